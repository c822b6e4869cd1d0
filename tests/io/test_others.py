"""Tables of further apps, loggers and programs, which `layouts` does not make: each is read correctly or refused with the reason."""

import datetime
import random

import numpy as np
import pytest

from jaxcal import read

from . import layouts

N, RATE, DEG, G = 400, 50.0, np.pi / 180, 9.80665


class Moving(random.Random):
    def choice(self, seq):
        return "hand" if "still" in seq else super().choice(seq)


BODY = layouts.motion(Moving(4), N, RATE)
GYRO, ACCEL, MAG = BODY["gyro"], BODY["accel"], BODY["mag"]
TIME = np.arange(N) / RATE
MOMENTS = [datetime.datetime(2021, 3, 4, 12, 59, 57) + datetime.timedelta(seconds=t) for t in TIME]


def cells(values, form="%.6f"):
    return [[form % value for value in channel] for channel in np.atleast_2d(np.asarray(values).T)]


def same(word):
    return [[word] * N]


def table(head, *groups, mark=",", rows=slice(None)):
    columns = [column for group in groups for column in group]
    return "\n".join([head, *(mark.join(row) for row in list(zip(*columns, strict=True))[rows]), ""])


def epoch(scale, later=0.0):
    return [[str(round((1.6e9 + later + t) * scale)) for t in TIME]]


def moments(form):
    return [[m.strftime(form) for m in MOMENTS]]


SECONDS = [[str(int(1.6e9 + t)) for t in TIME]]
MS = [[str(round(1000 * t)) for t in TIME]]
A, W, M = cells(ACCEL), cells(GYRO), cells(MAG * 1e6)
CHINESE = {"\u52a0\u901f\u5ea6": "g", "\u89d2\u901f\u5ea6": "\u00b0/s"}
READ = {
    "months by name": ("Acceleration.csv", lambda: table("Timestamp,X,Y,Z", moments("%d-%b-%Y %H:%M:%S.%f"), A)),
    "years of two digits": ("log.csv", lambda: table("Time,Acc X,Acc Y,Acc Z", moments("%m/%d/%y %I:%M:%S.%f %p"), A)),
    "digits of a time of day": ("log.csv", lambda: table("time,ax,ay,az", [[m.strftime("%H%M%S%f")[:-3] for m in MOMENTS]], A)),
    "seconds and milliseconds": (
        "log.csv", lambda: table("sec,msec,ax,ay,az", SECONDS, [[str(round(1000 * (t % 1))) for t in TIME]], A)
    ),
    "whole seconds": ("log.csv", lambda: table("timestamp,ax,ay,az", SECONDS, A)),
    "words in every column's name": ("acc_walking_waist.csv", lambda: table("id,attr_time,attr_x,attr_y,attr_z", MS, epoch(1e3), A)),
    "groups named above": (
        "imu.csv",
        lambda: table("stamp,header,secs,nsecs,angular_velocity,x,y,z,linear_acceleration,x,y,z", epoch(1e9), same(""),
                      SECONDS, [[str(round(1e9 * (t % 1))) for t in TIME]], same(""), W, same(""), A),
    ),
    "a line of units, some unknown": (
        "log.csv",
        lambda: table("Stamp_CAL\tAccel_LN_X_CAL\tAccel_LN_Y_CAL\tAccel_LN_Z_CAL\tMag_X_CAL\tMag_Y_CAL\tMag_Z_CAL\tBattery\n"
                      "ms\tm/(s^2)\tm/(s^2)\tm/(s^2)\tlocal_flux\tlocal_flux\tlocal_flux\tmV",
                      MS, A, cells(MAG / 5e-5), same("4000"), mark="\t"),
    ),
    "another script": (
        "log.csv",
        lambda: table(
            ",".join(["\u65f6\u95f4(s)", *(f"{word}{x}({unit})" for word, unit in CHINESE.items() for x in "XYZ")]),
            cells(TIME, "%.2f"), cells(ACCEL / G, "%.5f"), cells(GYRO / DEG, "%.4f"),
        ),
    ),
    "labels in every line": (
        "serial.txt",
        lambda: "ready\n" + "".join(
            f"{m.strftime('%H:%M:%S.%f')[:-3]} -> Accel X: {a[0]:.4f} g, Y: {a[1]:.4f} g, Z: {a[2]:.4f} g | Gyro X: {w[0]:.3f} deg/s, "
            f"Y: {w[1]:.3f} deg/s, Z: {w[2]:.3f} deg/s\n" for m, a, w in zip(MOMENTS, ACCEL / G, GYRO / DEG, strict=True)
        ),
    ),
    "a label for three numbers": (
        "serial.txt",
        lambda: "".join(f"t={round(1000 * t)} Acc: {a[0]:.4f}, {a[1]:.4f}, {a[2]:.4f} Gyro: {w[0]:.3f}, {w[1]:.3f}, {w[2]:.3f}\n"
                        for t, a, w in zip(TIME, ACCEL, GYRO / DEG, strict=True)),
    ),
    "lines that end with a semicolon": (
        "raw.txt", lambda: "".join(f"33,Jogging,{round(1e9 * t) + 49105962326000},{a[0]:.6f},{a[1]:.6f},{a[2]:.6f};\n"
                                   for t, a in zip(TIME, ACCEL, strict=True)),
    ),
    "sizes in the preamble": (
        "video.gcsv",
        lambda: table("GYROFLOW IMU LOG\nversion,1.3\ntscale,0.02\ngscale,0.00122173047\nascale,0.00048828125\nt,gx,gy,gz,ax,ay,az",
                      [[str(i) for i in range(N)]], cells(np.round(GYRO / 0.00122173047), "%.0f"),
                      cells(np.round(ACCEL / G / 0.00048828125), "%.0f")),
    ),
    "two lines of names": ("log.csv", lambda: table("t,accel,,,gyro,,\n,x,y,z,x,y,z", MS, A, W)),
    "a flag that flips": (
        "log.csv", lambda: table("timestamp,ax,ay,az,mag_ready,gps", epoch(1e3), A, [[str(i % 2) for i in range(N)]],
                                 [["yes" if i % 5 else "no" for i in range(N)]]),
    ),
    "an id that begins again": ("log.csv", lambda: table("timestamp,ax,ay,az,id", epoch(1e3), A, [[str(i % 16) for i in range(N)]])),
    "clocks of two sensors that agree": (
        "log.csv", lambda: table("ts_accel,accel_x,accel_y,accel_z,ts_gyro,gyro_x,gyro_y,gyro_z", epoch(1e9), A, epoch(1e9, 0.002), W)
    ),
}  # fmt: skip


@pytest.mark.parametrize("which", READ)
def test_a_table_of_another_program_is_read(which, tmp_path):
    name, text = READ[which]
    path = tmp_path / name
    path.write_text(text(), encoding="utf-8")
    log = read(path, quiet=True)
    assert log.rate == pytest.approx(RATE, rel=2e-3)
    assert log.mag is None
    for found, true, size in ((log.accel, ACCEL, G), (log.gyro, GYRO, 1.0)):
        if found is not None:
            np.testing.assert_allclose(found[: len(true)], true[: len(found)], atol=2e-3 * size)
    assert log.accel is not None
    assert (log.gyro is None) == (log.provenance["columns"].get("gyro") is None)


def axes(form):
    return ",".join(form.format(axis) for axis in "xyz")


DEVICES = {
    "VectorNav": lambda: table(f"TimeStartup,{axes('UncompAccel.{}')},{axes('UncompGyro.{}')}", epoch(1e9), A, W),
    "Xsens MT": lambda: table(
        f"// Sample rate: 50.0Hz\nCounter\t{axes('Acc_{}')}\t{axes('Gyr_{}')}\tMat[1][1]".replace(",", "\t"),
        [[str(i) for i in range(N)]], A, W, same("1"), mark="\t",
    ),
}  # fmt: skip


@pytest.mark.parametrize("device", DEVICES)
def test_a_device_that_is_known_needs_no_guess(device, tmp_path, finding):
    path = tmp_path / "log.csv"
    path.write_text(DEVICES[device]())
    log = read(path, quiet=True)
    assert finding(log, "device").facts["name"].startswith(device)
    assert not any(one.kind.guess for one in log.findings)
    assert log.rate == pytest.approx(RATE, rel=2e-3)
    np.testing.assert_allclose(log.gyro, GYRO, atol=1e-3)
    if log.accel is not None:
        np.testing.assert_allclose(log.accel, ACCEL, atol=1e-3)


def taking_turns(head, middle):
    rows = []
    for i in range(N):
        for k, word in enumerate(middle):
            values = ACCEL[i] if k == 0 else ACCEL[(i + 150) % N]
            rows.append(f"{1.6e9 + TIME[i] + 0.0004 * k:.4f},{word}," + ",".join(f"{value:.5f}" for value in values))
    return "\n".join([head, *rows, ""])


REFUSED = {
    "two devices in turn": ("log.csv", lambda: taking_turns("timestamp,sensor_id,ax,ay,az", "01"), "mixed"),
    "two addresses in turn": ("log.csv", lambda: taking_turns("timestamp,mac,ax,ay,az", ("d4:22", "d4:23")), "mixed"),
    "gravity under the name of a rate": (
        "log.csv", lambda: table("time_s,gyro_x,gyro_y,gyro_z", cells(TIME), cells(ACCEL / G)), "accel_as_gyro"
    ),
    "millidegrees without a unit": ("log.csv", lambda: table("time_s,gx,gy,gz", cells(TIME), cells(GYRO / DEG * 1e3)), "unit_unknown"),
    "a relative magnetometer alone": (
        "log.csv", lambda: table("time_s,Mag X (a.u.),Mag Y (a.u.),Mag Z (a.u.)", cells(TIME), cells(MAG / 5e-5)), "unit_unknown"
    ),
    "JSON": ("log.txt", lambda: '[{"time": "noon", "x": "two"}]', "json"),
    "nanoseconds of no second": ("log.csv", lambda: table("sec,nsec,ax,ay,az", same(""), [[str(i) for i in range(N)]], A), "two_columns"),
    "a page of the web": ("imu.csv", lambda: "<!DOCTYPE html>\n<html></html>\n", "not_a_log"),
    "sensors of which no axis is understood": (
        "log.csv", lambda: table("time_s,temp,gyro_foo,acc_foo", cells(TIME), same("25.1"), W[:1], A[:1]), "columns_unclear"
    ),
}  # fmt: skip


@pytest.mark.parametrize("which", REFUSED)
def test_a_table_that_no_reading_can_be_right_for_is_refused(which, tmp_path, refuses):
    name, text, said = REFUSED[which]
    path = tmp_path / name
    path.write_text(text(), encoding="utf-8")
    with refuses(said):
        read(path, quiet=True)


def test_a_counter_that_skips_numbers_tells_of_lost_samples(tmp_path, finding):
    path = tmp_path / "log_50Hz.csv"
    kept = [i for i in range(N) if i not in (100, 101, 250)]
    path.write_text(table("counter,ax,ay,az", [[str(i) for i in kept]], cells(ACCEL[kept])))
    log = read(path, quiet=True)
    assert (log.rate, len(log.time), [gap.samples for gap in log.gaps]) == (RATE, N, [2, 1])
    assert finding(log, "skips").facts == {"counter": "counter", "count": 3, "places": 2}


@pytest.mark.parametrize(("value", "code"), [("-3920", "left_out"), ("2534", "left_out"), ("75.2", "assumed")])
def test_a_temperature_that_no_sensor_has_is_left_out(value, code, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(table("time_ms,ax,ay,az,temp", MS, A, same(value)))
    log = read(path, quiet=True)
    assert (log.temperature is None) == (code == "left_out")
    assert (code, ("temperature",)) in [(one.code, one.subject) for one in log.findings]


UPWARD = ACCEL / np.linalg.norm(ACCEL, axis=1, keepdims=True)


@pytest.mark.parametrize(
    ("sensor", "values", "other"),
    [("accel", UPWARD, "m/s^2"), ("accel", np.round(978 * UPWARD, 2), "cm/s^2"), ("gyro", np.array([420, -310, 55]) + 3 * GYRO, "mdeg/s")],
)
def test_a_guess_near_two_units_is_said(sensor, values, other, tmp_path, finding):
    path = tmp_path / "log.csv"
    path.write_text(table(f"time_s,{sensor}_x,{sensor}_y,{sensor}_z", cells(TIME), cells(values, "%.7g")))
    assert finding(read(path, quiet=True), "assumed").facts["other"] == other


def test_coarse_stamps_do_not_turn_radians_into_degrees(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(table("timestamp,ax,ay,az,gx,gy,gz", SECONDS, A, W))
    log = read(path, quiet=True)
    assert (log.provenance["units"]["gyro"], log.rate) == ("rad/s", pytest.approx(RATE))


def test_a_start_and_a_rate_above_the_samples(tmp_path, refuses):
    path = tmp_path / "ACC.csv"
    counts = np.round(ACCEL / G * 64)
    path.write_text(
        "1544027337.000000, 1544027337.000000, 1544027337.000000\n32.000000, 32.000000, 32.000000\n" + table("", cells(counts, "%.0f"))[1:]
    )
    log = read(path, units={"accel": f"{1 / 64} g"}, quiet=True)
    assert (log.rate, len(log.time)) == (32.0, N)
    with refuses("unit_unknown"):
        read(path, quiet=True)
