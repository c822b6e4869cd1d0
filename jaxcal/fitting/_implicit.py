"""The derivative of what an iteration ends at, by the implicit function theorem: none goes through its steps."""

import functools
from collections.abc import Callable
from typing import Any

import jax


@functools.partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def implicit(solver: Callable[..., Any], score: Callable[..., Any], *data: Any) -> Any:
    """`solver(*data)`: the root x of `score(x, further, *data)`, and what else a solver tells; only x has a derivative.

    Items of a batch are solved one by one: each takes only its own steps, and batched routines of LAPACK that run side by side may hang.

    Examples
    --------
    >>> import jax
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting._implicit import implicit
    >>> root = lambda a: implicit(lambda a: (jnp.sqrt(a), ()), lambda x, _, a: x**2 - a, a)[0][0]
    >>> print(jax.grad(root)(jnp.array([4.0])))
    [0.25]
    """
    return jax.custom_batching.sequential_vmap(solver)(*data)


@implicit.defjvp
def _(solver: Callable[..., Any], score: Callable[..., Any], data: tuple, change: tuple) -> Any:
    x, further = implicit(solver, score, *data)
    push = jax.jvp(lambda *data: score(x, further, *data), data, change)[1]
    slope = jax.jacfwd(score)(x, further, *data)
    size = abs(slope.diagonal()) ** 0.5
    size = jax.numpy.where(size > 0, size, 1.0)
    moved = -jax.numpy.linalg.solve(slope / size[:, None] / size[None], push / size) / size
    return (x, further), (moved, jax.tree.map(jax.numpy.zeros_like, further))
