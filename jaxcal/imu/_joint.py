"""Both triads at once: norms, turns and still rates in one whitened residual."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from .._types import Array
from ._integrate import attitude, closed_form
from ._norms import AccelParameters, GyroParameters, corrected
from ._turns import Segments


class ImuParameters(eqx.Module):
    """Accelerometer, gyroscope, drift of the gyroscope's bias (readings per s), and the heading of the first pose (cos, sin)."""

    accel: AccelParameters
    gyro: GyroParameters
    drift: Any
    north: Any


class Poses(eqx.Module):
    """Means over the still intervals, padded.

    accel, gyro : (k, 3) readings. weight : (k,) zero for padding. time : (k,) s from the middle of the record.
    """

    accel: Any
    gyro: Any
    weight: Any
    time: Any


class Joint(eqx.Module):
    """What the joint fit is given.

    origin : (6,) readings of gyroscope and accelerometer that are taken off before they are multiplied (rounding).
    sigma_norm : (k,) of the norms, m/s^2. sigma_rest : (k, 3) of the still rates, readings.
    tangent : (s, 3, 2) plane across the vertical after each turn. whiten : (2s, 2s) inverse Cholesky factor of the turns' errors.
    time : (s,) middle of each turn, s. earth : (2,) vertical and horizontal part of the Earth's rate, rad/s.
    """

    poses: Poses
    segments: Segments
    origin: Any
    gravity: Any
    sigma_norm: Any
    sigma_rest: Any
    tangent: Any
    whiten: Any
    time: Any
    earth: Any
    sigma_north: Any


def _unit(f: Array) -> Array:
    return f / jnp.sqrt(jnp.sum(f**2, axis=-1, keepdims=True))


def rate_matrix(p: ImuParameters, origin: Array) -> Array:
    """(3, 8) that turns readings less their origin, one, and the time into angular rate: w = D (y - b - G f - drift t)."""
    matrix = p.gyro.correction()
    cross = matrix @ p.gyro.g_sensitivity
    force = cross @ p.accel.correction()
    constant = matrix @ (origin[:3] - p.gyro.bias) - force @ (origin[3:] - p.accel.bias)
    return jnp.concatenate([matrix, -force, constant[:, None], -(matrix @ p.drift)[:, None]], axis=1)


def attitudes(p: ImuParameters, data: Joint) -> Array:
    """Rotation of every segment from the axes after it to those before, (s, 3, 3)."""
    s = data.segments
    one = jnp.ones_like(s.gyro[..., :1])
    gyro, accel = s.gyro - jnp.broadcast_to(data.origin[:3], s.gyro.shape), s.accel - jnp.broadcast_to(data.origin[3:], s.accel.shape)
    column = jnp.concatenate([gyro, accel, one, one * data.time[:, None, None]], axis=-1)
    return attitude(rate_matrix(p, data.origin), column, s.dt)


def _norths(p: ImuParameters, vertical: Array, turn: Array, data: Joint) -> Array:
    """Horizontal vector of the Earth's rate over its size in the axes of every pose, from that of the first and the turns."""
    first = vertical[0]
    # any axis that is far from the vertical gives a horizontal pair
    aside = jnp.where(jnp.abs(first) == jnp.min(jnp.abs(first)), 1.0, 0.0).astype(first.dtype)
    right = _unit(jnp.cross(first, aside))
    start = p.north[0] * right + p.north[1] * jnp.cross(first, right)
    kept = jnp.where(data.segments.weight[:, None, None] > 0, turn, jnp.eye(3, dtype=turn.dtype))
    rest = jax.lax.scan(lambda north, c: (north @ c, north @ c), start, kept)[1]
    return jnp.concatenate([start[None, :], rest])[: len(vertical)]


def parts(p: ImuParameters, data: Joint) -> tuple[Array, Array, Array, Array]:
    """Residuals in physical units: norms (k,) m/s^2, turns (s, 3), still rates (k, 3) in readings; and the vertical (k, 3)."""
    force = corrected(p.accel, data.poses.accel)
    size = jnp.sqrt(jnp.sum(force**2, axis=-1))
    vertical = force / size[:, None]
    s = data.segments
    turn = attitudes(p, data)
    moved, still = vertical[s.first], force @ p.gyro.g_sensitivity.T + data.poses.time[:, None] * p.drift[None, :]
    if data.earth is not None:
        earth = data.earth[0] * vertical + data.earth[1] * _norths(p, vertical, turn, data)
        # against the stars the vertical of a resting table turns with the Earth
        rate = earth[s.first]
        moved = jnp.einsum("sij,sj->si", closed_form(rate, rate, s.duration[:, None]).rotation, moved)
        still = still + earth @ jnp.linalg.inv(p.gyro.correction()).T
    turned = jnp.einsum("sji,sj->si", turn, moved) - vertical[s.second]
    rest = data.poses.gyro - jnp.broadcast_to(p.gyro.bias, force.shape) - still
    weight = data.poses.weight
    return weight * (data.gravity - size), s.weight[:, None] * turned, weight[:, None] * rest, vertical


@jax.jit
def joint_residuals(p: ImuParameters, data: Joint) -> Array:
    """All of it, whitened: norms, turns across the vertical, still rates, and a prior on the heading of a unit vector."""
    norm, turned, rest, _ = parts(p, data)
    across = jnp.einsum("sij,si->sj", data.tangent, turned)
    return jnp.concatenate(
        [norm / data.sigma_norm, data.whiten @ across.reshape(-1), (rest / data.sigma_rest).reshape(-1), p.north / data.sigma_north]
    )
