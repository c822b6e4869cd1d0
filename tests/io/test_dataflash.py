"""ArduPilot DataFlash: logs packed record by record in a form that pymavlink also reads."""

import numpy as np
import pytest

from jaxcal import read

from .flightlogs import DataFlashWriter, dataflash_with_imu, f4

STAMPS = 1_000_000 + np.arange(400) * 10_000


def test_imu_records_are_read_exactly_and_named(still, put):
    log = read(put(dataflash_with_imu(STAMPS, still.gyro, still.accel)), quiet=True)
    np.testing.assert_array_equal(log.gyro, f4(still.gyro))
    np.testing.assert_array_equal(log.accel, f4(still.accel))
    assert (log.rate, log.temperature[0], log.provenance["columns"]) == (100.0, 25.0, {"topics": ["IMU:0"]})
    assert {"applied", "filtered"} <= set(log.codes)


def test_instances_are_separate_sensors(still, put, finding, refuses):
    path = put(dataflash_with_imu(STAMPS, still.gyro, still.accel, instances=(0, 1, 2)))
    first = read(path, quiet=True)
    assert first.provenance["columns"] == {"topics": ["IMU:0"]}
    assert finding(first, "several_sensors").facts == {"chosen": "IMU:0", "count": 3, "others": "IMU:1, IMU:2"}
    with refuses("several"):
        read(path, topics="IMU", quiet=True)
    assert len(read(path, topics="IMU:2", quiet=True).time) == 400
    with refuses("topics"):
        read(path, topics="IMU:3", quiet=True)


def test_old_names_of_instances(still, put):
    log = DataFlashWriter()
    for number, name in ((10, "IMU"), (11, "IMU2")):
        log.describe(number, name, "Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
        log.write_all(
            name, [(int(t), *map(float, w), *map(float, f)) for t, w, f in zip(STAMPS, still.gyro * number, still.accel, strict=True)]
        )
    np.testing.assert_array_equal(read(put(log), topics="IMU:1", quiet=True).gyro, f4(still.gyro * 11))


def test_sample_stamps_are_preferred(still, put):
    log = DataFlashWriter()
    for number, name, axes in ((20, "ACC", "AccX,AccY,AccZ"), (21, "GYR", "GyrX,GyrY,GyrZ")):
        log.describe(number, name, "QBQfff", f"TimeUS,I,SampleUS,{axes}")
    jitter = np.random.default_rng(0).integers(0, 4000, 400)
    for t, late, w, f in zip(STAMPS, jitter, still.gyro, still.accel, strict=True):
        log.write("ACC", int(t + late), 0, int(t), *map(float, f))
        log.write("GYR", int(t + late), 0, int(t), *map(float, w))
    found = read(put(log), quiet=True)
    np.testing.assert_array_equal(found.gyro, f4(still.gyro))
    np.testing.assert_array_equal(found.accel, f4(still.accel))
    assert found.rate == 100.0
    assert "unstated" in found.codes


def batches(put, counts, rate=1000.0, mul=100, every=2.0, cut=0):
    """Write batches of 64 samples, alternately of gyroscope and accelerometer."""
    log = DataFlashWriter()
    log.describe(30, "ISBH", "QHBBHHQf", "TimeUS,N,type,instance,mul,smp_cnt,SampleUS,smp_rate")
    log.describe(31, "ISBD", "QHHaaa", "TimeUS,N,seqno,x,y,z")
    for n, block in enumerate(counts):
        start = 1_000_000 + round(n * every * 64 / rate * 1e6)
        log.write("ISBH", start + 99_000, n % 65536, (n + 1) % 2, 0, mul, 64, start, rate)
        for k in range(2 - (cut and n == len(counts) - 1)):
            piece = block[32 * k : 32 * k + 32]
            log.write("ISBD", start + 99_000, n % 65536, k, *(np.asarray(column, "<i2").tobytes() for column in piece.T))
    return put(log)


@pytest.fixture
def int16_arrays(monkeypatch):
    from . import flightlogs

    monkeypatch.setitem(flightlogs.DATAFLASH_CODES, "a", "64s")


def test_batches_of_raw_samples(put, int16_arrays):
    counts = np.random.default_rng(1).integers(-3000, 3000, size=(8, 64, 3))
    log = read(batches(put, counts), quiet=True)
    assert log.rate == 1000.0
    # even batches are of the gyroscope and odd ones of the accelerometer; they are 64 ms long and start every 128 ms
    gyro = np.concatenate([log.gyro[256 * k : 256 * k + 64] for k in range(4)])
    accel = np.concatenate([log.accel[128 + 256 * k : 192 + 256 * k] for k in range(4)])
    np.testing.assert_array_equal(gyro, counts[::2].reshape(-1, 3) / 100)
    np.testing.assert_array_equal(accel, counts[1::2].reshape(-1, 3) / 100)
    assert np.isfinite(log.gyro[:, 0]).sum() == np.isfinite(log.accel[:, 0]).sum() == 256
    assert [(one.subject, one.facts["count"], one.facts["rate"], one.facts["cut"]) for one in log.findings if one.code == "batches"] == [
        (("ISB-ACC:0",), 4, 1000.0, 0), (("ISB-GYR:0",), 4, 1000.0, 0)
    ]  # fmt: skip
    alone = read(batches(put, counts), topics="ISB-GYR:0", quiet=True)
    assert [gap.samples for gap in alone.gaps] == [192, 192, 192]


def test_batches_that_are_not_complete_are_counted(put, int16_arrays):
    counts = np.random.default_rng(1).integers(-3000, 3000, size=(8, 64, 3))
    log = read(batches(put, counts, cut=1), topics="ISB-ACC", quiet=True)
    assert next(one.facts["cut"] for one in log.findings if one.code == "batches") == 1
    assert np.isfinite(log.accel[:, 0]).sum() == 3 * 64 + 32


def mag_log(values, extra=lambda log: None, letters="QBhhhhhhhhhBI"):
    log = DataFlashWriter()
    log.describe(40, "MAG", letters, "TimeUS,I,MagX,MagY,MagZ,OfsX,OfsY,OfsZ,MOX,MOY,MOZ,Health,S")
    log.describe(64, "PARM", "QNf", "TimeUS,Name,Value")
    extra(log)
    for t, v in zip(STAMPS, values, strict=True):
        log.write("MAG", int(t), 0, *map(int, v), -125, 72, -300, 5, 0, -5, 1, 0)
    return log


MILLIGAUSS = np.random.default_rng(3).integers(-500, 500, size=(400, 3))


def test_a_compass_is_in_milligauss(put):
    log = read(put(mag_log(MILLIGAUSS)), quiet=True)
    np.testing.assert_allclose(log.mag, MILLIGAUSS * 1e-7, rtol=1e-14)
    assert ("MAG:0",) in [one.subject for one in log.findings if one.code == "applied"]


def test_letters_that_stand_for_hundredths(put):
    log = read(put(mag_log(MILLIGAUSS, letters="QBccchhhhhhBI")), quiet=True)
    np.testing.assert_allclose(log.mag, MILLIGAUSS * 1e-9, rtol=1e-14)


def test_drops_of_the_logger(still, put, finding):
    log = dataflash_with_imu(STAMPS, still.gyro, still.accel)
    log.describe(60, "DSF", "QI", "TimeUS,Dp")
    log.write("DSF", 1, 17)
    assert finding(read(put(log), quiet=True), "dropped").facts["what"] == "17 records (DSF)"


@pytest.mark.parametrize("block", [1 << 24, 1000, 97])
def test_the_bytes_that_begin_a_record_may_stand_in_one(block, still, put, blocks_of):
    blocks_of(block)
    gyro = still.gyro.copy()
    # a float with the bytes A3 95 B0 3D, which look like the start of a record of type 176
    gyro[::7, 1] = np.frombuffer(b"\xa3\x95\xb0\x3d", "<f4")[0]
    found = read(put(dataflash_with_imu(STAMPS, gyro, still.accel)), quiet=True)
    np.testing.assert_array_equal(found.gyro, f4(gyro))


def test_damage_costs_the_records_that_it_hits(still, put, finding):
    content = bytearray(dataflash_with_imu(STAMPS, still.gyro, still.accel).content)
    at = content.index(b"\xa3\x95\xb0", len(content) // 2)
    content[at : at + 2] = b"\0\0"
    found = read(put(bytes(content)), quiet=True)
    assert [gap.samples for gap in found.gaps] == [1]
    assert "54 bytes" in finding(found, "damaged").facts["what"]


def test_no_records_of_a_sensor(put, refuses):
    log = DataFlashWriter()
    log.describe(64, "PARM", "QNf", "TimeUS,Name,Value")
    log.write("PARM", 0, "A", 1.0)
    with refuses("no_sensor"):
        read(put(log), quiet=True)
