"""Wrong calls and unsuitable inputs end before any fit with a message that says what to type, and leave no files."""

import re
import shlex

import numpy as np
import pytest

from jaxcal.cli import main

from .conftest import HEADER as IMU, save

RATE = 50.0
MAG = "time [s],accel_x [m/s^2],accel_y [m/s^2],accel_z [m/s^2],mag_x [uT],mag_y [uT],mag_z [uT]"

# each call with words that its message must contain; `logs` below writes the files

#: the call was wrong
CALLS = """
noise                                      | needs a log: jaxcal noise LOG.csv. To see how it works: jaxcal demo
north                                      | needs a table of readings, or a log: jaxcal north table.csv --latitude 39.93
apply                                      | needs CALIBRATION: jaxcal apply calibration.json LOG.csv --out corrected.csv
apply device.json rest.csv                 | needs --out: jaxcal apply calibration.json LOG.csv --out corrected.csv
convert rest.csv                           | needs OUT: jaxcal convert LOG.csv LOG.npz
diff device.json                           | needs SECOND: jaxcal diff old.json new.json
export device.json                         | needs --to: jaxcal export calibration.json --to kalibr
batch rest.csv                             | needs --out: jaxcal batch logs/ --task noise --out fleet
help noise                                 | use: jaxcal noise --help
-version                                   | use: jaxcal --version
simulate imu                               | needs --out: jaxcal simulate imu --out log.csv
noise rest.csv --out                       | --out stands without its value. Folder for the files
noise rest.csv --rate                      | --rate stands without its value. jaxcal noise --help says
noise rest.csv --json -                    | --json stands without its value. Numbers, findings
noise rest.csv --plot a.bmp                | expected a name that ends in .png, .svg or .pdf
noise rest.csv --report a.pdf              | expected a name that ends in .html; a browser prints it as PDF
noise rest.csv --columns gx gy gz          | with commas: --columns gyro=gx,gy,gz
noise rest.csv --units deg/s               | --units: 'deg/s' has no quantity before it; expected such as gyro=deg/s
noise rest.csv --start 10:00               | give seconds: --start 600
noise rest.csv --stop 1h                   | give the number alone, in the unit of --help, as 1
noise rest.csv --sensor gyro               | jaxcal noise --help lists those it has
noise rest.csv --name unit7                | --name is an option of jaxcal imu, rate-table, device and apply
imu poses.csv --gravity 981                | expected 9.76 to 9.84 m/s^2; --latitude gives it
mag tumble.csv --field 50000               | expected 20 to 70 uT
mag new.csv --live                         | --live stands without its value. Record LOG
export device.json --format kalibr         | jaxcal export has no option --format; use --to
budget device.json --motion car            | expected rest, circle (a vehicle), hand, or a log
budget device.json --require heading       | expected such as heading=1
sheet bmi088                               | expected such as 0.3 deg/sqrt(h)
batch --out fleet                          | jaxcal batch logs/ --task noise --out fleet
batch two --out two                        | is the folder of the logs; the results need one of their own
batch rest.csv --task device --out fleet   | Choose from: "noise", "mag", "imu"
simulate noise --out a.csv                 | give the noise of a sensor, as in --gyro
rest.csv                                   | is a file, and the first word is the command: jaxcal info rest.csv
nois rest.csv                              | Did you mean "noise"?
magnetometer tumble.csv                    | there is no command magnetometer; use: jaxcal mag
simulate nois                              | takes what to simulate: noise, temperature, imu, mag, device, north
noise rest.csv tumble.csv                  | To work on each: jaxcal batch rest.csv tumble.csv --task noise --out fleet
psd rest.csv tumble.csv                    | one after the other: jaxcal psd rest.csv
noise rest.csv device.json                 | To correct it with a calibration first: jaxcal noise rest.csv --calibration device.json
mag rest.csv device.json                   | To correct it first: jaxcal apply device.json rest.csv --out corrected.npz
diff device.json device.json device.json   | compares two calibrations, and these are 3
noise rest.csv 100                         | 100 belongs to no option: numbers stand behind the name of an option, as in --rate 100
noise rest.csv --verbose yes                | --verbose takes no value here; leave out yes
demo extra                                 | has no use for extra
noise -                                    | and not its standard input: save the log first (cat > log.csv), then: jaxcal noise log.csv
noise https://example.org/log.csv          | https://example.org/log.csv is an address; download the log first
noise 'logs/*.csv'                         | for all files of a pattern: jaxcal batch 'logs/*.csv' --task noise --out fleet
noise rest                                 | rest does not exist. Did you mean rest.csv?
noise nowhere/rest.csv                     | because there is no folder nowhere
noise device.json                          | is a calibration and not a log; jaxcal apply device.json LOG --out corrected.npz applies it
noise noise.json                           | holds results of jaxcal and is not a log; give the log that they came from
noise report.html                          | is a report and not a log; give the log that it was made from
north folder                               | is a folder; jaxcal north takes one file
apply rest.csv device.json --out a.csv     | the calibration comes first: jaxcal apply device.json rest.csv --out a.csv
apply rest.csv tumble.csv --out a.csv      | rest.csv is a log, and a calibration is asked for: a file calibration.json
apply folder rest.csv --out a.csv          | is a folder; give the calibration in it
apply device.json rest.csv --out a.bag     | expected a name that ends in .csv or .npz
apply device.json rest.csv --out rest.csv  | rest.csv is the log that is read; it would be overwritten
convert gone.npz rest.csv                  | the log comes first: jaxcal convert rest.csv gone.npz
export rest.csv --to kalibr                | rest.csv is a log, and a calibration is asked for
export device.json --to excel              | Choose from: "kalibr", "openvins"
export device.json --to kalibr --ids accel=1 | --to kalibr has no option --ids; it has --axis
export device.json --to px4 --ids accel=x  | expected accel=NUMBER,gyro=NUMBER,mag=NUMBER
export device.json --to gtsam --rate 100     | --to gtsam has no option --rate, which is for kalibr
diff device.json device.json --significance 5 | expected a probability between 0 and 1, such as 0.01
noise rest.csv --calibration tumble.csv    | --calibration tumble.csv is a log, and a calibration is asked for
mag tumble.csv --against gone.json         | gone.json does not exist
noise rest.csv --field 50                  | --field is an option of jaxcal mag, device and simulate, not of jaxcal noise
noise rest.csv --unit gyro=deg/s           | expected --units gyro=deg/s for a unit of the file
noise rest.csv --fs 100                    | has no option --fs; use --rate
noise rest.csv --kalibr                    | use --export kalibr
noise rest.csv --rate 100Hz                | give the number alone, in the unit of --help, as 100
noise rest.csv --rate 0,01                 | numbers have a decimal point: --rate 0.01
imu poses.csv --latitude 39.9N             | --latitude 39.9
noise rest.csv --rate -100                 | positive number of Hz
noise rest.csv --confidence 95             | expected 0.01 to 0.9999
noise rest.csv --start 3 --stop 2          | nothing lies between; the start comes first
noise rest.csv --band 10 1                 | the shortest first
noise rest.csv --terms QNX                 | expected letters of QNBKRM
noise rest.csv --method whittel            | Did you mean "whittle"?
noise rest.csv --units gyro=furlong/s      | 'furlong/s' is not a unit of gyro
noise rest.csv --format xls                | expected one of csv, npy
noise rest.csv --export word               | unknown format 'word'; expected one of kalibr
noise rest.csv --json folder               | folder is a folder; give the name of a file in it
noise rest.csv --report nowhere/a.html     | cannot write into
noise rest.csv --json a --report ./a       | two outputs have the same file name
noise rest.csv --config gone.toml          | there is no such file
noise rest.csv --config device.json        | is not TOML
allan rest.csv --kind xdev                 | "oadev"
mag tumble.csv --field 5                   | expected 20 to 70 uT
mag tumble.csv --place 39.93 32.86         | --place 39.93 32.86 --date 2026-05-31
mag tumble.csv --date 2026-05-31           | --place and --date go together
mag tumble.csv --place 39.93,32.86 --date 2026-05-31 | --place 39.93 32.86
mag tumble.csv --place 132.86 39.93 --date 2026-05-31 | the latitude comes first: --place 39.93 132.86
mag tumble.csv --place 39.93 32.86 --date 31.05.2026 | write year, month, day: --date 2026-05-31
mag tumble.csv --place 39.93 32.86 --date 1875-01-01 | --date 1875-01-01
mag tumble.csv --place 39.93 32.86 --date 2026-05-31 --field 47 | exclude one another
mag tumble.csv --model spere                | Did you mean "sphere"?
imu poses.csv --gravity 9.5                | 9.76 to 9.84 m/s^2; --latitude gives it
imu poses.csv --earth-rate                 | --earth-rate needs --latitude
temperature warm.csv --degree 3            | go together
temperature warm.csv --lag soon            | expected auto, or a number from 0
north table.csv --latitude 95              | to 90 degrees
north table.csv --gyro N=0.01              | N has no unit; use one of deg/sqrt(h)
north table.csv --gyro N=0.01deg/h         | 'deg/h' is not a unit of N of a gyro
north table.csv --prior s_a                | expected NAME=STANDARD_DEVIATION
north table.csv --angles a,b               | expected numbers with commas between them, such as 0,90,180,270
batch nowhere/ --out fleet                 | there are no logs at nowhere
batch rest.csv --task fly --out fleet      | Choose from: "noise", "mag"
batch rest.csv --out fleet --set a         | expected NAME=VALUE, such as confidence=0.9
batch rest.csv --out fleet --set gravity=9.8 | task 'noise' has no option gravity
batch rest.csv --out fleet --workers 0     | a number above 0
device rest.csv                            | needs accelerometer, gyroscope and magnetometer in one log
north table.csv --latitude 35 --plot a.txt | ends in
export device.json --to kalibr --random-walk much | --random-walk much: expected
export empty.json --to c                   | no JSON, and a calibration is asked for
"""

#: the data do not allow a result
DATA = """
noise tumble.csv                           | the sensor moves in
noise poses.csv                            | jaxcal noise needs a sensor at rest
noise bumped.csv                           | It is still from
temperature rest.csv                       | no temperature; name its column with --columns temperature=NAME
temperature shaken.csv                     | jaxcal temperature needs a sensor at rest
mag still_mag.csv                          | the field comes from one side all the time
mag rest.csv                               | no magnetometer of three axes; name its columns with --columns mag=mx,my,mz
imu rest.csv                               | the sensor rests in one attitude all the time
imu gyro_only.csv                          | no accelerometer
noise rest.csv --units accel=g             | that of gravity in m/s^2. Give --units 'accel=m/s^2'
noise grams.csv --units accel=m/s^2        | that of gravity in g. Give --units accel=g
mag tumble.csv --units mag=nT              | it is that in uT. Give --units mag=uT
imu poses.csv --units gyro=deg/s           | as it says in rad/s (r = 1.00). Give --units gyro=rad/s
noise folder                               | no readable log
noise two                                  | jaxcal batch two --task noise --out fleet
noise rest.csv --rate 200                  | contradicts the time stamps, which say 50 Hz
noise rest.csv --columns gyro=99           | gyro wants column 99
noise rest.csv --columns gyro=wx,wy,wz     | wx
noise rest.csv --topics /imu0              | choose with --columns
noise rest.csv --start 1000                | Choose another start and stop
noise rest.csv --format npy                | rest.csv
noise notes.txt                            | notes.txt
noise header.csv                           | no rows
noise bytes.csv                            | bytes.csv
noise cut.npz                              | cut.npz
noise cut.parquet                          | cut.parquet
noise cut.bag                              | cut.bag
noise cut.mcap                             | cut.mcap
noise constant.csv                         | equal
noise wrong_name.npy                       | damaged, or misnamed
noise pointer.csv                          | git lfs pull
noise standing.csv                         | standing.csv
noise nothing.csv                          | nothing.csv
noise nameless.csv                         | --columns
noise odd_unit.csv                         | gives no known unit of gyro
noise counts.csv                           | --units 'gyro=
noise oops.csv                             | oops
noise short.csv                            | too short
noise huge.csv                             | huge.csv
noise attitude.csv                         | no inertial sensor
noise no_time.csv                          | --rate
noise still_mag.csv --columns gyro=4:6     | still_mag.csv
north no_angle.csv                         | no column with an angle
north no_sensor.csv                        | neither accelerometer nor gyro readings
north bad_unit.csv                         | is not a unit of gyro
north up.csv --latitude 35                 | no mounting 'up'
north empty.csv --latitude 35              | is empty
north bad_cell.csv                         | line 3: 'soon' is not a number
north header_only.csv                      | it takes one row per position
north degrees.csv                          | look like
north rest.csv                             | a test takes rests on several positions
allan rest.csv --m 0                       | cluster size 0 is outside
allan rest.csv --m 100000                  | cluster size 100000 is outside
allan warm_only.csv                        | neither gyroscope, accelerometer nor magnetometer
mag tumble.csv --align gyro                | the log has no gyro; name its columns with --columns gyro=...
temperature cold.csv                       | over its range of use, 2 degC at least
export device.json --to kalibr             | run jaxcal noise on a log of the sensor at rest
diff device.json device.json               | have no part in common that could be compared
apply broken.json rest.csv --out a.csv     | broken.json
noise other.json                           | other.json
"""


def cases(text, status):
    for line in text.strip().splitlines():
        call, words = (part.strip() for part in line.split(" | "))
        yield pytest.param(call, status, words, id=call)


def turning(samples, seed):
    """Directions of a vector fixed in space, in the axes of a tumbling sensor, (n, 3)."""
    angle = np.cumsum(np.random.default_rng(seed).normal(size=(samples, 2)) * 0.02 + 0.06, axis=0)
    return np.stack([np.cos(angle[:, 0]) * np.sin(angle[:, 1]), np.sin(angle[:, 0]) * np.sin(angle[:, 1]), np.cos(angle[:, 1])], axis=1)


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A folder with all files that the calls name."""
    folder = tmp_path_factory.mktemp("logs")
    random = np.random.default_rng(0)
    n = 2000
    time = np.arange(n) / RATE
    noise = random.normal(size=(n, 6)) * np.repeat([1e-2, 5e-2], 3)
    rest = np.column_stack([time, noise + np.array([0, 0, 0, 0, 0, 9.80665])])
    save(folder / "rest.csv", rest, IMU)
    save(folder / "grams.csv", np.column_stack([rest[:, :4], rest[:, 4:] / 9.80665]), IMU.replace("m/s^2", "g"))
    tumble = turning(600, 1)
    slow = np.arange(600) / 10.0
    save(folder / "tumble.csv", np.column_stack([slow, 9.8 * tumble, 47.0 * turning(600, 2) + random.normal(size=(600, 3)) * 0.2]), MAG)
    flat = np.column_stack([slow, rest[:600, 4:], np.array([20.0, 5.0, 40.0]) + random.normal(size=(600, 3)) * 0.2])
    save(folder / "still_mag.csv", flat, MAG)
    save(folder / "poses.csv", moving(n, random), IMU)
    bumped = rest.copy()
    bumped = np.column_stack([np.arange(6000) / RATE, np.concatenate([rest[:, 1:]] * 3)])
    bumped[5000:, 4:] = bumped[5000:, [6, 4, 5]]
    save(folder / "bumped.csv", bumped, IMU)
    save(folder / "gyro_only.csv", rest[:, :4], IMU.partition(",accel")[0])
    warm = 20.0 + 25.0 * time / time[-1]
    save(folder / "warm.csv", np.column_stack([rest, warm]), IMU + ",temperature [degC]")
    save(folder / "shaken.csv", np.column_stack([moving(n, random), warm]), IMU + ",temperature [degC]")
    save(folder / "cold.csv", np.column_stack([rest, np.full(n, 20.0)]), IMU + ",temperature [degC]")
    save(folder / "warm_only.csv", np.column_stack([time, warm]), "time [s],temperature [degC]")
    content(folder, rest)
    tables(folder)
    return folder


def moving(n, random):
    """Rows of an inertial unit that always turns; gyroscope and accelerometer agree."""
    rate = np.stack([0.8 * np.sin(np.arange(n) / 90), 0.7 * np.cos(np.arange(n) / 70), 0.5 * np.sin(np.arange(n) / 50)], axis=1)
    down, force = np.array([0.0, 0.0, 9.80665]), []
    for step in rate:
        force.append(down)
        down = down - np.cross(step, down) / RATE
        down *= 9.80665 / np.linalg.norm(down)
    return np.column_stack([np.arange(n) / RATE, rate, force]) + np.column_stack([np.zeros(n), 1e-3 * random.normal(size=(n, 6))])


def content(folder, rest):
    """Write files that are not logs, and logs that allow no result."""

    def change(name, spoil, header=IMU):
        rows = rest.copy()
        save(folder / name, spoil(rows), header)

    def put(column, value):
        def spoil(rows):
            rows[:, column] = value
            return rows

        return spoil

    text = {
        "notes.txt": "once upon a time\nthere was a log\n" * 20, "empty.csv": "", "header.csv": IMU + "\n",
        "one.csv": IMU + "\n0,0,0,0,0,0,9.8\n", "pointer.csv": "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 100\n",
        "wrong_name.npy": IMU + "\n0,0,0,0,0,0,9.8\n", "odd.toml": '[noise]\nterm = "N"\n',
        "report.html": "<!doctype html>\n<p>jaxcal</p>\n",
        "device.json": '{\n  "schema": "jaxcal.calibration/1"\n}\n', "noise.json": '{\n  "schema": "jaxcal.noise/1"\n}\n',
        "empty.json": "", "other.json": '{"data": [1, 2, 3]}\n', "broken.json": '{\n  "schema": "jaxcal.calibration/1",\n  "imu": 3\n}\n',
    }  # fmt: skip
    for name, words in text.items():
        (folder / name).write_text(words)
    binary = {
        "bytes.csv": bytes(range(256)) * 40, "cut.npz": b"PK\x03\x04" + bytes(40), "cut.parquet": b"PAR1" + bytes(40),
        "cut.bag": b"#ROSBAG V2.0\n", "cut.mcap": b"\x89MCAP0\r\n\x01", "picture.png": b"\x89PNG\r\n\x1a\n" + bytes(40),
    }  # fmt: skip
    for name, data in binary.items():
        (folder / name).write_bytes(data)
    change("standing.csv", put(0, 0.0))
    change("nothing.csv", put(slice(1, None), np.nan))
    change("constant.csv", put(slice(1, None), [1.0, 2.0, 3.0, 0.0, 0.0, 9.8]))
    change("huge.csv", put(1, 1e300))
    change("short.csv", lambda rows: rows[:20])
    change("nameless.csv", lambda rows: rows[:, 1:5], "a,b,c,d")
    change("odd_unit.csv", lambda rows: rows[:, :4], "time [s],gyro_x [furlong],gyro_y [furlong],gyro_z [furlong]")
    change("counts.csv", lambda rows: np.column_stack([rows[:, 0], np.round(rows[:, 1:4] * 1e4)]), "time [s],gyro_x,gyro_y,gyro_z")
    change("attitude.csv", lambda rows: rows[:, :4], "time [s],roll [deg],pitch [deg],yaw [deg]")
    change("no_time.csv", lambda rows: rows[:, 1:], IMU.partition(",")[2])
    lines = (folder / "rest.csv").read_text().splitlines()
    for i in range(10, len(lines), 20):
        lines[i] = lines[i].replace(lines[i].split(",")[2], "oops")
    (folder / "oops.csv").write_text("\n".join(lines))
    (folder / "folder").mkdir()
    (folder / "folder" / "readme.md").write_text("nothing here\n")
    (folder / "two").mkdir()
    for name in ("a.csv", "b.csv"):
        (folder / "two" / name).write_text((folder / "short.csv").read_text())


def tables(folder):
    """Write tables of turntable readings."""
    head, rows = (
        "angle [deg],mounting,dwell [s],accel [m/s^2],gyro [deg/h]",
        "0,x,60,0.1,11\n90,x,60,-0.1,1\n180,x,60,-0.1,-11\n270,x,60,0.1,-1\n",
    )
    made = {
        "table.csv": f"{head}\n{rows}", "header_only.csv": f"{head}\n", "no_angle.csv": f"{head.replace('angle [deg]', 'place')}\n{rows}",
        "no_sensor.csv": "angle [deg],mounting,dwell [s]\n0,x,60\n90,x,60\n", "bad_unit.csv": f"{head.replace('deg/h', 'furlong')}\n{rows}",
        "up.csv": f"{head}\n0,up,60,0.1,11\n", "bad_cell.csv": f"{head}\n0,x,60,0.1,11\n90,x,soon,-0.1,1\n",
        "degrees.csv": f"{head.replace('deg/h', 'rad/s')}\n{rows}",
    }  # fmt: skip
    for name, words in made.items():
        (folder / name).write_text(words)


@pytest.mark.parametrize(("call", "status", "words"), [*cases(CALLS, 2), *cases(DATA, 1)])
def test_a_wrong_call_says_what_to_type(logs, monkeypatch, capsys, call, status, words):
    monkeypatch.chdir(logs)
    before = sorted(logs.rglob("*"))
    found = main(shlex.split(call))
    out, err = capsys.readouterr()
    reason = " ".join(err.split())
    assert found == status, out + err
    assert reason.startswith("jaxcal: ")
    assert words in reason
    assert 25 < len(reason) < 700
    assert not re.search(r"(?<!--rate )\bnan\b|Traceback|Warning:|=\{|\bTrue\b|(?<!time=)\bNone\b", reason)
    assert status == 1 or (out == "" and reason.endswith("--help)"))
    assert sorted(logs.rglob("*")) == before


def test_there_are_enough_of_them():
    assert len([*cases(CALLS, 2), *cases(DATA, 1)]) >= 150
