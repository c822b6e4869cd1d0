"""Read PX4 ULog files: choice of topics, and meaning of their fields."""

import collections
import pathlib

import numpy as np

from ..._answer import Finding
from ..._errors import DataError
from .._findings import READ
from .._table import Signals
from ._streams import Part, choose, imus_of, join, lacks
from ._ulog import Topic, ULog

#: topic -> its sensor
_ALL = {
    "sensor_gyro": "gyro", "sensor_accel": "accel", "sensor_mag": "mag", "sensor_gyro_fifo": "gyro", "sensor_accel_fifo": "accel",
    "sensor_combined": "gyro and accel", "vehicle_magnetometer": "mag",
}  # fmt: skip
#: topics of magnetometers, and all topics, raw readings first
COMPASSES = ("sensor_mag", "vehicle_magnetometer")
_IMUS = (("sensor_gyro", "sensor_accel"), ("sensor_gyro_fifo", "sensor_accel_fifo"), ("sensor_combined",))
_PREFERRED = (_IMUS, tuple((name,) for name in COMPASSES))
#: value that PX4 writes if it has no accelerometer sample
_INVALID = 2147483647
#: raw topics with a smaller share of the samples of another topic are not used
FEW = 0.2
_UNITS = {"gyro": "rad/s", "accel": "m/s^2", "mag": "G", "temperature": "degC"}


def read_px4(path: pathlib.Path, topics: list[str] | None, units: dict[str, str]) -> Signals:
    """Read time stamps and sensors of a ULog; raw topics are preferred to calibrated ones; `topics` names one of several instances."""
    log = ULog(path, frozenset(_ALL))
    found = {topic.label: topic for topic in log.topics}
    if not found:
        others = ", ".join(sorted(log.others)) or "none"
        raise DataError(f"no sensor topic ({', '.join(_ALL)}) with data in it; the topics are: {others}", code="no_sensor")
    signals = Signals(None, {}, findings=log.findings)
    present = "; ".join(f"{label}{_device(log, topic)} ({len(topic.offsets)} rows{_rate(log, topic)})" for label, topic in found.items())
    signals.sources = present.split("; ")
    samples = {label: _samples(log, topic) for label, topic in found.items()}
    labels = choose(samples, topics, present, _PREFERRED, signals.findings, FEW)
    signals.imus = imus_of(list(found), labels if topics is None else [])
    chosen = [found[label] for label in labels]
    parts = [part for topic in chosen for part in _parts(log, topic, signals)]
    # of several temperatures that of the gyroscope, whose bias depends on it most
    heat = sorted((part for part in parts if part.name == "temperature"), key=lambda part: not part.source.startswith("sensor_gyro"))
    parts = [part for part in parts if part not in heat[1:]]
    if log.dropouts:
        total, longest = sum(log.dropouts) / 1000, max(log.dropouts) / 1000
        signals.findings.append(READ("dropped", what=f"data {len(log.dropouts)} times, {total:g} s in all, the longest {longest:g} s"))
    join(parts, units, signals)
    signals.columns = {"topics": labels}
    return signals


def _samples(log: ULog, topic: Topic) -> int:
    """Number of samples in a topic: its rows, or the samples in the batches of a FIFO."""
    if "fifo" not in topic.name or "samples" not in topic.fields:
        return len(topic.offsets)
    counts = log.rows(topic, ["samples"])["samples"]
    return int(counts.astype(np.int64).clip(0, 1000).sum()) if counts.dtype.kind in "iu" else len(topic.offsets)


def _device(log: ULog, topic: Topic) -> str:
    ids = np.unique(log.rows(topic, ["device_id"])["device_id"]).tolist() if "device_id" in topic.fields else []
    return f" device {', '.join(map(str, ids[:3]))}" if ids else ""


def _rate(log: ULog, topic: Topic) -> str:
    stamps = log.rows(topic, ["timestamp"]).get("timestamp", [0])
    span = float(stamps[-1]) - float(stamps[0])
    return f", {(len(stamps) - 1) / (span * 1e-6):.4g} Hz" if span > 0 else ""


def _parts(log: ULog, topic: Topic, signals: Signals) -> list[Part]:
    """Sensors of one topic."""
    if "fifo" in topic.name:
        return _fifo(log, topic)
    if topic.name == "sensor_combined":
        return _combined(log, topic, signals)
    name = _ALL[topic.name]
    fields = ["magnetometer_ga"] if topic.name == "vehicle_magnetometer" else ["x", "y", "z"]
    rows = _rows(log, topic, [*fields, "timestamp"], ["timestamp_sample", "temperature", "device_id", "clip_counter", "calibration_count"])
    if "device_id" in rows and len(np.unique(rows["device_id"])) > 1:
        signals.findings.append(READ("several_devices", topic.label, devices=_device(log, topic).strip()))
    if topic.name == "vehicle_magnetometer":
        rows = _longest(rows, "calibration_count", topic, signals.findings)
    stamps, values = _stamps(rows, topic, signals.findings), _wide(rows, fields)
    if topic.name == "vehicle_magnetometer":
        signals.findings.append(READ("applied", name, who="PX4"))
    elif "clip_counter" in rows:
        clipped = np.count_nonzero(rows["clip_counter"].reshape(len(stamps), -1).any(axis=1))
        if clipped:
            signals.findings.append(READ("sensor_clipped", topic.label, count=clipped))
    parts = [Part(name, topic.label, stamps, values, _UNITS[name])]
    if "temperature" in rows and np.isfinite(rows["temperature"]).any() and name != "mag":
        parts.append(Part("temperature", topic.label, stamps, rows["temperature"].astype(np.float64)[:, None], "degC"))
    return parts


def _combined(log: ULog, topic: Topic, signals: Signals) -> list[Part]:
    counts = ["accel_calibration_count", "gyro_calibration_count"]
    needed, own = ["timestamp", "gyro_rad", "accelerometer_m_s2"], "accelerometer_timestamp_relative"
    rows = _rows(log, topic, needed, [own, *counts])
    for count in counts:
        rows = _longest(rows, count, topic, signals.findings)
    stamps = rows["timestamp"].astype(np.int64) * 1000
    accel, later = _wide(rows, ["accelerometer_m_s2"]), stamps
    if own in rows:
        relative = rows[own].astype(np.int64)
        invalid = relative == _INVALID
        accel[invalid] = np.nan
        later = stamps + np.where(invalid, 0, relative) * 1000
        if invalid.any():
            signals.findings.append(READ("not_read", "accel", what=f"{np.count_nonzero(invalid)} rows that are marked invalid"))
    parts = []
    for name, at, values in (("gyro", stamps, _wide(rows, ["gyro_rad"])), ("accel", later, accel)):
        signals.findings.append(READ("applied", name, who="PX4"))
        if np.isfinite(values).any():
            parts.append(Part(name, topic.label, at, values, _UNITS[name]))
    what = "The readings are averages over an interval"
    signals.findings.append(READ("filtered", topic.label, what=what, better="sensor_gyro and sensor_accel"))
    return parts


def _fifo(log: ULog, topic: Topic) -> list[Part]:
    """Read batches of raw counts: sample k of `samples` was taken (samples - 1 - k) dt before the time stamp of the batch."""
    rows = _rows(log, topic, ["dt", "scale", "samples", "x", "y", "z"], ["timestamp", "timestamp_sample"])
    stamps = _stamps(rows, topic, [])
    width = rows["x"].reshape(len(stamps), -1).shape[1]
    samples = np.minimum(rows["samples"].astype(np.int64), width)
    k = np.arange(width)
    there = k < samples[:, None]
    dt = np.where(np.isfinite(rows["dt"]), rows["dt"], 0.0).astype(np.float64)
    back = np.clip((samples[:, None] - 1 - k) * dt[:, None] * 1000.0, -1e15, 1e15)
    each = (stamps[:, None] - np.round(back).astype(np.int64))[there]
    counts = np.stack([rows[axis].reshape(len(stamps), -1)[there] for axis in "xyz"], axis=1)
    scale = np.repeat(rows["scale"].astype(np.float64), samples)
    name = _ALL[topic.name]
    if not len(each):
        raise lacks(f"{topic.label} holds no samples")
    return [Part(name, topic.label, each, counts * scale[:, None], _UNITS[name])]


def _rows(log: ULog, topic: Topic, needed: list[str], optional: list[str]) -> dict[str, np.ndarray]:
    missing = [name for name in needed if name not in topic.fields]
    if missing:
        raise lacks(f"{topic.label} lacks {', '.join(missing)} (it has {', '.join(topic.fields)})")
    rows = log.rows(topic, needed + optional)
    text = [name for name, column in rows.items() if column.dtype.kind not in "iuf"]
    if text:
        raise DataError(f"{topic.label}: {', '.join(text)} holds no numbers; the file is damaged: copy it again", code="damaged")
    return rows


def _stamps(rows: dict[str, np.ndarray], topic: Topic, findings: list[Finding]) -> np.ndarray:
    """Times of the samples, ns since boot."""
    if "timestamp_sample" in rows and rows["timestamp_sample"].any():
        return rows["timestamp_sample"].astype(np.int64) * 1000
    if "timestamp" not in rows:
        raise lacks(f"{topic.label} has no time stamps")
    findings.append(READ("logging_times", topic.label))
    return rows["timestamp"].astype(np.int64) * 1000


def _wide(rows: dict[str, np.ndarray], fields: list[str]) -> np.ndarray:
    values = np.concatenate([rows[field].reshape(len(rows[field]), -1) for field in fields], axis=1).astype(np.float64)
    if values.shape[1] != 3:
        raise DataError(f"{', '.join(fields)}: {values.shape[1]} numbers a row where 3 are expected")
    return values


def _longest(rows: dict[str, np.ndarray], field: str, topic: Topic, findings: list[Finding]) -> dict[str, np.ndarray]:
    """Keep the rows with the most frequent calibration."""
    if field not in rows:
        return rows
    counts = collections.Counter(rows[field].tolist())
    most, number = counts.most_common(1)[0]
    if len(counts) > 1:
        findings.append(READ("recalibrated", topic.label, count=len(counts) - 1, read=number, total=counts.total()))
    kept = np.asarray(rows[field] == most)
    return {name: column[kept] for name, column in rows.items()}
