"""`residuals`: what the rests and turns of a recording say about a model of its sensors; `Poses`, `Turns` and `Weighted` hold the data."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._precision import array_module, host_float64, is_traced
from .._types import Array
from ._integrate import attitude, closed_form
from ._model import EARTH_RATE, Imu, inverse


class Poses(eqx.Module):
    """Mean readings of k poses held still. A pose with an infinite `sigma` is left out: padding, so that programs keep their shapes.

    Attributes
    ----------
    accel : (k, 3) readings of the accelerometer.
    sigma : (k,) standard deviation of the norm of the corrected specific force, m/s^2.
    gyro : (k, 3) readings of the gyroscope; None without one.
    gyro_sigma : (k, 3) standard deviation of `gyro`, in readings.
    time : (k,) s, for a bias that drifts; from the middle of the record, where the bias is to hold.
    short : (k,) m/s^2 by which the mean of a force that turned during the pose is shorter than the force; None for not at all.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Poses, simulate_positions
    >>> poses = Poses(simulate_positions(), np.full(6, 1e-3))
    """

    accel: Any
    sigma: Any
    gyro: Any = None
    gyro_sigma: Any = None
    time: Any = None
    short: Any = None


class Turns(eqx.Module):
    """Samples of the k - 1 turns between successive poses, from the last sample of a pose to the first of the next one.

    Turns that take fewer than n steps repeat their last sample with steps of length zero.

    Attributes
    ----------
    gyro, accel : (k - 1, n + 1, 3) readings.
    dt : (k - 1, n) steps, s.
    sigma : (k - 1,) standard deviation, rad, of what the gyroscope adds to each component of the vertical after the turn, such as
        N sqrt(duration); infinite for a turn that is left out.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Turns
    >>> turns = Turns(gyro=np.zeros((1, 50, 3)), accel=np.zeros((1, 50, 3)), dt=np.full((1, 49), 0.02), sigma=np.array([1e-3]))
    >>> turns.gyro.shape
    (1, 50, 3)
    """

    gyro: Any
    accel: Any
    dt: Any
    sigma: Any


class Weighted(eqx.Module):
    """Poses and turns as `residuals` takes them; `weighted` makes it.

    Attributes
    ----------
    poses, turns : `Poses` and `Turns`; turns None for an accelerometer alone.
    gravity : m/s^2.
    latitude : rad, where the Earth's rate is accounted for; else None.
    tangent : (k - 1, 3, 2) plane across the vertical after each turn.
    whiten : (2k - 2, 2k - 2) inverse Cholesky factor of the covariance of the turns' residuals.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Imu, Poses, Triad, residuals, simulate_positions, weighted
    >>> model = Imu(Triad(np.eye(3), np.zeros(3)))
    >>> data = weighted(model, Poses(simulate_positions(), np.full(6, 0.01)), gravity=9.81)
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
    """Residuals in physical units: norm (k,) m/s^2, turned (k - 1, 3) rad, rest (k, 3) readings; and vertical (k, 3) of each pose,
    rotation (k - 1, 3, 3) from the axes after a turn to those before it.
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
    """Rotation of every turn, from the corrected rates."""
    accel, gyro = model.accel, model.gyro
    time = jnp.zeros_like(turns.sigma) if model.drift is None else poses.time[:-1]
    if not model.plain:
        readings = turns.gyro if model.drift is None else turns.gyro - (time[:, None] * model.drift[None, :])[:, None, :]
        force = accel.correct(turns.accel.reshape(-1, 3))
        rate = gyro.correct(readings.reshape(-1, 3), force).reshape(readings.shape)
        return attitude(jnp.eye(3, dtype=rate.dtype), rate, turns.dt)
    # linear in the readings: the derivative of all turns then needs their samples once, not once for each parameter
    matrix = inverse(gyro.matrix)
    force = matrix @ gyro.g_sensitivity @ inverse(accel.matrix)
    one = jnp.ones_like(turns.gyro[..., :1])
    parts, columns = [matrix, -force, (force @ accel.bias - matrix @ gyro.bias)[:, None]], [turns.gyro, turns.accel, one]
    if model.drift is not None:
        parts, columns = [*parts, -(matrix @ model.drift)[:, None]], [*columns, one * time[:, None, None]]
    return attitude(jnp.concatenate(parts, axis=1), jnp.concatenate(columns, axis=-1), turns.dt)


def _norths(north: Array, vertical: Array, rotation: Array, sigma: Array) -> Array:
    """Horizontal vector of the Earth's rate over its size in the axes of every pose, from that of the first and the turns."""
    first = vertical[0]
    # any axis that is far from the vertical gives a horizontal pair
    aside = jnp.where(jnp.abs(first) == jnp.min(jnp.abs(first)), 1.0, 0.0).astype(first.dtype)
    right = _unit(jnp.cross(first, aside))
    start = north[0] * right + north[1] * jnp.cross(first, right)
    kept = jnp.where(jnp.isfinite(sigma)[:, None, None], rotation, jnp.eye(3, dtype=rotation.dtype)[None])
    rest = jax.lax.scan(lambda north, c: (north @ c, north @ c), start, kept)[1]
    return jnp.concatenate([start[None, :], rest])


def warm_up(time: Any, known: Any) -> Any:
    """What is left of a warm-up at a time, one at the first and exp(-4) at the last of the poses that are `known`."""
    xp = array_module(time)
    first, last = xp.min(xp.where(known, time, xp.inf)), xp.max(xp.where(known, time, -xp.inf))
    return xp.exp(-4 * (time - first) / (last - first))


def _settled(model: Imu, poses: Poses) -> Array:
    """Readings of the accelerometer without what its bias wanders during the recording."""
    accel = poses.accel
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
        # against the stars the vertical of a resting table turns with the Earth
        still = closed_form(earth[:-1], earth[:-1], jnp.sum(turns.dt, axis=1, keepdims=True)).rotation
        moved = jnp.einsum("sij,sj->si", still, moved)
    turned = jnp.einsum("sji,sj->si", rotation, moved) - vertical[1:]
    rest = poses.gyro - model.gyro.measure(earth, force)
    if model.drift is not None:
        rest = rest - poses.time[:, None] * model.drift[None, :]
    # two unit vectors across each vertical after a turn, from the axis of the sensor that is farthest from it
    aside = jnp.eye(3, dtype=vertical.dtype)[jnp.argmin(jnp.abs(vertical[1:]), axis=1)]
    right = _unit(jnp.cross(vertical[1:], aside))
    return Pieces(norm, vertical, turned, rest, rotation, jnp.stack([right, jnp.cross(vertical[1:], right)], axis=2))


@host_float64
def residuals(model: Imu, data: Weighted) -> Array:
    r"""Residuals of a model in units of their standard deviation, which `estimate` minimises.

    .. math:: \frac{g - |f_k|}{\sigma_k},\qquad L^{-1} T_{k+1}^T (R_k^T u_k - u_{k+1}),\qquad
              \frac{\bar y_k - b_g - G f_k}{\sigma_{g,k}},\qquad f_k = D_a (\bar a_k - b_a),\ u_k = f_k / |f_k|

    for the norms, the turns (R integrated from the rates, T the plane across the vertical, L the factor of the covariance, in which
    neighbours share the error of a vertical) and the still rates.

    Parameters
    ----------
    model : `Imu`; its sensors may be subclasses of `Triad`.
    data : `Weighted`, from `weighted`.

    Returns
    -------
    (k,) for an accelerometer alone; with a gyroscope (k + 2 (k - 1) + 3 k,), and two more for the heading where there is a latitude. The
    function is pure and runs under jit, vmap and grad.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Imu, Poses, Triad, residuals, simulate_positions, weighted
    >>> model = Imu(Triad(np.eye(3), np.zeros(3)))
    >>> readings = simulate_positions(Triad(np.eye(3), np.zeros(3)))
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
        parts.append(model.north * 2.0**0.5)  # the heading is a unit vector
    return jnp.concatenate(parts)


@filter_jit
def whitening(sigma: Array, turn: Array, gravity: Array, tangent: Array, rotation: Array) -> Array:
    """Inverse Cholesky factor (2s, 2s) of the covariance of the turns' residuals, zero for turns that are left out.

    The vertical of a pose, with `sigma`, closes one turn and opens the next: neighbours share its error.
    """
    count, valid, known = len(turn), jnp.isfinite(turn), jnp.isfinite(sigma)
    # rows left out get a variance of one; the double where keeps infinities from the derivative
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
def weighted(model: Imu, poses: Poses, turns: Turns | None = None, *, gravity: Any, latitude: Any = None) -> Weighted:
    """Poses and turns with the weights of their residuals near a model.

    Parameters
    ----------
    model : `Imu`, at which the covariance of the turns' residuals is linearised.
    poses, turns : `Poses` and `Turns`; without turns the accelerometer alone.
    gravity : m/s^2.
    latitude : rad, to account for the Earth's rate; None leaves it out.

    Returns
    -------
    Weighted

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Imu, Poses, Triad, simulate_positions, weighted
    >>> model = Imu(Triad(np.eye(3), np.zeros(3)))
    >>> weighted(model, Poses(simulate_positions(), np.full(6, 0.01)), gravity=9.81).turns is None
    True
    """
    return reweighted(*arrays((model, Weighted(poses, turns, gravity, latitude))))


def arrays(tree: Any) -> Any:
    """The tree with every number as a JAX array, so that other numbers need no other program."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf) if isinstance(leaf, float) or hasattr(leaf, "dtype") else leaf, tree)


def reweighted(model: Imu, data: Weighted, found: Pieces | None = None) -> Weighted:
    """The same data with the covariance of the turns at a model, whose pieces may be at hand. The tangents stay once they are there."""
    if data.turns is None:
        return data
    found = pieces(model, data) if found is None else found
    tangent = found.tangent if data.tangent is None else data.tangent
    whiten = whitening(*arrays((data.poses.sigma, data.turns.sigma, data.gravity, tangent, found.rotation)))
    return Weighted(data.poses, data.turns, data.gravity, data.latitude, tangent, whiten)


def pieces(model: Imu, data: Weighted) -> Pieces:
    """Residuals of norms, turns and still rates before they are weighted; arrays of NumPy outside of a trace."""
    found = _pieces(*arrays((model, data.poses, data.turns, data.gravity, data.latitude)))
    return found if is_traced(found) else jax.tree.map(np.asarray, found)
