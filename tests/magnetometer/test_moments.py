"""Fits of moments agree with fits of the readings, and a C program accumulates the same moments."""

import re
import shutil
import subprocess

import numpy as np
import pytest

import jaxcal
from jaxcal import DataError, ExportError
from jaxcal.magnetometer import Admission, Moments, fit

from . import cases

M = cases.readings(cases.MILD, cases.directions(400, 0), 0.02, 0)


@pytest.mark.parametrize("method", ["consistent", "algebraic"])
def test_the_fit_of_moments_is_the_fit_of_readings(method):
    moments = Moments(M[0], 1.3)
    for part in np.array_split(M, 7):
        moments = moments.update(part)
    found, whole = moments.fit(method, field=1.0), fit(M, method=method, field=1.0)
    np.testing.assert_allclose(found.model.hard_iron, whole.model.hard_iron, atol=1e-9)
    np.testing.assert_allclose(found.model.soft_iron, whole.model.soft_iron, atol=1e-9)
    assert found.count == 400
    assert found.noise == pytest.approx(0.02, rel=0.1)


def test_merging_and_moving_are_exact():
    one, two = Moments(M[0], 1.0).update(M[:150]), Moments(np.array([3.0, 0.0, 1.0]), 0.5).update(M[150:])
    merged, whole = one.merge(two), Moments(M[0], 1.0).update(M)
    np.testing.assert_allclose(merged.sums, whole.sums, rtol=1e-9, atol=1e-9)
    moved = whole.moved([0.3, 0.2, -0.1], 2.0)
    np.testing.assert_allclose(moved.sums, Moments([0.3, 0.2, -0.1], 2.0).update(M).sums, rtol=1e-9, atol=1e-9)


def test_a_large_hard_iron_costs_no_digits():
    far = M + 20.0
    np.testing.assert_allclose(
        Moments(far[0], 1.0).update(far).fit().model.hard_iron, fit(M, method="consistent").model.hard_iron + 20, atol=1e-8
    )


def test_what_moments_cannot_do():
    with pytest.raises(DataError, match="at least 10"):
        Moments(M[0], 1.0).update(M[:9]).fit()
    with pytest.raises(DataError, match="no method 'ml'"):
        Moments(M[0], 1.0).update(M).fit("ml")
    with pytest.raises(DataError, match="not finite"):
        Moments(M[0], 1.0).update(np.full((1, 3), np.nan))
    with pytest.raises(DataError, match="positive scale"):
        Moments(M[0], 0.0)
    with pytest.raises(DataError, match="the same"):
        Moments(M[0], 1.0).update(np.tile(M[0], (20, 1))).fit()


def test_a_device_at_rest_does_not_fill_the_sums():
    rest = cases.readings(cases.MILD, np.tile([0.0, 0.6, 0.8], (5000, 1)), 0.02, 4)
    admission, new = Admission([0.7, -0.4, 0.2], 1.0).admit(np.concatenate([rest, M]))
    # noise sometimes moves a still reading by 0.05, but a cell admits no more than 32 readings
    assert new[:5000].sum() <= 64
    assert new[5000:].sum() > 300
    assert admission.count.max() <= 32
    np.testing.assert_array_equal(admission.count, np.bincount(admission.cells(np.concatenate([rest, M])[new]), minlength=96))
    # the result is the same in chunks
    part, kept = Admission([0.7, -0.4, 0.2], 1.0), []
    for chunk in np.array_split(np.concatenate([rest, M]), 9):
        part, mask = part.admit(chunk)
        kept.append(mask)
    np.testing.assert_array_equal(np.concatenate(kept), new)
    found = Moments(M[0], 1.0).update(np.concatenate([rest, M])[new]).fit().model
    assert np.linalg.norm(found.hard_iron - cases.MILD.hard_iron) < 0.01


def test_cells_part_the_sphere():
    u, cells = cases.directions(200_000, 1), Admission(np.zeros(3), 1.0).cells
    count = np.bincount(cells(u), minlength=96)
    edge = np.linspace(-1, 1, 5)
    corner = np.arctan(np.outer(edge, edge) / np.sqrt(1 + edge[:, None] ** 2 + edge**2))
    share = np.tile(np.diff(np.diff(corner, axis=0), axis=1).ravel(), 6) / (4 * np.pi)  # solid angles
    np.testing.assert_allclose(share.sum(), 1.0, rtol=1e-12)
    assert np.abs((count - 200_000 * share) / np.sqrt(200_000 * share)).max() < 4.5
    for face in range(6):
        axis, sign = face // 2, 1 - 2 * (face % 2)
        inside = cells(u) // 16 == face
        assert np.all(u[inside, axis] * sign >= np.abs(u[inside]).max(axis=1) - 1e-15)
    assert cells(np.zeros((1, 3)))[0] < 96


@pytest.mark.parametrize(
    ("arguments", "words"),
    [((np.zeros(2), 1.0), "centre"), ((np.zeros(3), 0.0), "positive scale"), ((np.zeros(3), 1.0, np.zeros(5)), "96 cells")],
)
def test_bad_admission(arguments, words):
    with pytest.raises(DataError, match=words):
        Admission(*arguments)
    with pytest.raises(DataError, match="not finite"):
        Admission(np.zeros(3), 1.0).admit(np.full((1, 3), np.nan))


PROGRAM = r"""
#include <stdio.h>
#include "mag.h"
int main(void)
{
    float m[3], y[3];
    mag_moments s;
    mag_admission a;
    const double c0[3] = {JAXCAL_MAG_BIAS[0], JAXCAL_MAG_BIAS[1], JAXCAL_MAG_BIAS[2]};
    mag_moments_clear(&s, c0, JAXCAL_MAG_FIELD);
    mag_admission_clear(&a, c0, JAXCAL_MAG_FIELD);
    while (scanf("%f %f %f", &m[0], &m[1], &m[2]) == 3) {
        mag_moments_add(&s, m);
        jaxcal_apply(JAXCAL_MAG_MATRIX, JAXCAL_MAG_BIAS, m, y);
        printf("%.9g %.9g %.9g %d\n", y[0], y[1], y[2], mag_admission_ask(&a, m));
    }
    for (int i = 0; i < MAG_MOMENTS; i++)
        printf("%.17g\n", s.sums[i]);
    return 0;
}
"""


def test_the_c_header_does_what_python_does(tmp_path):
    # one attitude is kept for a while, as on a bench
    m = (50e-6 * np.concatenate([M[:200], np.repeat(M[200:201], 100, axis=0), M[200:]])).astype(np.float32).astype(float)
    found = fit(m, field=50e-6)
    device = jaxcal.Calibration(magnetometer=found, device="unit 7")
    assert jaxcal.export.write(device, tmp_path / "mag.h", format="c", accumulator=True) == ()
    text = (tmp_path / "mag.h").read_text()
    assert "// device: unit 7" in text
    numbers = [float(x) for x in re.findall(r"(-?[\d.]+(?:e-?\d+)?)f", text[text.index("MAG_MATRIX[3][3]") : text.index("MAG_BIAS")])]
    np.testing.assert_allclose(np.reshape(numbers, (3, 3)), np.linalg.inv(found.model.soft_iron), rtol=1e-8, atol=1e-10)
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    (tmp_path / "main.c").write_text(PROGRAM)
    command = [compiler, "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "main.c", "-o", "main"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    rows = "\n".join(" ".join(f"{x:.9g}" for x in row) for row in m)
    out = subprocess.run([str(tmp_path / "main")], input=rows, text=True, capture_output=True, check=True).stdout.split()
    corrected, sums = np.array(out[: 4 * len(m)], dtype=float).reshape(-1, 4), np.array(out[4 * len(m) :], dtype=float)
    corrected, admitted = corrected[:, :3], corrected[:, 3] == 1
    np.testing.assert_allclose(corrected, found.model.correct(m), atol=1e-6 * 50e-6)
    offset = np.asarray(found.model.hard_iron, dtype=np.float32).astype(float)
    moments = Moments(offset, float(np.float32(50e-6)), sums)
    np.testing.assert_allclose(sums, Moments(offset, float(np.float32(50e-6))).update(m).sums, rtol=1e-6, atol=1e-6)
    assert moments.count == len(m)
    assert 100 < admitted.sum() < len(m)
    np.testing.assert_array_equal(admitted, Admission(offset, float(np.float32(50e-6))).admit(m)[1])
    exact = fit(m, method="consistent", field=50e-6).model
    np.testing.assert_allclose(moments.fit(field=50e-6).model.hard_iron, exact.hard_iron, atol=1e-6 * 50e-6)


def test_a_header_needs_a_magnetometer(tmp_path):
    with pytest.raises(ExportError, match="needs an imu, magnetometer or temperature"):
        jaxcal.export.write(jaxcal.Calibration(), tmp_path / "x.h", format="c")
