"""`jaxcal allan` and `jaxcal psd`."""

import json

import numpy as np
import pytest

import jaxcal

from .conftest import HEADER, listing, save, table


@pytest.mark.parametrize(
    ("words", "row", "label", "white", "unit", "factor"),
    [
        # white noise: N / sqrt(tau), and N
        (("allan", "imu.csv", "--m", "1,10,100"), 1, "at 1 s deg/h", 1e-3 * 180 / np.pi * 3600, "deg/s", 1 / 3600),
        (("psd", "imu.csv"), 2, "at 10 Hz deg/sqrt(h)", 1e-3 * 180 / np.pi * 60, "deg/sqrt(s)", 1 / 60),
    ],
    ids=["allan", "psd"],
)
def test_it_prints_and_writes_nothing_unless_asked(call, folder, log, words, row, label, white, unit, factor):
    found = call(*words)
    assert (found.status, found.err) == (0, "")
    assert listing(folder) == ["imu.csv"]
    lines = found.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert len(lines) <= 30
    head = next(i for i, line in enumerate(lines) if line.startswith("gyroscope"))
    assert lines[head].split() == ["gyroscope", "x", "y", "z"]
    cells = lines[head + row].split()
    assert " ".join(cells[:4]) == label
    assert float(cells[4]) == pytest.approx(white, rel=0.2)
    shown = call(*words, "--unit", unit).out.splitlines()[head + row].split()
    assert shown[3] == unit
    assert float(shown[4]) == pytest.approx(float(cells[4]) * factor, rel=0.01)


FIELDS = {"allan": ("m", "deviation", "lower", "upper", "edf"), "psd": ("frequency", "count", "density", "lower", "upper", "edf")}
HEADS = {"allan": "channel,unit,tau_s,m,deviation,lower,upper,edf", "psd": "channel,unit,frequency_hz,count,density,lower,upper,edf"}


@pytest.mark.parametrize(
    ("command", "words", "options"),
    [
        ("allan", "--m octave", {"m": "octave"}), ("allan", "--kind tdev --m all", {"kind": "tdev", "m": "all"}),
        ("allan", "--m 1,10 --alpha -2", {"m": [1, 10], "alpha": -2}), ("psd", "", {}),
        ("psd", "--method welch --sided 1 --average log", {"method": "welch", "sided": 1, "average": "log"}),
        ("psd", "--method dct --average none --confidence 0.8", {"method": "dct", "average": None, "confidence": 0.8}),
        ("psd", "--keep-tail", {"keep_tail": True}),
    ],
)  # fmt: skip
def test_files_hold_what_the_library_gives(call, folder, command, words, options):
    log = save(folder / "imu.csv", table(1000))
    found = call(command, "imu.csv", *words.split(), "--json", "a.json", "--export", "csv", "--plot", "a.svg", "--quiet")
    assert (found.status, found.out, found.err) == (0, "", "")
    assert listing(folder) == ["a.json", "a.svg", f"imu-{command}.csv", "imu.csv"]
    document, gyro = json.loads((folder / "a.json").read_text()), jaxcal.read(log, quiet=True).gyro[:, 1]
    assert document["schema"] == {"allan": "jaxcal.Deviations/1", "psd": "jaxcal.Spectra/1"}[command]
    expected = jaxcal.allan.deviation(gyro, 100.0, **options) if command == "allan" else jaxcal.spectrum.density(gyro, 100.0, **options)
    channel = document["channels"]["gyro_y"]
    for name in {"allan": ("kind", "rate"), "psd": ("method", "sided", "average", "confidence", "rate")}[command]:
        assert channel[name] == getattr(expected, name)
    assert channel["unit"] == ("(rad/s)^2/Hz" if command == "psd" else "rad" if "tdev" in words else "rad/s")
    for name in FIELDS[command]:
        np.testing.assert_allclose(channel[name], getattr(expected, name))
    rows = [line.split(",") for line in (folder / f"imu-{command}.csv").read_text().splitlines()]
    assert ",".join(rows[0]) == HEADS[command]
    mine = np.array([row[-len(FIELDS[command]) :] for row in rows if row[0] == "gyro_y"], dtype=float)
    np.testing.assert_allclose(mine, np.stack([getattr(expected, name) for name in FIELDS[command]], axis=1))
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
