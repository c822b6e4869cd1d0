"""`mean_covariance`: covariance of the means over several stretches of one record."""

import numpy as np

from .._errors import DataError
from .._precision import array_module, host_float64
from .._types import AnyArray, Samples
from ._model import Noise


@host_float64
def mean_covariance(noise: Noise, start: Samples, dwell: Samples, weight: Samples | None = None) -> AnyArray:
    r"""Exact covariance of the means of a sensor's noise over several stretches of one record.

    With G the generalised covariance of the integral of the noise (`Term.integral`), the means over [a, a + A] and [b, b + B] have

    .. math:: \mathrm{Cov} = \frac{G(a+A-b-B) - G(a+A-b) - G(a-b-B) + G(a-b)}{A B}

    up to a constant that is common to all pairs. Flicker and a random walk do not determine this constant, because their mean over all
    time is infinite or depends on when the record began. The function chooses it so that the wandering terms (all terms except Q and N)
    are measured from their mean over all stretches, weighted by length. The bias of a sensor is then its mean over the measured time. An
    estimate with a free bias does not depend on this choice.

    Parameters
    ----------
    noise : noise model of one channel. A ramp R contributes nothing, because it is not random.
    start : (n,) beginning of each stretch, s. The stretches must not overlap.
    dwell : (n,) length of each stretch, s.
    weight : (n,) weight of each stretch in the common mean; its length by default. Zero excludes a stretch from the mean.

    Returns
    -------
    (n, n) array in the unit of B squared. It can be differentiated with respect to the coefficients, times and lengths.

    Raises
    ------
    DataError
        If the noise has several channels, or start and dwell differ in length.

    Examples
    --------
    Standard deviation of the difference between two means of flicker over 100 s that begin 1000 s apart:

    >>> import numpy as np
    >>> from jaxcal.noise import Noise, mean_covariance
    >>> c = mean_covariance(Noise(B=1.0), np.array([0.0, 1000.0]), np.array([100.0, 100.0]))
    >>> print(np.sqrt(c[0, 0] + c[1, 1] - 2 * c[0, 1]).round(3))
    1.556

    References
    ----------
    G. Matheron, Adv. Appl. Prob. 5, 1973, 439-468 (generalised covariances).
    """
    xp = array_module(noise, start, dwell, weight)
    begin, length = xp.asarray(start), xp.asarray(dwell)
    if begin.ndim != 1 or begin.shape != length.shape:
        raise DataError(f"start has shape {begin.shape} and dwell {length.shape}; give one number for each stretch")
    if any(np.ndim(coefficient) for _, coefficient, _ in noise.parts):
        raise DataError("noise must be the model of one channel; take noise.channel(i)")
    size = length if weight is None else xp.asarray(weight)
    whole = xp.sum(size)
    share = size / xp.where(whole > 0, whole, 1)
    end = begin + length
    area = length[:, None] * length[None, :]
    lags = xp.stack([first[:, None] - second[None, :] for first, second in ((end, end), (end, begin), (begin, end), (begin, begin))])
    total = wander = xp.zeros_like(area)
    for name, coefficient, term in noise.parts:
        if isinstance(coefficient, (int, float)) and coefficient == 0:
            continue  # not part of the model
        if name == "N":
            total = total + xp.diag(coefficient**2 / length)
            continue
        g = term.integral(lags)
        part = coefficient**2 * (g[0] - g[1] - g[2] + g[3]) / area
        total, wander = (total + part, wander) if name == "Q" else (total, wander + part)
    wander = wander - (share @ wander)[None, :] - (wander @ share)[:, None] + share @ wander @ share
    return total + wander
