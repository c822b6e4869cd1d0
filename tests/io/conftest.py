"""Fixtures: a recording that the tests write in every format, writers of ROS recordings, and smaller reading blocks."""

import functools
import types

import numpy as np
import pytest

from jaxcal.io._readers import _dataflash, _text

DEG, G = np.pi / 180.0, 9.80665


def recording(n=400, rate=100.0, seed=0):
    """Recording of a still sensor in SI units: rates well below 0.35 rad/s, gravity along z, the Earth's field along x and z."""
    rng = np.random.default_rng(seed)
    return types.SimpleNamespace(
        time=np.arange(n) / rate,
        gyro=rng.normal(scale=0.002, size=(n, 3)) + np.array([0.01, -0.02, 0.005]),
        accel=rng.normal(scale=0.02, size=(n, 3)) + np.array([0.1, -0.2, 9.8]),
        mag=rng.normal(scale=2e-7, size=(n, 3)) + np.array([2e-5, 1e-6, -4.2e-5]),
        temperature=25 + rng.normal(scale=0.01, size=n),
    )


@pytest.fixture
def still():
    return recording()


@pytest.fixture(scope="session")
def make():
    return recording


def _typestore(version):
    rosbags = pytest.importorskip("rosbags.typesys")
    return rosbags.get_typestore(rosbags.Stores.ROS1_NOETIC if version == 1 else rosbags.Stores.ROS2_HUMBLE)


def _messages(store, kind, stamps, values, frame, attitude, covariance):
    """Messages of one topic; `values` has columns of gyro and accel, of mag, or of temperature."""
    t = store.types
    vector = lambda v: t["geometry_msgs/msg/Vector3"](*map(float, v))  # noqa: E731
    for i, (ns, row) in enumerate(zip(stamps, values, strict=True)):
        stamp = t["builtin_interfaces/msg/Time"](int(ns) // 10**9, int(ns) % 10**9)
        name = frame(i) if callable(frame) else frame
        seq = {"seq": i} if "seq" in t["std_msgs/msg/Header"].__dataclass_fields__ else {}
        header = t["std_msgs/msg/Header"](stamp=stamp, frame_id=name, **seq)
        zeros = np.zeros(9)
        if kind == "Imu":
            marked = [zeros.copy(), zeros.copy()]
            for matrix, first in zip(marked, covariance, strict=True):
                matrix[0] = first
            attitude_message = t["geometry_msgs/msg/Quaternion"](*attitude)
            yield t["sensor_msgs/msg/Imu"](header, attitude_message, zeros, vector(row[:3]), marked[0], vector(row[3:]), marked[1])
        elif kind == "MagneticField":
            yield t["sensor_msgs/msg/MagneticField"](header, vector(row), zeros)
        elif kind == "Temperature":
            yield t["sensor_msgs/msg/Temperature"](header, float(np.ravel(row)[0]), 0.0)
        else:
            yield t["std_msgs/msg/String"]("a word")


@pytest.fixture
def write_bag(tmp_path):
    """``write_bag(storage, {topic: (kind, stamps in ns, values)})`` -> path; storage is "ros1", "sqlite3" or "mcap"."""

    def write(
        storage, topics, frame="imu", attitude=(0.0, 0.0, 0.0, 0.0), covariance=(0.0, 0.0), name="record", received=None,
        order="little", change=lambda content: content,
    ):  # fmt: skip
        store = _typestore(1 if storage == "ros1" else 2)
        if storage == "ros1":
            from rosbags.rosbag1 import Writer

            path = tmp_path / f"{name}.bag"
            writer = Writer(path)
        else:
            from rosbags.rosbag2 import StoragePlugin, Writer

            path = tmp_path / name
            writer = Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3 if storage == "sqlite3" else StoragePlugin.MCAP)
        serialize = store.serialize_ros1 if storage == "ros1" else functools.partial(store.serialize_cdr, little_endian=order == "little")
        with writer:
            for topic, (kind, stamps, values) in topics.items():
                full = f"std_msgs/msg/{kind}" if kind == "String" else f"sensor_msgs/msg/{kind}"
                connection = writer.add_connection(topic, full, typestore=store)
                times = stamps if received is None else received
                for ns, message in zip(times, _messages(store, kind, stamps, values, frame, attitude, covariance), strict=True):
                    writer.write(connection, int(ns), change(serialize(message, full)))
        return path

    return write


@pytest.fixture
def blocks_of(monkeypatch):
    """``blocks_of(length)`` makes the readers of text tables and DataFlash logs read blocks of this many bytes."""

    def short(length):
        monkeypatch.setattr(_text, "BLOCK", length)
        monkeypatch.setattr(_dataflash, "BLOCK", length)

    return short


@pytest.fixture
def put(tmp_path):
    """Write the bytes of a flight log to a file."""

    def write(log, name="log.bin"):
        path = tmp_path / name
        path.write_bytes(getattr(log, "content", log))
        return path

    return write
