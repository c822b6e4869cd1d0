r"""Method "edf": weighted least squares with variances 2 (A theta)^2 / edf."""

from ..allan import Deviation
from ._estimator import Weighted
from ._joint import fit_jointly
from ._result import NoiseFit
from ._terms import Term


def fit_curve(curve: Deviation, samples: int, terms: tuple[Term, ...], inside, automatic: bool, confidence: float) -> NoiseFit:
    """Fit one channel's overlapped Allan deviation; see `fit_jointly`."""
    return fit_jointly(curve, samples, terms, inside, automatic, confidence, estimator=Weighted(), method="edf")
