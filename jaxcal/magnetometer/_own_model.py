"""`fit` of the leaves of a model object: a `MagModel`, or a subclass of it with fields of its own.

Field magnitudes do not determine a common rotation. So the soft iron is S Q with a symmetric S, which is fitted, and the rotation Q of
the start, which is kept. All other floating leaves are fitted unchanged.
"""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._errors import DataError
from .._frozen import made
from .._precision import array_module, is_traced
from .._types import Array
from ..fitting import Fit, covariance, identifiability, solve
from ..fitting._serial import BLOCKS, is_white, leave_out
from ._checked import checked, norm_and_dip
from ._design._coverage import covered
from ._design._heading_error import rms_heading
from ._ellipsoid._algebraic import extents, traced_start
from ._ellipsoid._causes import EXACT
from ._ellipsoid._kinds import basis_of, shape_and_centre
from ._ellipsoid._orthogonal import CURVED, PRECISE
from ._ellipsoid._residuals import surface_distances
from ._ellipsoid._shape import NEAR_PLANAR, Frame, model_of, radius_of
from ._findings import FINDINGS
from ._iron import estimated
from ._judge import by_readings, judged, outliers
from ._leaves import UPPER, Leaves, changes, changes_of
from ._model import MagModel
from ._result import MagFit, not_judged

_SOFT = [f"soft_iron[{i},{j}]" for i, j in zip(*UPPER, strict=True)]


def _whitened(leaves: Leaves, data: tuple) -> Array:
    turn, *rest = data
    return surface_distances(leaves.model(turn), *rest)


def _start(model: MagModel, m: Any, field: Any, conditions: Any) -> tuple[Leaves, Array, Any]:
    """Start of the fit, Q of the soft iron S Q, and the field.

    The start is the given model, or the same with the iron of the algebraic fit if that has smaller distances.
    """
    frame = Frame.of(m)
    shape, centre = shape_and_centre(traced_start(frame.scaled(m), "symmetric"), basis_of("symmetric"))
    norm = radius_of(shape) * frame.scale if field is None else jnp.asarray(field, dtype=m.dtype)
    iron = model_of(shape, centre, frame, norm / frame.scale)
    left, _, right = jnp.linalg.svd(model.soft_iron)
    turn = left @ right
    given = Leaves((model.soft_iron @ turn.T)[UPPER], eqx.tree_at(lambda m: m.soft_iron, model, None))
    other = Leaves(iron.soft_iron[UPPER], eqx.tree_at(lambda r: r.hard_iron, given.rest, iron.hard_iron))
    cost = [jnp.nan_to_num(jnp.sum(surface_distances(x.model(turn), m, norm, conditions, 0.0) ** 2), nan=jnp.inf) for x in (given, other)]
    pick = lambda a, b: jnp.where(cost[1] < cost[0], b, a) if eqx.is_inexact_array(b) else a  # noqa: E731
    return jax.lax.stop_gradient(jax.tree.map(pick, given, other)), jax.lax.stop_gradient(turn), norm


def _pure(dip: float, model: MagModel, m: Any, field: Any, conditions: Any) -> tuple[Fit, dict[str, Any]]:
    """The fit, and the fields of a `MagFit` that follow from it."""
    begin, turn, norm = _start(model, m, field, conditions)
    noise2 = jnp.zeros((), m.dtype)
    for last in (False, True):
        found = solve(_whitened, begin, (turn, m, norm, conditions, noise2), rtol=PRECISE)
        variance = jnp.sum(found.residuals**2) / (len(m) - found.parameters.size)
        noise = jnp.sqrt(variance)
        if not last:
            noise2 = jnp.where((0.5 * norm > noise) & (noise > CURVED * norm), variance, 0.0)
            begin = jax.lax.stop_gradient(found.model)
    fitted, matrix = found.model.model(turn), by_leaves(covariance(found, scaled=True), turn)
    usual = {name: jnp.median(jnp.asarray(value), axis=0) for name, value in conditions.items()}
    return eqx.tree_at(lambda f: f.problem, found, None), {
        "model": fitted, "covariance": matrix, "residual": found.residuals, "noise": noise, "field": norm, "usual": usual,
        "heading_error": rms_heading(functools.partial(changes, fitted, norm, usual), matrix, dip),
    }  # fmt: skip


def by_leaves(covariance: Any, turn: Any) -> Any:
    """Covariance of hard iron, soft iron and further leaves from that of the six entries of S, the hard iron and the further leaves."""
    xp = array_module(covariance)
    entry = np.zeros((6, 3, 3))
    entry[range(6), *UPPER] = entry[range(6), *UPPER[::-1]] = 1.0
    by_soft = xp.reshape(xp.asarray(entry, dtype=turn.dtype) @ turn, (6, 9)).T
    more = len(covariance) - 9
    rows = [
        xp.concatenate([xp.zeros((3, 6)), xp.eye(3), xp.zeros((3, more))], axis=1),
        xp.concatenate([by_soft, xp.zeros((9, 3 + more))], axis=1), xp.concatenate([xp.zeros((more, 9)), xp.eye(more)], axis=1),
    ]  # fmt: skip
    slopes = xp.concatenate(rows).astype(covariance.dtype)
    known = xp.isfinite(covariance).all()
    return xp.where(known, slopes @ xp.where(known, covariance, 0.0) @ slopes.T, xp.inf)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def one_by_one(pure: Callable, dip: float, *given: Any) -> Any:
    """`pure(dip, *given)`; a batch runs item by item, because LAPACK may hang otherwise, and each item takes only its own steps."""
    return jax.custom_batching.sequential_vmap(functools.partial(pure, dip))(*given)


# derivatives of a batch still run together, because `custom_vmap` has none
@one_by_one.defjvp
def _(pure: Callable, dip: float, primals: tuple, tangents: tuple) -> tuple:
    return jax.jvp(functools.partial(pure, dip), primals, tangents)


_compiled = filter_jit(one_by_one)


def fit_model(
    m: Any, model: MagModel, field: Any, inclination: Any, conditions: dict[str, Any], limits: tuple[float, float], others: list[str]
) -> MagFit:
    """`fit` for a model object, traced or not; `others` names options that were given and that this fit does not have."""
    if others:
        raise DataError("A model object is fitted by method='ml', without `field_error` and `aid`.", code="model_object_options")
    traced = is_traced(m, model, field, conditions)
    if not traced:
        m, norm, dip = checked(m, "ml", "auto", field, inclination, 0.5, None)
    else:
        norm, dip = norm_and_dip(field, inclination)
    conditions = {name: jnp.asarray(value, dtype=float) for name, value in conditions.items()}
    for name, value in conditions.items():
        if value.ndim < 1 or len(value) != len(m):
            raise DataError(f"The condition {name!r} has shape {value.shape}; give one row for each of {len(m)} readings.",
                            code="condition_shape")  # fmt: skip
        if not traced and not np.isfinite(value).all():
            raise DataError(f"The condition {name!r} has values that are not finite.", code="condition_not_finite")
    model = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=m.dtype), model)
    count = sum(leaf.size for leaf in jax.tree.leaves(model)) - 3
    if len(m) <= count:
        raise DataError(f"There are {len(m)} readings; this model with {count} parameters needs {count + 1}.", code="few_readings")
    found, told = (one_by_one if traced else _compiled)(_pure, dip, model, jnp.asarray(m), norm, conditions)
    names, kind = [name.removeprefix("rest.") for name in found.names[9:]], type(model).__name__
    usual, matrix, noise, field, fitted = (told.pop(name) for name in ("usual", "covariance", "noise", "field", "model"))

    def further(fitted: MagModel) -> dict[str, Any]:
        leaves = jax.tree.leaves(fitted)[2:]
        flat = jnp.concatenate([jnp.ravel(leaf) for leaf in leaves]) if leaves else []
        return dict(zip(names, flat, strict=True))

    if traced:
        return not_judged(dip, kind, model=fitted, field=field, noise=noise, _about={"usual": usual},
                          estimate=estimated(fitted, field, with_field(matrix), 1.0, further(fitted)), **told)  # fmt: skip
    told = jax.tree.map(lambda leaf: np.asarray(leaf) if eqx.is_array(leaf) else leaf, told)
    fitted, usual = (jax.tree.map(np.asarray, tree) for tree in (fitted, usual))
    matrix, noise, field, error = np.asarray(matrix), float(noise), float(field), told.pop("heading_error")
    y = np.asarray(fitted.correct(jnp.asarray(m), **conditions))
    back = np.asarray(fitted.measure(jnp.asarray(y), **conditions))
    if not np.allclose(back, m, rtol=1e-6, atol=1e-6 * np.abs(m).max()):
        raise DataError(f"`measure` and `correct` of {kind} do not undo one another; `correct` must be its inverse.", code="no_inverse")
    identified, jacobian, left = identifiability(found), np.asarray(found.jacobian), np.asarray(found.residuals)
    weakest, known, parts = ", ".join(name.removeprefix("rest.") for name in identified.weakest), [], False
    if np.isfinite(matrix).all() and noise > EXACT * field and not is_white(jacobian, left):
        matrix = np.asarray(by_leaves(leave_out(jacobian, left), np.linalg.inv(_symmetric(fitted.soft_iron)) @ fitted.soft_iron))
        by_parts = np.asarray(rms_heading(functools.partial(changes_of, fitted, field, usual), matrix, dip))
        more = max(error[0] / by_parts[0], 1.0)
        matrix, error, parts = matrix * more**2, by_parts * more, True
        known.append(FINDINGS("correlated", size=100 * noise / field))
    if not bool(found.usable) or not np.isfinite(matrix).all():
        known.append(FINDINGS("undetermined", what=weakest or "the model"))
    elif extents(Frame.of(m).scaled(m))[-1] < NEAR_PLANAR:
        known.append(FINDINGS("near_planar"))
    known += by_readings(noise / field, len(outliers(told["residual"] / field)), len(m))
    estimate = estimated(fitted, field, np.asarray(with_field(matrix)), BLOCKS - 1 if parts else max(len(m) - count, 1), further(fitted))
    return made(
        MagFit, model=fitted, estimate=estimate, heading_error=error, field=field, noise=noise, inclination=dip, method="ml", kind=kind,
        coverage=covered(y), findings=judged(known, error[0], limits, weakest, np.zeros((0, 3))),
        _about={"usual": usual, "used": len(m), "condition": float(identified.condition)}, **told,
    )  # fmt: skip


def _symmetric(soft: np.ndarray) -> np.ndarray:
    """S of C = S Q."""
    left, values, _ = np.linalg.svd(soft)
    return (left * values) @ left.T


def with_field(matrix: Any) -> Any:
    """The covariance with a row and a column of zeros for the field, after hard and soft iron."""
    xp = array_module(matrix)
    order = np.insert(np.arange(len(matrix)), 12, 0)
    there = np.insert(np.ones(len(matrix)), 12, 0.0)
    return xp.where(np.outer(there, there) > 0, matrix[np.ix_(order, order)], 0.0)
