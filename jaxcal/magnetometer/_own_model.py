"""`fit` of the leaves of a model object: a `MagModel`, or a subclass of it with fields of its own.

A fit of norms leaves a common rotation open, so the soft iron is S Q with S symmetric, which is fitted, and Q that of the start, which
is held. All other floating leaves are fitted as they are.
"""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._types import Array
from ..fitting import Fit, covariance, identifiability, solve
from ._design._coverage import covered
from ._design._heading_error import grids, grids_across, rms
from ._ellipsoid._algebraic import Frame, extents
from ._ellipsoid._orthogonal import CURVED
from ._ellipsoid._residuals import shape_and_centre, surface_distances
from ._ellipsoid._shape import model_of, radius_of
from ._ellipsoid._start import basis_of, traced_start
from ._model import MagModel
from ._result import NOT_JUDGED, MagFit
from ._verdict import NEAR_PLANAR, NEAR_PLANAR_SENTENCE, OUTLIER

_ENTRY = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
_UPPER = np.triu_indices(3)
_NOISY, _TOO_NOISY = 0.1, 0.2
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


def _pure(model: MagModel, m: Any, field: Any, conditions: Any, dip: float) -> tuple[Fit, dict[str, Any]]:
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
    known = jnp.all(jnp.isfinite(matrix))
    usual = {name: jnp.median(jnp.asarray(value), axis=0) for name, value in conditions.items()}
    errors = []
    for (_, directions), across in zip(grids(dip), grids_across(dip), strict=True):
        there = {name: jnp.broadcast_to(value, (len(directions), *value.shape)) for name, value in usual.items()}
        readings = fitted.measure(norm * directions, **there)
        slope = jax.jacfwd(lambda leaves, m=readings, there=there: leaves.model(turn).correct(m, **there))(found.model)
        flat = jnp.concatenate([x.reshape(*readings.shape, -1) for x in jax.tree.leaves(slope)], axis=-1) / norm
        errors.append(rms(jnp.einsum("ni,nip->np", across, flat), jnp.where(known, matrix, 0.0)))
    return eqx.tree_at(lambda f: f.problem, found, None), {
        "model": fitted, "covariance": matrix, "residual": found.residuals, "noise": noise, "field": norm, "values": found.parameters,
        "heading_error": jnp.where(known, jnp.stack(errors), jnp.inf),
    }  # fmt: skip


# one after another, as in `_fit`
@functools.partial(jax.custom_jvp, nondiff_argnums=(4,))
def _calibrated(model: MagModel, m: Any, field: Any, conditions: Any, dip: float) -> Any:
    return jax.custom_batching.sequential_vmap(lambda *given: _pure(*given, dip))(model, m, field, conditions)  # type: ignore[call-arg]


@_calibrated.defjvp
def _(dip: float, primals: tuple, tangents: tuple) -> tuple:
    return jax.jvp(lambda *given: _pure(*given, dip), primals, tangents)  # type: ignore[call-arg]


_compiled = eqx.filter_jit(_calibrated)


def _named(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the leaves by their paths in the model."""
    soft = [f"soft_iron[{i},{j}]" for i, j in zip(*_UPPER, strict=True)]
    return (*soft, *(name.removeprefix("rest.") for name in names[6:]))


def fit_model(
    m: Any, model: MagModel, norm: Any, dip: float, conditions: dict[str, Any], limits: tuple[float, float], traced: bool
) -> MagFit:
    """`fit` for a model object; `norm` and `dip` of the field, and conditions of one row a reading."""
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
    found, told = (_calibrated if traced else _compiled)(model, jnp.asarray(m), norm, conditions, dip)
    common: dict[str, Any] = {
        **told, "names": _named(found.names), "inclination": dip, "used": len(m), "kind": type(model).__name__, "method": "ml",
        "needed": np.zeros((0, 3)), "plane": None, "condition": np.inf, "coverage": None, "outliers": np.zeros(0, dtype=int),
    }  # fmt: skip
    if traced:
        return MagFit(verdict="not judged", reason=NOT_JUDGED, warnings=(), **common)
    told = jax.tree.map(np.asarray, told)
    y = np.asarray(told["model"].correct(jnp.asarray(m), **conditions))
    back = np.asarray(told["model"].measure(jnp.asarray(y), **conditions))
    if not np.allclose(back, m, rtol=1e-6, atol=1e-6 * np.abs(m).max()):
        raise DataError(f"`measure` and `correct` of {type(model).__name__} do not undo one another; `correct` must be its inverse.")
    off, size = np.abs(told["residual"]), float(told["noise"]) / float(told["field"])
    far = np.flatnonzero(off > max(OUTLIER * 1.4826 * np.median(off), 1e-9 * float(told["field"])))
    identified = identifiability(found)
    level, tilted = np.rad2deg(told["heading_error"])
    least, most = np.rad2deg(limits)
    refused, weak = [], []
    if not bool(found.usable) or not np.isfinite(told["covariance"]).all():
        refused.append(f"The fit has no solution that the readings determine: {found.message} {identified.sentence}")
    elif extents(Frame.of(m).scaled(m))[-1] < NEAR_PLANAR:
        refused.append(NEAR_PLANAR_SENTENCE.partition(", or use")[0] + ".")
    elif not level <= least:
        (weak if level <= most else refused).append(f"The heading would be wrong by {level:.2g} degrees rms. {identified.sentence}")
    if size > _NOISY:
        (refused if size > _TOO_NOISY else weak).append(f"The readings scatter by {100 * size:.0f} % of the field about the model.")
    if len(far) > max(0.01 * len(m), 2):
        weak.append(f"{len(far)} of {len(m)} readings are outliers; leave them out.")
    said = f"The heading error to expect is {level:.2g} degrees rms at level and {tilted:.2g} at 20 degrees of tilt, but for the rotation."
    return MagFit(**common | told | {
        "verdict": "refused" if refused else "weak" if weak else "good", "reason": " ".join([*refused, *weak]) or said, "warnings": (),
        "coverage": covered(y), "outliers": far, "condition": float(identified.condition), "noise": float(told["noise"]),
        "field": float(told["field"]),
    })  # fmt: skip
