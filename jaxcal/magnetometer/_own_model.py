"""`fit` of the leaves of a model object: a `MagModel`, or a subclass of it with fields of its own.

A fit of norms leaves a common rotation open, so the soft iron is S Q with S symmetric, which is fitted, and Q that of the start, which
is held. All other floating leaves are fitted as they are.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import is_traced
from .._types import Array
from ..fitting import Fit, covariance, identifiability, solve
from ._checks import checked, norm_and_dip
from ._design._coverage import covered
from ._design._heading_error import rms_heading
from ._ellipsoid._algebraic import extents, traced_start
from ._ellipsoid._kinds import basis_of, shape_and_centre
from ._ellipsoid._orthogonal import CURVED
from ._ellipsoid._residuals import surface_distances
from ._ellipsoid._shape import Frame, model_of, radius_of
from ._model import MagModel
from ._result import NEAR_PLANAR, NEAR_PLANAR_SENTENCE, NOT_JUDGED, OUTLIER, MagFit, Reasons, refusal

_ENTRY = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
_UPPER = np.triu_indices(3)
_PRECISE = 1e-8


class Leaves(eqx.Module):
    """What is fitted: six entries of S, and the model without its soft iron."""

    soft_iron: Any
    rest: MagModel

    def model(self, turn: Array) -> MagModel:
        """The model with soft iron S Q."""
        return eqx.tree_at(lambda m: m.soft_iron, self.rest, self.soft_iron[_ENTRY] @ turn, is_leaf=lambda leaf: leaf is None)


def _leaves(model: MagModel) -> tuple[Leaves, Array]:
    """Leaves of a model, and Q of its polar decomposition S Q."""
    left, _, right = jnp.linalg.svd(jnp.asarray(model.soft_iron))
    turn = left @ right
    return Leaves((jnp.asarray(model.soft_iron) @ turn.T)[_UPPER], eqx.tree_at(lambda m: m.soft_iron, model, None)), turn


class Given(eqx.Module):
    """Readings, norm of the field, conditions, variance of the curvature term, and Q."""

    m: Any
    field: Any
    conditions: Any
    noise2: Any
    turn: Any


def _whitened(leaves: Leaves, data: Given) -> Array:
    return surface_distances(leaves.model(data.turn), data.m, data.field, data.conditions, data.noise2)


def _start(model: MagModel, m: Any, field: Any, conditions: Any) -> tuple[Leaves, Array, Any]:
    """The given model, or that with the iron of the algebraic fit where its distances are less; Q; and the norm of the field."""
    frame = Frame.of(m)
    shape, centre = shape_and_centre(traced_start(frame.scaled(m), "symmetric"), basis_of("symmetric"))
    norm = radius_of(shape) * frame.scale if field is None else jnp.asarray(field, dtype=m.dtype)
    iron = model_of(shape, centre, frame, norm / frame.scale)
    given, turn = _leaves(model)
    other = Leaves(iron.soft_iron[_UPPER], eqx.tree_at(lambda r: r.hard_iron, given.rest, iron.hard_iron))
    cost = [jnp.nan_to_num(jnp.sum(surface_distances(x.model(turn), m, norm, conditions, 0.0) ** 2), nan=jnp.inf) for x in (given, other)]
    pick = lambda a, b: jnp.where(cost[1] < cost[0], b, a) if eqx.is_inexact_array(b) else a  # noqa: E731
    return jax.lax.stop_gradient(jax.tree.map(pick, given, other)), jax.lax.stop_gradient(turn), norm


def _pure(dip: float, model: MagModel, m: Any, field: Any, conditions: Any) -> tuple[Fit, dict[str, Any]]:
    """The fit, and what a `MagFit` has of it."""
    begin, turn, norm = _start(model, m, field, conditions)
    noise2 = jnp.zeros((), m.dtype)
    for last in (False, True):
        found = solve(_whitened, begin, Given(m, norm, conditions, noise2, turn), rtol=_PRECISE)
        variance = jnp.sum(found.residuals**2) / (len(m) - found.parameters.size)
        noise = jnp.sqrt(variance)
        if not last:
            noise2 = jnp.where((0.5 * norm > noise) & (noise > CURVED * norm), variance, 0.0)
            begin = jax.lax.stop_gradient(found.model)
    fitted, matrix = found.model.model(turn), covariance(found, scaled=True)
    usual = {name: jnp.median(jnp.asarray(value), axis=0) for name, value in conditions.items()}

    def change(directions: Any) -> Array:
        there = {name: jnp.broadcast_to(value, (len(directions), *value.shape)) for name, value in usual.items()}
        readings = fitted.measure(norm * directions, **there)
        slope = jax.jacfwd(lambda leaves: leaves.model(turn).correct(readings, **there))(found.model)
        return jnp.concatenate([x.reshape(*readings.shape, -1) for x in jax.tree.leaves(slope)], axis=-1) / norm

    return eqx.tree_at(lambda f: f.problem, found, None), {
        "model": fitted, "covariance": matrix, "residual": found.residuals, "noise": noise, "field": norm, "values": found.parameters,
        "heading_error": rms_heading(change, matrix, dip),
    }  # fmt: skip


@functools.partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def one_by_one(pure: Callable, dip: float, *given: Any) -> Any:
    """`pure(dip, *given)`, of which a batch runs one after another, each in as few steps as it needs.

    Together they would all take as many steps as the slowest, and stand still now and then in LAPACK. Their derivatives run together all
    the same, as `custom_vmap` has none.
    """
    return jax.custom_batching.sequential_vmap(functools.partial(pure, dip))(*given)


@one_by_one.defjvp
def _(pure: Callable, dip: float, primals: tuple, tangents: tuple) -> tuple:
    return jax.jvp(functools.partial(pure, dip), primals, tangents)


_compiled = eqx.filter_jit(one_by_one)


def _named(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the leaves by their paths in the model."""
    soft = [f"soft_iron[{i},{j}]" for i, j in zip(*_UPPER, strict=True)]
    return (*soft, *(name.removeprefix("rest.") for name in names[6:]))


def fit_model(m: Any, model: MagModel, field: Any, inclination: Any, conditions: dict[str, Any], limits: tuple[float, float]) -> MagFit:
    """`fit` for a model object."""
    if traced := is_traced(m, model, field, conditions):
        norm, dip = norm_and_dip(field, inclination)
    else:
        m, norm, dip = checked(m, "ml", "auto", field, None, inclination, "bic", 0.0, None)
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
    result = dataclasses.replace(
        refusal("ml", dip, NOT_JUDGED), verdict="not judged", names=_named(found.names), used=len(m), kind=type(model).__name__, **told
    )
    return result if traced else _judged(result, found, m, conditions, limits)


def _judged(result: MagFit, found: Fit, m: np.ndarray, conditions: dict[str, Any], limits: tuple[float, float]) -> MagFit:
    result = jax.tree.map(lambda leaf: np.asarray(leaf) if eqx.is_array(leaf) else leaf, result)
    noise, field = float(result.noise), float(result.field)
    y = np.asarray(result.model.correct(jnp.asarray(m), **conditions))  # type: ignore[union-attr]
    back = np.asarray(result.model.measure(jnp.asarray(y), **conditions))  # type: ignore[union-attr]
    if not np.allclose(back, m, rtol=1e-6, atol=1e-6 * np.abs(m).max()):
        raise DataError(f"`measure` and `correct` of {result.kind} do not undo one another; `correct` must be its inverse.")
    off = np.abs(result.residual)
    far = np.flatnonzero(off > max(OUTLIER * 1.4826 * np.median(off), 1e-9 * field))
    identified, reasons = identifiability(found), Reasons([], [])
    if not bool(found.usable) or not np.isfinite(result.covariance).all():
        reasons.refused.append(f"The fit has no solution that the readings determine: {found.message} {identified.sentence}")
    elif extents(Frame.of(m).scaled(m))[-1] < NEAR_PLANAR:
        reasons.refused.append(NEAR_PLANAR_SENTENCE.partition(", or use")[0] + ".")
    else:
        reasons.heading(result.heading_error, limits, f". {identified.sentence}")
    reasons.scatter(noise / field, "surface of this model")
    reasons.outliers(len(far), len(m))
    level, tilted = np.rad2deg(result.heading_error)
    said = f"The heading error to expect is {level:.2g} degrees rms at level and {tilted:.2g} at 20 degrees of tilt, but for the rotation."
    return dataclasses.replace(
        result, verdict=reasons.verdict, reason=reasons.text() or said, coverage=covered(y), outliers=far,
        condition=float(identified.condition), noise=noise, field=field,
    )  # fmt: skip
