r"""Methods "log" and "slope", which fit an Allan deviation curve without uncertainty.

They serve for comparison with older work. With ad the Allan deviation and v its square:

- log: :math:`\min_{\theta \ge 0} \sum (\ln A\theta - \ln v)^2` over cluster sizes. All count alike, however well they are known, so
  that B and K scatter by 30 to 40 % where weights give 11 and 23 %, and absent terms come out positive.
- slope: tangents of slope -1, -1/2, +1/2 and +1 (Q, N, K and R), drawn where the slope of the curve is nearest to theirs and read at
  tau = sqrt 3, 1, 3 and sqrt 2 s. B is the minimum of ad divided by 0.664 (thesis, section 5.4.4; IEEE Std 952-1997, annex C). Tangents
  blame one term for what several add up to: B comes out about 44 % too high on a gyroscope with N, B and K, and where B is absent.

No valid error propagation exists for these methods. Intervals, limits, significances and the covariance are therefore unknown.
`goodness` is the chance of a worse chi-square about the fitted curve.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np

from .._arrays import namespace
from .._errors import DataError, FitError
from .._precision import is_traced
from ..allan import Deviation
from ..fitting import solve
from ._allanfit import freedom
from ._checks import Asked
from ._curve import Curve, curve_of, differences, whitened
from ._findings import FINDINGS
from ._limits import chance
from ._result import NoiseFit, assemble
from ._terms import Term

#: term -> slope in log-log, time in s at which its tangent is read, and the local slope that the curve must go below (rising: above)
#: for the term to be reported
_TANGENTS = {"Q": (-1.0, math.sqrt(3.0), -0.75), "N": (-0.5, 1.0, math.inf), "K": (0.5, 3.0, 0.25), "R": (1.0, math.sqrt(2.0), 0.75)}


def fit_plainly(y, asked: Asked) -> NoiseFit:
    """Fit the overlapped Allan deviation of one channel without uncertainty."""
    return fit_deviation(asked.deviation(y), len(y), asked.terms, asked.inside, asked.method, asked.confidence)


def fit_deviation(curve: Deviation, samples: int, terms: tuple[Term, ...], inside, method: str, confidence: float) -> NoiseFit:
    """Fit the cluster sizes `inside` of a curve."""
    xp, traced = namespace(curve.deviation), is_traced(curve.deviation)
    data, used, unit = curve_of(curve, samples, terms, curve.deviation**2, inside)
    theta = _logarithmic(data, used, traced) if method == "log" else _tangents(curve, terms, inside if traced else used) / unit
    whole = xp.append(theta, 0.0)
    rows, target = whitened(data, used, whole, True)
    goodness = chance(xp.sum((target - rows @ whole) ** 2), freedom(used, whole))
    unknown = xp.full((len(terms), len(terms)), np.nan, dtype=theta.dtype)
    return assemble(
        theta * unit, unknown, None, terms, curve, samples / curve.rate, goodness=goodness, used=inside, confidence=confidence,
        method=method, band=(np.min(curve.tau[inside]), np.max(curve.tau[inside])),
        findings=() if traced else (*getattr(curve, "findings", ()), FINDINGS("no_intervals", method=method)),
    )  # fmt: skip


def _weighted(data: Curve, used, weight):
    """Squared coefficients by least squares with the given weights."""
    xp, columns = namespace(data), data.columns[:, :-1]
    root = xp.sqrt(xp.where(used, weight, 0.0))
    rows = {"rows": columns * root[:, None], "target": data.v * root}
    found = solve(differences, np.zeros(columns.shape[1], dtype=columns.dtype), rows, bounds=(0.0, np.inf)).parameters
    return found if xp is jnp else np.asarray(found)


def _logarithmic(data: Curve, used, traced: bool):
    """Squared coefficients by least squares on the logarithms."""
    still = jax.lax.stop_gradient(data) if traced else data
    xp, columns = namespace(data), data.columns[:, :-1]
    touching = xp.min(xp.where(used[:, None], still.v[:, None] / columns, np.inf), axis=0)
    # in units of the largest possible value of each coefficient; the start is a hundredth of it away from the bounds
    start = _weighted(still, used, 1.0 / still.v**2) / touching + 0.01
    found = solve(_log_residuals, start, {"columns": columns * touching[None, :], "v": data.v, "used": used}, bounds=(0.0, np.inf))
    if not traced and not bool(found.usable):
        raise FitError(f"the logarithmic fit did not end well: {found.message}")
    return (found.model if xp is jnp else np.asarray(found.model)) * touching


def _log_residuals(theta, data):
    fitted = data["columns"] @ theta
    positive = fitted > 0.0  # both branches must stay finite for the gradients to be finite
    ratio = jnp.where(positive, fitted, 1.0) / data["v"]
    return jnp.where(data["used"], jnp.where(positive, jnp.log(ratio), -100.0), 0.0)


def _tangents(curve: Deviation, terms: tuple[Term, ...], use):
    """Squared coefficients from the tangents and the minimum of the curve."""
    xp = namespace(curve.deviation)
    tau, ad = curve.tau[use], curve.deviation[use]
    step = np.diff(np.log(tau))
    chord = (xp.log(ad[1:]) - xp.log(ad[:-1])) / step
    # central differences of second order for uneven steps, one-sided at the ends
    inner = (step[1:] * chord[:-1] + step[:-1] * chord[1:]) / (step[1:] + step[:-1])
    slope = xp.concatenate([chord[:1], inner, chord[-1:]])
    index, lowest = np.arange(len(tau)), xp.argmin(ad)
    values = {"B": ad[lowest] / 0.664}
    for term, (wanted, time, least) in _TANGENTS.items():
        side = index <= lowest if wanted < 0 else index > lowest
        at = xp.argmin(xp.where(side, xp.abs(slope - wanted), xp.inf))
        seen = side[at] & ((slope[at] < least) if wanted < 0 else (slope[at] > least))
        values[term] = xp.where(seen, ad[at] * (time / xp.asarray(tau)[at]) ** wanted, 0.0)
    if unknown := [term.name for term in terms if term.name not in values]:
        raise DataError(f"method 'slope' reads tangents of Q, N, B, K and R; {', '.join(unknown)} has none: take another method")
    return xp.stack([values[term.name] for term in terms]) ** 2
