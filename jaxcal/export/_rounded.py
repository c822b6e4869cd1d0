"""The rotation behind a rounded one."""

import numpy as np
from scipy.optimize import linprog

from .._errors import DataError
from .._types import AnyArray

_DIGITS = 9


def exact_rotation(turn: AnyArray) -> AnyArray:
    """The rotation whose entries, rounded to nine digits, are those given; the nearest one where there is none such.

    Nine digits leave a rotation open by 5e-10, and the nearest one to them rounds to other digits about once in three entries. The
    errors are linear in the three angles of a small turn, so that the one with the smallest largest error is a linear programme.

    Raises
    ------
    DataError
        If the matrix is no rotation to four digits.
    """
    u, _, v = np.linalg.svd(turn)
    near = u @ v
    if np.linalg.det(near) < 0 or np.abs(near - turn).max() > 1e-4:
        raise DataError("R_IMUtoACC or R_IMUtoGYRO is no rotation")
    steps = np.stack([np.cross(np.eye(3)[k], near, axisb=0, axisc=0).ravel() for k in range(3)], axis=1)
    half = np.array([_half_digit(value) for value in turn.ravel()])[:, None]
    off = (turn - near).ravel()
    rows = np.vstack([np.hstack([steps, -half]), np.hstack([-steps, -half])])
    limits = np.concatenate([off, -off])
    scale = 5e-10
    found = linprog([0, 0, 0, 1.0], A_ub=np.hstack([rows[:, :3], rows[:, 3:] / scale]), b_ub=limits / scale, bounds=[(None, None)] * 4)
    if not found.success:
        return near
    angles = found.x[:3] * scale
    size = np.linalg.norm(angles)
    if size == 0:
        return near
    cross = np.cross(np.eye(3), angles / size)
    return (np.eye(3) + np.sin(size) * cross + (1 - np.cos(size)) * cross @ cross) @ near


def _half_digit(value: float) -> float:
    """Half a unit of the ninth digit of a number."""
    if abs(value) < 1e-13:
        return 1e-15  # written as an exact zero
    return 0.5 * 10.0 ** (np.ceil(np.log10(abs(value))) - _DIGITS)
