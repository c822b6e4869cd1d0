"""Write a calibration as a C header without dependencies: C99, float32, SI, no dynamic memory."""

from typing import Any

import numpy as np

from .._answer import Finding
from .._errors import ExportError
from .._types import AnyArray
from ..calibration import Calibration
from ..imu import Triad
from ..magnetometer import Moments
from ..magnetometer._iron import HARD
from ..magnetometer._onboard import APART, CELLS, MOST
from ._findings import FINDINGS
from ._models import correction, cubics, gyro_bias, triads, unknown_field
from ._options import Product, number

_APPLY = """static inline void %sapply(const float m[3][3], const float b[3], const float y[3], float x[3]) {
  for (int i = 0; i < 3; ++i)
    x[i] = m[i][0] * (y[0] - b[0]) + m[i][1] * (y[1] - b[1]) + m[i][2] * (y[2] - b[2]);
}
"""

_MOMENTS = """
/* Sums of x^a y^b z^c with a + b + c <= 4, (x, y, z) = (m - c0) / s0: all that a new calibration needs, whatever the number of
   readings. The order of the sums is that of mag_exponents; jaxcal.magnetometer.Moments(c0, s0, sums).fit() solves for it. */
#define MAG_MOMENTS 35
typedef struct {
    double c0[3], s0, sums[MAG_MOMENTS];
} mag_moments;

static const unsigned char mag_exponents[MAG_MOMENTS][3] = {
%s};

/* Start anew about a centre (such as the first reading, or the bias) and a scale (such as the field). */
static inline void mag_moments_clear(mag_moments *s, const double c0[3], double s0)
{
    for (int i = 0; i < 3; i++)
        s->c0[i] = c0[i];
    s->s0 = s0;
    for (int i = 0; i < MAG_MOMENTS; i++)
        s->sums[i] = 0.0;
}

static inline void mag_moments_add(mag_moments *s, const float m[3])
{
    double powers[3][5];
    for (int i = 0; i < 3; i++) {
        const double x = ((double)m[i] - s->c0[i]) / s->s0;
        powers[i][0] = 1.0;
        for (int k = 1; k < 5; k++)
            powers[i][k] = powers[i][k - 1] * x;
    }
    for (int i = 0; i < MAG_MOMENTS; i++)
        s->sums[i] += powers[0][mag_exponents[i][0]] * powers[1][mag_exponents[i][1]] * powers[2][mag_exponents[i][2]];
}

/* Which readings to add: new ones, and from all directions alike, so that a device at rest does not fill the sums with one
   direction. 4 x 4 cells on each face of a cube about c0, %d readings in each, %g s0 from the one before.
   jaxcal.magnetometer.Admission(c0, s0).admit does the same. */
#define MAG_CELLS %d
typedef struct {
    double c0[3], s0;
    float last[MAG_CELLS][3];
    unsigned char count[MAG_CELLS];
} mag_admission;

static inline void mag_admission_clear(mag_admission *s, const double c0[3], double s0)
{
    for (int i = 0; i < 3; i++)
        s->c0[i] = c0[i];
    s->s0 = s0;
    for (int i = 0; i < MAG_CELLS; i++)
        s->count[i] = 0;
}

/* 1 where the reading is to be added, 0 where not. */
static inline int mag_admission_ask(mag_admission *s, const float m[3])
{
    double z[3], size[3], far = 0.0;
    int axis = 0, cell;
    for (int i = 0; i < 3; i++) {
        z[i] = (double)m[i] - s->c0[i];
        size[i] = z[i] < 0 ? -z[i] : z[i];
        if (size[i] > size[axis])
            axis = i;
    }
    cell = 32 * axis + (z[axis] < 0 ? 16 : 0);
    for (int k = 1; k < 3; k++) {
        int place = (int)(2.0 * (z[(axis + k) %% 3] / (size[axis] > 0 ? size[axis] : 1.0) + 1.0));
        cell += (place > 3 ? 3 : place) * (k == 1 ? 4 : 1);
    }
    for (int i = 0; i < 3; i++)
        far += ((double)m[i] - s->last[cell][i]) * ((double)m[i] - s->last[cell][i]);
    if (s->count[cell] >= %d || (s->count[cell] > 0 && far < %g * %g * s->s0 * s->s0))
        return 0;
    s->count[cell]++;
    for (int i = 0; i < 3; i++)
        s->last[cell][i] = m[i];
    return 1;
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
    elif options.accumulator:
        raise ExportError("accumulator=True is for the magnetometer, and the calibration holds none", code="no_part")
    if not any(found.values()):
        raise ExportError("a C header needs an imu, magnetometer or temperature section; this calibration has none", code="no_part")
    head = ["/* Sensor calibration written by jaxcal. SI units, sensor frame.", *(_HEAD[name] for name, lines in found.items() if lines)]
    ranges = []
    if any(powers is not None for powers in thermal.values()):
        head.append(_THERMAL % p)
        limits = {"REFERENCE": "reference", "MIN": "minimum", "MAX": "maximum"}.items()
        ranges = [f"#define {p}TEMPERATURE_{name}_C {_number(getattr(calibration.temperature, key))}" for name, key in limits] + [""]
    guard = f"{p}CALIBRATION_H"
    lines = [*head, " */", f"#ifndef {guard}", f"#define {guard}", "", *ranges, *(line for lines in found.values() for line in lines), ""]
    text = "\n".join(lines) + "\n" + _APPLY % p.lower()
    if options.accumulator:
        exponents = Moments(np.zeros(3), 1.0).exponents
        rows = ["    " + " ".join(f"{{{a}, {b}, {c}}}," for a, b, c in exponents[i : i + 7]) + "\n" for i in range(0, len(exponents), 7)]
        text += _MOMENTS % ("".join(rows), MOST, APART, CELLS, MOST, APART, APART)
    return Product(text + "\n#endif\n", said, _spread(calibration))


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
    if options.accumulator:
        if section.field is None:
            raise ExportError("accumulator=True needs the field's strength as a scale; the calibration has none", code="no_part")
        lines.append(f"{start}_FIELD = {_number(section.field)}; /* norm of the corrected field, {section.unit} */")
    return lines


def _spread(calibration: Calibration) -> tuple[str, ...]:
    covariance = None if calibration.magnetometer is None else calibration.magnetometer.covariance
    known = None if covariance is None else covariance.of(HARD)
    if known is None:
        return ()
    spread = np.sqrt(np.diag(known))
    return (f"standard deviation of the magnetometer's bias: {', '.join(f'{s:.2g}' for s in spread)} {calibration.magnetometer.unit}",)  # type: ignore[union-attr]


def _number(value: float) -> str:
    return f"{number(value)}f"


def _row(values: AnyArray) -> str:
    return "{" + ", ".join(_number(float(value)) for value in values) + "}"


def _table(rows: AnyArray) -> str:
    return "{" + ", ".join(_row(row) for row in rows) + "}"
