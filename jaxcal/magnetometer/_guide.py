"""`guide`: which attitude to read next, and when to stop."""

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._precision import host_float64, real_numbers
from .._quality import checked_confidence
from .._types import AnyArray, Samples
from ._beside import sphere_centre
from ._directions import HEADINGS, INCLINATION, attitude_in_words, by_iron, distance_slopes, heading_slopes, sphere_grid
from ._fit import fit
from ._quadric import COUNT, unit
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
    m: Samples, *, limit: float = np.deg2rad(1.0), candidates: Samples | None = None, inclination: float | None = None,
    confidence: float = 0.95,
) -> Guide:  # fmt: skip
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
    grid, few = sphere_grid(), len(m) < _FEWEST
    choice = None if candidates is None else np.asarray(candidates, dtype=np.float64).reshape(-1, 3)
    found = None if few else fit(m, model="symmetric", inclination=inclination)
    error = bound = np.inf
    if found is None or found.model is None or not np.isfinite(np.asarray(found.estimate.matrix)).all():
        # the direction farthest from those seen
        centre = sphere_centre(m) if len(m) else np.zeros(3)
        points = grid if choice is None else unit(choice - centre)
        gain = -(points @ unit(m - centre).T).max(axis=1, initial=-1.0)
        told = f"{len(m)} readings; from {_FEWEST} on an error can be stated" if few else "the readings leave the calibration open"
    else:
        slopes = heading_slopes(by_iron(found.model, found.field), HEADINGS, 0.0, float(found.inclination), found.down)
        covariance, weight = np.asarray(found.estimate.matrix), slopes.T @ slopes / len(slopes)
        # candidates stand for the readings that the model gives there: their noise would prefer those that point outwards
        points = grid if choice is None else unit(np.asarray(found.model.correct(choice)))
        rows = distance_slopes(found.model, float(found.field), points)
        variance = found.noise**2 + np.sum((rows @ covariance) * rows, axis=1)
        gain = np.sum((rows @ (covariance @ weight @ covariance)) * rows, axis=1) / variance
        form = weight @ covariance
        freedom = float(np.trace(form) ** 2 / np.trace(form @ form))  # of the chi-square distribution that approximates the form
        quantile = scipy.special.fdtri(freedom, max(len(m) - COUNT["symmetric"], 1), 1.0 - (1.0 - confidence) / _LOOKS)
        error = float(found.heading_error[0])
        bound = float(error * np.sqrt(quantile))
        told = f"heading error {np.rad2deg(error):.2g} deg rms expected, below {np.rad2deg(bound):.2g} deg at {100 * confidence:g} %"
    if found is not None and bound <= limit and found.verdict != "refused":
        return Guide(True, None, None, error, bound, f"Stop: {told}.", found)
    best = int(np.argmax(gain)) if len(gain) else None
    if choice is not None:
        return Guide(False, None, best, error, bound, f"{told}.", found)
    dip = inclination if inclination is not None else INCLINATION if found is None else float(found.inclination)
    return Guide(False, grid[best], None, error, bound, f"{told}. Next: {attitude_in_words(grid[best], dip)}.", found)
