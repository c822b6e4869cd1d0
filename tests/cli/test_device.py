"""`jaxcal device` on a simulated recording."""

import json

import jaxcal


def test_a_recording_by_hand_becomes_a_calibration(call, folder):
    assert call("simulate", "device", "--out", "log.csv", "--duration", "60", "--rate", "50", "--seed", "11").status == 0
    found = call("device", "log.csv")
    assert found.status == 0
    assert len(found.out.splitlines()) <= 40
    document = json.loads((folder / "log-device" / "device.json").read_text(encoding="utf-8"))
    assert document["schema"] == "jaxcal.DeviceFit/1"
    page = (folder / "log-device" / "report.html").read_text(encoding="utf-8")
    # what the terminal says stands in the report and in the JSON
    assert "--latitude" in found.out
    assert {one["code"] for one in document["findings"]} == {"gravity_assumed"}
    assert 'data-code="gravity_assumed"' in page
    assert 'data-number="gyro_delay"' in page
    calibration = jaxcal.Calibration.load(folder / "log-device" / "calibration.json")
    assert calibration.imu.gyro.model.matrix.shape == (3, 3)
    assert calibration.magnetometer.field is not None
    # a bias that wanders by more than one recording shows widens the interval of the bias
    told = {"unit": "rad/s", **dict.fromkeys("QKR"), "N": [1.2e-4] * 3, "B": [1e-3] * 3}
    jaxcal.Calibration(noise={"rate": 100.0, "gyro": told}).save(folder / "known.json")
    assert call("device", "log.csv", "--gravity", "9.80665", "--noise", "known.json", "--json", "told.json").status == 0
    known = json.loads((folder / "told.json").read_text(encoding="utf-8"))
    alone, beside = (one["numbers"]["gyro.bias[0]"] for one in (document, known))
    assert beside["high"] - beside["low"] > 3 * (alone["high"] - alone["low"])
