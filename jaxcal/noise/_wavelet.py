r"""Method "wavelet": the Haar wavelet variance at dyadic scales, as the generalised method of wavelet moments fits it.

.. math:: \nu^2(2m) = \tfrac12\,\sigma^2(m\,dt), \qquad m = 1, 2, 4, \ldots \le n/4

fitted with weights 1/Var(nu^2), iterated, and a sandwich covariance (S. Guerrier, J. Skaloud, Y. Stebler and M.-P.
Victoria-Feser, J. Am. Stat. Assoc. 108, 2013; the identity: D. B. Percival and P. Guttorp, in Wavelets in Geophysics, 1994).
Halving every variance and every column of the model moves neither the coefficients nor their covariance, so this is method "edf"
on other cluster sizes.
"""

import numpy as np

from ..allan import Deviation
from ._estimator import Weighted
from ._joint import fit_jointly
from ._result import NoiseFit
from ._terms import Term


def dyadic(samples: int) -> np.ndarray:
    """Cluster sizes 1, 2, 4, ... up to a quarter of the record."""
    return 2 ** np.arange((samples // 4).bit_length())


def fit_curve(curve: Deviation, samples: int, terms: tuple[Term, ...], inside, automatic: bool, confidence: float) -> NoiseFit:
    """Fit one channel's overlapped Allan deviation at `dyadic` cluster sizes; see `fit_jointly`."""
    return fit_jointly(curve, samples, terms, inside, automatic, confidence, estimator=Weighted(), method="wavelet")
