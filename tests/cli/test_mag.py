"""`jaxcal mag` and `jaxcal simulate mag`."""

import json
import re

import numpy as np
import pytest

import jaxcal

from .conftest import listing, save


@pytest.fixture
def simulated(call):
    """Simulate a log in all attitudes whose magnetometer is rotated by 2 degrees about z; returns the command line."""
    found = call("simulate", "mag", "--out", "tumble.csv", "--mounting", "2", "--samples", "200")
    assert (found.status, found.err) == (0, "")
    lines = found.out.splitlines()
    truth = np.array([[float(cell) for cell in line.split()] for line in lines[1:4]])
    assert np.linalg.det(truth) == pytest.approx(1.0, abs=1e-4)
    assert lines[4].startswith("as jaxcal mag gives it; with --field 47 it is ")
    return call, truth * float(lines[4].split()[-3])


def test_it_finds_the_truth_and_writes_everything(simulated, folder):
    call, truth = simulated
    found = call("mag", "tumble.csv", "--align", "accel", "--field", "47")
    assert (found.status, found.err) == (0, "")
    assert listing(folder / "tumble-mag") == ["calibration.json", "mag.json", "report.html"]
    document = json.loads((folder / "tumble-mag" / "mag.json").read_text())
    assert document["schema"] == "jaxcal.MagFit/1"
    assert document["verdict"] == "good"
    for i, true in enumerate((21.7e-6, 5.2e-6, -10.2e-6)):
        known = document["numbers"][f"hard_iron[{i}]"]
        assert abs(known["value"] - true) < known["high"] - known["low"]
    np.testing.assert_allclose(document["model"]["soft_iron"], truth, atol=6e-3)
    inverse = [[document["numbers"][f"correction[{i},{j}]"]["value"] for j in range(3)] for i in range(3)]
    np.testing.assert_allclose(np.linalg.inv(inverse), truth, atol=6e-3)
    assert np.rad2deg(document["numbers"]["alignment.angle"]["value"]) == pytest.approx(2.0, abs=0.3)
    assert "hard iron      uT" in found.out
    assert len(found.out.splitlines()) <= 30
    page = (folder / "tumble-mag" / "report.html").read_text()
    assert page.startswith("<!DOCTYPE html>")
    assert page.count("<svg") >= 5  # two planes, residuals, coverage, heading error, and the signals
    assert "Magnetometer of tumble.csv" in page
    calibration = jaxcal.Calibration.load(folder / "tumble-mag" / "calibration.json")
    np.testing.assert_array_equal(calibration.magnetometer.model.hard_iron, document["model"]["hard_iron"])


def test_a_refused_fit_ends_with_its_reason(simulated, folder):
    call, _ = simulated
    lines = (folder / "tumble.csv").read_text().splitlines()
    (folder / "few.csv").write_text("\n".join(lines[:-192]) + "\n")
    found = call("mag", "few.csv", "--model", "symmetric")
    assert (found.status, found.code) == (1, "refused")
    assert "8 distinct readings" in " ".join(found.out.split())
    assert not (folder / "few-mag").exists()
    assert call("mag", "few.csv", "--model", "symmetric", "--force", "--json", "few.json").status == 0
    assert json.loads((folder / "few.json").read_text())["model"] is None


def test_the_field_of_a_place_scales_the_result(simulated, folder):
    pytest.importorskip("pygeomag")
    call, _ = simulated
    assert call("mag", "tumble.csv", "--place", "39.93", "32.86", "--date", "2026-05-31", "--json", "out.json").status == 0
    document = json.loads((folder / "out.json").read_text())
    assert document["field"] == pytest.approx(48e-6, abs=1e-6)
    assert np.rad2deg(document["inclination"]) == pytest.approx(59, abs=2)


def test_exports_hold_what_the_calibration_says(simulated, folder):
    call, _ = simulated
    exports = ("--export", "c", "--export", "csv=mag.csv", "--export", "motioncal")
    found = call("mag", "tumble.csv", "--calibration", "device.json", *exports)
    assert found.status == 0
    assert "strength of the field was not known" in " ".join(found.out.split())
    hard = jaxcal.Calibration.load(folder / "device.json").magnetometer.model.hard_iron
    read = jaxcal.export.read(folder / "motioncal.bin", format="motioncal").magnetometer
    np.testing.assert_allclose(read.model.hard_iron, hard, rtol=1e-6)
    rows = [line.split(",") for line in (folder / "mag.csv").read_text().splitlines() if line.startswith("mag.hard_iron")]
    np.testing.assert_allclose([float(row[1]) for row in rows], hard, rtol=1e-6)
    assert "JAXCAL_MAG_BIAS" in (folder / "calibration.h").read_text()


@pytest.fixture
def counts():
    """Readings in whole numbers, as an Arduino prints them, of a field of 400 counts with the hard iron 50, -20, 10."""
    rng = np.random.default_rng(0)
    u = rng.normal(size=(300, 3))
    return np.round(400 * u / np.linalg.norm(u, axis=1, keepdims=True) + [50, -20, 10] + 4 * rng.normal(size=u.shape)).astype(int)


def test_counts_need_neither_times_nor_a_unit(call, folder, counts):
    (folder / "counts.txt").write_text("".join(f"{x} {y} {z}\n" for x, y, z in counts))
    found = call("mag", "counts.txt")
    assert (found.status, found.err) == (0, "")
    assert re.search("hard iron +counts", found.out)
    document = json.loads((folder / "counts-mag" / "mag.json").read_text())
    assert np.abs(np.array(document["model"]["hard_iron"]) - [50, -20, 10]).max() < 2
    assert (document["field"], document["numbers"]["field"]["unit"]) == (pytest.approx(400, rel=0.01), "counts")
    assert any("are counts, and so are all results" in one["text"] for one in document["log"]["findings"])
    assert jaxcal.Calibration.load(folder / "counts-mag" / "calibration.json").magnetometer.unit == "counts"


def test_counts_need_no_unit_beside_rates(call, folder, reference):
    """The log of a flight controller (pichim) has columns without names, of which three are counts and three are rates."""
    log = next((reference / "data" / "magnetometer" / "pichim").glob("*.txt"))
    found = call(
        "mag", log, "--columns", "mag=0:2,gyro=3:5", "--units", "gyro=rad/s", "--rate", "200", "--align", "gyro", "--out", "pichim"
    )
    assert (found.status, found.err) == (0, "")
    assert jaxcal.Calibration.load(folder / "pichim" / "calibration.json").magnetometer.unit == "counts"
    assert json.loads((folder / "pichim" / "mag.json").read_text())["alignment"]["source"] == "gyro"


def test_the_next_attitude_and_when_to_stop(simulated, folder):
    call, _ = simulated
    lines = (folder / "tumble.csv").read_text().splitlines()
    (folder / "few.csv").write_text("\n".join(lines[:-192]) + "\n")
    before = listing(folder)
    few = call("mag", "few.csv", "--next")
    assert few.status == 0
    assert "8 readings; from 12 on an error can be stated. Next: level, z up, x to magnetic" in " ".join(few.out.split())
    enough = call("mag", "tumble.csv", "--next", "--limit", "5")
    assert enough.out.startswith("Stop: heading error")
    more = call("mag", "tumble.csv", "--next", "--limit", "0.01")
    assert "Next: level" in " ".join(more.out.split())
    assert listing(folder) == before


def test_what_a_new_calibration_would_change(simulated, folder):
    call, _ = simulated
    assert call("mag", "tumble.csv", "--calibration", "device.json").status == 0
    same = call("mag", "tumble.csv", "--json", "new.json", "--against", "device.json")
    assert same.status == 0
    assert "unchanged" in {one["code"] for one in json.loads((folder / "new.json").read_text())["findings"]}
    old = jaxcal.magnetometer.MagModel(np.eye(3), np.array([10e-6, 0.0, 0.0]))
    jaxcal.Calibration(magnetometer=old).save(folder / "old.json")
    assert call("mag", "tumble.csv", "--json", "new.json", "--against", "old.json").status == 0
    assert "changed" in {one["code"] for one in json.loads((folder / "new.json").read_text())["findings"]}
    # a hard iron that is wrong by 10 uT, where the horizontal field is 25.6 uT
    known = jaxcal.Calibration.load(folder / "device.json").magnetometer.model
    moved = jaxcal.magnetometer.MagModel(known.soft_iron, np.add(known.hard_iron, [10e-6, 0.0, 0.0]))
    jaxcal.Calibration(magnetometer=moved).save(folder / "old.json")
    found = " ".join(call("mag", "tumble.csv", "--json", "new.json", "--against", "old.json", "--inclination", "57").out.split())
    degrees = float(found.split("Level headings turn by ")[1].split()[0])
    assert degrees == pytest.approx(np.rad2deg(10 / 25.6 / np.sqrt(2)), rel=0.15)
    device = {"name": "quad", "ardupilot": {"compass_id": 97539}}
    jaxcal.export.write(jaxcal.Calibration(magnetometer=moved, device=device), folder / "old.param", format="ardupilot")
    found = " ".join(call("mag", "tumble.csv", "--json", "new.json", "--against", "old.param", "--inclination", "57").out.split())
    assert float(found.split("Level headings turn by ")[1].split()[0]) == pytest.approx(degrees, rel=0.05)
    (folder / "old.txt").write_text("nothing")
    assert call("mag", "tumble.csv", "--json", "new.json", "--against", "old.txt").status == 2
    assert call("mag", "tumble.csv", "--json", "new.json", "--against", "missing.json").status == 2


def test_lists_of_readings_as_json(call, folder, counts):
    rows = counts.tolist()
    forms = {
        "rows": rows,
        "records": [{"x": x, "y": y, "z": z, "stamp": "a"} for x, y, z in rows],
        "deep": {"made": "by hand", "poses": [{"heading": 0, "samples": [{"mag": row, "roll": 0.5} for row in rows]}]},
    }
    for name, content in forms.items():
        (folder / f"{name}.json").write_text(json.dumps(content))
        found = call("mag", f"{name}.json", "--json", f"{name}-out.json")
        assert (found.status, found.err) == (0, "")
        assert np.abs(np.array(json.loads((folder / f"{name}-out.json").read_text())["model"]["hard_iron"]) - [50, -20, 10]).max() < 3
    (folder / "arrays.json").write_text(json.dumps({"mag": (1e-1 * counts).tolist(), "sensor": 3}))
    assert call("mag", "arrays.json", "--units", "mag=uT", "--json", "out.json").status == 0
    for content, reason in (("[1, 2", "read as JSON"), ("{}", "no readings"), ("[" * 5000, "")):
        (folder / "bad.json").write_text(content)
        found = call("mag", "bad.json")
        assert (found.status, reason in found.reason) == (1, True)


@pytest.fixture
def swung(folder):
    """A compass swung through twelve headings at three tilts, with the current of a motor; its mounting is rotated by 3 degrees."""
    rng = np.random.default_rng(1)
    heading, tilt = np.repeat(np.tile(np.arange(0, 360, 30), 6), 3), np.repeat([-60, -25, 0, 25, 60, 0], 36)
    bank = np.repeat([0, 15, 0, -20, 0, 170], 36)
    attitudes = np.deg2rad(np.stack([heading, tilt, bank], axis=1))
    current = np.round(rng.uniform(0, 10, len(heading)), 2)
    angle = np.deg2rad(3.0)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    m = jaxcal.magnetometer.body_field(attitudes, 48.0) @ turn.T + [5.0, -3.0, 8.0] + 0.1 * rng.normal(size=(len(heading), 3))
    powered = m + np.outer(current, [0.3, 0.0, -0.2])
    columns = "mag_x [uT],mag_y [uT],mag_z [uT],heading,roll,pitch,motor"
    save(folder / "swing.csv", np.column_stack([m, heading, bank, tilt, current]), columns)
    save(folder / "powered.csv", np.column_stack([powered, heading, bank, tilt, current]), columns)


def test_known_attitudes_give_the_rotation_and_a_table(call, folder, swung):
    found = call("mag", "swing.csv", "--headings", "heading,roll,pitch", "--check", "4", "--json", "out.json", "--inclination", "57")
    assert (found.status, found.err) == (0, "")
    assert "their headings are off by" in found.out
    document = json.loads((folder / "out.json").read_text())
    assert document["alignment"]["source"] == "headings"
    assert np.rad2deg(document["numbers"]["alignment.angle"]["value"]) == pytest.approx(3.0, abs=0.3)
    assert document["numbers"]["readings"]["value"] == 162
    assert "check.at[0].error" in document["numbers"]
    assert document["check"]["verdict"] == "good"
    assert document["check"]["count"] == 54
    assert np.rad2deg(document["check"]["heading"]) < 0.5
    for words in (("--headings", "heading,roll"), ("--headings", "heading", "--align", "accel"), ("--check", "1")):
        assert call("mag", "swing.csv", *words).status == 2
    assert call("mag", "swing.csv", "--headings", "bearing").status == 1


def test_currents_are_fitted(call, folder, swung):
    found = call("mag", "powered.csv", "--currents", "motor", "--json", "out.json")
    assert (found.status, found.err) == (0, "")
    assert re.search("motor, per unit +uT", found.out)
    document = json.loads((folder / "out.json").read_text())
    for name, truth in (("currents.motor", [3e-7, 0.0, -2e-7]), ("hard_iron", [5e-6, -3e-6, 8e-6])):
        for i, true in enumerate(truth):
            known = document["numbers"][f"{name}[{i}]"]
            assert abs(known["value"] - true) < known["high"] - known["low"]
    assert call("mag", "powered.csv", "--currents", "motor", "--model", "planar").status == 2


def test_fields_of_currents_are_taken_off_a_log(call, folder, swung):
    assert call("mag", "powered.csv", "--currents", "motor", "--calibration", "device.json", "--corrected", "at_once.csv").status == 0
    found = call("apply", "device.json", "powered.csv", "--rate", "1", "--currents", "motor", "--out", "without.csv")
    assert (found.status, found.err) == (0, "")
    assert "currents motor are taken off" in found.out
    left = call("apply", "device.json", "powered.csv", "--rate", "1", "--out", "with.csv")
    assert "is still in the readings" in " ".join(left.out.split())
    spread = [np.std(np.linalg.norm(jaxcal.read(folder / name, quiet=True).mag, axis=1)) for name in ("without.csv", "with.csv")]
    assert spread[0] < 0.15e-6
    one, two = (jaxcal.read(folder / name, quiet=True).mag for name in ("at_once.csv", "without.csv"))
    np.testing.assert_allclose(one, two, rtol=1e-6)
    assert spread[1] > 2 * spread[0]
    device = jaxcal.Calibration.load(folder / "device.json")
    np.testing.assert_allclose(device.magnetometer.currents["motor"], [3e-7, 0.0, -2e-7], atol=2e-8)
    wrong = call("apply", "device.json", "powered.csv", "--rate", "1", "--currents", "heading", "--out", "no.csv")
    assert wrong.status == 1
    assert "no field of the current 'heading'; it has motor" in wrong.reason


def test_a_warming_sensor_is_fitted_with_its_temperature(call, folder):
    """The hard iron changes with a temperature between 25 and 40 degC; a message names the option that fits this."""
    rng, time = np.random.default_rng(0), np.arange(600) / 5
    u, warmth = rng.normal(size=(600, 3)), 40 - 15 * np.exp(-time / 50)
    m = 47 * u / np.linalg.norm(u, axis=1, keepdims=True) + np.outer(warmth, [0.2, 0.0, -0.07]) + 0.2 * rng.normal(size=u.shape)
    save(folder / "warm.csv", np.column_stack([time, m, warmth]), "time [s],mag_x [uT],mag_y [uT],mag_z [uT],temperature [degC]")
    first = call("mag", "warm.csv", "--out", "alone")
    assert "--currents temperature" in " ".join(first.out.split())
    assert "fit_current" not in first.out
    found = call("mag", "warm.csv", "--currents", "temperature", "--json", "warm.json", "--out", "warm")
    assert (found.status, found.err) == (0, "")
    document = json.loads((folder / "warm.json").read_text())
    slope = [document["numbers"][f"currents.temperature[{i}]"]["value"] for i in range(3)]
    assert np.abs(np.array(slope) * 1e6 - [0.2, 0.0, -0.07]).max() < 0.01
    # the error is that at the temperatures of the log, not at 0 degC
    assert np.rad2deg(document["heading_error"][0]) < 0.15


OWN = """
import jax
import jax.numpy as jnp
from jaxcal.magnetometer import MagModel

class Warming(MagModel):
    per_kelvin: jax.Array

    def measure(self, h, temperature):
        return super().measure(h) + jnp.outer(jnp.asarray(temperature) - 25.0, self.per_kelvin)

    def correct(self, m, temperature):
        return super().correct(m - jnp.outer(jnp.asarray(temperature) - 25.0, self.per_kelvin))

class Other: ...
"""


def test_a_model_of_the_user(call, folder):
    rng, warmth = np.random.default_rng(0), np.linspace(10.0, 40.0, 400)
    u = rng.normal(size=(400, 3))
    m = 47 * u / np.linalg.norm(u, axis=1, keepdims=True) + np.outer(warmth - 25, [0.2, 0.0, -0.07]) + 0.2 * rng.normal(size=u.shape)
    save(folder / "warm.csv", np.column_stack([np.arange(400), m, warmth]), "time [s],mag_x [uT],mag_y [uT],mag_z [uT],temperature [degC]")
    (folder / "own.py").write_text(OWN)
    found = call("mag", "warm.csv", "--model", "own.py:Warming", "--corrected", "right.csv", "--out", "warm")
    assert (found.status, found.err) == (0, "")
    numbers = json.loads((folder / "warm" / "mag.json").read_text())["numbers"]
    slope = [numbers[f"per_kelvin[{i}]"]["value"] for i in range(3)]
    assert np.abs(np.array(slope) * 1e6 - [0.2, 0.0, -0.07]).max() < 0.01
    assert np.linalg.norm(jaxcal.read(folder / "right.csv", quiet=True).mag, axis=1).std() < 0.5e-6
    refused = {"none.py:A": "not_there", "own.py:A": "model_class", "own.py:Other": "model_kind", "cube": "model"}
    assert {model: call("mag", "warm.csv", "--model", model).code for model in refused} == refused
    assert call("mag", "warm.csv", "--model", "own.py:Warming", "--check", "5", "--out", "tried").status == 0
    seen = json.loads((folder / "tried" / "mag.json").read_text())["check"]
    assert (seen["verdict"], seen["count"]) == ("good", 80)
    assert 0.8 < seen["norm"] / seen["expected_norm"] < 1.2


def test_columns_x_y_z_without_a_clock_beside_a_magnet(call, folder):
    rng = np.random.default_rng(0)
    field = rng.normal(size=(400, 3))
    readings = 48 * field / np.linalg.norm(field, axis=1, keepdims=True) + [300, -250, 260] + 0.2 * rng.normal(size=(400, 3))
    np.savetxt(folder / "plain.csv", readings, "%.3f", ",", header="x,y,z", comments="")
    found = call("mag", "plain.csv", "--units", "mag=uT", "--json", "plain.json")
    assert (found.status, found.err) == (0, "")
    document = json.loads((folder / "plain.json").read_text())
    assert any("there are no times" in one["text"] for one in document["log"]["findings"])
    for i, true in enumerate([300e-6, -250e-6, 260e-6]):
        assert abs(document["numbers"][f"hard_iron[{i}]"]["value"] - true) < 0.2e-6
    assert call("mag", "plain.csv", "--units", "mag=uT", "--align", "gyro").code == "no_rate"


def test_a_fact_that_stands_beside_the_samples_is_no_sensor(call, folder):
    u = np.random.default_rng(0).standard_normal((400, 3))
    m = np.round(1600 * u / np.linalg.norm(u, axis=1, keepdims=True) + [600, 100, 0] + 5 * u)
    samples = [{"x": x, "y": y, "z": z, "timestamp": 1781283150803 + 80 * k} for k, (x, y, z) in enumerate(m.tolist())]
    (folder / "tumble.json").write_text(json.dumps({"samples": samples, "coverage": {"faces": [19, 22, 15]}}))
    assert call("mag", "tumble.json", "--json", "a.json").status == 0
    found = json.loads((folder / "a.json").read_text())
    assert found["model"]["hard_iron"] == pytest.approx([600, 100, 0], abs=5)


def test_readings_without_a_clock_have_no_rate(call, folder):
    u = np.random.default_rng(0).standard_normal((300, 3))
    np.savetxt(folder / "tumble.csv", 47 * u / np.linalg.norm(u, axis=1, keepdims=True), "%.2f", ",", header="mx,my,mz", comments="")
    head = call("mag", "tumble.csv", "--json", "a.json").out.splitlines()[0]
    assert "300 readings" in head
    assert "Hz" not in head
