"""A newly installed jaxcal turns a ROS 2 recording into a report with one command and without ROS."""

import importlib.util
import sys

import numpy as np
import pytest


def test_one_command_makes_the_report(make, write_bag, tmp_path, capsys, monkeypatch):
    from jaxcal.cli import main

    assert all(importlib.util.find_spec(name) is None for name in ("rclpy", "rospy", "rosbag2_py"))
    still = make(n=8000)
    stamps = 1_700_000_000_000_000_000 + np.arange(8000) * 10_000_000
    bag = write_bag("mcap", {"/imu/data_raw": ("Imu", stamps, np.column_stack([still.gyro, still.accel]))})
    monkeypatch.chdir(tmp_path)
    assert main(["noise", str(bag), "--report", "report.html"]) == 0
    out = capsys.readouterr().out
    assert "gyroscope and accelerometer, 100 Hz, 1 min 20 s" in out
    assert "wrote report.html" in out
    page = (tmp_path / "report.html").read_text()
    assert page.startswith("<!DOCTYPE html>")
    assert page.count("<svg") >= 1
    assert "src=" not in page.replace('src="data:', "")  # the page is one file and loads nothing else
    assert not {"rclpy", "rospy"} & set(sys.modules)


@pytest.mark.parametrize(("work", "seen"), [(1.4, True), (0.0, False)])
def test_a_bar_appears_where_reading_takes_more_than_a_second(work, seen, monkeypatch):
    import io
    import time

    from rich.console import Console

    from jaxcal.cli import _screen

    shown = io.StringIO()
    monkeypatch.setattr(_screen, "Console", lambda **_: Console(file=shown, force_terminal=True, width=80))
    with _screen.progress("reading log.csv"):
        time.sleep(work)
    assert ("reading log.csv" in shown.getvalue()) == seen
