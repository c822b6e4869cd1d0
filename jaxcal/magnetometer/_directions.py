"""Directions of a field in the sensor's axes: how readings cover them, and the error of the heading that each gives.

Coverage is by MotionCal's regions (with its southern index corrected) and by the largest gap; the heading error by first derivatives.
"""

import functools
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._precision import host_float64, real_numbers
from .._types import AnyArray, Samples
from ._own_model import changes_of
from ._quadric import unit

#: dip of the field at Ankara, where the magnetometer paper's experiment was made
INCLINATION = np.deg2rad(57.0)
TILT = np.deg2rad(20.0)  # of a vehicle that brakes or banks
HEADINGS = np.arange(24) * np.pi / 12  # every 15 degrees
ZONES = (1, 15, 34, 34, 15, 1)  # sectors of the zones of latitude, from the north pole on: 100 regions of equal area
_GRID = 500  # points of the lattice, 9 degrees apart


class Coverage(eqx.Module):
    """How well readings fill the sphere of directions.

    Attributes
    ----------
    counts : (100,) readings per region of equal area: pole, 15 sectors, 34, 34, 15, pole.
    occupied : share of 500 equal bins that contain a reading.
    largest_gap : half-angle of the largest cap without a reading, rad.
    missing : (k, 3) unit vectors to the centres of the regions without a reading.

    Examples
    --------
    >>> from jaxcal.magnetometer import body_field, coverage, scenario
    >>> found = coverage(body_field(scenario("three_turns")))
    >>> f"{100 * found.occupied:.0f} % of the directions", len(found.missing) > 50
    ('13 % of the directions', True)
    """

    counts: AnyArray
    occupied: float
    largest_gap: float
    missing: AnyArray


@functools.cache
def sphere_grid(count: int = _GRID) -> np.ndarray:
    """Points of a Fibonacci lattice, (count, 3); each represents nearly the same area."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    grid = np.stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z], axis=1)
    grid.flags.writeable = False
    return grid


@functools.cache
def _tree() -> Any:
    return scipy.spatial.KDTree(sphere_grid())


def bins(directions: np.ndarray) -> np.ndarray:
    """Index of the nearest of the 500 grid points for each unit vector."""
    return np.asarray(_tree().query(directions)[1])


def _edges() -> np.ndarray:
    """Heights of the upper edges of the zones, on a sphere of radius one."""
    return 1 - 2 * np.cumsum([0, *ZONES[:-1]]) / sum(ZONES)


def regions(directions: np.ndarray) -> np.ndarray:
    """Region of each direction, 0 to 99."""
    x, y, z = directions.T
    zone = np.searchsorted(-_edges(), -z, side="right") - 1
    sectors = np.array(ZONES)[zone]
    sector = np.minimum(sectors - 1, ((np.arctan2(y, x) + np.pi) * sectors / (2 * np.pi)).astype(int))
    return np.cumsum([0, *ZONES[:-1]])[zone] + sector


@functools.cache
def middles() -> np.ndarray:
    """Unit vectors to the centres of the regions, (100, 3)."""
    latitude = np.arcsin(np.append(_edges(), -1.0))
    middle = np.repeat((latitude[1:] + latitude[:-1]) / 2, ZONES)
    middle[[0, -1]] = latitude[[0, -1]]
    longitude = np.concatenate([(np.arange(n) + 0.5) * 2 * np.pi / n for n in ZONES]) - np.pi
    found = np.stack([np.cos(longitude) * np.cos(middle), np.sin(longitude) * np.cos(middle), np.sin(middle)], axis=1)
    found.flags.writeable = False
    return found


@host_float64
def coverage(m: Samples) -> Coverage:
    """How evenly corrected readings fill the sphere.

    Parameters
    ----------
    m : (n, 3) corrected readings in any unit; the hard iron must be subtracted already.

    Returns
    -------
    Coverage

    Raises
    ------
    DataError
        If a reading is zero or not finite, or there are no readings.

    Examples
    --------
    >>> import jaxcal
    >>> from jaxcal.magnetometer import body_field, scenario
    >>> full = jaxcal.magnetometer.coverage(body_field(scenario("all", samples=2000)))
    >>> turns = jaxcal.magnetometer.coverage(body_field(scenario("three_turns")))
    >>> len(full.missing) < 1, len(turns.missing) > 50
    (True, True)

    References
    ----------
    P. Stoffregen, MotionCal (quality.c), with corrected positions of the southern sectors.
    """
    return covered(real_numbers(m, "m"))


def covered(m: np.ndarray) -> Coverage:
    """`coverage` for NumPy arrays on the host."""
    if m.ndim != 2 or m.shape[-1] != 3 or not len(m):
        raise DataError(f"The corrected readings have shape {m.shape}; they must be (n, 3) with at least one row.")
    norm = np.linalg.norm(m, axis=1)
    if not (np.isfinite(norm) & (norm > 0)).all():
        raise DataError("A corrected reading is zero or not finite; leave it out.")
    directions = m / norm[:, None]
    region = regions(directions)
    counts = np.bincount(region, minlength=100)
    filled = counts > 0
    largest = float(np.max(scipy.spatial.KDTree(directions).query(sphere_grid())[0]))
    occupied = int(np.count_nonzero(np.bincount(bins(directions)))) / _GRID
    return Coverage(counts, occupied, 2 * float(np.arcsin(min(largest / 2, 1.0))), middles()[~filled])


def unit_field(attitudes: Any, inclination: Any, xp: ModuleType = np) -> Any:
    """`body_field` of magnitude one. Plain numbers give NumPy arrays, even while something else is traced."""
    azimuth, elevation, bank = xp.moveaxis(attitudes, -1, 0)
    ct, st, cp, sp = xp.cos(elevation), xp.sin(elevation), xp.cos(bank), xp.sin(bank)
    north, east, down = xp.cos(inclination) * xp.cos(azimuth), -xp.cos(inclination) * xp.sin(azimuth), xp.sin(inclination)
    forward, below = north * ct - down * st, north * st + down * ct
    return xp.stack([forward, east * cp + below * sp, below * cp - east * sp], axis=-1)


def tilted(headings: np.ndarray, tilt: float) -> np.ndarray:
    """Attitudes at the given headings, (8 n, 3): tilted in each of eight directions, or level, (n, 3), if the tilt is zero."""
    way = np.repeat(np.arange(8 if tilt else 1) * np.pi / 4, len(headings))
    elevation, bank = np.arcsin(np.sin(tilt) * np.cos(way)), np.arctan2(np.sin(tilt) * np.sin(way), np.cos(tilt))
    return np.stack([np.resize(headings, len(way)), elevation, bank], axis=1)


def level_axes(up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors forward and to the right in the horizontal plane, (n, 3) each, in the body axes of upward vectors."""
    forward = unit(np.array([1.0, 0.0, 0.0]) - up[:, :1] * up)
    return forward, np.cross(forward, up)


def levelled(down: Any) -> np.ndarray:
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


@functools.lru_cache(maxsize=64)
def _turning(headings: tuple[float, ...], tilt: float, dip: float, down: tuple[float, ...] | None) -> tuple[np.ndarray, np.ndarray]:
    """Derivative (m, 3) of headings by the unit field, and that field: for each `down`, direction of tilt, and heading."""
    attitudes, turns = tilted(np.array(headings), tilt), levelled(down)
    directions = unit_field(attitudes, dip)
    forward, right = level_axes(-unit_field(attitudes, np.pi / 2))
    x, y = (np.sum(directions * axis, axis=1, keepdims=True) for axis in (forward, right))
    across = (y * forward - x * right) / (x**2 + y**2)
    return (across @ turns).reshape(-1, 3), (directions @ turns).reshape(-1, 3)


def heading_slopes(change: Callable[[Any, Any], Any], headings: np.ndarray, tilt: float, dip: float, down: AnyArray | None) -> Any:
    """Derivative (m, p) of headings by parameters: for each `down`, each direction of tilt, and each heading, which is the last in m.

    change : takes vectors (n, 3) and unit fields in body axes (n, 3) to the change of the corrected fields along these vectors with the
    parameters, (n, p). down : the axis that points down at level; None for all six.
    """
    return change(*_turning(tuple(headings.tolist()), tilt, float(dip), None if down is None else tuple(np.ravel(down).tolist())))


def both_tilts(change: Callable[[Any, Any], Any], dip: float, down: AnyArray | None = None) -> tuple[Any, Any]:
    """`heading_slopes` at every 15 degrees, at level and at 20 degrees of tilt."""
    level, tilted = (heading_slopes(change, HEADINGS, tilt, dip, down) for tilt in (0.0, TILT))
    return level, tilted


def rms_heading(slopes: tuple[Any, Any], covariance: Any) -> Any:
    """Root mean square heading error in rad, at level and tilted, from the covariance of the parameters; infinite if that is."""
    xp = covariance.__array_namespace__()
    known = xp.isfinite(covariance).all()
    safe = xp.where(known, covariance, 0.0)
    # rounding may make a small value negative
    mean = xp.stack([((rows @ safe) * rows).sum(axis=1).mean() for rows in slopes])
    return xp.where(known, xp.sqrt(xp.maximum(mean, 0.0)), xp.inf)


def by_iron(model: Any, field: Any) -> Callable[[Any, Any], Any]:
    """Change (n, 13) of corrected unit fields, along vectors, by hard iron, soft iron and field.

    With the whole matrix H C and its inverse W, u changes by -W db - H W dC u. A change of H turns no heading.
    """
    xp = model.soft_iron.__array_namespace__()
    inverse = xp.linalg.inv(model.soft_iron * field)

    def change(across: Any, directions: Any) -> Any:
        along = -(across @ inverse)
        by_soft = field * (along[:, :, None] * directions[:, None, :]).reshape(-1, 9)
        return xp.concatenate([along, by_soft, 0.0 * along[:, :1]], axis=1)

    return change


def angle(attitudes: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Magnetic heading in rad of corrected fields `y` in body axes, for known attitudes."""
    forward, right = (np.sum(y * axis, axis=1) for axis in level_axes(-unit_field(attitudes, np.pi / 2)))
    return np.arctan2(-right, forward)


def heading_change(present: Any, new: Any, field: float, *, inclination: float = INCLINATION, down: Any = None) -> AnyArray:
    """By how much headings change when a new calibration replaces the present one.

    Parameters
    ----------
    present, new : the two models, for readings in the same unit.
    field : magnitude of the field that `new` gives, in its unit, as in `MagFit.field`.
    inclination : dip of the field in rad.
    down : the axis that points down at level, in the axes of the field that `new` gives; z by default.

    Returns
    -------
    (24,) rad: heading by `new` minus heading by `present`, at every 15 degrees of heading by `new`, from north.
    """
    attitudes = tilted(HEADINGS, 0.0)
    turn = levelled(np.array([0.0, 0.0, 1.0]) if down is None else down)[0]
    readings = new.measure(float(field) * unit_field(attitudes, float(inclination)) @ turn)
    by = [angle(attitudes, np.asarray(model.correct(readings)) @ turn.T) for model in (present, new)]
    return np.angle(np.exp(1j * (by[1] - by[0])))


def change_of(model: Any, field: Any, usual: dict[str, Any] | None) -> Callable[[Any, Any], Any]:
    """Change (n, p) of corrected unit fields, along vectors, by the first parameters of a fit; `usual`: conditions of a model object."""
    return by_iron(model, field) if usual is None else functools.partial(changes_of, model, field, usual)


def heading_errors(
    model: Any, field: Any, usual: dict[str, Any] | None, dip: Any, down: AnyArray | None, matrices: Sequence[Any]
) -> list[Any]:  # fmt: skip
    """`rms_heading` (2,) in rad by each covariance of the parameters."""
    headings = both_tilts(change_of(model, field, usual), dip, down)
    return [rms_heading(headings, one) for one in matrices]


def heading_at(found: Any, headings: np.ndarray, tilt: float = 0.0) -> np.ndarray:
    """Standard deviation (n,) of the headings of a fit; the root mean square over directions of tilt, and over axes if none points down."""
    change = change_of(found.model, float(found.field), found._about.get("usual"))
    rows = heading_slopes(change, headings, tilt, found.inclination, found.down)
    covariance = np.asarray(found.estimate.matrix)[: rows.shape[1], : rows.shape[1]]
    return np.sqrt(np.sum((rows @ covariance) * rows, axis=1).reshape(-1, len(headings)).mean(axis=0))


def distance_slopes(model: Any, field: float, directions: np.ndarray) -> np.ndarray:
    """Derivative (n, 13) of the distance of a reading to its surface by hard iron, soft iron and field, for corrected unit fields."""
    normal = directions @ np.linalg.inv(np.asarray(model.soft_iron))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    by_soft = (normal[:, :, None] * field * directions[:, None, :]).reshape(-1, 9)
    by_field = np.sum(normal * (directions @ np.asarray(model.soft_iron).T), axis=1, keepdims=True)
    return -np.concatenate([normal, by_soft, by_field], axis=1)


def needed(model: Any, field: float, kind: str, covariance: np.ndarray) -> np.ndarray:
    """The three directions, at least 45 degrees apart, in which the fit predicts readings worst: new readings there help most.

    None, (0, 3), for a plane, or where the covariance is not known.
    """
    if kind == "planar" or not np.isfinite(covariance).all():
        return np.zeros((0, 3))
    grid, chosen = sphere_grid(), []
    rows = distance_slopes(model, field, grid)
    variance = np.sum(rows @ covariance[:13, :13] * rows, axis=1)
    for _ in range(3):
        chosen.append(grid[np.argmax(variance)])
        variance = np.where(grid @ chosen[-1] < np.cos(np.pi / 4), variance, -1.0)
    return np.array(chosen)


def attitude_in_words(direction: AnyArray, inclination: float, down: AnyArray | None = None) -> str:
    """How to hold a sensor so that the field points along a direction in its axes: facing north or south, tilted, then rolled about x.

    Parameters
    ----------
    direction : (3,) unit vector in the axes of the sensor, along which the field should point.
    inclination : dip of the field in rad.
    down : (3,) axis that points down at level, where it is known; otherwise z points up.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer._directions import attitude_in_words
    >>> attitude_in_words(np.array([1.0, 0.0, 0.0]), np.deg2rad(60.0))
    'level, z up, x to magnetic north; then x down by 60 deg'
    """
    x, y, z = (float(value) for value in direction)
    up = -1.0 if down is not None and float(np.ravel(down)[2]) > 0.5 else 1.0
    ways: list[tuple[float, float, str]] = []
    for facing, horizontal in (("north", np.cos(inclination)), ("south", -np.cos(inclination))):
        elevation = np.arctan2(-np.sin(inclination), horizontal)  # of the field, in the vertical plane that x stays in
        for side in (1.0, -1.0):
            tilt = np.remainder(elevation + side * np.arccos(np.clip(x, -1.0, 1.0)) + np.pi, 2 * np.pi) - np.pi
            along = np.sign(np.round(up * np.sin(elevation - tilt), 9)) + 0.0  # of the field along z before the roll; 0 if it is along x
            roll = np.arctan2(along * y + 0.0, along * z + 0.0)  # no -0, whose angle is half a turn
            ways += [(np.rad2deg(tilt), np.rad2deg(roll), facing)] if abs(tilt) <= np.pi / 2 + 1e-9 else []
    tilt, roll, facing = min(ways, key=lambda way: abs(way[0]) + abs(way[1]))
    turns = [f"x {'up' if tilt > 0 else 'down'} by {5 * round(abs(tilt) / 5)} deg"] if abs(tilt) > 2.5 else []
    turns += [f"roll {'right' if roll > 0 else 'left'} by {5 * round(abs(roll) / 5)} deg"] if abs(roll) > 2.5 else []
    return f"level, z {'up' if up > 0 else 'down'}, x to magnetic {facing}" + "; then " * bool(turns) + ", ".join(turns)
