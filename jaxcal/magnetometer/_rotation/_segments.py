"""Rotations from rotation vectors, traced; and integrated from rates, on the host."""

import itertools

import numpy as np
from scipy.spatial.transform import Rotation

from ..._rotation import exponential, matrix
from ..._types import Array

_LONGEST = 10.0  # s of a segment, for the bias of the rates is only first order in it


def turn(rho: Array) -> Array:
    """Rotation matrix exp([rho]x), (3, 3)."""
    return matrix(exponential(rho))


def rotation_vector(matrix: np.ndarray) -> np.ndarray:
    """Rotation vector of a rotation matrix."""
    return Rotation.from_matrix(matrix).as_rotvec()


def permutations() -> np.ndarray:
    """The 24 rotations that take axes to axes, (24, 3, 3), the unit matrix first."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.eye(3)[list(order)] * np.array(signs)[:, None]
            if np.linalg.det(matrix) > 0:
                found.append(matrix)
    return np.array(found)


def attitudes_in_segments(gyro: np.ndarray, rate: float, most: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Attitude of each sample relative to the first of its segment, from rates (n, 3).

    A segment ends where the angle travelled reaches `most` rad, after 10 s, or at a sample that is NaN, which belongs to none.

    Returns
    -------
    segment : (n,) number of its segment, -1 for none.
    attitude : (n, 3, 3) from the body axes of the sample to those of the segment's first.
    slope : (n, 3, 3) derivative of the rotation vector, in the axes of the sample, with respect to a bias of the rates.
    """
    n, good = len(gyro), np.asarray(np.isfinite(gyro).all(axis=1))
    step = np.where(good[1:, None] & good[:-1, None], (gyro[1:] + gyro[:-1]) / 2 / rate, 0.0)
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(step, axis=1))])
    broken = np.concatenate([[0], np.cumsum(~(good[1:] & good[:-1]))])
    label = broken * (int(travelled[-1] / most) + 1) + (travelled / most).astype(int)
    long = np.arange(1, n) % max(int(_LONGEST * rate), 2) == 0
    start = np.flatnonzero(np.concatenate([[True], (np.diff(label) != 0) | long]))
    segment = np.repeat(np.arange(len(start)), np.diff(np.append(start, n)))
    place = np.arange(n) - start[segment]
    small = Rotation.from_rotvec(step).as_matrix() if n > 1 else np.zeros((0, 3, 3))
    attitude, slope = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3, 3))
    # one step of all segments at a time
    order = np.argsort(place, kind="stable")
    for k in np.split(order, np.flatnonzero(np.diff(place[order])) + 1)[1:]:
        attitude[k] = attitude[k - 1] @ small[k - 1]
        back = np.swapaxes(small[k - 1], 1, 2)
        slope[k] = back @ slope[k - 1] + (np.eye(3) + back) / (2 * rate)
    return np.where(good, segment, -1), attitude, slope
