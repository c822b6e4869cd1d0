"""Composition, inverse and difference of calibrations."""

import contextlib
import copy
import json
import pathlib
import re
from functools import partial

import numpy as np
import pytest
from scipy.stats import kstest

import jaxcal
from jaxcal import Calibration, JaxcalError, Log
from jaxcal.calibration import Part, difference
from jaxcal.fitting import Estimate
from jaxcal.imu import Triad
from jaxcal.magnetometer import MagModel

from .made_calibration import made

GOLDEN = pathlib.Path(__file__).parent / "export" / "golden.json"
DOCUMENT = json.loads(GOLDEN.read_text())
NAMES = [f"matrix[{i},{j}]" for i in range(3) for j in range(3)] + [f"bias[{i}]" for i in range(3)]
GYRO_NAMES = NAMES + [f"g_sensitivity[{i},{j}]" for i in range(3) for j in range(3)]
MAG_NAMES = [*(f"hard_iron[{i}]" for i in range(3)), *(f"soft_iron[{i},{j}]" for i in range(3) for j in range(3)), "field"]


@pytest.fixture(scope="module")
def golden():
    return Calibration.load(GOLDEN)


@pytest.fixture(scope="module")
def log():
    draw = np.random.default_rng(0)
    raw = {"gyro": draw.standard_normal((50, 3)), "accel": 9.8 * draw.standard_normal((50, 3)), "mag": 5e-5 * draw.standard_normal((50, 3))}
    return Log(None, **raw, temperature=np.linspace(12, 58, 50), rate=10.0)


def same(a, b):
    for sensor, size in (("gyro", 1.0), ("accel", 10.0), ("mag", 5e-5)):
        np.testing.assert_allclose(getattr(a, sensor), getattr(b, sensor), rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("sensors", ["", "imu", "magnetometer", "accel", "gyro"])
@pytest.mark.parametrize("swapped", [False, True])
def test_composed_is_one_after_the_other(golden, log, sensors, swapped):
    part = {"imu": {sensors: getattr(made(3).imu, sensors)}} if sensors in ("accel", "gyro") else {sensors: None} if sensors else {}
    old, new = (made(1, **part), made(2, temperature=None)) if swapped else (golden, made(1, temperature=None, **part))
    same(new.compose(old).correct(log), new.correct(old.correct(log)))
    alone = made(1, imu=None, temperature=None)
    same(golden.compose(alone).correct(log), golden.correct(alone.correct(log)))


def test_composed_matrices(golden):
    """The matrix is C_new C_old, and the new bias is mapped back through C_old, as in section 2.15 of formats.md."""
    new, old = made(2, temperature=None), golden
    both = new.compose(old).imu.accel
    c_new, c_old = (np.linalg.inv(one.imu.accel.model.matrix) for one in (new, old))
    np.testing.assert_allclose(np.linalg.inv(both.model.matrix), c_new @ c_old, rtol=1e-13)
    np.testing.assert_allclose(both.model.bias, old.imu.accel.model.bias + np.linalg.inv(c_old) @ new.imu.accel.model.bias, rtol=1e-13)
    assert new.compose(old).provenance["composed"] == {"first": None, "then": None}


def test_the_covariance_is_carried_to_the_raw_readings():
    """The covariance equals that of compositions in which the new parameters are changed along the columns of its root."""
    draw = np.random.default_rng(7)
    size = 1e-3
    root = size * np.tril(draw.standard_normal((21, 21)) / 5 + np.eye(21))
    new, old = made(5), made(6)

    def drawn(step, known=None):
        gyro = new.imu.gyro.model
        matrix, bias = gyro.matrix + step[:9].reshape(3, 3), gyro.bias + step[9:12]
        moved = Triad(matrix, bias, gyro.g_sensitivity + step[12:].reshape(3, 3))
        return Calibration(imu={"gyro": Part(moved, "rad/s", estimate=known)})

    def flat(calibration):
        return np.array(list(calibration.imu.gyro.parameters.values()))

    whole = drawn(np.zeros(21), Estimate(GYRO_NAMES, np.zeros(21), root @ root.T)).compose(old)
    middle = flat(drawn(np.zeros(21)).compose(old))
    # the composition is linear in the new numbers, so that unit steps give it exactly
    columns = np.stack([flat(drawn(root[:, k]).compose(old)) - middle for k in range(21)], axis=1)
    np.testing.assert_allclose(whole.imu.gyro.estimate.matrix, columns @ columns.T, rtol=0, atol=1e-12)


def test_the_covariance_of_a_magnetometer_is_carried():
    new, old = made(5).magnetometer, made(6).magnetometer
    root = 1e-6 * np.tril(np.random.default_rng(1).standard_normal((13, 13)))
    known = Part(new.model, "T", new.field, Estimate(MAG_NAMES, np.zeros(13), root @ root.T))
    found = Calibration(magnetometer=known).compose(Calibration(magnetometer=old)).magnetometer
    soft = old.model.soft_iron
    moved = np.array([[*(soft @ step[:3]), *(soft @ step[3:12].reshape(3, 3)).ravel(), step[12]] for step in root.T]).T
    np.testing.assert_allclose(found.estimate.matrix, moved @ moved.T, rtol=1e-10, atol=1e-30)
    np.testing.assert_allclose(found.model.soft_iron, soft @ new.model.soft_iron, rtol=1e-12)


@pytest.mark.parametrize("old", [{"temperature": None}, {"imu": None}])
def test_thermal_models_of_corrected_readings(golden, old, refuses):
    with refuses("thermal"):
        golden.compose(made(1, **old))


def drawn_pair(draw, change):
    """Two random fits of an accelerometer whose z bias changed; matrix elements below the diagonal are fixed, as in "upper"."""
    root = 1e-3 * np.tril(np.random.default_rng(3).standard_normal((12, 12)))
    fixed = [3, 6, 7]
    root[fixed] = 0.0
    devices = []
    for shift in (0.0, change):
        step = root @ draw.standard_normal(12)
        accel = {"unit": "m/s^2", "matrix": np.eye(3) + step[:9].reshape(3, 3), "bias": step[9:] + np.array([0, 0, shift]),
                 "covariance": {"parameters": NAMES, "values": root @ root.T}}  # fmt: skip
        devices.append(Calibration(imu={"accel": accel}))
    return difference(*devices)[0]


def test_significance_is_that_of_chance():
    draw = np.random.default_rng(11)
    parts = [drawn_pair(draw, 0.0) for _ in range(200)]
    assert {part.degrees_of_freedom for part in parts} == {9}
    assert kstest([part.probability for part in parts], "uniform").pvalue > 0.01
    assert not any(part.findings for part in parts)
    found = drawn_pair(draw, 0.05)
    assert found.probability < 1e-4
    assert found.change[11] == pytest.approx(0.05, abs=5 * found.standard_error[11])
    assert found.standard_error[3] == 0.0


def test_conventions_and_missing_covariances_are_told(golden):
    known = DOCUMENT["imu"]["accel"] | {"covariance": {"parameters": NAMES, "values": np.diag([1e-6] * 3 + [0.0] * 6 + [1e-6] * 3)}}
    a, b = Calibration(imu={"accel": known}), Calibration(imu={"accel": known | {"matrix": np.eye(3)}})
    (part,) = difference(a, b)
    assert [one.code for one in part.findings] == ["conventions"]
    (part,) = difference(a, Calibration(imu={"accel": golden.imu.accel}))
    assert [(one.code, one.facts["which"]) for one in part.findings] == [("one_covariance", "second")]
    assert part.chi_square == 0.0
    parts = difference(golden, golden)
    assert [part.name for part in parts] == [
        "accel", "gyro", "magnetometer", *(f"noise {s}_{axis}" for s in ("gyro", "accel") for axis in "xyz"), "temperature gyro",
        "temperature accel",
    ]  # fmt: skip
    assert all(np.isnan(part.probability) and not part.change.any() for part in parts)
    signed = Calibration(imu={"accel": known}, provenance={"sha256": "a"})
    assert "same_recording" in difference(signed, signed).codes


def test_a_calibration_prints_its_numbers_and_a_difference_is_one_result(golden):
    said = repr(golden)
    assert "f64" not in said
    assert re.search(r"hard iron +uT +12.5 +-7.25 +30", said)
    assert 'data-number="gyro.bias[2]"' in golden._repr_html_()
    found = difference(golden, golden)
    assert found.codes == {"no_covariance", "range"}
    assert found.numbers["gyro.bias[0].first"].unit == "rad/s"
    assert found.numbers["noise gyro_x.N.first"].quantity == "N.gyro"
    assert set(found.to_dict()["numbers"]) == set(found.numbers)


def test_a_magnetometer_that_changed():
    """The difference is significant for a recording with another hard iron, but not for another recording of the same device."""
    field = jaxcal.magnetometer.body_field(jaxcal.magnetometer.scenario("all"), 50e-6)
    soft, hard = np.array([[1.1, 0.05, 0.0], [0.05, 0.95, 0.0], [0.0, 0.0, 1.0]]), np.array([2e-5, -1e-5, 3e-5])

    def device(seed, shift=0.0):
        noise = 3e-7 * np.random.default_rng(seed).standard_normal(field.shape)
        readings = MagModel(soft, hard + np.array([shift, 0, 0])).measure(field) + noise
        return Calibration(magnetometer=jaxcal.magnetometer.fit(readings, field=50e-6))

    one = device(1)
    (same_device,) = difference(one, device(2))
    assert same_device.probability > 1e-3
    assert same_device.degrees_of_freedom == 9
    assert np.all(np.abs(same_device.change) < 4.5 * same_device.standard_error)
    (changed,) = difference(one, device(3, 1e-6))
    assert changed.probability < 1e-6
    assert changed.change[6] == pytest.approx(1e-6, abs=4.5 * changed.standard_error[6])
    assert np.argmax(np.abs(changed.change / changed.standard_error)) == 6


def test_thermal_models_that_changed(golden):
    moved = {**DOCUMENT["temperature"], "accel": golden.temperature.powers("accel") + np.array([[1e-4, 0, 0], [0, 0, 0], [0, 0, 0]])}
    (gyro, accel) = difference(Calibration(temperature=golden.temperature), Calibration(temperature=moved))
    assert not gyro.change.any()
    np.testing.assert_allclose(np.abs(accel.change), [2.5e-3, 0, 0], atol=1e-15)


def places(value, path=()):
    yield path
    for key, item in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield from places(item, (*path, key))


ROUNDS = 300
FORMATS = ("px4", "ardupilot", "c", "ros", "csv", "kalibr", "openvins", "vins", "gtsam", "motioncal")
JUNK = [
    None, True, -1, 0, 1e308, 10**400, "text", "\ud800", [], {}, [[]], [[[1.0]]], {"a": 1}, float("nan"), float("inf"), "x" * 10_000,
    [0.0] * 9,
]  # fmt: skip


@pytest.mark.long
def test_a_mutated_file_ends_in_a_sentence(golden, log, tmp_path):
    """A file with random values replaced, removed or copied is refused, or all results computed from it are finite."""
    full = made(1)
    document = json.loads(GOLDEN.read_text())
    document["imu"]["accel"]["covariance"] = {"parameters": NAMES, "values": np.eye(12).tolist()}
    document["imu"] |= {"verdict": "good", "verdict_reason": "well"}
    document["temperature"]["channels"] = {
        "mag_x": {"curve": "steps", "minimum": 0.0, "maximum": 50.0, "lag": 1.0, "play": 0.1, "coefficients": [1e-6, 1e-7],
                  "height": [1e-6], "centre": [20.0], "width": [0.1]},
        "mag_y": {"curve": "piecewise", "minimum": 0.0, "maximum": 50.0, "lag": 0.0, "play": 0.0, "nodes": [0.0, 25.0, 50.0],
                  "pieces": [[0.0, 1e-7], [1e-6, 0.0]]},
        "mag_z": {"curve": "chebyshev", "minimum": 0.0, "maximum": 50.0, "lag": 0.0, "play": 0.0, "coefficients": [1e-6]},
    }  # fmt: skip
    everywhere = [path for path in places(document) if path]
    draw = np.random.default_rng(0)
    path, refused = tmp_path / "a.json", 0
    for _ in range(ROUNDS):
        damaged = copy.deepcopy(document)
        for _ in range(draw.integers(1, 3)):
            *parents, last = everywhere[draw.integers(len(everywhere))]
            place = damaged
            try:
                for key in parents:
                    place = place[key]
                kind = draw.integers(4)
                if kind == 0:
                    del place[last]
                elif kind == 1 and isinstance(place[last], float):
                    place[last] = -place[last] * 10.0 ** draw.integers(-5, 20)
                else:
                    place[last] = copy.deepcopy(JUNK[draw.integers(len(JUNK))])
            except (KeyError, IndexError, TypeError):
                continue
        path.write_text(json.dumps(damaged))
        try:
            found = Calibration.load(path)
        except JaxcalError:
            refused += 1
            continue
        found.save(tmp_path / "b.json")
        actions = [partial(full.compose, found), partial(difference, found, full)]
        actions += [partial(jaxcal.export.write, found, tmp_path / "out", format=format) for format in FORMATS]
        for action in actions:
            with contextlib.suppress(JaxcalError):
                action()
        with contextlib.suppress(JaxcalError):
            fixed = found.correct(log)
            assert all(np.isfinite(getattr(fixed, sensor)).all() for sensor in ("gyro", "accel", "mag"))
    assert 40 < refused < ROUNDS - 40
