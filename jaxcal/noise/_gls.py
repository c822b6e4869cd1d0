r"""Method "gls": generalised least squares with the covariance of the whole curve.

.. math:: \min_{\theta \ge 0} (v - A\theta)'\,C(\theta)^{-1}\,(v - A\theta)

with C taken at the theta of the step before, from the result of method "edf" on. The covariance of the estimate is
(A' C^-1 A)^-1.
"""

import jax.numpy as jnp

from .._types import Array, Bool, Float
from ..allan import Deviation
from ._curve import Curve, inverse, whitened
from ._estimator import Estimator, Weighted, settle
from ._joint import fit_jointly
from ._result import NoiseFit
from ._terms import Term


class Generalised(Estimator):
    """Least squares with C(theta)."""

    @property
    def most(self) -> int:
        """Fifteen; few records need more than eight."""
        return 15

    def begin(self, curve: Curve) -> Float[Array, " p"]:
        """The weighted estimate, to a hundredth."""
        weighted = Weighted()
        return settle(curve, weighted, weighted.begin(curve), weighted.most, 1e-2)[0]

    def step(self, curve: Curve, theta: Float[Array, " p"]) -> Float[Array, " p"]:
        """Least chi-square with C at theta."""
        return whitened(curve, theta).solve(curve)

    def spread(self, curve: Curve, theta: Float[Array, " p"], independent: Bool[Array, " p"]) -> Float[Array, "p p"]:
        """(A' C^-1 A)^-1."""
        rows = jnp.where(independent[None, :], whitened(curve, theta).rows, 0.0)
        return inverse(rows.T @ rows)


def fit_curve(curve: Deviation, samples: int, terms: tuple[Term, ...], inside, automatic: bool, confidence: float) -> NoiseFit:
    """Fit one channel's overlapped Allan deviation; see `fit_jointly`."""
    return fit_jointly(curve, samples, terms, inside, automatic, confidence, estimator=Generalised(), method="gls")
