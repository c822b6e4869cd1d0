"""Findings about the residuals of a surface, and which readings are fitted."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._answer import Finding
from ..evidence._values import clipped, held
from ._design._heading_error import Information
from ._ellipsoid._algebraic import extents
from ._ellipsoid._causes import BENT, FAST, Cause
from ._ellipsoid._robust import sound, thinned
from ._ellipsoid._shape import NEAR_PLANAR, Found
from ._findings import FINDINGS

LONG = 20_000  # largest number of readings that are all fitted
_SINGULAR = 1e8  # condition number, 3 for even coverage, at which a combination is lost in rounding
_BY_NOISE = 0.5  # share of the information that is due to noise alone
_FAR_OFF = 1.25  # ratio of mean field and given one: a sensitivity is true to 10 %, so that the unit is wrong


def chosen_rows(m: np.ndarray) -> tuple[np.ndarray, int]:
    """Indices of the readings to fit, without spikes, repeats and saturated ones, and thinned if many; number of saturated ones."""
    full = clipped(m)
    used = np.flatnonzero(~full & ~held(m))
    used = used[sound(m[used])]
    if len(used) > LONG:
        used = used[thinned(m[used])]
    return used, int(full.sum())


def from_structure(found: Found, u: np.ndarray, told: Information) -> list[Finding]:
    """Findings that lie in the geometry of the readings, and those about the convergence of the fit."""
    if extents(u - u.mean(axis=0))[-1] < NEAR_PLANAR:
        return [FINDINGS("near_planar")]
    if not told.condition <= _SINGULAR or not np.isfinite(found.covariance).all() or told.by_noise > _BY_NOISE:
        return [FINDINGS("undetermined", what=told.weakest)]
    said = [] if found.converged else [FINDINGS("not_converged", what=told.weakest)]
    return said + FINDINGS.over("hardly", told.condition, what=told.weakest)


def from_field(mean: float, norm: float | None) -> list[Finding]:
    """A finding if the readings have another field than the given one."""
    if norm is None or 1 / _FAR_OFF <= mean / norm <= _FAR_OFF:
        return []
    return [FINDINGS("field_differs", found=mean, given=norm)]


def from_causes(causes: Sequence[Cause], costs: Sequence[float]) -> list[Finding]:
    """Findings about what the residuals follow; their costs are heading errors in rad at level."""
    findings = []
    for cause, cost in zip(causes, costs, strict=True):
        code = {FAST: "averaged", BENT: "bent"}.get(cause.name, "follows")
        what: dict[str, Any] = {"what": cause.name} if code == "follows" else {}
        findings.append(FINDINGS(code, cost=cost, size=100 * cause.size, **what))
    return findings
