"""Write a calibration as a C header without dependencies (C99, float32, SI, no dynamic memory), and code that makes one on the device."""

import pathlib
from typing import Any

import numpy as np

from .._answer import Finding
from .._errors import ExportError
from .._special import NORMAL95
from .._types import AnyArray
from ..calibration import Calibration, difference
from ..calibration._find import moment
from ..imu import ThermalTriad, Triad
from ._findings import FINDINGS
from ._models import correction, cubics, gyro_bias, triads, unknown_field
from ._options import Product, number

_SENSOR = """
/* {sensor}: bias at a temperature in degC (NAN if it is not known), days after the calibration; and y without its errors */
static inline void {p}bias_{sensor}(float temperature, float days, float b[3]) {{
{first}  for (int i = 0; i < 3; ++i) b[i] = {bias};
}}

static inline void {p}correct_{sensor}(const float y[3], {felt}float temperature, float days, float x[3]) {{
  float b[3];
  {p}bias_{sensor}(temperature, days, b);
{then}}}
"""
_EACH = "  for (int i = 0; i < 3; ++i)\n    for (int k = 0; k < 3; ++k) "

_REMARKS = {
    "_BIAS_TEMPERATURE": "[axis][power-1]", "_BIAS_DAY": "for each day", "_RANGE": "reference, low, high, degC",
    "_FORWARD": "of y = forward * x + ..., and its powers of degC",
}  # fmt: skip
_HEAD = {
    "accel": " * accel: x = matrix * (y - bias)                     m/s^2",
    "gyro": " * gyro:  x = matrix * (y - bias - g_sensitivity * a) rad/s, a = corrected accel",
    "mag": " * mag:   x = matrix * (y - bias)                     tesla",
}
_RANGE = ("REFERENCE", "MIN", "MAX")
_THERMAL = """ * bias is at %sTEMPERATURE_REFERENCE_C; add coeff[0]*d + coeff[1]*d^2 + coeff[2]*d^3,
 * d = temperature - reference, temperature clipped to the valid range."""


def write_c(calibration: Calibration, options: Any) -> Product:
    """Write the constants of every sensor in the calibration, and the functions that apply them."""
    said: list[Finding] = []
    p, low = options.prefix, options.prefix.lower()
    thermal = {sensor: cubics(calibration, sensor, None, said) for sensor in _HEAD}
    aged = {} if options.earlier is None else _ageing(calibration, options.earlier, said)
    made = {sensor: _sensor(calibration, sensor, powers, aged.get(sensor), options, said) for sensor, powers in thermal.items()}
    found = {sensor: each for sensor, each in made.items() if each}
    if not found and not options.solver:
        raise ExportError("a C header needs an imu, magnetometer or temperature section; this calibration has none", code="no_part")
    about = "Sensor calibration written by jaxcal. SI units, sensor frame." if found else "Code for calibrations."
    head = [f"/* {about}", *(_HEAD[name] for name in found)]
    ranges = []
    if any(powers is not None for powers in thermal.values()):
        head.append(_THERMAL % p)
        limits = [getattr(calibration.temperature, key) for key in ("reference", "minimum", "maximum")]
        ranges = [f"#define {p}TEMPERATURE_{name}_C {literal(x, options.double)}" for name, x in zip(_RANGE, limits, strict=True)] + [""]
    constants = [line for lines, _ in found.values() for line in lines]
    functions = "".join(code for _, code in found.values())
    shared = [name for name in ("apply", "powers", "solve") if f"{low}{name}(" in functions]
    begin = [*head, " */", f"#ifndef {p}CALIBRATION_H", f"#define {p}CALIBRATION_H", "", *ranges, *constants, ""]
    text = "\n".join(begin) + "\n" + "".join(_code(f"{name}.h", p) for name in shared) + functions
    text = text.replace("float", "double") if options.double else text
    return Product(text + (_solver(p, options.double) if options.solver else "") + "\n#endif\n", said)


def _code(file: str, prefix: str) -> str:
    """Code with the names of a prefix."""
    text = (pathlib.Path(__file__).parent / "_embedded" / file).read_text(encoding="utf-8")
    return text.replace("JAXCAL_", prefix.upper()).replace("jaxcal_", prefix.lower())


def _solver(prefix: str, double: bool) -> str:
    """The code that collects readings and solves for a calibration: declarations, and behind a switch their functions."""
    switch, made = "\n#ifndef {0}\n#define {0}\n#endif".format(f"{prefix.upper()}DOUBLE"), _code("sensors.c", prefix)
    return switch * double + f"\n{_code('sensors.h', prefix)}\n#ifdef {prefix.upper()}IMPLEMENTATION\n{made}#endif\n"


def _sensor(
    calibration: Calibration, sensor: str, powers: AnyArray | None, aged: AnyArray | None, options: Any, said: list[Finding]
) -> tuple[list[str], str] | None:
    """Constants and functions of a sensor; None if nothing of it is known."""
    part = _model(calibration, sensor, powers is not None, said)
    if part is None:
        return None
    p, low = options.prefix, options.prefix.lower()
    name = f"{p}{sensor.upper()}"
    held = {"_MATRIX[3][3]": correction(part.matrix), "_BIAS[3]": part.bias}
    first, above, bias = "", "", f"{name}_BIAS[i]"
    if powers is not None:
        held["_BIAS_TEMPERATURE[3][3]"] = powers
        first += f"  const float d = {low}above(temperature, {', '.join(f'{p}TEMPERATURE_{x}_C' for x in _RANGE)});\n"
        bias += f" + {low}powers({name}_BIAS_TEMPERATURE[i], 3, d)"
    if aged is not None:
        held["_BIAS_DAY[3]"] = aged
        bias += f" + days * {name}_BIAS_DAY[i]"
    felt, solved = f"{name}_G_SENSITIVITY[i][k]", f"  {low}apply({name}_MATRIX, b, y, x);\n"
    if sensor == "gyro":
        held["_G_SENSITIVITY[3][3]"] = part.g_sensitivity
    if isinstance(part, ThermalTriad):  # the matrix in front of the true value is a polynomial, and its inverse is none
        held |= {"_RANGE[3]": [part.reference, part.low, part.high], "_FORWARD[3][3]": part.matrix}
        add = f" + {low}powers({name}_%s, {len(part.bias_powers)}, e)"
        for field, size in (("matrix", "[3][3]"), ("bias", "[3]"), *[("g_sensitivity", "[3][3]")] * (sensor == "gyro")):
            held[f"_{field.upper()}_POWERS{size}[{len(part.bias_powers)}]"] = np.moveaxis(getattr(part, f"{field}_powers"), 0, -1)
        above = f"  const float e = {low}above(temperature, {', '.join(f'{name}_RANGE[{i}]' for i in range(3))});\n"
        bias, felt = bias + add % "BIAS_POWERS[i]", f"({felt}{add % 'G_SENSITIVITY_POWERS[i][k]'})"
        entry = f"m[i][k] = {name}_FORWARD[i][k]{add % 'MATRIX_POWERS[i][k]'};\n"
        solved = f"  float m[3][3];\n{_EACH}{entry}  {low}solve(m, b, y, x);\n"
    then = above + f"{_EACH}b[i] += {felt} * a[k];\n" * (sensor == "gyro") + solved
    first += above
    first += "".join(f"  (void){one};\n" for one, known in (("temperature", first), ("days", aged is not None)) if not known)
    code = _SENSOR.format(sensor=sensor, p=low, first=first, bias=bias, then=then,
                          felt="const float a[3], " * (sensor == "gyro"))  # fmt: skip
    lines = [f"static const float {name}{key} = {literal(value, options.double)};" for key, value in held.items()]
    return [line + next((f" /* {said} */" for key, said in _REMARKS.items() if key in line), "") for line in lines], code


def _model(calibration: Calibration, sensor: str, thermal: bool, said: list[Finding]) -> Triad | None:
    """Matrix and bias of a sensor; of the thermal model alone where the calibration has no more."""
    if sensor == "mag" and calibration.magnetometer is not None:
        unknown_field(calibration, said)
        return Triad(calibration.magnetometer.model.soft_iron, calibration.magnetometer.model.hard_iron)
    part, bias = triads(calibration).get(sensor), gyro_bias(calibration) if sensor == "gyro" else None
    if part is None and (thermal or bias is not None):
        part = Triad(np.eye(3), np.zeros(3) if bias is None else bias)
        said += [FINDINGS("placeholder", sensor, what="bias for the thermal model", value="zero")] if bias is None else []
    return part


def _ageing(later: Calibration, earlier: Calibration, said: list[Finding]) -> dict[str, AnyArray]:
    """Sensor -> (3,) change of its bias in a day since an earlier calibration, zero on an axis where it is within its uncertainty."""
    dates = [(one.provenance or {}).get("date") for one in (earlier, later)]
    if None in dates or not (days := (moment(dates[1], "date") - moment(dates[0], "date")).total_seconds() / 86400) > 0:
        raise ExportError("ageing needs two calibrations with dates in their provenance, the earlier one before the other", code="dates")
    found = {}
    for part in difference(earlier, later):
        rows = [i for i, name in enumerate(part.parameters) if name.startswith(("bias[", "hard iron"))]
        change, sensor = part.change[rows], {"magnetometer": "mag"}.get(part.name, part.name)
        sure = np.abs(change) > NORMAL95 * part.standard_error[rows]
        if rows:
            found[sensor] = np.where(sure, change, 0.0) / days
            said += [] if sure.all() else [FINDINGS("no_ageing", [f"{sensor}_{'xyz'[i]}" for i in np.flatnonzero(~sure)], days=days)]
    return found


def literal(values: Any, double: bool = False) -> str:
    """A number, or an array as nested braces."""
    if np.ndim(values):
        return "{" + ", ".join(literal(one, double) for one in values) + "}"
    return number(float(values), 17) if double else f"{number(float(values))}f"
