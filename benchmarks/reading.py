"""Speed of the readers beside the libraries that read the same formats.

    python benchmarks/reading.py                  everything
    python benchmarks/reading.py --only csv       csv, ros, ulog, dataflash, convert
    python benchmarks/reading.py --pymavlink /path/to/python    an interpreter that has pymavlink, for comparison

Every time is the best of three, each in a separate process, with files in the page cache; the peak is that of the process.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "io")]
PARTS = ("csv", "ros", "ulog", "dataflash", "convert")

#: timed code, which runs in a separate process; `path` is the file
CODE = {
    "jaxcal": "import jaxcal.io\nstart = now()\nlog = jaxcal.read(path, quiet=True)\ncount = len(log.time)",
    "polars": (
        "import polars as pl\nstart = now()\n"
        "frame = pl.scan_csv(path).collect(engine='streaming')\ncount = frame.height"
    ),
    "rosbags": (
        "from rosbags.highlevel import AnyReader\nimport pathlib\nstart = now()\ncount = 0\n"
        "with AnyReader([pathlib.Path(path)]) as reader:\n"
        "    for connection, stamp, raw in reader.messages():\n        count += 1"
    ),
    "rosbags, decoded": (
        "from rosbags.highlevel import AnyReader\nfrom rosbags.typesys import Stores, get_typestore\nimport pathlib\nstart = now()\n"
        "count = 0\nwith AnyReader([pathlib.Path(path)], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:\n"
        "    for connection, stamp, raw in reader.messages():\n        reader.deserialize(raw, connection.msgtype)\n        count += 1"
    ),
    "pyulog": "import pyulog\nstart = now()\ncount = len(pyulog.ULog(path).get_dataset('sensor_gyro').data['x'])",
    "pymavlink": (
        "from pymavlink import DFReader\nstart = now()\nreader = DFReader.DFReader_binary(path)\ncount = 0\n"
        "while reader.recv_match(type='IMU') is not None:\n    count += 1"
    ),
}  # fmt: skip
FRAME = """
import json, sys, time
now, path = time.perf_counter, sys.argv[1]
sys.path.insert(0, sys.argv[2])
{code}
seconds = now() - start
peak = next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(json.dumps([seconds, peak / 1e6, count]))
"""


def measure(what, path, python=sys.executable, repeat=3):
    """Best time (s), peak memory (GB) and count of three runs."""
    runs = []
    for _ in range(repeat):
        done = subprocess.run(
            [python, "-c", FRAME.format(code=CODE[what]), str(path), str(ROOT)], capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise SystemExit(f"{what}: {done.stderr[-2000:]}")
        runs.append(json.loads(done.stdout.splitlines()[-1]))
    return min(runs)


def show(title, path, names, unit, python=None):
    print(f"\n{title} ({path_size(path) / 1e6:.0f} MB)")
    print(f"{'':20} {'s':>7} {'GB':>6} {'1000 ' + unit + '/s':>16} {'ratio':>6}")
    first = None
    for name in names:
        seconds, peak, count = measure(name, path, python if name == "pymavlink" and python else sys.executable)
        first = first or seconds
        print(f"{name:20} {seconds:7.2f} {peak:6.2f} {count / seconds / 1000:16.0f} {first / seconds:6.2f}")


def path_size(path):
    return path.stat().st_size if path.is_file() else sum(file.stat().st_size for file in path.iterdir())


def csv(folder):
    """Read 10^7 rows of a stamp and six channels."""
    import numpy as np
    import polars as pl

    rows, path = 10_000_000, folder / "log.csv"
    draw = np.random.default_rng(0)
    names = ["time [s]", *(f"gyro_{axis} [rad/s]" for axis in "xyz"), *(f"accel_{axis} [m/s^2]" for axis in "xyz")]
    columns = {names[0]: np.arange(rows) / 1000.0}
    for j, name in enumerate(names[1:]):
        columns[name] = np.round(draw.normal(scale=0.01, size=rows) + (9.8 if j == 5 else 0.0), 6)
    pl.DataFrame(columns).write_csv(path, float_precision=6)
    del columns
    show("CSV, 10^7 rows of 7 columns", path, ("jaxcal", "polars"), "rows")


def ros(folder):
    """Read 10^5 Imu messages in both storages."""
    import numpy as np
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = store.types
    zeros = np.zeros(9)
    vector = kinds["geometry_msgs/msg/Vector3"](0.1, 0.2, 9.8)
    attitude = kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 0.0)
    for plugin in (StoragePlugin.SQLITE3, StoragePlugin.MCAP):
        path = folder / plugin.name.lower()
        with Writer(path, version=9, storage_plugin=plugin) as writer:
            connection = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
            for i in range(100_000):
                ns = 1_700_000_000_000_000_000 + i * 5_000_000
                header = kinds["std_msgs/msg/Header"](stamp=kinds["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9), frame_id="imu")
                turn = kinds["geometry_msgs/msg/Vector3"](0.01 * (i % 7), 0.0, 0.001)
                message = kinds["sensor_msgs/msg/Imu"](header, attitude, zeros, turn, zeros, vector, zeros)
                writer.write(connection, ns, store.serialize_cdr(message, "sensor_msgs/msg/Imu"))
        show(f"ROS 2, {plugin.name}, 10^5 messages", path, ("jaxcal", "rosbags", "rosbags, decoded"), "messages")


def numbers(count):
    import numpy as np

    draw = np.random.default_rng(0)
    return (
        1_000_000 + np.arange(count) * 1000, draw.normal(scale=0.01, size=(count, 3)),
        draw.normal(scale=0.02, size=(count, 3)) + np.array([0.0, 0.0, 9.8]),
    )  # fmt: skip


def ulog(folder):
    """Read two raw topics of 5 10^5 rows each."""
    import flightlogs

    path = folder / "log.ulg"
    path.write_bytes(flightlogs.ulog_with_imu(*numbers(500_000)).content)
    show("PX4 ULog, 10^6 rows", path, ("jaxcal", "pyulog"), "samples")


def dataflash(folder, python):
    """Read 5 10^5 IMU records."""
    import flightlogs

    path = folder / "log.bin"
    path.write_bytes(flightlogs.dataflash_with_imu(*numbers(500_000)).content)
    names = ["jaxcal"]
    if python or not subprocess.run([sys.executable, "-c", "import pymavlink"], capture_output=True, check=False).returncode:
        names.append("pymavlink")
    show("ArduPilot DataFlash, 5 10^5 records", path, names, "records", python)


def convert(folder):
    """Time reading after converting once."""
    import jaxcal

    ros(folder)
    path = folder / "mcap"
    print("\nThe MCAP recording again, converted")
    for suffix in (".npz", ".parquet"):
        out = folder / f"out{suffix}"
        start = time.perf_counter()
        jaxcal.io.convert(path, out, quiet=True)
        took = time.perf_counter() - start
        seconds, _, _ = measure("jaxcal", out)
        print(f"{suffix:10} converted in {took:.2f} s, read in {seconds:.3f} s, {out.stat().st_size / 1e6:.1f} MB")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", default=",".join(PARTS))
    parser.add_argument("--pymavlink", help="interpreter that has pymavlink")
    options = parser.parse_args()
    parts = options.only.split(",")
    with tempfile.TemporaryDirectory() as name:
        for part in parts:
            folder = pathlib.Path(name, part)
            folder.mkdir()
            if part == "dataflash":
                dataflash(folder, options.pymavlink)
            elif not (part == "ros" and "convert" in parts):
                {"csv": csv, "ros": ros, "ulog": ulog, "convert": convert}[part](folder)


if __name__ == "__main__":
    main()
