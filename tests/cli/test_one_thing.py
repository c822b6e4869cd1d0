"""One thing is said in one way: the inconsistencies that were once measured, each as a row of a table."""

import pathlib
import re

import pytest

import jaxcal
from jaxcal.cli import _app
from jaxcal.cli._advice import KINDS

from .conftest import save, table

TESTS = pathlib.Path(__file__).parents[1]


@pytest.fixture
def device(folder):
    """A calibration with noise in which no K was found, models of all sensors, and a log of the sensors at rest."""
    golden = jaxcal.Calibration.load(TESTS / "export" / "golden.json")
    golden.save(folder / "device.json")
    save(folder / "rest.csv", table(3000))
    return golden


def noise_exports_alike(call, folder, device):
    """`jaxcal noise` and `jaxcal export` of its calibration write the same numbers, also where a term was not found."""
    assert call("noise", "rest.csv", "--terms", "NK").status == 0
    for format in ("kalibr", "openvins", "vins", "orbslam3", "gtsam", "ros", "csv"):
        found = call("export", "rest-noise/calibration.json", "--to", format, "--out", f"{format}.out")
        assert (found.status, found.err) == (0, ""), format
    lines = [
        [line for line in (folder / name).read_text().splitlines() if line[0] != "#"] for name in ("rest-noise/imu.yaml", "kalibr.out")
    ]
    assert lines[0] == lines[1]


def exports_replace_nothing(call, folder, device):
    """A file that jaxcal did not write stays, in the terminal and in Python, unless that is forced."""
    (folder / "imu.yaml").write_text("mine: 1\n")
    assert call("export", "device.json", "--to", "kalibr").code == "not_ours"
    with pytest.raises(jaxcal.ExportError) as error:
        jaxcal.export.write(device, folder / "imu.yaml")
    assert error.value.code == "not_ours"
    assert (folder / "imu.yaml").read_text() == "mine: 1\n"
    assert call("export", "device.json", "--to", "kalibr", "--force").status == 0
    assert call("export", "device.json", "--to", "kalibr").status == 0  # its own file


def info_names_every_command(call, folder, device):
    """`jaxcal info` judges every command that takes a log, and takes a table of readings on a turntable."""
    found = call("info", "rest.csv")
    assert found.status == 0
    for command in ("noise", "allan", "psd", "imu", "mag", "device", "north", "temperature"):
        assert f"jaxcal {command}" in found.out, command
    assert call("simulate", "north", "--latitude", "39.93", "--out", "table.csv").status == 0
    assert "jaxcal north table.csv" in call("info", "table.csv").out


def units_are_one(call, folder, device):
    """A quantity has one unit in every command: a change of hard iron is told in uT, one of a gyroscope's bias in deg/s."""
    told = call("diff", "device.json", "device.json").out
    assert "uT" in told
    assert " T " not in told
    assert "deg/s" in told
    assert "rad/s" not in told


def help_has_an_example(call, folder, device):
    """The help of every command ends with a call that works, and names no option twice, since one of the two could not be given."""
    for command in (*_app._names(), *(f"simulate {kind}" for kind in KINDS)):
        said = call(*command.split(), "--help").out
        assert said.rstrip().splitlines()[-1].startswith(f"Example: jaxcal {command}"), command
        assert not re.search(r"default: *(False|None|\(\)|\"\")", said), command
        names = re.findall(r"^│ (?:\*  |   )?(--[a-z-]+)", said, re.M)
        assert len(names) == len(set(names)) > 0, (command, sorted(names))
        assert ("LOG-" in said) == (command in ("noise", "temperature", "imu", "rate-table", "mag", "device", "budget")), command


TABLE = [noise_exports_alike, exports_replace_nothing, info_names_every_command, units_are_one, help_has_an_example]


@pytest.mark.parametrize("check", TABLE, ids=lambda check: check.__name__)
def test_one_thing_is_said_in_one_way(check, call, folder, device):
    check(call, folder, device)
