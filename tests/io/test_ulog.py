"""PX4 ULog: files packed byte by byte in a form that pyulog also reads."""

import numpy as np
import pytest

from jaxcal import read

from .flightlogs import SENSOR, ULogWriter, dtype_of, f4, sensor_rows, ulog_message, ulog_with_imu

STAMPS = 5_000_000 + np.arange(400) * 10_000
G = 1e-4  # T


def test_raw_topics_are_read_exactly(still, put):
    log = read(put(ulog_with_imu(STAMPS, still.gyro, still.accel, still.mag / G)), quiet=True)
    np.testing.assert_array_equal(log.gyro, f4(still.gyro))
    np.testing.assert_array_equal(log.accel, f4(still.accel))
    np.testing.assert_allclose(log.mag, f4(still.mag / G) * G, rtol=1e-15)
    np.testing.assert_array_equal(log.temperature, 25.0)
    assert (log.rate, log.gaps, log.warnings) == (100.0, (), ())
    assert log.provenance["epoch_ns"] == 5_000_000_000  # from timestamp_sample, not from the time of logging
    assert log.provenance["columns"] == {"topics": ["sensor_gyro:0", "sensor_accel:0", "sensor_mag:0"]}
    assert log.provenance["units"] == {"gyro": "rad/s", "accel": "m/s^2", "mag": "G", "temperature": "degC"}


def test_the_same_numbers_as_pyulog(still, put):
    pyulog = pytest.importorskip("pyulog")
    path = put(ulog_with_imu(STAMPS, still.gyro, still.accel, still.mag / G))
    log, other = read(path, quiet=True), pyulog.ULog(str(path))
    assert not other.file_corruption
    for sensor, topic in (("gyro", "sensor_gyro"), ("accel", "sensor_accel")):
        data = other.get_dataset(topic).data
        np.testing.assert_array_equal(getattr(log, sensor), np.stack([data[axis] for axis in "xyz"], axis=1))
        np.testing.assert_array_equal(data["timestamp_sample"], STAMPS)


def test_of_several_instances_the_first_is_read_and_the_others_are_told(still, put, refuses):
    path = put(ulog_with_imu(STAMPS, still.gyro, still.accel, instances=(0, 1)))
    first = read(path, quiet=True)
    assert first.provenance["columns"] == {"topics": ["sensor_gyro:0", "sensor_accel:0"]}
    several = [(one.facts["chosen"], one.facts["others"]) for one in first.findings if one.code == "several_sensors"]
    assert several == [("sensor_gyro:0", "sensor_gyro:1"), ("sensor_accel:0", "sensor_accel:1")]
    with refuses("several"):
        read(path, topics="sensor_gyro", quiet=True)
    log = read(path, topics="sensor_gyro:1,sensor_accel:1", quiet=True)
    np.testing.assert_array_equal(log.gyro, f4(still.gyro))
    assert read(path, topics=["sensor_gyro:0"], quiet=True).accel is None
    with refuses("topics"):
        read(path, topics="sensor_baro", quiet=True)


COMBINED = [
    "uint64_t timestamp", "float[3] gyro_rad", "uint32_t gyro_integral_dt", "int32_t accelerometer_timestamp_relative",
    "float[3] accelerometer_m_s2", "uint32_t accelerometer_integral_dt", "uint8_t accel_calibration_count", "uint8_t[7] _padding0",
]  # fmt: skip


def combined(still, relative=0, count=1, n=400):
    log = ULogWriter()
    log.format("sensor_combined", COMBINED)
    rows = np.zeros(n, dtype_of(COMBINED))
    rows["timestamp"], rows["gyro_rad"], rows["accelerometer_m_s2"] = STAMPS[:n], still.gyro[:n], still.accel[:n]
    rows["accelerometer_timestamp_relative"], rows["accel_calibration_count"] = relative, count
    return log, rows


def finish(log, rows, cut=7):
    log.subscribe("sensor_combined")
    log.data("sensor_combined", 0, rows, cut)
    return log


def test_calibrated_topics_are_a_last_resort_and_are_named(still, put):
    log = read(put(finish(*combined(still))), quiet=True)
    np.testing.assert_array_equal(log.gyro, f4(still.gyro))
    assert [one.subject for one in log.findings if one.code == "applied"] == [("gyro",), ("accel",)]
    assert "filtered" in log.codes


def test_raw_topics_go_before_calibrated_ones(still, put, finding):
    log, rows = combined(still)
    log.format("sensor_gyro", SENSOR)
    finish(log, rows)
    log.subscribe("sensor_gyro")
    log.data("sensor_gyro", 0, sensor_rows(STAMPS, 2 * still.gyro), 4)
    found = read(put(log), quiet=True)
    np.testing.assert_array_equal(found.gyro, f4(2 * still.gyro))
    assert found.accel is None  # raw readings are not mixed with averages
    assert finding(found, "topics").facts == {"chosen": "sensor_gyro:0", "others": "sensor_combined"}
    assert read(put(log), topics="sensor_combined", quiet=True).accel is not None


@pytest.mark.parametrize("late", [0, 3_000])
def test_relative_stamps_and_the_mark_of_an_invalid_sample(late, still, put, finding):
    log, rows = combined(still, relative=late)
    rows["accelerometer_timestamp_relative"][[3, 50]] = 2147483647
    found = read(put(finish(log, rows)), quiet=True)
    missing = np.flatnonzero(np.isnan(found.accel).any(axis=1))
    assert missing.tolist() == [3, 50]
    assert "2 rows" in finding(found, "not_read").facts["what"]
    np.testing.assert_array_equal(found.accel[51:350], f4(still.accel)[51:350])


def test_a_change_of_calibration_splits_the_log(still, put, finding):
    log, rows = combined(still)
    rows["accel_calibration_count"][300:] = 2
    found = read(put(finish(log, rows)), quiet=True)
    assert len(found.time) == 300
    assert finding(found, "recalibrated").facts == {"count": 1, "read": 300, "total": 400}


def test_fifo_batches_are_spread_over_time(put):
    fields = ["uint64_t timestamp", "uint64_t timestamp_sample", "uint32_t device_id", "float dt", "float scale", "uint8_t samples",
              "int16_t[32] x", "int16_t[32] y", "int16_t[32] z"]  # fmt: skip
    log = ULogWriter()
    log.format("sensor_gyro_fifo", fields)
    rows = np.zeros(100, dtype_of(fields))
    counts = np.random.default_rng(0).integers(-500, 500, size=(800, 3))
    rows["timestamp_sample"] = 1_000_000 + 875 + np.arange(100) * 1000
    rows["dt"], rows["scale"], rows["samples"] = 125.0, 0.001, 8
    for k, axis in enumerate("xyz"):
        rows[axis][:, :8] = counts[:, k].reshape(100, 8)
    log.subscribe("sensor_gyro_fifo")
    log.data("sensor_gyro_fifo", 0, rows)
    found = read(put(log), quiet=True)
    assert found.rate == pytest.approx(8000.0)
    np.testing.assert_allclose(found.gyro, counts * np.float64(np.float32(0.001)), rtol=1e-12)
    assert found.provenance["epoch_ns"] == 1_000_000_000


def test_dropouts_are_gaps(still, put, finding):
    log = ULogWriter()
    log.format("sensor_gyro", SENSOR)
    log.subscribe("sensor_gyro")
    log.data("sensor_gyro", 0, sensor_rows(STAMPS[:200], still.gyro[:200]), 4)
    log.dropout(500)
    log.data("sensor_gyro", 0, sensor_rows(STAMPS[250:], still.gyro[250:]), 4)
    found = read(put(log), quiet=True)
    assert [(gap.samples, round(gap.start, 6)) for gap in found.gaps] == [(50, 2.0)]
    assert "0.5 s in all" in finding(found, "dropped").facts["what"]


def test_clipped_rows_are_counted(still, put, finding):
    log = ULogWriter()
    log.format("sensor_accel", SENSOR)
    log.subscribe("sensor_accel")
    rows = sensor_rows(STAMPS, still.accel)
    rows["clip_counter"][7, 2] = 3
    log.data("sensor_accel", 0, rows, 4)
    assert finding(read(put(log), quiet=True), "sensor_clipped").facts["count"] == 1


@pytest.mark.parametrize("sync", [True, False])
def test_behind_damage_reading_goes_on_at_the_next_mark(sync, still, put):
    log = ULogWriter()
    log.format("sensor_gyro", SENSOR)
    log.subscribe("sensor_gyro")
    log.data("sensor_gyro", 0, sensor_rows(STAMPS[:200], still.gyro[:200]), 4)
    log.content += b"\xff" * 100
    if sync:
        log.sync()
    log.data("sensor_gyro", 0, sensor_rows(STAMPS[200:], still.gyro[200:]), 4)
    found = read(put(log), quiet=True)
    assert len(found.time) == (400 if sync else 200)
    assert "damaged" in found.codes


def test_a_log_cut_off_is_read_to_its_last_whole_row(still, put):
    content = ulog_with_imu(STAMPS, still.gyro, still.accel).content
    found = read(put(content[:-20]), quiet=True)
    np.testing.assert_array_equal(found.gyro, f4(still.gyro))
    assert np.isnan(found.accel[-1]).all()


def test_types_made_of_others(still, put, refuses):
    log = ULogWriter()
    log.format("vec", ["float x", "float y", "float z"])
    log.format("sensor_gyro", ["uint64_t timestamp", "vec[2] pair"])
    log.subscribe("sensor_gyro")
    log.data("sensor_gyro", 0, np.zeros(5, dtype_of(["uint64_t timestamp", "float[6] pair"])))
    with refuses("fields"):
        read(put(log), quiet=True)


def test_a_type_that_holds_itself(put, refuses):
    log = ULogWriter()
    log.format("sensor_gyro", ["uint64_t timestamp", "sensor_gyro[9] again"])
    log.subscribe("sensor_gyro")
    with refuses("damaged"):
        read(put(log), quiet=True)


def test_no_sensor_topic(put, refuses):
    log = ULogWriter()
    log.format("battery_status", ["uint64_t timestamp"])
    log.subscribe("battery_status")
    with refuses("no_sensor"):
        read(put(log), quiet=True)


def test_data_appended_after_a_crash(still, put, refuses):
    log = ULogWriter()
    log.format("sensor_gyro", SENSOR)
    log.subscribe("sensor_gyro")
    log.data("sensor_gyro", 0, sensor_rows(STAMPS[:200], still.gyro[:200]), 4)
    log.content += b"\x40\x00D"  # truncated message
    place = len(log.content)
    log.data("sensor_gyro", 0, sensor_rows(STAMPS[200:], still.gyro[200:]), 4)
    flags = bytes(8) + b"\x01" + bytes(7) + place.to_bytes(8, "little") + bytes(16)
    content = log.content.replace(ulog_message("B", bytes(40)), ulog_message("B", flags))
    np.testing.assert_array_equal(read(put(content), quiet=True).gyro, f4(still.gyro))
    unknown = log.content.replace(ulog_message("B", bytes(40)), ulog_message("B", bytes(8) + b"\x02" + bytes(31)))
    with refuses("damaged"):
        read(put(unknown), quiet=True)
