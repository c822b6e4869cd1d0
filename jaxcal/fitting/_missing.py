"""`missing`: what a result would change by if its model had a further term (host, NumPy)."""

from collections.abc import Mapping

import equinox as eqx
import numpy as np

from .._special import chi_square_tail, f_tail

#: least degrees of freedom to judge a term, or a prediction; least share of a term's effect, in length, that no parameter reproduces
LEAST, _APART = 3, 0.05
LEVEL = 1e-3  # of the test: one false alarm in a thousand results, whatever the number of terms tried


class Missing(eqx.Module):
    """A term that a model lacks: its size by the residuals, and what the result would change by with it.

    Attributes
    ----------
    name : of the term.
    coefficient : (q,) sizes of its coefficients, by the residuals and the parameters together.
    covariance : (q, q) of the coefficients; infinite if the parameters reproduce the term, so that the residuals cannot show it.
    change : (p, q) what each parameter of the result would change by for a unit of each coefficient.
    log_level : logarithm of `level`, which may be too small for a number.
    odds : by how much the residuals make the term more probable (Bayes factor with a prior of unit information); zero if they cannot.
    better : whether the term improves the prediction of residuals that were left out of the fit.
    """

    name: str = eqx.field(static=True)
    coefficient: np.ndarray
    covariance: np.ndarray
    change: np.ndarray
    log_level: float
    odds: float
    better: bool

    @property
    def level(self) -> float:
        """Probability of a fit at least as much better if the term is absent, times the number of terms tried; one at most."""
        return float(np.exp(min(self.log_level, 0.0)))

    @property
    def shown(self) -> bool:
        """Whether the residuals show the term."""
        return bool(self.better and self.log_level < np.log(LEVEL))

    @property
    def shift(self) -> np.ndarray:
        """(p,) what the parameters would change by, with the size that the residuals show."""
        return self.change @ np.where(np.isfinite(np.diag(self.covariance)), self.coefficient, 0.0)


def missing(
    rows: np.ndarray, jacobian: np.ndarray, terms: Mapping[str, np.ndarray], sigma: float | None = None, least: float = 0.0
) -> list[Missing]:
    """Test terms that a model lacks, on the residuals of its fit; the one that the residuals show most comes first.

    Parameters
    ----------
    rows : (n,) residuals in units of their standard deviation, times the roots of their weights. Zeros of padding do not count.
    jacobian : (n, p) their derivative by the parameters, with the same weights; a column of zeros is a parameter of other residuals.
    terms : name -> (n, q) by how much the residuals are larger for a unit of each coefficient, with the same weights.
    sigma : standard deviation of the rows; None estimates it from what the larger model leaves of them.
    least : standard deviation of the rows by the noise of the sensor alone, a lower bound of the unknown one that `odds` begin at.

    Returns
    -------
    One `Missing` for each term for which at least 3 degrees of freedom are left, or none if `sigma` is given, by `level`.

    Examples
    --------
    A line is fitted to readings with a quadratic term of 0.3, which moves its slope by 0.3:

    >>> import numpy as np
    >>> from jaxcal.fitting._missing import missing
    >>> x = np.linspace(0, 1, 50)
    >>> line, noise = np.stack([np.ones(50), x], axis=1), 0.01 * np.random.default_rng(0).normal(size=50)
    >>> y = 1 + 2 * x + 0.3 * x**2 + noise
    >>> left = y - line @ np.linalg.lstsq(line, y)[0]
    >>> best = missing(left, -line, {"quadratic": x[:, None] ** 2, "cubic": x[:, None] ** 3})[0]
    >>> best.name, best.shown, round(float(best.coefficient[0]), 1), best.change.ravel().round(2).tolist()
    ('quadratic', True, 0.3, [0.16, -1.0])

    References
    ----------
    R. D. Cook and S. Weisberg, Residuals and Influence in Regression, Chapman and Hall 1982, chapter 2 (added variables).
    """
    counted = np.any(jacobian != 0, axis=1) | (rows != 0)
    rows, jacobian, terms = rows[counted], jacobian[counted], {name: x[counted] for name, x in terms.items()}
    # columns of one length, so that parameters of different units do not decide on the rank
    size = np.linalg.norm(jacobian, axis=0)
    used = size > 0
    basis, values, right = np.linalg.svd(jacobian[:, used] / size[used], full_matrices=False)
    kept = values > len(rows) * np.finfo(float).eps * values.max(initial=0.0)
    basis, inverse = basis[:, kept], (right[kept].T / values[kept]) / size[used][:, None]
    plain, found = rows - basis @ (basis.T @ rows), []
    without, share = np.sum(plain**2), np.sum(basis**2, axis=1)
    number = max(len(rows) - basis.shape[1], 1)
    top = 10 * max(np.sqrt(without / number), least, 1e-150)
    sizes = np.geomspace(max(least, 1e-4 * top), top, 50)
    for name, x in terms.items():
        freedom = len(rows) - basis.shape[1] - x.shape[1]
        if freedom < (LEAST if sigma is None else 0):
            continue
        change = np.zeros((len(used), x.shape[1]))
        change[used] = inverse @ (basis.T @ x)
        apart = x - basis @ (basis.T @ x)
        # six faces, for example, cannot distinguish a cubic term from a scale factor
        if np.any(np.linalg.norm(apart, axis=0) <= _APART * np.linalg.norm(x, axis=0)):
            nothing = np.zeros(x.shape[1])
            found.append(Missing(name, nothing, np.diag(nothing + np.inf), change, np.inf, 0.0, False))
            continue
        root, upper = np.linalg.qr(apart)
        coefficient = np.linalg.solve(upper, root.T @ plain)
        left = plain - root @ (root.T @ plain)
        gain, square = max(without - np.sum(left**2), 0.0), np.sum(left**2)
        variance = max(square / freedom, 1e-300) if sigma is None else sigma**2
        times = gain / variance
        level = f_tail(times / x.shape[1], x.shape[1], freedom) if sigma is None else chi_square_tail(times, x.shape[1])
        likelihood = number / 2 * np.log(without / max(square, 1e-300)) if sigma is None else times / 2
        # the leading part of the logarithm where the number is too small
        log_level = float((np.log(level) if level > 0 else -likelihood) + np.log(len(terms)))
        evidence = likelihood if sigma is not None else _likelihood(square, number, sizes) - _likelihood(without, number, sizes)
        odds = float(np.exp(min(evidence - x.shape[1] / 2 * np.log(number), 700.0)))
        inner = np.linalg.inv(upper)
        better = _left_out(left, share + np.sum(root**2, axis=1)) < _left_out(plain, share)
        found.append(Missing(name, coefficient, inner @ inner.T * variance, change, log_level, odds, better))
    return sorted(found, key=lambda one: one.log_level)


def _likelihood(square: float, number: int, sizes: np.ndarray) -> float:
    """Logarithm of the mean likelihood of residuals with this sum of squares: half for the first of the standard deviations.

    A factor that all models share is left out. The others are evenly spaced in the logarithm: each multiple is equally probable.
    """
    each = -number * np.log(sizes) - square / 2 / sizes**2
    each[0] += np.log(len(sizes) - 1)
    return float(np.logaddexp.reduce(each))


def _left_out(left: np.ndarray, share: np.ndarray) -> float:
    """Sum of the squared leave-one-out residuals, from the residuals and their leverage."""
    return float(np.sum((left / np.maximum(1 - share, 1e-3)) ** 2))
