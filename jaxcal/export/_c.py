"""A magnetometer calibration as a C header that needs nothing else."""

import numpy as np

from .._errors import ExportError
from ..calibration import Calibration
from ..magnetometer import Moments
from ._options import Options
from ._text import number

_APPLY = """
/* y = M (m - b): corrected field in the axes of the sensor, in tesla like the reading m. */
static inline void mag_apply(const float m[3], float y[3])
{
    const float d[3] = {m[0] - MAG_B[0], m[1] - MAG_B[1], m[2] - MAG_B[2]};
    for (int i = 0; i < 3; i++)
        y[i] = MAG_M[i][0] * d[0] + MAG_M[i][1] * d[1] + MAG_M[i][2] * d[2];
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

/* Start anew about a centre (such as the first reading, or MAG_B) and a scale (such as MAG_H). */
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
"""


def header(calibration: Calibration, options: Options) -> tuple[str, tuple[str, ...]]:
    """Text of the header, and what it leaves out."""
    section = calibration.magnetometer
    if section is None:
        raise ExportError("a C header needs a magnetometer calibration; this one has none")
    matrix, offset = np.linalg.inv(section["soft_iron"]), section["hard_iron"]
    lines = ["#ifndef JAXCAL_MAG_H", "#define JAXCAL_MAG_H", ""]
    covariance = section["covariance"]
    if covariance is not None and "b_x" in covariance["parameters"]:
        first = covariance["parameters"].index("b_x")
        spread = np.sqrt(np.diag(covariance["values"])[first : first + 3])
        lines.append(f"/* standard deviation of MAG_B: {', '.join(f'{s:.2g}' for s in spread)} T */")
    lines += [
        f"static const float MAG_B[3] = {_row(offset)}; /* hard iron, T */",
        "static const float MAG_M[3][3] = {",
        *(f"    {_row(row)}," for row in matrix),
        "}; /* inverse of the soft iron, row by row */",
    ]
    if section["field"] is not None:
        lines.append(f"static const float MAG_H = {_number(section['field'])}; /* norm of the corrected field, T */")
    exponents = Moments(np.zeros(3), 1.0).exponents
    rows = ["    " + " ".join(f"{{{a}, {b}, {c}}}," for a, b, c in exponents[i : i + 7]) + "\n" for i in range(0, len(exponents), 7)]
    text = "\n".join(lines) + "\n" + _APPLY + _MOMENTS % "".join(rows) + "\n#endif\n"
    left_out = tuple(f"{name} is not in the file" for name in ("noise", "imu", "temperature") if getattr(calibration, name) is not None)
    return text, left_out


def _number(value: float) -> str:
    return f"{number(value)}f"


def _row(values: np.ndarray) -> str:
    return "{" + ", ".join(_number(float(v)) for v in values) + "}"
