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
from ..fitting import solve
from ._lanes import namespace, run

#: relative change of the modelled variance at which the weights have settled, for the fit and for a first guess, and the most steps
SETTLED, GUESSED, MOST = 1e-7, 1e-2, 40
#: the compiled program takes multiples of so many cluster sizes and terms
_ROWS, _TERMS = 32, 4


class Curve(NamedTuple):
    """An Allan variance curve with what its fit needs: a plain tuple, for the loops of the host read it thousands of times.

    v : (clusters,) measured variances. columns : (clusters, p + 1), A and the tail. tensor : (p, p, clusters, clusters), T.
    share : (clusters,) count of differences without gaps over that with them. octave : (clusters,) base-2 logarithm of the cluster
    size. short : (p,) 1 for the term whose shape the tail has, else 0.
    """

    v: AnyArray
    columns: AnyArray
    tensor: AnyArray
    share: AnyArray
    octave: AnyArray
    short: AnyArray

    def noise(self, theta) -> Any:
        """(p,) squared coefficients of the terms that scatter, the tail taken as what it looks like."""
        return theta[:-1] + self.short * namespace(self.v, theta).maximum(-theta[-1], 0.0)

    def covariance(self, theta) -> Any:
        """C(theta), (clusters, clusters); gaps leave fewer differences."""
        noise, loss = self.noise(theta), namespace(self.v, theta).sqrt(self.share)
        pairs = (noise[:, None] * noise[None, :]).ravel()
        return (pairs @ self.tensor.reshape(pairs.size, -1)).reshape(self.tensor.shape[2:]) * (loss[:, None] * loss[None, :])


class Lane(NamedTuple):
    """A fit: (clusters,) `used`, (p + 1,) `free` coefficients, the values `held` of the others, and those free in the fit beside it.

    Several fits have a first axis more.
    """

    used: AnyArray
    free: AnyArray
    held: AnyArray
    wider: AnyArray


class Settled(NamedTuple):
    """The fixed point of a lane, with the last change of the weights; the least chi-square with C at it, held and `wider`.

    theta : (p + 1,) fixed point. change : relative change of the modelled variance in the last step. held : least chi-square of the
    coefficients free, the others held. best, least : coefficients and least chi-square of those of `wider`, the others zero.
    """

    theta: AnyArray
    change: AnyArray
    held: AnyArray
    best: AnyArray
    least: AnyArray


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


def least_squares(white: tuple[Any, Any], free, held, start) -> tuple[Any, Any]:
    """Coefficients of least chi-square of whitened columns and variances, none but the tail negative, and that chi-square."""
    rows, target = white
    # a coefficient that is not free has no column, and must lie on a bound
    lower = jnp.where(free, np.append(np.zeros(rows.shape[-1] - 1), -np.inf).astype(rows.dtype), 0.0)
    data = {"rows": jnp.where(free[None, :], rows, 0.0), "target": target - rows @ held}
    found = solve(differences, jnp.where(free, start, 0.0), data, bounds=(lower, np.inf))
    return jnp.where(free, found.parameters, held), 2.0 * found.cost


def _settle(shared, lane) -> Settled:
    """The fixed point of one lane, and the chi-square about it.

    Left alone the steps may swing, or go on at two thirds of the length before. Each is lengthened or shortened by what the last
    two tell (Irons and Tuck, Int. J. Numer. Meth. Eng. 1, 1969): a dozen steps do where halving every step took forty.
    """
    (curve, full, enough, most, extra), ((used, free, held, wider), start) = shared, lane
    lower = np.append(np.zeros(start.size - 1), -np.inf).astype(start.dtype)

    def body(state):
        theta, before, length, _, k = state
        new, _ = least_squares(whitened(curve, used, theta, full), free, held, theta)
        reached = curve.columns @ new
        change = jnp.where(used, (reached - curve.columns @ theta) / jnp.where(reached > 0.0, reached, 1.0), 0.0)
        bend = before - change
        turn = bend @ bend
        following = length * (before @ bend) / jnp.where(turn > 0.0, turn, 1.0)
        following = jnp.where((k > 1) & (following > 0.0), jnp.clip(following, 0.3, 4.0), 1.0)
        size = jnp.max(jnp.abs(change))
        # the last step is a whole one: what goes to zero is zero
        theta = jnp.where(size > enough, jnp.maximum(theta + following * (new - theta), lower), new)
        return theta, change, following, size, k + 1

    one = jnp.ones((), start.dtype)
    begun = (start, jnp.zeros_like(curve.v), one, np.inf * one, 0)
    theta, _, _, change, _ = jax.lax.while_loop(lambda state: (state[3] > enough) & (state[4] < most), body, begun)
    if wider is None:
        return Settled(theta, change, one, theta, one)
    white = whitened(curve, used, theta, True, extra)
    sets = jnp.stack([free, wider]), jnp.stack([held, jnp.zeros_like(held)])
    (_, best), (chi, least) = jax.lax.map(lambda one: least_squares(white, *one, theta), sets)
    return Settled(theta, change, chi, best, least)


def settle(curve: Curve, lanes: Lane, start, full: bool, enough: float = SETTLED, most: int = MOST, extra: Any = 0.0) -> Settled:
    """Iterate every lane until a step changes the modelled variance by no more than `enough` of it, `most` steps; from `start`.

    `extra` are independent variances that the chi-squares allow for besides.
    """
    if namespace(curve, lanes, start) is jnp:
        return run(_settle, (curve, full, enough, most, extra), (lanes, start), None)
    # filled up, at the end with cluster sizes that are not used and at the start with terms that are not free
    rows, terms, none = (0, -len(curve.v) % _ROWS), (-len(curve.short) % _TERMS, 0), (0, 0)
    full_curve = Curve(
        v=np.pad(curve.v, rows, constant_values=1.0),
        columns=np.pad(curve.columns, (rows, terms)),
        tensor=np.pad(curve.tensor, (terms, terms, rows, rows)),
        share=np.pad(curve.share, rows),
        octave=np.pad(curve.octave, rows),
        short=np.pad(curve.short, terms),
    )
    wider = lanes.free if lanes.wider is None else lanes.wider
    used, extra = np.pad(lanes.used, (none, rows)), np.pad(extra * np.ones(len(curve.v)), rows)
    lanes, start = Lane(used, *(np.pad(each, (none, terms)) for each in (lanes.free, lanes.held, wider))), np.pad(start, (none, terms))
    shared = full_curve, np.asarray(full), np.asarray(enough), np.asarray(most), extra
    found = run(_settle, shared, (lanes, start), Settled(start[0], 0.0, 0.0, start[0], 0.0))
    return found._replace(theta=found.theta[:, terms[0] :], best=found.best[:, terms[0] :])


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
