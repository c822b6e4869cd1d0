"""`jaxcal temperature`, `jaxcal apply`, `jaxcal simulate temperature`, and `jaxcal noise --calibration`."""

import json

import numpy as np
import pytest

import jaxcal

FILES = ["calibration.json", "report.html", "temperature.json"]


@pytest.fixture
def ramp(call, folder):
    """Simulate two temperature ramps of one device, each of 45 minutes."""
    for seed, name in ((1, "ramp.csv"), (2, "again.csv")):
        assert call("simulate", "temperature", "--out", name, "--duration", "2700", "--seed", seed).status == 0
    return folder / "ramp.csv"


def test_a_jump_is_found_stored_and_taken_off_another_recording(call, folder, ramp):
    found = call("temperature", ramp)
    assert (found.status, found.err) == (0, "")
    assert sorted(p.name for p in (folder / "ramp-temperature").iterdir()) == FILES
    document = json.loads((folder / "ramp-temperature" / "temperature.json").read_text())
    assert document["schema"] == "jaxcal.TemperatureFits/1"
    assert document["headline"] in found.out.replace("\n  ", " ")
    assert {one["code"] for one in document["findings"]} == {"one_way", "thermometer"}
    x = document["numbers"]
    assert [x[f"gyro_{axis}.jump.centre[0]"]["value"] for axis in "xy"] == pytest.approx([24.5, 24.5], abs=0.03)
    assert np.rad2deg([x[f"gyro_{axis}.jump.height[0]"]["value"] for axis in "xy"]) == pytest.approx([0.3, -0.3], abs=0.01)
    assert x["gyro_x.rms"]["unit"] == "rad/s"
    assert x["gyro_x.worst"]["value"] < 5 * x["gyro_x.rms"]["value"]
    assert "<svg" in (folder / "ramp-temperature" / "report.html").read_text()

    applied = call("apply", "ramp-temperature/calibration.json", "again.csv", "--out", "fixed.npz")
    assert (applied.status, applied.err) == (0, "")
    assert "passes a jump of the bias at 24.5" in " ".join(applied.out.split())
    before, after = (jaxcal.read(folder / name, units={"gyro": "rad/s"}, quiet=True) for name in ("again.csv", "fixed.npz"))
    assert before.gyro[:, 0].std() > 40 * np.deg2rad(4e-3)
    assert after.gyro[:, :2].std(axis=0) == pytest.approx(np.deg2rad(4e-3) * np.ones(2), rel=0.25)
    np.testing.assert_allclose(after.temperature, before.temperature, atol=1e-6)

    noise = call("noise", "again.csv", "--calibration", "ramp-temperature/calibration.json", "--json", "n.json", "--terms", "NK")
    assert noise.status == 0
    assert "passes a jump of the bias" in " ".join(noise.out.split())
    n = json.loads((folder / "n.json").read_text())["numbers"]["gyro_z.N"]["value"]
    assert n == pytest.approx(np.deg2rad(4e-3), rel=0.1)


def test_files_for_flight_controllers(call, folder, ramp):
    options = ["--model", "polynomial", "--degree", "3", "--export", "px4", "--quiet"]
    assert call("temperature", ramp, *options, "--ids", "gyro=1310988").status == 0
    assert "TC_G0_X3_2" in (folder / "px4.params").read_text()
    refused = call("temperature", ramp, *options)
    assert refused.status == 1
    assert refused.code == "no_id"
    assert "--ids gyro=ID" in refused.reason
