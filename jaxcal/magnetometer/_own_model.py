"""`fit` of the leaves of a model object: a `MagModel`, or a subclass of it with fields of its own.

Field magnitudes do not determine a common rotation. So the soft iron is S Q with a symmetric S, which is fitted, and the rotation Q of
the start, which is kept. All other floating leaves are fitted unchanged.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._errors import DataError
from .._types import Array
from ..fitting import Fit, covariance, identifiability, is_white, leave_out, solve
from ..fitting._serial import BLOCKS, doubt
from ._design._coverage import covered
from ._design._heading_error import rms_heading
from ._ellipsoid._algebraic import extents, traced_start
from ._ellipsoid._causes import SERIAL
from ._ellipsoid._kinds import basis_of, shape_and_centre
from ._ellipsoid._orthogonal import CURVED
from ._ellipsoid._residuals import surface_distances
from ._ellipsoid._shape import Frame, model_of, radius_of
from ._model import MagModel
from ._result import NEAR_PLANAR, NEAR_PLANAR_SENTENCE, NOT_JUDGED, UNEVEN, MagFit, Reasons, expected, outliers, refusal

_ENTRY = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
_UPPER = np.triu_indices(3)
_SOFT = [f"soft_iron[{i},{j}]" for i, j in zip(*_UPPER, strict=True)]
_PRECISE = 1e-8


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


def changes_of(found: MagFit, directions: np.ndarray) -> np.ndarray:
    """`_changes` for a finished fit of a model object (host only)."""
    model: Any = found.model
    left, _, right = np.linalg.svd(np.asarray(model.soft_iron))
    turn = left @ right
    leaves = Leaves((np.asarray(model.soft_iron) @ turn.T)[_UPPER], eqx.tree_at(lambda m: m.soft_iron, model, None))
    return np.asarray(_changes_compiled(leaves, turn, found.field, found.usual, directions))


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
        "model": fitted, "covariance": matrix, "residual": found.residuals, "noise": noise, "field": norm, "values": found.parameters,
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
    m: Any, model: MagModel, norm: Any, dip: float, conditions: dict[str, Any], limits: tuple[float, float], traced: bool
) -> MagFit:
    """`fit` for a model object; `norm` and `dip` describe the field."""
    conditions = {name: jnp.asarray(value, dtype=float) for name, value in conditions.items()}
    for name, value in conditions.items():
        if value.ndim < 1 or len(value) != len(m):
            raise DataError(f"The condition {name!r} has shape {value.shape}; give one row for each of {len(m)} readings.")
        if not traced and not np.isfinite(value).all():
            raise DataError(f"The condition {name!r} has values that are not finite; leave those readings out.")
    model = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=m.dtype), model)
    count = sum(leaf.size for leaf in jax.tree.leaves(model)) - 3
    if len(m) <= count:
        raise DataError(f"There are {len(m)} readings; this model has {count} parameters and needs at least {count + 1}.")
    found, told = (one_by_one if traced else _compiled)(_pure, dip, model, jnp.asarray(m), norm, conditions)
    names = (*_SOFT, *(name.removeprefix("rest.") for name in found.names[6:]))
    result = dataclasses.replace(
        refusal("ml", dip, NOT_JUDGED), verdict="not judged", names=names, used=len(m), kind=type(model).__name__, **told
    )
    if traced:
        return result
    result = jax.tree.map(lambda leaf: np.asarray(leaf) if eqx.is_array(leaf) else leaf, result)
    noise, field = float(result.noise), float(result.field)
    y = np.asarray(result.model.correct(jnp.asarray(m), **conditions))  # type: ignore[union-attr]
    back = np.asarray(result.model.measure(jnp.asarray(y), **conditions))  # type: ignore[union-attr]
    if not np.allclose(back, m, rtol=1e-6, atol=1e-6 * np.abs(m).max()):
        raise DataError(f"`measure` and `correct` of {result.kind} do not undo one another; `correct` must be its inverse.")
    far = outliers(result.residual / field)
    identified, reasons, doubtful = identifiability(found), Reasons([], []), 0.0
    jacobian, left = np.asarray(found.jacobian), np.asarray(found.residuals)
    if np.isfinite(result.covariance).all() and noise > 1e-9 * field and not is_white(jacobian, left):
        matrix = leave_out(jacobian, left)
        error = np.asarray(rms_heading(functools.partial(changes_of, result), matrix, dip))
        said = (
            f"The noise is correlated from reading to reading; the errors are those between fits without parts of the log ({BLOCKS} parts)."
        )
        result = dataclasses.replace(
            result, covariance=matrix, heading_error=error, blocks=BLOCKS, causes={SERIAL: float(error[0])}, warnings=(said,)
        )
        doubtful = doubt(BLOCKS - 1) * float(error[0])
    if not bool(found.usable) or not np.isfinite(result.covariance).all():
        reasons.refused.append(f"The fit has no solution that the readings determine: {found.message} {identified.sentence}")
    elif extents(Frame.of(m).scaled(m))[-1] < NEAR_PLANAR:
        reasons.refused.append(NEAR_PLANAR_SENTENCE.partition(", or use")[0] + ".")
    elif not reasons.heading(result.heading_error, limits, f". {identified.sentence}") and doubtful > limits[0]:
        reasons.weak.append(f"{UNEVEN}: the heading may be wrong by {np.rad2deg(doubtful):.2g} degrees rms.")
    reasons.scatter(noise / field, "surface of this model")
    reasons.outliers(len(far), len(m))
    said = reasons.text(f"The {expected(result.heading_error)}, excluding a rotation common to all readings.")
    return dataclasses.replace(
        result, verdict=reasons.verdict, reason=said, coverage=covered(y), outliers=far,
        condition=float(identified.condition), noise=noise, field=field,
    )  # fmt: skip
