"""`jaxcal mag` on flight logs: every compass with the attitudes of the filter, and the field at the place by GPS."""

import datetime
import importlib.util
import json
import pathlib

import numpy as np
import pytest

import jaxcal
from jaxcal.magnetometer import MagModel, earth_field

from .conftest import listing

pytest.importorskip("pygeomag")


def _loaded(place):
    spec = importlib.util.spec_from_file_location(place.stem, place)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


_TOP = pathlib.Path(__file__).resolve().parents[2]
flights, writers = (_loaded(_TOP / place) for place in ("benchmarks/_flight.py", "tests/io/flightlogs.py"))
PLACE, DAY, START = (47.3977, 8.5456, 488.0), datetime.date(2026, 5, 31), 3_000_000
FIELD = earth_field(*PLACE[:2], DAY, altitude=PLACE[2])
SIZE, DIP = float(np.linalg.norm(FIELD)), float(np.arctan2(FIELD[2], np.hypot(*FIELD[:2])))


@pytest.fixture(scope="module")
def flight():
    """Two compasses, 20 samples per second; a log has the attitude at the even ones and the readings at the odd ones."""
    return flights.flown(3, dip=DIP, minutes=6.0, rate=20.0, compasses=2)


def dataflash(flight, attitudes="ATT", fix=3):
    log = writers.DataFlashWriter()
    names = "TimeUS,I,MagX,MagY,MagZ,OfsX,OfsY,OfsZ,MOX,MOY,MOZ,Health,S"
    log.describe(100, "MAG", "QBhhhhhhhhhBI", names)
    log.describe(102, "GPS", "QBBIHLLe", "TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt")
    week, ms = divmod((datetime.datetime.combine(DAY, datetime.time(12)) - datetime.datetime(1980, 1, 6)).total_seconds(), 604800.0)
    log.write("GPS", START, 0, 1, 0, 0, 0, 0, 0)
    log.write("GPS", START, 0, fix, int(1000 * ms), int(week), round(1e7 * PLACE[0]), round(1e7 * PLACE[1]), round(100 * PLACE[2]))
    log.describe(64, "PARM", "QNf", "TimeUS,Name,Value")
    log.write_all("PARM", [(START, "COMPASS_DEV_ID", 97539.0), (START, "COMPASS_DEV_ID2", 131874.0)])
    stamps = START + np.round(1e6 * flight.time).astype(int)
    yaw, pitch, roll = np.round(100 * np.rad2deg(flight.attitude.as_euler("ZYX"))).astype(int).T
    if attitudes == "ATT":
        log.describe(101, "ATT", "QccC", "TimeUS,Roll,Pitch,Yaw")
        log.write_all("ATT", zip(stamps[::2].tolist(), roll[::2].tolist(), pitch[::2].tolist(), (yaw[::2] % 36000).tolist(), strict=True))
    elif attitudes == "XKF1":
        log.describe(101, "XKF1", "QBccC", "TimeUS,C,Roll,Pitch,Yaw")
        for core in (0, 1):  # the second core is wrong
            log.write_all("XKF1", [(int(t), core, (1 - core) * int(r), (1 - core) * int(p), int(y) % 36000)
                                   for t, r, p, y in zip(stamps[::2], roll[::2], pitch[::2], yaw[::2], strict=True)])  # fmt: skip
    for i, readings in enumerate(flight.readings):
        counts = np.round(1e7 * SIZE * readings[1::2]).astype(int).tolist()  # milligauss
        log.write_all("MAG", [(int(t), i, *m, 0, 0, 0, 0, 0, 0, 1, 0) for t, m in zip(stamps[1::2], counts, strict=True)])
    return log


def ulog(flight):
    log = writers.ULogWriter()
    fields = {
        "vehicle_attitude": ["uint64_t timestamp", "uint64_t timestamp_sample", "float[4] q"],
        "vehicle_gps_position": [
            "uint64_t timestamp", "uint64_t time_utc_usec", "int32_t lat", "int32_t lon", "int32_t alt", "uint8_t fix_type",
        ],
        "sensor_mag": ["uint64_t timestamp", "uint64_t timestamp_sample", "uint32_t device_id", "float x", "float y", "float z"],
    }  # fmt: skip
    stamps = START + np.round(1e6 * flight.time).astype(np.uint64)

    def rows(name, times, **columns):
        found = np.zeros(len(times), writers.dtype_of(fields[name]))
        for column, values in {"timestamp": times, **columns}.items():
            found[column] = values
        return found

    for name, words in fields.items():
        log.format(name, words)
    for name, instance in (("vehicle_attitude", 0), ("vehicle_gps_position", 0), ("sensor_mag", 0), ("sensor_mag", 1)):
        log.subscribe(name, instance)
    noon = int(datetime.datetime.combine(DAY, datetime.time(12), datetime.UTC).timestamp()) * 1_000_000
    integers = {name: round(value * scale) for name, value, scale in zip(("lat", "lon", "alt"), PLACE, (1e7, 1e7, 1e3), strict=True)}
    log.data("vehicle_gps_position", 0, rows("vehicle_gps_position", stamps[:1], time_utc_usec=noon, fix_type=3, **integers))
    q = flight.attitude.as_quat(scalar_first=True)[::2]
    log.data("vehicle_attitude", 0, rows("vehicle_attitude", stamps[::2] + 500, timestamp_sample=stamps[::2], q=q))
    for i, readings in enumerate(flight.readings):
        m = dict(zip("xyz", 1e4 * SIZE * readings[1::2].T, strict=True))  # gauss
        log.data("sensor_mag", i, rows("sensor_mag", stamps[1::2] + 300, timestamp_sample=stamps[1::2], device_id=7 + i, **m))
    return log


@pytest.mark.parametrize(("name", "write", "compasses"), [("flight.bin", dataflash, "MAG"), ("flight.ulg", ulog, "sensor_mag")])
def test_every_compass_of_a_flight_is_calibrated(call, folder, flight, name, write, compasses):
    (folder / name).write_bytes(write(flight).content)
    found = call("mag", name)
    assert (found.status, found.err) == (0, "")
    assert len(found.out.splitlines()) <= 60
    assert f"{name}: magnetometer {compasses}:1, 10 Hz" in found.out
    out = folder / "flight-mag"
    assert {f"{compasses}_{i}/{file}" for i in (0, 1) for file in ("mag.json", "calibration.json", "report.html")} < set(listing(out))
    for i, (soft, hard) in enumerate(flight.irons):
        document = json.loads((out / f"{compasses}_{i}" / "mag.json").read_text())
        assert (document["verdict"], document["alignment"]["source"]) == ("good", "attitude")
        model = MagModel(*(np.array(document["model"][part]) for part in ("soft_iron", "hard_iron")))
        errors = flights.heading_errors(model, (soft, hard), DIP, SIZE)
        assert np.rad2deg(errors[0]) < 1.0
        assert document["numbers"]["inclination"]["value"] == pytest.approx(DIP, abs=1e-6)
    tool = "ardupilot" if compasses == "MAG" else "px4"
    found = call("export", *(out / f"{compasses}_{i}" / "calibration.json" for i in (0, 1)), "--to", tool)
    assert found.status == 0
    text = (folder / {"ardupilot": "ardupilot.param", "px4": "px4.params"}[tool]).read_text().replace("\t", ",")
    ids = {"ardupilot": ("COMPASS_DEV_ID,97539", "COMPASS_DEV_ID2,131874"), "px4": ("CAL_MAG0_ID,7", "CAL_MAG1_ID,8")}[tool]
    assert all(one in text for one in ids)


def test_what_a_flight_log_tells(folder, flight):
    path = folder / "flight.bin"
    path.write_bytes(dataflash(flight).content)
    found = jaxcal.io.flight(path)
    assert (found.source, found.date, list(found.compasses)) == ("ATT", DAY, ["MAG:0", "MAG:1"])
    np.testing.assert_allclose(found.place, PLACE, rtol=1e-6)
    log = jaxcal.read(path, topics="MAG:1", quiet=True)
    known, true = found.at(log), flight.attitude[1::2].as_quat(scalar_first=True)
    there = np.isfinite(known).all(axis=1)
    assert there.sum() >= len(known) - 1
    assert np.rad2deg(2 * np.arccos(np.abs(np.sum(known * true, axis=1))[there])).max() < 0.3
    path.write_bytes(dataflash(flight, "XKF1", fix=1).content)
    other = jaxcal.io.flight(path)
    assert (other.source, other.place, other.date) == ("XKF1", None, None)
    np.testing.assert_allclose(np.abs(np.sum(other.quaternion * found.quaternion, axis=1)), 1.0, atol=1e-6)


def test_a_gap_has_no_attitudes(folder, flight):
    log = dataflash(flight, "").content
    keep = (flight.time < 60.0) | (flight.time > 100.0)
    part = flight._replace(time=flight.time[keep], attitude=flight.attitude[keep], readings=[])
    (folder / "flight.bin").write_bytes(log + dataflash(part).content)
    known = jaxcal.io.flight(folder / "flight.bin")
    found = known.at(jaxcal.read(folder / "flight.bin", topics="MAG:0", quiet=True))
    when = 0.05 + np.arange(len(found)) / 10
    inside, outside = (when > 60) & (when < 100), (when < 59.8) | ((when > 100.2) & (when < 359.8))
    assert np.isnan(found[inside]).all()
    assert np.isfinite(found[outside]).all()


def test_logs_without_attitudes(call, folder, flight, refuses):
    (folder / "flight.bin").write_bytes(dataflash(flight, "").content)
    for path in ("flight.bin", __file__):
        with refuses("no_attitude"):
            jaxcal.io.flight(folder / path)
    found = call("mag", "flight.bin", "--align", "attitude")
    assert (found.status, found.code) == (1, "no_attitude")
    (folder / "flight.bin").write_bytes(dataflash(flight).content)
    assert call("mag", "flight.bin", "--json", "one.json").code == "several"
    assert call("mag", "flight.bin", "--json", "one.json", "--topics", "MAG:1", "--quiet").status == 0
