"""`Fit`: what a solve returns."""

from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import numpy as np
import scipy.special

from .._errors import FitError
from .._precision import array_module, is_traced
from .._types import AnyArray, Value
from ._outcome import Outcome, ended
from ._problem import Problem

M = TypeVar("M")


class Fit(eqx.Module, Generic[M]):
    """A fitted model and everything needed to say how well it is known.

    Attributes
    ----------
    model : the fitted model, of the type of the start.
    outcome : an item of `Outcome`.
    cost : half the sum of the squared residuals (of the loss, where there is one) and of the residuals of the priors.
    parameters : (p,) free parameters, in the order of `names`.
    residuals : (n,) whitened residuals at the solution, without the loss.
    jacobian : (n, p) their derivative with respect to `parameters`.
    weights : (n,) weight of each residual under the loss, one without it.
    curvature : (n,) second derivative of the loss, one without it.
    prior_residuals, prior_jacobian : (m,) residuals of the priors, and (m, p) their derivative; empty without priors.
    at_bound : (p,) True where a bound holds the parameter.
    steps : evaluations of the residuals.
    effective : number of parameters that the data determine: the free ones, less what the priors determine (sum of the leverage).
    names : one name per free parameter.
    robust : whether there was a loss.
    problem : what was solved, for `profile_interval`; None for one of many.
    """

    model: M
    outcome: Any
    cost: AnyArray
    parameters: AnyArray
    residuals: AnyArray
    jacobian: AnyArray
    weights: AnyArray
    curvature: AnyArray
    prior_residuals: AnyArray
    prior_jacobian: AnyArray
    at_bound: AnyArray
    steps: AnyArray
    effective: Value
    names: tuple[str, ...] = eqx.field(static=True)
    robust: bool = eqx.field(static=True)
    problem: Problem | None = None

    @property
    def usable(self) -> Value | np.bool_:
        """True where the fit converged, inside its bounds or on one."""
        return ended(self.outcome, Outcome.converged, Outcome.at_bound)

    @property
    def counted(self) -> Value:
        """(n,) False for padding: entries that are zero with zero derivative."""
        return (self.residuals != 0) | array_module(self.residuals).any(self.jacobian != 0, axis=-1)

    @property
    def count(self) -> Value:
        """Number of residuals that are not padding."""
        return array_module(self.residuals).sum(self.counted, axis=-1, dtype=self.residuals.dtype)

    @property
    def free(self) -> Value:
        """Number of parameters that no bound holds."""
        return array_module(self.residuals).sum(~self.at_bound, axis=-1, dtype=self.residuals.dtype)

    @property
    def degrees_of_freedom(self) -> Value:
        """`count` less `effective`: residuals of the data that are left to test the fit."""
        return self.count - self.effective

    @property
    def mean_curvature(self) -> Value:
        """Mean second derivative of the loss over the residuals: one without it."""
        xp = array_module(self.residuals)
        if not self.robust:
            return xp.mean(self.curvature, axis=-1)
        return xp.sum(xp.where(self.counted, self.curvature, 0), axis=-1) / self.count

    @property
    def variance(self) -> Value:
        """Variance of a whitened residual that explains the fit: reduced chi-square, or its counterpart for a robust loss."""
        xp = array_module(self.residuals)
        return xp.sum((self.weights * self.residuals) ** 2, axis=-1) / xp.maximum(self.degrees_of_freedom, 1) / self.mean_curvature**2

    @property
    def chi_square(self) -> Value:
        """Sum of the squared residuals: chi-square distributed if they are whitened, normal and without loss."""
        return array_module(self.residuals).sum(self.residuals**2, axis=-1)

    @property
    def goodness(self) -> Value:
        """Probability of a larger chi-square by chance (p value); one where no degree of freedom is left."""
        xp, gammaincc = array_module(self.residuals), (jax.scipy.special if is_traced(self.residuals) else scipy.special).gammaincc
        tail = gammaincc(xp.maximum(self.degrees_of_freedom, 1) / 2, self.chi_square / 2)
        return xp.where(self.degrees_of_freedom > 0, tail, 1)

    @property
    def message(self) -> str:
        """The outcome's sentence, with the names of parameters at a bound (host only, one fit)."""
        held = [name for name, at in zip(self.names, np.asarray(self.at_bound), strict=True) if at]
        return Outcome[self.outcome] + (f" At its bound: {', '.join(held)}." if held else "")

    def checked(self) -> "Fit[M]":
        """Return this fit, or raise a `FitError` with the outcome's sentence where it did not converge (host only, one fit)."""
        if not bool(self.usable):
            raise FitError(self.message)
        return self


def to_numpy(tree: Any) -> Any:
    """The same tree with arrays of NumPy, outside of a trace."""
    return tree if is_traced(tree) else jax.tree.map(lambda leaf: np.asarray(leaf) if eqx.is_array(leaf) else leaf, tree)
