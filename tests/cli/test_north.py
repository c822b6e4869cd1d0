"""`jaxcal north` and `jaxcal simulate north`."""

import json

import pytest

from .conftest import listing

NOISE = ["--gyro", "N=0.01deg/sqrt(h)", "--accel", "N=0.03m/s/sqrt(h)"]
MADE = ["simulate", "north", "--latitude", "35", "--attitude", "1,2,88", "--gyro-bias", "0.5", "--accel-bias", "100", "--out"]


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
        entry = document["parameters"][name]
        # four standard deviations
        assert abs(entry["value"] - value) < 4 * entry["std"], name
    assert document["schema"] == "jaxcal.north/1"
    assert document["verdict"] == "ok"
    # 360 s on x4 + z + -z: 0.254 degrees
    assert 0.2 < document["parameters"]["psi"]["std"] * 57.29578 < 0.3
    page = (folder / "a.html").read_text()
    for word in ("<svg", "azimuth", "Every reading", "Chi-square"):
        assert word in page
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_no_azimuth_is_status_1_and_says_what_is_missing(call, folder, made):
    found = call("north", made, "--latitude", "90", *NOISE)
    assert found.status == 1
    assert "no azimuth" in found.reason
    rows = made.read_text().splitlines()
    (folder / "four.csv").write_text("\n".join(rows[:5]))
    found = call("north", "four.csv", "--latitude", "35", *NOISE, "--free", "phi,theta,psi,b_a,s_a,b_g,s_g")
    assert found.status == 1
    assert "cannot tell apart phi, theta, psi, s_a, s_g" in found.reason
    assert "not determined" in found.out
    found = call("north", "four.csv", "--latitude", "35", *NOISE, "--free", "phi,theta,psi,b_a,b_g", "--prior", "s_a=1e-4,s_g=1e-4")
    assert found.status == 0
    assert "From the prior alone: s_a" in " ".join(found.out.split())


@pytest.mark.parametrize(
    ("text", "options", "status", "match"),
    [
        ("angle [deg],accel [furlong],gyro\n0,0,0\n", [], 1, "not a unit of accel"), ("a,b\n1,2\n", [], 1, "no column with an angle"),
        ("angle [deg],dwell [s]\n0,1\n", [], 1, "neither accelerometer nor gyro"), ("", [], 1, "is empty"),
        ("angle [deg],gyro [deg/h]\n0,x\n", [], 1, "line 2: 'x' is not a number"),
        ("angle [deg],mounting,gyro [deg/h]\n0,up,3\n", [], 1, "no mounting 'up'"),
        ("angle,gyro\n0,1\n", ["--latitude", "99"], 2, "between -90 and 90"),
        ("angle,gyro\n0,1\n", ["--prior", "s_a"], 2, "NAME=STANDARD_DEVIATION"), ("angle,gyro\n0,1\n", ["--plot", "a.txt"], 2, "ends in"),
    ],
)  # fmt: skip
def test_wrong_tables_and_calls(call, folder, text, options, status, match):
    (folder / "r.csv").write_text(text)
    found = call("north", "r.csv", *(["--latitude", "35"] if "--latitude" not in options else []), *options)
    assert found.status == status
    assert match in found.reason


def test_wrong_simulations(call):
    for options, match in (
        (["--attitude", "1,2"], "roll, pitch and azimuth"), (["--positions", "0,up"], "numbers"), (["--dwell", "0"], "positive"),
    ):  # fmt: skip
        found = call("simulate", "north", "--out", "r.csv", "--latitude", "35", *options)
        assert found.status == 2
        assert match in found.reason
    assert call("north", "missing.csv", "--latitude", "35").status == 2
