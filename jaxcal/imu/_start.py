"""Initial guess of scales that are not known, and the unit or axes that would explain a failed fit (host, NumPy)."""

import itertools

import equinox as eqx
import numpy as np
from scipy.spatial.transform import Rotation

from ._residuals import Turns
from ._triad import Triad

_SCALES = 80
_STEPS = 64
_RADIANS = {"rad/s": 1.0, "deg/s": np.pi / 180}


def nominal_start(model: Triad, mean: np.ndarray, gravity: float) -> Triad:
    """The model with scale and bias from the extremes of the means, without misalignment, for an accelerometer of unknown unit."""
    low, high = mean.min(axis=0), mean.max(axis=0)
    half = np.maximum((high - low) / 2, 1e-3 * np.abs(high - low).max())
    # the axis that was never vertical shows less than its range; the others tell what it would be
    half = np.maximum(half, 0.7 * half.max())
    return eqx.tree_at(lambda t: (t.matrix, t.bias), model, (np.diag(half / gravity), (low + high) / 2))


def turn_costs(matrices: np.ndarray, bias: np.ndarray, vertical: np.ndarray, turns: Turns) -> np.ndarray:
    """Mean square of the turns' residuals for each of a few matrices from readings to rad/s.

    Every turn is divided into 64 steps of constant rate, which is fine enough to compare guesses that differ by some per cent.
    """
    middle = (turns.gyro[:, :-1] + turns.gyro[:, 1:]) / 2 - bias
    steps = (middle * turns.dt[..., None]).reshape(len(middle), _STEPS, -1, 3).sum(axis=2)
    valid = np.isfinite(turns.sigma)
    costs = []
    for matrix in matrices:
        turn = Rotation.from_rotvec((steps @ matrix.T).reshape(-1, 3)).as_matrix().reshape(-1, _STEPS, 3, 3)
        while turn.shape[1] > 1:
            turn = turn[:, ::2] @ turn[:, 1::2]
        predicted = np.einsum("sji,sj->si", turn[:, 0], vertical[:-1])
        costs.append(np.mean(np.sum((predicted - vertical[1:])[valid] ** 2, axis=1)))
    return np.array(costs)


def scanned_scale(bias: np.ndarray, vertical: np.ndarray, turns: Turns) -> float:
    """Scale (rad/s per reading) at which the turns fit best, of a grid from slow turns to quick ones."""
    valid = np.isfinite(turns.sigma)
    fast = float(np.quantile(np.linalg.norm(turns.gyro[valid] - bias, axis=2), 0.9))
    grid = np.geomspace(0.1, 10.0, _SCALES) / fast
    return float(grid[np.argmin(turn_costs(grid[:, None, None] * np.eye(3), bias, vertical, turns))])


def permutations() -> list[np.ndarray]:
    """The 24 rotations that carry axes into axes."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) > 0:
                found.append(matrix)
    return found


def explanation(bias: np.ndarray, vertical: np.ndarray, turns: Turns, scale: float) -> str | None:
    """Another unit or another order of the gyroscope's axes that would fit at least ten times better than what was taken."""
    tried = [(unit, factor, turn) for unit, factor in _RADIANS.items() for turn in permutations()]
    matrices = np.array([scale * factor * turn for _, factor, turn in tried])
    costs = turn_costs(matrices, bias, vertical, turns)
    here = turn_costs(scale * np.eye(3)[None], bias, vertical, turns)[0]
    unit, _, turn = tried[int(np.argmin(costs))]
    if not costs.min() < 0.1 * here:
        return None
    rows = ["".join(f"{'+' if s > 0 else '-'}{a}" for s, a in zip(row, "xyz", strict=True) if s) for row in turn]
    said = []
    if unit != "rad/s":
        said.append(f"are in {unit} (read the log with units gyro={unit})")
    if not np.array_equal(turn, np.eye(3)):
        said.append(f"have other axes than the accelerometer (x, y, z should be {', '.join(rows)} of the gyroscope)")
    return f"The turns fit if the gyroscope's readings {' and '.join(said)}."
