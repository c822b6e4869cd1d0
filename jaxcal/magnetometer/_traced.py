"""`fit` under `jit`, `vmap` and `grad`: maximum likelihood with a given model, without a verdict."""

import functools
from collections.abc import Callable
from typing import Any

import jax

from .._errors import DataError
from ._checked import norm_and_dip
from ._design._heading_error import both_tilts, by_iron, rms_heading
from ._ellipsoid._kinds import COUNT
from ._ellipsoid._orthogonal import estimate
from ._ellipsoid._shape import Frame, between
from ._iron import estimated
from ._result import MagFit, not_judged
from ._surface import iron_of


@functools.partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def one_by_one(pure: Callable, dip: float, *given: Any) -> Any:
    """`pure(dip, *given)`; a batch runs item by item, because LAPACK may hang otherwise, and each item takes only its own steps."""
    return jax.custom_batching.sequential_vmap(functools.partial(pure, dip))(*given)


# derivatives of a batch still run together, because `custom_vmap` has none
@one_by_one.defjvp
def _(pure: Callable, dip: float, primals: tuple, tangents: tuple) -> tuple:
    return jax.jvp(functools.partial(pure, dip), primals, tangents)


def fit_traced(m: Any, model: Any, field: Any, inclination: Any, refused: list[str]) -> MagFit:
    """The traced fit; `refused` names options that were given and are decided on the host."""
    if model not in COUNT or refused:
        said = ", ".join(f"`{name}`" for name in refused) or f"model={model!r}"
        raise DataError(
            "A traced fit has its structure fixed by model='sphere', 'diagonal' or 'symmetric' and method='ml'; "
            f"{said} is decided on the host. Leave it out, or call `fit` outside of jit, vmap and grad.", code="traced_options",
        )  # fmt: skip
    if m.ndim != 2 or m.shape[1] != 3 or len(m) <= COUNT[model]:
        raise DataError(f"The readings have shape {m.shape}; model {model!r} needs (n, 3) with at least {COUNT[model] + 1} rows.",
                        code="bad_shape")  # fmt: skip
    norm, dip = norm_and_dip(field, inclination)
    told = one_by_one(functools.partial(_pure, model), dip, m, norm)
    freedom = float(max(len(m) - COUNT[model], 1))
    known = estimated(told["model"], told["field"], told.pop("covariance"), freedom, held=norm is not None)
    return not_judged(dip, model, estimate=known, **told)


def _pure(kind: str, dip: float, m: Any, norm: Any) -> dict[str, Any]:
    """The results of a traced fit, from the readings and the magnitude of the field."""
    frame = Frame.of(m)
    found = estimate(frame.scaled(m), kind)
    iron, field, slopes = iron_of(found, frame, norm)
    matrix = between(slopes, found.spread)
    return {
        "model": iron, "covariance": matrix, "field": field, "heading_error": rms_heading(both_tilts(by_iron(iron, field), dip), matrix),
        "noise": found.noise * frame.scale, "residual": found.distance * frame.scale,
    }  # fmt: skip
