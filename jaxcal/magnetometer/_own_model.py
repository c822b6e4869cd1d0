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
from .._precision import is_traced
from .._types import Array
from ..fitting import Fit, covariance, identifiability, solve
from ..fitting._serial import is_white, leave_out
from ._checked import checked, norm_and_dip
from ._design._coverage import covered
from ._design._heading_error import rms_heading
from ._ellipsoid._algebraic import extents, traced_start
from ._ellipsoid._kinds import basis_of, shape_and_centre
from ._ellipsoid._orthogonal import CURVED
from ._ellipsoid._residuals import surface_distances
from ._ellipsoid._shape import NEAR_PLANAR, Frame, model_of, radius_of
from ._findings import FINDINGS
from ._judge import by_readings, outliers
from ._model import MagModel
from ._result import Facts, MagFit, finished, not_judged, unfitted

_ENTRY = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
_UPPER = np.triu_indices(3)
_SOFT = [f"soft_iron[{i},{j}]" for i, j in zip(*_UPPER, strict=True)]
_PRECISE = 1e-8  # remaining step, relative to the statistical uncertainty
_EXACT = 1e-9  # share of the field below which residuals are rounding, not noise


class Leaves(eqx.Module):
    """The fitted leaves: six entries of S, and the model without its soft iron."""

    soft_iron: Any
    rest: MagModel

    def model(self, turn: Array) -> MagModel:
        """The model with soft iron S Q."""
        return eqx.tree_at(lambda m: m.soft_iron, self.rest, self.soft_iron[_ENTRY] @ turn, is_leaf=lambda leaf: leaf is None)


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
    given = Leaves((model.soft_iron @ turn.T)[_UPPER], eqx.tree_at(lambda m: m.soft_iron, model, None))
    other = Leaves(iron.soft_iron[_UPPER], eqx.tree_at(lambda r: r.hard_iron, given.rest, iron.hard_iron))
    cost = [jnp.nan_to_num(jnp.sum(surface_distances(x.model(turn), m, norm, conditions, 0.0) ** 2), nan=jnp.inf) for x in (given, other)]
    pick = lambda a, b: jnp.where(cost[1] < cost[0], b, a) if eqx.is_inexact_array(b) else a  # noqa: E731
    return jax.lax.stop_gradient(jax.tree.map(pick, given, other)), jax.lax.stop_gradient(turn), norm


def _changes(leaves: Leaves, turn: Array, norm: Any, usual: dict[str, Any], directions: Any) -> Array:
    """Derivative of corrected unit fields with respect to the fitted leaves, (n, 3, p), under the usual conditions."""
    there = {name: jnp.broadcast_to(value, (len(directions), *jnp.shape(value))) for name, value in usual.items()}
    readings = leaves.model(turn).measure(norm * jnp.asarray(directions), **there)
    slope = jax.jacfwd(lambda leaves: leaves.model(turn).correct(readings, **there))(leaves)
    return jnp.concatenate([x.reshape(*readings.shape, -1) for x in jax.tree.leaves(slope)], axis=-1) / norm


_changes_compiled = filter_jit(_changes)


def changes_of(model: Any, field: Any, usual: dict[str, Any], directions: np.ndarray) -> np.ndarray:
    """`_changes` for a fitted model object (host only)."""
    left, _, right = np.linalg.svd(np.asarray(model.soft_iron))
    turn = left @ right
    leaves = Leaves((np.asarray(model.soft_iron) @ turn.T)[_UPPER], eqx.tree_at(lambda m: m.soft_iron, model, None))
    return np.asarray(_changes_compiled(leaves, turn, field, usual, directions))


def _pure(dip: float, model: MagModel, m: Any, field: Any, conditions: Any) -> tuple[Fit, dict[str, Any]]:
    """The fit, and the fields of a `MagFit` that follow from it."""
    begin, turn, norm = _start(model, m, field, conditions)
    noise2 = jnp.zeros((), m.dtype)
    for last in (False, True):
        found = solve(_whitened, begin, (turn, m, norm, conditions, noise2), rtol=_PRECISE)
        variance = jnp.sum(found.residuals**2) / (len(m) - found.parameters.size)
        noise = jnp.sqrt(variance)
        if not last:
            noise2 = jnp.where((0.5 * norm > noise) & (noise > CURVED * norm), variance, 0.0)
            begin = jax.lax.stop_gradient(found.model)
    fitted, matrix = found.model.model(turn), covariance(found, scaled=True)
    usual = {name: jnp.median(jnp.asarray(value), axis=0) for name, value in conditions.items()}
    change = functools.partial(_changes, found.model, turn, norm, usual)
    return eqx.tree_at(lambda f: f.problem, found, None), {
        "model": fitted, "covariance": matrix, "residual": found.residuals, "noise": noise, "field": norm,
        "usual": usual,
        "heading_error": rms_heading(change, matrix, dip),
    }  # fmt: skip


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
    own, kind = (*_SOFT, *(name.removeprefix("rest.") for name in found.names[6:])), type(model).__name__
    facts = {"own": own, "usual": told.pop("usual"), "used": len(m), "limits": limits}
    if traced:
        return not_judged("ml", dip, kind, Facts(told.pop("covariance"), **facts), **told)
    told = jax.tree.map(lambda leaf: np.asarray(leaf) if eqx.is_array(leaf) else leaf, told)
    matrix, noise, field, fitted = told.pop("covariance"), float(told.pop("noise")), float(told.pop("field")), told["model"]
    y = np.asarray(fitted.correct(jnp.asarray(m), **conditions))
    back = np.asarray(fitted.measure(jnp.asarray(y), **conditions))
    if not np.allclose(back, m, rtol=1e-6, atol=1e-6 * np.abs(m).max()):
        raise DataError(f"`measure` and `correct` of {kind} do not undo one another; `correct` must be its inverse.", code="no_inverse")
    far, identified, known = outliers(told["residual"] / field), identifiability(found), []
    facts |= {"weakest": ", ".join(name.removeprefix("rest.") for name in identified.weakest), "condition": float(identified.condition)}
    error, jacobian, left = told.pop("heading_error"), np.asarray(found.jacobian), np.asarray(found.residuals)
    if np.isfinite(matrix).all() and noise > _EXACT * field and not is_white(jacobian, left):
        matrix = leave_out(jacobian, left)
        by_parts = np.asarray(rms_heading(functools.partial(changes_of, fitted, field, facts["usual"]), matrix, dip))
        matrix, error = matrix * max(error[0] / by_parts[0], 1.0) ** 2, by_parts * max(error[0] / by_parts[0], 1.0)
        known.append(FINDINGS("correlated", size=100 * noise / field))
        facts["parts"] = True
    if not bool(found.usable) or not np.isfinite(matrix).all():
        known.append(FINDINGS("undetermined", what=facts["weakest"] or "the model"))
    elif extents(Frame.of(m).scaled(m))[-1] < NEAR_PLANAR:
        known.append(FINDINGS("near_planar"))
    known += by_readings(noise / field, len(far), len(m))
    return finished(
        unfitted("ml", dip), kind=kind, _facts=Facts(matrix, known=tuple(known), **facts), noise=noise, field=field,
        heading_error=error, coverage=covered(y), outliers=far, **told,
    )  # fmt: skip
