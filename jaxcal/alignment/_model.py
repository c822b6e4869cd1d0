"""The joint model: every reading of both sensors as a function of attitude, sensor errors and latitude."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._precision import is_traced
from .._types import Array
from ._frames import AXES, EARTH_RATE, angles_of, table_from_nav, turned, wrap
from ._positions import Readings, Sensor
from ._simulate import read, true_force, true_rate, walk_covariance

NAMES = (
    "phi", "theta", "psi", "b_a", "s_a", "b_g", "s_g", "ma_a_xy", "ma_a_xz", "ma_g_xy", "ma_g_xz", "b_a_rate", "b_g_rate", "latitude",
)  # fmt: skip
UNITS = ("rad", "rad", "rad", "m/s^2", "", "rad/s", "", "rad", "rad", "rad", "rad", "m/s^3", "rad/s^2", "rad")
INDEX = {name: i for i, name in enumerate(NAMES)}
COUNT = len(NAMES)
_SMALLEST_PAD = 16


class Table(eqx.Module):
    """Readings as arrays of one length, filled up with rows that count nothing, so that few programs serve all lists of positions.

    axes : (n, 3, 3). whiten_accel, whiten_gyro : (n,) one over the standard deviation, or (n, n) inverse Cholesky factor, of readings
    in units of gravity and of the Earth's rate; zero for rows that were not measured.
    """

    angle: Any
    axes: Any
    dwell: Any
    start: Any
    time: Any
    rate: Any
    acceleration: Any
    width: Any
    accel: Any
    gyro: Any
    has_accel: Any
    has_gyro: Any
    lever_arm: Any
    gravity: Any


class Whitening(eqx.Module):
    """What turns residuals of either sensor into those of unit variance."""

    accel: Any
    gyro: Any


class Rows(eqx.Module):
    """Data of the residuals.

    start : (14,) parameters to which the steps are added. matrix : C_TN there. rotate : whether the first three steps are a turn of
    the table in its own axes, which is regular at every attitude, and not changes of the three angles.
    prior, certainty : (14,) prior means and one over their standard deviations, zero where there is none.
    """

    table: Table
    whitening: Whitening
    start: Any
    matrix: Any
    rotate: Any
    prior: Any
    certainty: Any


def tabulate(readings: Readings, gravity: Any) -> Table:
    """Readings padded to a power of two."""
    xp = jnp if is_traced(readings, gravity) else np
    positions = readings.positions
    count = len(positions)
    size = max(_SMALLEST_PAD, 1 << (count - 1).bit_length())

    def pad(value: Any, fill: float = 0.0) -> Any:
        value = xp.asarray(value)
        return xp.concatenate([value, xp.full(size - count, fill, dtype=value.dtype)])

    kept = {}
    for name in ("accel", "gyro"):
        values = getattr(readings, name)
        values = xp.full(count, np.nan) if values is None else xp.asarray(values)
        kept[name] = pad(xp.where(xp.isfinite(values), values, 0))
        kept[f"has_{name}"] = pad(xp.isfinite(values).astype(values.dtype)) > 0
    axes = np.concatenate([positions.axes, np.broadcast_to(AXES["x"], (size - count, 3, 3))])
    end = xp.max(xp.asarray(positions.start) + xp.asarray(positions.dwell))
    return Table(
        angle=pad(positions.angle), axes=axes, dwell=pad(positions.dwell, 1.0),
        start=xp.concatenate([xp.asarray(positions.start), xp.broadcast_to(end, size - count)]),
        time=pad(positions.time), rate=pad(positions.rate), acceleration=pad(positions.acceleration), width=pad(positions.width),
        lever_arm=readings.lever_arm, gravity=gravity, **kept,
    )  # fmt: skip


def as_arrays(table: Table, dtype: Any) -> Table:
    """The same table in one floating type."""
    table = jax.tree.map(jnp.asarray, table)
    return jax.tree.map(lambda leaf: leaf if leaf.dtype == bool else jnp.asarray(leaf, dtype=dtype), table)


def whitening(table: Table, noise: Any, correlated: bool) -> Whitening:
    """From (N, K) of the accelerometer and of the gyro."""
    made = []
    for (white, walk), unit, kept in zip(noise, (table.gravity, EARTH_RATE), (table.has_accel, table.has_gyro), strict=True):
        if not correlated:
            made.append(jnp.where(kept, unit * jnp.sqrt(table.dwell) / white, 0))
            continue
        covariance = jnp.diag(white**2 / table.dwell) + walk**2 * walk_covariance(table.start, table.dwell)
        both = kept[:, None] & kept[None, :]
        covariance = jnp.where(both, covariance, jnp.diag(white**2 / table.dwell))
        factor = jnp.linalg.cholesky(covariance)
        inverse = jnp.linalg.solve(factor, jnp.eye(kept.size, dtype=factor.dtype))
        made.append(jnp.where(both, unit * inverse, 0))
    return Whitening(*made)


def predicted(values: Array, matrix: Array, table: Table) -> tuple[Array, Array]:
    """Readings of the accelerometer over gravity and of the gyro over the Earth's rate."""
    p = {name: values[i] for name, i in INDEX.items()}
    accel = Sensor(p["s_a"], jnp.stack([p["ma_a_xy"], p["ma_a_xz"]]), p["b_a"], p["b_a_rate"])
    gyro = Sensor(p["s_g"], jnp.stack([p["ma_g_xy"], p["ma_g_xz"]]), p["b_g"], p["b_g_rate"])
    axes, time = (jnp.asarray(value, dtype=values.dtype) for value in (table.axes, table.time))
    arm, gravity = (jnp.asarray(value, dtype=values.dtype) for value in (table.lever_arm, table.gravity))
    force = true_force(matrix, p["latitude"], table, arm, gravity)
    rate = true_rate(matrix, p["latitude"], table)
    return read(force, axes, accel, time) / gravity, read(rate, axes, gyro, time) / EARTH_RATE


def parameters_at(step: Array, rows: Rows) -> tuple[Array, Array]:
    """Parameters and C_TN after a step from the start."""
    values = rows.start + step
    by_angles = table_from_nav(values[0], values[1], values[2])
    rotation = jnp.where(rows.rotate, step[:3], 0)
    matrix = jnp.where(rows.rotate, turned(rows.matrix, rotation), by_angles)
    return values, matrix


def residuals(step: Array, rows: Rows) -> Array:
    """Whitened residuals of the accelerometer, of the gyro, and of the priors."""
    values, matrix = parameters_at(step, rows)
    accel, gyro = predicted(values, matrix, rows.table)
    table, by = rows.table, rows.whitening
    a = accel - jnp.where(table.has_accel, table.accel / table.gravity, 0)
    w = gyro - jnp.where(table.has_gyro, table.gyro / EARTH_RATE, 0)
    a, w = ((m * r if m.ndim == 1 else m @ r) for m, r in ((by.accel, a), (by.gyro, w)))
    change = values - rows.prior
    change = change.at[:3].set(wrap(change[:3]))
    return jnp.concatenate([a, w, rows.certainty * change])


def euler(step: Array, rows: Rows) -> Array:
    """Parameters after a step, the attitude as the three angles."""
    values, matrix = parameters_at(step, rows)
    return values.at[:3].set(jnp.where(rows.rotate, angles_of(matrix), wrap(values[:3])))
