"""ArduPilot DataFlash: which records are read, and what their fields mean."""

import pathlib
import re

import numpy as np

from .._errors import DataError
from .._units import find_unit
from ._dataflash import HUNDREDTHS, DataFlash, open_dataflash
from ._join import Part, join
from ._table import Signals
from ._undo import undo_ardupilot, undo_compass

#: group of records -> sensor -> (fields, unit of the value where the log does not tell)
_GYRO = ("gyro", "Gyr", "rad/s")
_ACCEL = ("accel", "Acc", "m/s^2")
_MAG = ("mag", "Mag", "mG")
_GROUPS = {"IMU": (_GYRO, _ACCEL), "GYR": (_GYRO,), "ACC": (_ACCEL,), "MAG": (_MAG,)}
_OLD = re.compile(r"(IMU|GYR|ACC|MAG)([1-9])")
_UNITS = {"gyro": "rad/s", "accel": "m/s^2", "mag": "mG"}


def read_ardupilot(path: pathlib.Path, topics: list[str] | None, units: dict[str, str], raw: bool) -> Signals:
    """Stamps and sensors of a DataFlash log.

    Batches of unfiltered samples (ISBH, ISBD) go before ACC and GYR, and those before IMU. Where there are several sensors of a
    kind, `topics` names one, as in ``IMU:1``.

    Raises
    ------
    DataError
        If no records, or those of more than one sensor, could be meant; the message lists them.
    """
    log = open_dataflash(path)
    streams = _streams(log)
    if not streams:
        held = ", ".join(sorted(name for name in log.formats if log.count(name))) or "none"
        raise DataError(f"no records of a sensor (IMU, ACC, GYR, ISBH, MAG) in it; the records are: {held}")
    signals = Signals(None, {})
    if log.skipped:
        signals.warnings.append(f"the file is damaged or cut off: {log.skipped} bytes belong to no record and are left out")
    present = "; ".join(f"{label} ({len(rows)} {'batches' if label.startswith('ISB') else 'records'})" for label, rows in streams.items())
    chosen = _choose(list(streams), topics, present, signals.notes)
    parameters, changed = _parameters(log)
    parts = []
    for label in chosen:
        if label.startswith("ISB"):
            parts.append(_batches(log, label, signals))
        else:
            parts += _records(log, label, streams[label], raw, parameters, changed, signals)
    if "DSF" in log.formats and log.count("DSF") and "Dp" in log.formats["DSF"].letters:
        dropped = int(log.rows("DSF")["Dp"].max())
        if dropped:
            signals.warnings.append(f"the logger dropped {dropped} records (DSF); samples lost there are gaps")
    join(_together(parts), units, signals)
    signals.columns = {"topics": chosen}
    return signals


def _streams(log: DataFlash) -> dict[str, np.ndarray]:
    """Label, as `topics=` takes it -> records of one sensor."""
    found: dict[str, np.ndarray] = {}
    for name in log.formats:
        old = _OLD.fullmatch(name)
        group = old[1] if old else name
        if group not in _GROUPS or not log.count(name):
            continue
        rows = log.rows(name)
        if "I" in log.formats[name].letters and rows["I"].dtype.kind in "iu":
            found |= {f"{group}:{number}": rows[rows["I"] == number] for number in np.unique(rows["I"]).tolist()}
        else:
            found.setdefault(f"{group}:{int(old[2]) - 1 if old else 0}", rows)
    if log.count("ISBH") and log.count("ISBD"):
        heads = log.rows("ISBH")
        if {"type", "instance", "N", "mul", "SampleUS", "smp_rate", "smp_cnt"} <= set(heads.dtype.names or ()):
            for kind, word in ((0, "ACC"), (1, "GYR")):
                of_kind = heads[heads["type"] == kind]
                found |= {f"ISB-{word}:{i}": of_kind[of_kind["instance"] == i] for i in np.unique(of_kind["instance"]).tolist()}
    return dict(sorted(found.items()))


def _choose(labels: list[str], topics: list[str] | None, present: str, notes: list[str]) -> list[str]:
    if topics is not None:
        return list(dict.fromkeys(_named(labels, wanted, present) for wanted in topics))
    groups = {label.partition(":")[0] for label in labels}
    batches = sorted(group for group in groups if group.startswith("ISB"))
    rates = sorted(groups & {"ACC", "GYR"})
    chosen = [*(batches or rates or sorted(groups & {"IMU"})), *sorted(groups & {"MAG"})]
    if groups - set(chosen):
        notes.append(f"records: {', '.join(chosen)}; not read: {', '.join(sorted(groups - set(chosen)))}; override with --topics")
    return [_named(labels, group, present) for group in chosen]


def _named(labels: list[str], wanted: str, present: str) -> str:
    matching = [label for label in labels if wanted in (label, label.partition(":")[0])]
    if not matching:
        raise DataError(f"topics=: {wanted} not among {present}")
    if len(matching) > 1:
        raise DataError(
            f"{wanted} comes from {len(matching)} sensors: name those to read with topics= (--topics), such as {matching[0]}: {present}"
        )
    return matching[0]


def _records(
    log: DataFlash, label: str, rows: np.ndarray, raw: bool, parameters: dict[str, float], changed: set[str], signals: Signals
) -> list[Part]:
    """Sensors of records that hold one sample each."""
    group, _, number = label.partition(":")
    names = rows.dtype.names or ()
    form = next(name for name in (group, f"{group}{int(number) + 1}") if name in log.formats and log.formats[name].dtype == rows.dtype)
    stamp = "SampleUS" if "SampleUS" in names and rows["SampleUS"].any() else "TimeUS"
    if stamp not in names or rows[stamp].dtype.kind not in "iu":
        raise DataError(f"{label} has no field {stamp} with whole numbers (it has {', '.join(names)}); choose other records with --topics")
    stamps = rows[stamp].astype(np.int64) * 1000
    parts = []
    for name, prefix, unit in _GROUPS[group]:
        values, unit = _values(log, form, rows, [prefix + axis for axis in "XYZ"], unit, name)
        if raw and name == "mag":
            added, _ = _values(log, form, rows, [f"Ofs{axis}" for axis in "XYZ"], unit, name)
            if all(f"MO{axis}" in names for axis in "XYZ"):
                added = added + _values(log, form, rows, [f"MO{axis}" for axis in "XYZ"], unit, name)[0]
            values = undo_compass(values, added, int(number), parameters, changed)
        elif raw:
            values = undo_ardupilot(name, values, int(number), parameters, changed)
        parts.append(Part(name, label, stamps, values, unit))
    if group == "IMU" and "T" in names:
        parts.append(Part("temperature", label, stamps, _values(log, form, rows, ["T"], "degC", "temperature")[0], "degC"))
    if raw:
        signals.notes.append(f"{label}: the calibration that ArduPilot applied is undone with the log's parameters (raw)")
    undo = "" if raw else "; undo the calibration with raw=True (--raw)"
    if group == "IMU":
        signals.warnings.append(
            f"{label} is {'' if raw else 'calibrated and '}filtered, and logged far below the sensor's rate: noise found from it is wrong; "
            f"log batches for noise (INS_LOG_BAT_MASK){undo}"
        )
    elif group == "MAG" and not raw:
        signals.warnings.append(f"{label} is already corrected by ArduPilot: a calibration found from it comes on top{undo}")
    elif not raw:
        signals.warnings.append(f"{label}: the log does not say whether these are calibrated or filtered")
    return parts


def _values(log: DataFlash, form: str, rows: np.ndarray, fields: list[str], unit: str, quantity: str) -> tuple[np.ndarray, str]:
    """Fields of records as (n, k), and their unit: that of FMTU, UNIT and MULT, else the customary one."""
    letters = log.formats[form].letters
    wrong = [field for field in fields if field not in letters or rows[field].dtype.kind not in "iuf" or rows[field].ndim > 1]
    if wrong:
        raise DataError(
            f"{form} has no numbers in {', '.join(wrong)} (its fields are {', '.join(letters)}); choose other records with --topics"
        )
    values = np.stack([rows[field].astype(np.float64) for field in fields], axis=1)
    stated, factor = _stated(log, form, fields[0], quantity)
    if stated is not None:
        return values * factor, stated
    hundredths = [0.01 if letters[field] in HUNDREDTHS else 1.0 for field in fields]
    return values * np.array(hundredths), unit


def _stated(log: DataFlash, form: str, field: str, quantity: str) -> tuple[str | None, float]:
    """Unit and factor that the log itself gives for a field, or None."""
    if not all(log.count(name) for name in ("FMTU", "UNIT", "MULT")):
        return None, 1.0
    needed = {"FMTU": ("FmtType", "UnitIds", "MultIds"), "UNIT": ("Id", "Label"), "MULT": ("Id", "Mult")}
    if any(set(fields) - set(log.formats[name].letters) for name, fields in needed.items()):
        return None, 1.0
    number = log.formats[form].number
    units = [row for row in log.rows("FMTU") if row["FmtType"] == number]
    place = list(log.formats[form].letters).index(field)
    if not units or not all(isinstance(units[0][name], bytes) and place < len(units[0][name]) for name in ("UnitIds", "MultIds")):
        return None, 1.0
    unit, factor = units[0]["UnitIds"][place], units[0]["MultIds"][place]
    labels = [row["Label"] for row in log.rows("UNIT") if row["Id"] == unit]
    factors = [float(row["Mult"]) for row in log.rows("MULT") if row["Id"] == factor]
    text = labels[0].decode("latin-1") if labels and isinstance(labels[0], bytes) else ""
    found = find_unit({"Gauss": "G", "mGauss": "mG", "m/s/s": "m/s^2"}.get(text, text), quantity)
    if found is None or not factors:
        return None, 1.0
    # zero stands for a field without a multiplier
    return found, factors[0] if np.isfinite(factors[0]) and factors[0] > 0 else 1.0


def _batches(log: DataFlash, label: str, signals: Signals) -> Part:
    """Bursts of int16 at the sensor's own rate: ISBH begins one, and the ISBD of the same number hold its samples."""
    name = "accel" if "ACC" in label else "gyro"
    data = log.rows("ISBD")
    if not {"N", "seqno", "x", "y", "z"} <= set(data.dtype.names or ()):
        raise DataError("ISBD lacks N, seqno, x, y or z; choose other records with topics= (--topics)")
    everything = log.rows("ISBH")
    # numbers of 16 bits come round again: a record belongs to the last header before it
    before = np.searchsorted(log.formats["ISBH"].offsets, log.formats["ISBD"].offsets) - 1
    own = (before >= 0) & (everything["N"][np.maximum(before, 0)] == data["N"])
    data, owner = data[own], before[own]
    stamps, values, cut = [], [], 0
    kind, instance = (0 if name == "accel" else 1), int(label.partition(":")[2])
    mine = np.flatnonzero((everything["type"] == kind) & (everything["instance"] == instance) & (everything["mul"] > 0))
    starts, ends = np.searchsorted(owner, mine), np.searchsorted(owner, mine, side="right")
    for i, start, end in zip(mine.tolist(), starts.tolist(), ends.tolist(), strict=True):
        head, part = everything[i], data[start:end]
        rate, count = float(head["smp_rate"]), int(head["smp_cnt"])
        if not part.size or not rate > 0:
            cut += 1
            continue
        block = np.stack([part[axis].reshape(len(part), -1) for axis in "xyz"], axis=-1)
        width = block.shape[1]
        order = np.arange(width) + part["seqno"].astype(np.int64)[:, None] * width
        keep = order < count
        cut += int(keep.sum() < count)
        stamps.append(int(head["SampleUS"]) * 1000 + np.round(order[keep] * (1e9 / rate)).astype(np.int64))
        values.append(block[keep] / float(head["mul"]))
    if not stamps:
        raise DataError(f"{label}: the batches hold no samples; choose other records with topics= (--topics)")
    signals.notes.append(
        f"{name}: {label}, {len(stamps)} batches at {float(everything['smp_rate'][mine[0]]):.6g} Hz, raw, with gaps between them"
    )
    if cut:
        signals.warnings.append(f"{label}: {cut} batches are not complete")
    return Part(name, label, np.concatenate(stamps), np.concatenate(values), _UNITS[name])


def _together(parts: list[Part]) -> list[Part]:
    """Batches of the gyroscope and of the accelerometer take turns: give both the stamps of either, with nothing at the other's."""
    turns = [part for part in parts if part.source.startswith("ISB")]
    if len(turns) < 2:
        return parts
    stamps = np.unique(np.concatenate([part.stamps for part in turns]))
    for part in turns:
        values = np.full((len(stamps), 3), np.nan)
        values[np.searchsorted(stamps, part.stamps)] = part.values
        part.stamps, part.values = stamps, values
    return parts


def _parameters(log: DataFlash) -> tuple[dict[str, float], set[str]]:
    """Parameters as first logged, and the names of those that changed later."""
    found: dict[str, float] = {}
    changed: set[str] = set()
    if not log.count("PARM") or {"Name", "Value"} - set(log.formats["PARM"].letters):
        return found, changed
    rows = log.rows("PARM")
    if rows["Name"].dtype.kind != "S" or rows["Value"].dtype.kind != "f":
        return found, changed
    for name, value in zip(rows["Name"].tolist(), rows["Value"].tolist(), strict=True):
        key = name.decode("latin-1")
        if found.setdefault(key, value) != value:
            changed.add(key)
    return found, changed
