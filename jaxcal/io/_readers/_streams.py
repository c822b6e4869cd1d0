"""Shared by readers of message logs: gather records into arrays, and bring sensors with different time stamps onto common ones."""

import dataclasses
from typing import Any

import numpy as np

from ..._answer import Finding
from ..._errors import DataError
from ..._message import Message
from ..._timebase import place
from .._columns import scale, wrong
from .._findings import READ
from .._guess import against_values, judged, no_field, turns_of
from .._table import Choice, Signals
from ._bounds import PIECE


@dataclasses.dataclass
class Part:
    """One sensor of one source (a topic, a message): `name`, time stamps in ns, values (n, axes) and their unit."""

    name: str
    source: str
    stamps: np.ndarray
    values: np.ndarray
    unit: str


def gather(content: np.ndarray, offsets: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Gather the records at `offsets` (bytes) in `content` (uint8) into a structured array; `dtype` may skip bytes."""
    if not len(offsets):
        return np.empty(0, dtype)
    windows = np.lib.stride_tricks.sliding_window_view(content, dtype.itemsize)
    out = np.empty(len(offsets), dtype)
    for start in range(0, len(offsets), PIECE):
        piece = slice(start, start + PIECE)
        out[piece] = np.ascontiguousarray(windows[offsets[piece]]).view(dtype)[:, 0]
    return out


def choose(
    samples: dict[str, int], topics: list[str] | None, present: str, preferred: Any, findings: list[Finding], few: float = 0.0
) -> list[str]:
    """Choose the labels, such as IMU:0, to read: those in `topics`, or the first sensors of the preferred kinds.

    `samples` maps label to number, `present` lists all for messages. `preferred` has families of kinds, the best first, for each group of
    sensors; a family with less than the share `few` of the samples of another is not used. Topics may be named without their number.
    """
    of = {kind: [label for label in samples if _kind(label) == kind] for kind in dict.fromkeys(map(_kind, samples))}
    chosen: list[str] = []
    for wanted in topics or ():
        matching = [wanted] if wanted in samples else of.get(wanted, [])
        if not matching:
            raise wrong("topics", f"{wanted} not among {present}")
        if len(matching) > 1:
            said = "{wanted} comes from {count} sensors: name those to read, as in {option.topics:{first}}: {present}"
            raise DataError(Message(said, wanted=wanted, count=len(matching), first=matching[0], present=present), code="several")
        chosen += matching
    if topics is not None:
        return list(dict.fromkeys(chosen))
    for families in preferred:
        most = [max((samples[label] for kind in family for label in of.get(kind, ())), default=0) for family in families]
        family = next((family for family, count in zip(families, most, strict=True) if count and count >= few * max(most)), ())
        chosen += [label for kind in family if kind in of for label in _first_of(of[kind], samples, findings)]
    if unread := sorted(of.keys() - set(map(_kind, chosen))):
        findings.append(READ("topics", chosen=", ".join(chosen), others=", ".join(unread)))
    return chosen


def _kind(label: str) -> str:
    return label.partition(":")[0]


def _first_of(labels: list[str], samples: dict[str, int], findings: list[Finding]) -> list[str]:
    """Of several sensors of one kind, the first with at least 80 % of the largest number of samples; the others are named."""
    first = next(label for label in labels if samples[label] >= 0.8 * max(map(samples.__getitem__, labels)))
    if len(labels) > 1:
        others = ", ".join(label for label in labels if label != first)
        findings.append(READ("several_sensors", chosen=first, count=len(labels), others=others))
    return [first]


class SeveralError(DataError):
    """Error for several sensors of one kind without an order of preference; `imus` are the `topics` of each IMU."""

    def __init__(self, message: Any, imus: list[str] | None = None):
        super().__init__(message, "several")
        self.imus = imus or []


def lacks(why: str) -> DataError:
    """Error for a topic or records without the fields that are needed."""
    return DataError(Message("{why}; choose others with {option.topics}", why=why), code="fields")


def imus_of(labels: list[str], chosen: list[str]) -> list[str]:
    """The `topics` of each IMU: instance 0 of every chosen kind, then instance 1 of every chosen kind, and so on."""
    names = list(dict.fromkeys(map(_kind, chosen)))
    numbers = sorted({int(number) for name, _, number in (label.partition(":") for label in labels) if name in names and number.isdigit()})
    return [",".join(one for name in names if (one := f"{name}:{number}") in labels) for number in numbers]


def join(parts: list[Part], units: dict[str, str], signals: Signals, topics: bool = True) -> None:
    """Convert all sensors to SI and put them on the time stamps of the sensor with most samples.

    A temperature is interpolated; other sensors keep their own time stamps. `units` from the caller override those of the parts. The
    result is stored in `signals`, with a note on each sensor that had other time stamps. `topics` tells whether parts can be chosen.
    """
    names = [part.name for part in parts]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        where = ", ".join(f"{part.source} ({part.name})" for part in parts if part.name in twice)
        said = "{what} in more than one of the topics: {where}; read them one by one with {option.topics}"
        raise DataError(Message(said, what=" and ".join(twice), where=where), code="several")
    parts = _checked(parts, units, signals.findings)
    main = max([part for part in parts if part.name != "temperature"] or parts, key=lambda part: len(part.stamps))
    signals.epoch_ns = int(main.stamps[0])
    time = signals.time = (main.stamps - main.stamps[0]) * 1e-9
    for part in parts:
        unit = signals.units[part.name] = units.get(part.name) or part.unit
        why = "as given" if part.name in units else "as the format prescribes"
        said, facts = "{option.topics:{source}} " * topics + "{option.units:{name}={unit}}", {"source": part.source, "name": part.name}
        signals.choices.append(Choice(part.name, (part.source,), unit, why, True, Message(said, unit=unit, **facts)))
        factor, offset = scale(unit, part.name)
        values = np.asfortranarray(part.values) * factor + offset
        if part.stamps is main.stamps or np.array_equal(part.stamps, main.stamps):
            signals.sensors[part.name] = values
        elif part.name == "temperature":
            order = np.argsort(part.stamps, kind="stable")
            since = (part.stamps[order] - main.stamps[0]) * 1e-9
            signals.sensors[part.name] = np.interp(time, since, values[order, 0])
            signals.findings.append(READ("temperature", source=part.source, main=main.source))
        elif why := _unplaced(part.stamps):
            signals.findings.append(READ("left_out", part.source, why=why, quantity=part.name))
        else:
            signals.sensors[part.name] = values
            how = Message(": {option.topics:{source}}" * topics, source=part.source)
            signals.own_time[part.name] = (part.stamps - main.stamps[0]) * 1e-9
            signals.findings.append(READ("own_stamps", part.name, source=part.source, main=main.source, how=how))


def _unplaced(stamps: np.ndarray) -> Any:
    """Why these stamps (ns) are not those of a recording, or nothing."""
    try:
        place((stamps - stamps[0]) * 1e-9, None, lambda i, j: np.zeros(len(i), dtype=bool))
    except DataError as error:
        return error
    return ""


def _checked(parts: list[Part], units: dict[str, str], findings: list[Finding]) -> list[Part]:
    """Check the values of the parts: leave out a magnetometer without a field, and warn about values that contradict their unit."""
    kept = []
    for part in parts:
        given = part.name in units or part.source.endswith((".csv", ".txt")) or len(part.values) < 2
        why = no_field(part.values) if part.name == "mag" and not given else None
        if why and len(parts) > 1:
            findings.append(READ("left_out", part.source, why=why, quantity="mag"))
            continue
        kept.append(part)
        if given:
            continue
        period = float(np.median(np.diff(part.stamps))) * 1e-9
        beside = {one.name: one.values for one in parts if part.name == "gyro" and np.array_equal(one.stamps, part.stamps)}
        try:
            judged(part.name, part.values, part.unit, f"the unit of {part.source}", period, turns_of(beside, period))
        except DataError as error:
            findings.append(against_values(part.source, part.name, part.unit, "as its format states", error))
    return kept
