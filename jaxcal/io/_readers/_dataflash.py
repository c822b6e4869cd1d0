"""Read ArduPilot DataFlash logs, a self-describing format: FMT records define the layout of all other records.

Records are found with array operations: every occurrence of the two bytes that begin a record is a candidate, and a candidate is a record
if the previous record ends there. Only where this chain breaks (the same two bytes within a record, or damage) is it followed step by step.
"""

import dataclasses
import mmap
import pathlib
import re

import numpy as np

from ..._errors import DataError
from .._findings import READ
from .._table import Signals
from ._bounds import BLOCK
from ._streams import Part, choose, gather, imus_of, join, lacks

_HEAD = b"\xa3\x95"
_FMT, _FMT_LENGTH = 128, 89
_LETTERS = {
    "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8", "f": "<f4", "d": "<f8", "g": "<f2",
    "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4", "M": "u1", "n": "S4", "N": "S16", "Z": "S64", "a": "(32,)<i2",
}  # fmt: skip
#: letters of fields that are stored multiplied by 100
_HUNDREDTHS = "cCeE"
#: (sensor, prefix of its fields, unit); group of records -> its sensors
_GYRO, _ACCEL, _MAG = ("gyro", "Gyr", "rad/s"), ("accel", "Acc", "m/s^2"), ("mag", "Mag", "mG")
_GROUPS = {"IMU": (_GYRO, _ACCEL), "GYR": (_GYRO,), "ACC": (_ACCEL,), "MAG": (_MAG,)}
#: groups of records, unfiltered readings first
_PREFERRED = ((("ISB-ACC", "ISB-GYR"), ("ACC", "GYR"), ("IMU",)), (("MAG",),))
_OLD = re.compile(r"(IMU|GYR|ACC|MAG)([1-9])")
#: clock of a record, newest first -> ns in one tick
_CLOCKS = {"TimeUS": 1000, "TimeMS": 1_000_000}
#: batches: number of the type, sensor, unit
_BATCHES = {"ISB-ACC": (0, "accel", "m/s^2"), "ISB-GYR": (1, "gyro", "rad/s")}


@dataclasses.dataclass
class Format:
    """Layout of one type of record: its number, the `letters` of its fields, and the offsets of its records."""

    number: int
    letters: dict[str, str]
    dtype: np.dtype
    offsets: np.ndarray


class DataFlash:
    """A log: the layouts of its records by name; `skipped` is the number of bytes that belong to no record."""

    def __init__(self, path: pathlib.Path):
        with path.open("rb") as file:
            data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self.formats = _formats(data)
        if not self.formats:
            raise DataError("the log describes no records (no FMT); it is damaged, or not a DataFlash log: copy it again", code="damaged")
        lengths = np.zeros(256, np.int64)
        lengths[_FMT] = _FMT_LENGTH
        for form in self.formats.values():
            lengths[form.number] = form.dtype.itemsize + 3
        self._content = np.frombuffer(data, np.uint8)
        places, kinds, self.skipped = _walk(self._content, lengths)
        for form in self.formats.values():
            form.offsets = places[kinds == form.number] + 3

    def holds(self, name: str, *fields: str) -> bool:
        """Whether the log has records of this type with these fields."""
        return name in self.formats and len(self.formats[name].offsets) > 0 and set(fields) <= set(self.formats[name].letters)

    def rows(self, name: str, offsets: np.ndarray | None = None, fields: list[str] | None = None) -> np.ndarray:
        """Records of one type, all or those at `offsets`, as a structured array with the log's field names and the stored values."""
        form = self.formats[name]
        return gather(self._content, form.offsets if offsets is None else offsets, form.dtype[fields] if fields else form.dtype)


def read_ardupilot(path: pathlib.Path, topics: list[str] | None, units: dict[str, str]) -> Signals:
    """Read time stamps and sensors of a log; batches of unfiltered samples (ISBH, ISBD) are preferred to ACC and GYR, these to IMU."""
    log = DataFlash(path)
    streams = _streams(log)
    if not streams:
        held = ", ".join(sorted(name for name in log.formats if log.holds(name))) or "none"
        raise DataError(f"no records of a sensor (IMU, ACC, GYR, ISBH, MAG) in it; the records are: {held}", code="no_sensor")
    signals = Signals(None, {})
    if log.skipped:
        signals.findings.append(READ("damaged", what=f"{log.skipped} bytes belong to no record and are left out"))
    present = "; ".join(f"{label} ({len(rows)} {'batches' if label.startswith('ISB') else 'records'})" for label, rows in streams.items())
    signals.sources = present.split("; ")
    chosen = choose({label: len(rows) for label, rows in streams.items()}, topics, present, _PREFERRED, signals.findings)
    signals.imus = imus_of(list(streams), chosen if topics is None else [])
    parts: list[Part] = []
    for label in chosen:
        parts += [_batches(log, label, signals)] if label.startswith("ISB") else _records(log, label, streams[label], signals)
    dropped = int(log.rows("DSF")["Dp"].max()) if log.holds("DSF", "Dp") else 0
    if dropped:
        signals.findings.append(READ("dropped", what=f"{dropped} records (DSF)"))
    join(_together(parts), units, signals)
    signals.columns = {"topics": chosen}
    return signals


def places_of(log: DataFlash) -> dict[str, tuple[str, np.ndarray]]:
    """Label -> type of record, and the offsets of this sensor's records."""
    found: dict[str, tuple[str, np.ndarray]] = {}
    for name in filter(log.holds, log.formats):
        old, form = _OLD.fullmatch(name), log.formats[name]
        group = old[1] if old else name
        if group not in _GROUPS:
            continue
        if "I" in form.letters and form.dtype["I"].kind in "iu":
            number = log.rows(name, fields=["I"])["I"]
            found |= {f"{group}:{one}": (name, form.offsets[number == one]) for one in np.unique(number).tolist()}
        else:
            found.setdefault(f"{group}:{int(old[2]) - 1 if old else 0}", (name, form.offsets))
    return dict(sorted(found.items()))


def _streams(log: DataFlash) -> dict[str, np.ndarray]:
    """Label, as in `topics=` -> records of one sensor."""
    found = {label: log.rows(name, offsets) for label, (name, offsets) in places_of(log).items()}
    if log.holds("ISBD") and log.holds("ISBH", "type", "instance", "N", "mul", "SampleUS", "smp_rate", "smp_cnt"):
        heads = log.rows("ISBH")
        for group, (kind, _, _) in _BATCHES.items():
            own = heads[heads["type"] == kind]
            found |= {f"{group}:{i}": own[own["instance"] == i] for i in np.unique(own["instance"]).tolist()}
    return dict(sorted(found.items()))


def _records(log: DataFlash, label: str, rows: np.ndarray, signals: Signals) -> list[Part]:
    """Sensors from records with one sample each."""
    group, _, number = label.partition(":")
    names = rows.dtype.names or ()
    form = next(name for name in (group, f"{group}{int(number) + 1}") if name in log.formats and log.formats[name].dtype == rows.dtype)
    stamps = stamps_of(rows, label)
    held = [(name, [prefix + axis for axis in "XYZ"], unit) for name, prefix, unit in _GROUPS[group]]
    held += [("temperature", ["T"], "degC")] * (group == "IMU" and "T" in names)
    parts = [Part(name, label, stamps, _values(log, form, rows, fields), unit) for name, fields, unit in held]
    signals.findings.append(READ("applied", label, who="ArduPilot") if group in ("IMU", "MAG") else READ("unstated", label))
    if group == "IMU":
        what = "The readings passed a filter and are logged far below the sensor's rate"
        signals.findings.append(READ("filtered", label, what=what, better="batches (INS_LOG_BAT_MASK)"))
    return parts


def degrees(log: DataFlash, form: str, rows: np.ndarray, field: str) -> np.ndarray:
    """A field of records in its unit (degrees of angles and places, m of altitudes), by the letter of its format alone."""
    letter = log.formats[form].letters[field]
    return rows[field].astype(float) * (1e-7 if letter == "L" else 0.01 if letter in _HUNDREDTHS else 1.0)


def stamps_of(rows: np.ndarray, label: str) -> np.ndarray:
    """Times of the samples, ns since boot."""
    names = rows.dtype.names or ()
    stamp = "SampleUS" if "SampleUS" in names and rows["SampleUS"].any() else next((one for one in _CLOCKS if one in names), "TimeUS")
    if stamp not in names or rows[stamp].dtype.kind not in "iu":
        raise lacks(f"{label} has no field {stamp} with whole numbers (it has {', '.join(names)})")
    return rows[stamp].astype(np.int64) * _CLOCKS.get(stamp, 1000)


def _values(log: DataFlash, form: str, rows: np.ndarray, fields: list[str]) -> np.ndarray:
    """Fields of records as (n, k)."""
    letters = log.formats[form].letters
    wrong = [field for field in fields if field not in letters or rows[field].dtype.kind not in "iuf" or rows[field].ndim > 1]
    if wrong:
        raise lacks(f"{form} has no numbers in {', '.join(wrong)} (its fields are {', '.join(letters)})")
    return np.stack([degrees(log, form, rows, field) for field in fields], axis=1)


def _batches(log: DataFlash, label: str, signals: Signals) -> Part:
    """Read batches of int16 samples at the sensor's own rate: ISBH begins a batch, and ISBD records of the same number have its samples."""
    group, _, number = label.partition(":")
    kind, name, unit = _BATCHES[group]
    if not log.holds("ISBD", "N", "seqno", "x", "y", "z"):
        raise lacks("ISBD lacks N, seqno, x, y or z")
    everything, data = log.rows("ISBH"), log.rows("ISBD")
    # the 16-bit batch numbers repeat, so a record belongs to the last header before it
    before = np.searchsorted(log.formats["ISBH"].offsets, log.formats["ISBD"].offsets) - 1
    own = (before >= 0) & (everything["N"][np.maximum(before, 0)] == data["N"])
    data, owner = data[own], before[own]
    stamps, values, cut = [], [], 0
    mine = np.flatnonzero((everything["type"] == kind) & (everything["instance"] == int(number)) & (everything["mul"] > 0))
    starts, ends = np.searchsorted(owner, mine), np.searchsorted(owner, mine, side="right")
    for i, start, end in zip(mine.tolist(), starts.tolist(), ends.tolist(), strict=True):
        head, part = everything[i], data[start:end]
        rate, count = float(head["smp_rate"]), int(head["smp_cnt"])
        if not part.size or not 1e-3 < rate < 1e9:
            cut += 1
            continue
        block = np.stack([part[axis].reshape(len(part), -1) for axis in "xyz"], axis=-1)
        width = block.shape[1]
        order = np.arange(width) + part["seqno"].astype(np.int64)[:, None] * width
        keep = order < count
        cut += int(keep.sum() < count)
        stamps.append(int(head["SampleUS"]) * 1000 + np.round(np.clip(order[keep] * (1e9 / rate), 0, 1e17)).astype(np.int64))
        values.append(block[keep] / float(head["mul"]))
    if not stamps:
        raise lacks(f"{label}: the batches hold no samples")
    signals.findings.append(READ("batches", label, count=len(stamps), rate=float(everything["smp_rate"][mine[0]]), cut=cut))
    return Part(name, label, np.concatenate(stamps), np.concatenate(values), unit)


def _together(parts: list[Part]) -> list[Part]:
    """Give gyroscope and accelerometer, whose batches alternate, common time stamps; each has NaN at the stamps of the other."""
    turns = [part for part in parts if part.source.startswith("ISB")]
    if len(turns) < 2:
        return parts
    stamps = np.unique(np.concatenate([part.stamps for part in turns]))
    for part in turns:
        values = np.full((len(stamps), 3), np.nan)
        values[np.searchsorted(stamps, part.stamps)] = part.values
        part.stamps, part.values = stamps, values
    return parts


def _formats(data: mmap.mmap) -> dict[str, Format]:
    """Types of records from all FMT records in the file; of several with the same number or name, the first is used."""
    found: dict[str, Format] = {}
    numbers = {_FMT}
    at = data.find(_HEAD + bytes([_FMT]))
    while 0 <= at <= len(data) - _FMT_LENGTH:
        body = data[at + 3 : at + _FMT_LENGTH]
        name, letters, labels = (part.rstrip(b"\0").decode("latin-1") for part in (body[2:6], body[6:22], body[22:86]))
        names = labels.split(",") if labels else []
        step = 1
        if len(names) == len(letters) == len(set(names)) and all(letter in _LETTERS for letter in letters) and all(names) and letters:
            dtype = np.dtype([(label, _LETTERS[letter]) for label, letter in zip(names, letters, strict=True)])
            if dtype.itemsize + 3 == body[1]:
                step = _FMT_LENGTH
                if body[0] not in numbers and name not in found and name.isalnum():
                    numbers.add(body[0])
                    found[name] = Format(body[0], dict(zip(names, letters, strict=True)), dtype, np.empty(0, np.int64))
        at = data.find(_HEAD + bytes([_FMT]), at + step)
    return found


def _walk(content: np.ndarray, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Offsets of the records, their types, and the number of bytes that belong to no record."""
    places, kinds = [np.empty(0, np.int64)], [np.empty(0, np.uint8)]
    due = taken = 0
    for begin in range(0, len(content), BLOCK):
        block = content[begin : begin + BLOCK + 2]
        at = np.flatnonzero((block[:-2] == _HEAD[0]) & (block[1:-1] == _HEAD[1]))
        kind = block[at + 2] if len(at) else np.empty(0, np.uint8)
        at = at + begin
        length = lengths[kind]
        known = (length > 0) & (at + length <= len(content)) & (at >= due)
        at, kind, length = at[known], kind[known], length[known]
        real, due = _chain(at, at + length, due)
        places.append(at[real])
        kinds.append(kind[real])
        taken += int(length[real].sum())
    return np.concatenate(places), np.concatenate(kinds), len(content) - taken


def _chain(at: np.ndarray, end: np.ndarray, due: int) -> tuple[np.ndarray, int]:
    """Select the candidates that begin a record: each begins where the previous record ends, or later; also the last end."""
    real = np.zeros(len(at), bool)
    breaks = [*np.flatnonzero(end[:-1] != at[1:]).tolist(), len(at) - 1]
    i = 0
    for stop in breaks:
        if stop < i:
            continue
        real[i : stop + 1] = True
        due = int(end[stop])
        i = int(np.searchsorted(at, due))
        if i >= len(at):
            break
    return real, due
