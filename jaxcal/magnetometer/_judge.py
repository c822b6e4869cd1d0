"""The findings of a calibration, from its numbers: the one place where a fit is judged."""

from collections.abc import Sequence

import numpy as np

from .._answer import CAUTION, FATAL, Finding, Quantity
from .._types import AnyArray
from ._findings import FINDINGS

#: rms heading error in rad above which a fit is weak, and above which it is refused
LIMITS = (float(np.deg2rad(1.0)), float(np.deg2rad(5.0)))
OUTLIER = 4.0  # robust standard deviations: one of 16,000 normal readings
#: findings beside which a heading error means nothing
_OPEN = ("not_judged", "undetermined", "near_planar", "no_ellipsoid", "not_converged")


def outliers(distance: AnyArray) -> np.ndarray:
    """Indices of readings more than four robust standard deviations off; distances in scaled units."""
    size = np.abs(distance)
    return np.flatnonzero(size > max(OUTLIER * 1.4826 * np.median(size), 1e-9))


def by_readings(scatter: float, far: int, total: int) -> list[Finding]:
    """Findings about the size of the residuals, relative to the field, and about outliers, of which two are no matter."""
    said = FINDINGS.over("scatter", scatter, share=100 * scatter)
    return said + FINDINGS.over("outliers", far / total if far > 2 else 0.0, count=far, total=total)


def judged(said: Sequence[Finding], level: float, limits: tuple[float, float], weakest: str, wanted: AnyArray) -> tuple[Finding, ...]:
    """All findings of a fit: those found, and one about its heading error in rad at level if that is above a limit."""
    if any(one.code in _OPEN for one in said) or level <= limits[0]:
        return tuple(said)
    grave = not level <= limits[1]
    way = "(" + ", ".join(f"{x:+.1f}" for x in wanted[0]) + ") of the sensor" if len(wanted) else "directions not yet seen"
    limit = Quantity(limits[1] if grave else limits[0], "angle")
    return (*said, FINDINGS("heading", severity=FATAL if grave else CAUTION, cost=level, limit=limit, what=weakest, direction=way))


def dip_differs(found: float, given: float) -> list[Finding]:
    """A finding if the dip by the accelerometer is not that of the given field; none for NaN."""
    return FINDINGS.over("dip_differs", abs(found - given), found=Quantity(found, "angle"), given=Quantity(given, "angle"))
