"""Clocks of loggers, the truth first: no rate is wrong without a word, and the option that is named mends it. Other habits of files."""

import collections
import itertools

import numpy as np
import pytest

import jaxcal

RATES = (0.2, 0.5, 1.0, 2.0, 4.0, 10.0, 25.0, 52.0, 100.0, 208.0, 500.0, 1000.0)
STARTS = (0.0, 0.752, 31.4, 5000.0)  # s after the sensor was switched on


def loop(unit, tick, late):
    """Stamps of a loop that waits for the period, rounded to ticks, and is late by some ticks; each wait begins where the last ended."""
    return lambda t, rng: [str(int(one)) for one in np.round(t / tick) + np.cumsum(late * (rng.random(len(t)) < 0.2))]


KINDS = {
    "millis of a loop": loop("ms", 1e-3, 1),
    "millis of a timer": loop("ms", 1e-3, 0),
    "micros of a loop": loop("us", 1e-6, 37),
    "micros of a timer": loop("us", 1e-6, 0),
    "nanoseconds": loop("ns", 1e-9, 4000),
    "seconds": lambda t, rng: [f"{one:.6f}" for one in t],
    "seconds of three digits": lambda t, rng: [f"{one:.2E}" for one in t],
    "milliseconds with decimals": lambda t, rng: [f"{1e3 * one:.3f}" for one in t],
    "milliseconds since 1970": lambda t, rng: [f"{1.7e12 + 1e3 * one:.0f}" for one in t],
}
CASES = [
    (kind, rate, start) for kind, rate, start in itertools.product(KINDS, RATES, STARTS)
    if not ("three digits" in kind and max(rate / 10, start) > 1.0) and not ("milli" in kind and rate > 300)
]  # fmt: skip


def outcome(kind, rate, start, path):
    rng = np.random.default_rng(round(1e3 * (rate + start)))
    t = start + np.arange(max(200, round(20 * rate))) / rate
    stamps = KINDS[kind](t, rng)
    path.write_text("time,ax,ay,az\n" + "".join(f"{one},{x:.3f},0.1,9.8\n" for one, x in zip(stamps, rng.normal(size=len(t)), strict=True)))
    true = (len(t) - 1) / (t[-1] - t[0]) if "loop" not in kind else None
    if true is None:
        ticks = np.array(stamps, float)
        true = (len(t) - 1) / (ticks[-1] - ticks[0]) * (1e3 if "millis" in kind else 1e6)
    try:
        log = jaxcal.read(path, quiet=True)
    except jaxcal.DataError:  # steps of one could also be numbers of rows: the refusal asks for the rate
        return "refused" if jaxcal.read(path, rate=rate, quiet=True).rate == rate else "wrong"
    if abs(log.rate / true - 1) < 0.01:
        return "right"
    guess = next((one for one in log.findings if one.code == "assumed" and one.subject == ("time",)), None)
    if guess is None:
        return "wrong"
    mended = jaxcal.read(path, units={"time": guess.facts["other"]}, quiet=True)
    return "mended" if abs(mended.rate / true - 1) < 0.01 else "wrong"


@pytest.mark.parametrize("step", [7, pytest.param(1, marks=pytest.mark.long)])
def test_no_clock_is_wrong_without_a_word(step, tmp_path):
    found = {case: outcome(*case, tmp_path / "log.csv") for case in CASES[::step]}
    tally = collections.Counter(found.values())
    assert [case for case, one in found.items() if one == "wrong"] == []
    assert len(found) > 300 / step
    assert tally["right"] >= 0.85 * len(found)


@pytest.mark.parametrize("suffix", ["json", "jsonl", "parquet", "csv"])
def test_rows_of_two_devices_are_refused_in_every_format(suffix, tmp_path, refuses):
    pl = pytest.importorskip("polars")
    rng, path = np.random.default_rng(0), tmp_path / f"log.{suffix}"
    turns = {f"a{axis}": rng.normal(size=400) * 0.02 + 9.8 * (np.arange(400) % 2 == k) for k, axis in enumerate("xyz")}
    frame = pl.DataFrame({"device": ["left", "right"] * 200, "t": np.arange(400) / 200} | turns)
    {"json": frame.write_json, "jsonl": frame.write_ndjson, "parquet": frame.write_parquet, "csv": frame.write_csv}[suffix](path)
    with refuses("mixed"):
        jaxcal.read(path, quiet=True)


#: formats that are not read: name, first bytes, and the program that converts them
CONVERTED = {
    "Betaflight": ("LOG00001.BFL", b"H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\n", "blackbox_decode"),
    "iNav": ("LOG00001.TXT", b"H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Firmware type:INAV\n", "blackbox_decode"),
    "MAVLink": ("flight.tlog", b"\x00\x05\xe1\x9d\x0a\x2b\xc0\x00\xfe\x1c\x00\x01\x01\x1e", "mavlogdump.py"),
    "Axivity": ("log.cwa", b"MD\xfc\x03\x01\x00\x00\x00", "cwa-convert"),
    "GENEActiv": ("log.bin", b"Device Identity\r\nDevice Unique Serial Code:012345\r\nDevice Type:GENEActiv\r\n", "GENEActiv"),
    "ActiGraph": ("log.gt3x", b"PK\x03\x04\x14\x00\x00\x00\x08\x00info.txt", "pygt3x"),
    "GoPro": ("GX010001.MP4", b"\x00\x00\x00\x14ftypmp41\x20\x13\x10\x18mp41", "gpmf-extract"),
    "R": ("log.rda", b"\x1f\x8b\x08\x00\x00\x00\x00\x00\x00\x03", "write.csv"),
    "R, not packed": ("log", b"RDX3\nX\n\x00\x00\x00\x03", "write.csv"),
    "NovAtel": ("log.asc", b"%RAWIMUSA,1105,425384.180;00000077,-176,", "NovAtel"),
}


@pytest.mark.parametrize("which", CONVERTED)
def test_a_format_that_is_not_read_names_the_program_that_converts_it(which, tmp_path, refuses):
    name, start, program = CONVERTED[which]
    (tmp_path / name).write_bytes(start + bytes(100))
    with refuses("not_a_log") as caught:
        jaxcal.read(tmp_path / name, quiet=True)
    assert program in str(caught.value)
    assert str(caught.value).count(". ") == 0  # one sentence


def test_names_that_steer_a_terminal_do_not_reach_it(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time,gyro_x\x1b[2J,gyro_y\u202e,gyro_z\n" + "".join(f"{i / 100},{i % 7},{i % 5},{i % 3}\n" for i in range(200)))
    log = jaxcal.read(path, units="gyro=deg/s", columns="gyro=1:3", quiet=True)
    assert all(str(one).isprintable() for one in log.findings)
