"""Conventions of files with clock data: phase, Modified Julian Dates, and numbers that mark a missing value."""

import os
import pathlib

import numpy as np
import pytest

import jaxcal

PHASE = pathlib.Path(os.environ.get("JAXCAL_REFERENCE", "../shared")) / "data" / "phasedat"
SERIES = {"columns": "gyro=0", "units": "gyro=rad/s", "rate": 1.0}


@pytest.mark.skipif(not PHASE.exists(), reason="needs the recordings of others: set JAXCAL_REFERENCE")
def test_the_phase_record_that_comes_with_stable32():
    log = jaxcal.read(PHASE / "PHASE.DAT", **SERIES, data="phase", quiet=True)
    table = np.loadtxt(PHASE / "phase_dat_oadev_octave.txt")
    found = jaxcal.allan.deviation(log.gyro[:, 0], log.rate, m=table[:, 0].astype(int))
    np.testing.assert_allclose(found.deviation, table[:, 5], rtol=5e-5)  # the table has five digits
    assert log.codes == ("phase",)


def test_phase_with_a_gap(tmp_path):
    """The reading is the derivative of the phase; it is NaN across a gap and next to a missing value."""
    t = np.delete(np.arange(200) / 50, slice(60, 70))
    x = np.column_stack([t**2, 3 * t, np.sin(t)])
    x[20, 1] = -999.0
    lines = [f"{a!r},{b!r},{c!r},{d!r}" for a, (b, c, d) in zip(t.tolist(), x.tolist(), strict=True)]
    (tmp_path / "a.csv").write_text("time [s],gx,gy,gz\n" + "\n".join(lines))
    log = jaxcal.read(tmp_path / "a.csv", units={"gyro": "deg/s"}, data="phase", missing=-999, quiet=True)
    assert (log.rate, len(log.time)) == (50.0, 199)
    k = np.arange(199)
    expected = np.radians(np.column_stack([(2 * k + 1) / 50, np.full(199, 3.0), 50 * (np.sin((k + 1) / 50) - np.sin(k / 50))]))
    expected[59:70] = np.nan
    expected[19:21, 1] = np.nan
    np.testing.assert_allclose(log.gyro, expected, rtol=1e-9)


def test_a_missing_value_of_a_converted_log(tmp_path):
    """The marker of missing values is in SI units, as are the values of a converted log."""
    x = np.random.default_rng(0).normal(size=(300, 3))
    x[7, 2] = 8.0
    np.savez(tmp_path / "raw.npz", gyro=x, rate=10.0)
    jaxcal.io.convert(tmp_path / "raw.npz", tmp_path / "a.npz", units="gyro=rad/s", quiet=True)
    log = jaxcal.read(tmp_path / "a.npz", missing=8, quiet=True)
    assert np.argwhere(np.isnan(log.gyro)).tolist() == [[7, 2]]


def test_modified_julian_dates(tmp_path):
    """Modified Julian Dates in the first column are times in days; the readings are one second apart from 2020-01-01 (58849) on."""
    rng = np.random.default_rng(0)
    mjd = 58849 + np.arange(2000) / 86400
    (tmp_path / "a.txt").write_text(
        "Frequency data\n" + "\n".join(f"{a:.9f} {b:.6e}" for a, b in zip(mjd, rng.normal(size=2000), strict=True))
    )
    log = jaxcal.read(tmp_path / "a.txt", columns="gyro=1", units="gyro=rad/s", quiet=True)
    assert log.rate == pytest.approx(1.0, rel=1e-6)
    assert "Modified Julian Dates" in log.findings[0].facts["why"]
    assert abs(log.provenance["epoch_ns"] - int(np.datetime64("2020-01-01", "ns").astype(np.int64))) < 10**8
    slow = 58849 + np.arange(500) / 48  # steps of half an hour could also be seconds; the option states days
    (tmp_path / "a.txt").write_text("\n".join(f"{a:.9f} {b:.6e}" for a, b in zip(slow, rng.normal(size=500), strict=True)))
    log = jaxcal.read(tmp_path / "a.txt", columns="gyro=1", units="gyro=rad/s,time=mjd", quiet=True)
    assert 1 / log.rate == pytest.approx(1800.0, rel=1e-6)
    log = jaxcal.read(tmp_path / "a.txt", columns="gyro=1", units="gyro=rad/s", rate=1 / 1800, quiet=True)
    assert 1 / log.rate == pytest.approx(1800.0, rel=1e-6)


def test_what_has_no_meaning_is_refused(tmp_path, refuses):
    np.savez(tmp_path / "a.npz", time=np.arange(50) / 10, mag=np.random.default_rng(0).normal(size=(50, 3)) * 1e-5)
    with refuses("phase"):
        jaxcal.read(tmp_path / "a.npz", units="mag=T", data="phase", quiet=True)
    with refuses("data"):
        jaxcal.read(tmp_path / "a.npz", data="angle", quiet=True)
    (tmp_path / "a.csv").write_text("time [s],gx [rad/s]\n0,1\n0,2\n1,3\n2,2\n")
    with refuses("phase"):
        jaxcal.read(tmp_path / "a.csv", data="phase", quiet=True)
    (tmp_path / "a.ulg").write_bytes(b"ULog\x01\x12\x35" + bytes(40))
    with refuses("missing"):
        jaxcal.read(tmp_path / "a.ulg", missing=0, quiet=True)
