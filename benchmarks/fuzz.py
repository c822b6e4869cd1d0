"""Give mutated logs to every reader: each must be read or refused with a JaxcalError, in bounded time and memory.

    python benchmarks/fuzz.py --out fuzz.txt      1,000,000 inputs; counts for every part of a reader are appended to the file
    python benchmarks/fuzz.py --inputs 20000      fewer inputs
    python benchmarks/fuzz.py --only ulog --seed 17 --each 1 --keep out     one input again, kept as a file

The name of the reader and a number determine each input. One process makes and reads the inputs, one after the other, in a folder in
memory. A hook in it notes files opened for writing, programs started, code run and pickles loaded. Another process watches it: an input
that takes more than 10 s ends it, and it starts again after that input. The peak memory of the process, and of the process in which
jaxcal reads Parquet, MATLAB and HDF5, may exceed their memory at the start by 400 MB. Exit status 1 means that something crashed; the lines
tell the number of the input.
"""

import argparse
import collections
import concurrent.futures
import contextlib
import gzip
import io
import json
import mmap
import multiprocessing
import os
import pathlib
import random
import resource
import sqlite3
import struct
import sys
import tempfile
import time
import warnings
import zipfile
import zlib

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tests" / "io")]

#: time limit for one input in s, and memory limit in bytes beyond what the process holds when it begins
LIMIT_S, LIMIT_BYTES = 10.0, 400_000_000
#: bytes of addresses beyond that, of which a process uses a part
ADDRESSES = 1 << 30
SAMPLES = 40
SUFFIX = {
    "csv": ".csv", "headers": ".csv", "lines": ".log", "records": ".json", "zip": ".zip",
    "npy": ".npy", "npz": ".npz", "parquet": ".parquet", "bag1": ".bag", "sqlite3": ".db3", "mcap": ".mcap",
    "ulog": ".ulg", "dataflash": ".bin", "mat5": ".mat", "hdf5": ".h5", "mat73": ".mat", "calibration": ".json",
    "workbook": ".xlsx", "tdms": ".tdms", "lvm": ".lvm",
}  # fmt: skip
#: thousandths of the inputs for each reader, by the cost of an input and by how much of the reader is jaxcal's own code
SHARE = {
    "csv": 25, "headers": 60, "lines": 30, "records": 80, "zip": 5, "npy": 100, "npz": 40, "parquet": 60, "bag1": 100, "sqlite3": 20,
    "mcap": 100, "ulog": 105, "dataflash": 105, "mat5": 20, "hdf5": 30, "mat73": 5, "calibration": 50,
    "workbook": 25, "tdms": 25, "lvm": 15,
}  # fmt: skip


# seeds: small valid logs


def signals():
    import numpy as np

    random_numbers = np.random.default_rng(0)
    gyro = random_numbers.normal(scale=0.01, size=(SAMPLES, 3))
    accel = random_numbers.normal(scale=0.02, size=(SAMPLES, 3)) + np.array([0.0, 0.0, 9.8])
    mag = random_numbers.normal(scale=2e-7, size=(SAMPLES, 3)) + np.array([2e-5, 0.0, -4e-5])
    return np.arange(SAMPLES) / 100.0, gyro, accel, mag


def seeds(folder):
    """Valid inputs by reader."""
    import flightlogs
    import h5py
    import layouts
    import nptdms
    import numpy as np
    import polars as pl
    import scipy.io

    import jaxcal

    t, gyro, accel, mag = signals()
    table = np.column_stack([t, gyro, accel])
    arrays = {"time": t, "gyro": gyro, "accel": accel, "mag": mag, "temperature": 25 + t}
    found = collections.defaultdict(list)

    def add(name, path):
        found[name].append(path.read_bytes())

    rows = "".join(",".join(f"{v:.6g}" for v in row) + "\n" for row in table[:30])
    found["csv"] += [
        b"time [s],gyro_x,gyro_y,gyro_z,accel_x [m/s^2],accel_y [m/s^2],accel_z [m/s^2]\n" + rows.encode(),
        rows.encode(),
        b"# made in a test\nt;gx;gy;gz\n"
        + "".join(";".join(f"{v:.4f}" for v in r[:4]) + "\n" for r in table[:30]).replace(".", ",").encode(),
        b'"date","gx","gy","gz"\n' + "".join(f'"2024-01-01T00:00:{i / 2:09.6f}",{i % 7}.5,1,2\n' for i in range(30)).encode(),
        gzip.compress(b"t,gx,gy,gz\n" + rows.encode(), mtime=0),
        ("t,gx\n" + "1,2\n" * 40).encode("utf-16"),
    ]
    # few rows, so that names and units take most of the time
    for number in range(48):
        name, content, _ = layouts.case(number)
        found["headers"].append(b"\n".join(content.split(b"\n")[: 120 if number % 12 == 0 else 24]) + b"\n")
    found["lines"] += lines_of(table)
    found["records"] += records_of(table)
    for members in ({"log.csv": rows}, {"Gyroscope.csv": "t,x,y,z\n" + rows, "Accelerometer.csv": "t,x,y,z\n" + rows}):
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in members.items():
                archive.writestr(name, content)
        found["zip"].append(packed.getvalue())
    for i, array in enumerate((table, table.astype("f4"), table[:, :4].astype(np.int16))):
        np.save(folder / f"a{i}.npy", array)
        add("npy", folder / f"a{i}.npy")
    np.save(folder / "b.npy", np.rec.fromarrays(table.T[:4], names="t,gx,gy,gz"))
    add("npy", folder / "b.npy")
    np.savez(folder / "a.npz", **arrays, rate=100.0)
    np.savez_compressed(folder / "b.npz", **arrays)
    jaxcal.io.convert(folder / "a.npz", folder / "c.npz", quiet=True)
    jaxcal.io.convert(folder / "a.npz", folder / "c.parquet", quiet=True)
    frame = pl.DataFrame({"t": t, "gx": gyro[:, 0], "gy": gyro[:, 1], "gz": gyro[:, 2], "n": np.arange(SAMPLES)})
    frame.write_parquet(folder / "a.parquet")
    frame.write_parquet(folder / "b.parquet", compression="uncompressed", statistics=False)
    for name in ("a", "b", "c"):
        add("npz", folder / f"{name}.npz")
        add("parquet", folder / f"{name}.parquet")
    for name, storage in (("bag1", None), ("sqlite3", "SQLITE3"), ("mcap", "MCAP")):
        found[name] += bags(folder, storage, gyro, accel, mag)
    stamps = 5_000_000 + np.arange(SAMPLES) * 10_000
    found["ulog"] += [flightlogs.ulog_with_imu(stamps, gyro, accel, mag * 1e4).content, ulog_combined(stamps, gyro, accel)]
    log = flightlogs.dataflash_with_imu(stamps, gyro, accel)
    found["dataflash"] += [log.content, dataflash_batches(gyro, accel)]
    for options in ({}, {"do_compression": True}, {"format": "4"}):
        scipy.io.savemat(folder / "a.mat", arrays, **options)
        add("mat5", folder / "a.mat")
    scipy.io.savemat(folder / "a.mat", {"log": {"imu": arrays, "name": "x"}, "cell": np.array([1, "a"], dtype=object)})
    add("mat5", folder / "a.mat")
    for i, options in enumerate(({}, {"compression": "gzip", "chunks": True, "shuffle": True})):
        with h5py.File(folder / f"{i}.h5", "w", libver="latest" if i else None) as file:
            for name, value in arrays.items():
                file.create_dataset(f"imu/{name}", data=value, **options)
                file[f"imu/{name}"].attrs["units"] = {"time": "s", "gyro": "rad/s"}.get(name, "")
        add("hdf5", folder / f"{i}.h5")
    with h5py.File(folder / "b.mat", "w", userblock_size=512) as file:
        for name, value in arrays.items():
            file[name] = np.atleast_2d(value.T)
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    content = bytearray((folder / "b.mat").read_bytes())
    content[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\x02IM"
    found["mat73"].append(bytes(content))
    found["calibration"] += calibrations(folder)
    rows = [["t (s)", "x (rad/s)", "y (rad/s)", "z (rad/s)"], *table[:30, :4].round(5).tolist()]
    layouts.workbook(folder / "a.xlsx", {"Gyroscope": rows, "Notes": [["version", "1.0"]]})
    layouts.workbook(folder / "b.xlsx", {"left": rows, "right": rows})
    for name in ("a", "b"):
        add("workbook", folder / f"{name}.xlsx")
    found["workbook"].append(spreadsheet(rows))
    for about in ({"unit_string": "g", "wf_increment": 0.01}, {}):
        with nptdms.TdmsWriter(folder / "a.tdms") as writer:
            channels = [nptdms.ChannelObject("imu", f"Acc{x}", accel[:, k] / 9.8, about) for k, x in enumerate("XYZ")]
            for part in (channels, [nptdms.ChannelObject("imu", "Time", t)]) if not about else (channels,):
                writer.write_segment(part)
        add("tdms", folder / "a.tdms")
    found["lvm"] += measurements(table)
    return dict(found)


def spreadsheet(rows):
    """An ODS file of one sheet."""

    def cell(v):
        kind = "string" if isinstance(v, str) else "float"
        return f'<table:table-cell office:value-type="{kind}" office:value="{v}"><text:p>{v}</text:p></table:table-cell>'

    body = "".join(f"<table:table-row>{''.join(map(cell, row))}</table:table-row>" for row in rows)
    names = " ".join(f'xmlns:{one}="urn:oasis:names:tc:opendocument:xmlns:{one}:1.0"' for one in ("office", "table", "text"))
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr("META-INF/manifest.xml", "<manifest/>")
        archive.writestr(
            "content.xml", f'<office:document-content {names}><office:body><office:spreadsheet><table:table table:name="Gyroscope">{body}'
            "</table:table></office:spreadsheet></office:body></office:document-content>",
        )  # fmt: skip
    return packed.getvalue()


def measurements(table):
    """LabVIEW measurement files, with a column of time and with a step."""
    head = "LabVIEW Measurement\nWriter_Version\t2\nSeparator\tTab\nX_Columns\t{0}\n***End_of_Header***\n"
    head += "Channels\t3\nDelta_X\t0.01\t0.01\t0.01\nY_Unit_Label\tg\tg\tg\n***End_of_Header***\nX_Value\tAccX\tAccY\tAccZ\tComment\n"
    rows = lambda timed: "".join("\t".join([f"{r[0]:.3f}" * timed, *(f"{v / 9.8:.5f}" for v in r[4:])]) + "\t\n" for r in table[:30])  # noqa: E731
    return [(head.format("One") + rows(True)).encode(), (head.format("No") + rows(False)).encode()]


def lines_of(table):
    """Logs of a terminal: a label for each number, a time and an arrow, lists, several lines a sample, sentences with checksums."""
    rows = table[:30]
    forms = (
        "ax: {4:.3f} ay: {5:.3f} az: {6:.3f} gx: {1:.3f} gy: {2:.3f} gz: {3:.3f}\n",
        "12:00:{0:06.3f} -> {1:.4f},{2:.4f},{3:.4f}\n",
        '{0:.3f},"[{1:.4f}, {2:.4f}, {3:.4f}]"\n',
        "GYRO {0:.3f} {1:.4f} {2:.4f} {3:.4f}\nACC {0:.3f} {4:.4f} {5:.4f} {6:.4f}\n",
        "$VNIMU,{0:.4f},{1:.4f},{2:.4f},{3:.4f},{4:.4f},{5:.4f},{6:.4f}*5F\n",
        "[INFO] t={0:.3f}s a=({4:.3f} g, {5:.3f} g, {6:.3f} g)\n",
    )
    return [("".join(form.format(*row) for row in rows)).encode() for form in forms]


def records_of(table):
    """JSON: records, one in each line, arrays by name, rows, and records inside others."""
    names = ("time", "gx", "gy", "gz", "ax", "ay", "az")
    records = [dict(zip(names, row, strict=True)) for row in table[:30].round(4).tolist()]
    nested = [{"t": one["time"], "gyro": [one["gx"], one["gy"], one["gz"]], "device": {"name": "a", "temperature": 20}} for one in records]
    arrays = {"time": table[:30, 0].tolist(), "gyro": table[:30, 1:4].tolist()}
    whole = (
        records,
        nested,
        arrays,
        table[:30].tolist(),
        {"poses": [{"heading": 90, "samples": nested}, {"heading": 0, "samples": nested}]},
    )
    return [json.dumps(one).encode() for one in whole] + ["".join(json.dumps(one) + "\n" for one in records).encode()]


def bags(folder, storage, gyro, accel, mag):
    import numpy as np
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if storage is None else Stores.ROS2_HUMBLE)
    kinds = store.types
    vector = lambda v: kinds["geometry_msgs/msg/Vector3"](*map(float, v))  # noqa: E731
    zeros = np.zeros(9)
    if storage is None:
        from rosbags.rosbag1 import Writer

        path, options = folder / "a.bag", {}
    else:
        from rosbags.rosbag2 import StoragePlugin, Writer

        path, options = folder / storage.lower(), {"version": 9, "storage_plugin": StoragePlugin[storage]}
    with Writer(path, **options) as writer:
        imu = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        field = writer.add_connection("/mag", "sensor_msgs/msg/MagneticField", typestore=store)
        for i in range(SAMPLES):
            ns = 1_700_000_000_000_000_000 + i * 10_000_000
            stamp = kinds["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9)
            extra = {"seq": i} if storage is None else {}
            header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="imu", **extra)
            message = kinds["sensor_msgs/msg/Imu"](
                header, kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0), zeros, vector(gyro[i]), zeros, vector(accel[i]), zeros
            )
            serialize = store.serialize_ros1 if storage is None else store.serialize_cdr
            writer.write(imu, ns, serialize(message, "sensor_msgs/msg/Imu"))
            if i % 10 == 0:
                message = kinds["sensor_msgs/msg/MagneticField"](header, vector(mag[i]), zeros)
                writer.write(field, ns, serialize(message, "sensor_msgs/msg/MagneticField"))
    if storage is None:
        return [path.read_bytes()]
    return [next(file for file in path.iterdir() if file.suffix in (".db3", ".mcap")).read_bytes()]


def ulog_combined(stamps, gyro, accel):
    import flightlogs as f
    import numpy as np

    fields = ["uint64_t timestamp", "float[3] gyro_rad", "int32_t accelerometer_timestamp_relative", "float[3] accelerometer_m_s2",
              "uint8_t accel_calibration_count", "uint8_t[3] _padding0"]  # fmt: skip
    log = f.ULogWriter()
    log.format("sensor_combined", fields)
    log.parameter("CAL_ACC0_ID", 5)
    log.subscribe("sensor_combined")
    rows = np.zeros(len(stamps), f.dtype_of(fields))
    rows["timestamp"], rows["gyro_rad"], rows["accelerometer_m_s2"] = stamps, gyro, accel
    log.data("sensor_combined", 0, rows[:40], 3)
    log.dropout(20)
    log.sync()
    log.data("sensor_combined", 0, rows[40:], 3)
    return log.content


def dataflash_batches(gyro, accel):
    import flightlogs as f
    import numpy as np

    f.DATAFLASH_CODES["a"] = "64s"
    log = f.DataFlashWriter()
    log.describe(30, "ISBH", "QHBBHHQf", "TimeUS,N,type,instance,mul,smp_cnt,SampleUS,smp_rate")
    log.describe(31, "ISBD", "QHHaaa", "TimeUS,N,seqno,x,y,z")
    log.describe(40, "MAG", "QBccc", "TimeUS,I,MagX,MagY,MagZ")
    log.describe(50, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
    log.describe(51, "UNIT", "QbZ", "TimeUS,Id,Label")
    log.describe(52, "MULT", "Qbd", "TimeUS,Id,Mult")
    log.describe(64, "PARM", "QNf", "TimeUS,Name,Value")
    log.write("UNIT", 0, ord("G"), "Gauss")
    log.write("MULT", 0, ord("C"), 1e-3)
    log.write("FMTU", 0, 40, "s#GGG", "F-CCC")
    log.write("PARM", 0, "COMPASS_DIA_X", 1.0)
    for n, values in enumerate((gyro * 1e4, accel * 100, gyro * 1e4)):
        start = 1_000_000 + n * 64_000
        log.write("ISBH", start, n, (n + 1) % 2, 0, 100, 64, start, 1000.0)
        for k in range(2):
            log.write("ISBD", start, n, k, *(column.astype("<i2").tobytes() for column in values[32 * k : 32 * k + 32].T))
        log.write("MAG", start, 0, 200, -300, 400)
    assert np.isfinite(gyro).all()
    return log.content


def calibrations(folder):
    """JSON files: the golden file of the exports, and a fit of noise."""
    import made_fit

    import jaxcal

    jaxcal.Calibration(noise={"gyro_x": made_fit.made_fit(), "accel_z": made_fit.made_fit(2.0)}).save(folder / "a.json")
    return [(ROOT / "tests" / "export" / "golden.json").read_bytes(), (folder / "a.json").read_bytes()]


# mutations

ODD = [
    0, 1, 2, 3, 7, 8, 0x7F, 0x80, 0xFF, 0x100, 0x7FFF, 0x8000, 0xFFFF, 0x10000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 40,
    (1 << 63) - 1, 1 << 63, (1 << 64) - 1,
]  # fmt: skip
WORDS = [
    "nan", "inf", "-inf", "1e400", "-1e-400", "", " ", "0x10", "1e5", "9" * 30, "1_000", "\u00e9", "\u22121", "null", "None",
    "2024-01-01", "\0", '"', "'", ",", ";", "\t", "\r", "#", "//", "\ufeff", "-9223372036854775808", "18446744073709551616",
    "1.7976931348623157e308", "9" * 20_000, " " * 2000, "-" * 3000, "1e" * 2000, "(" * 2000, "x: " * 2000, "[/x]", "\x1b[31m", "\u202e",
]  # fmt: skip


def bytewise(draw, content, others):
    """Change bytes in one to eight places, anywhere or near one place."""
    content = bytearray(content)
    near = draw.randrange(len(content) + 1) if draw.random() < 0.3 else None
    for _ in range(draw.choice([1, 1, 1, 2, 3, 5, 8])):
        if not content:
            break
        at = draw.randrange(len(content)) if near is None else min(len(content) - 1, max(0, near + draw.randrange(-64, 64)))
        if draw.random() < 0.25:
            at = min(at, draw.randrange(1, 257)) if draw.random() < 0.5 else max(at, len(content) - draw.randrange(1, 257))
            at = min(max(at, 0), len(content) - 1)
        kind = draw.randrange(10)
        length = draw.choice([1, 2, 4, 8, 16, 64, 300])
        if kind == 0:
            content[at] ^= 1 << draw.randrange(8)
        elif kind == 1:
            content[at] = draw.randrange(256)
        elif kind in (2, 3):
            width, order = draw.choice([(1, "B"), (2, "H"), (4, "I"), (8, "Q")])
            word = struct.pack(draw.choice("<>") + order, draw.choice(ODD) & ((1 << 8 * width) - 1))
            content[at : at + width] = word
        elif kind == 4:
            del content[at : at + length]
        elif kind == 5:
            content[at:at] = content[at : at + length] * draw.choice([1, 1, 2, 20])
        elif kind == 6:
            content[at:at] = draw.randbytes(length)
        elif kind == 7:
            content[at : at + length] = bytes([draw.choice([0, 0xFF, 0x20, 0x41])]) * min(length, len(content) - at)
        elif kind == 8:
            other = draw.choice(others)
            start = draw.randrange(len(other))
            content[at : at + length] = other[start : start + length]
        elif draw.random() < 0.5:
            del content[at:]
        else:
            length = draw.randrange(1, 9)
            step = draw.choice([-1, 1, 255])
            content[at : at + length] = bytes((byte + step) & 255 for byte in content[at : at + length])
    return bytes(content)


def textwise(draw, content, others):
    """Change fields and lines of a text."""
    encoding = "utf-16" if content.startswith((b"\xff\xfe", b"\xfe\xff")) else "latin-1"
    lines = content.decode(encoding).splitlines(keepends=True)
    for _ in range(draw.choice([1, 2, 4])):
        at = draw.randrange(len(lines))
        kind = draw.randrange(8)
        mark = next((mark for mark in ";\t," if mark in lines[at]), " ")
        fields = lines[at].rstrip("\n").split(mark)
        if kind <= 2:
            fields[draw.randrange(len(fields))] = draw.choice(WORDS)
            lines[at] = mark.join(fields) + "\n"
        elif kind == 3:
            del fields[draw.randrange(len(fields)) :]
            lines[at] = mark.join(fields) + "\n"
        elif kind == 4:
            lines[at:at] = [draw.choice(lines)] * draw.choice([1, 2, 60])
        elif kind == 5:
            lines = lines[: at + 1] if draw.random() < 0.5 else lines[at:]
        elif kind == 6:
            old, new = mark, draw.choice([",", ";", "\t", " ", "  ", ", "])
            lines = [line.replace(old, new) for line in lines]
        else:
            column, word = draw.randrange(len(fields)), draw.choice(WORDS)
            lines = [mark.join([*line.split(mark)[:column], word, *line.split(mark)[column + 1 :]]) for line in lines]
    return "".join(lines).encode(encoding if encoding == "utf-16" else "utf-8", errors="replace")


HEADS = [
    "", "Unnamed: 0", "time", "t", "timestamp", "Time (s)", "time_ms",
    "TimeUS", "SampleTimeFine", "sec", "nsec", "date", "Uhrzeit", "counter",
    "gx", "gyro_x", "GyroR", "p", "q", "r", "wx", "Drehrate x", "rate", "ax", "ax1", "ax2", "acc_x", "FreeAcc_X", "linear_acceleration.x",
    "Beschleunigung x", "gravity_x", "gFx", "mx", "mag_x", "magnetic field", "temp", "T(\u00b0C)", "x", "y", "z", "X (rad/s)", "Y (uT)",
    "roll", "quat_w", "gyroADC[0]", "accSmooth[1]", "seconds_elapsed", "packetcounter", "timestartup", "x accel [x8004]", "(", "[", "[]",
    "[0]", "()()", "x" * 5000, "x_" * 2000, "1" * 400, "\u00b5T", "\u0660", "a" + "\u0301" * 50,
]  # fmt: skip
UNITS = [
    "[deg/s]", "(rad/s)", "_dps", "_g", " [m/s^2]", "(mg)", "[uT]",
    "[T]", "_G", "[ms]", "(s)", "[ns]", "[LSB]", "[]", "(((", "[1e9 g]", "[nan]",
    "[-]", " (\u00b0/s)", "[K]",
]  # fmt: skip
ABOVE = [
    "sep=,",
    "# Update Rate: 100 Hz",
    "fs = 1e9",
    "rate: 0",
    "Sampling rate: nan Hz",
    "acc_1G,2048",
    "acc_1G,0",
    "OutputRate:,60Hz",
    "%",
    "//",
]


def headerwise(draw, content, others):
    """Change names, units, columns and their order, and the lines above the table."""
    lines = content.decode().split("\n")
    at = next((i for i, line in enumerate(lines[:6]) if any(mark in line for mark in ",;\t") and "#" not in line[:1]), 0)
    mark = max(",;\t", key=lines[at].count)
    rows = [line.split(mark) for line in lines]
    width = len(rows[at])
    for _ in range(draw.choice([1, 1, 2, 4, 8])):
        kind, column = draw.randrange(9), draw.randrange(width)
        if kind <= 1:
            rows[at][column] = draw.choice(HEADS)
        elif kind == 2:
            rows[at][column] += draw.choice(UNITS)
        elif kind == 3:
            rows[at][column] = draw.choice(HEADS) + draw.choice(UNITS)
        elif kind == 4:
            other = draw.randrange(width)
            rows[at][column], rows[at][other] = rows[at][other], rows[at][column]
        elif kind == 5 and width > 1:
            rows = [row[:column] + row[column + 1 :] if len(row) == width else row for row in rows]
            width -= 1
        elif kind == 6:
            factor = draw.choice([0.0, 1e-3, 9.80665, 57.29578, 131.0, 16384.0, 1e6, 1e300])
            for row in rows[at + 1 :]:
                with contextlib.suppress(ValueError, IndexError):
                    row[column] = f"{float(row[column]) * factor:.6g}"
        elif kind == 7:
            for i, row in enumerate(rows[at + 1 :]):
                if len(row) == width:
                    row[column] = draw.choice(["", str(i), "0", str(i % 256), f"{i}e3", "12:00:00", "2024-01-01", "nan"])
        else:
            rows.insert(0, [draw.choice(ABOVE)])
            at += 1
    return "\n".join(mark.join(row) for row in rows).encode()


def zipped(draw, content, others):
    """Change members of an .npz, and build a valid archive again."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = draw.choice(list(members))
    members[name] = bytewise(draw, members[name], others)
    if draw.random() < 0.2:
        members[draw.choice(["../out.npy", "/tmp/out.npy", "gyro", "x" * 300, "rate.npy"])] = members[name]
    out = io.BytesIO()
    with (
        warnings.catch_warnings(),
        zipfile.ZipFile(out, "w", draw.choice([zipfile.ZIP_STORED] * 5 + [zipfile.ZIP_DEFLATED] * 4 + [zipfile.ZIP_BZIP2])) as archive,
    ):
        warnings.simplefilter("ignore")
        for name, member in members.items():
            archive.writestr(name, member)
    return out.getvalue()


def unpacked_mat(draw, content, others):
    """Change the contents of one packed variable of a MATLAB file, and pack it again."""
    at, places = 128, []
    while at + 8 <= len(content):
        kind, length = struct.unpack_from("<II", content, at)
        places.append((at, kind, length))
        at += 8 + length
    packed = [place for place in places if place[1] == 15]
    if not packed:
        return bytewise(draw, content, others)
    at, _, length = draw.choice(packed)
    inside = zlib.compress(bytewise(draw, zlib.decompress(content[at + 8 : at + 8 + length]), others))
    return content[:at] + struct.pack("<II", 15, len(inside)) + inside + content[at + 8 + length :]


def in_database(draw, content, others):
    """Change messages and tables of an sqlite3 recording."""
    database = sqlite3.connect(":memory:")
    database.deserialize(content)
    ids = [row[0] for row in database.execute("select id from messages")]
    for _ in range(draw.choice([1, 2, 5])):
        kind = draw.randrange(5)
        which = draw.choice(ids)
        if kind <= 1:
            row = database.execute("select data from messages where id = ?", (which,)).fetchone()
            if row and isinstance(row[0], bytes) and row[0]:
                database.execute("update messages set data = ? where id = ?", (bytewise(draw, row[0], others), which))
        elif kind == 2:
            odd = draw.choice([None, "text", -1, 2**62, 1.5, b"\0"])
            column = draw.choice(["timestamp", "topic_id", "data"])
            with contextlib.suppress(sqlite3.IntegrityError):
                database.execute(f"update messages set {column} = ? where id = ?", (odd, which))
        elif kind == 3:
            column = draw.choice(["name", "type", "serialization_format", "offered_qos_profiles"])
            word = draw.choice([*WORDS, "sensor_msgs/msg/Imu", "- history: [", "&a [*a]"])
            with contextlib.suppress(sqlite3.Error):
                database.execute(f"update topics set {column} = ?", (word,))
        else:
            database.execute("delete from messages where id >= ?", (which,))
    database.commit()
    return database.serialize()


def in_json(draw, content, others):
    """Replace values of a JSON file by values of any type, and rename or drop keys."""
    document = {"": json.loads(content)}
    for _ in range(draw.choice([1, 1, 2, 4])):
        places = [(document, key) for key in document]
        for holder, key in places:
            inner = holder[key]
            if isinstance(inner, dict):
                places += [(inner, name) for name in inner]
            elif isinstance(inner, list):
                places += [(inner, i) for i in range(len(inner))]
        if not places:
            return content
        holder, key = draw.choice(places)
        kind = draw.randrange(5)
        if kind <= 2:
            holder[key] = draw.choice(
                [None, True, -1, 0, 1e308, "x", "", [], {}, [[]], [None] * 3, {"a": 1}, "1e400", float("nan"), float("inf"), 2**70]
            )
        elif kind == 3:
            del holder[key]
        elif isinstance(holder, dict):
            holder[draw.choice(["x", "__class__", "type", key + "_"])] = holder.pop(key)
        else:
            holder.insert(key, holder[key])
    text = json.dumps(document.get(""))
    if draw.random() < 0.02:
        text = "[" * 100_000 + text
    return text.encode()


def mutate(reader, number, found):
    """The input with this number."""
    draw = random.Random(f"{reader} {number}")
    content = draw.choice(found[reader])
    others = found[reader]
    if draw.random() < 0.03:
        return content[: draw.choice([4, 8, 16, 40])] + draw.randbytes(draw.randrange(400))
    own = draw.random() < 0.5
    if reader == "csv":
        if content.startswith(b"\x1f\x8b"):
            return gzip.compress(bytewise(draw, gzip.decompress(content), others), 1, mtime=0) if own else bytewise(draw, content, others)
        return textwise(draw, content, others) if own else bytewise(draw, content, others)
    if reader == "headers":
        content = headerwise(draw, content, others)
        return textwise(draw, content, others) if draw.random() < 0.1 else content
    if reader in ("lines", "lvm") or (reader == "records" and content.count(b"\n") > 1):
        return textwise(draw, content, others) if own else bytewise(draw, content, others)
    special = {
        "records": in_json,
        "npz": zipped,
        "zip": zipped,
        "workbook": zipped,
        "mat5": unpacked_mat,
        "sqlite3": in_database,
        "calibration": in_json,
    }.get(reader)
    return special(draw, content, others) if special and own else bytewise(draw, content, others)


# the reading process


class Inline(concurrent.futures.Executor):
    """Runs a task at once: waiting for a thread takes longer than reading a small file."""

    def __init__(self, *_, **__):
        pass

    def submit(self, task, /, *given, **options):
        done = concurrent.futures.Future()
        try:
            done.set_result(task(*given, **options))
        except BaseException as error:
            done.set_exception(error)
        return done


#: what the process reports while it works: number of the part, and of the input in it
STATE = struct.Struct("<qq")


def worker(folder, parts, first, state, out):
    """Read all inputs of the `parts`, (reader, seed, number), starting at input `first` of the first part; write a line for each part."""
    import jaxcal
    from jaxcal.io._readers import _csv
    from jaxcal.io._readers._sandbox import sandbox

    with open(state, "r+b") as file:
        told = mmap.mmap(file.fileno(), STATE.size)
    found = seeds(pathlib.Path(tempfile.mkdtemp(dir=folder)))
    concurrent.futures.ThreadPoolExecutor = _csv.ThreadPoolExecutor = Inline
    place = pathlib.Path(folder, "in")
    place.mkdir()
    os.chdir(place)
    for reader, contents in found.items():
        for content in contents:
            take(jaxcal, reader, content, place)
    seen = watch(place)
    warnings.simplefilter("error")  # no warning of a library may reach a user
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    own = resource.getpagesize() * int(pathlib.Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (own + ADDRESSES, own + ADDRESSES))
    begun = held()
    aside = held(sandbox._process.pid)
    for part, (reader, seed, number) in enumerate(parts):
        tally, longest, start = collections.Counter(), 0.0, time.process_time()
        for i in range(first if part == 0 else 0, number):
            before = time.perf_counter()
            STATE.pack_into(told, 0, part, i + 1)
            content = mutate(reader, seed + i, found)
            seen.clear()
            outcome = take(jaxcal, reader, content, place)
            if seen:
                outcome = f"crash did {seen[0]}"
            longest = max(longest, time.perf_counter() - before)
            tally[outcome.split(" ")[0]] += 1
            if outcome.startswith("crash"):
                out.write(f"  {reader} --seed {seed + i}: {outcome}\n".replace("\0", "?"))
        used = time.process_time() - start
        more = [held() - begun, held(sandbox._process.pid) - aside if sandbox._process is not None else 0]
        out.write(line(reader, seed, tally, 1000 * used / max(sum(tally.values()), 1), longest, more))
        if max(more) > LIMIT_BYTES:
            out.write(f"  {reader} --seed {seed}: crash more than {LIMIT_BYTES} bytes in this part or before\n")
        out.flush()


def held(process="self"):
    """Peak memory of a process in bytes."""
    try:
        text = pathlib.Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0
    return 1024 * next((int(one.split()[1]) for one in text.splitlines() if one.startswith("VmHWM")), 0)


def line(reader, seed, tally, each, longest, more):
    words = [f"{tally[name]:8}" for name in ("read", "refused", "memory", "crash")]
    memory = f"{more[0] / 1e6:7.0f} {more[1] / 1e6:8.0f}"
    return f"{reader:12} {seed:9} {sum(tally.values()):8} {' '.join(words)} {each:8.2f} {longest:8.2f} {memory}\n"


HEAD = (
    f"{'reader':12} {'from':>9} {'inputs':>8} {'read':>8} {'refused':>8} {'memory':>8} {'crash':>8} {'ms cpu':>8} {'most s':>8} "
    f"{'MB':>7} {'MB aside':>7}\n"
)  # fmt: skip


def take(jaxcal, reader, content, place):
    """Outcome of one input: read, refused, or crash with the reason."""
    path = place / f"log{SUFFIX[reader]}"
    path.write_bytes(content)
    try:
        if reader == "calibration":
            jaxcal.Calibration.load(path)
        else:
            log = jaxcal.read(path, quiet=True)
            if not (len(log.time) >= 2 and 0 < log.rate < float("inf")):
                return f"crash a log of {len(log.time)} samples at {log.rate} Hz"
        outcome = "read"
    except jaxcal.JaxcalError as error:
        outcome = "refused" if str(error).startswith(path.name) or reader == "calibration" else f"crash message {str(error)[:200]}"
        if isinstance(error.__cause__, MemoryError):
            outcome = "memory"  # refused too, but only after all available memory was requested
    except Exception as error:
        outcome = f"crash {type(error).__name__}: {str(error)[:200]} {origin(error)}"
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt | SystemExit):
            raise
        outcome = f"crash {type(error).__name__}: {str(error)[:200]} {origin(error)}"
    left = set(os.listdir(place)) - {path.name}
    path.unlink()
    return f"crash left {sorted(left)}" if left else outcome


def origin(error):
    frame, at = error.__traceback__, ""
    while frame is not None:
        name = frame.tb_frame.f_code.co_filename
        if "/jaxcal/" in name:
            at = f"({pathlib.Path(name).parent.name}/{pathlib.Path(name).name}:{frame.tb_lineno})"
        frame = frame.tb_next
    return at


FORBIDDEN = ("pickle.find_class", "os.system", "subprocess.Popen", "os.exec", "os.posix_spawn", "socket.connect", "os.remove", "os.rename")


def watch(place):
    """Note anything that no reader may do."""
    seen = []

    def hook(event, arguments):
        if event == "subprocess.Popen" and str(arguments[1][-1]).endswith("/jaxcal/io/_readers/_sandbox.py"):
            return  # jaxcal's own reading process
        if event == "os.remove" and arguments[1] != -1:
            return  # inside the folder in which a zip file was unpacked
        if event in FORBIDDEN and not (event == "os.remove" and pathlib.Path(arguments[0]).parent == place):
            seen.append(event)
        elif event == "exec" and arguments[0].co_filename == "<string>":
            seen.append("exec")
        elif event == "open" and isinstance(arguments[1], str) and set(arguments[1]) & set("wax+"):
            path = os.path.abspath(arguments[0]) if isinstance(arguments[0], str | bytes | os.PathLike) else str(place)
            # the standard error of the reading process goes to a file without a name
            own = (str(place), os.path.join(tempfile.gettempdir(), ".jaxcal-"))  # here zip files are unpacked
            if not str(path).startswith(own) and path != tempfile.gettempdir():
                seen.append(f"open {path}")

    sys.addaudithook(hook)
    return seen


# the watching process


def watched(parts, out):
    """Have all parts read, whatever an input does to the process; lines are written to the file `out`."""
    # in memory, because a busy disk is not the fault of a reader
    room = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    part = first = 0
    with tempfile.TemporaryDirectory(dir=room, ignore_cleanup_errors=True) as folder, tempfile.NamedTemporaryFile(dir=room) as state:
        state.write(bytes(STATE.size))
        state.flush()
        begins = 0
        while part < len(parts):
            begins += 1
            own = pathlib.Path(folder, str(begins))
            own.mkdir()
            process = multiprocessing.get_context("spawn").Process(target=begin, args=(str(own), parts[part:], first, state.name, str(out)))
            process.start()
            before, looks, late = b"", 0.0, False
            while process.is_alive() and not late:
                # count checks instead of time, because time goes on while the machine is suspended
                process.join(1.0)
                now = pathlib.Path(state.name).read_bytes()
                looks = looks + 1.0 if now == before else 0.0
                # the start takes a while
                late, before = looks > (LIMIT_S if any(now) else 300.0), now
            if late:
                process.kill()
            process.join()
            if process.exitcode == 0:
                return
            at, i = STATE.unpack(before)
            reader, seed, _ = parts[part + at]
            why = f"no answer in {LIMIT_S:g} s" if late else f"status {process.exitcode}"
            with open(out, "a") as file:
                file.write(f"  {reader} --seed {seed + i - 1}: crash {why}\n")
            if begins > 100:
                raise SystemExit("the process ends again and again")
            part, first = part + at, i
            state.seek(0)
            state.write(bytes(STATE.size))
            state.flush()


def begin(folder, parts, first, state, out):
    os.environ |= {"JAX_PLATFORMS": "cpu", "POLARS_MAX_THREADS": "1", "OMP_NUM_THREADS": "1", "RUST_BACKTRACE": "0"}
    with open(out, "a", buffering=1) as file:
        worker(folder, parts, first, state, file)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=1_000_000)
    parser.add_argument("--each", type=int)
    parser.add_argument("--only", default=",".join(SHARE))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=pathlib.Path, help="file to which the lines are appended; by default they are printed at the end")
    parser.add_argument("--keep", type=pathlib.Path, help="folder for the inputs that crash, or for all of --each 1")
    options = parser.parse_args()
    names = options.only.split(",")
    total = sum(SHARE[name] for name in names)
    counts = {name: options.each or round(options.inputs * SHARE[name] / total) for name in names}
    rounds = max(1, min(50, sum(counts.values()) // 20_000))
    # every reader takes part in every round, so that an interrupted run has tested all of them
    parts = []
    for k in range(rounds):
        for name, count in counts.items():
            start, stop = count * k // rounds, count * (k + 1) // rounds
            if stop > start:
                parts.append((name, options.seed + start, stop - start))
    out = options.out or pathlib.Path(tempfile.mkstemp(suffix=".txt")[1])
    with out.open("a") as file:
        file.write(HEAD)
    began = time.perf_counter()
    watched(parts, out)
    text = out.read_text()
    crashes = [one.split() for one in text.splitlines() if one.startswith("  ")]
    last = f"{sum(counts.values())} inputs, {len(crashes)} crashes, {time.perf_counter() - began:.0f} s"
    with out.open("a") as file:
        file.write(last + "\n")
    print(last if options.out else text + last)
    if options.keep and (crashes or options.each == 1):
        with tempfile.TemporaryDirectory() as folder:
            found = seeds(pathlib.Path(folder))
        options.keep.mkdir(parents=True, exist_ok=True)
        for name, number in {(words[0], int(words[2].rstrip(":"))) for words in crashes} or {(names[0], options.seed)}:
            (options.keep / f"{name}-{number}{SUFFIX[name]}").write_bytes(mutate(name, number, found))
    return 1 if crashes else 0


if __name__ == "__main__":
    sys.exit(main())
