"""`Calibration.correct` and the temperature section: equations (5.4) and (5.5), exact storage, warnings."""

import pathlib

import numpy as np
import pytest

import jaxcal
from jaxcal import Calibration, Log
from jaxcal.temperature import characterise, fit, reference_bias, simulate

GOLDEN = pathlib.Path(__file__).parent / "export" / "golden.json"


@pytest.fixture(scope="module")
def made():
    return simulate(seed=1)


@pytest.fixture(scope="module")
def log(made):
    gyro = np.stack([made.bias, 0.5 * made.bias, -made.bias], axis=1)
    return Log(made.time, gyro=gyro, accel=gyro + np.array([0, 0, 9.8]), temperature=made.temperature, provenance={"sha256": "a"})


@pytest.fixture(scope="module")
def device(log):
    fits = {}
    for i, (model, degree, name) in enumerate((("auto", None, "gyro_x"), ("table", None, "gyro_y"), ("polynomial", 25, "gyro_z"))):
        fits[name] = fit(log.temperature, log.gyro[:, i], time=log.time, model=model, degree=degree)
    return Calibration(temperature=fits, device="unit 7", provenance={"sha256": "a"})


@pytest.mark.parametrize(("t", "accel", "gyro"), [
    (35.0, (0.89827666, 2.06189563, 9.29625), (0.292519705, -0.178092638, 0.0952735111)),
    (50.0, (0.884314169, 2.07169181, 9.25245712), None),
])  # fmt: skip
def test_the_check_vectors_of_the_golden_calibration(t, accel, gyro):
    golden = Calibration.load(GOLDEN)
    raw = {
        "gyro": np.tile([0.3, -0.2, 0.1], (4, 1)),
        "accel": np.tile([1.0, 2.0, 9.5], (4, 1)),
        "mag": np.tile([20e-6, 10e-6, -35e-6], (4, 1)),
    }
    found = golden.correct(Log(None, **raw, temperature=np.full(4, t), rate=10.0))
    np.testing.assert_allclose(found.accel[2], accel, atol=1e-8)
    np.testing.assert_allclose(found.mag[0], [8.87e-6, 14.9325e-6, -64.5575e-6], atol=1e-11)
    if gyro is not None:
        np.testing.assert_allclose(found.gyro[1], gyro, atol=1e-9)
    assert found.findings[-1].subject == ("gyro", "accel", "mag")
    assert found.provenance["corrected_with"] == "golden"


def test_saved_and_loaded_models_are_the_same(device, log, tmp_path):
    device.save(tmp_path / "a.json")
    loaded = Calibration.load(tmp_path / "a.json")
    loaded.save(tmp_path / "b.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    np.testing.assert_array_equal(loaded.correct(log).gyro, device.correct(log).gyro)


def test_a_gyroscope_goes_to_zero_and_gravity_stays(device, log, made):
    found = device.correct(log)
    near = np.abs(made.true_temperature - 24.5) > 1.0
    assert np.abs(np.mean(found.gyro, axis=0)).max() < np.deg2rad(2e-3)
    assert found.gyro[near, 0].std() < 1.5 * np.deg2rad(4e-3)
    np.testing.assert_array_equal(found.accel, log.accel)
    both = Calibration(temperature={"accel_z": characterise(Log(None, accel=log.accel, temperature=log.temperature, rate=1.0),
                                                             model="polynomial", degree=3)["accel_z"]})  # fmt: skip
    kept = both.correct(log)
    assert kept.accel[:, 2].mean() == pytest.approx(9.8, abs=0.01)
    assert kept.accel[near, 2].std() < 0.3 * log.accel[:, 2].std()
    assert {"constant_kept", "no_thermal_model"} <= set(kept.codes)


def test_warnings_of_range_jump_and_same_recording(device, log):
    said = device.correct(log)
    assert next(one.facts["centre"] for one in said.findings if one.code == "jump") == pytest.approx(24.5, abs=0.01)
    assert "same_recording" in said.codes
    warm = Log(None, gyro=log.gyro[:100], temperature=np.linspace(44, 50, 100), rate=1.0)
    said = device.correct(warm)
    assert "gyro_y" in [name for one in said.findings if one.code == "outside" for name in one.subject]
    assert not {"jump", "same_recording"} & set(said.codes)


def test_missing_samples_stay_missing(device, log):
    gyro = log.gyro.copy()
    gyro[10:20] = np.nan
    found = device.correct(Log(None, gyro=gyro, temperature=log.temperature, rate=1.0))
    assert np.isnan(found.gyro[10:20]).all()
    assert np.isfinite(np.delete(found.gyro, slice(10, 20), axis=0)).all()


def test_what_cannot_be_corrected_is_refused(device, log, refuses):
    with refuses("no_temperature"):
        device.correct(Log(None, gyro=log.gyro, rate=1.0))
    with refuses("nothing"):
        device.correct(Log(None, mag=log.gyro, rate=1.0))
    section = device.temperature.to_document()
    broken = {**section, "channels": {"gyro_x": {k: v for k, v in section["channels"]["gyro_x"].items() if k != "coefficients"}}}
    wrong = {"wx": fit(log.temperature, log.gyro[:, 0], model="polynomial", degree=1)}
    for code, temperature in (("channel", wrong), ("missing", broken), ("value", {**section, "minimum": 99.0})):
        with refuses(code):
            Calibration(temperature=temperature)


def test_the_slow_noise_of_a_drifting_temperature_goes(device):
    """The temperature drifts by 2 degC within an hour; without the correction this appears as B, K or R at long cluster times."""
    n, rate = 9_000, 2.5
    t = 30 + 2 * np.sin(np.pi * np.arange(n) / n)
    white = 1e-4 * np.sqrt(rate) * np.random.default_rng(0).standard_normal(n)
    log = Log(None, gyro=white + reference_bias(t), temperature=t, rate=rate)
    raw, mended = (jaxcal.allan.deviation(one.gyro[:, 0], rate, m=[1, 1250]) for one in (log, device.correct(log)))
    expected = 1e-4 / np.sqrt(500)
    assert raw.deviation[1] > 10 * expected
    assert mended.lower[1] < expected < mended.upper[1]
    assert mended.deviation[0] == pytest.approx(1e-4 * np.sqrt(rate), rel=0.03)
