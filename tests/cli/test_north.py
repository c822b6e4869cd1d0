"""`jaxcal north` and `jaxcal simulate north`."""

import json

import numpy as np
import pytest

import jaxcal

from ..alignment import world
from .conftest import listing

NOISE = ["--gyro", "N=0.01deg/sqrt(h)", "--accel", "N=0.03m/s/sqrt(h)"]
MADE = ["simulate", "north", "--latitude", "35", "--attitude", "1,2,88", "--out"]


def std_of(number):
    """Standard deviation of a number in JSON, from its 95 % interval by the normal distribution."""
    return (number["high"] - number["low"]) / 3.92


@pytest.fixture
def made(call, folder):
    assert call(*MADE, "six.csv", "--positions", "0,90,180,270,z,-z").status == 0
    return folder / "six.csv"


def test_what_was_simulated_comes_back_with_intervals_report_and_picture(call, folder, made):
    found = call("north", made, "--latitude", "35", *NOISE, "--json", "a.json", "--report", "a.html", "--plot", "a.png")
    assert (found.status, found.err) == (0, "")
    assert listing(folder) == ["a.html", "a.json", "a.png", "six.csv"]
    assert max(map(len, found.out.splitlines())) <= 80
    document = json.loads((folder / "a.json").read_text())
    truth = {"phi": 0.0174533, "theta": 0.0349066, "psi": 1.5358897, "b_g": 2.42407e-6, "b_a": 9.80665e-4}
    for name, value in truth.items():
        entry = document["numbers"][name]
        assert abs(entry["value"] - value) < 4 * std_of(entry), name
    assert document["schema"] == "jaxcal.AlignmentFit/1"
    assert document["verdict"] == "good"
    # 360 s at four x positions, z and -z give 0.254 degrees
    assert 0.2 < std_of(document["numbers"]["psi"]) * 57.29578 < 0.3
    page = (folder / "a.html").read_text()
    for word in ("<svg", "azimuth", "Every reading", "chi-square"):
        assert word in page
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_no_azimuth_is_status_1_and_says_what_is_missing(call, folder, made):
    found = call("north", made, "--latitude", "90", *NOISE)
    assert (found.status, found.code) == (1, "refused")
    rows = made.read_text().splitlines()
    (folder / "four.csv").write_text("\n".join(rows[:5]))
    found = call("north", "four.csv", "--latitude", "35", *NOISE, "--free", "phi,theta,psi,b_a,s_a,b_g,s_g")
    assert (found.status, found.code) == (1, "refused")
    assert "do not determine phi, theta, psi, s_a, s_g" in " ".join(found.out.split())
    found = call("north", "four.csv", "--latitude", "35", *NOISE, "--free", "phi,theta,psi,b_a,b_g", "--prior", "s_a=1e-4,s_g=1e-4", "-v")
    assert found.status == 0
    assert "From the prior alone: s_a" in " ".join(found.out.split())


def raw_log(path, axes):
    """Write a raw table log, simulated by tests/alignment/world.py, and device.json with the noise of its sensors."""
    rng, attitude = np.random.default_rng(3), np.array([1.0, 2.0, 40.0]) * world.DEG
    time, angle, accel, gyro, _, _ = world.recording(rng, [0, 90, 180, 270], [40.0] * 4, "N+B", attitude, axes=axes, rate=20.0)
    names = [f"{sensor}_{axis} [{unit}]" for sensor, unit in (("accel", "m/s^2"), ("gyro", "deg/h")) for axis in "xyz"[:axes]]
    columns = np.column_stack([time, np.rad2deg(angle), accel, np.rad2deg(gyro) * 3600])
    np.savetxt(path, columns, delimiter=",", header=",".join(["time [s]", "angle [deg]", *names]), comments="", fmt="%.9g")
    told = {
        sensor: {
            "unit": unit,
            **dict.fromkeys("QR"),
            **{t: [x] * 3 for t, x in zip("NBK", (c * world.NOISES["N+B"]).tolist(), strict=True)},
        }
        for sensor, unit, c in (("gyro", "rad/s", world.GYRO), ("accel", "m/s^2", world.ACCEL))
    }
    jaxcal.Calibration(noise={"rate": 20.0, **told}).save(path.with_name("device.json"))


@pytest.mark.parametrize("axes", [1, 3])
def test_a_raw_log_needs_no_averaging_by_hand(call, folder, axes):
    raw_log(folder / "table.csv", axes)
    found = call("north", "table.csv", "--latitude", "35", "--noise", "device.json", "--json", "a.json", "--report", "a.html")
    assert (found.status, found.err) == (0, "")
    assert "4 rests" in found.out
    document = json.loads((folder / "a.json").read_text())
    assert "rests" in {one["code"] for one in document["findings"]}
    for name, value in zip(("phi", "theta", "psi"), (1.0, 2.0, 40.0), strict=True):
        entry = document["numbers"][name]
        assert abs(entry["value"] - np.deg2rad(value)) < 4 * std_of(entry), name
    # with flicker of 0.02 deg/h, four positions of 40 s cannot give a smaller error
    assert std_of(document["numbers"]["psi"]) > np.deg2rad(0.05 if axes == 1 else 0.03)
    assert document["p_value"] is not None


def test_angles_azimuth_and_columns_of_a_raw_log(call, folder):
    raw_log(folder / "table.csv", 1)
    given = ["--latitude", "35", "--noise", "device.json", "--columns", "time=0,accel=2,gyro=3"]
    found = call("north", "table.csv", *given, "--angles", "0,90,180,270", "--azimuth", "40", "--json", "a.json")
    assert found.status == 0
    numbers = json.loads((folder / "a.json").read_text())["numbers"]
    assert "psi" not in numbers
    assert abs(numbers["s_g"]["value"]) < 4 * std_of(numbers["s_g"])
    wide = []
    for prior in ([], ["--prior", "phi=0.0175:1e-7"]):
        assert call("north", "table.csv", "--latitude", "35", "--noise", "device.json", *prior, "--json", "b.json").status == 0
        wide.append(std_of(json.loads((folder / "b.json").read_text())["numbers"]["phi"]))
    assert wide[1] < 1.1e-7 < wide[0]
    refused = call("north", "table.csv", "--latitude", "35", "--angles", "0,90")
    assert (refused.status, "2 angles were given for 4 rests" in refused.reason) == (1, True)
    assert call("north", "table.csv", "--latitude", "35", "--angle-column", "tilt").status == 1


def test_what_a_table_leaves_open_is_named(call, folder):
    rows = "".join(f"{angle},{5e-5 * np.cos(np.deg2rad(angle)):.4g}\n" for angle in (0, 90, 180, 270))
    (folder / "r.csv").write_text("angle,gyro\n" + rows)
    assert call("north", "r.csv", "--latitude", "35", "--json", "a.json", "--force").status == 0
    document = json.loads((folder / "a.json").read_text())
    assert {"no_column", "no_unit"} <= {one["code"] for one in (*document["findings"], *document["log"]["findings"])}
