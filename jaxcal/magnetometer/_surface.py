"""The surface through the readings: its kind, its fit, and what the readings cannot show of it."""

from typing import Any, NamedTuple

import numpy as np

from .._answer import Finding
from ._design._heading_error import both_tilts, by_iron, rms_heading
from ._ellipsoid._algebraic import consistent, constrained, extents
from ._ellipsoid._kinds import COUNT, parameters_of
from ._ellipsoid._orthogonal import described, flat, left_out, refined
from ._ellipsoid._select import candidates, score
from ._ellipsoid._shape import NEAR_PLANAR, Found, Frame, between, iron_slopes, model_of, radius_of, soft_of
from ._findings import FINDINGS
from ._iron import EXACT


class Surface(NamedTuple):
    """A fitted surface, the finding why there is none, or the normal of the plane of the readings.

    u : scaled readings. unseen : (12,) bias due to terms that a smaller model leaves out. said : findings.
    """

    refused: Finding | None = None
    plane: Any = None
    found: Any = None
    frame: Any = None
    u: Any = None
    unseen: Any = np.zeros(12)
    said: tuple[Finding, ...] = ()


def surface_of(m: np.ndarray, method: str, model: str, limit: tuple[float, float]) -> Surface:
    """The surface through readings (n, 3); `limit`: a dip, and the heading error that a good fit may have there.

    Raises
    ------
    NotEllipsoid
        If the readings lie on another quadric.
    """
    count, frame = _distinct(m), Frame.of(m)
    least = "sphere" if model in ("auto", "planar") and method == "ml" else "symmetric" if model == "auto" else model
    if count <= COUNT[least] or frame.scale < EXACT * np.abs(m).max():
        return Surface(FINDINGS("few", count=count, model=least, least=COUNT[least] + 1))
    u = frame.scaled(m)
    spread = extents(u)
    if spread[1] < NEAR_PLANAR:
        return Surface(FINDINGS("line"))
    if model == "planar" or (spread[2] < NEAR_PLANAR and model == "auto" and method == "ml"):
        normal = np.linalg.svd(u, full_matrices=False)[2][2]
        return Surface(plane=normal * np.sign(normal[np.argmax(np.abs(normal))]))
    if method != "ml":
        shape, centre = constrained(u) if method == "constrained" else consistent(u)
        return Surface(found=described(parameters_of(least, soft_of(shape), centre), u, least), frame=frame, u=u)
    if model != "auto":
        return Surface(found=refined(flat(u, model), u), frame=frame, u=u)
    fits, occupied = candidates(u, count)
    chosen = min(fits.values(), key=lambda found: score(found.distance, found.kind, occupied))
    return Surface(None, None, refined(chosen, u), frame, u, left_out(fits, chosen), _unseen(fits, chosen, frame, *limit))


def _distinct(m: np.ndarray) -> int:
    """Number of distinct readings; only the first few are counted where these suffice for any model."""
    few = len(np.unique(m[: 2**6], axis=0))
    return few if few > COUNT["symmetric"] else len(np.unique(m, axis=0))


def iron_of(found: Found, frame: Frame, norm: Any) -> tuple[Any, Any, Any]:
    """The model of an ellipsoid, the magnitude of its field, and the derivative (13, 12) of iron and field by S and the centre."""
    size = radius_of(found.soft) if norm is None else norm / frame.scale
    slopes = iron_slopes(found.soft * frame.scale, size * frame.scale, norm is not None) * frame.scale
    return model_of(found.soft, found.centre, frame, size), size * frame.scale, slopes


def _unseen(fits: dict[str, Found], chosen: Found, frame: Frame, dip: float, limit: float) -> tuple[Finding, ...]:
    """A finding if a smaller model was fitted because the readings cannot show the largest one."""
    full = fits.get("symmetric")
    if chosen is full:
        return ()
    if full is not None and full.converged:
        iron, field, slopes = iron_of(full, frame, None)
        if rms_heading(both_tilts(by_iron(iron, field), dip), between(slopes, full.spread))[0] <= limit:
            return ()
    return (FINDINGS("small_model", what="a full soft iron matrix", model=chosen.kind),)
