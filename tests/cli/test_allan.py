"""`jaxcal allan`."""

import json

import numpy as np
import pytest

import jaxcal

from .conftest import listing, save, table


def test_it_prints_and_writes_nothing_unless_asked(call, folder, log):
    found = call("allan", "imu.csv", "--m", "1,10,100")
    assert (found.status, found.err) == (0, "")
    assert listing(folder) == ["imu.csv"]
    lines = found.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert len(lines) <= 30
    head = next(i for i, line in enumerate(lines) if line.startswith("gyroscope"))
    assert lines[head].split() == ["gyroscope", "x", "y", "z"]
    row = lines[head + 1].split()
    assert row[:4] == ["at", "1", "s", "deg/h"]
    # white noise: N / sqrt(tau)
    assert float(row[4]) == pytest.approx(1e-3 * 180 / np.pi * 3600, rel=0.2)
    shown = call("allan", "imu.csv", "--m", "1,10,100", "--unit", "deg/s").out.splitlines()[head + 1].split()
    assert shown[3] == "deg/s"
    assert float(shown[4]) == pytest.approx(float(row[4]) / 3600, rel=0.01)


@pytest.mark.parametrize(
    ("words", "options"),
    [
        (("--m", "octave"), {"m": "octave"}), (("--kind", "tdev", "--m", "all"), {"kind": "tdev", "m": "all"}),
        (("--m", "1,10", "--alpha", "-2"), {"m": [1, 10], "alpha": -2}),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)  # fmt: skip
def test_files_hold_what_the_library_gives(call, folder, words, options):
    log = save(folder / "imu.csv", table(1000))
    found = call("allan", "imu.csv", *words, "--json", "a.json", "--export", "csv", "--plot", "a.svg", "--quiet")
    assert (found.status, found.out, found.err) == (0, "", "")
    assert listing(folder) == ["a.json", "a.svg", "imu-allan.csv", "imu.csv"]
    document = json.loads((folder / "a.json").read_text())
    assert document["schema"] == "jaxcal.Deviations/1"
    expected = jaxcal.allan.deviation(jaxcal.read(log, quiet=True).gyro, 100.0, **options)
    channel, kind = document["channels"]["gyro_y"], options.get("kind", "oadev")
    assert (channel["kind"], channel["rate"], channel["unit"]) == (kind, 100.0, "rad" if kind == "tdev" else "rad/s")
    assert channel["m"] == expected.m.tolist()
    for name in ("deviation", "lower", "upper", "edf"):
        np.testing.assert_allclose(channel[name], getattr(expected, name)[:, 1])
    rows = [line.split(",") for line in (folder / "imu-allan.csv").read_text().splitlines()]
    assert rows[0] == ["channel", "unit", "tau_s", "m", "deviation", "lower", "upper", "edf"]
    mine = [row for row in rows if row[0] == "gyro_y"]
    np.testing.assert_allclose([float(row[4]) for row in mine], expected.deviation[:, 1])
    assert "<svg" in (folder / "a.svg").read_text()


X = 1e-9 * np.cumsum(np.random.default_rng(1).standard_normal(1000)) + 1e-6 * np.arange(1000)  # s, with a frequency offset of 1e-6
Y = np.diff(X)


def lines(form, values, step=1.0, start=0.0):
    return "".join(form.format(start + step * i, repr(float(value))) + chr(10) for i, value in enumerate(values))


#: layout -> name and text of a file with X, its interval in s, and options that it needs
CLOCKS = {
    "one column": ("a.txt", lines("{1}", X), 1.0, "--data phase --rate 1"),
    "one column of phases by the name of the file": ("phase.dat", "# at the bench\n" + lines("{1}", X), 1.0, "--rate 1"),
    "time and phase": ("a.csv", "time_s,phase_ns\n" + lines("{0:.0f},{1}", 1e9 * X), 1.0, ""),
    "five minutes apart": ("a.csv", "time,phase\n" + lines("{0:.0f},{1}", X, 300.0), 300.0, ""),
    "Modified Julian Dates": ("a.txt", lines("{0:.8f} {1}", X, 300 / 86400, 58849), 300.0, "--data phase"),
    "named Modified Julian Dates": ("a.csv", "MJD,x [ns]\n" + lines("{0:.8f},{1}", 1e9 * X, 30 / 86400, 58849), 30.0, ""),
    "phase file of Stable32": ("a.txt", "File: A\nType: Phase\nTau: 1.0e+01\n# Points: 1000\n" + lines("{1}", X), 10.0, ""),
    "frequency file of Stable32": ("a.txt", "Type: Frequency\nTau: 1.0\n" + lines("{0:.9f} {1}", Y, 1 / 86400, 58849), 1.0, ""),
    "readings of an oscillator of 10 MHz": ("a.csv", "time_s,frequency\n" + lines("{0:.0f},{1}", 1e7 * (1 + Y)), 1.0, ""),
    "differences in Hz": ("a.csv", "t,df [Hz]\n" + lines("{0:.0f},{1}", 1e7 * Y), 1.0, "--nominal 10e6"),
    "parts in a billion": ("a.csv", "timestamp,freq_ppb\n" + lines("{0:.0f},{1}", 1e9 * Y, 1.0, 1.7e9), 1.0, ""),
    "columns by option": ("a.csv", "n,a,b\n" + lines("{0:.0f},{1},0", 1e9 * X), 1.0, "--rate 1 --columns phase=a --units phase=ns"),
}  # fmt: skip


def closed_form(kind, tau, m=5):
    if kind == "mtie":
        return np.ptp(np.lib.stride_tricks.sliding_window_view(X, m + 1), axis=1).max()
    if kind == "hdev":
        return np.sqrt(np.mean(np.diff(X[::m], 3) ** 2) / 6) / (m * tau)
    mean = X if kind == "oadev" else np.lib.stride_tricks.sliding_window_view(X, m).mean(axis=1)
    value = np.sqrt(np.mean((mean[2 * m :] - 2 * mean[m:-m] + mean[: -2 * m]) ** 2) / 2) / (m * tau)
    return value * m * tau / np.sqrt(3) if kind == "tdev" else value


@pytest.mark.parametrize("which", CLOCKS)
def test_files_of_clocks(which, call, folder):
    name, text, tau, options = CLOCKS[which]
    (folder / name).write_text(text)
    for kind in ("oadev", "mdev", "hdev", "tdev", "mtie"):
        words = ("allan", name, "--clock", "--kind", kind, "--m", "1,5", "--json", "clock.json", *options.split())
        ended = call(*words, *(("--report", "clock.html") if kind == "tdev" else ()))
        assert ended.status == 0, ended.reason
        channel = json.loads((folder / "clock.json").read_text())["channels"]["clock_x"]
        np.testing.assert_allclose(channel["deviation"][1], closed_form(kind, tau), rtol=1e-6)
        assert channel["unit"] == ("s" if kind in ("tdev", "mtie") else "")
        assert not any(word in ended.out for word in ("gyro", "rad/s"))
    assert not any(word in (folder / "clock.html").read_text() for word in ("gyro_x", "rad/s", "gyro="))


@pytest.mark.parametrize(
    ("text", "options", "code"),
    [
        (lines("{1}", X), "", "no_rate"), ("t,df [Hz]\n" + lines("{0:.0f},{1}", 1e7 * Y), "", "nominal"),
        ("t,a,b\n" + lines("{0:.0f},{1},{1}", Y), "", "columns_unclear"), (lines("{1}", Y), "--rate 1 --units frequency=deg", "units"),
    ],
)  # fmt: skip
def test_a_file_of_a_clock_that_says_too_little(text, options, code, call, folder):
    (folder / "a.txt").write_text(text)
    assert call("allan", "a.txt", "--clock", *options.split()).code == code


def test_what_a_clock_holds_is_a_guess_if_nothing_says_so(call, folder):
    (folder / "a.txt").write_text(lines("{1}", Y))
    assert "holds fractional frequencies" in call("allan", "a.txt", "--clock", "--rate", "1").out
