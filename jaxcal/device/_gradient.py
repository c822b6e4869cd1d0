"""Derivatives of fitted parameters by the readings: the implicit function theorem at the solution."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._types import AnyArray
from ._normal import inertial
from ._solve import Record, Solution, whitened
from ._windows import Windows, windows


def gradients(found: Solution, record: Record, jacobian: np.ndarray, slope: np.ndarray, strength: float) -> list[dict[str, AnyArray]]:
    """For each row of `slope` (q, p), which are functions of the free parameters: sensor -> (n, 3) its derivative by the readings.

    The parameters solve J'r = 0, where J holds the way's derivative. So a change dr of the residuals moves them by -(J'J)^-1 J' dr.
    Terms in the size of the residuals are left out, as Gauss and Newton do; they were 0.1 to 8 % in a short
    recording. Noise, weights, and the hand's reach and speed stay as they were found.
    """
    model, back = found.model, found.back
    whiten = whitened(inertial(model, record.windows(found.vector, back)), found.noise, record.time, record.broken)
    weight = found.weight / np.reshape(found.noise.mag, (-1, 1))
    turn = found.way.rotation
    delays = float(model.gyro_delay), float(model.mag_delay)
    rotation, tilted = jnp.asarray(turn[:-1]), jnp.asarray(np.swapaxes(turn[:-1], 1, 2) @ turn[1:])

    def left(accel: Any, gyro: Any, mag: Any) -> tuple[Any, Any]:
        made = windows(record.grid, accel, gyro, mag, *delays, back)
        return jax.vmap(lambda w, r, both: _window(w, r, both, model))(made, rotation, tilted)

    readings = [jnp.asarray(x) for x in (record.accel, record.gyro, record.mag)]
    _, back_of = jax.vjp(left, *readings)
    back_of = jax.jit(back_of)
    out: list[dict[str, AnyArray]] = []
    inverse = np.linalg.inv(found.eliminated.information)
    size = {"accel": 1.0, "gyro": 1.0, "mag": 1 / strength}
    for row in slope:
        felt = -jacobian[:, : 9 + 3 * weight.shape[1]] @ (inverse @ row)
        field = felt[:, 9:].reshape(*weight.shape, 3) * weight[..., None]
        by = back_of((jnp.asarray(np.einsum("kab,ka->kb", whiten, felt[:, :9])), jnp.asarray(field)))
        out.append({name: np.asarray(value) * size[name] for name, value in zip(size, by, strict=True)})
    return out


def _window(w: Windows, begin: Any, tilted: Any, model: Any) -> tuple[Any, Any]:
    """Residuals of one window, up to terms that no reading enters: rotation, velocity and place (9,), and field (m, 3)."""
    gyro, accel = jnp.linalg.inv(jnp.asarray(model.gyro.matrix)), jnp.linalg.inv(jnp.asarray(model.accel.matrix))
    bias, arm, h = jnp.asarray(model.gyro.bias)[None], jnp.asarray(model.arm), w.step
    steps = w.turn.shape[0]
    rate, force = (w.rate - bias) @ gyro.T, (w.force - jnp.asarray(model.accel.bias)[None]) @ accel.T
    small = (w.turn - h * bias) @ gyro.T + h**2 / 12 * jnp.cross(rate[:-1], rate[1:])
    turns = [jnp.eye(3)]
    by = jax.vmap(_turn)(small)
    for i in range(steps):
        turns.append(turns[-1] @ by[i])
    rotation = jnp.stack(turns)
    pushed = jnp.einsum("iab,ib->ia", rotation, force)
    half = jnp.full(steps + 1, 1.0).at[jnp.array([0, steps])].set(0.5) * h
    twice = h**2 * (steps - jnp.arange(steps + 1.0)).at[0].set((2 * steps - 1) / 4).at[steps].set(0.25)
    time = steps * h
    swept = jnp.cross(rate[0], arm), jnp.cross(rate[-1], arm)
    over = rotation[-1].T @ tilted
    turned = jnp.stack([over[2, 1] - over[1, 2], over[0, 2] - over[2, 0], over[1, 0] - over[0, 1]]) / 2
    speed = tilted @ swept[1] - swept[0] - half @ pushed
    place = -time * swept[0] - twice @ pushed
    part = (w.field_turn - w.field_time[:, None] * bias) @ gyro.T
    to_reading = jnp.einsum("iab,ibc->iac", rotation[:-1], jax.vmap(_turn)(part))
    seen = jnp.einsum("iba,b->ia", to_reading, begin.T @ jnp.asarray(model.world_field))
    return jnp.concatenate([turned, speed, place]), seen @ jnp.asarray(model.magnetometer.soft_iron).T - w.field


def _turn(v: Any) -> Any:
    """Rotation by a small vector, to fourth order."""
    cross = jnp.cross(jnp.eye(3), v[None] * jnp.ones((3, 1)))
    square = cross @ cross
    return jnp.eye(3) + cross + square / 2 + square @ cross / 6 + square @ square / 24
