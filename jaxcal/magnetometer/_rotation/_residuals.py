"""Residuals of a second sensor, traced: for the rotation alone, and for rotation and ellipsoid together.

In the joint fit, noise of a reading across the surface enters the distance, and noise along it the second sensor's residual: to first
order they are independent. Both are lengths in the space of the readings. Angles of the corrected field would be smaller on a larger
ellipsoid, and the fit would drift towards one.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from ..._rotation import exponential, matrix
from ..._types import Any, Array
from .._ellipsoid._distance import mean_curvature, signed_distance
from .._ellipsoid._kinds import basis_of, upper_and_centre
from .._field import heading

#: slices of the parameters: U by rows, centre, rotation vector; then the bias of the rates and the delay, or the sine
CENTRE, TURN, EXTRA, DELAY = slice(6, 9), slice(9, 12), slice(12, None), 15


def turn(rho: Array) -> Array:
    """Rotation matrix exp([rho]x), (3, 3)."""
    return matrix(exponential(rho))


def dip_residuals(parameters: dict[str, Array], data: dict[str, Array]) -> Array:
    """Products y'Qf minus s: in a uniform field at rest, the angle between field and vertical is the same in all poses."""
    force = data["f"] @ (data["base"] @ turn(parameters["rho"])).T
    return data["weight"] * (jnp.sum(data["y"] * force, axis=1) - parameters["s"])


def heading_residuals(parameters: dict[str, Array], data: dict[str, Array]) -> Array:
    """Heading of the rotated field minus the known one, in rad, within half a turn."""
    found = heading(data["y"] @ (data["base"] @ turn(parameters["rho"])), data["f"])
    off = jnp.where(jnp.isfinite(found), found - data["angle"], 0.0)
    return data["weight"] * jnp.arctan2(jnp.sin(off), jnp.cos(off))


def _turned_back(body: Array, bias: Array, attitude: Array, slope: Array) -> tuple[Array, Array]:
    """Vectors after correcting the attitude for bias and delay (4,), to first order: in axes of the reading, and of its segment's first."""
    body = body - jnp.cross(jnp.einsum("nij,j->ni", slope, bias), body)
    return body, jnp.einsum("nij,nj->ni", attitude, body)


def turn_residuals(parameters: dict[str, Array], data: dict[str, Array]) -> Array:
    """Field in the axes of each segment's first reading, minus its mean: the field is constant there while the sensor turns."""
    member, weight, y = data["member"], data["weight"], data["y"] @ (data["base"] @ turn(parameters["rho"]))
    lag = jnp.concatenate([parameters["bias"], parameters["delay"][None]])
    still = weight[:, None] * _turned_back(y, lag, data["attitude"], data["slope"])[1]
    total, number = (jax.ops.segment_sum(x, member, num_segments=len(data["segments"])) for x in (still, weight))
    mean = total / jnp.maximum(number, 1)[:, None]
    return still - weight[:, None] * mean[member]


class Joint(eqx.Module):
    """Scaled readings of the magnetometer, beside the data of a second sensor.

    u : (n, 3) readings. weight, paired : (n,), zero for padding, and for readings without data of the second sensor. sigma : (2,) standard
    deviations of a reading across the surface, and of the second sensor. noise2 : as in `Readings`. base : (3, 3) rotation to start from.
    """

    u: Any
    weight: Any
    paired: Any
    sigma: Any
    noise2: Any
    base: Any


class JointTurns(Joint):
    """Readings beside attitudes from rates.

    sigma[1] is the standard deviation along the surface; `paired` is below one where the noise of the rates adds up.

    member : (n,) segment of a reading. attitude, slope : (n, 3, 3) and (n, 3, 4), from `attitudes_in_segments`. tangent : (n, 3, 2) along
    the surface. metric, inverse : (n, 3, 3) and (segments, 3, 3): weights of the mean field of a segment, and the inverse of their sum.
    """

    member: Any
    attitude: Any
    slope: Any
    tangent: Any
    metric: Any
    inverse: Any


class JointPoses(Joint):
    """Readings beside unit specific forces (n, 3); sigma[1] is the standard deviation of a direction of the force in rad."""

    force: Any


def _on_surface(parameters: Array, data: Any) -> tuple[Array, Array, Array, Array]:
    """U, directions of the nearest surface points to first order, the normals there, and the weighted distances over their sigma."""
    upper, centre = upper_and_centre(parameters[:9], jnp.asarray(basis_of("symmetric"), dtype=parameters.dtype))
    shape, z = upper.T @ upper, data.u - centre[None, :]
    distance = signed_distance(shape, z)
    normal = _unit(z @ shape)
    unit = _unit((z - distance[:, None] * normal) @ upper.T)
    levelled = distance - data.noise2 * mean_curvature(shape, z)
    return upper, unit, normal, data.weight * levelled / data.sigma[0]


def _unit(v: Array) -> Array:
    square = jnp.sum(v**2, axis=1, keepdims=True)
    return v / jnp.sqrt(jnp.where(square > 0, square, 1))


def joint_turn_residuals(parameters: Array, data: JointTurns) -> Array:
    """Distances, and offsets of the readings along the surface from the place where their segment's field, rotated back, puts them."""
    upper, unit, _, across = _on_surface(parameters, data)
    rotation = data.base @ turn(parameters[TURN])
    body, still = _turned_back(unit @ rotation, parameters[EXTRA], data.attitude, data.slope)
    total = jax.ops.segment_sum(jnp.einsum("nij,nj->ni", data.metric, still), data.member, num_segments=len(data.inverse))
    # the least-squares estimate with the weights of the start; their derivative has no effect to first order
    field = jnp.einsum("sij,sj->si", data.inverse, total)
    off = body - jnp.einsum("nji,nj->ni", data.attitude, field[data.member])
    along = jnp.einsum("nik,ni->nk", data.tangent, off @ rotation.T @ jnp.linalg.inv(upper).T)
    return jnp.concatenate([across, (data.paired[:, None] * along / data.sigma[1]).ravel()])


def joint_pose_residuals(parameters: Array, data: JointPoses) -> Array:
    """Distances, and products y'f minus the sine, divided by the standard deviation due to the noise of both sensors."""
    upper, unit, normal, across = _on_surface(parameters, data)
    rotation = data.base @ turn(parameters[TURN])
    force = data.force @ rotation.T
    product = jnp.sum(unit * force, axis=1)
    by_reading = force @ upper
    by_reading = by_reading - jnp.sum(by_reading * normal, axis=1)[:, None] * normal
    variance = data.sigma[0] ** 2 * jnp.sum(by_reading**2, axis=1) + data.sigma[1] ** 2 * (1 - product**2)
    # a force along the field gives no information, and neither does padding
    off = jnp.where(variance > 0, product - parameters[12], 0) / jnp.sqrt(jnp.where(variance > 0, variance, 1))
    return jnp.concatenate([across, data.paired * off])
