"""Find which axes of one sensor correspond to those of another, for sensors that are mounted in different directions."""

import itertools

import numpy as np

from .._errors import DataError

_SMOOTH, _THIN = 0.3, 0.1  # s, mean of readings, and step between those that are used
#: largest cost of other axes, over the cost of equal axes, and over that of vectors that do not rotate
_CLEAR, _LEAST = 0.5, 0.6


def axes_of(vectors: np.ndarray, rates: np.ndarray, rate: float, names: tuple[str, str]) -> np.ndarray:
    """(3, 3) matrix Q, a permutation of axes with signs, that rotates `rates` to the axes of the `vectors`.

    A vector v that is constant in the world, such as gravity or the field, changes by v' = -(Q w) x v at the rate w. Q is the identity
    unless another matrix explains the changes far better.
    """
    size = max(round(_SMOOTH * rate), 1)
    v, w = (np.stack([np.convolve(x, np.ones(size) / size, mode="valid") for x in y.T], axis=1) for y in (vectors, rates))
    some = slice(None, None, max(round(_THIN * rate), 1))
    change = np.gradient(v, axis=0)[some] * rate
    v, w = v[some], (w - np.median(w, axis=0))[some]
    matrices = [
        np.eye(3)[list(order)] * sign for order in itertools.permutations(range(3)) for sign in itertools.product((1.0, -1.0), repeat=3)
    ]
    # the identity comes first
    cost = np.array([np.sum((change + np.cross(w @ matrix.T, v)) ** 2) for matrix in matrices])
    best = int(np.argmin(cost))
    if not cost[best] < min(_CLEAR * cost[0], _LEAST * np.sum(change**2)):
        return matrices[0]
    if np.linalg.det(matrices[best]) < 0:
        raise DataError(
            f"The axes of the {names[0]} are mirrored against those of the {names[1]}: {named(matrices[best].T, names[1])}. Every sensor "
            "needs right-handed axes, and rates are positive counterclockwise: change the signs or the order of its axes."
        )
    return matrices[best]


def named(matrix: np.ndarray, other: str) -> str:
    """A matrix that rotates vectors from the axes of the `other` sensor to those of a sensor, in words, for messages."""
    order = np.argmax(np.abs(matrix), axis=1)
    words = ["-"[: int(matrix[row, column] < 0)] + "xyz"[column] for row, column in enumerate(order)]
    return f"its x, y, z are {', '.join(words)} of the {other}"
