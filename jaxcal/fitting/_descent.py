"""Least squares of residuals that come with their Jacobian in closed form, and the derivative of what they end at.

On the host NumPy takes the steps, and nothing is compiled. In a trace the same steps run in one loop of JAX, and no derivative goes through
them: `implicit` gives the solution its derivative by the implicit function theorem.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from .._types import AnyArray

#: Damping of the first step relative to the unit diagonal: nearly a Gauss-Newton step, but never a singular matrix.
FIRST_DAMPING = 1e-2
#: Shares of the predicted decrease: above the first a step is accepted, above the second the next step is longer.
ACCEPTED, GOOD = 0.01, 0.75
SHORTER, LONGER = 0.25, 3.5


class Point(NamedTuple):
    """Residuals (n,) with their Jacobian (n, p) at `x`, and the normal equations with columns of unit length."""

    x: Any
    carry: Any
    residuals: Any
    rows: Any
    column: Any
    gram: Any
    gradient: Any
    total: Any


class _State(NamedTuple):
    """The best point so far, the next one to try, and the undamped step from the best."""

    best: Point
    trial: Any
    newton: Any
    longest: Any
    size: Any
    count: Any
    done: Any


def repeated(step: Callable[[Any], Any], state: Any, done: Callable[[Any], Any]) -> Any:
    """`step` until `done`: a loop of Python for arrays of NumPy, and one of JAX in a trace."""
    if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(state)):
        return jax.lax.while_loop(lambda now: ~done(now), step, state)
    while not done(state):
        state = step(state)
    return state


def descend(
    evaluate: Callable[[Any, Any], tuple[Any, Any, Any]], start: AnyArray, carry: Any, *, rtol: float = 1e-8, most: int = 128
) -> tuple[Point, Any]:
    """Levenberg-Marquardt steps with columns of unit length, as those of `solve`.

    Parameters
    ----------
    evaluate
        Takes parameters (p,) and a carry to the residuals (n,), their Jacobian (n, p), and a carry for the next step from there.
    start, carry
        Where to begin.
    rtol
        Remaining step, relative to the statistical uncertainty, that ends the steps. most : number of evaluations.

    Returns
    -------
    The end, and whether the cost has no slope left there.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.fitting._descent import descend
    >>> x = np.linspace(0.0, 1.0, 9)
    >>> y = np.exp(-2.0 * x)
    >>> end, converged = descend(lambda k, _: (np.exp(-k * x) - y, (-x * np.exp(-k * x))[:, None], ()), np.ones(1), ())
    >>> print(end.x.round(6), bool(converged))
    [2.] True
    """
    xp, p = start.__array_namespace__(), start.size
    eps, eye = float(np.finfo(start.dtype).eps), xp.eye(p, dtype=start.dtype)
    rounding = 10 * p * eps

    def point(x: Any, carry: Any) -> Point:
        residuals, rows, carry = evaluate(x, carry)
        gram, gradient = rows.T @ rows, rows.T @ residuals
        column = xp.sqrt(xp.diagonal(gram))
        column = xp.where(column > 0, column, 1.0)
        return Point(x, carry, residuals, rows, column, gram / column[:, None] / column[None], gradient / column, residuals @ residuals)

    def solved(here: Point, damping: Any) -> Any:
        # the floor keeps the matrix positive if columns are dependent or zero
        return -xp.linalg.solve(here.gram + xp.maximum(damping, rounding)[:, None] * eye, here.gradient)

    def offset(best: Point, newton: Any) -> Any:
        return -(best.gradient @ newton) / xp.where(best.total > 0, best.total, 1.0)

    def aimed(best: Point, longest: Any, size: Any, count: Any) -> _State:
        # damp a parameter by its longest column so far (More, 1978): otherwise it could diverge where it has no effect
        longest = xp.maximum(longest, best.column)
        newton = solved(best, 0.0 * longest)
        step = solved(best, FIRST_DAMPING / size * (longest / best.column) ** 2)
        short = xp.linalg.norm(step) <= eps**0.75 * xp.linalg.norm(best.column * best.x)
        done = (offset(best, newton) <= rtol**2) | short | (count >= most)
        return _State(best, best.x + step / best.column, newton, longest, size, count, done)

    def advance(state: _State) -> _State:
        best, here = state.best, point(state.trial, state.best.carry)
        way = best.column * (state.trial - best.x)
        change, predicted = (here.total - best.total) / 2, way @ (best.gradient + best.gram @ way / 2)
        # so near the solution that the cost only changes by rounding, the linearised residuals are right, and the cost cannot judge them
        near = (offset(best, state.newton) <= rounding) & (change <= rounding * best.total)
        accept = (change <= ACCEPTED * predicted) | near
        good = (predicted < 0) & (change < GOOD * predicted)
        size = state.size * xp.where(accept, xp.where(good, LONGER, 1.0), SHORTER)
        if xp is np:
            best = here if accept else best
        else:
            best = jax.tree.map(lambda new, old: xp.where(accept, new, old), here, best)
        return aimed(best, state.longest, size, state.count + 1)

    # no point yet: any is better, and a trace contains the residuals once
    zero, none = 0.0 * start, xp.zeros((), dtype=start.dtype)
    kept = (
        (none, none)
        if xp is np
        else jax.tree.map(lambda leaf: xp.zeros(leaf.shape, leaf.dtype), jax.eval_shape(evaluate, start, carry)[:2])
    )
    before = Point(start, carry, kept[0], kept[1], zero, zero[None] * zero[:, None], zero, none + np.inf)
    begin = _State(before, start, zero, zero, none + 1.0, xp.asarray(0), xp.asarray(False))
    end = repeated(advance, begin, lambda state: state.done)
    flat = (offset(end.best, end.newton) <= 1e-6) | (xp.linalg.norm(end.newton) <= eps**0.5 * xp.linalg.norm(end.best.column * end.best.x))
    return end.best, flat & xp.isfinite(end.best.total)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def implicit(solver: Callable[..., Any], score: Callable[..., Any], *data: Any) -> Any:
    """`solver(*data)`: the root x of `score(x, further, *data)`, and what else a solver tells; only x has a derivative.

    Items of a batch are solved one by one: each takes only its own steps, and batched routines of LAPACK that run side by side may hang.

    Examples
    --------
    >>> import jax
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting._descent import implicit
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
