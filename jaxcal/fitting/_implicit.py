"""The derivative of what an iteration ends at, by the implicit function theorem: none goes through its steps."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp


@functools.partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def implicit(solver: Callable[..., Any], score: Callable[..., Any], *data: Any) -> Any:
    """`solver(*data)`: the root x of `score(x, further, *data)`, and what else a solver tells; only x has a derivative.

    On a processor the items of a batch are solved one by one: each takes only its own steps, and batched routines of LAPACK that run side
    by side may hang. On a graphics card all take their steps together.

    Examples
    --------
    >>> import jax
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting._implicit import implicit
    >>> root = lambda a: implicit(lambda a: (jnp.sqrt(a), ()), lambda x, _, a: x**2 - a, a)[0][0]
    >>> print(jax.grad(root)(jnp.array([4.0])))
    [0.25]
    """
    return (jax.custom_batching.sequential_vmap(solver) if jax.default_backend() == "cpu" else solver)(*data)


@implicit.defjvp
def _(solver: Callable[..., Any], score: Callable[..., Any], data: tuple, change: tuple) -> Any:
    x, further = implicit(solver, score, *data)
    moved = root_change(lambda x, *data: score(x, further, *data), x, data, change)
    return (x, further), (moved, jax.tree.map(jnp.zeros_like, further))


def root_change(score: Callable[..., Any], x: Any, data: tuple, change: tuple) -> Any:
    """Change of the root x of `score(x, *data)` with the data, by the implicit function theorem: the one derivative of all fits."""
    _, along = jax.linearize(score, x, *data)
    push, none = along(jnp.zeros_like(x), *change), jax.tree.map(jnp.zeros_like, change)
    slope = jax.vmap(lambda way: along(way, *none), out_axes=-1)(jnp.eye(x.size, dtype=x.dtype))
    size = jnp.sqrt(jnp.abs(jnp.diagonal(slope)))
    size = jnp.where(size > 0, size, 1.0)
    return -jnp.linalg.solve(slope / size[:, None] / size[None], push / size) / size
