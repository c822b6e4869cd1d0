"""What a second sensor says about the rotation that norms cannot see: residuals, traced."""

import equinox as eqx
import jax
import jax.numpy as jnp

from ..._types import Any, Array
from .._heading import heading
from ._segments import turn


class Poses(eqx.Module):
    """Paired unit vectors: corrected field y, specific force f (n, 3), weight (n,), and the rotation to start from."""

    y: Any
    f: Any
    weight: Any
    base: Any


class Known(eqx.Module):
    """Corrected field, specific force (n, 3), magnetic headings and weight (n,), and the rotation to start from."""

    y: Any
    f: Any
    angle: Any
    weight: Any
    base: Any


class Turns(eqx.Module):
    """Corrected field y (n, 3) beside attitudes from rates (see `attitudes_in_segments`).

    member : (n, ) segment of each reading. weight : (n,), zero for padding; the other fields (n, 3, 3), or (3, 3) for `base`.
    ones : (segments,) of ones, for their number.
    """

    y: Any
    attitude: Any
    slope: Any
    member: Any
    weight: Any
    base: Any
    ones: Any


def dip_residuals(parameters: dict[str, Array], data: Poses) -> Array:
    """Products y'Qf less s: in a uniform field at rest the angle between field and vertical is the same in all poses."""
    force = data.f @ (data.base @ turn(parameters["rho"])).T
    return data.weight * (jnp.sum(data.y * force, axis=1) - parameters["s"])


def heading_residuals(parameters: dict[str, Array], data: Known) -> Array:
    """Heading of the turned field less the known one, in rad, within half a turn."""
    found = heading(data.y @ (data.base @ turn(parameters["rho"])), data.f)
    off = jnp.where(jnp.isfinite(found), found - data.angle, 0.0)
    return data.weight * jnp.arctan2(jnp.sin(off), jnp.cos(off))


def turn_residuals(parameters: dict[str, Array], data: Turns) -> Array:
    """Field in the axes of each segment's first reading, less its mean there: it stands still while the sensor turns.

    That mean is the least-squares estimate of the segment's field, so the residuals are those of all readings, each used once.
    """
    rotation = data.base @ turn(parameters["rho"])
    shift = jnp.einsum("nij,j->ni", data.slope, parameters["bias"])
    # first order in the bias: over one segment it turns the attitude by little
    body = data.y @ rotation
    body = body - jnp.cross(shift, body)
    still = data.weight[:, None] * jnp.einsum("nij,nj->ni", data.attitude, body)
    count = len(data.ones)
    total = jax.ops.segment_sum(still, data.member, num_segments=count)
    number = jax.ops.segment_sum(data.weight, data.member, num_segments=count)
    mean = total / jnp.maximum(number, 1)[:, None]
    return still - data.weight[:, None] * mean[data.member]
