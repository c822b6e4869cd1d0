"""`solve_many`: the same fit for many data sets."""

import dataclasses
from collections.abc import Callable
from typing import Any, Literal

import equinox as eqx
import jax

from .._compile import filter_jit
from .._types import Array
from ._fit import run
from ._parameters import common_dtype, to_floats
from ._problem import Problem, define
from ._result import Fit, M


def solve_many(
    residuals: Callable[[Any, Any], Array],
    start: M,
    data: Any,
    *,
    batched: Any = (True, True),
    batch: Literal["map", "vmap"] | None = None,
    **options: Any,
) -> Fit[M]:
    """Fit the same model to many data sets in one compiled call.

    Nothing is raised for one bad data set among many: look at `outcome` or `usable`, one per fit.

    Parameters
    ----------
    residuals
        As for `solve`.
    start, data
        As for `solve`, with one more axis in front of every leaf that is `batched`.
    batched
        Which leaves have that axis: True or False for all of `start`, and for all of `data` (or a tree for each).
    batch
        "map" solves one after another, each in as few steps as it needs; "vmap" all at once, each in as many steps as the
        slowest. By default "map" on a CPU and "vmap" elsewhere.
    options
        Those of `solve`, the same for every fit.

    Returns
    -------
    Fit whose arrays have the fits as their first axis.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import solve_many
    >>> y = jnp.array([[1.0, 2.0, 3.0], [4.0, 4.0, 7.0]])
    >>> fits = solve_many(lambda mean, y: mean - y, 0.0, y, batched=(False, True))
    >>> print(fits.model.round(3))
    [2. 5.]
    """
    start, data = to_floats((start, data), common_dtype(start, data))
    mapped, shared = eqx.partition((start, data), batched)
    first = eqx.combine(jax.tree.map(lambda leaf: leaf[0], mapped), shared)
    defaults = dict.fromkeys(("free", "bounds", "loss", "solver", "starts", "rtol")) | {"priors": (), "max_steps": 128}
    template = define(residuals, *first, **(defaults | options))
    if batch is None:
        batch = "map" if jax.default_backend() == "cpu" else "vmap"
    return _each(template, mapped, shared, batch == "vmap")


@filter_jit
def _each(template: Problem, mapped: Any, shared: Any, together: bool) -> Fit:
    def one(item: Any) -> Fit:
        start, data = eqx.combine(item, shared)
        return dataclasses.replace(run(dataclasses.replace(template, start=start, data=data)), problem=None)

    return jax.vmap(one)(mapped) if together else jax.lax.map(one, mapped)
