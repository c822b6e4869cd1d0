"""From the covariance of an ellipsoid to the heading error it causes, and which parameters the readings leave open (host, NumPy)."""

import functools
from typing import Any

import equinox as eqx
import numpy as np

from ..._precision import array_module
from .._attitude import body_field, rotation
from .._ellipsoid._algebraic import matrix_of, triangle
from .._ellipsoid._orthogonal import Found
from .._ellipsoid._penalty import BASES, natural_rows
from .._ellipsoid._shape import root, root_slopes
from .._ellipsoid._start import PLANAR, PLANAR_ROWS

WORDS = (
    "scale along x", "coupling of x and y", "scale along y", "coupling of x and z", "coupling of y and z", "scale along z",
    "hard iron along x", "hard iron along y", "hard iron along z",
)  # fmt: skip
_IN_PLANE = {
    0: "scale along the plane's first axis", 1: "coupling of the plane's axes", 2: "scale along the plane's second axis",
    6: "hard iron along the plane's first axis", 7: "hard iron along the plane's second axis",
}  # fmt: skip
_TILT = np.deg2rad(20.0)


@functools.lru_cache(maxsize=64)
def grids(inclination: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Attitudes and unit fields at level, and at 20 degrees of tilt in eight directions."""
    headings = np.arange(24) * np.pi / 12
    level = np.stack([headings, 0 * headings, 0 * headings], axis=1)
    way = np.repeat(np.arange(8) * np.pi / 4, 24)
    elevation = np.arcsin(np.sin(_TILT) * np.cos(way))
    bank = np.arctan2(np.sin(_TILT) * np.sin(way), np.cos(_TILT))
    tilted = np.stack([np.tile(headings, 8), elevation, bank], axis=1)
    return [(attitudes, np.asarray(body_field(attitudes, 1.0, inclination))) for attitudes in (level, tilted)]


def _levelled(attitudes: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Body vectors (n, ..., 3) turned back by bank and elevation."""
    turned = attitudes.copy()
    turned[:, 0] = 0.0
    return np.einsum("nji,n...j->n...i", rotation(turned), y)


def _across(attitudes: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Derivative of the magnetic heading with respect to the corrected field, (n, 3)."""
    x, y, _ = np.moveaxis(_levelled(attitudes, directions), -1, 0)
    along_x, along_y, _ = np.moveaxis(_levelled(attitudes, np.broadcast_to(np.eye(3), (len(directions), 3, 3))), -1, 0)
    return (y[:, None] * along_x - x[:, None] * along_y) / (x**2 + y**2)[:, None]


@functools.lru_cache(maxsize=64)
def grids_across(inclination: float) -> list[np.ndarray]:
    return [_across(*grid) for grid in grids(inclination)]


def heading_slopes(shape: np.ndarray, attitudes: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Derivative of the magnetic heading with respect to the shape's entries and the centre, (n, 9)."""
    return _heading_slopes(shape, directions, _across(attitudes, directions))


def _heading_slopes(shape: Any, directions: np.ndarray, across: np.ndarray) -> Any:
    xp, matrix = array_module(shape), root(shape)
    z = directions @ xp.linalg.inv(matrix)
    by_shape = (across[:, :, None] * z[:, None, :]).reshape(-1, 9) @ root_slopes(shape).reshape(6, 9).T
    return xp.concatenate([by_shape, -across @ matrix], axis=1)


def heading_error(shape: Any, covariance: Any, inclination: float) -> Any:
    """Predicted rms heading error in rad, at level and at 20 degrees of tilt; in a plane there is no tilt."""
    xp = array_module(shape, covariance)
    known = xp.isfinite(covariance).all()
    safe = xp.where(known, covariance, 0.0)
    if len(covariance) == 5:
        attitudes = grids(inclination)[0][0]
        directions = np.stack([np.cos(attitudes[:, 0]), -np.sin(attitudes[:, 0]), np.zeros(len(attitudes))], axis=1)
        errors = [rms(heading_slopes(shape, attitudes, directions)[:, PLANAR_ROWS], safe), np.inf]
    else:
        level, tilted = (directions for _, directions in grids(inclination))
        slopes = _heading_slopes(shape, np.concatenate([level, tilted]), np.concatenate(grids_across(inclination)))
        errors = [rms(part, safe) for part in (slopes[: len(level)], slopes[len(level) :])]
    return xp.where(known, xp.stack(errors), xp.inf)


def rms(slopes: Any, covariance: Any) -> Any:
    """Root of the mean variance s'Cs over all rows s."""
    return array_module(slopes, covariance).sqrt((slopes @ covariance * slopes).sum(axis=1).mean())


def turned_heading_error(covariance: np.ndarray, inclination: float) -> np.ndarray:
    """Root mean square heading error, at level and tilted, of a rotation about the body axes that is known to `covariance`."""
    errors = []
    for attitudes, directions in grids(inclination):
        change = np.cross(np.eye(3)[None], directions[:, None])
        x, y, _ = np.moveaxis(_levelled(attitudes, directions), -1, 0)
        dx, dy, _ = np.moveaxis(_levelled(attitudes, change), -1, 0)
        errors.append(rms((y[:, None] * dx - x[:, None] * dy) / (x**2 + y**2)[:, None], covariance))
    return np.array(errors)


def heading_departure(first: Found, second: Found, inclination: float) -> np.ndarray:
    """Root mean square of the headings' difference between two calibrations of the same readings, at level and tilted."""
    matrix, other = root(first.shape), root(second.shape)
    departures = []
    for attitudes, directions in grids(inclination):
        y = (directions @ np.linalg.inv(other) + second.centre - first.centre) @ matrix
        turned = np.exp(1j * (_angle(attitudes, y) - _angle(attitudes, directions)))
        departures.append(np.sqrt(np.mean(np.angle(turned) ** 2)))
    return np.array(departures)


def _angle(attitudes, y):
    level = _levelled(attitudes, y)
    return np.arctan2(-level[:, 1], level[:, 0])


class Information(eqx.Module):
    """How well directions determine a model.

    condition : ratio of the largest to the smallest singular value on the unit sphere.
    weakest : the parameters of the smallest, in words.
    by_noise : share of the smallest singular value's square that noise along the sphere alone would give.
    """

    condition: float
    by_noise: float
    weakest: str = eqx.field(static=True)


def information(directions: np.ndarray, kind: str, relative_noise: float) -> Information:
    """Condition number of the fit on the unit sphere, and the parameters it leaves weakest, in words.

    Columns keep their natural scale: with columns of unit length a thin band of directions looks well conditioned. A row is
    (u'Qu - 2c'u)/2 for the change Q of A and c of the centre; noise of size s across u alone moves it by s |(Qu - c)_across|.
    """
    basis = BASES[kind]
    values, vectors = np.linalg.svd(triangle(natural_rows(directions) @ basis) / np.sqrt(len(directions)))[1:]
    condition = float(values[0] / values[-1]) if len(values) == basis.shape[1] and values[-1] > 1e-12 * values[0] else np.inf
    weak = basis @ vectors[-1]
    slope = directions @ matrix_of(weak[:6] * np.array([1, 2, 1, 2, 2, 1])) - weak[6:]
    across = slope - np.sum(slope * directions, axis=1, keepdims=True) * directions
    noise = relative_noise**2 * float(np.mean(np.sum(across**2, axis=1)))
    by_noise = min(noise / float(values[-1]) ** 2, 1.0) if np.isfinite(condition) else 0.0
    chosen = [word for word, share in zip(WORDS, np.abs(weak), strict=True) if share > 0.5 * np.abs(weak).max()]
    if kind in PLANAR:
        chosen = [_IN_PLANE[WORDS.index(word)] for word in chosen]
    return Information(condition, by_noise, ", ".join(chosen))


def needed(shape: np.ndarray, covariance: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Three directions, at least 45 degrees apart, in which a reading is predicted worst: there a new one tells most."""
    z = grid @ np.linalg.inv(root(shape))
    x, y, w = z.T
    rows = np.concatenate([np.stack([x * x, 2 * x * y, y * y, 2 * x * w, 2 * y * w, w * w], axis=1), -2 * z @ shape], axis=1)
    rows = rows / np.linalg.norm(2 * z @ shape, axis=1, keepdims=True)
    variance = np.sum(rows @ covariance * rows, axis=1)
    chosen = []
    for _ in range(3):
        chosen.append(grid[np.argmax(variance)])
        variance = np.where(grid @ chosen[-1] < np.cos(np.pi / 4), variance, -1.0)
    return np.array(chosen)
