"""`fit` of the leaves of a model object: a `MagModel`, or a subclass of it with fields of its own.

Field magnitudes do not determine a common rotation. So the soft iron is S Q with a symmetric S, which is fitted, and the rotation Q of
the start, which is kept. All other floating leaves are fitted unchanged.
"""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._errors import DataError
from .._types import Array
from ..fitting import Fit, covariance, identifiability, solve
from ..fitting._problem import names_of
from ..fitting._serial import BLOCKS
from ._checked import Asked
from ._design._heading_error import both_tilts, rms_heading
from ._ellipsoid._algebraic import NotEllipsoid, extents, start
from ._ellipsoid._kinds import SYMMETRIC, UPPER
from ._ellipsoid._orthogonal import PRECISE, settled
from ._ellipsoid._residuals import surface_distances
from ._ellipsoid._shape import NEAR_PLANAR, Frame, between, radius_of, soft_of
from ._findings import FINDINGS
from ._iron import EXACT, by_parts, estimated
from ._judge import by_readings, outliers
from ._leaves import Leaves, changes_of
from ._model import MagModel
from ._result import MagFit, judged_fit


class _Round(NamedTuple):
    """A fit and its noise."""

    fit: Fit
    noise: float


def _whitened(leaves: Leaves, data: tuple) -> Array:
    turn, *rest = data
    return surface_distances(leaves.model(turn), *rest)


@filter_jit
def _there_and_back(model: MagModel, m: Any, conditions: Any) -> tuple[Array, Array]:
    """Corrected readings, and what the model measures of them."""
    y = jnp.asarray(model.correct(m, **conditions))
    return y, jnp.asarray(model.measure(y, **conditions))


def _start(model: MagModel, m: np.ndarray, field: float | None, conditions: Any) -> tuple[Leaves, np.ndarray, float]:
    """Start of the fit, Q of the soft iron S Q, and the field.

    The start is the given model, or the same with the iron of the algebraic fit if the magnitudes that it corrects scatter less.
    """
    left, values, right = np.linalg.svd(model.soft_iron)
    turn, frame, whole, hard = left @ right, Frame.of(m), (left * values) @ left.T, np.asarray(model.hard_iron)
    given = Leaves(whole[UPPER], eqx.tree_at(lambda m: m.soft_iron, model, None))
    try:
        shape, centre = start(frame.scaled(m), "symmetric")
    except NotEllipsoid:
        return given, turn, float(np.median(np.linalg.norm(m - hard, axis=1))) if field is None else field
    soft = soft_of(shape) * frame.scale
    norm = float(radius_of(soft)) if field is None else field
    other = Leaves((soft / norm)[UPPER], eqx.tree_at(lambda r: r.hard_iron, given.rest, frame.centre + frame.scale * centre))
    off = [np.linalg.norm(_there_and_back(one.model(turn), m, conditions)[0], axis=1) - norm for one in (given, other)]
    return given if np.sum(off[0] ** 2) <= np.sum(off[1] ** 2) else other, turn, norm


def _by_leaves(turn: np.ndarray, more: int) -> np.ndarray:
    """Derivative (13 + more, 9 + more) of hard iron, soft iron, field and further leaves by the leaves."""
    slopes = np.zeros((13 + more, 9 + more))
    slopes[3:12, :6] = (SYMMETRIC.T.reshape(6, 3, 3) @ turn).reshape(6, 9).T
    slopes[:3, 6:9], slopes[13:, 9:] = np.eye(3), np.eye(more)
    return slopes


def fit_model(asked: Asked) -> MagFit:
    """`fit` for a model object."""
    m, dip, conditions = asked.m, asked.dip, asked.conditions
    model = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), asked.model)
    names, kind = names_of(model)[12:], type(model).__name__
    if len(m) <= 9 + len(names):
        raise DataError(f"There are {len(m)} readings; this model with {9 + len(names)} parameters needs {10 + len(names)}.",
                        code="few_readings")  # fmt: skip
    begin, turn, field = _start(model, m, asked.norm, conditions)

    def at(begin: Leaves, noise2: float) -> _Round:
        fit = solve(_whitened, begin, (turn, m, field, conditions, np.float64(noise2)), rtol=PRECISE)
        return _Round(fit, float(np.sqrt(np.sum(fit.residuals**2) / (len(m) - fit.parameters.size))))

    fit, noise = settled(at(begin, 0.0), lambda found, noise2: at(found.fit.model, noise2), lambda _: field)
    usual = {name: np.median(value, axis=0) for name, value in conditions.items()}
    fitted = jax.tree.map(np.asarray, fit.model.model(turn))
    y, back = (np.asarray(x) for x in _there_and_back(fit.model.model(turn), m, conditions))
    if not np.allclose(back, m, rtol=1e-6, atol=1e-6 * np.abs(m).max()):
        raise DataError(f"`measure` and `correct` of {kind} do not undo one another; `correct` must be its inverse.", code="no_inverse")
    matrix, parts, known, identified = covariance(fit, scaled=True), False, [], identifiability(fit)
    weakest, residual = ", ".join(name.removeprefix("rest.") for name in identified.weakest), np.asarray(fit.residuals)
    if not bool(fit.usable) or not np.isfinite(matrix).all():
        known.append(FINDINGS("undetermined", what=weakest or "the model"))
    elif extents(Frame.of(m).scaled(m))[-1] < NEAR_PLANAR:
        known.append(FINDINGS("near_planar"))
    elif noise > EXACT * field:
        matrix, parts = by_parts(matrix, np.asarray(fit.jacobian), residual)
        known += [FINDINGS("correlated", size=100 * noise / field)] if parts else []
    matrix = between(_by_leaves(turn, len(names)), np.asarray(matrix))
    error = np.asarray(rms_heading(both_tilts(functools.partial(changes_of, fitted, field, usual), dip), matrix))
    known += by_readings(noise / field, len(outliers(residual / field)), len(m))
    further = dict(zip(names, np.concatenate([np.zeros(0), *map(np.ravel, jax.tree.leaves(fitted)[2:])]), strict=True))
    estimate = estimated(fitted, field, matrix, BLOCKS - 1 if parts else max(len(m) - fit.parameters.size, 1), further)
    return judged_fit(
        known, asked.limits, weakest, y, model=fitted, estimate=estimate, heading_error=error, field=field, noise=noise, residual=residual,
        inclination=dip, method="ml", kind=kind, _about={"usual": usual, "used": len(m), "condition": float(identified.condition)},
    )  # fmt: skip
