"""The C code for a microcontroller, compiled here, beside the same algorithm in Python."""

import ctypes
import pathlib
import shutil
import subprocess

import numpy as np
import pytest

import jaxcal
from jaxcal.magnetometer import Moments

SCENARIOS = {  # directions of the field in the sensor
    "all": lambda h, turn: h,
    "half": lambda h, turn: h[h[:, 2] > 0],
    "turns": lambda h, turn: np.concatenate(
        [np.c_[r * np.cos(turn), r * np.sin(turn), 0 * turn + z] for r, z in ((0.8, -0.6), (1, 0), (0.8, 0.6))]
    ),
}
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror")


class Mag(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_float * size) for name, size in (("sum", 35), ("lost", 35), ("centre", 3), ("scale", 1), ("last", 3))),
        ("bin", ctypes.c_uint16 * 24), *((name, ctypes.c_uint16) for name in ("count", "held", "outliers")),
        ("matrix", ctypes.c_float * 9), ("bias", ctypes.c_float * 3),
        *((name, ctypes.c_float) for name in ("field", "noise", "heading_error", "horizontal")),
        *((name, ctypes.c_uint8) for name in ("solved", "verdict", "reasons")),
    ]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("c")
    device = jaxcal.Calibration.load(pathlib.Path(__file__).parent / "golden.json")
    jaxcal.export.write(device, found / "sensors.h", format="c", solver=True)
    (found / "sensors.c").write_text('#define JAXCAL_IMPLEMENTATION\n#include "sensors.h"\n')
    return found


def built(folder, compiler, *flags, out="sensors.so"):
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler}")
    subprocess.run([compiler, *STRICT, *flags, "sensors.c", "-lm", "-o", out], cwd=folder, check=True)
    return folder / out


@pytest.fixture(scope="module")
def code(folder):
    return ctypes.CDLL(str(built(folder, "gcc", "-O1", "-shared", "-fPIC", "-fsanitize=undefined", "-fno-sanitize-recover=all")))


def calibrated(code, m, method):
    mag = Mag()
    code.jaxcal_mag_begin(ctypes.byref(mag))
    for row in np.asarray(m, dtype=np.float32):
        code.jaxcal_mag_add(ctypes.byref(mag), row.ctypes.data_as(ctypes.c_void_p))
    getattr(code, f"jaxcal_mag_{method}")(ctypes.byref(mag))
    return mag


@pytest.mark.parametrize("method", ["solve", "constrained"])
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_single_precision_gives_what_python_gives_in_double(code, scenario, method):
    rng = np.random.default_rng(4)
    for noise, hard in ((0.1, [20.0, -70.0, 100.0]), (1.5, [0.0, 10.0, -5.0])):
        h = rng.standard_normal((600, 3))
        h = SCENARIOS[scenario](h / np.linalg.norm(h, axis=1, keepdims=True), np.linspace(0, 6.2, 300))
        soft = np.array([[1.1, 0.1, 0.0], [0.1, 0.9, -0.05], [0.0, -0.05, 1.0]])
        m = (47 * h @ soft + hard + noise * rng.standard_normal(h.shape)).astype(np.float32)
        m[7] = m[6]  # a reading that is held
        m[40] = np.nan
        mag, moments = calibrated(code, m, method), Moments()
        assert moments.add(m) == mag.count == len(m) - 2
        verdict = moments.solve({"solve": "consistent"}.get(method, method), inclination=np.arccos(0.54))
        assert ("good", "weak", "refused")[mag.verdict] == verdict != "refused"
        assert np.linalg.norm(mag.bias - moments.model.hard_iron) < 1e-3 * 47
        np.testing.assert_allclose(np.linalg.inv(np.reshape(mag.matrix, (3, 3))), moments.model.soft_iron, atol=1e-3)
        assert mag.heading_error == pytest.approx(moments.heading_error, rel=0.02)
        home = Moments(np.array(mag.sum), mag.centre, mag.scale[0])
        assert home.solve({"solve": "consistent"}.get(method, method), inclination=np.arccos(0.54)) == verdict


def test_hostile_readings_give_no_nan_and_nothing_good(code):
    rng = np.random.default_rng(3)
    for m in (
        rng.integers(0, 2**32, (200, 3), dtype=np.uint32).view(np.float32), rng.uniform(-1, 1, (200, 3)), np.full((50, 3), 3.0),
        rng.integers(-1, 2, (200, 3)), 1e-30 * rng.integers(0, 99, (99, 3)), 1e18 * rng.uniform(-1, 1, (99, 3)), np.eye(3),
        rng.uniform(-1, 1, (200, 3)) * [1, 1, 0], np.zeros((50, 3)),
    ):  # fmt: skip
        for method in ("solve", "constrained"):
            with np.errstate(all="ignore"):
                mag = calibrated(code, m, method)
            assert mag.verdict != 0
            assert not np.isnan([mag.field, mag.noise, mag.heading_error, *mag.bias, *mag.matrix]).any()


def test_faces_and_a_gyroscope_at_rest(code):
    rng, faces, rest = np.random.default_rng(5), (ctypes.c_uint8 * 96)(), (ctypes.c_uint8 * 64)()
    bias, scale = (ctypes.c_float * 3)(), (ctypes.c_float * 3)()
    code.jaxcal_faces_begin(faces)
    assert code.jaxcal_faces_solve(faces, ctypes.c_float(9.81), bias, scale) == 0
    for up in (*np.eye(3), *-np.eye(3)):
        for _ in range(50):
            y = np.float32(9.81 * 1.02 * up + [0.1, -0.2, 0.3] + 0.02 * rng.standard_normal(3))
            code.jaxcal_faces_add(faces, y.ctypes.data_as(ctypes.c_void_p))
    assert code.jaxcal_faces_solve(faces, ctypes.c_float(9.81), bias, scale) == 1
    np.testing.assert_allclose(bias, [0.1, -0.2, 0.3], atol=0.01)
    np.testing.assert_allclose(scale, 1.02, atol=1e-3)
    code.jaxcal_rest_begin(rest, ctypes.c_float(0.002), 100)
    for i in range(400):  # the second window moves
        y = np.float32([0.01, -0.02, 0.03] + (0.5 if 100 <= i < 200 else 0.001) * rng.standard_normal(3))
        assert code.jaxcal_rest_add(rest, y.ctypes.data_as(ctypes.c_void_p)) == (i in (99, 299, 399))
    np.testing.assert_allclose(np.frombuffer(rest, np.float32, 3), [0.01, -0.02, 0.03], atol=2e-4)


@pytest.mark.parametrize("double", [(), ("-DJAXCAL_DOUBLE",)])
def test_another_compiler_and_double(folder, double):
    assert built(folder, "clang", "-shared", "-fPIC", *double, out="clang.so").exists()


@pytest.mark.parametrize("core", [("-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"), ("-mcpu=cortex-m0plus",)])
def test_it_fits_a_small_processor(folder, core):
    built(folder, "arm-none-eabi-gcc", "-mthumb", "-Os", "-c", *core, out="arm.o")
    said = subprocess.run(["arm-none-eabi-size", "arm.o"], cwd=folder, check=True, capture_output=True, text=True).stdout
    text, data, bss = map(int, said.split()[6:9])
    assert text <= 8192
    assert data == bss == 0
    assert ctypes.sizeof(Mag) <= 512


def test_moments_refuse_what_they_cannot_use(refuses):
    moments = Moments()
    assert moments.solve() == "refused"
    assert moments.reasons == ("few",)
    assert moments.model is None
    with refuses("bad_method"):
        moments.solve("ml")
    with refuses("bad_moments"):
        Moments(np.ones(34))
