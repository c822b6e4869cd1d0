"""Error of a fit whose readings follow more than the field.

The covariance comes from fits without parts of the log, on the raw residuals. On real logs nothing else predicts the difference between
halves: what looks like a drift or a current there does not go on after the log, and taking it out of the residuals makes the error too
small. Only what acts alike in every part of the log is looked for beside: the response of an axis, the rate of turn, recorded conditions.
The step of the fit that such a cause explains is a part of its error.
"""

from typing import Any, NamedTuple

import numpy as np

from ..._special import chi_square_tail
from ...fitting._serial import CHANCE, correlation_time, span_of, tamed
from .._iron import EXACT, by_parts
from ._kinds import COUNT, basis_of
from ._orthogonal import rows_of
from ._shape import Found, between, directions_of, radius_of

FAST, BENT = "rate of turn", "nonlinearity"
_FEWEST = 80  # readings for which the correlation time is known well enough


class Cause(NamedTuple):
    """One cause: its name, the step (12,) of S and centre that it explains, and its largest effect on a reading over the field."""

    name: str
    step: np.ndarray
    size: float


def _columns(found, normals, z, whole, rows, conditions) -> dict[str, np.ndarray]:
    """Columns of each cause, for the readings in the given rows of the whole log."""
    radius, support = radius_of(found.soft), np.sum(normals * z, axis=1)
    columns = {}
    for name, values in conditions.items():
        # the hard iron stays that of the mean condition
        off = values[rows] - values[rows].mean()
        if off.any():
            columns[name] = normals * (off / np.abs(off).max())[:, None]
    # averaging over a short time shortens a turning vector in proportion to the square of its rate
    turn = np.gradient(directions_of(found, whole), axis=0)[rows]
    columns[FAST] = (support * np.sum(turn**2, axis=1))[:, None]
    columns[BENT] = np.concatenate([normals * (z / radius) ** 2, normals * (z / radius) ** 3], axis=1)
    return columns


def _cause(name: str, jacobian: np.ndarray, span: np.ndarray, part: np.ndarray, left: np.ndarray) -> tuple[Cause, float] | None:
    """The cause with the step of the parameters, and its gain over that of chance; None if chance explains it."""
    free = part - span @ (span.T @ part)
    size = np.linalg.norm(free, axis=0)
    if not (size > 1e-6 * np.linalg.norm(part, axis=0)).all():
        return None
    calm = tamed(span, left)
    coefficients = np.linalg.lstsq(free / size, calm, rcond=1e-9)[0] / size
    rest = calm - free @ coefficients
    gain = len(left) / correlation_time(rest) * np.log(np.sum(calm**2) / np.sum(rest**2))
    chance = float(chi_square_tail(float(gain), part.shape[1]))
    if not chance < CHANCE:
        return None
    length = np.linalg.norm(jacobian, axis=0)
    step = np.linalg.lstsq(jacobian / length, part @ coefficients, rcond=1e-9)[0] / length
    return Cause(name, step, float(np.max(np.abs(part @ coefficients)))), chance


def examined(found: Found, u: np.ndarray, whole: np.ndarray, rows: np.ndarray, conditions: dict[str, np.ndarray]) -> Any:
    """Covariance (12, 12) of S and the centre, whether it is by parts of the log, and the causes that the residuals show.

    The given `rows` of the `whole` log were fitted, in order of time.
    """
    count, n, radius = COUNT[found.kind], len(u), radius_of(found.soft)
    if not np.isfinite(found.covariance).all() or not found.noise > EXACT * radius or not found.converged:
        return found.spread, False, []
    basis = basis_of(found.kind)[:, :count]
    by_entries, normals, z = rows_of(found.soft, found.centre, found.distance, u)
    jacobian, left = by_entries @ basis, np.asarray(found.distance)
    columns = {} if n < _FEWEST else _columns(found, normals, z, whole, rows, conditions)
    columns = {name: part[:, np.abs(part).max(axis=0) > 1e-12 * radius] for name, part in columns.items()}
    # a soft iron that the model leaves out is told by another step: a cause is what the largest model does not explain
    span = span_of(by_entries @ basis_of("symmetric"))
    told = [one for name, part in columns.items() if part.size and (one := _cause(name, jacobian, span, part, left)) is not None]
    causes = [Cause(one.name, basis @ one.step, one.size / radius) for one, _ in sorted(told, key=lambda pair: pair[1])]
    matrix, parts = by_parts(found.covariance[:count, :count], jacobian, left)
    return between(basis, matrix), parts, causes
