"""Profile-likelihood intervals: the values of a parameter that the data do not rule out."""

import dataclasses
import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import FitError
from ._covariance import covariance
from ._fit import run
from ._result import Fit


class Interval(eqx.Module):
    """Interval of one parameter, from `low` to `high` at level `confidence`; infinite if the data set no limit.

    Examples
    --------
    >>> from jaxcal.fitting import Interval
    >>> Interval(low=0.9, high=1.1, confidence=0.95).high
    1.1
    """

    low: float
    high: float
    confidence: float = eqx.field(static=True)


def profile_interval(fit: Fit[Any], name: str, *, confidence: float = 0.95, scaled: bool = False) -> Interval:
    """Interval of a parameter, found by holding it at trial values and refitting all others.

    At the ends, the sum of squares exceeds its minimum by the chi-square quantile with one degree of freedom; with `scaled`, and with a
    robust loss, by s^2 times the F(1, n-p) quantile. Unlike a standard error, this interval follows the curvature of the model (D. M.
    Bates and D. G. Watts, Nonlinear Regression Analysis, 1988, section 6.1). For a parameter at its bound, one end is the bound. The
    function runs on the host only and reuses the compiled fit.

    Parameters
    ----------
    fit
        A converged fit by `solve`.
    name
        Name of the parameter, one of `fit.names`.
    confidence
        Level of the interval.
    scaled
        True if the standard deviation of the residuals is unknown.

    Returns
    -------
    Interval, in the unit of the parameter.

    Raises
    ------
    FitError
        If the name is unknown, the fit did not converge, or the search finds a better fit.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import profile_interval, solve
    >>> fit = solve(lambda model, y: (model["mean"] - y) / 2, {"mean": 0.0}, jnp.array([1.0, 5.0, 3.0, 3.0]))
    >>> interval = profile_interval(fit, "mean")
    >>> round(interval.low, 3), round(interval.high, 3)
    (1.04, 4.96)
    """
    if name not in fit.names:
        raise FitError(f"There is no parameter {name!r}; the fit has {', '.join(fit.names)}.", code="no_parameter")
    if fit.problem is None:
        raise FitError("A fit out of many does not keep its data; solve it by itself for a profile.", code="no_data")
    fit.checked()
    problem = dataclasses.replace(fit.problem, starts=None)
    j, best, least = fit.names.index(name), np.asarray(fit.parameters, dtype=np.float64), 2 * float(fit.cost)
    if scaled and problem.priors:
        raise FitError("A scaled profile would scale the priors too; divide the residuals by their standard deviation.", code="priors")
    if scaled or fit.robust:
        rise = float(fit.variance * fit.mean_curvature) * scipy.special.fdtri(1, int(fit.degrees_of_freedom), confidence)
    else:
        rise = 2.0 * float(scipy.special.gammaincinv(0.5, confidence))
    # Without its bound, a parameter at the bound has a standard error; it only sets the length of the first step.
    place = np.arange(len(fit.names))
    lifted = dataclasses.replace(fit, at_bound=np.where(place == j, False, fit.at_bound))
    step = math.sqrt(rise * float(covariance(lifted)[j, j]))
    near = jnp.asarray(fit.parameters)

    def refit(value: float) -> Fit:
        nonlocal near
        lower, upper = (np.where(place == j, value, end).astype(near.dtype) for end in (problem.lower, problem.upper))
        found = run(dataclasses.replace(problem, start=problem.model(near.at[j].set(value)), lower=lower, upper=upper))
        near = jnp.where(found.usable, found.parameters, near)
        return found

    def excess(value: float) -> float:
        """Root of the rise at `value` over the allowed rise, minus one: nearly linear in the value."""
        gain = 2 * float(refit(value).cost) - least
        if not gain > -1e-3 * rise:
            raise FitError(f"A better fit turned up at {name} = {value:g}; start there, or use several starts.", code="better_fit")
        return math.sqrt(max(gain, 0.0) / rise) - 1

    def end(side: int, bound: float) -> float:
        nonlocal near
        near, inner, before, reach = jnp.asarray(fit.parameters), float(best[j]), -math.inf, step
        while inner != bound:
            outer = float(best[j] + side * reach)
            outer = bound if side * outer >= side * bound else outer
            now = excess(outer)
            if now >= 0:
                root = float(scipy.optimize.brentq(excess, inner, outer, xtol=1e-6 * step))  # type: ignore[arg-type]
                refit(root).checked()
                return root
            if now <= before:  # no further rise: the data set no limit
                return side * math.inf
            inner, before, reach = outer, now, 2.0 * reach
        return bound

    return Interval(end(-1, float(problem.lower[j])), end(1, float(problem.upper[j])), confidence)
