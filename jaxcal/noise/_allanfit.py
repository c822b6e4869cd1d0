r"""Fit the noise terms to an Allan variance curve, with intervals (`fit_curve`); and choose the band (`choose_band`, host only).

The test for an absent term is corrected for the skewness of the curve. The variances at long cluster times have few degrees of freedom,
so that the test statistic for K has a long tail. Treated as a normal variable, it would pass the 1 % threshold in 3 % of records without
K. The statistic is linear in the variances, z = w'(v - A theta), and the variances are quadratic in the record. Its cumulants therefore
follow from the density S of the fitted noise and the frequency response h = sum_m w_m H_m of the statistic,

.. math:: \kappa_2 = 2 \sum_k (S_k h_k)^2, \qquad \kappa_3 = 8 \sum_k (S_k h_k)^3,
          \qquad H_m(f) = \frac{2 \sin^4 \pi f m dt}{m^2 \sin^2 \pi f dt}

over the frequencies k/(2T). These sums neglect the ends of the record, and the exact covariance gives a larger variance w'Cw. This has
the same effect as fewer independent parts, so the skewness is multiplied by the square root of the ratio of the two variances. The
statistic is then taken to follow a gamma law of this skewness, which the cube root converts to a normal law.

Sources: spectral kernel, D. W. Allan, Proc. IEEE 54, 1966; cumulants of quadratic forms, A. M. Mathai and S. B. Provost,
Quadratic Forms in Random Variables, 1992; cube root, E. B. Wilson and M. M. Hilferty, Proc. Nat. Acad. Sci. 17, 1931.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._arrays import namespace
from .._types import AnyArray, Float
from ._curve import GUESSED, Curve, Lane, correlation, estimate, settle, whiten, whitened
from ._lanes import inverse
from ._limits import Limits, chance, find_limits
from ._terms import Term

#: relative misfit of the deviation that is allowed; chance of a worse chi-square below which a band is refused; chance below which the
#: intervals are widened to the observed scatter; octaves left out beyond the first cluster time at which the model passes
_TOLERANCE, _REFUSED, _WIDENED, _MARGIN = 0.0025, 0.001, 0.01, 1.0
#: change of the modelled variance at which a fit with one coefficient held stops, and its largest number of steps
_SETTLED, _MOST = 1e-3, 15
#: number of lowest frequencies that are bins of their own; bins per decade of the others; largest skewness, that of about one degree
#: of freedom
_SINGLE, _PER_DECADE, _LARGEST = 64, 40, 3.0


class Response(NamedTuple):
    """Bins of frequency: number of frequencies in each, kernels of the cluster sizes, and densities per squared coefficient."""

    number: Float[AnyArray, " bins"]
    kernel: Float[AnyArray, "clusters bins"]
    columns: Float[AnyArray, "bins p"]


def response(samples: int, m, dt: float, terms: tuple[Term, ...]) -> Response:
    """Kernels and densities for a record of `samples`."""
    per_decade = np.arange(np.log10(_SINGLE), np.log10(samples), 1.0 / _PER_DECADE)
    edges = np.unique(np.concatenate([np.arange(1, min(_SINGLE, samples)), np.round(10.0**per_decade), [samples]]))
    number, middle = np.diff(edges), (edges[:-1] + edges[1:] - 1) / 2.0
    half = np.pi * middle / (2.0 * samples)
    angle, width = half * m[:, None], np.maximum(number - 1, 0) / (2.0 * samples) * m[:, None]
    # sin^4 is averaged over the bin, because a bin at high frequency spans many periods
    fourth = 0.375 - np.cos(2.0 * angle) / 2.0 * np.sinc(width) + np.cos(4.0 * angle) / 8.0 * np.sinc(2.0 * width)
    kernel = 2.0 * fourth / (m[:, None] * np.sin(half)) ** 2 / (samples * dt)  # scaled so that a sum over frequencies is the variance
    frequency = middle / (2.0 * samples * dt)
    with jax.ensure_compile_time_eval():  # the densities do not depend on the record
        columns = [np.asarray(term.psd(frequency, dt)) for term in terms]
    return Response(number, kernel, np.stack(columns, axis=1))


def skewness(curve: Curve, used, heard: Response, at, index: int) -> Any:
    """Skewness of the test statistic of coefficient `index`, for noise with the coefficients `at`."""
    xp = namespace(curve, used, heard, at)
    matrix, scale = correlation(curve, used, at)
    rows = xp.where(used[:, None], curve.columns, 0.0) / scale[:, None]
    white = whiten(matrix, xp.concatenate([rows, xp.eye(len(used), dtype=rows.dtype)], axis=1))
    rows, back = white[:, : rows.shape[1]], white[:, rows.shape[1] :]
    here = np.arange(rows.shape[1]) == index
    others = xp.where((at != 0.0) & ~here, rows, 0.0)
    mine = rows[:, index]
    along = mine - others @ (inverse(others.T @ others) @ (others.T @ mine))
    weight = xp.where(used, back.T @ along / scale, 0.0)
    part = (heard.columns @ curve.noise(at)) * (weight @ heard.kernel)
    second = xp.maximum(2.0 * heard.number @ part**2, np.finfo(rows.dtype).tiny)
    part = part / xp.sqrt(second)
    return 8.0 * (heard.number @ part**3) * xp.sqrt(along @ along / second)


def as_normal(rise, skew):
    """Convert a rise of the chi-square to that of a statistic without skewness that has the same chance."""
    xp = namespace(rise, skew)
    z = xp.sqrt(xp.maximum(rise, 0.0))
    skew = xp.clip(skew, 0.0, _LARGEST)
    small = skew < 1e-3
    g = xp.where(small, 1.0, skew)
    root = (6.0 / g) * (xp.cbrt(1.0 + g * z / 2.0) - 1.0 + g**2 / 36.0)
    return xp.where(small, z, xp.maximum(root, 0.0)) ** 2


def alone(curve: Curve, used, cut) -> Lane:
    """The lane of one fit to the cluster sizes used, with all terms free; if short ones are cut off, the tail replaces Q."""
    xp = namespace(curve, used, cut)
    free = xp.append(~(cut & (curve.short > 0)), cut)
    return Lane(used[None], free[None], xp.zeros((1, len(free)), dtype=curve.v.dtype), free[None])


def freedom(used, theta) -> Any:
    """Degrees of freedom of the chi-square: cluster sizes used, minus coefficients that are not zero."""
    xp = namespace(used, theta)
    return (xp.sum(used, axis=-1) - xp.sum(theta != 0.0, axis=-1)).astype(theta.dtype)


def choose_band(curve: Curve, octave, used) -> tuple[AnyArray, bool, bool, Any]:
    """Choose the band: cluster sizes used, whether short ones are cut off, whether the model holds, and the estimate if none are cut.

    Filters and output averaging in a sensor spoil short cluster times. These are left out one by one until the chance of a worse
    chi-square of the others, with a misfit of 0.25 % of the deviation allowed, reaches one in a thousand. Another octave is then left
    out, because the model only just holds there. If no band passes, the one with the highest chance is used. Host only.
    """

    def chances(lanes: Lane):
        theta, change = estimate(curve, lanes)
        chi = settle(curve, lanes, theta, True, most=0, extra=(2.0 * _TOLERANCE * curve.v) ** 2).held
        found = chance(chi, freedom(lanes.used, theta))
        return np.where(np.isfinite(found), found, -1.0), (theta, change)

    (whole,), estimated = chances(alone(curve, used, np.asarray(False)))
    ranked = np.sort(octave[used])
    last = max(len(ranked) - len(curve.short) - 5, 0)  # last start that leaves enough cluster sizes to fit
    if whole >= _REFUSED or not last:
        return used, False, bool(whole >= _REFUSED), estimated
    tried = [alone(curve, used & (octave >= start), np.asarray(True)) for start in ranked[1 : last + 1]]
    found = np.append(whole, chances(jax.tree.map(lambda *leaves: np.concatenate(leaves), *tried))[0])
    passed = found >= _REFUSED
    best = int(np.argmax(passed)) if passed.any() else int(np.argmax(found))
    if best == 0:
        return used, False, False, estimated
    return used & (octave >= min(ranked[best] + _MARGIN, ranked[last])), True, bool(passed.any()), None


class Fitted(NamedTuple):
    """A fit of the curve: squared coefficients of the terms, their covariance and limits, and the chance of a worse chi-square.

    inflation : factor on the covariance and on the levels of the limits, above 1 if the curve scatters more than the noise model allows.
    step : last change of the modelled variance in the iteration. modelled : Allan variance of the fitted terms. edf : its degrees of
    freedom.
    """

    theta: AnyArray
    covariance: AnyArray
    limits: Limits
    goodness: Any
    inflation: Any
    step: Any
    modelled: AnyArray
    edf: AnyArray


def fit_curve(curve: Curve, used, cut, heard: Response, two_sided, one_sided, estimated: Any = None) -> Fitted:
    r"""Fit the cluster sizes `used`. `heard` is their frequency response, which the test for absent terms needs.

    At cluster times well above its own time constant, a filter turns white noise into N^2/tau + c/tau^2 with c of either sign, and a
    spectral line has the same effect. If short cluster times are `cut` off, a tail of that slope is therefore fitted with the other
    terms. It replaces the term that only short cluster times show (Q), which is then not estimated.
    """
    xp = namespace(curve, used, cut)
    p = len(curve.short)
    lanes = alone(curve, used, cut)
    fitted, change = (found[0] for found in estimated or estimate(curve, lanes))
    reported = lanes.free[0, :p]
    rows = xp.where(lanes.free[0][None, :], whitened(curve, used, fitted, True)[0], 0.0)
    spread = inverse(rows.T @ rows)  # (A' C^-1 A)^-1
    theta, covariance = xp.where(reported, fitted[:p], 0.0), spread[:p, :p]
    modelled = curve.columns[:, :p] @ theta

    # the intervals carry no derivative
    curve, fitted, spread = jax.lax.stop_gradient((curve, fitted, spread)) if xp is jnp else (curve, fitted, spread)
    # Q is tested without the tail: the tail has the same slope and may have either sign, so together with it Q would have no upper limit
    own = np.eye(p, p + 1, dtype=bool)
    admitted = xp.where(reported[:, None], lanes.free[0][None, :], own | xp.append(reported, False)[None, :])

    def lanes_of(free, held, wider=None):
        return Lane(xp.broadcast_to(used, (len(free), len(used))), free, held, free if wider is None else wider)

    several = xp.concatenate([admitted, lanes.free])
    again, none = xp.broadcast_to(fitted, several.shape), xp.zeros(several.shape, dtype=curve.v.dtype)
    least = settle(curve, lanes_of(several, none, several), again, True, most=0)
    number = freedom(used, fitted)
    goodness = chance(least.least[p], number)
    inflation = xp.where(goodness < _WIDENED, xp.maximum(least.least[p] / number, 1.0), 1.0)

    def ratio(index, value, state):
        """Rise of the chi-square when a coefficient is held, with C at the restricted fit; and the coefficients of that fit."""
        here, held = own[index], xp.where(own[index], value[:, None], 0.0)
        restricted = lanes_of(admitted[index] & ~here, held, admitted[index])
        found = settle(curve, restricted, xp.where(here, held, state), True, _SETTLED, _MOST)
        return xp.maximum(found.held - found.least, 0.0), found.theta

    # the fit with a coefficient held at zero starts from its own first guess. Started from the unrestricted fit it would oscillate
    # between two solutions, because C is then far too small at the cluster times that this coefficient explained
    absent = lanes_of(admitted & ~own, xp.zeros((p, p + 1), dtype=curve.v.dtype))
    begun = settle(curve, absent, absent.held, False, GUESSED).theta
    # the search starts at the minimum of the chi-square, which for generalised least squares is near theta but not equal to it
    reach = xp.sqrt(xp.where(reported, xp.diagonal(spread)[:p], spread[p, p]))
    middle = xp.diagonal(least.best[:p, :p])
    ends, without = find_limits(ratio, middle, reach, begun, two_sided * inflation, one_sided * inflation)
    skew = xp.stack([skewness(curve, used, heard, without[index], index) for index in range(p)])
    inside = xp.where(reported, fitted[:p], 0.0)
    limits = Limits(
        low=xp.where(reported, xp.minimum(ends.low, inside), 0.0),
        high=xp.maximum(ends.high, inside),
        upper=xp.maximum(ends.upper, inside),
        significance=xp.where(reported, as_normal(ends.significance / inflation, skew), 0.0),
    )
    variance = xp.diagonal(curve.covariance(xp.append(theta, 0.0)))
    edf = 2.0 * modelled**2 / xp.where(used & (variance > 0.0), variance, 1.0)
    return Fitted(theta, covariance * inflation, limits, goodness, inflation, change, modelled, edf)
