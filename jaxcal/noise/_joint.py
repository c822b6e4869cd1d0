"""Method "gls": generalised least squares on an Allan deviation curve, min (v - A theta)' C(theta)^-1 (v - A theta)."""

import numpy as np

from .._arrays import namespace
from .._errors import FitError
from .._frozen import replaced
from .._message import Message
from ..allan import Deviation
from ._allanfit import choose_band, fit_curve, response
from ._checks import Asked
from ._curve import curve_of
from ._findings import FINDINGS, of_curve, of_model
from ._limits import levels_of
from ._result import NoiseFit, assemble, with_edf
from ._terms import Term

_SETTLED = 1e-4  # change of the weights in the last step above which the fit has not converged


def fit_jointly(y, asked: Asked) -> NoiseFit:
    """Fit the overlapped Allan deviation of one channel.

    Unless a band is asked for, and not in a trace, short cluster sizes at which the model does not hold are left out.
    """
    return fit_deviation(asked.deviation(y), len(y), asked.terms, asked.inside, asked.band is None, asked.confidence)


def fit_deviation(deviation: Deviation, samples: int, terms: tuple[Term, ...], inside, automatic: bool, confidence: float) -> NoiseFit:
    """Fit a curve of a channel of so many `samples`; `inside`, (clusters,), marks the cluster sizes that may be used."""
    xp = namespace(deviation.deviation)
    curve, used, unit = curve_of(deviation, samples, terms, deviation.deviation**2, inside)
    cut, holds, estimated = False, True, None
    if automatic and xp is np:
        used, cut, holds, estimated = choose_band(curve, np.log2(deviation.m), used)
    heard = response(samples, deviation.m.astype(float), 1.0 / deviation.rate, terms)
    found = fit_curve(curve, used, np.asarray(cut), heard, *levels_of(confidence), estimated)
    if xp is np and not np.all(np.isfinite(found.theta)):
        raise FitError(Message("the fit gave no finite coefficients; give fewer {option.terms} or another {option.band}"))
    fit = assemble(
        found.theta * unit, found.covariance * unit**2, found.limits.scaled(unit), terms, deviation, samples / deviation.rate,
        goodness=found.goodness, used=used, confidence=confidence, method="gls",
        band=(xp.min(xp.where(used, deviation.tau, np.inf)), xp.max(xp.where(used, deviation.tau, 0.0))),
    )  # fmt: skip
    if xp is not np:
        return fit
    shortest = float(fit.band[0]) if cut and "Q" in fit.terms else None
    findings = (
        *getattr(deviation, "findings", ()),
        *of_model(float(found.inflation) if not holds else 0.0, shortest),
        *((FINDINGS("unsettled"),) if float(found.step) > _SETTLED else ()),
        *of_curve(deviation),
    )
    return replaced(fit, deviation=with_edf(deviation, used, found.edf), findings=findings)
