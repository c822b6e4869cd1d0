r"""Joint fits of an Allan deviation curve with uncertainty: one `Deviation` in, one `NoiseFit` out.

- gls: generalised least squares with the covariance of the whole curve, min (v - A theta)' C(theta)^-1 (v - A theta).
- edf: independent variances 2 (A theta)^2 / edf, with a sandwich covariance.
- wavelet: the Haar wavelet variance at dyadic scales, as the generalised method of wavelet moments fits it,
  nu^2(2m) = sigma^2(m dt) / 2, with weights 1/Var(nu^2) and a sandwich covariance (S. Guerrier, J. Skaloud, Y. Stebler and M.-P.
  Victoria-Feser, J. Am. Stat. Assoc. 108, 2013; the identity: D. B. Percival and P. Guttorp, in Wavelets in Geophysics, 1994).
  Halving every variance and every column moves neither the coefficients nor their covariance, so it is edf on other cluster sizes.
"""

import dataclasses

import jax
import numpy as np

from .._errors import FitError
from .._types import Any
from ..allan import Deviation
from ._allanfit import choose_band, fit_curve
from ._assemble import assemble, with_edf
from ._covariance import covariance_tensor
from ._curve import Curve
from ._lanes import namespace
from ._limits import levels_of
from ._result import NoiseFit
from ._sentences import sentences_of_fit, sentences_of_octaves
from ._skewness import response
from ._terms import Term


def curve_of(curve: Deviation, samples: int, terms: tuple[Term, ...], variance, inside) -> tuple[Curve, Any, Any]:
    """Allan variances with columns and covariance tensor, divided by the largest one; which of those `inside` are used; and that one."""
    xp, used = namespace(variance), inside & (variance > 0.0)
    dt, dtype = 1.0 / curve.rate, variance.dtype
    # squares of small coefficients would leave the range of float32
    unit = xp.max(xp.where(used, variance, 0.0))
    with jax.ensure_compile_time_eval():  # neither depends on the record
        found = [np.asarray(term.avar(curve.tau, dt)) for term in terms]
        tensor = covariance_tensor(samples, tuple(int(m) for m in curve.m), dt, terms)
    short = np.array([term.name == "Q" for term in terms])
    tail = -found[int(np.argmax(short))] if short.any() else -1.0 / curve.tau**2
    columns = np.stack([*found, tail], axis=1)
    return (
        Curve(
            v=xp.where(used, variance / unit, 1.0),
            columns=columns.astype(dtype),
            tensor=tensor.astype(dtype),
            share=(1.0 + curve.skipped / curve.count).astype(dtype),
            octave=np.log2(curve.m.astype(dtype)),
            short=short.astype(dtype),
        ),
        used,
        unit,
    )


def fit_jointly(
    deviation: Deviation, samples: int, terms: tuple[Term, ...], inside, automatic: bool, confidence: float, *, method: str
) -> NoiseFit:
    """Fit one channel's overlapped Allan deviation.

    Parameters
    ----------
    deviation : the deviation.
    samples : number of rate samples of the record.
    terms : the terms.
    inside : (clusters,) cluster sizes that may take part.
    automatic : whether short cluster times at which the model does not hold are left out (not of a traced record).
    confidence : level of the intervals.
    method : "gls", "edf" or "wavelet".
    """
    xp, full = namespace(deviation.deviation), method == "gls"
    curve, used, unit = curve_of(deviation, samples, terms, deviation.deviation**2, inside)
    cut, holds, estimated = False, True, None
    if automatic and xp is np:
        used, cut, holds, estimated = choose_band(curve, used, full)
    heard = response(samples, deviation.m.astype(float), 1.0 / deviation.rate, terms)
    found = fit_curve(curve, used, np.asarray(cut), full, heard, *levels_of(confidence), estimated)
    if xp is np and not np.all(np.isfinite(found.theta)):
        raise FitError("the fit gave no finite coefficients; fit fewer terms (terms=) or other cluster times (band=)")
    fit = assemble(
        found.theta * unit,
        found.covariance * unit**2,
        found.limits.scaled(unit),
        terms,
        samples / deviation.rate,
        goodness=found.goodness,
        band=(xp.min(xp.where(used, deviation.tau, np.inf)), xp.max(xp.where(used, deviation.tau, 0.0))),
        left_out=(),
        warnings=(),
        deviation=deviation,
        used=used,
        confidence=confidence,
        method=method,
    )
    if xp is not np:
        return fit
    return dataclasses.replace(
        fit,
        deviation=with_edf(deviation, used, found.edf),
        left_out=sentences_of_octaves(deviation, used, np.sqrt(found.modelled * unit), automatic),
        warnings=deviation.warnings + sentences_of_fit(found, cut, holds, deviation, used, fit.verdict, automatic),
    )
