"""Where the gyroscope's fit starts when its scale is not known, and what its axes and unit would have to be when it fails."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np

from .._rotation import conjugate, rotate
from ._integrate import attitude
from ._turns import Segments

_SCALES = 80
_RADIANS = {"rad/s": 1.0, "deg/s": np.pi / 180}


@jax.jit
def _costs(matrices, bias, vertical, segments):
    def one(matrix):
        rest = segments.gyro - jnp.broadcast_to(bias, segments.gyro.shape)
        q = attitude(matrix, rest, segments.dt)
        r = rotate(conjugate(q), vertical[segments.first]) - vertical[segments.second]
        return jnp.sum(segments.weight[:, None] * r**2) / jnp.sum(segments.weight)

    return jax.lax.map(one, matrices)


def turn_costs(matrices: np.ndarray, bias: np.ndarray, vertical: np.ndarray, segments: Segments) -> np.ndarray:
    """Mean square of the turns' residuals for each of a few matrices from readings to rad/s."""
    given = jax.tree.map(jnp.asarray, (matrices, bias, vertical, segments))
    return np.asarray(_costs(*given))


def scanned_scale(bias: np.ndarray, vertical: np.ndarray, segments: Segments) -> float:
    """Scale (rad/s per reading) at which the turns fit best, of a grid from slow turns to quick ones."""
    valid = segments.weight > 0
    fast = float(np.quantile(np.linalg.norm(segments.gyro[valid] - bias, axis=2), 0.9))
    grid = np.geomspace(0.1, 10.0, _SCALES) / fast
    best = grid[np.argmin(turn_costs(grid[:, None, None] * np.eye(3), bias, vertical, segments))]
    finer = best * np.geomspace(0.95, 1.05, _SCALES)
    return float(finer[np.argmin(turn_costs(finer[:, None, None] * np.eye(3), bias, vertical, segments))])


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


def explanation(bias: np.ndarray, vertical: np.ndarray, segments: Segments, scale: float) -> str | None:
    """Another unit or another order of the gyroscope's axes that would fit at least ten times better than what was taken."""
    tried = [(unit, factor, turn) for unit, factor in _RADIANS.items() for turn in permutations()]
    matrices = np.array([scale * factor * turn for _, factor, turn in tried])
    costs = turn_costs(matrices, bias, vertical, segments)
    here = float(turn_costs(np.tile(scale * np.eye(3), (len(tried), 1, 1)), bias, vertical, segments)[0])
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
