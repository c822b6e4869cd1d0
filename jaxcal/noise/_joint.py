r"""Methods "gls", "edf" and "wavelet", which fit an Allan deviation curve with uncertainty; and the second opinion on a spectrum.

- gls: generalised least squares with the covariance of the whole curve, min (v - A theta)' C(theta)^-1 (v - A theta).
- edf: least squares with independent variances 2 (A theta)^2 / edf, and a sandwich covariance of the coefficients.
- wavelet: the generalised method of wavelet moments, which fits the Haar wavelet variance nu^2(2m) = sigma^2(m dt) / 2 at dyadic
  scales with weights 1/Var(nu^2) and a sandwich covariance (S. Guerrier, J. Skaloud, Y. Stebler and M.-P. Victoria-Feser, J. Am.
  Stat. Assoc. 108, 2013; the identity: D. B. Percival and P. Guttorp, in Wavelets in Geophysics, 1994). To halve every variance and
  every column changes neither the coefficients nor their covariance, so this method is edf on other cluster sizes.
"""

import numpy as np

from .._arrays import namespace
from .._errors import FitError
from .._frozen import replaced
from ..allan import Deviation
from . import _messages
from ._allanfit import alone, choose_band, covariance_of, fit_curve, response
from ._curve import curve_of, estimate
from ._limits import levels_of
from ._model import Noise, noise_of
from ._result import NoiseFit, assemble, with_edf
from ._terms import Term

_LEFT = 0.1  # a cluster time is used if at least this share of its Allan variance remains when lines and processes are subtracted


def fit_jointly(
    deviation: Deviation, samples: int, terms: tuple[Term, ...], inside, automatic: bool, confidence: float, *, method: str
) -> NoiseFit:
    """Fit the overlapped Allan deviation of one channel that has `samples` samples.

    `inside`, (clusters,), marks the cluster sizes that may be used. If `automatic` and not in a trace, short cluster sizes at which the
    model does not hold are left out.
    """
    xp, full = namespace(deviation.deviation), method == "gls"
    curve, used, unit = curve_of(deviation, samples, terms, deviation.deviation**2, inside)
    cut, holds, estimated = False, True, None
    if automatic and xp is np:
        used, cut, holds, estimated = choose_band(curve, np.log2(deviation.m), used, full)
    heard = response(samples, deviation.m.astype(float), 1.0 / deviation.rate, terms)
    found = fit_curve(curve, used, np.asarray(cut), full, heard, *levels_of(confidence), estimated)
    if xp is np and not np.all(np.isfinite(found.theta)):
        raise FitError("the fit gave no finite coefficients; fit fewer terms (terms=) or other cluster times (band=)")
    fit = assemble(
        found.theta * unit, found.covariance * unit**2, found.limits.scaled(unit), terms, deviation, samples / deviation.rate,
        goodness=found.goodness, used=used, confidence=confidence, method=method,
        band=(xp.min(xp.where(used, deviation.tau, np.inf)), xp.max(xp.where(used, deviation.tau, 0.0))),
    )  # fmt: skip
    if xp is not np:
        return fit
    where, how = "any range of cluster times" if automatic else "the band asked for", f"chance {float(found.goodness):.1g}"
    limit = "; its upper limit is what the rest of the curve allows"
    warnings = (
        *deviation.warnings,
        *_messages.of_model(fit, "curve", holds, where, how, float(found.inflation), cut, limit),
        *_messages.of_curve(deviation, float(found.step)),
    )
    left_out = _messages.of_octaves(deviation, used, np.sqrt(found.modelled * unit), automatic)
    return replaced(fit, deviation=with_edf(deviation, used, found.edf), left_out=left_out, warnings=warnings)


def with_second_opinion(found: NoiseFit, samples: int) -> NoiseFit:
    """Add a second opinion to a fit: the coefficients by generalised least squares in the same band, with a warning if they disagree.

    Lines and Gauss-Markov processes are subtracted from the curve first. If short cluster times are cut off, a tail of slope -1
    replaces Q.
    """
    curve, names = found.deviation, tuple(term for term in found.terms if term != "markov")
    terms = tuple(found.noise.part(name)[2] for name in names)
    further = tuple((value, term) for value, term in found.noise.further if term.name not in names)
    beside = Noise(markov=found.noise.markov, sinusoid=found.noise.sinusoid, further=further)
    variance = curve.deviation**2
    if beside.markov or beside.sinusoid or further:
        variance = variance - np.asarray(beside.avar(curve.tau, dt=1.0 / curve.rate))
    kept = found.used & (variance > _LEFT * curve.deviation**2)
    if kept.sum() <= len(terms) + 1:
        note = "no second opinion: too few cluster times are left in the band, or lines make up most of the Allan variance"
        return replaced(found, notes=(*found.notes, note))
    data, kept, unit = curve_of(curve, samples, terms, variance, kept)
    lanes = alone(data, kept, np.asarray(not found.used[0]))
    squares = np.array([float(found.noise.part(name)[1]) ** 2 for name in names]) / unit
    (theta,), _ = estimate(data, lanes, True, np.where(lanes.free, np.append(squares, 0.0), 0.0))
    errors = np.sqrt(np.diagonal(covariance_of(data, lanes, theta, True))) * unit
    other = noise_of(terms, np.sqrt(theta[: len(terms)] * unit).tolist())
    said = _messages.of_difference(found, other, dict(zip(names, errors, strict=False)))
    return replaced(found, other=other, warnings=(*found.warnings, *said))
