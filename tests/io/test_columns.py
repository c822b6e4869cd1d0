"""Columns of workbooks and TDMS files. Those of text as loggers, apps and programs name them are in `benchmarks/columns.py`."""

import ast
import random
import re

import numpy as np
import pytest

import jaxcal

from . import layouts

N, RATE = 400, 100.0
TIME = np.arange(N) / RATE
NAMES = {"w": "gyro", "a": "accel", "m": "mag"}


def signals(seed):
    found = layouts.motion(random.Random(seed), N, RATE)
    return {name[0]: found[name] for name in ("accel", "mag")} | {"w": found["gyro"]}


def typed(said):
    """The options that a refusal or a finding names, as Python reads them; the rate is known to whoever recorded the log."""
    found = {name: ast.literal_eval(value) for name, value in re.findall(r"\b(columns|units|topics)=('[^']+'|\{[^}.]+\})", said)}
    return found | ({"rate": RATE} if "rate=" in said else {})


def check(log, truth, wanted):
    assert log.rate == pytest.approx(RATE, rel=5e-3)
    assert {name for name in NAMES.values() if getattr(log, name) is not None} == {NAMES[one] for one in wanted}
    for one in wanted:
        assert np.abs(getattr(log, NAMES[one]) - truth[one]).max() < 2e-3 * np.abs(truth[one]).max()


def test_a_workbook_is_read_by_sheet_or_as_a_sensor_in_each(tmp_path, refuses):
    pytest.importorskip("python_calamine")
    truth, path = signals(1), tmp_path / "log.xlsx"
    sheet = lambda one, unit: [["t (s)", *(f"{x} ({unit})" for x in "xyz")], *np.column_stack([TIME, truth[one]]).tolist()]  # noqa: E731
    layouts.workbook(path, {"Accelerometer": sheet("a", "m/s^2"), "Gyroscope": sheet("w", "rad/s"), "Metadata": [["version", "1.0"]]})
    check(jaxcal.read(path, quiet=True), truth, "wa")
    layouts.workbook(path, {"left": sheet("a", "m/s^2"), "right": sheet("a", "m/s^2")})
    with refuses("several") as caught:
        jaxcal.read(path, quiet=True)
    check(jaxcal.read(path, quiet=True, **typed(str(caught.value))), truth, "a")


def test_channels_of_a_tdms_file_have_their_unit_and_rate(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    truth, path = signals(1), tmp_path / "log.tdms"
    with nptdms.TdmsWriter(path) as writer:
        about = {"unit_string": "g", "wf_increment": 1 / RATE}
        writer.write_segment([nptdms.ChannelObject("imu", f"Acc{x}", truth["a"][:, k] / layouts.G, about) for k, x in enumerate("XYZ")])
    check(jaxcal.read(path, quiet=True), truth, "a")
