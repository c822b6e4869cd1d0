"""`fit` under `jit`, `vmap` and `grad`: maximum likelihood with a given model, without a verdict."""

import functools
from typing import Any

import jax
import jax.numpy as jnp

from .._errors import DataError
from ._checked import norm_and_dip
from ._design._heading_error import heading_error
from ._ellipsoid._kinds import COUNT, PLANAR, SOLID
from ._ellipsoid._orthogonal import estimate
from ._ellipsoid._shape import Frame, covariance_of, in_plane, model_of, radius_of
from ._iron import by_surface, estimated
from ._own_model import one_by_one
from ._result import MagFit, not_judged


def fit_traced(m: Any, model: str, field: Any, inclination: Any, refused: list[str]) -> MagFit:
    """The traced fit; `refused` names options that were given and are decided on the host."""
    if model not in (*SOLID, "planar") or refused:
        said = ", ".join(f"`{name}`" for name in refused) or f"model={model!r}"
        raise DataError(
            "A traced fit has its structure fixed by model='sphere', 'diagonal', 'symmetric' or 'planar' and method='ml'; "
            f"{said} is decided on the host. Leave it out, or call `fit` outside of jit, vmap and grad.", code="traced_options",
        )  # fmt: skip
    kind = "ellipse" if model == "planar" else model
    if m.ndim != 2 or m.shape[1] != 3 or len(m) <= COUNT[kind]:
        raise DataError(f"The readings have shape {m.shape}; model {model!r} needs (n, 3) with at least {COUNT[kind] + 1} rows.",
                        code="bad_shape")  # fmt: skip
    norm, dip = norm_and_dip(field, inclination, model)
    told = one_by_one(functools.partial(_pure, kind), dip, m, norm)
    estimate = estimated(told["model"], told["field"], told.pop("covariance"), float(max(len(m) - COUNT[kind], 1)), None, norm is not None,
                         told["plane"])  # fmt: skip
    return not_judged(dip, kind, estimate=estimate, **told)


def _pure(kind: str, dip: float, m: Any, norm: Any) -> dict[str, Any]:
    """The results of a traced fit, from the readings and the magnitude of the field."""
    frame = Frame.of(m)
    u = frame.scaled(m)
    plane = _plane(u) if kind in PLANAR else None
    found = estimate(u if plane is None else in_plane(u, plane), kind)
    size = radius_of(found.shape, plane is not None) if norm is None else norm / frame.scale
    iron, field = model_of(found.shape, found.centre, frame, size, plane), size * frame.scale
    matrix = by_surface(iron.soft_iron, field, covariance_of(found, frame), norm is not None, plane)
    return {
        "model": iron, "covariance": matrix, "field": field,
        "heading_error": heading_error(iron, field, matrix[:12, :12], dip, plane=plane),
        "noise": found.noise * frame.scale, "plane": plane, "residual": found.distance * frame.scale,
    }  # fmt: skip


def _plane(u: Any) -> Any:
    """Axes of the plane nearest to the readings, and its normal, (3, 3), with the derivative of the normal.

    A rotation about the normal changes nothing, so it has no derivative.
    """
    scatter = u.T @ u
    values, axes = jax.lax.stop_gradient(jnp.linalg.eigh(scatter))
    normal, inside = axes[:, 0], axes[:, :0:-1].T
    tilt = inside @ scatter @ normal / (values[:0:-1] - values[0])  # its value is zero, only its derivative matters
    return jnp.concatenate([inside + tilt[:, None] * normal[None, :], (normal - tilt @ inside)[None, :]])
