"""`Fit`: the result of a solve; `Outcome`: how it ended, as sentences that tell what to do."""

import functools
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Number, grid_lines, listed
from .._errors import FitError
from .._precision import array_module, is_traced
from .._types import AnyArray, Value
from ._information import Information, information
from ._problem import Problem

M = TypeVar("M")


class Outcome(eqx.Enumeration):
    """How a fit ended; `Outcome[item]` is a sentence.

    Examples
    --------
    >>> from jaxcal.fitting import Outcome
    >>> Outcome[Outcome.converged]
    'The fit converged.'
    """

    converged = "The fit converged."
    at_bound = "The fit converged with a parameter at its bound, where its interval is one-sided; widen the bound unless it is a fact."
    unidentifiable = "The data do not determine every parameter; hold one fixed, add a prior, or record data that move it."
    stalled = "The fit stopped where its residuals still slope; look for a kink in the model, and run in float64."
    step_limit = "The fit reached its step limit before it converged; start closer, try several starts, or raise max_steps."
    not_finite = "The residuals became infinite or NaN; bound the parameters to where the model is defined, or start closer."


def weighted_rows(fit: "Fit") -> tuple[AnyArray, AnyArray]:
    """Rows of the Jacobian that determine the solution: those of the data times the roots of their weights, and those of the priors."""
    return array_module(fit.residuals).sqrt(fit.weights)[:, None] * fit.jacobian, fit.prior_jacobian


def _informed(fit: "Fit") -> Information:
    return information(array_module(fit.residuals).concatenate(weighted_rows(fit)), held=fit.at_bound, names=fit.names)


class Fit(eqx.Module, Generic[M]):
    """A fitted model, with everything needed to tell how well it is known.

    Attributes
    ----------
    model : the fitted model, of the type of the start.
    outcome : an item of `Outcome`.
    cost : half the sum of the squared residuals (or of the loss) and of the squared residuals of the priors.
    parameters : (p,) free parameters, in the order of `names`.
    residuals : (n,) whitened residuals at the solution, without the loss.
    jacobian : (n, p) derivative of the residuals with respect to `parameters`.
    weights : (n,) weight of each residual under the loss; one without a loss.
    curvature : (n,) second derivative of the loss; one without a loss.
    prior_residuals, prior_jacobian : (m,) residuals of the priors, and (m, p) their derivative; empty without priors.
    at_bound : (p,) True where a bound holds the parameter.
    steps : number of evaluations of the residuals.
    flat : whether the cost has no slope left at the solution. `outcome` and `usable` also tell whether the data determine every parameter.
    effective : number of parameters that the data determine: the free ones minus the part that the priors determine (sum of the leverage).
    names : one name per free parameter.
    robust : whether a loss was used.
    problem : the problem that was solved, for a jackknife; None for one fit out of many.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import covariance, solve
    >>> fit = solve(lambda model, y: (model["mean"] - y) / 2, {"mean": 0.0}, jnp.array([1.0, 5.0, 3.0, 3.0]))
    >>> print(fit.parameters.round(2), round(float(fit.cost), 2), covariance(fit).round(2))
    [3.] 1.0 [[1.]]
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
    flat: Value | np.bool_
    effective: Value
    names: tuple[str, ...] = eqx.field(static=True)
    robust: bool = eqx.field(static=True)
    problem: Problem | None = None

    @property
    def usable(self) -> Value | np.bool_:
        """True if the fit converged, inside its bounds or on one."""
        return array_module(self.residuals).logical_or(ended(self, Outcome.converged), ended(self, Outcome.at_bound))

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
        """`count` minus `effective`: the residuals of the data that remain to test the fit."""
        return self.count - self.effective

    @property
    def mean_curvature(self) -> Value:
        """Mean second derivative of the loss over the residuals; one without a loss."""
        xp = array_module(self.residuals)
        if not self.robust:
            return xp.mean(self.curvature, axis=-1)
        return xp.sum(xp.where(self.counted, self.curvature, 0), axis=-1) / self.count

    @property
    def variance(self) -> Value:
        """Estimated variance of a whitened residual: reduced chi-square, or its counterpart for a robust loss."""
        xp = array_module(self.residuals)
        return xp.sum((self.weights * self.residuals) ** 2, axis=-1) / xp.maximum(self.degrees_of_freedom, 1) / self.mean_curvature**2

    @property
    def chi_square(self) -> Value:
        """Sum of the squared residuals. It has a chi-square distribution if they are whitened and normal, and no loss is used."""
        return array_module(self.residuals).sum(self.residuals**2, axis=-1)

    @property
    def goodness(self) -> Value:
        """Probability of a larger chi-square by chance (p value); one if no degrees of freedom are left."""
        xp, gammaincc = array_module(self.residuals), (jax.scipy.special if is_traced(self.residuals) else scipy.special).gammaincc
        tail = gammaincc(xp.maximum(self.degrees_of_freedom, 1) / 2, self.chi_square / 2)
        return xp.where(self.degrees_of_freedom > 0, tail, 1)

    def __repr__(self) -> str:
        """The outcome, and each parameter with half of its 95 % interval if the residuals have a standard deviation of one."""
        if is_traced(self) or np.ndim(self.parameters) != 1:
            return eqx.tree_pformat(self)
        error = np.sqrt(np.diag(known_of(self).covariance))
        lines = [f"Fit: {self.message} {int(self.count)} residuals, rms {float(np.sqrt(self.chi_square / self.count)):.3g}"]
        if self.names:
            numbers = [
                Number(name, value, value - half, value + half, "", "held" if at else "estimated" if np.isfinite(half) else "open")
                for name, value, half, at in zip(self.names, self.parameters, 1.96 * error, self.at_bound, strict=True)
            ]
            lines += grid_lines(listed("fit", "", [(one.name, one) for one in numbers]))[1:]
        return "\n".join(lines)

    @property
    def message(self) -> str:
        """The outcome's sentence, with the names of parameters at a bound (host only, one fit)."""
        held = [name for name, at in zip(self.names, np.asarray(self.at_bound), strict=True) if at]
        return Outcome[self.outcome] + (f" At its bound: {', '.join(held)}." if held else "")

    def checked(self) -> "Fit[M]":
        """Return this fit, or raise a `FitError` with the outcome's sentence if it did not converge (host only, one fit)."""
        if not bool(self.usable):
            raise FitError(self.message, code="not_converged")
        return self

    #: cached on the host, because several functions need it and each call would take a twentieth of a small fit
    _known = functools.cached_property(_informed)


def known_of(fit: Fit[Any]) -> Information:
    """Information of data and priors at the solution."""
    return _informed(fit) if is_traced(fit.residuals) else fit._known


def ended(fit: Fit[Any], item: Any) -> Any:
    """Whether the outcome of a fit is the given item of `Outcome`; unlike Equinox's `==`, this needs no JAX operation."""
    return fit.outcome._value == item._value


def to_numpy(tree: Any) -> Any:
    """The tree with NumPy arrays, outside of a trace."""
    return tree if is_traced(tree) else jax.tree.map(lambda leaf: np.asarray(leaf) if eqx.is_array(leaf) else leaf, tree)


def leverage(fit: Fit[Any]) -> AnyArray:
    """Share of each residual in its own prediction, the diagonal of the hat matrix W^1/2 J (J'WJ + K'K)^-1 J' W^1/2.

    A residual of leverage one is fitted exactly, whatever its value. W are the weights of a robust loss, K is the Jacobian of the priors.

    Parameters
    ----------
    fit
        Any fit by `solve`.

    Returns
    -------
    (n,) between 0 and 1. The sum is the number of parameters, minus the part that the priors determine.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import solve
    >>> from jaxcal.fitting._result import leverage
    >>> fit = solve(lambda slope, data: slope * data[0] - data[1], 0.0, (jnp.array([1.0, 1.0, 2.0]), jnp.array([1.0, 1.2, 2.1])))
    >>> print(leverage(fit).round(3))
    [0.167 0.167 0.667]
    """
    return known_of(fit).leverage(weighted_rows(fit)[0])


def identifiability(fit: Fit[Any]) -> Information:
    """Which parameters of a fit the data determine, and which combination they determine least.

    Parameters
    ----------
    fit
        Any fit, converged or not.

    Returns
    -------
    Information of data and priors; its `sentence` names the parameters.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import identifiability, solve
    >>> def residuals(model, y):
    ...     return model["scale"] * (9.81 + model["bias"]) - y
    >>> fit = solve(residuals, {"bias": 0.0, "scale": 1.0}, jnp.array([9.9, 9.8, 9.9]))
    >>> print(identifiability(fit).sentence.split(";")[0])
    The data determine 1 of 2 parameters and cannot tell apart bias, scale
    """
    return known_of(fit)
