"""Errors that are correlated along a log: a test whether residuals are white, and a covariance from fits without parts of the log.

A part of a log shows the log's correlation only if it contains most of what the fit needs. So few and long parts are left out, one at a
time. The parts overlap: they are windows of a sixth of the log, spaced by a quarter of their length. Each refit is one Gauss-Newton step
from the solution. This is exact for a model that is linear there, and needs no compilation.
"""

import itertools
from typing import Any

import numpy as np

from .._arrays import interpolated
from .._special import chi_square_tail, f_tail

#: number of parts of a log; on real logs the errors were right with six, but too small with ten or twenty
BLOCKS = 6
_STEPS = 4  # number of windows that begin in each part
_PIECES = BLOCKS * _STEPS  # the fewest readings that can tell, and the most lags of their autocorrelation
_FAR = 3.5  # standard deviations
CHANCE = 0.003  # error probability of each of the two tests of whiteness


def span_of(jacobian: np.ndarray) -> np.ndarray:
    """Orthonormal columns (n, p) that span the changes of the residuals with the parameters."""
    unit = jacobian / np.sqrt((jacobian * jacobian).sum(axis=0))
    # a floor keeps the normal equations regular, and what is lost in their rounding out of the span
    return unit @ np.linalg.inv(np.linalg.cholesky(unit.T @ unit + len(unit) * np.finfo(float).eps * np.eye(unit.shape[1]))).T


def tamed(span: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """Residuals clipped at 3.5 robust standard deviations and orthogonal to the Jacobian, because single outliers prove nothing."""
    most = _FAR * 1.4826 * interpolated(np.abs(residuals), 0.5)
    residuals = np.minimum(np.maximum(residuals, -most), most)
    return residuals - span @ (span.T @ residuals)


def is_white(jacobian: np.ndarray, residuals: np.ndarray, calm: np.ndarray | None = None) -> bool:
    """Whether residuals in the order of a log look independent.

    Two tests examine the residuals: one their autocorrelation, the other whether parts of the log need parameters of their own. Each test
    mistakes white residuals for correlated ones in three of a thousand logs.

    Parameters
    ----------
    jacobian : (n, p) derivative of the residuals at the solution.
    residuals : (n,) in the order of time.
    calm : these as `tamed`, where they are known.

    Returns
    -------
    True if neither test finds dependence, or if there are fewer than 24 residuals.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.fitting._serial import is_white
    >>> noise = np.random.default_rng(0).normal(size=300)
    >>> is_white(np.ones((300, 1)), noise), is_white(np.ones((300, 1)), np.cumsum(noise))
    (True, False)

    References
    ----------
    G. M. Ljung and G. E. P. Box, Biometrika 65 (1978) 297; G. C. Chow, Econometrica 28 (1960) 591.
    """
    n, free = jacobian.shape
    if n < _PIECES:
        return True  # too few to tell
    residuals = tamed(span_of(jacobian), residuals) if calm is None else calm
    lags = np.arange(1, min(_PIECES, n // 8) + 1)
    products = np.correlate(np.concatenate([residuals, np.zeros(len(lags))]), residuals)  # at each lag, from zero on
    correlation = products[1:] / products[0]
    statistic = n * (n + 2) * (correlation @ (correlation / (n - lags)))
    if chi_square_tail(statistic, len(lags)) < CHANCE:
        return False
    parts = min(BLOCKS, n // (2 * free))
    if parts < 2:
        return True
    hats, scores = _in_parts(jacobian, residuals, parts)
    # a floor drops the combinations that a part does not determine
    floor = np.finfo(float).eps ** 0.75 * hats.trace(axis1=1, axis2=2)
    inverse = np.linalg.inv(hats + floor[:, None, None] * np.eye(free))
    gain, used = np.einsum("kp,kpq,kq", scores, inverse, scores), round((inverse * hats).sum())
    if used <= free or used >= n:
        return True
    ratio = gain / (used - free) / ((products[0] - gain) / (n - used))
    return bool(f_tail(ratio, used - free, n - used) >= CHANCE)


def _in_parts(jacobian: np.ndarray, residuals: np.ndarray, parts: int) -> tuple[np.ndarray, np.ndarray]:
    """J'J (k, p, p) and J'r (k, p) of equally long parts of a log."""
    both, edges = np.vstack([jacobian.T, residuals]), np.round(np.arange(parts + 1) * len(residuals) / parts).astype(int)
    products = np.array([both[:, a:b] @ both[:, a:b].T for a, b in itertools.pairwise(edges)])
    return products[:, :-1, :-1], products[:, :-1, -1]


def leave_out(jacobian: np.ndarray, residuals: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
    r"""Covariance of parameters whose residuals are correlated along a log: a jackknife of overlapping windows.

    .. math:: C = \frac{m - 1}{w} \sum_i (\theta_i - \bar\theta)(\theta_i - \bar\theta)^T

    with m = 6 parts, w = 21 windows of a sixth of the log, and a Gauss-Newton step without each window. In contrast, `covariance` of kind
    "jackknife" refits in full, and leaves out each part once.

    Parameters
    ----------
    jacobian : (n, p) derivative of the residuals at the solution.
    residuals : (n,) in the order of time.
    known : (p, p) information from other sources than the residuals, such as a prior; every refit uses it.

    Returns
    -------
    (p, p); infinite if the log without a window does not determine the parameters. The covariance has five degrees of freedom.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.fitting._serial import leave_out
    >>> noise = np.convolve(np.random.default_rng(0).normal(size=619), np.ones(20), mode="valid")
    >>> bool(leave_out(np.ones((600, 1)), noise)[0, 0] > 4 * np.var(noise) / 600)
    True

    References
    ----------
    H. R. Kunsch, The Annals of Statistics 17 (1989) 1217 (the jackknife of moving blocks).
    """
    n, free = jacobian.shape
    known = np.zeros((free, free)) if known is None else known
    # what only the other sources show has a column of zeros
    size = np.sqrt(np.sum(jacobian**2, axis=0) + np.diag(known))
    if n < 2 * free or not (size > 0).all():
        return np.full((free, free), np.inf)
    matrix = leave_out_pieces(*_in_parts(jacobian / size, residuals, _PIECES), known / np.outer(size, size))
    return matrix / np.outer(size, size)


def leave_out_pieces(hats: np.ndarray, scores: np.ndarray, known: np.ndarray) -> np.ndarray:
    """`leave_out` from what consecutive pieces of a log, all as long, say: J'J (k, p, p) and J'r (k, p) of each; k is a multiple of 24."""
    free, width = hats.shape[-1], len(hats) // BLOCKS
    whole, score = hats.sum(axis=0) + known, scores.sum(axis=0)
    size = np.sqrt(np.diag(whole))
    steps = []
    for first in range(0, len(hats) - width + 1, width // _STEPS):
        window = slice(first, first + width)
        rest = whole - hats[window].sum(axis=0)
        if np.linalg.eigvalsh(rest / np.outer(size, size))[0] < 1e-10 * free:
            return np.full((free, free), np.inf)
        steps.append(np.linalg.solve(rest, score - scores[window].sum(axis=0)))
    off = np.array(steps) - np.mean(steps, axis=0)
    return (BLOCKS - 1) / len(off) * off.T @ off


def by_parts(white: Any, jacobian: np.ndarray, left: np.ndarray, prior: Any = None, calm: Any = None) -> tuple[np.ndarray, bool]:
    """Covariance of the parameters by fits without parts of the log, and True; if its residuals look white, the given one, and False.

    No parameter is known better than by white residuals. prior : information (p, p) that no part of the log takes away. calm : as for
    `is_white`.
    """
    shown = np.abs(jacobian).max(axis=0) > 0  # others are in the prior alone
    if is_white(jacobian if shown.all() else jacobian[:, shown], left, calm):
        return white, False
    other = leave_out(jacobian, left, prior)
    if prior is not None:
        if not np.isfinite(other).all():
            return white, False  # too few to leave any out, and the prior holds what they leave open
        other = other + white @ prior @ white
    ratio = np.sqrt(np.maximum(np.diag(white) / np.maximum(np.diag(other), 1e-300), 1.0))
    return other * np.outer(ratio, ratio), True


def correlation_time(residuals: np.ndarray) -> float:
    """Number of readings that count as one: the sum of the autocorrelation up to where its own noise hides it."""
    n = len(residuals)
    values = np.fft.irfft(np.abs(np.fft.rfft(residuals, 2 * n)) ** 2)[: max(n // 4, 2)]
    values = values / values[0]
    lost = values < 2 / np.sqrt(n)
    return float(max(1 + 2 * np.sum(values[1 : np.argmax(lost) if lost.any() else len(values)]), 1.0))


def followed(span: np.ndarray, causes: dict[str, np.ndarray], calm: np.ndarray) -> dict[str, tuple[np.ndarray, float]]:
    """Coefficients (k,) of each cause's columns (n, k) that residuals follow beside the parameters, and the chance of that by accident.

    span : orthonormal columns that span the changes with the parameters. calm : residuals as `tamed`. A cause is left out where the
    parameters imitate a column, and where white residuals, too, would often seem to follow. Correlation raises the chance of the others.
    """
    columns = np.concatenate([*causes.values(), calm[:, None]], axis=1)
    seen = span.T @ columns
    free = columns - span @ seen
    products, eps, last, found = free.T @ free, np.finfo(float).eps, 0, {}
    squares, square, nothing = products.diagonal(), products[-1, -1], 1e-24 * len(calm)
    whole = squares + (seen * seen).sum(axis=0)
    own = squares > np.maximum(1e-12 * whole, nothing)
    sizes, imitated = np.where(own, np.sqrt(squares), np.inf), ~own & (whole > nothing)
    for name, part in causes.items():
        here = slice(last, last := last + part.shape[1])
        size, count = sizes[here], int(own[here].sum())
        if not count or imitated[here].any():
            continue
        along = products[here, -1] / size
        # a floor keeps the products of columns of length one regular
        explained = along @ np.linalg.solve(products[here, here] / (size * size[:, None]) + eps * np.eye(size.size), along)
        if chi_square_tail(len(calm) * np.log(square / max(square - explained, eps * square)), count) < CHANCE:
            coefficients = np.linalg.lstsq(free[:, here] / size, calm, rcond=1e-9)[0]
            rest = calm - free[:, here] @ (coefficients / size)
            gain = len(calm) / correlation_time(rest) * np.log(square / (rest @ rest))
            found[name] = coefficients / size, float(chi_square_tail(gain, count))
    return found
