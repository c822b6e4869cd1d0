"""Add the errors of the current terms to a fit of magnitudes, to first order, and to a joint fit, by fitting again."""

import dataclasses
from typing import Any

import numpy as np

from ._design._heading_error import angle, distance_slopes, grids, heading_error, levelled
from ._ellipsoid._shape import Frame, ellipsoid_entries, ellipsoid_of_model
from ._result import MagFit, finished, widened
from ._rotation._joint import aligned

#: share of the largest variance below which a direction of the terms adds nothing
_NOTHING = 1e-6


def widened_by_terms(found: MagFit, m: np.ndarray, columns: np.ndarray, covariance: np.ndarray, terms: dict[str, Any]) -> MagFit:
    """The fit of readings (n, 3) without the fields of the currents, widened by the errors (3 c, 3 c) of the `terms`.

    The hard iron holds at zero current. The heading error holds at the recorded current nearest to zero: a temperature is never zero.
    """
    slopes = _by_terms(found, m, columns)
    errors = None
    if (nearest := np.clip(0.0, columns.min(axis=0), columns.max(axis=0))).any():
        there = _by_terms(found, m, columns - nearest)
        shape = ellipsoid_of_model(found.model, Frame(np.zeros(3), 1.0), found.field)[0]  # type: ignore[arg-type]
        errors = heading_error(shape, there @ covariance @ there.T, found.inclination, found.down)
    return widened(found, slopes @ covariance @ slopes.T, errors, terms=terms)


def _by_terms(found: MagFit, m: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Change of shape and centre (9,) with each term, (9, 3 currents), to first order."""
    shape, centre = ellipsoid_of_model(found.model, Frame(np.zeros(3), 1.0), found.field)  # type: ignore[arg-type]
    rows = distance_slopes(shape, m - centre)
    size = np.linalg.norm(rows, axis=0)
    normals = -rows[:, 6:]
    by_terms = (normals[:, :, None] * columns[:, None, :]).reshape(len(m), -1)
    return np.linalg.lstsq(rows / size, by_terms, rcond=None)[0] / size[:, None]


def jointly_with_terms(
    found: MagFit, m: np.ndarray, columns: np.ndarray, covariance: np.ndarray, aid: Any, terms: dict[str, Any]
) -> MagFit:
    """The joint fit of readings (n, 3) without the fields of the currents, widened by the errors of the terms.

    covariance : (3 c, 3 c) of the terms (3, c), by rows. The fit is repeated one standard deviation away along each principal axis.
    """
    best = aligned(found, m, aid, joint=True)
    values, vectors = np.linalg.eigh(covariance)
    by, turns, errors = np.zeros((9, 9)), np.zeros((3, 3)), np.zeros(2)
    if best.verdict == "refused" or best.alignment.verdict == "refused":
        return finished(best, _facts=dataclasses.replace(best._facts, terms=terms))
    for value, vector in zip(values, vectors.T, strict=True):
        if value > _NOTHING * values[-1]:
            step = np.sqrt(value) * vector.reshape(3, -1)
            moved = aligned(found, m - columns @ step.T, aid, joint=True)
            change = ellipsoid_entries(moved.model, moved.field) - ellipsoid_entries(best.model, best.field)  # type: ignore[arg-type]
            between = np.asarray(best.alignment.rotation).T @ np.asarray(moved.alignment.rotation)
            turn = np.array([between[2, 1] - between[1, 2], between[0, 2] - between[2, 0], between[1, 0] - between[0, 1]]) / 2
            by, turns = by + np.outer(change, change), turns + np.outer(turn, turn)
            errors = errors + _departure(best, moved) ** 2
    alignment = dataclasses.replace(best.alignment, covariance=np.asarray(best.alignment.covariance) + turns)
    return widened(dataclasses.replace(best, alignment=alignment), by, np.sqrt(errors), terms=terms)


def _departure(first: MagFit, second: MagFit) -> np.ndarray:
    """Root mean square difference of the headings by two fits, at level and at 20 degrees of tilt."""
    assert first.model is not None
    assert second.model is not None
    axes, found = levelled(np.array([0, 0, 1.0]) if first.down is None else np.asarray(first.alignment.rotation).T @ first.down)[0], []
    for attitudes, directions in grids(float(first.inclination)):
        readings = first.model.measure(float(first.field) * directions @ axes)
        by = angle(attitudes, np.asarray(second.model.correct(readings)) @ axes.T) - angle(attitudes, directions)
        found.append(np.sqrt(np.mean(np.angle(np.exp(1j * by)) ** 2)))
    return np.array(found)
