"""Write a calibration as a C header without dependencies (C99, float32, SI, no dynamic memory), and code that makes one on the device."""

import pathlib
from typing import Any

import numpy as np

from .._answer import Finding
from .._errors import ExportError
from .._types import AnyArray
from ..calibration import Calibration
from ..imu import Triad
from ._findings import FINDINGS
from ._models import correction, cubics, gyro_bias, triads, unknown_field
from ._options import Product, number

_APPLY = """static inline void %sapply(const float m[3][3], const float b[3], const float y[3], float x[3]) {
  for (int i = 0; i < 3; ++i)
    x[i] = m[i][0] * (y[0] - b[0]) + m[i][1] * (y[1] - b[1]) + m[i][2] * (y[2] - b[2]);
}
"""


_HEAD = {
    "accel": " * accel: x = matrix * (y - bias)                     m/s^2",
    "gyro": " * gyro:  x = matrix * (y - bias - g_sensitivity * a) rad/s, a = corrected accel",
    "mag": " * mag:   x = matrix * (y - bias)                     tesla",
}
_THERMAL = """ * bias is at %sTEMPERATURE_REFERENCE_C; add coeff[0]*d + coeff[1]*d^2 + coeff[2]*d^3,
 * d = temperature - reference, temperature clipped to the valid range."""


def write_c(calibration: Calibration, options: Any) -> Product:
    """Write the constants of every sensor in the calibration, and the function that applies them."""
    said: list[Finding] = []
    parts, p = triads(calibration), options.prefix
    thermal = {sensor: cubics(calibration, sensor, None, said) for sensor in ("accel", "gyro")}
    found = {sensor: _inertial(calibration, sensor, parts.get(sensor), powers, p, said) for sensor, powers in thermal.items()}
    if calibration.magnetometer is not None:
        found["mag"] = _magnetic(calibration, options, said)
    if not any(found.values()) and not options.solver:
        raise ExportError("a C header needs an imu, magnetometer or temperature section; this calibration has none", code="no_part")
    about = "Sensor calibration written by jaxcal. SI units, sensor frame." if any(found.values()) else "Code for calibrations."
    head = [f"/* {about}", *(_HEAD[name] for name, lines in found.items() if lines)]
    ranges = []
    if any(powers is not None for powers in thermal.values()):
        head.append(_THERMAL % p)
        limits = {"REFERENCE": "reference", "MIN": "minimum", "MAX": "maximum"}.items()
        ranges = [f"#define {p}TEMPERATURE_{name}_C {_number(getattr(calibration.temperature, key))}" for name, key in limits] + [""]
    guard = f"{p}CALIBRATION_H"
    lines = [*head, " */", f"#ifndef {guard}", f"#define {guard}", "", *ranges, *(line for lines in found.values() for line in lines), ""]
    text = "\n".join(lines) + "\n" + (_APPLY % p.lower() if any(found.values()) else "") + (_solver(p) if options.solver else "")
    return Product(text + "\n#endif\n", said)


def _solver(prefix: str) -> str:
    """The code that collects readings and solves for a calibration: declarations, and behind a switch their functions."""
    declared, made = ((pathlib.Path(__file__).parent / "_embedded" / f"sensors.{kind}").read_text(encoding="utf-8") for kind in "hc")
    text = f"\n{declared}\n#ifdef JAXCAL_IMPLEMENTATION\n{made}#endif\n"
    return text.replace("JAXCAL_", prefix.upper()).replace("jaxcal_", prefix.lower())


def _inertial(
    calibration: Calibration, sensor: str, part: Triad | None, powers: AnyArray | None, prefix: str, said: list[Finding]
) -> list[str]:
    if part is None:
        bias = gyro_bias(calibration) if sensor == "gyro" else None
        if powers is None and bias is None:
            return []
        if bias is None:
            bias = np.zeros(3)
            said.append(FINDINGS("placeholder", sensor, what="bias for the thermal model", value="zero"))
        part = Triad(np.eye(3), bias)
    start = f"static const float {prefix}{sensor.upper()}"
    lines = [f"{start}_MATRIX[3][3] = {_table(correction(part.matrix))};", f"{start}_BIAS[3] = {_row(part.bias)};"]
    if powers is not None:
        remark = " /* [axis][power-1] */" if sensor == "accel" else ""
        lines.append(f"{start}_BIAS_TEMPERATURE[3][3] = {_table(powers)};{remark}")
    if sensor == "gyro":
        lines.append(f"{start}_G_SENSITIVITY[3][3] = {_table(part.g_sensitivity)};")
    return lines


def _magnetic(calibration: Calibration, options: Any, said: list[Finding]) -> list[str]:
    section: Any = calibration.magnetometer
    start, model = f"static const float {options.prefix}MAG", section.model
    lines = [f"{start}_MATRIX[3][3] = {_table(correction(model.soft_iron))};", f"{start}_BIAS[3] = {_row(model.hard_iron)};"]
    unknown_field(calibration, said)
    return lines


def _number(value: float) -> str:
    return f"{number(value)}f"


def _row(values: AnyArray) -> str:
    return "{" + ", ".join(_number(float(value)) for value in values) + "}"


def _table(rows: AnyArray) -> str:
    return "{" + ", ".join(_row(row) for row in rows) + "}"
