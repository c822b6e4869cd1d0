"""Read files of clocks and oscillators: phase or frequency in any table that can be read, as a log of fractional frequencies."""

import pathlib
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from .._errors import DataError
from .._log import Log
from .._message import Message
from .._units import units_of
from ._choose import Selection, increasing
from ._clock import label_of, newest_first, no_clock, reading_of, stated_rate
from ._columns import Columns, listing, resolve, wrong
from ._findings import READ
from ._names import bracketed, parse, plain
from ._phase import differentiate
from ._read import asked, faults, named, opened
from ._table import Signals, Table, tell

#: what a column holds -> its units with their sizes in s, Hz or parts; "" is a fraction of the frequency
UNITS = {"phase": units_of("time"), "frequency": units_of("ratio") | units_of("frequency")}
_NAMES = {
    "phase": "phase|x|te|tie|ti|(?:time|clock|phase)(?:error|offset|interval|diff|difference|deviation)|offset|bias|delay",
    "frequency": "(?:fractional|relative|normali[sz]ed|frac)?(?:freq|frequency)(?:offset|error|deviation|reading)?|y|f|ffo|df|counter",
}
#: lines above the numbers in files of Stable32
_TYPE, _TAU = re.compile(r"\btype\W+(phase|freq)", re.IGNORECASE), re.compile(r"\btau\W+([\d.]+(?:e[+-]?\d+)?)", re.IGNORECASE)
#: least nominal frequency of an oscillator, Hz, and the part of it by which it is off at most
_OSCILLATOR = (1e3, 1e-3)


def read_oscillator(
    path: pathlib.Path, *, columns: Mapping[str, Any], units: Mapping[str, str], rate: float | None = None, missing: float | None = None,
    data: str = "rate", nominal: float | None = None, format: str | None = None,
) -> Log:  # fmt: skip
    """The log of a file with the phase (s) or the frequency of clocks, whose columns `gyro` are fractional frequencies.

    Parameters
    ----------
    path : any file that holds a table.
    columns : columns of "time" and of "phase" or "frequency" (one to three), by number or name.
    units : units of these, as `UNITS`, with a number before them if need be.
    rate : readings in one s, if there are no time stamps.
    missing : number that marks a missing value.
    data : "phase" if the columns are phases though nothing says so.
    nominal : nominal frequency in Hz of readings in Hz.
    format : as in `jaxcal.read`.
    """
    with named(path), opened(path, asked(format=format, rate=rate, missing=missing)) as (table, origin), faults("a clock"):
        if isinstance(table, Signals):
            raise DataError("it holds messages of sensors, and no column of a clock", code="no_sensor")
        newest_first(table)
        signals = Signals(None, {}, findings=list(table.findings), rate=rate)
        time, kind, indices = _chosen(table, columns, data)
        kind = kind or next((one for one in UNITS if one in units), "")
        _set_time(table, time, units.get("time"), signals)
        raw = [np.asarray(table.columns[i], float) for i in indices]
        values = {"gyro": [np.where(one == missing, np.nan, one) if missing is not None else one for one in raw]}
        size, unit, right = _size(table, kind or "frequency", indices, values["gyro"], units.get(kind), nominal, signals)
        if not kind and not unit:
            signals.findings.append(READ("oscillator", clock=label_of(table, indices)))
        values = {"gyro": [size * (one - right) for one in values["gyro"]]}
        if kind == "phase":
            values, signals.time = differentiate(values, signals.time, signals.rate)
        held = {"columns": {kind: [table.names[i] or i for i in indices]}, "units": {kind: unit or "1"}, "quantity": "clock"}
        return Log(signals.time, gyro=np.column_stack(values["gyro"]), rate=signals.rate, findings=signals.findings,
                   provenance=origin | held | {"epoch_ns": signals.epoch_ns})  # fmt: skip


def _set_time(table: Table, time: int | None, unit: str | None, signals: Signals) -> None:
    """Set the time stamps, or else the rate: Tau of the header, or one that is stated."""
    tau = _TAU.search(table.preamble)
    stated = (1 / float(tau[1]), "Tau in the header states") if tau else stated_rate(table.preamble, table.stem)
    if time is not None:
        name = parse(table.names[time])
        own = "mjd" if "mjd" in table.names[time].lower() else name.unit if name is not None and name.kind == "time" else None
        clock = reading_of(table, [time], unit or own, signals.rate or (stated and stated[0]), Selection({}, {}, [], set()), "clock")
        signals.time, signals.epoch_ns = clock.time, clock.epoch_ns
        tell(table, "time", [time], clock.unit, clock.reason, clock.other, clock.sure, True, signals)
    elif signals.rate is None and stated is not None:
        signals.rate = stated[0]
        signals.findings.append(READ("rate_stated", rate=stated[0], source=stated[1]))
    elif signals.rate is None:
        raise no_clock(table, [])


def _meaning(table: Table, index: int) -> tuple[str, str]:
    """What the name of a column says: time, phase or frequency, or ""; and its unit, or ""."""
    name, column = table.names[index], table.columns[index]
    bare, inside, one = plain(name).lower(), (bracketed(name) or "").replace("\u00b5", "u"), parse(name)
    for kind, words in _NAMES.items():
        for unit in ("", *UNITS[kind]):
            if re.fullmatch(f"(?:{words}){unit.lower()}", bare):
                return kind, unit or (inside if inside in UNITS[kind] else "")
    if column.dtype.kind == "M" or index in table.clocks or bare in ("mjd", "date") or (one is not None and one.kind == "time"):
        return "time", ""
    return next(((kind, inside) for kind, known in UNITS.items() if inside and inside in known), ("", ""))


def _chosen(table: Table, given: Mapping[str, Any], data: str) -> tuple[int | None, str, list[int]]:
    """The column of time, what the others hold ("": nothing says so), and which they are: as given, or as names, order and header say."""
    known: Columns = {name: [int(v) if v.isdecimal() else v for v in np.atleast_1d(value).tolist()] for name, value in given.items()}
    if unknown := set(known) - {"time", *UNITS}:
        raise wrong("columns", f"{', '.join(sorted(unknown))}: a clock has time, and phase or frequency")
    chosen = resolve(known, table.names, len(table.columns))
    meanings = [_meaning(table, i)[0] for i in range(len(table.columns))]
    numbers = [i for i, one in enumerate(table.columns) if one.dtype.kind in "iuf" and i not in table.clocks]
    time = chosen["time"][0] if "time" in chosen else meanings.index("time") if "time" in meanings else None
    for kind in UNITS:
        if kind in chosen:
            return None if time in chosen[kind] else time, kind, chosen[kind]
    if time is None and len(numbers) > 1 and not meanings[numbers[0]]:
        time = next((i for i in numbers if increasing(table.columns[i])), None)
    for kind in sorted(UNITS, reverse=data == "phase"):
        if indices := [i for i in numbers if meanings[i] == kind and i != time]:
            return time, kind, indices[:1]
    left = [i for i in numbers if i != time and not meanings[i]]
    if len(left) != 1:
        said = "which column of {listed} holds the clock? Name it: {option.columns:phase=...} or {option.columns:frequency=...}"
        raise DataError(Message(said, listed=listing(table.names, len(table.columns))), code="columns_unclear")
    stated = _TYPE.search(table.preamble) or re.search("phase|freq", table.stem, re.IGNORECASE)
    kind = "phase" if data == "phase" or (stated and stated[0].lower().endswith("phase")) else "frequency" if stated else ""
    return time, kind, left


def _size(
    table: Table, kind: str, indices: list[int], values: list[np.ndarray], given: str | None, nominal: float | None, signals: Signals
) -> tuple[float, str, float]:
    """Size of one unit in s or in parts of the frequency, the unit, and the value at which the clock is right."""
    middle = abs(float(np.nanmedian(values[0])))
    unit = given or _meaning(table, indices[0])[1] or ("s" if kind == "phase" else "Hz" if middle > 1.0 else "")
    number, _, bare = unit.rpartition(" ")
    if bare not in UNITS[kind]:
        raise wrong("units", f"{kind}={unit}: expected one of {', '.join(filter(None, UNITS[kind]))}")
    size = float(number or 1) * UNITS[kind][bare]
    if not bare.endswith("Hz"):
        return size, unit, 0.0
    middle *= size
    if nominal is None:
        least, part = _OSCILLATOR
        nice = [float(f"{middle:.2g}"), float(f"{middle:.3g}"), 2.0 ** np.round(np.log2(middle))] if middle >= least else [np.inf]
        nominal = min(nice, key=lambda one: abs(middle / one - 1))
        if not abs(middle / nominal - 1) < part:
            said = "{column} is in Hz, and its nominal frequency is not known ({middle:.6g} Hz in the median): give {option.nominal:10e6}"
            raise DataError(Message(said, column=label_of(table, indices), middle=middle), code="nominal")
        signals.findings.append(READ("nominal", nominal=nominal, clock=label_of(table, indices)))
    return size / nominal, unit, nominal / size if abs(middle / nominal - 1) < 0.5 else 0.0
