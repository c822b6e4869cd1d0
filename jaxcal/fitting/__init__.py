"""Least squares for every calibration, and for models of your own.

A calibration is a residual problem: a model (any tree of numbers, usually an Equinox module) and a function
`residuals(model, data) -> array` of residuals in units of their standard deviation. `solve` fits the model; the other functions tell how
well its parameters are known. Every estimator of jaxcal uses this package, and only this package uses optimistix.
"""

from ._chain import Chain as Chain
from ._covariance import covariance as covariance, intervals as intervals
from ._estimate import Estimate as Estimate
from ._fit import solve as solve, solve_many as solve_many
from ._information import Information as Information, information as information
from ._loss_and_prior import (
    AbstractLoss as AbstractLoss,
    AbstractPrior as AbstractPrior,
    Cauchy as Cauchy,
    Gaussian as Gaussian,
    Huber as Huber,
)
from ._result import Fit as Fit, Outcome as Outcome, identifiability as identifiability
