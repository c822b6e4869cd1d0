"""Columns as loggers, apps and programs name them, the truth first: read rightly, or refused with a way out that works when typed.

A line is a header (@ and ~ stand for the axes x, y, z and X, Y, Z in three columns), the columns in words, and what must come of it:
nothing (all sensors are read), the initials of the sensors that are read, or the code of a refusal.
"""

import ast
import random
import re

import numpy as np
import pytest

import jaxcal

from . import layouts

N, RATE = 400, 100.0
TIME = np.arange(N) / RATE
UNIT = {
    "r": 1.0, "d": np.pi / 180, "md": np.pi / 180e3, "mr": 1e-3, "m": 1.0, "g": layouts.G, "mg": layouts.G / 1e3, "uT": 1e-6, "G": 1e-4,
    "mG": 1e-7, "rel": 48e-6, "inc": 1 / RATE,
}  # fmt: skip
NAMES = {"w": "gyro", "a": "accel", "m": "mag"}
CASES = r"""
t,b_w_RS_S_@ | t n | no_sensor
#timestamp, p_RS_R_@ [m], b_w_RS_S_@ [rad s^-1] | ns n n | no_sensor
t,pn,pe,pd,vn,ve,vd,bg@,ba@ | t n n n n | no_sensor
time,latitude,longitude,altitude | t n | no_sensor
t,q0,q1,q2,q3 | t n 1 | no_sensor
t,@ | t n | columns_unclear
t,@,v@ | t n n | columns_unclear
Frame,Time,LASI_@,RASI_@ | i t n n | columns_unclear
t,angular_acceleration_@ | t n | no_sensor
"Time (s)","Linear Acceleration @ (m/s^2)" | t f:m | gravity_free
time;dev;a@;g@;label | t 1 a:g w:d z
timestamp,gyroRotation~,accelerometerAcceleration~ | t w:r a:g
timestamp,accelerometerAccel~,gyroscopeRot~ | t a:g w:r
Counter,Acc_~,Gyr_~,Mag_~,Mat[1][1] | i a:m w:r m:rel 1 | no_rate wa
t,dtheta_@,dv_@ | t w:inc a:inc
time,DeltaAngle_~,DeltaVelocity_~ | t w:inc a:inc
timestamp,status,accel~,gyro~,deltaVel~,deltaAngle~ | us 255 a:m w:r a:m w:r
~GYRO_OUT,~ACCL_OUT,TEMP_OUT | w:d a:mg 25 | no_rate
Time (s),~_GYRO_OUT,~_ACCL_OUT | t w:d a:g
Time [s],Accelerometer (@) [m/s2],Gyroscope (@) [rad/s] | t a:m w:r
time,scaledAccel~,scaledGyro~ | t a:g w:r
time,a@,g@,checksum | t a:g w:d hex
time,a@,g@ | t a:g w:d hex
time,a@,g@ | t a:g w:d k
time,a@,g@ | t a:g w:d z z
time,a@,g@,label | t a:g w:d
time,p,q,r,n@ | t w:r a:g
time,roll_rate,pitch_rate,yaw_rate,accel_@ | t w:d a:m
time,pqr[0],pqr[1],pqr[2],acc[0],acc[1],acc[2] | t w:r a:m
t,accelerometer.v[0],accelerometer.v[1],accelerometer.v[2],gyro.v[0],gyro.v[1],gyro.v[2] | t a:m w:r
Time,XV1_ROT,XV2_ROT,XV3_ROT,XV1_ACC,XV2_ACC,XV3_ACC | t w:d a:m
t,accelerationIncludingGravity.@,acceleration.@,rotationRate.beta,rotationRate.gamma,rotationRate.alpha | t a:m f:m w:d
t,rotation_rate_@(radians/s),gravity_@(G),user_acc_@(G),magnetic_field_@(microteslas) | t w:r v:g f:g m:uT | wm
lat lon alt roll pitch yaw vn ve vf vl vu a@ af al au w@ wf wl wu | n n n 1 1 a:m v:m w:r w:r | no_rate wa
timestamp,time_boot_ms,@acc,@gyro,@mag | t ms a:mg w:mr m:mG
timestamp,TimeUS,I,Gyr~,Acc~ | t us 0 w:r a:m
timestamp,timestamp_sample,device_id,@,temperature | us us 396825 m:G 25 | | log_sensor_mag_0.csv
Clock:offsetTime,IMU_ATTI(0):accel~,IMU_ATTI(0):gyro~ | t a:g w:d
tickNo,offsetTime,ATTI_PRINTF(0):accel~[meters/sec2],gyro~[degrees/sec] | i t a:m w:d
time,Shank LT Accel Sens ~ (mG) | t a:mg
timestamp,~ (40g) | t a:g
t,f_ib_b_@,omega_ib_b_@ | t a:m w:r
t,acc_@,acc_bias_@,gyr_@,gyr_std_@ | t a:m n w:r n
t,rate_setpoint_@,gyro_@ | t n w:r
t,@,@ | t a:m w:r
t,@ | t a:m
 | t w:d a:g m:uT
 | t w:r | | gyro.csv
 | t m:uT | | magnetometer.txt
time,a@,g@¶[s],[g],[g],[g],[dps],[dps],[dps] | t a:g w:d
"TOA5","CR6"¶"TIMESTAMP","RECORD","A@"¶"TS","RN","g","g","g"¶"","","Smp","Smp","Smp" | t i a:g
Frame,Sub Frame,@,@¶,,m/s²,m/s²,m/s²,deg/s,deg/s,deg/s | i 0 a:m w:d | no_rate
SensorId, TimeStamp (s), FrameNumber, Acc~ (g), Gyro~ (deg/s), Mag~ (uT), Euler~ (deg), LinAcc~ (g) | 1 t i a:g w:d m:uT n f:g
"""
ROWS = [[*map(str.strip, line.split("|")), "", ""][:4] for line in CASES.strip("\n").split("\n")]


def signals(seed):
    found = layouts.motion(random.Random(seed), N, RATE)
    found["v"] = found["accel"] / np.linalg.norm(found["accel"], axis=1, keepdims=True) * layouts.G
    return found | {name[0]: found[name] for name in ("accel", "mag")} | {"w": found["gyro"], "f": found["accel"] - found["v"]}


def fields(word, truth):
    rng, (kind, _, unit) = np.random.default_rng(1), word.partition(":")
    if unit:
        return np.char.mod("%.9g", truth[kind] / (UNIT[unit] if unit != "inc" else RATE))
    stamps = {"t": "%.3f", "ms": "%.0f", "us": "%.0f", "ns": "%.0f"}
    if kind in stamps:
        return np.char.mod(stamps[kind], 5.0 + TIME if kind == "t" else (5.0 + TIME) * {"ms": 1e3, "us": 1e6, "ns": 1e9}[kind])[:, None]
    held = {
        "i": np.char.mod("%d", np.arange(N)), "z": np.full(N, ""), "k": np.char.mod("%d", rng.integers(0, 256, N)),
        "hex": np.char.mod("%02X", rng.integers(0, 256, N)),
    }  # fmt: skip
    return np.char.mod("%.4f", np.sin(np.outer(TIME, [1, 2, 3])) * [1, 2, 3]) if kind == "n" else held.get(kind, np.full(N, word))[:, None]


def spread(header):
    mark = next((mark for mark in ";\t," if mark in header), " ")
    for sign, axes in (("@", "xyz"), ("~", "XYZ")):
        each = re.compile(rf"(?:(?<={mark})|^)[^{mark}\n]*{re.escape(sign)}[^{mark}\n]*", re.MULTILINE)
        header = each.sub(lambda field, sign=sign, axes=axes: mark.join(field[0].replace(sign, axis) for axis in axes), header)
    return mark, header


def typed(said):
    """The options that a refusal or a finding names, as Python reads them; the rate is known to whoever recorded the log."""
    found = {name: ast.literal_eval(value) for name, value in re.findall(r"\b(columns|units|topics)=('[^']+'|\{[^}.]+\})", said)}
    return found | ({"rate": RATE} if "rate=" in said else {})


def check(log, truth, wanted):
    assert log.rate == pytest.approx(RATE, rel=5e-3)
    assert {name for name in NAMES.values() if getattr(log, name) is not None} == {NAMES[one] for one in wanted}
    for one in wanted:
        assert np.abs(getattr(log, NAMES[one]) - truth[one]).max() < 2e-3 * np.abs(truth[one]).max()


@pytest.mark.parametrize("seed", [1, 4], ids=["turned", "still"])
@pytest.mark.parametrize(("header", "words", "outcome", "file"), ROWS)
def test_columns_are_read_rightly_or_refused_with_a_way_out(header, words, outcome, file, seed, tmp_path, refuses):
    truth, (mark, head) = signals(seed), spread(header.replace("¶", "\n"))
    body = np.hstack([fields(word, truth) for word in words.split()])
    path = tmp_path / (file or "log.csv")
    path.write_text("".join(line + "\n" for line in [*([head] if head else []), *(mark.join(row) for row in body.tolist())]))
    sensors = "".join(dict.fromkeys(word[0] for word in words.split() if word[0] in "wam" and ":" in word))
    code, _, wanted = outcome.partition(" ") if "_" in outcome else ("", "", outcome)
    options = {}
    if code:
        with refuses(code) as caught:
            jaxcal.read(path, quiet=True)
        options = typed(str(caught.value))
    if not code or code == "no_rate":
        check(jaxcal.read(path, quiet=True, **options), truth, wanted or sensors)


def lvm(truth):
    head = "LabVIEW Measurement\nX_Columns\tOne\n***End_of_Header***\t\nChannels\t3\nY_Unit_Label\tg\tg\tg\nDelta_X\t0.01\n"
    rows = "".join(f"{t:.3f}\t" + "\t".join(f"{v:.9g}" for v in a / layouts.G) + "\t\n" for t, a in zip(TIME, truth["a"], strict=True))
    return head + "***End_of_Header***\t\nX_Value\tUntitled\tUntitled 1\tUntitled 2\tComment\n" + rows


def lines(form):
    """Text of one or more lines for each sample: `form` takes its number, its time, and its rates, specific force and field."""
    return lambda truth: "".join(form(k, t, *(truth[one][k] for one in "wam")) for k, t in enumerate(TIME.tolist()))


def listed(*values):
    return ",".join(f"{v:.9g}" for v in np.concatenate(values))


def record(sensor, t, v):
    x, y, z = map(str, v)
    return f'{{"sensor":"{sensor}","time":"{1_700_000_000_000_000_000 + round(1e9 * t)}","x":"{x}","y":"{y}","z":"{z}"}}\n'


TEXTS = {
    "LabVIEW without names": ("log.lvm", lvm, "a"),
    "VectorNav": ("log.txt", lines(lambda k, t, w, a, m: f"$VNYMR,1.0,2.0,3.{k % 9},{listed(m / 1e-4, a, w)}*{k % 256:02X}\n"), "wam"),
    "DataFlash text": ("flight.log", lambda truth: "FMT, 129, 9, IMU, QBffffff, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ\n" + lines(
        lambda k, t, w, a, m: f"IMU, {7e6 + 1e6 * t:.0f}, 0, {listed(w, a)}\nIMU, {7e6 + 1e6 * t:.0f}, 1, 0,0,0,0,0,0\nATT, 1, 2\n"
    )(truth), "wa"),
    "a label on each of six lines": ("log.txt", lines(
        lambda k, t, w, a, m: "".join(f"{name}{x}: {v:.9g}\n" for name, u in (("A", a), ("G", w)) for x, v in zip("XYZ", u, strict=True))
    ), "wa"),
    "decimal commas in quotes": ("log.csv", lambda truth: '"time","ax","ay","az"\n' + lines(
        lambda k, t, w, a, m: ",".join(f'"{v:.6f}"' for v in [t, *a]).replace(".", ",") + "\n")(truth), "a"),
    "records of several sensors in turn": ("log.json", lines(
        lambda k, t, w, a, m: record("Accelerometer", t, 0.01 * w) + record("Gyroscope", t, w) + record("TotalAcceleration", t, a)), "wa"),
}  # fmt: skip


@pytest.mark.parametrize("which", TEXTS)
def test_text_of_a_program_is_read(which, tmp_path):
    name, make, wanted = TEXTS[which]
    truth = signals(1)
    (tmp_path / name).write_text(make(truth))
    try:
        log = jaxcal.read(tmp_path / name, quiet=True)
    except jaxcal.DataError as error:  # without a clock, the refusal asks for the rate
        log = jaxcal.read(tmp_path / name, quiet=True, **typed(str(error)))
    check(log, truth, wanted)


def test_a_workbook_is_read_by_sheet_or_as_a_sensor_in_each(tmp_path, refuses):
    pytest.importorskip("python_calamine")
    truth, path = signals(1), tmp_path / "log.xlsx"
    sheet = lambda one, unit: [["t (s)", *(f"{x} ({unit})" for x in "xyz")], *np.column_stack([TIME, truth[one]]).tolist()]  # noqa: E731
    layouts.workbook(path, {"Accelerometer": sheet("a", "m/s^2"), "Gyroscope": sheet("w", "rad/s"), "Metadata": [["version", "1.0"]]})
    check(jaxcal.read(path, quiet=True), truth, "wa")
    layouts.workbook(path, {"left": sheet("a", "m/s^2"), "right": sheet("a", "m/s^2")})
    with refuses("several") as caught:
        jaxcal.read(path, quiet=True)
    check(jaxcal.read(path, quiet=True, **typed(str(caught.value))), truth, "a")


def test_channels_of_a_tdms_file_have_their_unit_and_rate(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    truth, path = signals(1), tmp_path / "log.tdms"
    with nptdms.TdmsWriter(path) as writer:
        about = {"unit_string": "g", "wf_increment": 1 / RATE}
        writer.write_segment([nptdms.ChannelObject("imu", f"Acc{x}", truth["a"][:, k] / layouts.G, about) for k, x in enumerate("XYZ")])
    check(jaxcal.read(path, quiet=True), truth, "a")


def test_a_unit_against_that_of_the_header_is_said(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t [s],gx [rad/s]\n" + "".join(f"{t},{np.sin(t)}\n" for t in TIME))
    said = [one for one in jaxcal.read(path, units="gyro=deg/s", quiet=True).findings if one.code == "against_header"]
    assert [(one.facts["unit"], one.facts["header"]) for one in said] == [("deg/s", "rad/s")]
