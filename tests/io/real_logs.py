"""Compare the reading of real logs in JAXCAL_REFERENCE with known facts about them; `python tests/io/real_logs.py` prints the score."""

import json
import os
import pathlib
import sys

import jaxcal

ROOT = pathlib.Path(os.environ.get("JAXCAL_REFERENCE", "/nowhere"), "data", "logs")
#: words that a refusal must contain (one of each group), from the reasons in the field `why` of expected.json
SAID = {
    "straightLine_CalInertialAndMag.csv": [("packet number",), ("rate",)],
    "example_ferraris_session.csv": [("n_samples",), ("rate",)],
    "Pelvis_20210820_202113_836.csv": [("free", "gravity"), ("accel",)],
    "esense_imu_data.csv": [("39.1", "times gravity"), ("counts rows", "rate")],
    "phyphox_linear_raw_data.csv": [("gravity",)],
    "SlowPickup.txt": [("rate",), ("counts",), ("gyro",)],
    "imu_data_raw_t.csv": [("begins again", "jump"), ("333", "332")],
    "sensorlogger/Accelerometer.csv": [("gravity",)],
    "phyphox_header_wrong_unit.csv": [("deg/s",), ("rad/s",), ("steps", "turns")],
    "android_sensor_csv.csv": [("rate",)],
    "hex_counts_imu_data.mat": [("rate",), ("counts",)],
    "stationary.xlsx": [("imu_data",), ("topics",)],
    "demo.mcap": [("git lfs",)],
}
#: options that make refused logs readable, as their refusals advise
MENDED = {
    "straightLine_CalInertialAndMag.csv": {"rate": 256},
    "example_ferraris_session.csv": {"rate": 102.4},
    "phyphox_header_wrong_unit.csv": {"units": "gyro=rad/s"},
    "android_sensor_csv.csv": {"rate": 10},
    "stationary.xlsx": {"topics": "imu_data"},
}


def entries():
    """Known facts about every file; an empty list without the reference data."""
    return json.loads((ROOT / "expected.json").read_text())["files"] if (ROOT / "expected.json").exists() else []


def wrongs(log, entry):
    """Differences between a log and the known facts about it."""
    found = []
    rate, tolerance = entry["rate_hz"], entry["rate_tolerance"]
    if rate is not None and abs(log.rate / rate - 1) > tolerance:
        found.append(f"rate {log.rate:.5g} instead of {rate}")
    for sensor, known in entry["channels"].items():
        if getattr(log, sensor) is None:
            found.append(f"no {sensor}")
        elif known["unit"] is None:
            if not any(one.code == "assumed" and sensor in one.subject for one in log.findings):
                found.append(f"{sensor} in {log.provenance['units'][sensor]} without a warning that this is a guess")
        elif log.provenance["units"][sensor] != known["unit"]:
            guessed = any(one.code == "assumed" and sensor in one.subject for one in log.findings)
            found.append(f"{sensor} in {log.provenance['units'][sensor]} instead of {known['unit']}{', said to be a guess' * guessed}")
    for sensor in ("gyro", "accel", "mag"):
        if sensor not in entry["channels"] and getattr(log, sensor) is not None and entry["expect"] == "refuse":
            found.append(f"{sensor} read, which is not there")
    samples = entry["samples"]
    if samples and entry["expect"] == "read" and len(log.time) < samples - 2:
        found.append(f"{len(log.time)} samples instead of {samples}")
    return found


def judge(entry):
    """Read a file and compare it with the known facts; returns the outcome and the messages.

    Outcomes: "read", "refused", "guessed" (wrong, with a warning that it is a guess), "wrong" (without one), "unhelpful", or "asked"
    (refused because an option was missing that the file may need).
    """
    path = ROOT / entry["file"]
    try:
        log = jaxcal.read(path, quiet=True)
    except jaxcal.JaxcalError as error:
        said = error.spelt("terminal")
        if entry["expect"] == "read":
            return "asked" if entry["options_allowed"] and "--" in said else "unhelpful", said
        missing = [group for group in SAID[entry["file"]] if not any(word in said.lower() for word in group)]
        if missing:
            return "unhelpful", f"nothing on {missing}: {said}"
        options = MENDED.get(entry["file"])
        if options:
            found = wrongs(jaxcal.read(path, quiet=True, **options), entry | {"expect": "read", "rate_hz": entry["rate_hz"]})
            found = [one for one in found if "guess" not in one]
            if found:
                return "wrong", f"with {options}: {'; '.join(found)}"
        return "refused", said
    found = wrongs(log, entry)
    loud = bool(found) and all(one.endswith("said to be a guess") for one in found)
    if entry["expect"] == "refuse":
        return "wrong", f"read at {log.rate:.5g} Hz; {'; '.join(found)}"
    return ("guessed" if loud else "wrong" if found else "read"), "; ".join(found)


def main():
    """Print the outcome of every file, and the score."""
    tally, text, read = {}, 0, 0
    for entry in entries():
        outcome, said = judge(entry)
        right = outcome == {"read": "read", "refuse": "refused"}[entry["expect"]]
        tally[outcome] = tally.get(outcome, 0) + 1
        if entry["kind"] == "text" and entry["expect"] == "read":
            text, read = text + 1, read + (outcome == "read")
        print(
            f"{'' if right else '** '}{entry['file']}: {outcome}; expected {entry['expect']}. "
            f"{said if len(sys.argv) > 1 or not right else ''}"
        )
    print(tally, f"text files read without options: {read} of {text}")


if __name__ == "__main__":
    main()
