"""Findings about the residuals of a surface, the heading errors of what they follow, and readings at the end of a range."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding
from ..evidence._values import held
from ._design._heading_error import Information, heading_departure
from ._ellipsoid._algebraic import NotEllipsoid, extents
from ._ellipsoid._causes import BENT, FAST, Examined
from ._ellipsoid._kinds import COUNT, PLANAR
from ._ellipsoid._orthogonal import flat
from ._ellipsoid._robust import sound, thinned
from ._ellipsoid._select import LONG
from ._ellipsoid._shape import NEAR_PLANAR, Found, radius_of
from ._findings import FINDINGS
from ._surface import distinct

_ILL, _SINGULAR = 1000.0, 1e8  # condition numbers: 3 for even coverage; of a thousand, a digit of the noise is a hundred of the error
_BY_NOISE, _BY_PENALTY = 0.5, 0.5  # share of the information due to noise alone; standard errors of a bias that an interval would miss
_FAR_OFF = 1.25  # ratio of mean field and given one: a sensitivity is true to 10 %, so that the unit is wrong

_FEWEST_AT_END, _NEAR = 4, 20  # equal largest values, and readings next to them, whose density tells how many may be equal by chance
_BY_CHANCE, _APART = 1e-5, 0.05  # one false alarm in 16,000 logs of six ends; share of the log's size, since a sensor at rest repeats too


def at_end(m: np.ndarray) -> np.ndarray:
    """Find readings (n,) of a saturated sensor: the largest or smallest value of an axis occurs more often than chance allows.

    Chance follows a Poisson distribution. Its mean is the density of the readings next to the end, times the step between values.
    """
    out, distinct = np.zeros(len(m), dtype=bool), None
    for axis in range(3):
        for sign in (1.0, -1.0):
            column = sign * m[:, axis]
            if np.sum(column == column.max()) < _FEWEST_AT_END:
                continue
            if distinct is None:
                distinct, size = np.unique(m, axis=0), float(np.std(m, axis=0).max())
            values = np.sort(sign * distinct[:, axis])[::-1]
            count = int(np.sum(values == values[0]))
            if count < _FEWEST_AT_END or count + _NEAR > len(values):
                continue
            below = values[count - 1 : count + _NEAR]
            steps = -np.diff(below)
            chance = _NEAR * steps[steps > 0].min() / (below[0] - below[-1])
            pile = distinct[sign * distinct[:, axis] == values[0]]
            if scipy.special.pdtrc(count - 1, 2 * chance + 0.05) < _BY_CHANCE and np.std(pile, axis=0).max() > _APART * size:
                out |= column == values[0]
    return out


def chosen_rows(m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the readings to fit, and flags of saturated ones: without spikes, repeats and those, and thinned if there are too many."""
    full = at_end(m)
    used = np.flatnonzero(~full & ~held(m))
    used = used[sound(m[used])]
    if len(used) > LONG:
        used = used[thinned(m[used])]
    return used, full


def departure(found: Found, u: np.ndarray, dip: float) -> np.ndarray:
    """Heading difference to the maximum likelihood fit of the same readings, at level and tilted; infinite if there is none."""
    try:
        best = flat(u, "symmetric" if distinct(u) > COUNT["symmetric"] else found.kind)
    except NotEllipsoid:
        return np.full(2, np.inf)
    return heading_departure(found, best, dip)


def from_structure(found: Found, u: np.ndarray, told: Information) -> list[Finding]:
    """Findings that lie in the geometry of the readings, and those about the convergence of the fit."""
    planar = found.kind in PLANAR
    if not planar and extents(u - u.mean(axis=0))[-1] < NEAR_PLANAR:
        return [FINDINGS("near_planar")]
    if not told.condition <= _SINGULAR or not np.isfinite(found.covariance).all() or told.by_noise > _BY_NOISE:
        return [FINDINGS("undetermined", what=told.weakest)]
    said = []
    if not found.converged:
        said.append(FINDINGS("not_converged", what=told.weakest))
    if found.bias > _BY_PENALTY or told.condition > _ILL:
        said.append(FINDINGS("hardly", what=told.weakest))
    return said


def from_field(found: Found, norm: float | None, scale: float, planar: bool) -> list[Finding]:
    """A finding if the readings have another field than the given one."""
    mean = scale * float(radius_of(found.shape, planar))
    if norm is None or 1 / _FAR_OFF <= mean / norm <= _FAR_OFF:
        return []
    return [FINDINGS("field_differs", found=mean, given=norm)]


def from_causes(found: Found, said: Examined, saturated: int, costs: Sequence[float]) -> list[Finding]:
    """Findings about saturated readings, and about what the residuals follow; their costs are heading errors in rad at level."""
    findings = [FINDINGS("clipped", count=saturated)] if saturated else []
    for cause, cost in zip(said.causes, costs, strict=True):
        code = {FAST: "averaged", BENT: "bent"}.get(cause.name, "follows")
        what: dict[str, Any] = {"what": cause.name} if code == "follows" else {}
        findings.append(FINDINGS(code, cost=cost, size=100 * cause.size, **what))
    if said.parts is not None:
        findings.append(FINDINGS("correlated", size=100 * found.noise / float(radius_of(found.shape, found.kind in PLANAR))))
    return findings
