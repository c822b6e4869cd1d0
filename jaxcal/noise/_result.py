"""`NoiseFit`: noise coefficients with their uncertainty."""

from typing import Any

import equinox as eqx

from .._types import AnyArray
from ..allan import Deviation
from ._model import Noise


class NoiseFit(eqx.Module):
    """Noise coefficients of one channel, or of several, with what is known about them.

    For a record of several channels every entry is per channel: the fields of `noise`, the values of the dictionaries and
    `goodness` have the channels as last axis, verdicts and warnings are tuples over channels. `channel(i)` gives one.

    Attributes
    ----------
    noise : fitted `Noise`, SI units.
    terms : names of the fitted terms, in the order of `covariance`.
    interval : term -> (low, high) at level `confidence`, in the unit of the coefficient; low is 0 where zero cannot be excluded.
    upper_limit : term -> one-sided upper limit at level `confidence`.
    verdict : term -> "present", "hint" or "not detected".
    significance : term -> drop of the fit's chi-square when the term is admitted; 2.71 is 5 %, 5.41 is 1 % by chance.
    covariance : (terms, terms) covariance of the *squared* coefficients, whose estimates are close to Gaussian
        and may lie at zero.
    goodness : p value of the fit in the band used.
    longer_record : term -> record length in s at which the coefficient would be known to 10 % (inf where it is not detected).
    band : (shortest, longest) cluster time in s that the fit uses.
    left_out : one sentence for each octave of cluster time left out because the model does not hold there.
    warnings : sentences.
    deviation : the `Deviation` that was fitted, all cluster sizes, before the band was chosen.
    used : (clusters,) True where a cluster size was in the band.
    duration : record length in s.
    confidence : level of interval and upper limit.
    method : name of the estimator.
    """

    noise: Noise
    interval: dict[str, tuple[Any, Any]]
    upper_limit: dict[str, Any]
    verdict: dict[str, Any]
    significance: dict[str, Any]
    covariance: AnyArray
    goodness: Any
    longer_record: dict[str, Any]
    band: tuple[Any, Any]
    left_out: tuple[Any, ...]
    warnings: tuple[Any, ...]
    deviation: Deviation
    used: AnyArray
    duration: float
    terms: tuple[str, ...] = eqx.field(static=True)
    confidence: float = eqx.field(static=True)
    method: str = eqx.field(static=True)
