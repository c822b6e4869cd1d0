"""Parameters of PX4 and ArduPilot: check vectors with the tools' own formulas, warnings on what the formats cannot store, refusals."""

import json
import pathlib

import equinox as eqx
import numpy as np
import pytest

from jaxcal import Calibration, ExportError
from jaxcal.export import write
from jaxcal.temperature import Chebyshev, Steps, ThermalModel, fit, simulate

FOLDER = pathlib.Path(__file__).parent
DOCUMENT = json.loads((FOLDER / "golden.json").read_text())


@pytest.fixture(scope="module")
def golden():
    return Calibration.load(FOLDER / "golden.json")


@pytest.fixture(scope="module")
def fitted():
    """Thermal fits of a simulated gyroscope whose axes all have the same bias, with a jump."""
    made = simulate(seed=1)
    found = fit(made.temperature, made.bias, time=made.time, sensor="gyro")
    return dict.fromkeys(("gyro_x", "gyro_y", "gyro_z"), found)


def parameters(path, separator):
    rows = [line.split(separator) for line in path.read_text().splitlines() if not line.startswith("#")]
    return {row[-3] if len(row) == 5 else row[0]: float(row[-2] if len(row) == 5 else row[1]) for row in rows}


@pytest.mark.parametrize("format", ["px4", "ardupilot"])
def test_losses_are_told_as_numbers(golden, tmp_path, format):
    found = write(golden, tmp_path / "a", format=format)
    lost = {one.subject: one.facts["lost"] for one in found if one.code == "matrix_left_out"}
    assert lost["accel",] == pytest.approx(0.002643, abs=5e-7)
    assert lost["gyro",] == pytest.approx(0.01099, abs=5e-6)
    assert "g_sensitivity_left_out" in {one.code for one in found}


def test_a_jump_is_smeared_out_and_said(fitted, tmp_path):
    device = Calibration(temperature=fitted, device={"px4": {"gyro_id": 5}})
    found = write(device, tmp_path / "a.params", format="px4")
    assert sum("24.5" in one.facts["jumps"] for one in found if one.code == "cubic_departs") == 3
    p = parameters(tmp_path / "a.params", "\t")
    t = np.linspace(20.5, 44.5, 200)
    d = t - p["TC_G0_TREF"]
    cubic = p["CAL_GYRO0_XOFF"] + sum(p[f"TC_G0_X{i}_0"] * d**i for i in range(4))
    # at a jump of 300 mdeg/s a polynomial of degree 3 has an rms error of about 47 mdeg/s
    assert 0.03 < np.sqrt(np.mean(np.rad2deg(cubic - fitted["gyro_x"].model.curve.value(t)) ** 2)) < 0.07


def test_what_cannot_be_written_is_refused(golden, fitted, tmp_path, refuses):
    path = tmp_path / "a"
    for format in ("px4", "ardupilot"):
        with refuses("no_id", ExportError):
            write(Calibration(imu=golden.imu), path, format=format)
        with refuses("no_part", ExportError):
            write(Calibration(noise=golden.noise), path, format=format)
    narrow = {**DOCUMENT["temperature"], "minimum": 31.0, "maximum": 38.0}
    with refuses("narrow", ExportError):
        write(Calibration(temperature=narrow), path, format="ardupilot")
    assert not path.exists()
    found = write(Calibration(temperature=narrow, device={"px4": {"accel_id": 1, "gyro_id": 2}}), path, format="px4")
    assert "no_bias" in {one.code for one in found}


def test_hysteresis_has_no_place(fitted, tmp_path):
    model = ThermalModel(Steps(Chebyshev(np.zeros(4), 20.0, 45.0), np.zeros(1), np.array([24.5]), np.array([0.1])), 20.0, 45.0, lag=30.0)
    fits = {name: eqx.tree_at(lambda fit: fit.model, fit, model) for name, fit in fitted.items()}
    found = write(Calibration(temperature=fits, device={"px4": {"gyro_id": 5}}), tmp_path / "a", format="px4")
    assert [one.code for one in found].count("hysteresis_left_out") == 3
