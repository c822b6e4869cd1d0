"""Rotations integrated from rates."""

from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

#: rad and s in one segment: the error of rates with a slightly wrong scale grows with the angle, and their bias enters to first order only
_SEGMENT, _LONGEST = 2.0, 10.0


def delayed(gyro: np.ndarray, samples: float) -> np.ndarray:
    """Rates `samples` samples earlier, with linear interpolation; at the edge of a gap the rate of the sample itself."""
    if samples == 0:
        return gyro
    place = np.arange(len(gyro)) - samples
    first = np.clip(np.floor(place).astype(int), 0, max(len(gyro) - 2, 0))
    share = np.clip(place - first, 0.0, 1.0)[:, None]
    earlier = (1 - share) * gyro[first] + share * gyro[np.minimum(first + 1, len(gyro) - 1)]
    return np.where(np.isfinite(earlier) & np.isfinite(gyro), earlier, gyro)


def attitudes_in_segments(gyro: np.ndarray, rate: float, lag: Any = (0.0, 0.0, 0.0, 0.0)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Attitude of each reading relative to the first of its segment, from rates (n, 3) at the times of the samples.

    lag : bias (3,) in rad/s, and delay in s: a reading shows the field so long before the sample of the rates beside it.

    A segment ends when the angle travelled, bias and delay left in, reaches 2 rad, after 10 s, or at a NaN sample without one. Returns the
    segment number (n,), -1 for none; the attitude (n, 3, 3), from the body axes of the sample to those of the segment's first sample; and
    the derivative (n, 3, 4) of the rotation vector, in the axes of the sample, with respect to a bias of the rates and the delay.
    """
    n, good = len(gyro), np.asarray(np.isfinite(gyro).all(axis=1))
    both = good[1:, None] & good[:-1, None]
    moved = np.where(both, (gyro[1:] + gyro[:-1]) / 2 / rate, 0.0)
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(moved, axis=1))])
    gyro = delayed(gyro - np.asarray(lag[:3]), lag[3] * rate)
    step = np.where(both, (gyro[1:] + gyro[:-1]) / 2 / rate, 0.0)
    broken = np.concatenate([[0], np.cumsum(~(good[1:] & good[:-1]))])
    label = broken * (int(travelled[-1] / _SEGMENT) + 1) + (travelled / _SEGMENT).astype(int)
    long = np.arange(1, n) % max(int(_LONGEST * rate), 2) == 0
    start = np.flatnonzero(np.concatenate([[True], (np.diff(label) != 0) | long]))
    segment = np.repeat(np.arange(len(start)), np.diff(np.append(start, n)))
    place = np.arange(n) - start[segment]
    small = scipy.spatial.transform.Rotation.from_rotvec(step).as_matrix() if n > 1 else np.zeros((0, 3, 3))
    attitude, slope = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3, 3))
    # take one step in all segments at a time
    order = np.argsort(place, kind="stable")
    for k in np.split(order, np.flatnonzero(np.diff(place[order])) + 1)[1:]:
        attitude[k] = attitude[k - 1] @ small[k - 1]
        back = np.swapaxes(small[k - 1], 1, 2)
        slope[k] = back @ slope[k - 1] + (np.eye(3) + back) / (2 * rate)
    return np.where(good, segment, -1), attitude, np.concatenate([slope, np.where(good[:, None], gyro, 0.0)[:, :, None]], axis=2)
