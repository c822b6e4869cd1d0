"""One answer: what a result says in Python stands in the terminal, in HTML and in JSON, with the same codes and numbers."""

import dataclasses
import html
import json
import re

import numpy as np
import pytest

from jaxcal._answer import Grid, Number, cell_text, merged
from jaxcal._units import shown_in
from jaxcal.cli import _work, main

#: command -> how its log is simulated, and its options
SIMULATED = {
    "noise": (("noise", "--gyro", "N=0.25deg/sqrt(h),B=8deg/h", "--duration", "300"), ()),
    "allan": (("noise", "--gyro", "N=0.25deg/sqrt(h)", "--duration", "60"), ()),
    "psd": (("noise", "--gyro", "N=0.25deg/sqrt(h)", "--duration", "60"), ()),
    "temperature": (("temperature", "--duration", "2400"), ()),
    "mag": (("mag", "--samples", "300"), ()),
    "imu": (("imu", "--rate", "50", "--poses", "20"), ()),
    "device": (("device", "--duration", "60", "--rate", "50", "--seed", "11"), ("--gravity", "9.80665")),
}
#: real log below the folder of reference data -> command, most lines printed, and options
REAL = {
    "adis16405/imu1.csv.gz": ("noise", 40),
    "logs/mpu6050_pico_imu_data.csv": ("noise", 40),
    "logs/vqf_imu_data.npz": ("device", 40),
    "logs/broad_05_slow_rotation_B.hdf5": ("device", 40),
    "logs/madgwick_ExampleData.mat": ("mag", 30),
    "magnetometer/sunsided/hmc5883l_compass.mat": ("mag", 30),
    "magnetometer/jremington/mag3_raw.csv": ("mag", 30),
    "magnetometer/furbrain/SAP6_BB.json": ("mag", 30),
    "magnetometer/betaflight/high-inclination-outdoor-applied_tumble.json": ("mag", 30),
    "imu/mikoff/imu1.log": ("imu", 40, "--rate", "100"),
    "imu/imucal/example_ferraris_session.csv": ("imu", 40, "--rate", "204.8"),
}
_LONGEST = 200  # characters of a message without its list


class Answer:
    """All outputs of one run of a command."""

    def __init__(self, folder, capsys, monkeypatch, command, log, options=()):
        kept = []
        end = _work.Done.end
        monkeypatch.setattr(_work.Done, "end", lambda done: (kept.append(done), end(done))[1])
        monkeypatch.setenv("COLUMNS", "80")
        (folder / "out").mkdir()
        files = ("--json", folder / "out" / "a.json", "--report", folder / "out" / "report.html")
        where = files if command in ("allan", "psd", "north") else ("--out", folder / "out")
        self.status = main([command, str(log), *map(str, where), *options])
        self.short, self.errors = capsys.readouterr()
        assert self.status == 0, self.errors
        (done,) = kept
        self.result, self.log = done.found, done.log
        # with -v the command would print this, but compute everything again
        running = dataclasses.replace(done.running, verbose=True)
        _work._show(done.screen, log, self.log, self.result, running)
        end(done._replace(running=running))
        self.long = capsys.readouterr().out
        self.files = {
            path.name: path.read_text(encoding="utf-8") for path in (folder / "out").iterdir() if path.suffix in (".json", ".html")
        }

    @property
    def json(self):
        return next(one for name, text in self.files.items() if name.endswith(".json") and "findings" in (one := json.loads(text)))


def flat(text):
    """Text on one line, without breaks of lines."""
    return re.sub(r"\s+", " ", text)


def check(answer, most):
    """The rules of one answer."""
    findings = [*answer.log.findings, *answer.result.findings]
    report = answer.files["report.html"]
    page = flat(html.unescape(re.sub(r"<[^>]+>", "", report)))
    codes = set(re.findall(r'data-code="(\w+)"', report))
    stored = {one["code"] for one in answer.json["findings"]} | {one["code"] for one in answer.json["log"]["findings"]}
    # every finding stands in each output, with the same codes
    assert stored == {one.code for one in findings}
    assert codes == stored
    for one in merged(findings):
        said = one.spelt("terminal")
        assert flat(said) in flat(answer.long), said
        assert flat(said) in page, said
        assert len(one.of().spelt("terminal")) <= _LONGEST or ";" in said or "," in said, said
        assert not re.search(r"(?<![-\w=])[a-z_]+=(?=[\s.,;)]|$)", one.of().spelt("terminal")), said
    # every number stands in each output, with its unit
    numbers = answer.result.numbers
    assert answer.json["numbers"].keys() == numbers.keys()
    for name, number in numbers.items():
        kept = answer.json["numbers"][name]
        assert kept["unit"] == number.unit
        assert kept["value"] is None or flat(cell_text(number._replace(remark=""))) in page, name
        assert kept["value"] is None if not np.isfinite(number.value) else kept["value"] == float(number.value), name
    for grid in answer.result.sections():
        if isinstance(grid, Grid):
            for label, cells in grid.rows:
                unit = next((shown_in(cell.quantity)[0] for cell in cells if isinstance(cell, Number)), "")
                # a table that would be too wide leaves out the words behind a letter
                known = {flat(f"{words} {unit}").strip() for words in (label, label.strip().partition("  ")[0])}
                assert any(words in flat(answer.long) for words in known), label
                assert flat(label) in page
    # the short answer
    lines = answer.short.splitlines()
    assert len(lines) <= most, answer.short
    assert max(map(len, (line for line in lines if "wrote" not in line))) <= 80, answer.short
    assert answer.result.verdict in answer.short
    assert flat(answer.result.headline) in flat(answer.short)
    assert answer.result.headline in page
    assert len([line for line in lines if line.startswith("wrote ")]) == 1
    assert len([line for line in lines if line.startswith(" - ")]) <= 3 + len([one for one in findings if one.kind.guess])


@pytest.mark.parametrize("command", [pytest.param(one, marks=[pytest.mark.long] * (one in ("temperature", "mag"))) for one in SIMULATED])
def test_a_simulated_log_has_one_answer(tmp_path, capsys, monkeypatch, command):
    simulate, options = SIMULATED[command]
    log = tmp_path / "log.csv"
    assert main(["simulate", *simulate, "--out", str(log)]) == 0
    capsys.readouterr()
    check(Answer(tmp_path, capsys, monkeypatch, command, log, options), 30 if command == "mag" else 40)


def turntable(rng):
    """Time, table angle, accelerometer and gyroscope of a table that rests at four angles."""
    time = np.arange(0, 160, 0.05)
    angle = np.deg2rad(90.0) * np.clip(np.floor(time / 40) + (time % 40 - 36) / 4 * (time % 40 > 36), 0, 3)
    gyro, accel = 6e-5 * np.cos(angle + 0.5) + 1e-5 * rng.normal(size=time.size), -0.2 * np.sin(angle) + 1e-3 * rng.normal(size=time.size)
    return np.stack([time, np.rad2deg(angle), accel, gyro], axis=1), "time [s],angle [deg],accel_x [m/s^2],gyro_x [rad/s]"


def rates(rng):
    """Time and gyroscope of a table that turns about each axis, up and down."""
    steps = np.repeat(np.array([0, 50, 100, 50, 0, -50, -100, -50, 0]), 500)
    turning = np.concatenate([steps[:, None] * np.eye(3)[axis] for axis in range(3)]) * 1.01 + [0.5, -1.0, 0.0]
    gyro = turning + 0.1 * rng.normal(size=turning.shape)
    return np.column_stack([np.arange(len(gyro)) / 100, gyro]), "time [s],gyro_x [deg/s],gyro_y [deg/s],gyro_z [deg/s]"


@pytest.mark.parametrize(("command", "made", "options"), [
    ("north", turntable, ("--latitude", "35")), ("rate-table", rates, ("--rates", "50,100")),
])  # fmt: skip
def test_a_log_of_a_table_has_one_answer(tmp_path, capsys, monkeypatch, command, made, options):
    rows, header = made(np.random.default_rng(0))
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=header, comments="", fmt="%.9g")
    check(Answer(tmp_path, capsys, monkeypatch, command, tmp_path / "log.csv", options), 40)


@pytest.mark.long
@pytest.mark.parametrize("name", REAL)
def test_a_real_log_has_one_answer(tmp_path, capsys, monkeypatch, reference, name):
    command, most, *options = REAL[name]
    check(Answer(tmp_path, capsys, monkeypatch, command, reference / "data" / name, ("--force", *options)), most)
