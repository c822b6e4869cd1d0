"""`jaxcal psd`."""

import json

import numpy as np
import pytest

import jaxcal

from .conftest import HEADER, listing, save, table


def test_it_prints_and_writes_nothing_unless_asked(call, folder, log):
    found = call("psd", "imu.csv")
    assert (found.status, found.err) == (0, "")
    assert listing(folder) == ["imu.csv"]
    lines = found.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert len(lines) <= 30
    head = next(i for i, line in enumerate(lines) if line.startswith("gyroscope"))
    row = lines[head + 2].split()
    assert row[:4] == ["at", "10", "Hz", "deg/sqrt(h)"]
    # white noise: N
    assert float(row[4]) == pytest.approx(1e-3 * 180 / np.pi * 60, rel=0.2)
    assert float(lines[head + 3].split()[2]) == pytest.approx(1e-2 * 180 / np.pi * 3600, rel=0.1)  # N sqrt(rate)
    assert "ordinates from 49.6125 Hz, 32 of 4000, do not fill a group" in " ".join(found.out.split()).lower().replace("hz", "Hz")


@pytest.mark.parametrize(
    ("options", "keywords"),
    [
        ([], {}),
        (["--method", "welch", "--sided", "1", "--average", "log"], {"method": "welch", "sided": 1, "average": "log"}),
        (["--method", "dct", "--average", "none", "--confidence", "0.8"], {"method": "dct", "average": None, "confidence": 0.8}),
        (["--keep-tail"], {"keep_tail": True}),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_files_hold_what_the_library_gives(call, folder, log, options, keywords):
    found = call("psd", "imu.csv", *options, "--json", "a.json", "--export", "csv", "--plot", "a.svg", "--quiet")
    assert (found.status, found.out, found.err) == (0, "", "")
    assert listing(folder) == ["a.json", "a.svg", "imu-psd.csv", "imu.csv"]
    expected = jaxcal.spectrum.density(jaxcal.read(log, quiet=True).gyro[:, 1], 100.0, **keywords)
    document = json.loads((folder / "a.json").read_text())
    assert document["schema"] == "jaxcal.Spectra/1"
    channel = document["channels"]["gyro_y"]
    for name in ("method", "sided", "average", "confidence", "rate"):
        assert channel[name] == getattr(expected, name)
    assert channel["unit"] == "(rad/s)^2/Hz"
    assert document["channels"]["accel_z"]["unit"] == "(m/s^2)^2/Hz"
    names = ("frequency", "count", "density", "lower", "upper", "edf")
    for name in names:
        np.testing.assert_allclose(channel[name], getattr(expected, name))
    rows = [line.split(",") for line in (folder / "imu-psd.csv").read_text().splitlines()]
    assert rows[0] == ["channel", "unit", "frequency_hz", "count", "density", "lower", "upper", "edf"]
    mine = np.array([row[2:] for row in rows if row[0] == "gyro_y"], dtype=float)
    np.testing.assert_allclose(mine, np.stack([getattr(expected, name) for name in names], axis=1))
    assert "<svg" in (folder / "a.svg").read_text()


def test_channels_with_gaps_or_without_noise_are_left_out_and_named(call, folder):
    rows = table(2000)
    rows[500:510, 1:4] = np.nan
    rows[:, 4] = 1.0
    save(folder / "gap.csv", rows)
    found = call("psd", "gap.csv", "--json", "a.json")
    assert found.status == 0
    assert "gyro x, y, z: 10 missing samples" in " ".join(found.out.split())
    assert "--start 5.1 --stop 20" in " ".join(found.out.split())
    assert "gyroscope  " not in found.out
    told = {one["code"]: one["subject"] for one in json.loads((folder / "a.json").read_text())["findings"]}
    assert (told["gaps"], told["constant"]) == (["gyro_x", "gyro_y", "gyro_z"], ["accel_x"])
    assert list(json.loads((folder / "a.json").read_text())["channels"]) == ["accel_y", "accel_z"]
    chosen = call("psd", "gap.csv", "--start", "5.1", "--stop", "20", "--json", "a.json", "--quiet")
    assert chosen.status == 0
    assert "gyro_x" in json.loads((folder / "a.json").read_text())["channels"]


def test_nothing_but_gaps_is_status_1_and_leaves_nothing(call, folder):
    rows = table(2000)[:, :4]
    rows[500:510, 1:4] = np.nan
    save(folder / "gap.csv", rows, header=",".join(HEADER.split(",")[:4]))
    found = call("psd", "gap.csv", "--start", "1", "--json", "a.json")
    assert found.status == 1
    assert "gyro x, y, z: 10 missing samples" in found.reason
    assert "--start 5.1 --stop 20" in found.reason
    assert listing(folder) == ["gap.csv"]


def test_exact_zeros_are_printed(call, folder):
    """A square wave at half the sampling rate has no power at other frequencies."""
    rows = table(64)[:, :4]
    rows[:, 1:] = np.where(np.arange(64) % 2, 1.0, -1.0)[:, None]
    save(folder / "square.csv", rows, header=",".join(HEADER.split(",")[:4]))
    found = call("psd", "square.csv")
    assert (found.status, found.err) == (0, "")
    assert "nan" not in found.out
