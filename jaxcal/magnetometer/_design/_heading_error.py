"""Heading error from the covariance of an ellipsoid, and the parameters that the readings determine least (host, NumPy)."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..._precision import array_module
from ..._types import AnyArray
from .._ellipsoid._algebraic import matrix_of, triangle
from .._ellipsoid._kinds import PLANAR, PLANAR_ROWS
from .._ellipsoid._residuals import BASES, natural_rows
from .._ellipsoid._shape import Found, root, root_slopes, roots_of
from .._field import unit_field

WORDS = (
    "scale along x", "coupling of x and y", "scale along y", "coupling of x and z", "coupling of y and z", "scale along z",
    "hard iron along x", "hard iron along y", "hard iron along z",
)  # fmt: skip
_IN_PLANE = {
    0: "scale along the plane's first axis", 1: "coupling of the plane's axes", 2: "scale along the plane's second axis",
    6: "hard iron along the plane's first axis", 7: "hard iron along the plane's second axis",
}  # fmt: skip
_TILT = np.deg2rad(20.0)  # of a vehicle that brakes or banks
_TURNED = 0.5  # length of the mean unit field: sin(dip) for turns about the vertical, zero for a sensor turned through all attitudes
_HEADINGS = np.arange(24) * np.pi / 12  # every 15 degrees


def tilted(headings: np.ndarray, tilt: float) -> np.ndarray:
    """Attitudes at the given headings, (8 n, 3): tilted in each of eight directions, or level, (n, 3), if the tilt is zero."""
    way = np.repeat(np.arange(8 if tilt else 1) * np.pi / 4, len(headings))
    elevation, bank = np.arcsin(np.sin(tilt) * np.cos(way)), np.arctan2(np.sin(tilt) * np.sin(way), np.cos(tilt))
    return np.stack([np.resize(headings, len(way)), elevation, bank], axis=1)


@functools.lru_cache(maxsize=64)
def grids(inclination: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Attitudes and unit fields at level, and at 20 degrees of tilt in eight directions."""
    both = [tilted(_HEADINGS, tilt) for tilt in (0.0, _TILT)]
    return [(attitudes, unit_field(attitudes, inclination)) for attitudes in both]


def _level_axes(attitudes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors forward and to the right in the horizontal plane, in body axes, (n, 3) each."""
    _, elevation, bank = attitudes.T
    ct, st, cp, sp = np.cos(elevation), np.sin(elevation), np.cos(bank), np.sin(bank)
    return np.stack([ct, sp * st, cp * st], axis=1), np.stack([0 * ct, cp, -sp], axis=1)


def _level_parts(attitudes: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
    """Components of body vectors along the axes of `_level_axes`, (n,) each."""
    return [np.sum(y * axis, axis=1) for axis in _level_axes(attitudes)]


def across(attitudes: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Derivative of the magnetic heading with respect to the corrected field, (n, 3)."""
    (forward, right), (x, y) = _level_axes(attitudes), _level_parts(attitudes, directions)
    return (y[:, None] * forward - x[:, None] * right) / (x**2 + y**2)[:, None]


@functools.lru_cache(maxsize=64)
def grids_across(inclination: float) -> list[np.ndarray]:
    return [across(*grid) for grid in grids(inclination)]


def change_of(shape: Any, directions: np.ndarray) -> Any:
    """Derivative of corrected unit fields with respect to the shape's entries and the centre, (n, 3, 9)."""
    xp, matrix = array_module(shape), root(shape)
    by_shape = xp.einsum("eij,nj->nie", root_slopes(shape), directions @ xp.linalg.inv(matrix))
    return xp.concatenate([by_shape, xp.broadcast_to(-matrix, (len(directions), 3, 3))], axis=2)


def heading_slopes(shape: Any, attitudes: np.ndarray, directions: np.ndarray) -> Any:
    """Derivative of the magnetic heading with respect to the shape's entries and the centre, (n, 9)."""
    return array_module(shape).einsum("ni,nip->np", across(attitudes, directions), change_of(shape, directions))


def planar_slopes(shape: Any, headings: np.ndarray) -> Any:
    """`heading_slopes` in a plane, with respect to the parameters that a plane has, (n, 5)."""
    level = tilted(headings, 0.0)
    return heading_slopes(shape, level, unit_field(level, 0.0))[:, np.array(PLANAR_ROWS)]


def levelled(down: AnyArray | None) -> np.ndarray:
    """Rotations (k, 3, 3) for rows of vectors: from axes whose z points down at level to axes whose `down` points down at level.

    Without `down` there are six, for each axis either way: a number that is averaged over them does not depend on the names of the axes.
    """
    z, found = np.array([0.0, 0.0, 1.0]), []
    for axis in np.concatenate([np.eye(3), -np.eye(3)]) if down is None else np.reshape(np.asarray(down), (1, 3)):
        both = z + axis / np.linalg.norm(axis)
        square = both @ both
        # half a turn about the bisector of z and the axis
        found.append(2 * np.outer(both, both) / square - np.eye(3) if square > 1e-12 else np.diag([1.0, -1.0, -1.0]))
    return np.array(found)


def down_of(directions: np.ndarray, dip: float) -> np.ndarray | None:
    """The axis about which a sensor turned, from unit fields (n, 3), or None if it was turned through all attitudes."""
    mean = directions.mean(axis=0)
    size = float(np.linalg.norm(mean))
    return np.copysign(1.0, dip) * mean / size if size > _TURNED else None


def rms_heading(change: Callable[[np.ndarray], Any], covariance: Any, inclination: float, down: AnyArray | None = None) -> Any:
    """Root mean square heading error in rad, at level and at 20 degrees of tilt, from the `covariance` (p, p) of the parameters.

    change : takes unit fields in body axes (n, 3) to the derivative of the corrected fields with respect to the parameters, (n, 3, p).
    down : the axis that points down at level; None for the mean over all.
    """
    turns, slopes = levelled(down), []
    xp = array_module(covariance)
    for (_, directions), sideways in zip(grids(inclination), grids_across(inclination), strict=True):
        s, u = ((x @ turns).reshape(-1, 3) for x in (sideways, directions))
        slopes.append(xp.einsum("ni,nip->np", s, change(u)))
    return _rms(slopes, covariance)


def _rms(slopes: list[Any], covariance: Any) -> Any:
    """Roots of the mean variance s'Cs over all rows s of each array; infinite if the covariance is."""
    xp = array_module(slopes, covariance)
    known = xp.isfinite(covariance).all()
    safe = xp.where(known, covariance, 0.0)
    return xp.where(known, xp.sqrt(xp.stack([(rows @ safe * rows).sum(axis=1).mean() for rows in slopes])), xp.inf)


def _moments(inclination: float, down: AnyArray | None = None) -> np.ndarray:
    """Mean of g g', at level and tilted, (2, 12, 12), where g holds the products s_i u_j of slope and unit field, and the slope s.

    The heading error due to a change D u + d of a corrected field u, for a matrix D and a vector d, depends on the grid only through it.
    """
    return _moments_about(float(inclination), None if down is None else tuple(np.asarray(down).tolist()))


@functools.lru_cache(maxsize=256)
def _moments_about(inclination: float, down: tuple[float, ...] | None) -> np.ndarray:
    turns, found = levelled(None if down is None else np.array(down)), []
    for (_, directions), sideways in zip(grids(inclination), grids_across(inclination), strict=True):
        s, u = ((x @ turns).reshape(-1, 3) for x in (sideways, directions))
        g = np.concatenate([(s[:, :, None] * u[:, None, :]).reshape(-1, 9), s], axis=1)
        found.append(g.T @ g / len(g))
    return np.array(found)


def _spread_of_change(shape: Any, covariance: Any) -> Any:
    """Covariance of (D, d), (12, 12), from that of the shape's entries and the centre: D = dS S^-1 and d = -S db with the root S."""
    xp = array_module(shape)
    matrix, inverse, slopes = roots_of(shape)
    turned = (slopes @ inverse).reshape(6, 9).T
    zeros = np.zeros((9, 3)), np.zeros((3, 6))
    change = xp.concatenate([xp.concatenate([turned, zeros[0]], axis=1), xp.concatenate([zeros[1], -matrix], axis=1)])
    return change @ covariance @ change.T


def heading_error(shape: Any, covariance: Any, inclination: float, down: AnyArray | None = None) -> Any:
    """Predicted rms heading error of an ellipsoid, at level and tilted; a plane has no tilt."""
    xp = array_module(covariance)
    if len(covariance) == 5:
        return xp.concatenate([_rms([planar_slopes(shape, _HEADINGS)], covariance), xp.full(1, np.inf)])
    known = xp.isfinite(covariance).all()
    spread = _spread_of_change(shape, xp.where(known, covariance, 0.0))
    # rounding may make a small value negative
    return xp.where(known, xp.sqrt(xp.maximum((_moments(inclination, down) * spread[None]).sum(axis=(1, 2)), 0.0)), xp.inf)


def turned_heading_error(covariance: np.ndarray, inclination: float, down: AnyArray | None = None) -> np.ndarray:
    """Predicted rms heading error due to the error of a rotation about the body axes."""
    return rms_heading(lambda directions: np.cross(np.eye(3), directions[:, None]).swapaxes(1, 2), covariance, inclination, down)


def heading_departure(first: Found, second: Found, inclination: float) -> np.ndarray:
    """Root mean square difference of the headings by two calibrations of the same readings, at level and tilted."""
    matrix, other = root(first.shape), root(second.shape)
    departures = []
    for attitudes, directions in grids(inclination):
        y = (directions @ np.linalg.inv(other) + second.centre - first.centre) @ matrix
        turned = np.exp(1j * (angle(attitudes, y) - angle(attitudes, directions)))
        departures.append(np.sqrt(np.mean(np.angle(turned) ** 2)))
    return np.array(departures)


def angle(attitudes: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Magnetic heading in rad of corrected fields `y` in body axes, for known attitudes."""
    forward, right = _level_parts(attitudes, y)
    return np.arctan2(-right, forward)


class Information(NamedTuple):
    """Condition number on the unit sphere, share of its smallest squared singular value due to noise alone, and the weakest parameters."""

    condition: float
    by_noise: float
    weakest: str


def information(directions: np.ndarray, kind: str, relative_noise: float) -> Information:
    """Condition number of the fit on the unit sphere, and the parameters that it determines least, in words.

    Columns keep their natural scale, because with columns of unit length a thin band of directions would look well conditioned. A row is
    (u'Qu - 2c'u)/2 for the change Q of A and c of the centre. Noise of size s across u changes it by s |(Qu - c)_across|.
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


def distance_slopes(shape: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Derivative of the distance to the ellipsoid with respect to the shape's entries and the centre, (n, 9).

    z : (n, 3) points, relative to the centre.
    """
    x, y, w = z.T
    rows = np.concatenate([np.stack([x * x, 2 * x * y, y * y, 2 * x * w, 2 * y * w, w * w], axis=1), -2 * z @ shape], axis=1)
    return rows / np.linalg.norm(2 * z @ shape, axis=1, keepdims=True)


def needed(shape: np.ndarray, covariance: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """The three directions, at least 45 degrees apart, in which the fit predicts readings worst: new readings there help most."""
    rows = distance_slopes(shape, grid @ np.linalg.inv(root(shape)))
    variance = np.sum(rows @ covariance * rows, axis=1)
    chosen = []
    for _ in range(3):
        chosen.append(grid[np.argmax(variance)])
        variance = np.where(grid @ chosen[-1] < np.cos(np.pi / 4), variance, -1.0)
    return np.array(chosen)
