r"""An Allan variance curve and least squares on it with weights that depend on the coefficients sought; host and trace.

The exact Allan variances of the terms are the columns of A, so that E v = A theta with theta the squared coefficients, and the
covariance of v is C(theta) = sum_ij theta_i theta_j T_ij (`covariance_tensor`). A step solves with the weights at the coefficients
of the step before,

.. math:: \theta \leftarrow \arg\min_{\theta \ge 0} (v - A\theta)'\,W(\theta)\,(v - A\theta)

with W = C^-1 (method "gls", `full`) or the inverse of its diagonal, 2 (A theta)^2 / edf ("edf" and "wavelet").

The last column is that of a tail, -1/tau^2: what a filter leaves at cluster times well above its own. It has the shape of Q with
either sign, so Q and the tail are never free together; a tail of the sign of Q scatters as Q does.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._types import AnyArray
from ..allan import Deviation
from ..fitting import solve
from ._covariance import covariance_tensor
from ._lanes import filled, namespace, run
from ._terms import Term

#: relative change of the modelled variance at which the weights have settled, for the fit and for a first guess, and the most steps
SETTLED, GUESSED, MOST = 1e-7, 1e-2, 40
#: the compiled program takes multiples of so many cluster sizes and terms
_ROWS, _TERMS = 32, 4


class Curve(NamedTuple):
    """An Allan variance curve with what its fit needs: a plain tuple, for the loops of the host read it thousands of times.

    v : (clusters,) measured variances. columns : (clusters, p + 1), A and the tail. tensor : (p, p, clusters, clusters), T, larger
    where gaps leave fewer differences. short : (p,) 1 for the term whose shape the tail has, else 0.
    """

    v: AnyArray
    columns: AnyArray
    tensor: AnyArray
    short: AnyArray

    def noise(self, theta) -> Any:
        """(p,) squared coefficients of the terms that scatter, the tail taken as what it looks like."""
        return theta[:-1] + self.short * namespace(self.v, theta).maximum(-theta[-1], 0.0)

    def covariance(self, theta) -> Any:
        """C(theta), (clusters, clusters)."""
        noise = self.noise(theta)
        pairs = (noise[:, None] * noise[None, :]).ravel()
        return (pairs @ self.tensor.reshape(pairs.size, -1)).reshape(self.tensor.shape[2:])


class Lane(NamedTuple):
    """A fit to the clusters `used`: `free` coefficients, the values `held` of the others, and those free in the fit beside it.

    (clusters,), then (p + 1,) each; several fits have a first axis more.
    """

    used: Any
    free: Any
    held: Any
    wider: Any


class Settled(NamedTuple):
    """The fixed point `theta` of a lane, with the last change of the modelled variance, and chi-squares with C at that point.

    `held` is the least one of the free coefficients; `best` are the coefficients of `wider` of the least one, `least`.
    """

    theta: AnyArray
    change: Any
    held: Any
    best: AnyArray
    least: Any


#: axes of a `Curve` and of several `Lane`: rows, which are clusters, terms, columns, lanes
_AXES, _LANES = ("r", "rc", "ttrr", "t"), ("lr", "lc", "lc", "lc")


def curve_of(curve: Deviation, samples: int, terms: tuple[Term, ...], variance, inside) -> tuple[Curve, Any, Any]:
    """Allan variances with columns and covariance tensor, divided by the largest one; which of those `inside` are used; and that one."""
    xp, used = namespace(variance), inside & (variance > 0.0)
    dt, dtype = 1.0 / curve.rate, variance.dtype
    # squares of small coefficients would leave the range of float32
    unit = xp.max(xp.where(used, variance, 0.0))
    with jax.ensure_compile_time_eval():  # neither depends on the record
        found = [np.asarray(term.avar(curve.tau, dt)) for term in terms]
        tensor = covariance_tensor(samples, tuple(int(m) for m in curve.m), dt, terms)
    short = np.array([term.name == "Q" for term in terms])
    tail = -found[int(np.argmax(short))] if short.any() else -1.0 / curve.tau**2
    columns, loss = np.stack([*found, tail], axis=1).astype(dtype), ((1.0 + curve.skipped / curve.count) ** 0.5).astype(dtype)
    tensor = tensor.astype(dtype) * (loss[:, None] * loss[None, :])[None, None]
    return Curve(xp.where(used, variance / unit, 1.0), columns, tensor, short.astype(dtype)), used, unit


def correlation(curve: Curve, used, theta, extra: Any = 0.0) -> tuple[Any, Any]:
    """Correlation matrix and standard deviations of v with C at theta, plus independent variances `extra`; unused ones apart."""
    xp = namespace(curve.v, used, theta)
    identity = np.eye(len(curve.v), dtype=curve.v.dtype)
    c = xp.where(used[:, None] & used[None, :], curve.covariance(theta) + xp.diag(extra * xp.ones_like(curve.v)), identity)
    scale = xp.sqrt(xp.diagonal(c))
    scale = xp.where(scale > 0.0, scale, 1.0)
    # smallest eigenvalues are about 1e-3; the addition keeps them above zero in any precision
    return c / scale[:, None] / scale[None, :] + max(1e-8, 64 * float(np.finfo(c.dtype).eps)) * identity, scale


def whiten(matrix, rows) -> Any:
    """L^-1 rows with L L' = matrix."""
    if namespace(matrix, rows) is np:
        return np.linalg.solve(np.linalg.cholesky(matrix), rows)
    return jax.scipy.linalg.solve_triangular(jnp.linalg.cholesky(matrix), rows, lower=True)


def whitened(curve: Curve, used, theta, full: Any, extra: Any = 0.0) -> tuple[Any, Any]:
    """A and v of unit covariance with C (its diagonal unless `full`) at theta: (clusters, p + 1) and (clusters,)."""
    xp = namespace(curve.v, used, theta)
    rows = xp.where(used[:, None], xp.concatenate([curve.columns, curve.v[:, None]], axis=1), 0.0)

    def wholly():
        matrix, scale = correlation(curve, used, theta, extra)
        return whiten(matrix, rows / scale[:, None])

    def one_by_one():
        variance = xp.diagonal(curve.covariance(theta))
        # without coefficients relative errors are taken as equal
        return rows / xp.sqrt(xp.where(variance > 0.0, variance, curve.v**2))[:, None]

    rows = (wholly() if full else one_by_one()) if isinstance(full, bool) else jax.lax.cond(full, wholly, one_by_one)
    return rows[:, :-1], rows[:, -1]


def differences(theta, data):
    """Residuals of whitened columns and variances."""
    return data["rows"] @ theta - data["target"]


def _lower(theta) -> np.ndarray:
    """Bounds: the tail alone may have either sign."""
    return np.append(np.zeros(theta.size - 1), -np.inf).astype(theta.dtype)


def least_squares(white: tuple[Any, Any], free, held, start) -> tuple[Any, Any]:
    """Coefficients of least chi-square of whitened columns and variances, none but the tail negative, and that chi-square."""
    rows, target = white
    # a coefficient that is not free has no column, and must lie on a bound
    lower = jnp.where(free, _lower(start), 0.0)
    data = {"rows": jnp.where(free[None, :], rows, 0.0), "target": target - rows @ held}
    found = solve(differences, jnp.where(free, start, 0.0), data, bounds=(lower, np.inf))
    return jnp.where(free, found.parameters, held), 2.0 * found.cost


def _settle(shared, lane) -> Settled:
    """The fixed point of one lane, and the chi-squares about it: in one loop, which holds one problem of least squares to be compiled.

    Left alone the steps may swing, or go on at two thirds of the length before. Each is lengthened or shortened by what the last
    two tell (Irons and Tuck, Int. J. Numer. Meth. Eng. 1, 1969): a dozen steps do where halving every step took forty.
    """
    (curve, full, enough, most, extra), ((used, free, held, wider), start) = shared, lane

    def body(state):
        (theta, change, chi, best, least), before, length, k, phase = state
        moving, second = phase == 0, phase == 2
        white = whitened(curve, used, theta, full | ~moving, jnp.where(moving, 0.0, extra))
        new, value = least_squares(white, jnp.where(second, wider, free), jnp.where(second, 0.0, held), theta)
        reached = curve.columns @ new
        departure = jnp.where(used, (reached - curve.columns @ theta) / jnp.where(reached > 0.0, reached, 1.0), 0.0)
        bend = before - departure
        turn = bend @ bend
        following = length * (before @ bend) / jnp.where(turn > 0.0, turn, 1.0)
        following = jnp.where((k > 1) & (following > 0.0), jnp.clip(following, 0.3, 4.0), 1.0)
        size = jnp.max(jnp.abs(departure))
        # the last step is a whole one: what goes to zero is zero
        further = jnp.where(size > enough, jnp.maximum(theta + following * (new - theta), _lower(theta)), new)
        found = Settled(
            theta=jnp.where(moving, further, theta),
            change=jnp.where(moving, size, change),
            held=jnp.where(phase == 1, value, chi),
            best=jnp.where(second, new, best),
            least=jnp.where(second, value, least),
        )
        return found, departure, following, k + 1, jnp.where(~moving | (size <= enough) | (k + 1 >= most), phase + 1, phase)

    one = jnp.ones((), start.dtype)
    begun = Settled(start, np.inf * one, one, start, one), jnp.zeros_like(curve.v), one, 0, jnp.where(jnp.asarray(most) > 0, 0, 1)
    return jax.lax.while_loop(lambda state: state[-1] < 3, body, begun)[0]


def settle(curve: Curve, lanes: Lane, start, full: bool, enough: float = SETTLED, most: int = MOST, extra: Any = 0.0) -> Settled:
    """Iterate every lane until a step changes the modelled variance by no more than `enough` of it, `most` steps; from `start`.

    `extra` are independent variances that the chi-squares allow for besides.
    """
    if namespace(curve, lanes, start) is jnp:
        return run(_settle, (curve, full, enough, most, extra), (lanes, start), None)
    # filled up, at the end with cluster sizes that are not used and at the start with terms that are not free
    n, p = len(curve.v), len(curve.short)
    rows, terms = -(-n // _ROWS) * _ROWS, -(-p // _TERMS) * _TERMS
    size = {"r": rows, "t": terms, "c": terms + 1, "l": len(start)}

    def long(array, axes: str):
        return filled(array, *(size[axis] for axis in axes), at=tuple((axis in "tc") * (terms - p) for axis in axes), value=axes == "r")

    each = Lane(*(long(leaf, axes) for leaf, axes in zip(lanes, _LANES, strict=True)))
    full_curve = Curve(*(long(leaf, axes) for leaf, axes in zip(curve, _AXES, strict=True)))
    start, extra = long(start, "lc"), long(extra * np.ones(n), "r")
    shared = full_curve, np.asarray(full), np.asarray(enough), np.asarray(most), extra
    found = run(_settle, shared, (each, start), Settled(start[0], 0.0, 0.0, start[0], 0.0))
    return found._replace(theta=found.theta[:, terms - p :], best=found.best[:, terms - p :])


def estimate(curve: Curve, lanes: Lane, full: bool) -> tuple[Any, Any]:
    """The fixed point from nothing, `full` weights by way of independent ones, and its last change; differentiable in a trace.

    The iteration carries no derivative. One Newton step for theta = step(theta) from its end does, that of the implicit
    function theorem.
    """
    traced = namespace(curve, lanes) is jnp
    still, start = (jax.lax.stop_gradient((curve, lanes)), jnp.zeros_like(lanes.held)) if traced else ((curve, lanes), lanes.held)
    if full:
        start = settle(*still, start, False, GUESSED).theta
    found = settle(*still, start, full)
    if not traced:
        return found.theta, found.change
    each = [_with_derivative(curve, jax.tree.map(lambda leaf: leaf[k], lanes), found.theta[k], full) for k in range(len(start))]  # noqa: B023
    return jnp.stack(each), found.change


def _with_derivative(curve: Curve, lane: Lane, theta, full: bool) -> Any:
    def step(at):
        return least_squares(whitened(curve, lane.used, at, full), lane.free, lane.held, at)[0]

    new = step(theta)
    slope = jax.lax.stop_gradient(jax.jacfwd(step)(theta))
    size = jnp.max(jnp.abs(curve.columns), axis=0)  # in units of these the coefficients are of similar size
    apart = jnp.eye(len(theta), dtype=theta.dtype) - slope * size[:, None] / size[None, :]
    move = jnp.linalg.solve(apart, (new - theta) * size) / size
    # the value is the fixed point's, whatever the Newton step
    return theta + move - jax.lax.stop_gradient(move)
