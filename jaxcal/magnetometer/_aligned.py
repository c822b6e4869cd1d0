"""The rotation that another sensor shows, in the model and in the heading error of a fit."""

import dataclasses
from typing import Any

import numpy as np

from .._errors import DataError
from .._precision import host_float64
from ._design._heading_error import turned_heading_error
from ._result import MagFit
from ._rotation._align import Alignment, align
from ._rotation._joint import checked_joint, jointly

_DIPS = np.deg2rad(5.0)


@host_float64
def aligned(found: MagFit, m: Any, aid: Any, *, joint: bool = False) -> MagFit:
    """A fit with the rotation that another sensor shows, where that sensor has readings of its own.

    Parameters
    ----------
    found : a fit with a model, of these readings or of some of them.
    m : (n, 3) readings; rows with NaN are left out.
    aid : `Accelerometer`, `Gyroscope` or `Headings`, one row for each reading.
    joint : fit these readings anew, norms and other sensor together, as `fit` with `joint` does; `found` is where it starts.

    Returns
    -------
    The fit, its `alignment`, the model with the rotation in it, and the rotation's uncertainty in `heading_error`.

    Raises
    ------
    DataError
        As `align` does, and for a fit without a model.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.magnetometer import Accelerometer, aligned, body_field, scenario
    >>> m, up = body_field(scenario("all"), 50.0), -9.81 * body_field(scenario("all"), 1.0, np.pi / 2)
    >>> aligned(jaxcal.magnetometer.fit(m), m, Accelerometer(up)).alignment.verdict
    'good'

    References
    ----------
    The rotation is that of `align`; the heading error adds its variance to that of the norms.
    """
    if found.model is None:
        raise DataError(f"The fit has no model to turn: {found.reason}")
    if joint:
        checked_joint(found.method, "auto", aid, None, None)
    after = with_rotation(found, align(m, found.model, aid), None)
    return jointly(after, m, aid) if joint else after


def with_rotation(result: MagFit, alignment: Alignment, field: Any) -> MagFit:
    """The fit with the rotation in its soft iron and in its heading error; a rotation that is not determined stays out."""
    warnings = list(result.warnings)
    if alignment.verdict == "refused":
        verdict = "weak" if result.verdict == "good" else result.verdict
        reason = f"{result.reason} The rotation against the other sensor was not found. {alignment.reason}"
        return dataclasses.replace(result, alignment=alignment, verdict=verdict, reason=reason)
    if np.ndim(field) == 1 and not abs(alignment.dip - result.inclination) < _DIPS:
        degrees = np.rad2deg([alignment.dip, result.inclination])
        if np.isfinite(alignment.dip):
            warnings.append(
                f"The dip found is {degrees[0]:.1f} degrees, that of the given field {degrees[1]:.1f}: the specific force points up at "
                "rest; where it agrees but for the sign, give it negated."
            )
    error = np.hypot(result.heading_error, turned_heading_error(np.asarray(alignment.covariance), result.inclination))
    planar = result.plane is not None
    reason = result.reason.replace("excluding a rotation common to all readings", "excluding the alignment error")
    verdict = alignment.verdict if result.verdict == "good" else result.verdict
    return dataclasses.replace(
        result, model=alignment.model, alignment=alignment, heading_error=result.heading_error if planar else error, verdict=verdict,
        reason=f"{reason} {alignment.reason}", warnings=tuple(warnings),
    )  # fmt: skip
