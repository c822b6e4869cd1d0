"""Heading error from the covariance of hard and soft iron, and the parameters that the readings determine least (host, NumPy)."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..._precision import array_module
from ..._types import AnyArray
from .._ellipsoid._algebraic import matrix_of, triangle
from .._ellipsoid._kinds import PLANAR
from .._ellipsoid._residuals import BASES, natural_rows
from .._ellipsoid._shape import Found, root
from .._field import unit_field
from .._leaves import changes_of

WORDS = (
    "scale along x", "coupling of x and y", "scale along y", "coupling of x and z", "coupling of y and z", "scale along z",
    "hard iron along x", "hard iron along y", "hard iron along z",
)  # fmt: skip
_IN_PLANE = {
    0: "scale along the plane's first axis", 1: "coupling of the plane's axes", 2: "scale along the plane's second axis",
    6: "hard iron along the plane's first axis", 7: "hard iron along the plane's second axis",
}  # fmt: skip
_TILT = np.deg2rad(20.0)  # of a vehicle that brakes or banks
TURNED = 0.5  # length of the mean unit field: sin(dip) for turns about the vertical, zero for a sensor turned through all attitudes
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
    return np.copysign(1.0, dip) * mean / size if size > TURNED else None


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


def moments_of(inclination: float, down: AnyArray | None = None) -> np.ndarray:
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


def changes_by_iron(model: Any, field: Any) -> Any:
    """Derivative (12, 12) of D and d with respect to hard and soft iron, where a corrected unit field u becomes u + D u + d.

    With the whole matrix H C and its inverse W: D = -W H dC and d = -W db. A change of H turns no heading.
    """
    xp = array_module(model.soft_iron, field)
    inverse = xp.linalg.inv(xp.asarray(model.soft_iron) * field)
    one, zeros = xp.eye(3, dtype=inverse.dtype), xp.zeros((9, 3), dtype=inverse.dtype)
    turned = xp.concatenate([zeros, -field * xp.kron(inverse, one)], axis=1)
    return xp.concatenate([turned, xp.concatenate([-inverse, zeros.T], axis=1)])


def heading_error(model: Any, field: Any, covariance: Any, dip: float, down: AnyArray | None = None, plane: AnyArray | None = None) -> Any:
    """Predicted rms heading error from the `covariance` of hard and soft iron (12, 12), at level and tilted; a `plane` has no tilt."""
    xp = array_module(covariance, model.soft_iron)
    known = xp.isfinite(covariance).all()
    change = changes_by_iron(model, field)
    spread = change @ xp.where(known, covariance, 0.0) @ change.T
    moments = moments_of(dip, down)
    if plane is not None:  # in the axes of the plane, whose normal points down
        turn = xp.kron(plane, plane), xp.zeros((9, 3), dtype=spread.dtype)
        turn = xp.concatenate([xp.concatenate(turn, axis=1), xp.concatenate([turn[1].T, plane], axis=1)])
        spread, moments = turn @ spread @ turn.T, moments_of(0.0, np.array([0.0, 0.0, 1.0]))
    # rounding may make a small value negative
    found = xp.where(known, xp.sqrt(xp.maximum((moments * spread[None]).sum(axis=(1, 2)), 0.0)), xp.inf)
    return found if plane is None else xp.where(np.array([True, False]), found, xp.inf)


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


def heading_at(found: Any, headings: np.ndarray, tilt: float = 0.0) -> np.ndarray:
    """Standard deviation (n,) of the headings of a fit; the root mean square over directions of tilt, and over axes if none points down."""
    dip, down = (found.inclination, found.down) if found.plane is None else (0.0, found.plane[2])
    attitudes, turns = tilted(headings, float(tilt) if found.plane is None else 0.0), levelled(down)
    directions = unit_field(attitudes, dip)
    s, u = ((x @ turns).reshape(-1, 3) for x in (across(attitudes, directions), directions))
    covariance = np.asarray(found.iron_covariance)
    if "usual" in found._about:
        order = [i for i, name in enumerate(found.estimate.names) if name != "field"]
        rows = np.einsum("ni,nip->np", s, changes_of(found.model, found.field, found._about["usual"], u))
        covariance = np.asarray(found.estimate.matrix)[np.ix_(order, order)]
    else:
        rows = np.concatenate([(s[:, :, None] * u[:, None, :]).reshape(-1, 9), s], axis=1) @ changes_by_iron(found.model, found.field)
    variance = np.sum(rows @ covariance * rows, axis=1)
    return np.sqrt(variance.reshape(-1, len(headings)).mean(axis=0))


def distance_slopes(model: Any, field: float, directions: np.ndarray) -> np.ndarray:
    """Derivative (n, 13) of the distance of a reading to its surface by hard iron, soft iron and field, for corrected unit fields."""
    normal = directions @ np.linalg.inv(np.asarray(model.soft_iron))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    by_soft = (normal[:, :, None] * field * directions[:, None, :]).reshape(-1, 9)
    by_field = np.sum(normal * (directions @ np.asarray(model.soft_iron).T), axis=1, keepdims=True)
    return -np.concatenate([normal, by_soft, by_field], axis=1)


def needed(model: Any, field: float, covariance: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """The three directions, at least 45 degrees apart, in which the fit predicts readings worst: new readings there help most."""
    rows = distance_slopes(model, field, grid)
    variance = np.sum(rows @ covariance * rows, axis=1)
    chosen = []
    for _ in range(3):
        chosen.append(grid[np.argmax(variance)])
        variance = np.where(grid @ chosen[-1] < np.cos(np.pi / 4), variance, -1.0)
    return np.array(chosen)
