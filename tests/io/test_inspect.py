"""`jaxcal.io.inspect` reports the choices of `read` with reasons, and the analyses for which a log is suitable."""

import json

import numpy as np
import pytest

import jaxcal

G = 9.80665


def text(names, values):
    return ",".join(names) + "\n" + "".join(",".join(f"{v:.9g}" for v in row) + "\n" for row in values)


def test_every_choice_has_a_reason_and_the_option_that_changes_it(still, tmp_path):
    path = tmp_path / "log.csv"
    names = ["t", "gx", "gy", "gz", "ax [g]", "ay [g]", "az [g]", "quat_w", "note"]
    rows = np.column_stack([still.time, still.gyro, still.accel / G, np.full(400, 0.5), np.arange(400)])
    path.write_text(text(names, rows))
    found = jaxcal.io.inspect(path)
    choices = {one.quantity: one for one in found.choices}
    assert (found.format, found.samples, found.rate, found.refusal) == ("csv", 400, 100.0, None)
    assert choices["accel"].columns == ("ax [g]", "ay [g]", "az [g]")
    assert (choices["accel"].unit, choices["accel"].certain) == ("g", True)
    assert not choices["gyro"].certain
    assert choices["gyro"].option.spelt("terminal") == "--columns gyro=1:3 --units gyro=deg/s"
    assert [column.name for column in found.columns] == names
    assert "columns={'gyro': '1:3'} units={'gyro': 'deg/s'}" in found.summary()
    json.dumps(found.to_dict(), allow_nan=False)
    # the suggested option has the described effect
    changed = jaxcal.io.inspect(path, columns="gyro=1:3", units="gyro=deg/s")
    assert {one.quantity: one.unit for one in changed.choices}["gyro"] == "deg/s"


def test_what_is_refused_is_shown_all_the_same(still, tmp_path, refuses):
    path = tmp_path / "log.csv"
    path.write_text(text(["sample_idx", "gx", "gy", "gz"], np.column_stack([np.arange(400), still.gyro])))
    found = jaxcal.io.inspect(path)
    assert "sample_idx counts rows and is no time" in found.refusal
    assert found.rate is None
    assert [column.holds for column in found.columns] == ["a counter", "gyro x", "gyro y", "gyro z"]
    (tmp_path / "odd.csv").write_text("nothing here\n")
    assert jaxcal.io.inspect(tmp_path / "odd.csv").refusal.startswith("odd.csv: ")
    with refuses("columns"):
        jaxcal.io.inspect(path, columns="speed=1")


def suits(found):
    """Names of the commands that suit, in their order."""
    return [one.command.removeprefix("jaxcal ") for one in found.commands if one.suits]


def test_commands_that_suit(tmp_path):
    noise = np.random.default_rng(0)
    time = np.arange(9000) / 100
    still = np.array([0.0, 0.0, G]) + 0.01 * noise.normal(size=(9000, 3))
    np.savez(tmp_path / "rest.npz", time=time, gyro=0.001 * noise.normal(size=(9000, 3)), accel=still, units="SI")
    assert suits(jaxcal.io.inspect(tmp_path / "rest.npz")) == ["noise", "allan", "psd", "budget"]
    # ten attitudes over the whole sphere, three seconds each
    k = np.arange(10) + 0.5
    down = np.stack([np.sqrt(1 - (1 - k / 5) ** 2) * np.cos(2.4 * k), np.sqrt(1 - (1 - k / 5) ** 2) * np.sin(2.4 * k), 1 - k / 5], axis=1)
    poses = np.repeat(G * down, 300, axis=0) + 0.01 * noise.normal(size=(3000, 3))
    mag = np.repeat(48e-6 * np.roll(down, 1, axis=1), 300, axis=0)
    np.savez(tmp_path / "poses.npz", time=time[:3000], accel=poses, mag=mag, units="SI")
    assert suits(jaxcal.io.inspect(tmp_path / "poses.npz")) == ["imu", "mag"]


def test_motion_by_hand_and_turntables_have_their_commands(tmp_path):
    made = jaxcal.device.simulate(40.0, 50.0, seed=1)
    made = made[0] if isinstance(made, tuple) else made
    np.savez(tmp_path / "hand.npz", time=made.time, gyro=made.gyro, accel=made.accel, mag=made.mag, units="SI")
    found = jaxcal.io.inspect(tmp_path / "hand.npz")
    assert suits(found)[:2] == ["device", "mag"]
    assert found.commands[0].line == f"jaxcal device {tmp_path / 'hand.npz'}"
    assert suits(found)[-1] == "budget calibration.json --motion"
    assert len({one.command for one in found.commands}) == 10
    # rests of a minute on a level table, and turns of 3 s at 30 deg/s between them
    noise, rate = np.random.default_rng(0), np.tile(np.repeat([0.0, np.deg2rad(30.0)], [6000, 300]), 4)
    time, level = np.arange(len(rate)) / 100, np.array([0.0, 0.0, G])
    gyro = np.outer(rate, [0, 0, 1]) + 1e-3 * noise.normal(size=(len(rate), 3))
    np.savez(tmp_path / "table.npz", time=time, gyro=gyro, accel=level + 0.01 * noise.normal(size=gyro.shape), units="SI")
    assert suits(jaxcal.io.inspect(tmp_path / "table.npz"))[0] == "north"


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
