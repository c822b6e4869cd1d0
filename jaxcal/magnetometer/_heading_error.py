"""Heading error from the covariance of hard and soft iron."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .._compile import filter_jit
from .._types import AnyArray
from ._coverage import sphere_grid
from ._field import INCLINATION, unit_field
from ._own_model import changes_of

TILT = np.deg2rad(20.0)  # of a vehicle that brakes or banks
HEADINGS = np.arange(24) * np.pi / 12  # every 15 degrees


def tilted(headings: np.ndarray, tilt: float) -> np.ndarray:
    """Attitudes at the given headings, (8 n, 3): tilted in each of eight directions, or level, (n, 3), if the tilt is zero."""
    way = np.repeat(np.arange(8 if tilt else 1) * np.pi / 4, len(headings))
    elevation, bank = np.arcsin(np.sin(tilt) * np.cos(way)), np.arctan2(np.sin(tilt) * np.sin(way), np.cos(tilt))
    return np.stack([np.resize(headings, len(way)), elevation, bank], axis=1)


def _level_axes(attitudes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors forward and to the right in the horizontal plane, in body axes, (n, 3) each."""
    _, elevation, bank = attitudes.T
    ct, st, cp, sp = np.cos(elevation), np.sin(elevation), np.cos(bank), np.sin(bank)
    return np.stack([ct, sp * st, cp * st], axis=1), np.stack([0 * ct, cp, -sp], axis=1)


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


def _grid(headings: np.ndarray, tilt: float, dip: float, down: AnyArray | None) -> tuple[np.ndarray, np.ndarray]:
    """Derivative (m, 3) of headings by the corrected unit field, and that field: for each `down`, direction of tilt, and heading."""
    attitudes = tilted(headings, tilt)
    directions = unit_field(attitudes, dip)
    forward, right = _level_axes(attitudes)
    x, y = (np.sum(directions * axis, axis=1, keepdims=True) for axis in (forward, right))
    across, turns = (y * forward - x * right) / (x**2 + y**2), levelled(down)
    return (across @ turns).reshape(-1, 3), (directions @ turns).reshape(-1, 3)


def heading_slopes(change: Callable[[Any, Any], Any], headings: np.ndarray, tilt: float, dip: float, down: AnyArray | None) -> Any:
    """Derivative (m, p) of headings by parameters: for each `down`, each direction of tilt, and each heading, which is the last in m.

    change : takes vectors (n, 3) and unit fields in body axes (n, 3) to the change of the corrected fields along these vectors with the
    parameters, (n, p). down : the axis that points down at level; None for all six.
    """
    return change(*_grid(headings, tilt, dip, down))


def both_tilts(change: Callable[[Any, Any], Any], dip: float, down: AnyArray | None = None) -> tuple[Any, Any]:
    """`heading_slopes` at every 15 degrees, at level and at 20 degrees of tilt."""
    level, leaning = (_grid(HEADINGS, tilt, dip, down) for tilt in (0.0, TILT))
    rows = change(*(np.concatenate(parts) for parts in zip(level, leaning, strict=True)))
    return rows[: len(level[0])], rows[len(level[0]) :]


def between(slopes: Any, covariance: Any) -> Any:
    """Covariance J C J'; infinite if C is: infinity times zero is NaN."""
    xp = covariance.__array_namespace__()
    known = xp.isfinite(covariance).all()
    return xp.where(known, slopes @ xp.where(known, covariance, 0.0) @ slopes.T, xp.inf)


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
    forward, right = (np.sum(y * axis, axis=1) for axis in _level_axes(attitudes))
    return np.arctan2(-right, forward)


def heading_change(present: Any, new: Any, field: float, *, inclination: float = INCLINATION, down: Any = None, tilt: float = 0.0) -> Any:
    """By how much headings change when a new calibration replaces the present one.

    Parameters
    ----------
    present, new : the two models, for readings in the same unit.
    field : magnitude of the field that `new` gives, in its unit, as in `MagFit.field`.
    inclination : dip of the field in rad.
    down : the axis that points down at level, in the axes of the field that `new` gives; z by default.
    tilt : angle from level, in eight directions, rad.

    Returns
    -------
    (24,) rad, or (192,) if tilted: heading by `new` minus heading by `present`, at every 15 degrees of heading by `new`, from north.
    """
    attitudes = tilted(HEADINGS, tilt)
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


errors_in_trace = filter_jit(heading_errors)


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
