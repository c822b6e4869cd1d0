"""The fit of a fixed kind under `jit`, `vmap` and `grad`."""

import dataclasses
import functools
from typing import Any

import jax

from .._errors import DataError
from ._checks import SOLID, norm_and_dip
from ._design._heading_error import heading_error
from ._ellipsoid._algebraic import Frame
from ._ellipsoid._orthogonal import estimate
from ._ellipsoid._shape import covariance_of, model_of, radius_of
from ._ellipsoid._start import COUNT
from ._result import NOT_JUDGED, MagFit, refusal


def traced(m: Any, kind: str, field: Any, inclination: Any, refused: list[str]) -> MagFit:
    """The fit under `jit`, `vmap` and `grad`: of a given kind by maximum likelihood, not judged."""
    if kind not in SOLID or refused:
        said = ", ".join(f"`{name}`" for name in refused) or f"model={kind!r}"
        raise DataError(
            f"A traced fit has its structure fixed by model='sphere', 'diagonal' or 'symmetric' and method='ml'; {said} is decided on the "
            "host. Leave it out, or call `fit` outside of jit, vmap and grad."
        )
    if m.ndim != 2 or m.shape[1] != 3 or len(m) <= COUNT[kind]:
        raise DataError(f"The readings have shape {m.shape}; model {kind!r} needs (n, 3) with at least {COUNT[kind] + 1} rows.")
    norm, dip = norm_and_dip(field, inclination)
    return dataclasses.replace(
        refusal("ml", dip, NOT_JUDGED), verdict="not judged", kind=kind, used=len(m), **_calibrated(m, norm, kind, dip)
    )


def _pure(m: Any, norm: Any, kind: str, dip: float) -> dict[str, Any]:
    """What a traced fit knows, from the readings and the norm of the field."""
    frame = Frame.of(m)
    found = estimate(frame.scaled(m), kind)
    size = radius_of(found.shape) if norm is None else norm / frame.scale
    covariance = covariance_of(found, frame)
    return {
        "model": model_of(found.shape, found.centre, frame, size), "covariance": covariance, "residual": found.distance * frame.scale,
        "heading_error": heading_error(found.shape / frame.scale**2, covariance, dip), "noise": found.noise * frame.scale,
        "field": size * frame.scale,
    }  # fmt: skip


# Many fits run one after another, each in as few steps as it needs: a batch would take as many as the slowest, and stands still now and
# then in LAPACK. A batch of derivatives is one all the same, as `custom_vmap` has none.
@functools.partial(jax.custom_jvp, nondiff_argnums=(2, 3))
def _calibrated(m: Any, norm: Any, kind: str, dip: float) -> dict[str, Any]:
    return jax.custom_batching.sequential_vmap(lambda m, norm: _pure(m, norm, kind, dip))(m, norm)


@_calibrated.defjvp
def _(kind: str, dip: float, primals: tuple, tangents: tuple) -> tuple:
    return jax.jvp(lambda m, norm: _pure(m, norm, kind, dip), primals, tangents)
