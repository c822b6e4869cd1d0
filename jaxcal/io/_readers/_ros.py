"""Read ROS 1 and ROS 2 recordings with rosbags.

The three message types have had the same layout since ROS 1, so jaxcal decodes the raw bytes as arrays, about five times faster than
message by message. It ignores the type definitions stored in a bag, which rosbags would turn into Python code.
"""

import contextlib
import dataclasses
import io
import itertools
import pathlib
import sqlite3
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..._answer import Finding
from ..._errors import DataError
from ..._message import Message
from ..._units import si_unit
from .._columns import wrong
from .._findings import READ
from .._table import Signals
from ._bounds import PIECE, require
from ._streams import Part, SeveralError, join

#: message type -> number of float64 after the header
_TYPES = {"sensor_msgs/msg/Imu": 37, "sensor_msgs/msg/MagneticField": 12, "sensor_msgs/msg/Temperature": 2}
#: positions in an Imu message: of the vectors, and of the first element of their covariances, which is -1 without a measurement
_IMU = {"gyro": (slice(13, 16), 16), "accel": (slice(25, 28), 28)}
_ODD = "the recording is damaged, or the type is not ROS's own: convert it to CSV"


@dataclasses.dataclass
class Stream:
    """One topic: time stamps in ns and the float64 numbers of every message."""

    topic: str
    kind: str
    stamps: np.ndarray
    values: np.ndarray


def read_ros(paths: list[pathlib.Path], version: int, topics: list[str] | None, units: dict[str, str]) -> Signals:
    """Read time stamps and sensors of the inertial, magnetic and temperature topics of a recording; `paths` are its parts in order."""
    signals = Signals(None, {})
    with contextlib.ExitStack() as stack:
        readers = [stack.enter_context(_open(path, version)) for path in paths]
        found = [c for reader in readers for c in reader.connections if c.msgtype in _TYPES]
        duration = max((max(r.end_time for r in readers) - min(r.start_time for r in readers)) * 1e-9, 1e-9)
        listed = []
        for topic in dict.fromkeys(c.topic for c in found):
            kinds = ", ".join(sorted({c.msgtype.split("/")[-1] for c in found if c.topic == topic}))
            count = sum(reader.topics[topic].msgcount for reader in readers if topic in reader.topics)
            listed.append(f"{topic} ({kinds}, {count} messages, {(count - 1) / duration:.4g} Hz)")
        present = "; ".join(listed)
        if not found:
            others = ", ".join(sorted({f"{c.topic} ({c.msgtype})" for r in readers for c in r.connections})) or "none"
            echo = "rostopic echo -b LOG -p TOPIC > log.csv" if version == 1 else "ros2 topic echo --csv TOPIC > log.csv"
            said = f"no topic of type sensor_msgs Imu, MagneticField or Temperature; write one of another type as text, `{echo}`"
            raise DataError(f"{said}; the topics are: {others}", code="no_sensor")
        signals.sources = listed
        chosen = _choose(found, topics, present, signals.findings)
        streams = [_stream(readers, topic, version, signals.findings) for topic in chosen]
    if len(paths) > 1:
        signals.findings.append(READ("joined", count=len(paths), which=f"{paths[0].name} to {paths[-1].name}"))
    streams = [stream for stream in streams if len(stream.stamps)]
    if not streams:
        raise DataError(f"there are no messages on {', '.join(chosen)}; the topics are: {present}", code="no_rows")
    join(_parts(streams, units, signals), units, signals)
    signals.columns = {"topics": chosen}
    return signals


@contextlib.contextmanager
def _open(path: pathlib.Path, version: int) -> Iterator[Any]:
    require("rosbags", "reading ROS recordings", "ros")
    from rosbags import rosbag1, rosbag2

    _check_database(path)
    try:
        with (rosbag1 if version == 1 else rosbag2).Reader(_BoundedPath(path)) as reader:
            yield reader
    except (rosbag1.ReaderError, rosbag2.ReaderError) as error:
        mend = "rosbag reindex" if version == 1 else "ros2 bag reindex"
        raise DataError(f"damaged, or cut off ({error}): run `{mend}` on a copy, or copy it again", code="damaged") from error


class _BoundedFile(io.BufferedReader):
    """A file that reads no more bytes than it has left, even if a damaged record requests more."""

    def __init__(self, path: pathlib.Path):
        super().__init__(io.FileIO(path))
        self._length = path.stat().st_size

    def read(self, size: int | None = -1, /) -> bytes:
        return super().read() if size is None or size < 0 else super().read(min(size, max(0, self._length - self.tell())))


class _BoundedPath(type(pathlib.Path())):
    """A path that opens its file as a `_BoundedFile` for reading bytes."""

    def open(self, mode: str = "r", *args: Any, **options: Any) -> Any:
        return _BoundedFile(self) if mode == "rb" else super().open(mode, *args, **options)


def _check_database(path: pathlib.Path) -> None:
    """Refuse views instead of tables in a database, because a view is a program that may never end."""
    for file in [path] if path.suffix == ".db3" else path.glob("*.db3") if path.is_dir() else []:
        with contextlib.closing(sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
            odd = database.execute("select name from sqlite_master where type not in ('table', 'index') limit 1").fetchone()
        if odd:
            raise DataError(f"the database holds {odd[0]!r}, which is no table; it is no ROS 2 recording, or was changed", code="damaged")


def _choose(found: list[Any], topics: list[str] | None, present: str, findings: list[Finding]) -> list[str]:
    """Topics to read: those in `topics`, or the only topic (or only raw topic) of each type."""
    if topics is not None:
        unknown = [topic for topic in topics if topic not in {c.topic for c in found}]
        if unknown:
            raise wrong("topics", f"{', '.join(unknown)} not among {present}")
        return list(dict.fromkeys(topics))
    chosen = []
    for kind in _TYPES:
        names = sorted({c.topic for c in found if c.msgtype == kind})
        raw = [name for name in names if "raw" in name.lower()] if len(names) > 1 else names
        if len(raw) != min(len(names), 1):
            said = "several topics of type {kind}: name those to read with {option.topics}: {present}"
            raise SeveralError(Message(said, kind=kind.split("/")[-1], present=present), _imus(found))
        chosen += raw
        if len(names) > 1:
            findings.append(READ("topics", chosen=raw[0], others=", ".join(name for name in names if name != raw[0])))
    return chosen


def _imus(found: list[Any]) -> list[str]:
    """The topics of each IMU: a topic of type Imu, and other topics with the same parent in the tree of names."""
    of = {c.topic: c.msgtype for c in found}
    first = [topic for topic, kind in sorted(of.items()) if kind == next(iter(_TYPES))]
    parents = [topic.rpartition("/")[0] for topic in first]
    return [
        ",".join([topic, *(other for other in sorted(of) if other not in first and other.rpartition("/")[0] == parent and parent)])
        if parents.count(parent) == 1 else topic
        for topic, parent in zip(first, parents, strict=True)
    ]  # fmt: skip


def _stream(readers: list[Any], topic: str, version: int, findings: list[Finding]) -> Stream:
    """Decode all messages of one topic, some thousand at a time."""
    connections = [[c for c in reader.connections if c.topic == topic and c.msgtype in _TYPES] for reader in readers]
    kind = next(c.msgtype for found in connections for c in found)
    numbers = _TYPES[kind]
    received, headers, values = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros((0, numbers))]
    for reader, own in zip(readers, connections, strict=True):
        messages: Iterator[Any] = iter(reader.messages(connections=own) if own else ())
        while True:
            stamps, raws = [], []
            for _, stamp, raw in itertools.islice(messages, PIECE):  # keeping thousands of tuples would trigger the garbage collector
                stamps.append(stamp)
                raws.append(raw)
            if not raws:
                break
            received.append(np.array(stamps, np.int64))
            header, block = _decode(raws, numbers, version, topic)
            headers.append(header)
            values.append(block)
    header, block = np.concatenate(headers), np.concatenate(values)
    expected = sum(connection.msgcount for own in connections for connection in own)
    if len(header) and len(header) != expected:
        findings.append(READ("damaged", topic, what=f"the index lists {expected} messages, but {len(header)} are there"))
    if len(header) > 1 and np.all(header == header[0]):
        findings.append(READ("reception", topic))
        header = np.concatenate(received)
    return Stream(topic, kind, header, block)


def _decode(raws: list[bytes], numbers: int, version: int, topic: str) -> tuple[np.ndarray, np.ndarray]:
    """Header stamps (ns) and float64 numbers of messages: a header with time stamp and frame name, then `numbers` float64."""
    # ROS 1: sequence number, stamp, frame; ROS 2: 4 bytes of encapsulation, stamp, frame, padding to 8 bytes
    stamps, values = np.empty(len(raws), np.int64), np.empty((len(raws), numbers))
    lengths = np.array([len(raw) for raw in raws])
    for length in np.unique(lengths):
        which = np.flatnonzero(lengths == length)
        block = np.frombuffer(b"".join([raws[i] for i in which]), np.uint8).reshape(len(which), length)
        order = ">" if version == 2 and length > 1 and block[0, 1] == 0 else "<"
        if length < 16 + 8 * numbers:
            raise DataError(f"{topic}: a message has {length} bytes, too few for its type; {_ODD}", code="damaged")
        head = np.ascontiguousarray(block[:, 4:16]).view(f"{order}u4")
        start = 16 + int(head[0, 2])
        if version == 2:
            start = 4 + -(-(start - 4) // 8) * 8
        if not start + 8 * numbers <= length < start + 8 * numbers + 8:
            raise DataError(f"{topic}: a message has {length} bytes, {start + 8 * numbers} expected; {_ODD}", code="damaged")
        stamps[which] = head[:, 0].astype(np.int64) * 10**9 + head[:, 1]
        values[which] = np.ascontiguousarray(block[:, start : start + 8 * numbers]).view(f"{order}f8")
    return stamps, values


def _parts(streams: list[Stream], units: dict[str, str], signals: Signals) -> list[Part]:
    """The sensors of all topics."""
    parts = [Part(name, one.topic, one.stamps, values, si_unit(name)) for one in streams for name, values in _sensors(one, signals).items()]
    if not parts:
        said = f"no measurement in {', '.join(stream.topic for stream in streams)} ({' '.join(map(str, signals.findings))})"
        raise DataError(said, code="no_rows")
    return parts


def _sensors(stream: Stream, signals: Signals) -> dict[str, np.ndarray]:
    if stream.kind.endswith("MagneticField"):
        return {"mag": stream.values[:, :3]}
    if stream.kind.endswith("Temperature"):
        return {"temperature": stream.values[:, :1]}
    filtered = stream.topic.rstrip("/").split("/")[-1] in ("data", "filtered")
    attitude = stream.values[:, :3].any() and stream.values[0, 4] != -1
    if filtered or attitude:
        what = f"The readings passed a filter, by {'its name' if filtered else 'the attitude that it carries'}"
        signals.findings.append(READ("filtered", stream.topic, what=what, better="the raw topic"))
    found = {}
    for name, (place, covariance) in _IMU.items():
        values = stream.values[:, place]
        # drivers with one topic per sensor leave the other sensor at zero
        if stream.values[0, covariance] == -1 or not values.any():
            why = "marked as not provided" if stream.values[0, covariance] == -1 else "zero throughout"
            signals.findings.append(READ("not_read", name, what=f"{stream.topic}, {why}"))
        else:
            found[name] = values
    return found
