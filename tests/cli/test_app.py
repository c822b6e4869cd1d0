"""The command line as a whole: help, exit status, configuration file, and output that is closed early."""

import json
import os
import re
import subprocess
import sys
import time

import numpy as np
import pytest

import jaxcal
from jaxcal.cli import main

from .conftest import listing

COMMANDS = tuple(map(str.split, ("demo", "noise", "allan", "psd", "mag", "north", "imu", "batch", "simulate noise", "simulate imu")))
SHARED = ("--quiet", "--config")
READING = ("--columns", "--units", "--rate", "--topics", "--format", "--start", "--stop")


def test_help_needs_no_jax():
    code = "import sys; from jaxcal.cli import main; main(['noise', '--help']); print([n for n in ('jax', 'numpy') if n in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_help_of_every_command_explains_every_option_in_80_columns(call, command):
    found = call(*command, "--help")
    assert found.status == 0
    for option in SHARED + (READING if command[0] in ("noise", "allan", "batch") else ()):
        assert option in found.out
    assert max(map(len, found.out.splitlines())) <= 80
    assert "--no-" not in found.out
    assert "\x1b" not in found.out
    # the line of an option without a description would end with its type
    assert not [line for line in found.out.splitlines() if line.rstrip("│ ").endswith((" STR", " FLOAT", " INT", " PATH", " STR..."))]


def words(sentence):
    """Choices that a message lists, with or without quotes, after "expected", "known are" or "Choose from:"."""
    offered = re.split(r"expected one of|expected|known are|Choose from:", sentence)[1]
    offered = re.split(r"\. |, or a function|, or FILE", offered)[0]
    return {word for word in re.findall(r"\w+", offered) if word not in ("or", "see")}


Y = np.random.default_rng(0).standard_normal(100)
M = np.random.default_rng(0).standard_normal((100, 3))


@pytest.mark.parametrize(
    ("argv", "library"),
    [
        (["allan", "imu.csv", "--kind"], lambda: jaxcal.allan.deviation(Y, 1.0, kind="nonsense")),
        (["psd", "imu.csv", "--method"], lambda: jaxcal.spectrum.density(Y, 1.0, method="nonsense")),
        (["psd", "imu.csv", "--average"], lambda: jaxcal.spectrum.density(Y, 1.0, average="nonsense")),
        (["mag", "imu.csv", "--model"], lambda: jaxcal.magnetometer.fit(M, model="nonsense")),
        (["batch", "imu.csv", "--task"], lambda: jaxcal.batch.run(["imu.csv"], "nonsense")),
        (["export", "device.json", "--to"], lambda: jaxcal.export.write(jaxcal.Calibration(), "a", format="nonsense")),
    ],
    ids=lambda each: " ".join(each) if isinstance(each, list) else "",
)
def test_commands_offer_what_the_library_takes(call, argv, library):
    with pytest.raises(jaxcal.JaxcalError) as refused:
        library()
    found = call(*argv, "nonsense")
    assert found.status == 2
    offered = words(found.reason)
    assert len(offered) > 2
    assert {word.lower() for word in words(str(refused.value))} == {word.lower() for word in offered}


@pytest.mark.parametrize("words", [("-q", "allan"), ("--quiet", "allan"), ("allan", "-q")])
def test_quiet_stands_anywhere(call, log, words):
    found = call(*words, "imu.csv", "--m", "1", "--json", "a.json")
    assert (found.status, found.out, found.err) == (0, "", "")


def test_version(call):
    assert call("--version").out.strip() == jaxcal.__version__


def test_configuration_file_gives_options_and_the_command_line_wins(call, folder, log):
    (folder / "run.toml").write_text('[allan]\nkind = "mdev"\nm = "1,10"\nunits = ["gyro=deg/s"]\njson = "from-file.json"\n')
    found = call("allan", "imu.csv", "--config", "run.toml", "--m", "1", "--quiet")
    assert (found.status, found.out, found.err) == (0, "", "")
    document = json.loads((folder / "from-file.json").read_text())
    assert document["channels"]["gyro_x"]["kind"] == "mdev"
    assert document["channels"]["gyro_x"]["m"] == [1]
    assert document["channels"]["gyro_x"]["deviation"] == pytest.approx([1e-3 * 10 * 3.14159 / 180], rel=0.1)  # read as deg/s


def test_an_interruption_is_130_and_leaves_nothing(call, folder, log, monkeypatch):
    def interrupt(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxcal.noise.characterise", interrupt)
    found = call("noise", "imu.csv")
    assert (found.status, found.reason) == (130, "jaxcal: interrupted")
    assert listing(folder) == ["imu.csv"]


def test_a_fault_of_ours_is_3_and_asks_for_a_report(call, folder, log, monkeypatch):
    monkeypatch.setattr("jaxcal.noise.characterise", lambda *args, **kwargs: 1 / 0)
    found = call("noise", "imu.csv")
    assert found.status == 3
    assert "ZeroDivisionError" in found.err
    assert "https://github.com/jaxcal/jaxcal/issues" in found.err
    assert listing(folder) == ["imu.csv"]


@pytest.mark.skipif(os.name != "posix", reason="pipes of this kind are POSIX")
def test_output_that_goes_away_ends_the_command_quietly(log, shell):
    command = f"({sys.executable} -m jaxcal allan {log} --m octave; echo status $? >&2) | true"
    found = subprocess.run(["bash", "-c", command], env=shell.cached, capture_output=True, text=True, check=False)
    assert found.stderr.split() == ["status", "141"]


def test_files_are_written_where_nobody_reads_on(log, shell, folder):
    command = f"({sys.executable} -m jaxcal noise {log} --json {folder}/noise.json; echo status $? >&2) | head -n 1"
    found = subprocess.run(["bash", "-c", command], env=shell.cached, capture_output=True, text=True, check=False)
    assert found.stderr.split()[-2:] == ["status", "141"]
    assert json.loads((folder / "noise.json").read_text())["channels"]


@pytest.mark.parametrize(
    ("terminal", "quiet", "wait", "shown"),
    [(True, False, 0.0, True), (False, False, 0.0, False), (True, True, 0.0, False), (True, False, 60.0, False)],
    ids=["terminal", "file", "quiet", "short work"],
)
def test_a_bar_shows_long_work_on_a_terminal_only(call, log, monkeypatch, terminal, quiet, wait, shown):
    def work(*args, progress, **options):
        time.sleep(0.1)
        progress(0, 6, "gyro_x")
        time.sleep(0.3)
        raise jaxcal.DataError("enough")

    monkeypatch.setattr("jaxcal.noise.characterise", work)
    monkeypatch.setattr("jaxcal.cli._screen._WAIT", wait)
    monkeypatch.setenv("TERM", "xterm")
    if terminal:
        monkeypatch.setenv("FORCE_COLOR", "1")  # with this setting rich treats every stream as a terminal
    found = call("noise", "imu.csv", *["--quiet"] * quiet)
    assert "fitting" not in found.out
    assert found.err.endswith("jaxcal: enough\n")
    assert ("fitting gyro_x" in found.err) == shown


def test_missing_packages_of_the_extra_are_one_sentence(monkeypatch, capsys):
    for name in [name for name in sys.modules if name.startswith(("jaxcal.cli._", "cyclopts"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "cyclopts", None)
    assert main(["--help"]) == 2
    error = capsys.readouterr().err
    assert 'pip install "jaxcal[cli]"' in error
    assert len(error.splitlines()) == 1
