"""`fit` of the leaves of a model object: a `MagModel`, or a subclass of it with fields of its own.

Field magnitudes do not determine a common rotation. So the soft iron is S Q with a symmetric S, which is fitted, and the rotation Q of
the start, which is kept. All other floating leaves are fitted unchanged.
"""

import dataclasses
import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._errors import DataError
from .._precision import array_module, is_traced
from .._types import Array
from ..fitting import Fit, covariance, identifiability, solve
from ..fitting._problem import names_of
from ..fitting._serial import BLOCKS
from ._checked import checked, norm_and_dip
from ._design._heading_error import both_tilts, rms_heading
from ._ellipsoid._algebraic import extents, host_start, traced_start
from ._ellipsoid._kinds import SYMMETRIC, UPPER, basis_of, soft_and_centre
from ._ellipsoid._orthogonal import PRECISE, settled
from ._ellipsoid._residuals import surface_distances
from ._ellipsoid._shape import NEAR_PLANAR, Frame, between, model_of, radius_of
from ._findings import FINDINGS
from ._iron import EXACT, by_parts, estimated
from ._judge import by_readings, outliers
from ._leaves import Leaves, changes, changes_of
from ._model import MagModel
from ._result import MagFit, judged_fit, not_judged
from ._traced import one_by_one


class _Round(NamedTuple):
    """A fit and its noise."""

    fit: Fit
    noise: Any


def _whitened(leaves: Leaves, data: tuple) -> Array:
    turn, *rest = data
    return surface_distances(leaves.model(turn), *rest)


@filter_jit
def _there_and_back(model: MagModel, m: Any, conditions: Any) -> tuple[Array, Array]:
    """Corrected readings, and what the model measures of them."""
    y = jnp.asarray(model.correct(m, **conditions))
    return y, jnp.asarray(model.measure(y, **conditions))


def _start(model: MagModel, m: Any, field: Any, conditions: Any) -> tuple[Leaves, Any, Any]:
    """Start of the fit, Q of the soft iron S Q, and the field.

    The start is the given model, or the same with the iron of the algebraic fit if the magnitudes that it corrects scatter less.
    """
    xp = array_module(m, model, field)
    frame, kind = Frame.of(m), "symmetric"
    begin = traced_start(frame.scaled(m), kind) if xp is jnp else host_start(frame.scaled(m), kind)
    soft, centre = soft_and_centre(begin, basis_of(kind))
    norm = radius_of(soft) * frame.scale if field is None else xp.asarray(field, dtype=m.dtype)
    iron = model_of(soft, centre, frame, norm / frame.scale)
    left, _, right = xp.linalg.svd(model.soft_iron)
    turn = left @ right
    given = Leaves((model.soft_iron @ turn.T)[UPPER], eqx.tree_at(lambda m: m.soft_iron, model, None))
    other = Leaves(iron.soft_iron[UPPER], eqx.tree_at(lambda r: r.hard_iron, given.rest, iron.hard_iron))
    off = [xp.linalg.norm(xp.asarray(_there_and_back(one.model(turn), m, conditions)[0]), axis=1) - norm for one in (given, other)]
    first, second = (xp.nan_to_num(xp.sum(x**2), nan=xp.inf) for x in off)
    pick = lambda a, b: xp.where(second < first, b, a) if eqx.is_inexact_array(b) else a  # noqa: E731
    return jax.lax.stop_gradient(jax.tree.map(pick, given, other)), jax.lax.stop_gradient(turn), norm


def _solved(model: MagModel, m: Any, field: Any, conditions: Any) -> tuple[_Round, Array, Any]:
    """The fit, Q and the field."""
    begin, turn, norm = _start(model, m, field, conditions)

    def at(begin: Leaves, noise2: Any) -> _Round:
        fit = solve(_whitened, begin, (turn, m, norm, conditions, noise2), rtol=PRECISE)
        xp = array_module(fit.residuals)
        return _Round(dataclasses.replace(fit, problem=None), xp.sqrt(xp.sum(fit.residuals**2) / (len(m) - fit.parameters.size)))

    first = at(begin, np.zeros((), m.dtype))
    found = settled(first, lambda found, noise2: at(jax.lax.stop_gradient(found.fit.model), noise2), lambda _: norm)
    return found, turn, norm


def _by_leaves(turn: Any, more: int) -> Any:
    """Derivative (13 + more, 9 + more) of hard iron, soft iron, field and further leaves by the leaves."""
    xp = array_module(turn)
    by_soft = (xp.reshape(xp.asarray(SYMMETRIC.T, dtype=turn.dtype), (6, 3, 3)) @ turn).reshape(6, 9).T
    slopes = xp.concatenate([xp.zeros((3, 6)), by_soft, xp.zeros((1 + more, 6))])
    rest = np.zeros((13 + more, 3 + more))
    rest[:3, :3], rest[13:, 3:] = np.eye(3), np.eye(more)
    return xp.concatenate([slopes, xp.asarray(rest)], axis=1).astype(turn.dtype)


def _pure(dip: float, model: MagModel, m: Any, field: Any, conditions: Any) -> dict[str, Any]:
    """The results of a traced fit."""
    found, turn, norm = _solved(model, m, field, conditions)
    fitted, usual = found.fit.model.model(turn), _usual(conditions)
    matrix = between(_by_leaves(turn, found.fit.parameters.size - 9), covariance(found.fit, scaled=True))
    error = rms_heading(both_tilts(functools.partial(changes, fitted, norm, usual), dip), matrix)
    return {"model": fitted, "matrix": matrix, "residual": found.fit.residuals, "noise": found.noise, "field": norm, "heading_error": error}


def _usual(conditions: dict[str, Any]) -> dict[str, Any]:
    return {name: array_module(value).median(value, axis=0) for name, value in conditions.items()}


def _further(fitted: MagModel, names: list[str]) -> dict[str, Any]:
    """The leaves beside hard and soft iron, by name."""
    leaves = [array_module(leaf).ravel(leaf) for leaf in jax.tree.leaves(fitted)[2:]]
    return dict(zip(names, array_module(*leaves).concatenate(leaves) if leaves else [], strict=True))


def _conditions(given: dict[str, Any], count: int, traced: bool) -> dict[str, Any]:
    """Conditions as arrays with one row for each reading."""
    found = {name: array_module(value).asarray(value, dtype=float) for name, value in given.items()}
    for name, value in found.items():
        if value.ndim < 1 or len(value) != count:
            raise DataError(f"The condition {name!r} has shape {value.shape}; give one row for each of {count} readings.",
                            code="condition_shape")  # fmt: skip
        if not traced and not np.isfinite(value).all():
            raise DataError(f"The condition {name!r} has values that are not finite.", code="condition_not_finite")
    return found


def fit_model(
    m: Any, model: MagModel, field: Any, inclination: Any, conditions: dict[str, Any], limits: tuple[float, float], others: list[str]
) -> MagFit:
    """`fit` for a model object, traced or not; `others` names options that were given and that this fit does not have."""
    if others:
        raise DataError("A model object is fitted by method='ml', without `field_error` and `aid`.", code="model_object_options")
    traced = is_traced(m, model, field, conditions)
    if traced:
        norm, dip = norm_and_dip(field, inclination)
    else:
        m, norm, dip = checked(m, "ml", "auto", field, inclination, None)
    conditions = _conditions(conditions, len(m), traced)
    model = jax.tree.map(lambda leaf: array_module(leaf).asarray(leaf, dtype=m.dtype), model)
    count, kind = sum(leaf.size for leaf in jax.tree.leaves(model)) - 3, type(model).__name__
    names = names_of(model)[12:]
    if len(m) <= count:
        raise DataError(f"There are {len(m)} readings; this model with {count} parameters needs {count + 1}.", code="few_readings")
    if traced:
        told = one_by_one(_pure, dip, model, jnp.asarray(m), norm, conditions)
        known = estimated(told["model"], told["field"], told.pop("matrix"), 1.0, _further(told["model"], names))
        return not_judged(dip, kind, _about={"usual": _usual(conditions)}, estimate=known, **told)
    return _judged(m, model, norm, dip, conditions, limits, names)


def _judged(
    m: np.ndarray, model: MagModel, norm: Any, dip: float, conditions: dict, limits: tuple[float, float], names: list[str]
) -> MagFit:
    """The fit on the host, with its findings."""
    found, turn, norm = _solved(model, m, norm, conditions)
    fit, noise, field = found.fit, float(found.noise), float(norm)
    fitted, usual = (jax.tree.map(np.asarray, tree) for tree in (fit.model.model(turn), _usual(conditions)))
    y, back = (np.asarray(x) for x in _there_and_back(fit.model.model(turn), m, conditions))
    if not np.allclose(back, m, rtol=1e-6, atol=1e-6 * np.abs(m).max()):
        raise DataError(f"`measure` and `correct` of {type(model).__name__} do not undo one another; `correct` must be its inverse.",
                        code="no_inverse")  # fmt: skip
    matrix, parts, known, identified = covariance(fit, scaled=True), False, [], identifiability(fit)
    weakest = ", ".join(name.removeprefix("rest.") for name in identified.weakest)
    if not bool(fit.usable) or not np.isfinite(matrix).all():
        known.append(FINDINGS("undetermined", what=weakest or "the model"))
    elif extents(Frame.of(m).scaled(m))[-1] < NEAR_PLANAR:
        known.append(FINDINGS("near_planar"))
    elif noise > EXACT * field:
        matrix, parts = by_parts(matrix, np.asarray(fit.jacobian), np.asarray(fit.residuals))
        known += [FINDINGS("correlated", size=100 * noise / field)] if parts else []
    matrix = np.asarray(between(np.asarray(_by_leaves(turn, len(names))), matrix))
    error = np.asarray(rms_heading(both_tilts(functools.partial(changes_of, fitted, field, usual), dip), matrix))
    known += by_readings(noise / field, len(outliers(np.asarray(fit.residuals) / field)), len(m))
    freedom = BLOCKS - 1 if parts else max(len(m) - fit.parameters.size, 1)
    estimate = estimated(fitted, field, matrix, freedom, _further(fitted, names))
    return judged_fit(
        known, limits, weakest, y, model=fitted, estimate=estimate, heading_error=error, field=field, noise=noise,
        residual=np.asarray(fit.residuals), inclination=dip, method="ml", kind=type(model).__name__,
        _about={"usual": usual, "used": len(m), "condition": float(identified.condition)},
    )  # fmt: skip
