"""Habits of loggers and programs in the wild: stamps, separators, units in words, lists, messages as text, rows of several devices."""

import datetime
import json

import numpy as np
import pytest

from jaxcal import read

N, RATE, G = 300, 50.0, 9.80665
TIME = np.arange(N) / RATE
_RNG = np.random.default_rng(5)
ACCEL = np.round(_RNG.normal([0.1, -0.2, 1.0], 0.02, (N, 3)), 4)  # g
GYRO = np.round(_RNG.normal(0.01, 0.004, (N, 3)), 6)  # rad/s
MOMENTS = [datetime.datetime(2023, 5, 1, 11, 59, 58) + datetime.timedelta(seconds=t) for t in TIME.tolist()]


def rows(stamps, mark=",", values=ACCEL):
    return "".join(mark.join([stamp, *(f"{v:.4f}" for v in row)]) + "\n" for stamp, row in zip(stamps, values, strict=True))


def stamped(form, head="time,ax,ay,az\n"):
    return head + rows([form(m) for m in MOMENTS])


def echoed(accel, gyro, t):
    xyz = lambda name, v: f"{name}:\n" + "".join(f"  {x}: {value}\n" for x, value in zip("xyz", v, strict=True))  # noqa: E731
    stamp = f"header:\n  stamp:\n    sec: {1700000000 + int(t)}\n    nanosec: {round((t % 1) * 1e9)}\n  frame_id: imu\n"
    return f"{stamp}{xyz('angular_velocity', gyro)}angular_velocity_covariance:\n- 0.1\n- 0.0\n{xyz('linear_acceleration', G * accel)}---\n"


SECONDS = [f"{t:.2f}" for t in TIME]
READ = {
    "brackets around times": stamped(lambda m: m.strftime("[%H:%M:%S.%f]")),
    "dates with dashes between the hours": stamped(lambda m: m.strftime("%Y-%m-%d_%H-%M-%S.%f")),
    "dates without marks": stamped(lambda m: m.strftime("%Y%m%dT%H%M%S.%f")),
    "dates as digits": stamped(lambda m: m.strftime("%Y%m%d%H%M%S%f")[:-3]),
    "dates of ctime": stamped(lambda m: m.strftime("%a %b %d %H:%M:%S.%f %Y")),
    "milliseconds without leading zeros": stamped(lambda m: f"{m:%H:%M:%S}.{m.microsecond // 1000}"),
    "no leading zeros at all": stamped(lambda m: f"{m.hour}:{m.minute}:{m.second}:{m.microsecond // 1000}"),
    "fractions without trailing zeros": stamped(lambda m: f"{m:%H:%M:%S}.{m.microsecond // 1000:03d}".rstrip("0")),
    "hours, minutes, seconds and milliseconds": stamped(
        lambda m: f"{m.hour},{m.minute},{m.second},{m.microsecond // 1000}", "Time(h),Time(m),Time(s),Time(ms),ax,ay,az\n"
    ),
    "hours and seconds with decimals": stamped(
        lambda m: f"2023,{m.hour},{m.minute},{m.second + m.microsecond / 1e6}", "Year,Hour,Min,Sec,ax,ay,az\n"
    ),
    "blocks of zero bytes": "time_ms,ax,ay,az\n" + rows([f"{1000 * t:.0f}" for t in TIME]) + "\0" * 600,
    "records in lines": "".join(
        json.dumps({"t": t, "accel": dict(zip("xyz", row, strict=True))}) + "\n"
        for t, row in zip(TIME.tolist(), ACCEL.tolist(), strict=True)
    ),
    "lists in quotes": "time,accel\n" + "".join(f'{t},"{row}"\n' for t, row in zip(SECONDS, ACCEL.tolist(), strict=True)),
    "ESP-IDF": "".join(
        f"I ({320 + 1000 * t:.0f}) MPU: acc_x:{a[0]:.4f}, acc_y:{a[1]:.4f}, acc_z:{a[2]:.4f}\n" for t, a in zip(TIME, ACCEL, strict=True)
    ),
    "messages printed by ROS 2": "".join(map(echoed, ACCEL, GYRO, TIME)),
    "ROS 2 as CSV": "".join(
        ",".join(
            [f"{1700000000 + int(t)},{round((t % 1) * 1e9)},imu", *["0"] * 13, *map(str, w), *["0"] * 9, *map(str, G * a), *["0"] * 9]
        ) + "\n"
        for t, w, a in zip(TIME, GYRO, ACCEL, strict=True)
    ),
    "Kalibr": "timestamp,omega_x,omega_y,omega_z,alpha_x,alpha_y,alpha_z\n"
    + rows([f"{1.7e18 + 1e9 * t:.0f}" for t in TIME], values=np.hstack([GYRO, G * ACCEL])),
    "units in words": "time,ax (in meters per second squared),ay (in m/s**2),az (metres/second^2)\n" + rows(SECONDS, values=G * ACCEL),
    "Polish": "czas,przyspieszenie x,przyspieszenie y,przyspieszenie z\n" + rows(SECONDS),
    "Turkish": "zaman,ivme x,ivme y,ivme z\n" + rows(SECONDS),
    "a clock whose name says so only in part": (
        "tickNo,offsetTime,ax,ay,az\n" + rows([f"{4000000 + 90000 * i},{t}" for i, t in enumerate(SECONDS)])
    ),
    "bursts of a radio": "t_ms,ax,ay,az\n" + rows([f"{1000 * TIME[i - i % 5] + i % 5:.0f}" for i in range(N)]),
    "seconds of the GPS week": "GPST,ax,ay,az\n" + rows([f"{390884.27 + t:.2f}" for t in TIME]),
    "a sensor in each row": "time,sensor,x,y,z\n" + "".join(
        f"{t},acc,{a[0]},{a[1]},{a[2]}\n{t}1,gyr,{w[0]},{w[1]},{w[2]}\n" for t, a, w in zip(SECONDS, ACCEL, GYRO, strict=True)
    ),
    "corrected values": "time,AccelCorrectedX,AccelCorrectedY,AccelCorrectedZ\n" + rows(SECONDS),
}  # fmt: skip


@pytest.mark.parametrize("which", READ)
def test_a_habit_is_read(which, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(READ[which], encoding="utf-8")
    log = read(path, quiet=True)
    assert log.rate == pytest.approx(RATE, rel=2e-3)
    np.testing.assert_allclose(log.accel, ACCEL * G, atol=2e-2)
    assert all(one.subject == ("gyro",) for one in log.findings if one.kind.guess)


def turns(*kinds):
    return "".join(kind.format(*row) for row in ACCEL for kind in kinds)


REFUSED = {
    "a sensor in three lines": (turns("Accel X: {0} Y: {1} Z: {2}\n", "Temp: {0}\n"), "no_rate"),
    "messages of a flight log": (turns("IMU, {0}, {1}, {2}\n", "ATT, {0}, {1}\n"), "several_kinds"),
    "a time above each sample": (
        "".join(f"12:00:{int(t):02d}\n{a[0]} {a[1]} {a[2]}\n" for t, a in zip(TIME, ACCEL, strict=True)), "rows_left_out"),
    "printed arrays": ("".join(f"[[{a[0]} {a[1]} {a[2]}]\n [{a[0]} {a[1]} {a[2]}]]\n" for a in ACCEL), "printed"),
    "hexadecimal counts": ("ax,ay,az\n" + "0x1F,0x3FF,0x4000\n" * N, "no_rows"),
    "a program": ("import smbus\nread(0x68, 0x3b)\n" * N, "no_rows"),
    "an id of two devices": ("id,t_ms,ax,ay,az\n" + "".join(
        f"{k},{20 * i + k},{(1 - 2 * k) * a[0]:.4f},{a[1]:.4f},{a[2]:.4f}\n" for i, a in enumerate(ACCEL) for k in (0, 1)), "mixed"),
    "types of rows as numbers": ("".join(
        f"{20 * i},1,{a[0]},{a[1]},{a[2]}\n{20 * i + 3},4,{w[0]},{w[1]},{w[2]}\n"
        for i, (a, w) in enumerate(zip(ACCEL, GYRO, strict=True))),
        "mixed"),
    "one of two devices dead": (turns("IMU,0x69,0,0,0\n", "IMU,0x68,{0},{1},{2}\n"), "mixed"),
    "an attitude that rises": ("attitude.yaw,ax,ay,az\n" + rows(SECONDS), "no_rate"),
    "a latitude that rises": ("Geodetic Latitude,mx,my,mz\n" + rows(SECONDS, values=31.7 * ACCEL), "no_rate"),
    "a sum that rises": ("energy,ax,ay,az\n" + rows([f"{0.001 * i**2 + i / 50:.4f}" for i in range(N)]), "no_rate"),
    "steps of time": ("dt,ax,ay,az\n" + rows(["0.02"] * N), "no_rate"),
    "a counter of microseconds that wraps within a few samples": (
        "time_us,ax,ay,az\n" + rows([str(20000 * i % 65536) for i in range(N)]), "irregular"),
    "a column that counts the milliseconds of each second": (
        "ms,ax,ay,az\n" + rows([str(20 * i % 1000) for i in range(N)]), "irregular"),
    "cut fractions without leading zeros": (
        stamped(lambda m: f"{m:%H:%M:%S}.{str(m.microsecond)[:4]}").replace(".2000,", ".41,"),
        "fractions"),
    "a button between light and temperature": ("".join(
        f"{m},{a[0]},{a[1]},{a[2]},{300 + i % 7},0,27.{i % 10}\n" for i, (m, a) in enumerate(zip(SECONDS, ACCEL, strict=True))),
        "columns_unclear"),
    "rows that hold one sensor each": ("time,ax,ay,az,gx,gy,gz\n" + "".join(
        f"{t},{a[0]},{a[1]},{a[2]},,,\n{t}4,,,,{w[0]},{w[1]},{w[2]}\n" for t, a, w in zip(SECONDS, ACCEL, GYRO, strict=True)),
        "unclear"),
    "a header with too few names": (
        "time,ax,ay,az,gx,gy,gz\n" + "".join(f"{t},{t},7,{a[0]},{a[1]},{a[2]},1,{a[0]}\n" for t, a in zip(SECONDS, ACCEL, strict=True)),
        "columns_unclear"),
    "counts without names": (
        "".join(",".join(str(round(v)) for v in [*(16384 * a), *w]) + "\n" for a, w in zip(ACCEL, 1e5 * GYRO, strict=True)),
        "no_gravity"),
    "a time in words": ("time,ax,ay,az\n" + rows(["noon"] * N), "no_rate"),
}  # fmt: skip


@pytest.mark.parametrize("which", REFUSED)
def test_a_habit_is_refused_with_what_to_do(which, tmp_path, refuses):
    text, said = REFUSED[which]
    (tmp_path / "log.csv").write_text(text)
    with refuses(said):
        read(tmp_path / "log.csv", quiet=True)


def test_one_sensor_of_several_in_turn_can_be_named(tmp_path):
    (tmp_path / "log.csv").write_text(REFUSED["rows that hold one sensor each"][0])
    log = read(tmp_path / "log.csv", columns="time=time,accel=ax,ay,az", units="accel=g", quiet=True)
    assert log.rate == pytest.approx(RATE, rel=1e-3)
    np.testing.assert_allclose(log.accel, ACCEL * G, atol=1e-6)
    (tmp_path / "log.csv").write_text(READ["a sensor in each row"])
    log = read(tmp_path / "log.csv", columns="time=0,accel=2:4", units="accel=g", quiet=True)
    assert "mixed" in log.codes


def test_a_rising_column_whose_name_does_not_speak_of_time_is_a_guess(tmp_path):
    (tmp_path / "log.csv").write_text("foo,ax,ay,az\n" + rows(SECONDS))
    log = read(tmp_path / "log.csv", quiet=True)
    assert any(one.code == "assumed" and "its name does not say so" in one.facts["why"] for one in log.findings)


def test_a_column_speaks_of_time_by_its_unit(tmp_path):
    (tmp_path / "log.csv").write_text("X [ms],ax,ay,az\n" + rows([str(1000 * i) for i in range(N)]))
    log = read(tmp_path / "log.csv", quiet=True)
    assert log.rate == pytest.approx(1.0)
    assert not any("name does not say so" in warning for warning in log.warnings)


def test_columns_of_hours_can_be_named(tmp_path):
    (tmp_path / "log.csv").write_text(READ["hours, minutes, seconds and milliseconds"])
    assert read(tmp_path / "log.csv", columns="time=0:3,accel=4:6", units="accel=g", quiet=True).rate == pytest.approx(RATE)


def test_a_slow_sensor_in_a_fast_log_is_told(tmp_path):
    held = np.repeat(ACCEL[::5], 5, axis=0)
    (tmp_path / "log.csv").write_text("time,ax,ay,az\n" + rows(SECONDS, values=held))
    assert "repeats" in read(tmp_path / "log.csv", quiet=True).codes
    coarse = np.round(50 * ACCEL) / 50
    (tmp_path / "log.csv").write_text("time,ax,ay,az\n" + rows(SECONDS, values=coarse))
    assert "repeats" not in read(tmp_path / "log.csv", quiet=True).codes


def test_a_field_near_a_magnet_is_no_sure_milligauss(tmp_path):
    field = _RNG.normal([104.0, 145.0, -418.0], 0.4, (N, 3))
    (tmp_path / "magnetometer.csv").write_text("time,x,y,z\n" + rows(SECONDS, values=field))
    log = read(tmp_path / "magnetometer.csv", quiet=True)
    assert [one.facts["unit"] for one in log.findings if one.code == "assumed" and one.subject == ("mag",)] == ["mG"]
    (tmp_path / "magnetometer.csv").write_text(
        "time,x (in microteslas),y (in microteslas),z (in microteslas)\n" + rows(SECONDS, values=field)
    )
    np.testing.assert_allclose(read(tmp_path / "magnetometer.csv", quiet=True).mag, field * 1e-6, atol=1e-9)


@pytest.mark.parametrize("stamps", [SECONDS, stamped(lambda m: f"{m}").split("\n")[1:-1]], ids=["seconds", "dates"])
@pytest.mark.parametrize("header", ["time,ax,ay,az\n", ""])
def test_rows_newest_first_are_put_in_order(stamps, header, tmp_path):
    lines = rows([one.partition(",")[0] for one in stamps]).splitlines()
    (tmp_path / "log.csv").write_text(header + "\n".join(lines[::-1]) + "\n")
    log = read(tmp_path / "log.csv", quiet=True)
    assert ("newest_first" in log.codes, log.rate) == (True, pytest.approx(RATE, rel=1e-3))
    np.testing.assert_allclose(log.accel, ACCEL * G, atol=1e-3)
    # beside a clock that rises, a signal that falls turns nothing round
    (tmp_path / "log.csv").write_text("".join(f"{line},{-i}\n" for i, line in enumerate(lines)))
    assert "newest_first" not in read(tmp_path / "log.csv", columns="time=0,accel=1:3", quiet=True).codes


def test_a_unit_in_brackets_outranks_a_name(tmp_path):
    head = "Sample No.,Flags[hex],Ts[deg.C],Ax[G],Ay[G],Az[G]\n"
    (tmp_path / "log.csv").write_text(head + rows([f"{i},0,{25 + 1e-4 * i:.4f}" for i in range(N)]))
    log = read(tmp_path / "log.csv", rate=RATE, quiet=True)
    np.testing.assert_allclose(log.temperature, 25 + 1e-4 * np.arange(N), atol=1e-9)
