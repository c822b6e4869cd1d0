"""`jaxcal device` on a simulated recording."""

import json

import jaxcal


def test_a_recording_by_hand_becomes_a_calibration(call, folder):
    assert call("simulate", "device", "--out", "log.csv", "--duration", "60", "--rate", "50", "--seed", "11").status == 0
    found = call("device", "log.csv", "--gravity", "9.80665")
    assert found.status == 0
    for words in ("accelerometer (", "gyroscope (", "magnetometer (", "delay of the gyroscope", "log-device/report.html"):
        assert words in found.out
    document = json.loads((folder / "log-device" / "device.json").read_text(encoding="utf-8"))
    assert document["schema"].startswith("jaxcal.")
    calibration = jaxcal.Calibration.load(folder / "log-device" / "calibration.json")
    assert calibration.imu.gyro.model.matrix.shape == (3, 3)
    assert calibration.magnetometer.field is not None


def test_a_log_without_a_magnetometer_is_a_wrong_call(call):
    call("simulate", "imu", "--out", "imu.csv", "--rate", "50", "--poses", "6", "--still", "2", "--turn", "1")
    found = call("device", "imu.csv")
    assert found.status == 2
    assert "magnetometer" in found.err
