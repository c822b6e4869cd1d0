"""Hard and soft iron for tools that take nothing else, as lines to paste.

https://github.com/xioTechnologies/Fusion/blob/main/Fusion/FusionCalibration.h: softIronMatrix (reading - hardIronOffset)
https://sailboatinstruments.blogspot.com/2011/08/improved-magnetometer-calibration.html (Magneto): Ainv (reading - B)
https://github.com/iNavFlight/inav/blob/master/src/main/sensors/compass.c: (reading - magzero) 1024 / maggain, in counts
https://github.com/betaflight/betaflight/blob/master/src/main/sensors/compass.c: reading - mag_calibration, in counts
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .._errors import ExportError
from .._units import factor
from ..calibration import Calibration
from ..calibration._parts import COUNTS
from ._c import literal
from ._findings import FINDINGS
from ._models import correction
from ._options import Product

_INAV = 1024.0  # size of the field that iNav corrects to


def _lines(calibration: Calibration, of: Callable[[Any, Any, Any], Sequence[str]], kept: Any = None) -> Product:
    """The lines `of` the correction A, the hard iron b and the part; of A a tool in counts has `kept` alone."""
    mag: Any = calibration.magnetometer
    if mag is None or (kept is not None and mag.unit != COUNTS):
        raise ExportError("the tool takes a magnetometer in counts alone" if mag else "there is no magnetometer", code="no_part")
    a, size = correction(mag.model.soft_iron), 1.0 if mag.unit == COUNTS else factor("uT", "mag")
    lost = 0.0 if kept is None else float(np.linalg.norm(a - kept(a), 2))
    said = [FINDINGS("matrix_left_out", "mag", what="the rest of the soft iron", lost=lost)] if lost > 0 else []
    facts = ("corrected = A (reading - b), in " + ("counts" if size == 1.0 else "uT"), f"A {literal(a)}",
             f"soft iron, the inverse of A {literal(mag.model.soft_iron)}")  # fmt: skip
    return Product("\n".join(of(a, mag.model.hard_iron / size, mag)) + "\n", said, facts)


def write_fusion(calibration: Calibration, options: Any) -> Product:
    """Write A and b for `FusionCalibrationMagnetic`."""
    return _lines(calibration, lambda a, b, _: (
        f"const FusionMatrix softIronMatrix = {literal(a.ravel())};", f"const FusionVector hardIronOffset = {literal(b)};"))  # fmt: skip


def write_magneto(calibration: Calibration, options: Any) -> Product:
    """Write A and b under the names that sketches give to the results of Magneto."""
    return _lines(calibration, lambda a, b, _: (f"float M_B[3] = {literal(b)};", f"float M_Ainv[3][3] = {literal(a)};"))


def write_inav(calibration: Calibration, options: Any) -> Product:
    """Write b and the diagonal of A for the command line of iNav."""

    def settings(a: Any, b: Any, mag: Any) -> list[str]:
        gains = (_INAV if mag.field is None else mag.field) / np.diag(a)
        return [f"set {name}_{axis} = {round(x)}" for name, values in (("magzero", b), ("maggain", gains))
                for axis, x in zip("xyz", values, strict=True)]  # fmt: skip

    return _lines(calibration, settings, lambda a: np.diag(np.diag(a)))


def write_betaflight(calibration: Calibration, options: Any) -> Product:
    """Write b for the command line of Betaflight."""
    return _lines(calibration, lambda a, b, _: [f"set mag_calibration = {','.join(str(round(x)) for x in b)}"],
                  lambda a: np.cbrt(np.linalg.det(a)) * np.eye(3))  # fmt: skip
