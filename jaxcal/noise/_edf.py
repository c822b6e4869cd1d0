"""Method "edf": one Allan deviation curve in, one `NoiseFit` out."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats

from .._errors import FitError
from .._precision import is_traced
from ..allan import Deviation
from ..allan._edf import interval_factors
from ._allanfit import Curve, fit_band
from ._columns import allan_column
from ._covariance import covariance_tensor
from ._model import with_coefficients
from ._result import NoiseFit
from ._sentences import sentences_of_fit, sentences_of_octaves

#: cluster sizes of the fit: the curve is so strongly correlated that more would add nothing
CLUSTERS = 25
#: drops of the chi-square above which a term is hinted at, and is present: 5 % and 1 % by chance, for a coefficient that
#: cannot be negative
_HINT, _PRESENT = 2.71, 5.41


def fit_curve(curve: Deviation, samples: int, terms: tuple[str, ...], inside, automatic: bool, confidence: float) -> NoiseFit:
    """Fit one channel's overlapped Allan deviation.

    Parameters
    ----------
    curve : the deviation, at no more than `CLUSTERS` cluster sizes.
    samples : number of rate samples of the record.
    terms : names of the terms.
    inside : (clusters,) cluster sizes that may take part.
    automatic : whether short cluster times at which the model does not hold are left out.
    confidence : level of the intervals.
    """
    traced = is_traced(curve.deviation)
    xp = jnp if traced else np
    levels = np.array([scipy.stats.chi2.ppf(confidence, 1), scipy.stats.norm.ppf(confidence) ** 2])
    found, unit = _fitted(*_padded(curve, samples, terms, inside, xp), 1.0 / curve.rate, automatic, levels, terms)
    if not traced:
        found, unit = jax.tree.map(np.asarray, (found, unit))
        if not np.all(np.isfinite(found.theta)):
            raise FitError("the fit gave no finite coefficients; fit fewer terms (terms=) or other cluster times (band=)")
    theta, spread = found.theta * unit, found.covariance * unit**2
    positive = theta > 0.0
    guarded = xp.where(positive, theta, 1.0)  # keeps the derivative of the root finite where the coefficient is zero
    value = xp.where(positive, xp.sqrt(guarded), 0.0)
    low, high, upper = (xp.sqrt(getattr(found.limits, end) * unit) for end in ("low", "high", "upper"))
    relative = xp.sqrt(xp.diagonal(spread)) / (2.0 * guarded)
    duration = samples / curve.rate
    longer = xp.where(positive, duration * (relative / 0.1) ** 2, xp.inf)
    used = found.used[: len(curve.m)]
    verdict, left_out, warnings = {}, (), ()
    if not traced:
        verdict = {term: _verdict(drop) for term, drop in zip(terms, found.limits.significance, strict=True)}
        curve = _with_model_edf(curve, used, found.edf)
        modelled = np.sqrt(found.modelled[: len(curve.m)] * unit)
        left_out = sentences_of_octaves(curve, used, modelled, automatic)
        warnings = curve.warnings + sentences_of_fit(found, curve, used, verdict, automatic)

    def table(values):
        return {term: values[i] for i, term in enumerate(terms)}

    return NoiseFit(
        noise=with_coefficients(table(value)),
        interval={term: (low[i], high[i]) for i, term in enumerate(terms)},
        upper_limit=table(upper),
        verdict=verdict,
        significance=table(found.limits.significance),
        covariance=spread,
        goodness=found.goodness,
        longer_record=table(longer),
        band=(xp.min(xp.where(used, curve.tau, xp.inf)), xp.max(xp.where(used, curve.tau, 0.0))),
        left_out=left_out,
        warnings=warnings,
        deviation=curve,
        used=used,
        duration=duration,
        terms=terms,
        confidence=confidence,
        method="edf",
    )


def _padded(curve: Deviation, samples: int, terms: tuple[str, ...], inside, xp):
    """Arrays of `CLUSTERS` entries, so that records of every length share one compilation."""
    pad = CLUSTERS - len(curve.m)
    tensor = covariance_tensor(samples, tuple(int(m) for m in curve.m), 1.0 / curve.rate, terms)
    arrays = (
        xp.pad(curve.deviation, (0, pad), constant_values=1.0),
        np.pad(curve.m.astype(float), (0, pad), constant_values=1.0),
        xp.pad(curve.count / (curve.count + curve.skipped), (0, pad), constant_values=1.0),
        np.pad(inside, (0, pad)),
    )
    # the tail comes last: an adjustment of the curve, which adds nothing to its scatter
    return *arrays, np.pad(tensor, [(0, 1), (0, 1), (0, pad), (0, pad)])


@functools.partial(jax.jit, static_argnames="terms")
def _fitted(deviation, m, share, inside, tensor, dt, automatic, levels, terms: tuple[str, ...]):
    """The fit of a padded curve, and the unit of its variance."""
    variance = deviation**2
    dtype = variance.dtype
    unit = jnp.max(jnp.where(inside, variance, 0.0))  # squares of small coefficients would leave the range of float32
    m, dt = m.astype(dtype), jnp.asarray(dt, dtype)
    tau = m * dt
    curve = Curve(
        v=jnp.where(inside, variance / unit, 1.0),
        columns=jnp.stack([*(allan_column(term, tau, dt) for term in terms), -1.0 / tau**2], axis=1),
        tensor=tensor.astype(dtype),
        share=1.0 / share.astype(dtype),
        octave=jnp.log2(m),
        used=inside & (variance > 0.0),
    )
    short = jnp.asarray([term == "Q" for term in terms])
    return fit_band(curve, short, automatic, levels[0].astype(dtype), levels[1].astype(dtype)), unit


def _verdict(drop: float) -> str:
    return "present" if drop > _PRESENT else "hint" if drop > _HINT else "not detected"


def _with_model_edf(curve: Deviation, used, edf) -> Deviation:
    """The deviation with the edf of the fitted model, and the limits that follow, where the model holds."""
    edf = np.where(used, np.maximum(edf[: len(curve.m)], 1.0), curve.edf)
    low, high = interval_factors(edf, curve.confidence)
    arrays = {name: getattr(curve, name) for name in ("tau", "m", "deviation", "count", "alpha", "skipped")}
    return Deviation(
        **arrays, edf=edf, lower=curve.deviation * low, upper=curve.deviation * high, kind=curve.kind, rate=curve.rate,
        confidence=curve.confidence, warnings=curve.warnings,
    )  # fmt: skip
