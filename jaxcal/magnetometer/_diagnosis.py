"""Findings about the residuals of a surface, and which readings are fitted."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._answer import Finding
from ..evidence._values import clipped, held
from ._ellipsoid._algebraic import extents
from ._ellipsoid._causes import BENT, FAST, Cause
from ._ellipsoid._robust import sound, thinned
from ._ellipsoid._shape import NEAR_PLANAR, Found
from ._findings import FINDINGS

LONG = 20_000  # largest number of readings that are all fitted


def chosen_rows(m: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Rows of the readings to fit, without spikes, repeats and saturated ones, thinned if many; the readings; number of saturated ones."""
    full = clipped(m)
    used = np.flatnonzero(~full & ~held(m))
    near, readings = sound(m[used])
    used = used[near]
    if len(used) > LONG:
        few = thinned(readings)
        used, readings = used[few], readings[few]
    return used, readings, int(full.sum())


def from_structure(found: Found, u: np.ndarray, condition: float, weakest: str) -> list[Finding]:
    """Findings that lie in the geometry of the readings, and those about the convergence of the fit."""
    if extents(u - u.mean(axis=0))[-1] < NEAR_PLANAR:
        return [FINDINGS("near_planar")]
    if not np.isfinite(found.covariance).all() or FINDINGS.over("undetermined", condition, what=weakest):
        return [FINDINGS("undetermined", what=weakest)]
    return [] if found.converged else [FINDINGS("not_converged", what=weakest)]


def from_causes(causes: Sequence[Cause], costs: Sequence[float]) -> list[Finding]:
    """Findings about what the residuals follow; their costs are heading errors in rad at level."""
    findings = []
    for cause, cost in zip(causes, costs, strict=True):
        code = {FAST: "averaged", BENT: "bent"}.get(cause.name, "follows")
        what: dict[str, Any] = {"what": cause.name} if code == "follows" else {}
        findings.append(FINDINGS(code, cost=cost, size=100 * cause.size, **what))
    return findings
