"""Joint fits with uncertainty (methods edf, gls, wavelet): one Allan deviation curve in, one `NoiseFit` out."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats

from .._errors import FitError
from .._precision import is_traced
from ..allan import Deviation
from ._allanfit import fit_band
from ._assemble import assemble, with_edf
from ._covariance import covariance_tensor
from ._curve import Curve
from ._estimator import Estimator
from ._limits import Limits
from ._result import NoiseFit
from ._sentences import sentences_of_fit, sentences_of_octaves
from ._skewness import Response, response
from ._terms import Term

#: cluster sizes of the fit: the curve is so strongly correlated that more would add nothing
CLUSTERS = 25


def fit_jointly(
    curve: Deviation,
    samples: int,
    terms: tuple[Term, ...],
    inside,
    automatic: bool,
    confidence: float,
    *,
    estimator: Estimator,
    method: str,
) -> NoiseFit:
    """Fit one channel's overlapped Allan deviation.

    Parameters
    ----------
    curve : the deviation.
    samples : number of rate samples of the record.
    terms : the terms.
    inside : (clusters,) cluster sizes that may take part.
    automatic : whether short cluster times at which the model does not hold are left out.
    confidence : level of the intervals.
    estimator, method : how the coefficients follow from the curve, and its name.
    """
    traced = is_traced(curve.deviation)
    xp = jnp if traced else np
    levels = np.array([scipy.stats.chi2.ppf(confidence, 1), scipy.stats.norm.ppf(confidence) ** 2])
    arrays = padded(curve, samples, terms, inside)
    heard = response(samples, arrays[1], 1.0 / curve.rate, terms)
    found, unit = _fitted(arrays, heard, automatic, levels, tuple(term.name for term in terms), estimator)
    if not traced:
        found, unit = jax.tree.map(np.asarray, (found, unit))
        if not np.all(np.isfinite(found.theta)):
            raise FitError("the fit gave no finite coefficients; fit fewer terms (terms=) or other cluster times (band=)")
    used = found.used[: len(curve.m)]
    limits = found.limits
    ends = Limits(low=limits.low * unit, high=limits.high * unit, upper=limits.upper * unit, significance=limits.significance)
    fit = assemble(
        found.theta * unit,
        found.covariance * unit**2,
        ends,
        terms,
        samples / curve.rate,
        goodness=found.goodness,
        band=(xp.min(xp.where(used, curve.tau, xp.inf)), xp.max(xp.where(used, curve.tau, 0.0))),
        left_out=(),
        warnings=(),
        deviation=curve,
        used=used,
        confidence=confidence,
        method=method,
    )
    if traced:
        return fit
    modelled = np.sqrt(found.modelled[: len(curve.m)] * unit)
    return dataclasses.replace(
        fit,
        deviation=with_edf(curve, used, found.edf[: len(curve.m)]),
        left_out=sentences_of_octaves(curve, used, modelled, automatic),
        warnings=curve.warnings + sentences_of_fit(found, curve, used, fit.verdict, automatic),
    )


def padded(curve: Deviation, samples: int, terms: tuple[Term, ...], inside):
    """Deviation, cluster sizes, share of differences, which take part, covariance tensor, and columns, for `CLUSTERS` cluster sizes.

    So records of every length share one compilation (up to the 10^8 samples at which powers of two are more than that).
    """
    xp = jnp if is_traced(curve.deviation) else np
    pad = max(CLUSTERS - len(curve.m), 0)
    with jax.ensure_compile_time_eval():  # neither depends on the record
        columns = [np.asarray(term.avar(curve.tau, 1.0 / curve.rate)) for term in terms]
        tensor = covariance_tensor(samples, tuple(int(m) for m in curve.m), 1.0 / curve.rate, terms)
    return (
        xp.pad(curve.deviation, (0, pad), constant_values=1.0),
        np.pad(curve.m.astype(float), (0, pad), constant_values=1.0),
        xp.pad(curve.count / (curve.count + curve.skipped), (0, pad), constant_values=1.0),
        np.pad(inside, (0, pad)),
        # the tail comes last: an adjustment of the curve, which adds nothing to its scatter
        np.pad(tensor, [(0, 1), (0, 1), (0, pad), (0, pad)]),
        np.pad(np.stack([*columns, -1.0 / curve.tau**2], axis=1), [(0, pad), (0, 0)], constant_values=1.0),
    )


def in_units(arrays):
    """The curve of `padded` arrays divided by its largest variance, and that variance."""
    deviation, m, share, inside, tensor, columns = arrays
    variance = deviation**2
    dtype = variance.dtype
    unit = jnp.max(jnp.where(inside, variance, 0.0))  # squares of small coefficients would leave the range of float32
    m = m.astype(dtype)
    curve = Curve(
        v=jnp.where(inside, variance / unit, 1.0),
        columns=columns.astype(dtype),
        tensor=tensor.astype(dtype),
        share=1.0 / share.astype(dtype),
        octave=jnp.log2(m),
        used=inside & (variance > 0.0),
        free=jnp.ones(columns.shape[1], dtype=bool),
        held=jnp.zeros(columns.shape[1], dtype=dtype),
    )
    return curve, unit


@functools.partial(jax.jit, static_argnames=("terms", "estimator"))
def _fitted(arrays, heard: Response, automatic, levels, terms: tuple[str, ...], estimator: Estimator):
    """The fit of a padded curve, and the unit of its variance."""
    curve, unit = in_units(arrays)
    short = jnp.asarray([term == "Q" for term in terms])
    two_sided, one_sided = levels.astype(curve.v.dtype)
    heard = jax.tree.map(lambda leaf: jnp.asarray(leaf, curve.v.dtype), heard)
    return fit_band(curve, estimator, heard, short, automatic, two_sided, one_sided), unit
