"""How a fit ended, as sentences that say what to do."""

import functools
from typing import Any

import equinox as eqx

from .._precision import array_module


class Outcome(eqx.Enumeration):
    """How a fit ended; `Outcome[item]` is the sentence."""

    converged = "The fit converged."
    at_bound = "The fit converged with a parameter at its bound, where its interval is one-sided; widen the bound unless it is a fact."
    unidentifiable = "The data do not determine every parameter; hold one fixed, add a prior, or record data that move it."
    stalled = "The fit stopped where its residuals still slope; look for a kink in the model, and run in float64."
    step_limit = "The fit reached its step limit before it converged; start closer, try several starts, or raise max_steps."
    not_finite = "The residuals became infinite or NaN; bound the parameters to where the model is defined, or start closer."


def ended(outcome: Any, *items: Any) -> Any:
    """Whether an outcome is one of `items`; unlike `==` of Equinox it takes no operation of JAX outside of a trace."""
    value = outcome._value
    return functools.reduce(array_module(value).logical_or, [value == item._value for item in items])
