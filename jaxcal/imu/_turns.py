"""The gyroscope from turns between still poses: the integrated rate must carry one vertical into the next."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._types import Array
from ._integrate import attitude
from ._norms import GyroParameters


class Segments(eqx.Module):
    """Samples of the turns between successive poses, in arrays of one shape.

    gyro, accel : (s, n + 1, 3) readings, the last one repeated as padding. dt : (s, n) steps in s, zero for padding; n is a power
    of two. first, second : (s,) poses before and after. duration : (s,) s. weight : (s,) zero for padding and for what is left out.
    """

    gyro: Any
    accel: Any
    dt: Any
    first: Any
    second: Any
    duration: Any
    weight: Any


class Turns(eqx.Module):
    """What imu_tk's fit of the gyroscope is given: segments, and the vertical (k, 3) of every pose, fixed."""

    segments: Segments
    vertical: Any


def power_of_two(n: int, least: int = 1) -> int:
    """Smallest power of two of at least n."""
    return max(1 << max(n - 1, 0).bit_length(), least)


def segments_of(time: np.ndarray, gyro: np.ndarray, accel: np.ndarray, start: np.ndarray, stop: np.ndarray, slots: int) -> Segments:
    """Segments from the last sample of each interval to the last before the next one."""
    first, last = stop[:-1] - 1, start[1:]  # samples first <= i < last
    count, longest = len(first), int((last - first).max())
    n = power_of_two(longest - 1, 64)
    index = np.minimum(first[:, None] + np.arange(n + 1)[None, :], last[:, None] - 1)
    index = np.concatenate([index, np.broadcast_to(index[:1, :1], (slots - count, n + 1))])
    poses = np.concatenate([np.arange(count), np.zeros(slots - count, dtype=int)])
    good = np.isfinite(gyro[index]).all(axis=(1, 2)) & np.isfinite(accel[index]).all(axis=(1, 2)) & (np.arange(slots) < count)
    return Segments(
        gyro=np.where(good[:, None, None], gyro[index], 0.0),
        accel=np.where(good[:, None, None], accel[index], 0.0),
        dt=np.diff(time[index], axis=1),
        first=poses,
        second=np.minimum(poses + 1, count),
        duration=time[index[:, -1]] - time[index[:, 0]],
        weight=good.astype(float),
    )


@jax.jit
def turn_residuals(parameters: GyroParameters, data: Turns) -> Array:
    """R' u_before - u_after, three components for every segment, by Runge-Kutta steps: the residual of imu_tk."""
    s, matrix = data.segments, parameters.correction()
    column = jnp.concatenate([s.gyro, jnp.ones_like(s.gyro[..., :1])], axis=-1)
    turn = attitude(jnp.concatenate([matrix, -(matrix @ parameters.bias)[:, None]], axis=1), column, s.dt, "runge_kutta")
    return s.weight[:, None] * (jnp.einsum("sji,sj->si", turn, data.vertical[s.first]) - data.vertical[s.second])
