r"""An Allan variance curve, and its least-squares fit with weights that depend on the coefficients; on the host and in a trace.

The exact Allan variances of the terms are the columns of A, so that E v = A theta with theta the squared coefficients. The covariance
of v is C(theta) = sum_ij theta_i theta_j T_ij (`covariance_tensor`). Each step takes the weights at the coefficients of the step
before and solves

.. math:: \theta \leftarrow \arg\min_{\theta \ge 0} (v - A\theta)'\,W(\theta)\,(v - A\theta)

with W = C^-1 (`full`), or for a first guess the inverse of its diagonal, 2 (A theta)^2 / edf.

The last column belongs to a tail, -1/tau^2, which describes the effect of a filter at cluster times well above its own time constant.
Its coefficient may have either sign. The tail has the shape of Q, so the two are never fitted together. A tail with the sign of Q
scatters as Q does.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._arrays import namespace
from .._types import AnyArray
from ..allan import Deviation
from ..fitting import solve
from ._covariance import covariance_tensor
from ._lanes import filled, run
from ._terms import Term

#: relative change of the modelled variance at which the iteration stops, for the fit and for a first guess; largest number of steps
SETTLED, GUESSED, MOST = 1e-7, 1e-2, 40
#: the numbers of cluster sizes and of terms are padded to multiples of these, so that few programs are compiled
_ROWS, _TERMS = 32, 4


class Curve(NamedTuple):
    """An Allan variance curve with all that its fit needs. It is a plain tuple, because loops on the host read it thousands of times.

    v : (clusters,) measured variances. columns : (clusters, p + 1), A and the tail. tensor : (p, p, clusters, clusters), T, increased
    where gaps leave fewer differences. short : (p,) 1 for the term that has the shape of the tail (Q), else 0.
    """

    v: AnyArray
    columns: AnyArray
    tensor: AnyArray
    short: AnyArray

    def noise(self, theta) -> Any:
        """(p,) squared coefficients that determine the scatter; a tail with the sign of Q counts as Q."""
        return theta[:-1] + self.short * namespace(self.v, theta).maximum(-theta[-1], 0.0)

    def covariance(self, theta) -> Any:
        """C(theta), (clusters, clusters)."""
        noise = self.noise(theta)
        pairs = (noise[:, None] * noise[None, :]).ravel()
        return (pairs @ self.tensor.reshape(pairs.size, -1)).reshape(self.tensor.shape[2:])


class Lane(NamedTuple):
    """One of several fits: which clusters are `used`, which coefficients are `free`, and the values at which the others are `held`.

    `wider` marks the coefficients that are free in a second fit, for comparison. Shapes: `used` (clusters,), the others (p + 1,);
    several fits together have one more axis in front.
    """

    used: Any
    free: Any
    held: Any
    wider: Any


class Settled(NamedTuple):
    """The fixed point `theta` of a lane, the last change of the modelled variance, and two chi-squares, both with C at that point.

    `held` is the smallest chi-square over the free coefficients. `least` is the smallest one over the coefficients of `wider`, reached
    at `best`.
    """

    theta: AnyArray
    change: Any
    held: Any
    best: AnyArray
    least: Any


#: axes of the fields of a `Curve` and of several `Lane`: r for rows (clusters), t for terms, c for columns, l for lanes
_AXES, _LANES = ("r", "rc", "ttrr", "t"), ("lr", "lc", "lc", "lc")


def curve_of(curve: Deviation, samples: int, terms: tuple[Term, ...], variance, inside) -> tuple[Curve, Any, Any]:
    """The curve in units of its largest variance, with columns and covariance tensor; which clusters `inside` are used; and that unit."""
    xp, used = namespace(variance), inside & (variance > 0.0)
    dt, dtype = 1.0 / curve.rate, variance.dtype
    # in SI units the squares of small coefficients would leave the range of float32
    unit = xp.max(xp.where(used, variance, 0.0))
    with jax.ensure_compile_time_eval():  # columns and tensor do not depend on the record
        found = [np.asarray(term.avar(curve.tau, dt)) for term in terms]
        tensor = covariance_tensor(samples, tuple(int(m) for m in curve.m), dt, terms)
    short = np.array([term.name == "Q" for term in terms])
    tail = -found[int(np.argmax(short))] if short.any() else -1.0 / curve.tau**2
    columns, loss = np.stack([*found, tail], axis=1).astype(dtype), ((1.0 + curve.skipped / curve.count) ** 0.5).astype(dtype)
    tensor = tensor.astype(dtype) * (loss[:, None] * loss[None, :])[None, None]
    return Curve(xp.where(used, variance / unit, 1.0), columns, tensor, short.astype(dtype)), used, unit


def correlation(curve: Curve, used, theta, extra: Any = 0.0) -> tuple[Any, Any]:
    """Correlation matrix and standard deviations of v, with C at theta plus independent variances `extra`.

    Clusters that are not used are independent of all others, with unit variance.
    """
    xp = namespace(curve.v, used, theta)
    identity = np.eye(len(curve.v), dtype=curve.v.dtype)
    c = xp.where(used[:, None] & used[None, :], curve.covariance(theta) + xp.diag(extra * xp.ones_like(curve.v)), identity)
    scale = xp.sqrt(xp.diagonal(c))
    scale = xp.where(scale > 0.0, scale, 1.0)
    # the smallest eigenvalues are about 1e-3; the addition keeps them above zero in any precision
    return c / scale[:, None] / scale[None, :] + max(1e-8, 64 * float(np.finfo(c.dtype).eps)) * identity, scale


def whiten(matrix, rows) -> Any:
    """L^-1 rows, where L L' = matrix is the Cholesky factorisation."""
    if namespace(matrix, rows) is np:
        return np.linalg.solve(np.linalg.cholesky(matrix), rows)
    return jax.scipy.linalg.solve_triangular(jnp.linalg.cholesky(matrix), rows, lower=True)


def whitened(curve: Curve, used, theta, full: Any, extra: Any = 0.0) -> tuple[Any, Any]:
    """A and v, scaled so that v has unit covariance if its covariance is C (its diagonal unless `full`) at theta.

    Returns arrays of shape (clusters, p + 1) and (clusters,).
    """
    xp = namespace(curve.v, used, theta)
    rows = xp.where(used[:, None], xp.concatenate([curve.columns, curve.v[:, None]], axis=1), 0.0)

    def wholly():
        matrix, scale = correlation(curve, used, theta, extra)
        return whiten(matrix, rows / scale[:, None])

    def one_by_one():
        variance = xp.diagonal(curve.covariance(theta))
        # while all coefficients are zero, all clusters get the same relative error
        return rows / xp.sqrt(xp.where(variance > 0.0, variance, curve.v**2))[:, None]

    rows = (wholly() if full else one_by_one()) if isinstance(full, bool) else jax.lax.cond(full, wholly, one_by_one)
    return rows[:, :-1], rows[:, -1]


def differences(theta, data):
    """Residuals of the whitened least-squares problem."""
    return data["rows"] @ theta - data["target"]


def _lower(theta) -> np.ndarray:
    """Lower bounds of the coefficients: only the tail may be negative."""
    return np.append(np.zeros(theta.size - 1), -np.inf).astype(theta.dtype)


def least_squares(white: tuple[Any, Any], free, held, start) -> tuple[Any, Any]:
    """Coefficients with the smallest chi-square, and that chi-square. Only the tail may be negative."""
    rows, target = white
    # a coefficient that is not free has a column of zeros, and must lie on a bound
    lower = jnp.where(free, _lower(start), 0.0)
    data = {"rows": jnp.where(free[None, :], rows, 0.0), "target": target - rows @ held}
    found = solve(differences, jnp.where(free, start, 0.0), data, bounds=(lower, np.inf))
    return jnp.where(free, found.parameters, held), 2.0 * found.cost


def _settle(shared, lane) -> Settled:
    """Find the fixed point of one lane and then its two chi-squares, all in one loop, so that least squares is compiled only once.

    Plain steps may oscillate, or shrink to only two thirds from one to the next. The length of each step is therefore chosen from the
    last two steps (Irons and Tuck, Int. J. Numer. Meth. Eng. 1, 1969). This needs a dozen steps where halving every step took forty.
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
        # the last step has full length, so that coefficients that tend to zero become exactly zero
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
    """Iterate every lane from `start` until a step changes the modelled variance by at most the fraction `enough`, or `most` steps.

    The chi-squares also allow for independent variances `extra`.
    """
    if namespace(curve, lanes, start) is jnp:
        return run(_settle, (curve, full, enough, most, extra), (lanes, start), None)
    # pad with unused cluster sizes at the end, and with terms that are not free at the start
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


def estimate(curve: Curve, lanes: Lane) -> tuple[Any, Any]:
    """Find the fixed point from a start at zero, and return it with its last change; differentiable in a trace.

    A first guess with independent weights comes before. The iteration carries no derivative. One Newton step for theta = step(theta) at
    its end provides the derivative, by the implicit function theorem.
    """
    traced = namespace(curve, lanes) is jnp
    still, start = (jax.lax.stop_gradient((curve, lanes)), jnp.zeros_like(lanes.held)) if traced else ((curve, lanes), lanes.held)
    found = settle(*still, settle(*still, start, False, GUESSED).theta, True)
    if not traced:
        return found.theta, found.change
    each = [_with_derivative(curve, jax.tree.map(lambda leaf: leaf[k], lanes), found.theta[k]) for k in range(len(start))]  # noqa: B023
    return jnp.stack(each), found.change


def _with_derivative(curve: Curve, lane: Lane, theta) -> Any:
    def step(at):
        return least_squares(whitened(curve, lane.used, at, True), lane.free, lane.held, at)[0]

    new = step(theta)
    slope = jax.lax.stop_gradient(jax.jacfwd(step)(theta))
    size = jnp.max(jnp.abs(curve.columns), axis=0)  # scales that make the coefficients similar in size
    apart = jnp.eye(len(theta), dtype=theta.dtype) - slope * size[:, None] / size[None, :]
    move = jnp.linalg.solve(apart, (new - theta) * size) / size
    # the Newton step contributes its derivative only; the value remains that of the fixed point
    return theta + move - jax.lax.stop_gradient(move)
