"""`residuals`: residuals of a sensor model on the rests and turns of a recording; `Poses`, `Turns` and `Weighted` hold the data."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._precision import array_module, host_float64, is_traced
from .._types import AnyArray, Array, Held, Scalar
from ._integrate import attitude, closed_form
from ._model import EARTH_RATE, Imu, inverse


class Poses(eqx.Module):
    """Mean readings of k still poses. A pose with an infinite `sigma` is ignored; such padding keeps array shapes the same.

    Attributes
    ----------
    accel : (k, 3) readings of the accelerometer.
    sigma : (k,) standard deviation of the magnitude of the corrected specific force, m/s^2.
    gyro : (k, 3) readings of the gyroscope; None without a gyroscope.
    gyro_sigma : (k, 3) standard deviation of `gyro`, in readings.
    time : (k,) s from the time to which the bias refers, the middle of the record; used for a drifting bias.
    short : (k,) m/s^2 by which the mean vector is shorter than the force because the sensor rotated during the pose; None for zero.
    past : (k, 3) readings of the last 15 s, smoothed, minus the present ones; used for a creep.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Poses
    >>> poses = Poses(9.81 * np.concatenate([np.eye(3), -np.eye(3)]), np.full(6, 1e-3))
    """

    accel: Held
    sigma: Held
    gyro: Any = None
    gyro_sigma: Any = None
    time: Any = None
    short: Any = None
    past: Any = None


class Turns(eqx.Module):
    """Samples of the k - 1 turns (rotations between successive poses), from the last sample of a pose to the first of the next.

    A turn with fewer than n steps repeats its last sample with steps of length zero.

    Attributes
    ----------
    gyro, accel : (k - 1, n + 1, 3) readings.
    dt : (k - 1, n) steps, s.
    sigma : (k - 1,) standard deviation, rad, of the gyroscope's error in each component of the vertical after the turn, such as
        N sqrt(duration); infinite for a turn to ignore.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Turns
    >>> turns = Turns(gyro=np.zeros((1, 50, 3)), accel=np.zeros((1, 50, 3)), dt=np.full((1, 49), 0.02), sigma=np.array([1e-3]))
    >>> turns.gyro.shape
    (1, 50, 3)
    """

    gyro: Held
    accel: Held
    dt: Held
    sigma: Held


class Weighted(eqx.Module):
    """Poses and turns with their weights, the data for `residuals`; `weighted` makes it.

    Attributes
    ----------
    poses, turns : `Poses` and `Turns`; turns None for an accelerometer alone.
    gravity : m/s^2.
    latitude : rad, to account for the Earth's rate; None leaves it out.
    tangent : (k - 1, 3, 2) basis of the plane perpendicular to the vertical after each turn.
    whiten : (2k - 2, 2k - 2) inverse Cholesky factor of the covariance of the turns' residuals.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Imu, Poses, Triad, residuals, weighted
    >>> model = Imu(Triad(np.eye(3), np.zeros(3)))
    >>> data = weighted(model, Poses(9.81 * np.concatenate([np.eye(3), -np.eye(3)]), np.full(6, 0.01)), gravity=9.81)
    >>> residuals(model, data).shape, float(data.gravity)
    ((6,), 9.81)
    """

    poses: Poses
    turns: Turns | None
    gravity: Any
    latitude: Any = None
    tangent: Any = None
    whiten: Any = None


class Pieces(eqx.Module):
    """Residuals in physical units, before weighting: norm (k,) m/s^2, turned (k - 1, 3) rad, rest (k, 3) readings.

    vertical : (k, 3) of each pose. rotation : (k - 1, 3, 3) from the axes after a turn to those before it. tangent : see `Weighted`.
    """

    norm: Any
    vertical: Any
    turned: Any = None
    rest: Any = None
    rotation: Any = None
    tangent: Any = None


def _unit(f: Array) -> Array:
    return f / jnp.sqrt(jnp.sum(f**2, axis=-1, keepdims=True))


def _rotations(model: Imu, poses: Poses, turns: Turns) -> Array:
    """Rotation matrix of every turn, from the corrected rates."""
    accel, gyro = model.accel, model.gyro
    time = jnp.zeros_like(turns.sigma) if model.drift is None else poses.time[:-1]
    if not model.plain:
        readings = turns.gyro if model.drift is None else turns.gyro - (time[:, None] * model.drift[None, :])[:, None, :]
        force = accel.correct(turns.accel.reshape(-1, 3))
        rate = gyro.correct(readings.reshape(-1, 3), force).reshape(readings.shape)
        return attitude(jnp.eye(3, dtype=rate.dtype), rate, turns.dt)
    # a model linear in the readings needs one pass over the samples for the derivative, not one pass for each parameter
    matrix = inverse(gyro.matrix)
    force = matrix @ gyro.g_sensitivity @ inverse(accel.matrix)
    one = jnp.ones_like(turns.gyro[..., :1])
    parts, columns = [matrix, -force, (force @ accel.bias - matrix @ gyro.bias)[:, None]], [turns.gyro, turns.accel, one]
    if model.drift is not None:
        parts, columns = [*parts, -(matrix @ model.drift)[:, None]], [*columns, one * time[:, None, None]]
    return attitude(jnp.concatenate(parts, axis=1), jnp.concatenate(columns, axis=-1), turns.dt)


def _norths(north: Array, vertical: Array, rotation: Array, sigma: AnyArray) -> Array:
    """Horizontal unit vector of the Earth's rate in the axes of every pose: that of the first pose, carried on by the turns."""
    first = vertical[0]
    # the cross product with an axis far from the vertical gives a horizontal pair of vectors
    aside = jnp.where(jnp.abs(first) == jnp.min(jnp.abs(first)), 1.0, 0.0).astype(first.dtype)
    right = _unit(jnp.cross(first, aside))
    start = north[0] * right + north[1] * jnp.cross(first, right)
    kept = jnp.where(jnp.isfinite(sigma)[:, None, None], rotation, jnp.eye(3, dtype=rotation.dtype)[None])
    rest = jax.lax.scan(lambda north, c: (north @ c, north @ c), start, kept)[1]
    return jnp.concatenate([start[None, :], rest])


def warm_up(time: Any, known: Any) -> Any:
    """Remaining share of a warm-up at a time: one at the first and exp(-4) at the last of the poses that are `known`."""
    xp = array_module(time)
    first, last = xp.min(xp.where(known, time, xp.inf)), xp.max(xp.where(known, time, -xp.inf))
    return xp.exp(-4 * (time - first) / (last - first))


def _settled(model: Imu, poses: Poses) -> Any:
    """Readings of the accelerometer minus its creep, and the drift and warm-up of its bias."""
    accel = poses.accel
    if model.accel_creep is not None:
        accel = accel - poses.past * model.accel_creep[None, :]
    if model.accel_drift is not None:
        accel = accel - poses.time[:, None] * model.accel_drift[None, :]
    if model.accel_warm_up is not None:
        accel = accel - warm_up(poses.time, jnp.isfinite(poses.sigma))[:, None] * model.accel_warm_up[None, :]
    return accel


@filter_jit
def _pieces(model: Imu, poses: Poses, turns: Turns | None, gravity: Array, latitude: Array | None) -> Pieces:
    force = model.accel.correct(_settled(model, poses))
    size = jnp.sqrt(jnp.sum(force**2, axis=-1))
    vertical = force / size[:, None]
    norm = gravity - size if poses.short is None else gravity - size - poses.short
    if turns is None:
        return Pieces(norm, vertical)
    rotation = _rotations(model, poses, turns)
    moved, earth = vertical[:-1], jnp.zeros_like(force)
    if latitude is not None:
        north = _norths(model.north, vertical, rotation, turns.sigma)
        earth = EARTH_RATE * (jnp.sin(latitude) * vertical + jnp.cos(latitude) * north)
        # in an inertial frame, the vertical of a table at rest rotates with the Earth
        still = closed_form(earth[:-1], earth[:-1], jnp.sum(turns.dt, axis=1, keepdims=True)).rotation
        moved = jnp.einsum("sij,sj->si", still, moved)
    turned = jnp.einsum("sji,sj->si", rotation, moved) - vertical[1:]
    rest = poses.gyro - model.gyro.measure(earth, force)
    if model.drift is not None:
        rest = rest - poses.time[:, None] * model.drift[None, :]
    # two unit vectors perpendicular to each vertical after a turn, made from the sensor axis farthest from it
    aside = jnp.eye(3, dtype=vertical.dtype)[jnp.argmin(jnp.abs(vertical[1:]), axis=1)]
    right = _unit(jnp.cross(vertical[1:], aside))
    return Pieces(norm, vertical, turned, rest, rotation, jnp.stack([right, jnp.cross(vertical[1:], right)], axis=2))


@host_float64
def residuals(model: Imu, data: Weighted) -> Array:
    r"""Compute the residuals of a model in units of their standard deviation; `estimate` minimises them.

    .. math:: \frac{g - |f_k|}{\sigma_k},\qquad L^{-1} T_{k+1}^T (R_k^T u_k - u_{k+1}),\qquad
              \frac{\bar y_k - b_g - G f_k}{\sigma_{g,k}},\qquad f_k = D_a (\bar a_k - b_a),\ u_k = f_k / |f_k|

    They belong to the magnitudes at rest, the turns and the rates at rest. R is integrated from the rates, T is the plane perpendicular
    to the vertical, and L is the Cholesky factor of the covariance, in which neighbouring turns share the error of a vertical.

    Parameters
    ----------
    model : `Imu`; its sensors may be subclasses of `Triad`.
    data : `Weighted`, from `weighted`.

    Returns
    -------
    (k,) for an accelerometer alone; (k + 2 (k - 1) + 3 k,) with a gyroscope, and two more for the heading if a latitude is given. The
    function is pure and runs under jit, vmap and grad.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Imu, Poses, Triad, residuals, weighted
    >>> model = Imu(Triad(np.eye(3), np.zeros(3)))
    >>> readings = 9.81 * np.concatenate([np.eye(3), -np.eye(3)])
    >>> data = weighted(model, Poses(readings, np.full(6, 0.01)), gravity=9.80)
    >>> print(np.asarray(residuals(model, data)).round(3))
    [-1. -1. -1. -1. -1. -1.]

    References
    ----------
    D. Tedaldi, A. Pretto and E. Menegatti, ICRA 2014, equations (7) to (10), with the covariance of the verticals.
    """
    found = pieces(model, data)
    parts = [found.norm / data.poses.sigma]
    if data.turns is not None:
        across = jnp.einsum("sij,si->sj", data.tangent, found.turned)
        parts += [data.whiten @ across.reshape(-1), (found.rest / data.poses.gyro_sigma).reshape(-1)]
    if data.latitude is not None:
        parts.append(model.north * 2.0**0.5)  # keeps the heading's cosine and sine bounded: only their direction matters
    return jnp.concatenate(parts)


@filter_jit
def whitening(sigma: Array, turn: Array, gravity: Array, tangent: Array, rotation: Array) -> Array:
    """Inverse Cholesky factor (2s, 2s) of the covariance of the turns' residuals, zero for ignored turns.

    The vertical of a pose ends one turn and begins the next, so neighbouring turns share its error (from `sigma`).
    """
    count, valid, known = len(turn), jnp.isfinite(turn), jnp.isfinite(sigma)
    # ignored rows get a variance of one; the double `where` keeps infinities out of the derivative
    upright = (jnp.where(known, sigma, 0) / gravity) ** 2
    own = jnp.where(valid, jnp.where(valid, turn, 0) ** 2 + upright[:-1] + upright[1:], 1)
    shared = jnp.where(valid[:-1] & valid[1:], -upright[1:-1], 0)
    cross = shared[:, None, None] * jnp.einsum("sia,sij,sjb->sab", tangent[:-1], rotation[1:], tangent[1:])
    cross = jnp.concatenate([cross, jnp.zeros((1, 2, 2), dtype=own.dtype)])
    after = (jnp.eye(count, k=1, dtype=own.dtype)[:, None, :, None] * cross[:, :, None, :]).reshape(2 * count, 2 * count)
    factor = jnp.linalg.cholesky(jnp.diag(jnp.repeat(own, 2)) + after + after.T)
    inverted = jax.scipy.linalg.solve_triangular(factor, jnp.eye(2 * count, dtype=own.dtype), lower=True)
    keep = jnp.repeat(valid, 2)
    return jnp.where(keep[:, None] & keep[None, :], inverted, 0)


@host_float64
def weighted(
    model: Imu, poses: Poses, turns: Turns | None = None, *, gravity: Scalar | int, latitude: Scalar | int | None = None
) -> Weighted:
    """Combine poses and turns with the weights of their residuals, computed at a model.

    Parameters
    ----------
    model : `Imu` at which the covariance of the turns' residuals is linearised.
    poses, turns : `Poses` and `Turns`; without turns, the data of an accelerometer alone.
    gravity : m/s^2.
    latitude : rad, to account for the Earth's rate; None leaves it out.

    Returns
    -------
    Weighted

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Imu, Poses, Triad, weighted
    >>> model = Imu(Triad(np.eye(3), np.zeros(3)))
    >>> weighted(model, Poses(9.81 * np.concatenate([np.eye(3), -np.eye(3)]), np.full(6, 0.01)), gravity=9.81).turns is None
    True
    """
    return reweighted(*arrays((model, Weighted(poses, turns, gravity, latitude))))


def arrays(tree: Any) -> Any:
    """Convert every number of the tree to a JAX array, so that new numbers need no new compilation."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf) if isinstance(leaf, float) or hasattr(leaf, "dtype") else leaf, tree)


def reweighted(model: Imu, data: Weighted, found: Pieces | None = None) -> Weighted:
    """Recompute the covariance of the turns at a model; `found` are its pieces, if known. Existing tangents are kept."""
    if data.turns is None:
        return data
    found = pieces(model, data) if found is None else found
    tangent = found.tangent if data.tangent is None else data.tangent
    whiten = whitening(*arrays((data.poses.sigma, data.turns.sigma, data.gravity, tangent, found.rotation)))
    return Weighted(data.poses, data.turns, data.gravity, data.latitude, tangent, whiten)


def pieces(model: Imu, data: Weighted) -> Pieces:
    """Unweighted residuals of the magnitudes, turns and rates at rest; NumPy arrays unless JAX traces."""
    found = _pieces(*arrays((model, data.poses, data.turns, data.gravity, data.latitude)))
    return found if is_traced(found) else jax.tree.map(np.asarray, found)
