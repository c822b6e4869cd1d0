"""`Calibration` against the golden file of its schema, and round trips of all its contents."""

import csv
import dataclasses
import json
import math
import pathlib
from typing import Any

import numpy as np
import pytest
import scipy

import jaxcal
from jaxcal import Calibration
from jaxcal.calibration import Part, Thermal, difference
from jaxcal.fitting import Estimate
from jaxcal.imu import Triad
from jaxcal.magnetometer import MagModel
from jaxcal.noise import Noise
from jaxcal.temperature import AbstractCurve, Chebyshev, ThermalModel

from .made_fit import made_fit

GOLDEN = pathlib.Path(__file__).parent / "export" / "golden.json"


@pytest.fixture
def golden():
    return json.loads(GOLDEN.read_text())


def saved(calibration, path):
    calibration.save(path)
    return path.read_bytes()


def loaded_from(document, path):
    path.write_text(json.dumps(document))
    return Calibration.load(path)


def close(a, b):
    if isinstance(a, dict):
        return list(a) == list(b) and all(close(a[key], b[key]) for key in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(close(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, float):
        return math.isclose(a, b, rel_tol=1e-12, abs_tol=0.0)
    return type(a) is type(b) and a == b


def test_golden_file_comes_back_byte_for_byte(tmp_path):
    assert saved(Calibration.load(GOLDEN), tmp_path / "a.json") == GOLDEN.read_bytes()


def test_golden_file_from_arrays(golden, tmp_path):
    def arrays(value):
        if isinstance(value, dict):
            return {key: arrays(item) for key, item in value.items()}
        return np.array(value) if isinstance(value, list) else value

    sections = {name: arrays(golden[name]) for name in ("noise", "imu", "magnetometer", "temperature")}
    saved(Calibration(**sections, device=golden["device"]), tmp_path / "a.json")
    assert close(golden, json.loads((tmp_path / "a.json").read_text()))


def test_fits_round_trip_without_loss(tmp_path):
    fits = {"gyro_x": made_fit(1.0), "gyro_y": made_fit(2.0), "gyro_z": made_fit(math.pi), "accel_y": made_fit()}
    first = saved(Calibration(noise=fits, device="unit 7"), tmp_path / "a.json")
    again = Calibration.load(tmp_path / "a.json")
    assert saved(again, tmp_path / "b.json") == first
    gyro, accel = again.noise.gyro, again.noise.accel
    np.testing.assert_array_equal(gyro.N, 1e-4 * np.array([1.0, 2.0, math.pi]))
    assert gyro.R is None  # not among the terms
    assert gyro.verdict["B"] == ("hint", "hint", "hint")
    assert (gyro.method, gyro.confidence) == ("gls", 0.95)
    assert gyro.covariance.parameters == ("Q^2", "N^2", "B^2", "K^2")
    np.testing.assert_array_equal(gyro.covariance.values[2], made_fit().covariance.array)
    np.testing.assert_array_equal(gyro.high["N"], [fits[f"gyro_{axis}"].interval["N"][1] for axis in "xyz"])
    np.testing.assert_array_equal(accel.N, [np.nan, 1e-4, np.nan])  # only y was measured
    assert accel.verdict["K"] == (None, "not detected", None)
    assert again.device == {"name": "unit 7"}


def test_what_json_cannot_say_is_null_and_processes_are_kept(tmp_path):
    limits = {"Q": math.inf, "N": 1.0, "B": math.nan, "K": -math.inf}
    noise = Noise(N=1e-4, markov=((1e-3, 20.0),), sinusoid=((1e-4, 0.1), (2e-4, 0.2)))
    fits = {"gyro_z": made_fit(noise=noise), "accel_x": made_fit(upper_limit=limits)}
    first = saved(Calibration(noise=fits), tmp_path / "a.json")
    assert json.loads(first)["noise"]["accel"]["upper_limit"]["Q"] == [None, None, None]
    again = Calibration.load(tmp_path / "a.json")
    np.testing.assert_array_equal(again.noise.accel.upper_limit["Q"], [np.nan] * 3)
    assert again.noise.gyro.markov == ((), (), ((1e-3, 20.0),))
    assert again.noise.gyro.sinusoid == ((), (), ((1e-4, 0.1), (2e-4, 0.2)))
    assert saved(again, tmp_path / "b.json") == first


def test_covariance_of_a_model_keeps_its_parameter_order(golden, tmp_path):
    golden["magnetometer"]["covariance"] = {"parameters": ["a", "b"], "values": [[1e-9, 0.0], [0.0, 2e-9]]}
    again = loaded_from(golden, tmp_path / "a.json")
    assert again.magnetometer.estimate.names == ("a", "b")
    saved(again, tmp_path / "b.json")
    assert close(golden, json.loads((tmp_path / "b.json").read_text()))


def test_provenance_carries_the_version(tmp_path):
    given = {"file": pathlib.PurePosixPath("logs/static.csv"), "sha256": "0" * 64, "options": {"band": (0.1, np.float64(30.0))}}
    calibration = Calibration(provenance=given)
    assert calibration.provenance["version"] == jaxcal.__version__
    first = saved(calibration, tmp_path / "a.json")
    assert json.loads(first)["provenance"]["file"] == "logs/static.csv"
    assert json.loads(first)["provenance"]["options"] == {"band": [0.1, 30.0]}
    assert saved(Calibration.load(tmp_path / "a.json"), tmp_path / "b.json") == first


def test_a_file_without_version_is_not_signed_by_this_one(golden, tmp_path):
    golden["provenance"] = {"file": "a.csv"}
    assert loaded_from(golden, tmp_path / "a.json").provenance == {"file": "a.csv", "version": None}


def test_unknown_keys_are_ignored_and_missing_sections_are_none(golden, tmp_path):
    golden["colour"] = "red"
    golden["noise"]["gyro"]["colour"] = [1]
    golden["schema"] = "jaxcal.calibration/1.7"
    del golden["imu"]
    again = loaded_from(golden, tmp_path / "a.json")
    assert again.imu is None
    assert "colour" not in saved(again, tmp_path / "b.json").decode()


@pytest.mark.parametrize(
    ("keys", "value", "code", "subject"),
    [
        (("schema",), "jaxcal.calibration/2", "version", ""), (("schema",), "something", "schema", ""), (("schema",), 1, "schema", ""),
        (("noise", "gyro", "N"), None.__class__, "missing", "noise.gyro.N"), (("noise", "rate"), None.__class__, "missing", "noise.rate"),
        *((("noise", "rate"), wrong, "value", "noise.rate") for wrong in (-1.0, "200", True)),
        (("noise", "gyro", "unit"), "deg/s", "value", "noise.gyro.unit"), (("noise", "gyro"), [1], "value", "noise.gyro"),
        *((("noise", "gyro", "N"), wrong, "value", "noise.gyro.N") for wrong in ([1.0, 2.0], ["1", "2", "3"])),
        (("noise", "gyro", "verdict"), {"N": ["present", 1, None]}, "value", "noise.gyro.verdict.N[1]"),
        (("noise", "gyro", "verdict"), {"N": "present"}, "value", "noise.gyro.verdict.N"),
        (("imu", "accel", "matrix"), [[1.0, 0.0, 0.0], [0.0, 1.0]], "value", "imu.accel.matrix"),
        (("imu", "gyro", "g_sensitivity"), None.__class__, "missing", "imu.gyro.g_sensitivity"),
        (("magnetometer", "hard_iron"), {}, "value", "magnetometer.hard_iron"),
        (("temperature", "accel"), [[1.0]], "value", "temperature.accel"), (("device",), 3, "value", "device"),
    ],
)  # fmt: skip
def test_damaged_files_are_refused_by_key(golden, tmp_path, keys, value, code, subject, refuses):
    *parents, last = keys
    place = golden
    for key in parents:
        place = place[key]
    if value is type(None):
        del place[last]
    else:
        place[last] = value
    with refuses(code) as caught:
        loaded_from(golden, tmp_path / "a.json")
    assert caught.value.subject == str(tmp_path / "a.json") + (f": {subject}" if subject else "")


def test_a_device_may_be_a_name(golden, tmp_path):
    assert loaded_from(golden | {"device": "golden"}, tmp_path / "a.json").device == {"name": "golden"}


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (None, "unreadable"), ("[]", "schema"), ("\ufeff{}", "not_json"), ('{"schema": "jaxcal.calibration/2.1"}', "version"),
        ('{"schema": "jaxcal.calibration/0.9"}', "version"), (b"\xff\xfe\x00", "not_json"), ("{", "not_json"), ('"\\ud800"', "schema"),
        ("NaN", "not_json"), ("[" * 100_000, "endless"), ('{"a":' * 200_000, "endless"), ('{"a": 1' + "0" * 5000 + "}", "not_json"),
        ('{"schema": ' + "[" * 5000 + "]" * 5000 + "}", "endless"),
        ('{"schema": "jaxcal.calibration/1", "provenance": {"a": 1e999}}', "value"),
        ('{"schema": "jaxcal.calibration/1", "provenance": NaN}', "not_json"), (200 * 2**20, "too_large"),
    ],
    ids=range(16),
)  # fmt: skip
def test_files_that_are_no_calibration(content, code, tmp_path, refuses):
    if isinstance(content, int):
        with open(tmp_path / "a.json", "wb") as file:
            file.truncate(content)
    elif content is not None:
        (tmp_path / "a.json").write_bytes(content if isinstance(content, bytes) else content.encode())
    with refuses(code):
        Calibration.load(tmp_path / "a.json")


def test_channels_that_do_not_belong_together(refuses):
    for code, noise in (
        ("channel", {"wx": made_fit()}),
        ("rates", {"gyro_x": made_fit(), "gyro_y": made_fit(rate=100.0)}),
        ("terms_differ", {"gyro_x": made_fit(), "gyro_y": made_fit(confidence=0.9)}),
        ("missing", {}),
    ):
        with refuses(code):
            Calibration(noise=noise)


def test_a_sensor_may_be_slower_than_its_log():
    assert Calibration(noise={"accel_x": made_fit(rate=100.0), "gyro_x": made_fit(rate=200.0)}).noise.rate == 200.0


def test_a_magnetometer_fit_corrects_a_log(tmp_path, refuses):
    field = jaxcal.magnetometer.body_field(jaxcal.magnetometer.scenario("all"), 50e-6)
    true = jaxcal.magnetometer.MagModel(np.array([[1.1, 0.1, 0.0], [0.1, 0.9, 0.0], [0.0, 0.0, 1.0]]), np.array([2e-5, -1e-5, 3e-5]))
    found = jaxcal.magnetometer.fit(true.measure(field), field=50e-6)
    jaxcal.Calibration(magnetometer=found).save(tmp_path / "device.json")
    loaded = jaxcal.Calibration.load(tmp_path / "device.json")
    np.testing.assert_array_equal(loaded.magnetometer.estimate.matrix, found.estimate.matrix)
    assert (loaded.magnetometer.verdict, loaded.magnetometer.verdict_reason) == (found.verdict, found.reason)
    log = jaxcal.Log(None, mag=np.vstack([true.measure(field), [[np.nan] * 3]]), gyro=np.arange(1083.0).reshape(361, 3), rate=10.0)
    fixed = loaded.correct(log)
    np.testing.assert_allclose(fixed.mag[:-1], field, atol=1e-12)
    assert np.isnan(fixed.mag[-1]).all()
    np.testing.assert_array_equal(fixed.gyro, log.gyro)
    assert (fixed.findings[-1].code, fixed.findings[-1].subject) == ("corrected", ("mag",))
    with refuses("nothing"):
        loaded.correct(jaxcal.Log(None, gyro=log.gyro, rate=10.0))
    with refuses("refused"):
        jaxcal.Calibration(magnetometer=jaxcal.magnetometer.fit(field[:2]))


def test_a_calibration_in_counts_is_written_applied_and_exported(tmp_path, refuses):
    field = jaxcal.magnetometer.body_field(jaxcal.magnetometer.scenario("all"), 500.0)
    counts = np.round(1.1 * field + [120.0, -30.0, 45.0])
    found = jaxcal.magnetometer.fit(counts)
    jaxcal.Calibration(magnetometer=found).save(tmp_path / "device.json")
    device = jaxcal.Calibration.load(tmp_path / "device.json")
    assert (device.magnetometer.unit, device.magnetometer.field) == ("counts", found.field)
    fixed = device.correct(jaxcal.Log(None, mag=counts, rate=10.0)).mag
    np.testing.assert_allclose(np.linalg.norm(fixed, axis=1), found.field, rtol=5e-3)
    for name in ("csv", "c"):
        jaxcal.export.write(device, tmp_path / name, format=name, force=True)
    rows = list(csv.DictReader((tmp_path / "csv").read_text().splitlines()))
    np.testing.assert_allclose([float(row["value"]) for row in rows if row["name"].startswith("mag.hard_iron")], found.model.hard_iron)
    assert {row["unit"] for row in rows} == {"", "counts"}
    with refuses("counts"):
        jaxcal.export.write(device, tmp_path / "px4", format="px4", force=True)


# user-defined models


def test_a_file_with_intervals_loads_with_their_degrees_of_freedom(golden, tmp_path):
    """Files of this version before degrees of freedom were written hold the limits of the intervals."""
    names = [f"hard_iron[{i}]" for i in range(3)]
    half = scipy.stats.t.ppf(0.975, 8.0) * 1e-7
    golden["magnetometer"] |= {
        "covariance": {"parameters": names, "values": (1e-14 * np.eye(3)).tolist()}, "interval": {"low": [-half] * 3, "high": [half] * 3}
    }  # fmt: skip
    held = loaded_from(golden, tmp_path / "a.json").magnetometer.estimate
    np.testing.assert_allclose(held.freedom, 8.0, rtol=1e-6)
    np.testing.assert_allclose(held.values, golden["magnetometer"]["hard_iron"])


class WarmMagnetometer(MagModel):
    """A magnetometer whose hard iron changes with the temperature."""

    slope: Any = 0.0

    def measure(self, h, temperature):
        return super().measure(h) + np.outer(temperature - 25.0, self.slope)

    def correct(self, m, temperature):
        return super().correct(m - np.outer(temperature - 25.0, self.slope))


class BentAccelerometer(Triad):
    """An accelerometer with a quadratic term along each axis."""

    bend: Any = 0.0

    def measure(self, x, accel=None):
        return super().measure(x + self.bend * x**2)

    def correct(self, y, accel=None):
        straight = super().correct(y)
        return (np.sqrt(1 + 4 * self.bend * straight) - 1) / (2 * self.bend)


class Quadratic(AbstractCurve):
    """A user-defined thermal curve."""

    vertex: float
    gain: float

    def value(self, t):
        return self.gain * (t - self.vertex) ** 2


SOFT = np.array([[1.1, 0.1, 0.0], [0.1, 0.9, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def own():
    """A device with user-defined models that have additional fields."""
    mag = WarmMagnetometer(SOFT, np.array([2e-5, -1e-5, 3e-5]), np.array([1e-8, 0.0, -2e-8]))
    names = [
        *(f"soft_iron[{i},{j}]" for i in range(3) for j in range(3)),
        *(f"{name}[{i}]" for name in ("hard_iron", "slope") for i in range(3)),
    ]
    estimate = Estimate([*names, "field"], np.zeros(16), np.diag([1e-4] * 9 + [1e-14] * 3 + [1e-20] * 3 + [1e-14]))
    known = Part(mag, "T", 5e-5, estimate, verdict="good", verdict_reason="Even.")
    accel = BentAccelerometer(np.diag([1.01, 1.0, 0.99]), np.array([0.1, 0.0, -0.2]), bend=np.array([1e-4, 2e-4, -1e-4]))
    curve = ThermalModel(Quadratic(20.0, 1e-5), 0.0, 50.0)
    return Calibration(magnetometer=known, imu={"accel": accel}, temperature=Thermal(25.0, 0.0, 50.0, {"gyro_x": curve}), device="own")


@pytest.fixture(scope="module")
def own_log(own):
    """Readings of the device `own`, the true field and the true specific force."""
    draw, t = np.random.default_rng(0), np.linspace(10.0, 40.0, 20)
    field, force = 5e-5 * draw.standard_normal((20, 3)), 9.8 * draw.standard_normal((20, 3))
    log = jaxcal.Log(
        None, mag=own.magnetometer.model.measure(field, t), accel=own.imu.accel.model.measure(force), temperature=t, rate=1.0,
        gyro=np.stack([1e-5 * (t - 20.0) ** 2, 0 * t, 0 * t], axis=1),
    )  # fmt: skip
    return log, field, force


def test_models_of_ones_own_are_saved_loaded_and_applied(own, own_log, tmp_path):
    log, field, force = own_log
    first = saved(own, tmp_path / "a.json")
    document = json.loads(first)
    assert document["magnetometer"]["class"] == "WarmMagnetometer"
    assert document["magnetometer"]["slope"] == [1e-8, 0.0, -2e-8]
    assert document["imu"]["accel"]["class"] == "BentAccelerometer"
    assert document["temperature"]["channels"]["gyro_x"]["curve"] == "Quadratic"
    again = Calibration.load(tmp_path / "a.json")
    assert saved(again, tmp_path / "b.json") == first
    assert type(again.magnetometer.model) is WarmMagnetometer
    assert type(again.temperature.channels["gyro_x"].curve) is Quadratic
    fixed = again.correct(log)
    np.testing.assert_allclose(fixed.mag, field, rtol=0, atol=1e-16)
    np.testing.assert_allclose(fixed.accel, force, rtol=0, atol=1e-10)
    np.testing.assert_allclose(fixed.gyro, 0.0, rtol=0, atol=1e-15)


def test_a_model_that_needs_what_the_log_lacks(own, own_log, refuses):
    log = own_log[0]
    with refuses("no_temperature"):
        Calibration(magnetometer=own.magnetometer).correct(jaxcal.Log(None, mag=log.mag, rate=10.0))

    class Loaded(MagModel):
        def correct(self, m, current):
            return m

    with refuses("condition"):
        Calibration(magnetometer=Loaded(SOFT, np.zeros(3))).correct(log)
    wrong = WarmMagnetometer(SOFT, np.zeros(3), np.zeros(7))
    with refuses("model"):
        Calibration(magnetometer=wrong).correct(log)


@pytest.mark.parametrize(("section", "key"), [("magnetometer", "class"), ("accel", "class"), ("gyro_x", "curve")])
def test_a_class_that_nobody_imported(own, tmp_path, section, key, refuses):
    document = json.loads(saved(own, tmp_path / "a.json"))
    channels = document["temperature"]["channels"]
    places = {"magnetometer": document["magnetometer"], "accel": document["imu"]["accel"], "gyro_x": channels["gyro_x"]}
    places[section][key] = "os.system"
    with refuses("class"):
        loaded_from(document, tmp_path / "b.json")
    places[section][key] = "Undreamt"
    del document["imu"]
    if section != "accel":
        with refuses("class"):
            loaded_from(document, tmp_path / "b.json")


def test_damage_in_a_field_of_ones_own(own, tmp_path, refuses):
    for value in (["a"], 10**400, [[1.0], [2.0, 3.0]]):
        document = json.loads(saved(own, tmp_path / "a.json"))
        document["magnetometer"]["slope"] = value
        with refuses("value"):
            loaded_from(document, tmp_path / "b.json")


def test_a_field_of_ones_own_in_a_difference(own):
    moved = WarmMagnetometer(SOFT, own.magnetometer.model.hard_iron, own.magnetometer.model.slope + np.array([5e-10, 0.0, 0.0]))
    known = Part(moved, "T", 5e-5, own.magnetometer.estimate)
    mag = next(part for part in difference(own, Calibration(magnetometer=known)) if part.name == "magnetometer")
    assert mag.parameters[-3:] == ("slope[0]", "slope[1]", "slope[2]")
    assert mag.change[-3] == pytest.approx(5e-10)
    assert mag.standard_error[-3] == pytest.approx(np.sqrt(2e-20))
    assert mag.degrees_of_freedom == 15
    names = tuple(name for name in known.parameters if name.startswith(("hard_iron", "slope")))
    fitted = [dataclasses.replace(part, estimate=Estimate(names, np.zeros(6), 1e-20 * np.eye(6))) for part in (own.magnetometer, known)]
    (mag,) = difference(*(Calibration(magnetometer=part) for part in fitted))
    assert mag.parameters == names
    assert mag.chi_square == pytest.approx(5e-10**2 / 2e-20)
    (mag,) = difference(own, Calibration(magnetometer=MagModel(SOFT, own.magnetometer.model.hard_iron)))
    (told,) = [one for one in mag.findings if one.code == "classes"]
    assert (told.facts["first"], told.facts["second"]) == ("WarmMagnetometer", "MagModel")


def test_models_of_ones_own_are_composed_where_that_means_something(own, own_log, refuses):
    gyro = Calibration(imu={"gyro": Triad(np.eye(3), np.zeros(3))})
    both = own.compose(Calibration(noise=None))
    np.testing.assert_array_equal(both.correct(own_log[0]).accel, own.correct(own_log[0]).accel)
    assert type(both.magnetometer.model) is WarmMagnetometer
    with refuses("own_model"):
        own.compose(gyro)
    with refuses("own_model"):
        Calibration(magnetometer=own.magnetometer).compose(Calibration(magnetometer=MagModel(SOFT, np.zeros(3))))


def test_an_export_says_what_it_cannot_hold(own, tmp_path):
    found = jaxcal.export.write(Calibration(magnetometer=own.magnetometer), tmp_path / "a", format="c")
    (left,) = (one.facts for one in found if one.code == "fields_left_out")
    assert left == {"tool": "c", "fields": "slope", "model": "WarmMagnetometer"}


class Nested(MagModel):
    """A model with a nested model and text as fields."""

    drift: Chebyshev = None
    remark: str = ""


def test_a_model_within_a_model(tmp_path):
    model = Nested(SOFT, np.zeros(3), Chebyshev(np.array([1.0, 2.0]), 0.0, 50.0), "warm")
    saved(Calibration(magnetometer=model), tmp_path / "a.json")
    again = Calibration.load(tmp_path / "a.json").magnetometer.model
    assert again.remark == "warm"
    np.testing.assert_array_equal(again.drift.value(np.array([50.0])), [3.0])
