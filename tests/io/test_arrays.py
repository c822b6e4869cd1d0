"""NumPy and Parquet files."""

import numpy as np
import polars as pl
import pytest

from jaxcal import read

DEG, G = np.pi / 180.0, 9.80665


def check(log, still):
    assert log.rate == pytest.approx(100.0)
    np.testing.assert_allclose(log.gyro, still.gyro, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(log.accel, still.accel, rtol=1e-12, atol=1e-14)


def test_a_matrix_is_read_as_the_columns_of_a_table(still, tmp_path):
    np.save(tmp_path / "log.npy", np.column_stack([still.time, still.gyro, still.accel]))
    check(read(tmp_path / "log.npy", quiet=True), still)


def test_a_structured_array_has_names(still, tmp_path):
    names = ["t", "gx", "gy", "gz", "ax", "ay", "az"]
    table = np.rec.fromarrays([still.time, *still.gyro.T, *still.accel.T], names=names)
    np.save(tmp_path / "log.npy", np.asarray(table))
    check(read(tmp_path / "log.npy", quiet=True), still)


@pytest.mark.parametrize("values", [np.ones((7, 100)), np.ones((3, 3, 3)), np.array([["a", "b"]] * 3)])
def test_arrays_that_are_no_table(values, tmp_path, refuses):
    np.save(tmp_path / "log.npy", values)
    with refuses("shape"):
        read(tmp_path / "log.npy", quiet=True)


@pytest.mark.parametrize("time", ["t", "time"])
def test_arrays_by_name(time, still, tmp_path):
    np.savez(tmp_path / "log.npz", **{time: still.time}, gyro=still.gyro, accel=still.accel, mag=still.mag, temperature=still.temperature)
    log = read(tmp_path / "log.npz", quiet=True)
    check(log, still)
    np.testing.assert_allclose(log.mag, still.mag)
    np.testing.assert_allclose(log.temperature, still.temperature)


def test_single_channels_and_units_in_their_names(still, tmp_path):
    gyro = {f"gyro_{axis}": still.gyro[:, k] / DEG for k, axis in enumerate("xyz")}
    np.savez(tmp_path / "log.npz", time_us=(still.time * 1e6).round().astype(np.int64), accel_g=still.accel / G, **gyro)
    log = read(tmp_path / "log.npz", units={"gyro": "deg/s"}, quiet=True)
    check(log, still)
    assert log.provenance["units"] == {"time": "us", "gyro": "deg/s", "accel": "g"}


@pytest.mark.parametrize("key", ["fs", "rate", "sample_rate"])
def test_a_scalar_rate_replaces_stamps(key, still, tmp_path):
    np.savez(tmp_path / "log.npz", **{key: 100.0}, gyro=still.gyro, accel=still.accel)
    check(read(tmp_path / "log.npz", quiet=True), still)


def test_stamps_win_over_a_stated_rate(still, tmp_path):
    np.savez(tmp_path / "log.npz", fs=104.0, time=still.time, gyro=still.gyro, accel=still.accel)
    log = read(tmp_path / "log.npz", quiet=True)
    check(log, still)
    assert "rate_differs" in log.codes


def test_arrays_of_other_lengths_are_told(still, tmp_path):
    np.savez(tmp_path / "log.npz", time=still.time, gyro=still.gyro, accel=still.accel, scale=np.ones(6))
    log = read(tmp_path / "log.npz", quiet=True)
    assert "not_read" in log.codes


class Trap:
    """Pickled, it would call print."""

    def __reduce__(self):
        return print, ("the pickle ran",)


@pytest.mark.parametrize("suffix", ["npy", "npz"])
def test_pickled_objects_are_never_loaded(suffix, tmp_path, capsys, refuses):
    objects = np.array([Trap(), Trap()], dtype=object)
    path = tmp_path / f"log.{suffix}"
    np.save(path, objects) if suffix == "npy" else np.savez(path, gyro=objects)
    with refuses("pickle"):
        read(path, quiet=True)
    assert "the pickle ran" not in capsys.readouterr().out


def vectors(still):
    return {f"{name[0]}{axis}": getattr(still, name)[:, k] for name in ("gyro", "accel") for k, axis in enumerate("xyz")}


def test_parquet(still, tmp_path):
    ns = 1_700_000_000_000_000_001 + 10_000_000 * np.arange(400)
    pl.DataFrame({"timestamp": ns, **vectors(still)}).write_parquet(tmp_path / "log.parquet")
    log = read(tmp_path / "log.parquet", quiet=True)
    check(log, still)
    assert log.provenance["epoch_ns"] == ns[0]
