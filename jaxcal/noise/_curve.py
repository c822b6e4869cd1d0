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
from ._minimise import iterate, minimise, namespace, some

#: relative change of the modelled variance at which the weights have settled, and the most steps; for a first guess, and for profiles
SETTLED, GUESSED, _MOST = 1e-7, 1e-2, 40


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
        """(lanes, p) squared coefficients of the terms that scatter, the tail taken as what it looks like."""
        xp = namespace(self.v, theta)
        return theta[:, :-1] + self.short[None, :] * xp.maximum(-theta[:, -1:], 0.0)

    def covariance(self, theta) -> Any:
        """C(theta) of (lanes, p + 1) coefficients, (lanes, clusters, clusters); gaps leave fewer differences."""
        noise, xp = self.noise(theta), namespace(self.v, theta)
        pairs = (noise[:, :, None] * noise[:, None, :]).reshape(len(noise), -1)
        loss = xp.sqrt(self.share)
        return (pairs @ self.tensor.reshape(pairs.shape[1], -1)).reshape(-1, *self.tensor.shape[2:]) * (loss[:, None] * loss[None, :])[None]


class Lanes(NamedTuple):
    """Fits to run side by side: (lanes, clusters) `used`, (lanes, p + 1) `free` coefficients and the values `held` of the others."""

    used: AnyArray
    free: AnyArray
    held: AnyArray


def correlation(curve: Curve, used, theta, extra: Any = None) -> tuple[Any, Any]:
    """Correlation matrices and standard deviations of v with C at theta, plus independent variances `extra`; unused ones apart."""
    xp = namespace(curve.v, used, theta)
    identity = np.eye(len(curve.v), dtype=curve.v.dtype)
    extra = 0.0 * identity if extra is None else extra[None, :] * identity
    c = xp.where(used[:, :, None] & used[:, None, :], curve.covariance(theta) + extra[None], identity[None])
    scale = xp.sqrt(xp.diagonal(c, axis1=1, axis2=2))
    scale = xp.where(scale > 0.0, scale, 1.0)
    # smallest eigenvalues are about 1e-3; the addition keeps them above zero in any precision
    ridge = max(1e-8, 64 * float(np.finfo(c.dtype).eps)) * identity
    return c / scale[:, :, None] / scale[:, None, :] + ridge[None], scale


def whiten(matrices, rows) -> Any:
    """L^-1 rows with L L' = matrix, (lanes, n, n) and (lanes, n, k)."""
    if namespace(matrices, rows) is np:
        return np.linalg.solve(np.linalg.cholesky(matrices), rows)
    # one at a time: batches of LAPACK calls in one program have hung on CPUs
    return jax.lax.map(lambda one: jax.scipy.linalg.solve_triangular(jnp.linalg.cholesky(one[0]), one[1], lower=True), (matrices, rows))


def whitened(curve: Curve, used, theta, full: bool, extra: Any = None) -> tuple[Any, Any]:
    """A and v of unit covariance with C (its diagonal unless `full`) at theta: (lanes, clusters, p + 1) and (lanes, clusters)."""
    xp = namespace(curve.v, used, theta)
    rows = xp.concatenate([curve.columns, curve.v[:, None]], axis=1)
    rows = xp.where(used[:, :, None], rows[None], 0.0)
    if full:
        matrices, scale = correlation(curve, used, theta, extra)
        rows = whiten(matrices, rows / scale[:, :, None])
    else:
        variance = xp.diagonal(curve.covariance(theta), axis1=1, axis2=2)
        # without coefficients relative errors are taken as equal
        rows = rows / xp.sqrt(xp.where(variance > 0.0, variance, curve.v[None, :] ** 2))[:, :, None]
    return rows[:, :, :-1], rows[:, :, -1]


def least_squares(white: tuple[Any, Any], lanes: Lanes, start) -> tuple[Any, Any]:
    """Coefficients of least chi-square of whitened columns and variances, and that chi-square."""
    rows, target = white
    xp = namespace(target, start)
    free = xp.where(lanes.free[:, None, :], rows, 0.0)
    base = xp.sum(rows * lanes.held[:, None, :], axis=-1)
    # a coefficient that is not free has no column, and must lie on a bound
    lower = xp.where(lanes.free, np.append(np.zeros(rows.shape[-1] - 1), -np.inf)[None, :].astype(rows.dtype), 0.0)
    begun = xp.where(lanes.free, start, 0.0)
    found = minimise(free, target, lanes.used.astype(target.dtype), begun, base=base, lower=lower, linear=True)
    return xp.where(lanes.free, found.theta, lanes.held), 2.0 * found.cost


def fixed_point(curve: Curve, lanes: Lanes, start, full: bool, enough: float = SETTLED, most: int = _MOST) -> tuple[Any, Any]:
    """Iterate until a step changes the modelled variance by no more than `enough` of it; theta and the last change, per lane.

    Left alone the steps may swing, or go on at two thirds of the length before. Each is lengthened or shortened by what the last
    two tell (Irons and Tuck, Int. J. Numer. Meth. Eng. 1, 1969): a dozen steps do where halving every step took forty.
    """
    xp = namespace(curve.v, start)
    lower = np.append(np.zeros(start.shape[1] - 1), -np.inf)[None, :]

    def step(used, free, held, theta):
        return least_squares(whitened(curve, used, theta, full), Lanes(used, free, held), theta)[0]

    def body(state):
        theta, before, length, largest, k = state
        active = largest > enough
        new = some(active, step, theta, lanes.used, lanes.free, lanes.held, theta)
        reached = new @ curve.columns.T
        change = xp.where(lanes.used, (reached - theta @ curve.columns.T) / xp.where(reached > 0.0, reached, 1.0), 0.0)
        bend = before - change
        turn = xp.sum(bend**2, axis=1)
        following = length * xp.sum(before * bend, axis=1) / xp.where(turn > 0.0, turn, 1.0)
        following = xp.where((k > 1) & (following > 0.0), xp.clip(following, 0.3, 4.0), 1.0)
        size = xp.max(xp.abs(change), axis=1)
        # the last step is a whole one: what goes to zero is zero
        longer = xp.where((size > enough)[:, None], xp.maximum(theta + following[:, None] * (new - theta), lower.astype(theta.dtype)), new)
        kept = active[:, None]
        return (
            xp.where(kept, longer, theta), xp.where(kept, change, before), xp.where(active, following, length),
            xp.where(active, size, largest), k + 1,
        )  # fmt: skip

    ones = xp.ones(len(start), dtype=curve.v.dtype)
    begun = (start, xp.zeros_like(lanes.used, dtype=curve.v.dtype), ones, np.inf * ones, 0)
    theta, _, _, change, _ = iterate(lambda state: xp.any(state[3] > enough) & (state[4] < most), body, begun)
    return theta, change


def estimate(curve: Curve, lanes: Lanes, full: bool) -> tuple[Any, Any]:
    """The fixed point from nothing, `full` weights by way of independent ones; differentiable in a trace.

    The iteration carries no derivative. One Newton step for theta = step(theta) from its end does, that of the implicit
    function theorem.
    """
    traced = namespace(curve, lanes) is jnp
    still = jax.lax.stop_gradient((curve, lanes)) if traced else (curve, lanes)
    start = jnp.zeros_like(lanes.held) if traced else np.zeros_like(lanes.held)
    if full:
        start, _ = fixed_point(*still, start, False, GUESSED)
    theta, change = fixed_point(*still, start, full)
    if not traced:
        return theta, change
    each = [_with_derivative(curve, jax.tree.map(lambda leaf: leaf[k], lanes), theta[k], full) for k in range(len(theta))]  # noqa: B023
    return jnp.stack(each), change


def _with_derivative(curve: Curve, lane: Lanes, theta, full: bool) -> Any:
    def step(at):
        one = jax.tree.map(lambda leaf: leaf[None], lane)
        return least_squares(whitened(curve, one.used, at[None], full), one, at[None])[0][0]

    new = step(theta)
    slope = jax.lax.stop_gradient(jax.jacfwd(step)(theta))
    size = jnp.max(jnp.abs(curve.columns), axis=0)  # in units of these the coefficients are of similar size
    apart = jnp.eye(len(theta), dtype=theta.dtype) - slope * size[:, None] / size[None, :]
    move = jnp.linalg.solve(apart, (new - theta) * size) / size
    # the value is the fixed point's, whatever the Newton step
    return theta + move - jax.lax.stop_gradient(move)
