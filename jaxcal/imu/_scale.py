"""`scale_figures`: deviations of one axis from a straight line, in ppm."""

from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Number
from .._precision import host_float64
from .._types import AnyArray

_LEAST_REPEATS = 6  # with at least so many degrees of freedom, the scatter of repeated rates replaces `sigma`


class ScaleFigures(eqx.Module):
    """Deviations of one axis from a straight line, in ppm; NaN for a figure that the inputs cannot show.

    Attributes
    ----------
    scale : slope of the least-squares line, reading per input.
    nonlinearity : largest deviation of the mean at any input from the line, relative to the output at the largest input.
    nonlinearity_noise : nonlinearity that noise alone exceeds in one of twenty tests.
    asymmetry : scale for positive inputs minus that for negative inputs, relative to their mean.
    asymmetry_interval : (2,) limits of the 95 % confidence interval.
    repeatability : standard deviation of the reading when an input is set again, relative to the output at the largest input.
    hysteresis : largest difference at one input between approach from below and from above, relative to the output at the largest input.
    hysteresis_noise : hysteresis that noise alone exceeds in one of twenty tests.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu._scale import scale_figures
    >>> rate = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    >>> found = scale_figures(rate, 1.01 * rate + 1e-4 * rate**3, sigma=1e-6)
    >>> round(float(found.scale), 3), round(float(found.nonlinearity))
    (1.01, 119)
    """

    scale: float
    nonlinearity: float
    nonlinearity_noise: float
    asymmetry: float
    asymmetry_interval: AnyArray
    repeatability: float
    hysteresis: float
    hysteresis_noise: float

    @property
    def headline(self) -> str:
        """The nonlinearity, beside that of noise alone."""
        return f"nonlinearity {self.nonlinearity:.3g} ppm of the largest output (noise alone: up to {self.nonlinearity_noise:.0f})"


def figure_numbers(one: ScaleFigures, prefix: str = "") -> dict[str, Number]:
    """The figures of an axis that the inputs show, by what a table calls them."""
    low, high = one.asymmetry_interval
    found = {
        "nonlinearity": Number("nonlinearity", one.nonlinearity), "  of noise alone": Number("nonlinearity_noise", one.nonlinearity_noise),
        "asymmetry": Number("asymmetry", one.asymmetry, float(low), float(high)),
        "repeatability": Number("repeatability", one.repeatability),
        "hysteresis": Number("hysteresis", one.hysteresis), "  of noise alone ": Number("hysteresis_noise", one.hysteresis_noise),
    }  # fmt: skip
    return {label: cell._replace(name=prefix + cell.name, quantity="ppm") for label, cell in found.items() if np.isfinite(cell.value)}


def _reach(freedom: float, number: int) -> float:
    """Size that the largest of `number` independent deviations exceeds with a probability of 5 %."""
    return float(scipy.special.stdtrit(freedom, 0.5 + 0.95 ** (1 / max(number, 1)) / 2))


@host_float64
def scale_figures(inputs: Any, readings: Any, sigma: Any = None) -> ScaleFigures:
    r"""Compute nonlinearity, asymmetry, repeatability and hysteresis of one axis, in ppm.

    .. math:: y_i = K\,x_i + y_0 + r_i,\qquad \text{nonlinearity} = \frac{\max_x|\bar r(x)|}{K\max|x|},\qquad
              \text{asymmetry} = \frac{2 (K_+ - K_-)}{K_+ + K_-}

    Parameters
    ----------
    inputs : (m,) three or more rates or specific forces, in the order in which they were set, because hysteresis depends on the order.
        Repeated inputs show the repeatability.
    readings : (m,) mean readings.
    sigma : standard deviation of a mean reading, one or (m,); used if few inputs were repeated (less than 6 repetitions), and needed if
        none was.

    Returns
    -------
    ScaleFigures

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu._scale import scale_figures
    >>> rate = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    >>> found = scale_figures(rate, 1.01 * rate + 1e-4 * rate**3, sigma=1e-6)
    >>> print(round(found.nonlinearity), round(found.asymmetry))
    119 0

    References
    ----------
    IEEE Std 952-1997 and Std 1431-2004 (scale factor tests), Std 1293-1998, and Std 528 for the words.
    """
    x, y = (np.asarray(part, dtype=float) for part in (inputs, readings))
    levels, which, number = np.unique(x, return_inverse=True, return_counts=True)
    mean = np.bincount(which, y) / number
    repeats = int(np.sum(number - 1))
    between = np.sum((y - mean[which]) ** 2)
    spread = np.sqrt(between / repeats) if repeats else np.nan
    error, freedom = float(spread), float(repeats)
    if sigma is not None and repeats < _LEAST_REPEATS:
        error, freedom = float(np.sqrt(np.mean(np.square(sigma)))), np.inf
    columns = np.stack([x, np.ones_like(x)], axis=1)
    inner = np.linalg.inv(columns.T @ columns)
    scale, offset = inner @ columns.T @ y
    left, full = y - columns @ np.array([scale, offset]), scale * np.abs(x).max()
    level = np.stack([levels, np.ones_like(levels)], axis=1)
    open_ = error * np.sqrt(np.maximum(1 / number - np.einsum("ij,jk,ik->i", level, inner, level), 0))
    curved = np.abs(np.bincount(which, left) / number)
    asymmetry, interval = _asymmetry(x, y, error, freedom)
    hysteresis, least = _hysteresis(x, left, which, error, freedom)
    over = 1e6 / abs(full)  # ppm
    noise = _reach(freedom, len(levels) - 2) * float(open_.max())
    sizes = float(curved.max() * over), noise * over, asymmetry, interval, float(spread * over), hysteresis * over, least * over
    return ScaleFigures(float(scale), *sizes)


def _asymmetry(x: np.ndarray, y: np.ndarray, error: float, freedom: float) -> tuple[float, np.ndarray]:
    """Asymmetry in ppm with its interval; NaN if the inputs do not determine a scale for each sign and an offset."""
    columns = np.stack([np.maximum(x, 0), np.minimum(x, 0), np.ones_like(x)], axis=1)
    if np.linalg.matrix_rank(columns) < 3:
        return np.nan, np.full(2, np.nan)
    inner = np.linalg.inv(columns.T @ columns)
    up, down, _ = inner @ columns.T @ y
    apart = np.array([1.0, -1.0, 0.0])
    half = scipy.special.stdtrit(freedom, 0.975) * error * np.sqrt(apart @ inner @ apart)
    over = 2e6 / (up + down)  # ppm
    value = (up - down) * over
    return float(value), value + abs(half * over) * np.array([-1.0, 1.0])


def _hysteresis(x: np.ndarray, left: np.ndarray, which: np.ndarray, error: float, freedom: float) -> tuple[float, float]:
    """Largest difference between inputs reached from below and from above, and the largest difference that noise would give."""
    step = np.concatenate([[0.0], np.diff(x)])
    found = []
    for level in range(which.max() + 1):
        up, down = (left[(which == level) & side] for side in (step > 0, step < 0))
        if len(up) and len(down):
            found.append((abs(up.mean() - down.mean()), error * np.sqrt(1 / len(up) + 1 / len(down))))
    if not found:
        return np.nan, np.nan
    size, noise = np.array(found).T
    return float(size.max()), float(_reach(freedom, len(found)) * noise.max())
