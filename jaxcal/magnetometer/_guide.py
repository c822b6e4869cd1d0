"""`guide`: which attitude to read next, and when to stop."""

from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._precision import host_float64, real_numbers
from .._quality import checked_confidence
from .._types import AnyArray, Float
from ._design._coverage import sphere_grid
from ._design._heading_error import HEADINGS, by_iron, distance_slopes, heading_slopes
from ._ellipsoid._kinds import COUNT
from ._ellipsoid._shape import unit
from ._fit import fit
from ._result import MagFit

_FEWEST = 12  # number of readings from which the fit gives the advice; before, the largest gap between directions does
_LOOKS = 5.0  # the error is checked after every reading, and one lucky check ends the session: they count as this many independent ones


class Guide(eqx.Module):
    """Advice on the next reading.

    Attributes
    ----------
    stop : whether the heading error is below the limit, at the requested confidence.
    direction : (3,) unit vector in the sensor's axes along which the field should point at the next reading; None if candidates were
        given.
    candidate : index of the best candidate; None if there are no candidates.
    heading_error : expected rms heading error in rad of the readings so far; infinite with fewer than twelve readings.
    bound : upper limit of the heading error in rad at the requested confidence.
    reason : the advice as a sentence.
    fit : the fit of the readings so far; None with fewer than twelve.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import body_field, guide, scenario
    >>> m = body_field(scenario("all"), 50e-6) + 50e-9 * np.random.default_rng(0).normal(size=(len(scenario("all")), 3))
    >>> found = guide(m[:5])
    >>> found.stop, found.reason[:40]
    (False, '5 readings; from 12 on an error can be s')
    """

    stop: bool
    direction: AnyArray | None
    candidate: int | None
    heading_error: float
    bound: float
    reason: str
    fit: MagFit | None


@host_float64
def guide(
    m: Any, *, limit: float = np.deg2rad(1.0), candidates: Any = None, inclination: float | None = None, confidence: float = 0.95
) -> Guide:
    r"""Which reading would lower the heading error most, and whether the readings so far are enough.

    A reading whose distance to the ellipsoid has the slope r lowers the mean square heading error tr(W C) by

    .. math:: \frac{r C W C r^T}{\sigma^2 + r C r^T},

    where C is the covariance of the nine parameters, W the mean outer product of the heading's slopes, and :math:`\sigma` the noise of a
    reading. With fewer than twelve readings, the next direction is the one farthest from those seen. The squared error of one calibration
    is a quadratic form of nine normal parameters. Its upper limit is a quantile of the F distribution. The numerator's degrees of freedom
    come from the mean and variance of the form (Satterthwaite), the denominator's from the noise. Because the limit is checked after every
    reading, a lucky check would stop too early. So the error probability is divided by five, as for five independent checks (Bonferroni).

    Parameters
    ----------
    m : (n, 3) readings so far, in tesla or in counts.
    limit : wanted rms heading error in rad, at level.
    candidates : (k, 3) readings to choose from, when a log is replayed; by default all directions.
    inclination : dip of the field in rad, as in `fit`.
    confidence : level at which the error must be below the limit.

    Returns
    -------
    Guide

    Raises
    ------
    DataError
        If the readings are not (n, 3) finite numbers, or the limit is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import body_field, guide, scenario
    >>> m = body_field(scenario("all"), 50e-6) + 50e-9 * np.random.default_rng(0).normal(size=(len(scenario("all")), 3))
    >>> few, many = guide(m[:5]), guide(m)
    >>> few.stop, many.stop
    (False, True)

    References
    ----------
    V. Fedorov, Theory of Optimal Experiments, 1972 (sequential L-optimal design). F. E. Satterthwaite, Biometrics Bulletin 2, 1946.
    """
    m = real_numbers(m, "the readings")
    if m.ndim != 2 or m.shape[1] != 3 or not np.isfinite(m).all():
        raise DataError(f"The readings must be (n, 3) finite numbers; got the shape {m.shape}.")
    if not limit > 0:
        raise DataError(f"The limit must be positive, in rad; got {limit:g}.")
    confidence = checked_confidence(confidence)
    choice = None if candidates is None else np.asarray(candidates, dtype=np.float64).reshape(-1, 3)
    if len(m) < _FEWEST:
        return _by_gap(m, choice, f"{len(m)} readings; from {_FEWEST} on an error can be stated", None)
    found = fit(m, model="symmetric", inclination=inclination)
    if found.model is None or not np.isfinite(np.asarray(found.iron_covariance)).all():
        return _by_gap(m, choice, "the readings leave the calibration open", found)
    slopes = heading_slopes(by_iron(found.model, found.field), HEADINGS, 0.0, float(found.inclination), found.down)
    covariance, weight = np.asarray(found.estimate.matrix), slopes.T @ slopes / len(slopes)
    grid = sphere_grid()
    # candidates stand for the readings that the model gives there: their noise would prefer those that point outwards
    points = grid if choice is None else unit(np.asarray(found.model.correct(choice)))
    rows = distance_slopes(found.model, float(found.field), points)
    gain = np.sum(rows @ (covariance @ weight @ covariance) * rows, axis=1) / (found.noise**2 + np.sum(rows @ covariance * rows, axis=1))
    form = weight @ covariance
    mean, spread = float(np.trace(form)), float(np.trace(form @ form))
    freedom = mean**2 / spread  # of the chi-square distribution that approximates the form
    quantile = scipy.special.fdtri(freedom, max(len(m) - COUNT["symmetric"], 1), 1.0 - (1.0 - confidence) / _LOOKS)
    error = float(found.heading_error[0])
    bound = float(error * np.sqrt(quantile))
    stop = bool(bound <= limit and found.verdict != "refused")
    best = int(np.argmax(gain)) if len(gain) else None
    told = f"heading error {np.rad2deg(error):.2g} deg rms expected, below {np.rad2deg(bound):.2g} deg at {100 * confidence:g} %"
    if stop:
        return Guide(True, None, None, error, bound, f"Stop: {told}.", found)
    direction = grid[best] if choice is None and best is not None else None
    return Guide(False, direction, None if choice is None else best, error, bound, f"{told}. {_next(direction)}".strip(), found)


def _by_gap(m: AnyArray, choice: AnyArray | None, said: str, found: MagFit | None) -> Guide:
    """Advice to read the direction, or the candidate, that is farthest from all readings so far."""
    if choice is not None:
        apart = np.linalg.norm(choice[:, None] - m[None], axis=2).min(axis=1) if len(m) else np.zeros(len(choice))
        best = int(np.argmax(apart)) if len(choice) else None
        return Guide(False, None, best, np.inf, np.inf, f"{said}.", found)
    grid = sphere_grid()
    seen = m - (_centre(m) if len(m) else 0.0)
    length = np.linalg.norm(seen, axis=1, keepdims=True)
    seen = seen[length[:, 0] > 0] / length[length > 0][:, None]
    nearest = (grid @ seen.T).max(axis=1) if len(seen) else np.zeros(len(grid))
    direction = grid[int(np.argmin(nearest))]
    return Guide(False, direction, None, np.inf, np.inf, f"{said}. {_next(direction)}", found)


def _centre(m: AnyArray) -> Float[np.ndarray, "3"]:
    """Centre of the sphere through the readings; if they do not determine one, the solution nearest to their mean."""
    middle = m.mean(axis=0)
    away = m - middle
    square = np.sum(away**2, axis=1)
    return middle + np.linalg.lstsq(2.0 * away, square - square.mean(), rcond=1e-2)[0]


def _next(direction: AnyArray | None) -> str:
    if direction is None:
        return ""
    axes = ", ".join(f"{value:+.2f}" for value in direction)
    return f"Next, turn the sensor so that the field points along ({axes}) in its axes (x, y, z)."
