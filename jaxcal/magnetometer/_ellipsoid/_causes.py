"""Find causes that the residuals follow beyond chance: drift, a recorded condition, the rate of turn, an axis's response, each other.

A cause is a few columns beside the Jacobian. What it explains beyond chance biases the fit by a known step. The covariance includes this
step, and the effect that remains in use: a drift continues after the log, and a current takes any value that it had. Chance is judged
by sums over twenty parts of the log, so that correlated noise is not mistaken for a cause.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from ..._special import f_tail
from ...fitting._information import symmetric_inverse
from ...fitting._serial import BLOCKS, correlation_time, leave_out, look_white, span_of, tamed
from ._kinds import COUNT, PLANAR, basis_of, slopes_of
from ._residuals import Size
from ._shape import Found, radius_of, root, unit
from ._shared import shared

DRIFT, FAST, BENT, SERIAL = "time", "rate of turn", "nonlinearity", "correlated noise"
_PARTS = 20  # of the log, whose sums judge chance
_CHANCE = 0.003  # of a false alarm for each cause
_FEWEST = 80  # readings: four in each part
_EXACT = 1e-9  # share of the field below which residuals are rounding, not noise
_MOST = 3  # largest number of causes


class Cause(NamedTuple):
    """One cause: its name, the steps (k, 9) of shape and centre that it adds to the error, and its largest effect on a reading."""

    name: str
    steps: np.ndarray
    size: float


class Examined(NamedTuple):
    """Covariance of the parameters, number of parts that it comes from (zero for white residuals), and causes, the strongest first.

    swing : (3, 9) or (0, 9): how far the hard iron may have moved from its mean along each axis, if this is why the residuals are not
        white. Only the verdict uses it.
    """

    covariance: np.ndarray
    blocks: int
    causes: list[Cause]
    swing: np.ndarray


def _rows(found: Found, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivative of the distances with respect to shape and centre, (n, 9), unit normals, and readings relative to the centre.

    They are taken at the nearest points of the ellipsoid, so that the readings' own noise does not enter.
    """
    z = u - found.centre
    z = z - found.distance[:, None] * unit(z @ found.shape)
    slope = 2 * z @ found.shape
    size = np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-300)
    x, y, w = z.T
    by_shape = np.stack([x * x, 2 * x * y, y * y, 2 * x * w, 2 * y * w, w * w], axis=1)
    return np.concatenate([by_shape, -slope], axis=1) / size, slope / size, z


def step_by(found: Found, u: np.ndarray, more: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Step (9,) of shape and centre that additional readings `more`, at the given distances from the ellipsoid, cause to first order."""
    slopes = slopes_of(found.parameters, basis_of(found.kind))[:, : COUNT[found.kind]]
    jacobian = np.concatenate([_rows(found, u)[0], _rows(dataclasses.replace(found, distance=distance), more)[0]]) @ slopes
    residuals = np.concatenate([np.zeros(len(u)), distance])
    size = np.linalg.norm(jacobian, axis=0)
    return -slopes @ (np.linalg.lstsq(jacobian / size, residuals, rcond=1e-9)[0] / size)


def _columns(found, normals, z, whole, rows, conditions) -> dict[str, np.ndarray]:
    """Columns of each cause, for the readings in the given rows of the whole log."""
    radius, support = radius_of(found.shape, found.kind in PLANAR), np.sum(normals * z, axis=1)
    follow = {DRIFT: rows.astype(float), **{name: values[rows] for name, values in conditions.items()}}
    columns = {}
    for name, values in follow.items():
        low, high = values.min(), values.max()
        if high > low:
            columns[name] = normals * ((2 * values - low - high) / (high - low))[:, None]
    # averaging over a short time shortens a turning vector in proportion to the square of its rate
    turn = np.gradient(unit((whole - found.centre) @ root(found.shape)), axis=0)[rows]
    columns[FAST] = (support * np.sum(turn**2, axis=1))[:, None]
    columns[BENT] = np.concatenate([normals * (z / radius) ** 2, normals * (z / radius) ** 3], axis=1)
    return columns


def _fitted(jacobian: np.ndarray, columns: np.ndarray, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Step of the parameters that the columns explain, and the coefficients of the columns."""
    both = np.concatenate([jacobian, columns], axis=1)
    size = np.linalg.norm(both, axis=0)
    found = np.linalg.lstsq(both / size, residuals, rcond=1e-9)[0] / size
    alone = np.linalg.lstsq(jacobian / size[: jacobian.shape[1]], residuals, rcond=1e-9)[0] / size[: jacobian.shape[1]]
    return found[: jacobian.shape[1]] - alone, found[jacobian.shape[1] :]


def _evidence(span: np.ndarray, columns: np.ndarray, residuals: np.ndarray, worth: float) -> float:
    """Log likelihood ratio of the columns minus their penalty, scaled by the `worth` of the readings; negative if chance explains it."""
    free = columns - span @ (span.T @ columns)
    size, before = np.linalg.norm(free, axis=0), np.linalg.norm(columns, axis=0)
    if not (size > 1e-6 * before).all():
        return -np.inf
    free = free / size
    count, bread = free.shape[1], symmetric_inverse(free.T @ free)
    coefficients = bread @ (free.T @ residuals)
    left = residuals - free @ coefficients
    gain = float(worth * np.log(np.sum(residuals**2) / np.sum(left**2)) - count * np.log(worth))
    if not gain > 0:
        return gain
    edges = np.round(np.arange(_PARTS) * len(left) / _PARTS).astype(int)
    scores = np.add.reduceat(free * left[:, None], edges, axis=0)
    variance = bread @ (scores.T @ scores) @ bread * _PARTS / (_PARTS - 1)
    statistic = coefficients @ symmetric_inverse(variance) @ coefficients
    ratio = (_PARTS - count) / (count * (_PARTS - 1)) * statistic  # Hotelling's T^2 as an F statistic
    if not f_tail(ratio, count, _PARTS - count) < _CHANCE:
        return -np.inf
    return gain


def examined(
    found: Found, u: np.ndarray, whole: np.ndarray, rows: np.ndarray, conditions: dict[str, np.ndarray], size: Size | None
) -> Examined:
    """What the residuals of a fit tell about its error; the given `rows` of the `whole` log were fitted, in order of time."""
    count, n = COUNT[found.kind], len(u)
    radius = radius_of(found.shape, found.kind in PLANAR)
    if not np.isfinite(found.covariance).all() or not found.noise > _EXACT * radius or not found.converged:
        return Examined(np.asarray(found.covariance), 0, [], np.zeros((0, 9)))
    slopes = slopes_of(found.parameters, basis_of(found.kind))[:, :count]
    weight = np.sqrt(np.asarray(found.weight))[:, None]
    by_entries, normals, z = _rows(found, u)
    jacobian, left = weight * (by_entries @ slopes), weight[:, 0] * found.distance
    columns = {} if n < _FEWEST else _columns(found, normals, z, whole, rows, conditions)
    columns = {name: weight * part[:, np.abs(part).max(axis=0) > 1e-12 * radius] for name, part in columns.items()}
    causes: list[Cause] = []
    span = span_of(jacobian)
    while columns and len(causes) < _MOST:
        calm = tamed(span, left)
        worth = n / correlation_time(calm)
        evidence = {name: _evidence(span, part, calm, worth) for name, part in columns.items() if part.size}
        if not evidence or not max(evidence.values()) > 0:
            break
        name = max(evidence, key=lambda name: evidence[name])
        part = columns.pop(name)
        step, coefficients = _fitted(jacobian, part, left)
        left = left - jacobian @ step - part @ coefficients
        steps = [-slopes @ step]
        if name not in (FAST, BENT):  # a cause that moves the hard iron continues after the log, by up to half its range
            moved = np.zeros(9)
            moved[6 : 6 + len(coefficients)] = coefficients
            steps.append(moved)
        causes.append(Cause(name, np.array(steps), float(np.max(np.abs(part @ coefficients))) / radius))
    if look_white(jacobian, span, left):
        rest = np.sum(left**2) / np.sum((weight[:, 0] * found.distance) ** 2)
        return Examined(found.covariance * min(rest, 1.0), 0, causes, np.zeros((0, 9)))
    known = np.zeros((count, count))
    if size is not None:  # derivative of the mean semi-axis, for the field that was given
        slope = np.linalg.inv(found.shape) / -6
        by_size = np.array([slope[0, 0], 2 * slope[0, 1], slope[1, 1], 2 * slope[0, 2], 2 * slope[1, 2], slope[2, 2], 0, 0, 0]) @ slopes
        known = np.outer(by_size, by_size) * (found.noise / size.error) ** 2
    matrix = np.full((9, 9), np.inf)
    part = leave_out(jacobian, left, known)
    if np.isfinite(part).all():
        matrix = np.zeros((9, 9))
        matrix[:count, :count] = part
    alone, swing = shared(left, normals)
    # half the range of a uniform distribution is sqrt(3) times its standard deviation
    half = np.sqrt(3.0) * swing * np.eye(9)[6:]
    moved = np.zeros((0, 9)) if alone is None else np.sqrt(3.0) * np.concatenate([np.zeros(6), alone])[None]
    rest = Cause(SERIAL, moved, float(np.std(left)) / radius)
    return Examined(matrix, BLOCKS, [*causes, rest], half)
