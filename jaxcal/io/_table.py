"""A table of columns -> stamps in s and sensors in SI: explicit options first, then names, then values. Time integrals -> rates."""

import dataclasses
import re
from typing import Any

import numpy as np

from .._errors import DataError
from .._quality import all_finite
from .._units import si_unit
from . import _guess
from ._columns import SENSORS, Columns, bracketed_unit, by_name, increasing, is_counter, listing, parse_name, resolve, scale, unit_of
from ._saved import Saved

_HOW = (
    "say which is which, by number or name, with columns={'time': 0, 'gyro': [1, 2, 3], 'accel': [4, 5, 6]} "
    "(--columns time=0,gyro=1:3,accel=4:6)"
)


@dataclasses.dataclass
class Table:
    """Columns as a reader found them: `names` are empty strings where there are none; `integer` are those without decimals;
    `saved` is what `convert` wrote.
    """

    columns: list[np.ndarray]
    names: list[str]
    integer: set[int] = dataclasses.field(default_factory=set)
    rate: float | int | None = None
    notes: list[str] = dataclasses.field(default_factory=list)
    warnings: list[str] = dataclasses.field(default_factory=list)
    saved: Saved | None = None


@dataclasses.dataclass
class Signals:
    """What goes into a `Log`, and the columns and units it was taken from; `nominal` is a rate that the file states beside stamps."""

    time: np.ndarray | None
    sensors: dict[str, np.ndarray]
    epoch_ns: int = 0
    columns: dict[str, Any] = dataclasses.field(default_factory=dict)
    units: dict[str, str] = dataclasses.field(default_factory=dict)
    notes: list[str] = dataclasses.field(default_factory=list)
    warnings: list[str] = dataclasses.field(default_factory=list)
    rate: float | int | None = None
    nominal: float | None = None


# a value too large to convert becomes infinite, and that is counted as missing
@np.errstate(invalid="ignore", over="ignore")
def interpret(
    table: Table, columns: Columns, units: dict[str, str], rate: float | int | None, missing: float | int | None = None
) -> Signals:
    """Stamps and sensors of a table, in which `missing` stands for no value."""
    listed = listing(table.names, len(table.columns))
    if not table.columns or not len(table.columns[0]):
        raise DataError(f"there are no rows of numbers (columns: {listed})")
    chosen, told, guessed = _choose(table, columns, rate)
    if not set(chosen) - {"time"}:
        raise DataError(f"no sensor among the columns {listed}; {_HOW}")
    if "time" not in chosen and rate is None and table.rate is None:
        raise DataError(
            f"there is no time column among {listed}; give the sampling rate with rate= (--rate), "
            "or name the column with columns={'time': ...} (--columns time=...)"
        )
    signals = Signals(None, {}, columns=dict(chosen), notes=list(table.notes), warnings=list(table.warnings), rate=rate)
    step = None if rate is None else 1.0 / rate
    if "time" in chosen:
        _read_time(table, chosen["time"], units, told, "time" in guessed, rate, signals)
        signals.nominal = table.rate
        # only the unit of a gyroscope is guessed with the help of the rate
        asked = "gyro" in chosen and "gyro" not in units and "gyro" not in told
        if asked and signals.time is not None and signals.time.dtype.kind == "f" and len(signals.time) > 1:
            step = float(np.nanmedian(np.diff(signals.time))) or None
    elif rate is None:
        signals.rate = table.rate

    raw = {name: [_numbers(table, i) for i in chosen[name]] for name in (*SENSORS, "temperature") if name in chosen}
    if missing is not None:
        raw = {name: [_without(column, missing) for column in values] for name, values in raw.items()}
    scales = {}
    for name, values in raw.items():
        guess = _stated(name, units, told)
        if guess is None:
            _refuse_unknown_unit(name, table.names[chosen[name][0]])
            guess = _unit(name, values, raw.get("accel"), None if not step else 1.0 / abs(step))
        scales[name] = scale(guess.unit, name)
        signals.units[name] = guess.unit
        if name in guessed or guess.reason:
            signals.notes.append(_note(name, chosen[name], table.names, guess))
    taken = [i for indices in chosen.values() for i in indices]
    # a table that is used as a whole is converted where it stands
    own = len(set(taken)) == len(taken) > len(table.columns) / 2
    for name, (factor, offset) in scales.items():
        signals.sensors[name] = _convert(raw.pop(name), factor, offset, own=own)
        # of a table that fills the memory there is no room for two
        for i in chosen[name]:
            table.columns[i] = table.columns[i][:0]
    unused = [name or str(i) for i, name in enumerate(table.names) if i not in taken]
    if unused and guessed:
        signals.notes.append(f"columns not used: {', '.join(unused[:12])}{' ...' if len(unused) > 12 else ''}")
    return signals


def _stated(name: str, units: dict[str, str], told: dict[str, str]) -> _guess.Guess | None:
    """The unit that the caller or a name states; None where it has to be guessed."""
    if name in units:
        return _guess.Guess(units[name], "", "")
    return _guess.Guess(told[name], "from the name", told[name]) if name in told else None


def _choose(table: Table, columns: Columns, rate: float | int | None) -> tuple[dict[str, list[int]], dict[str, str], set[str]]:
    """Columns by quantity, the units that names tell, and which quantities were guessed."""
    names, count = table.names, len(table.columns)
    explicit = resolve(columns, names, count)
    named, told = by_name(names) if any(names) else ({}, {})
    # a name tells the unit of an explicitly chosen column too
    for quantity, indices in explicit.items():
        told.pop(quantity, None)
        parsed = parse_name(names[indices[0]]) if names[indices[0]] else None
        inside = bracketed_unit(names[indices[0]])
        unit = (unit_of(inside, quantity) if inside else None) or (parsed[2] if parsed and parsed[0] == quantity else None)
        if unit:
            told[quantity] = unit
    if set(explicit) - {"time"}:
        used = {i for indices in explicit.values() for i in indices}
        named = {q: indices for q, indices in named.items() if q == "time" and not set(indices) & used}
    chosen = {quantity: indices for quantity, indices in named.items() if quantity not in columns} | explicit
    if not set(chosen) - {"time"}:
        if any(names) and not all(name.isdecimal() for name in names if name):
            raise DataError(f"the columns {listing(names, count)} do not say which sensor they hold; {_HOW}")
        chosen |= _by_position(table, columns, chosen.get("time"))
    if "time" not in chosen and "time" not in columns and rate is None and table.rate is None:
        used = {i for indices in chosen.values() for i in indices}
        free = [i for i in range(count) if i not in used and _is_number(table, i) and not is_counter(names[i])]
        rising = [i for i in free if increasing(table.columns[i])]
        chosen |= {"time": rising[:1]} if rising else {}
    return chosen, told, set(chosen) - set(explicit)


def _by_position(table: Table, columns: Columns, time: list[int] | None) -> dict[str, list[int]]:
    count = len(table.columns)
    numeric = [i for i in range(count) if _is_number(table, i)]
    if time is None and "time" not in columns:
        rising = [i for i in numeric if increasing(table.columns[i])]
        time = rising[:1] or None
    left = [i for i in numeric if i not in (time or [])]
    if len(left) not in (3, 6, 9):
        rises = f" (column {time[0]} rises, as time does)" if time else ""
        raise DataError(f"{listing(table.names, count)}{rises}: 3, 6 or 9 columns besides time can be told apart, not {len(left)}; {_HOW}")
    triples = [left[i : i + 3] for i in range(0, len(left), 3)]
    try:
        found = _guess.roles([_stack([table.columns[i] for i in triple]) for triple in triples])
    except DataError as error:
        raise DataError(f"{error}; {_HOW}") from None
    return ({"time": time} if time else {}) | dict(zip(found, triples, strict=True))


def _is_number(table: Table, index: int) -> bool:
    return table.columns[index].dtype.kind in "iufbM"


def _numbers(table: Table, index: int, kinds: str = "iufb") -> np.ndarray:
    column = table.columns[index]
    if column.dtype.kind in kinds:
        return column
    held = "dates" if column.dtype.kind == "M" else f"text, such as {next((str(v) for v in column if v is not None), '')!r}"
    raise DataError(
        f"column {index} ({table.names[index] or 'no name'}) holds {held}, where numbers are expected; name other columns with "
        "columns= (--columns)"
    )


def _without(column: np.ndarray, missing: float | int) -> np.ndarray:
    """A column in which a value that stands for none is NaN."""
    found = column == missing
    return np.where(found, np.nan, column) if found.any() else column


def _beside(columns: list[np.ndarray]) -> np.ndarray | None:
    """Columns that are successive rows of one array, as (k, n) without a copy; None for others."""
    base = columns[0].base
    if base is None or base.ndim != 2 or base.dtype != np.float64 or not base.flags.writeable or base.strides[1] != base.itemsize:
        return None
    if any(column.base is not base or column.strides != (base.itemsize,) for column in columns):
        return None
    place, rest = divmod(columns[0].ctypes.data - base.ctypes.data, base.strides[0])
    if rest or any(column.ctypes.data != columns[0].ctypes.data + j * base.strides[0] for j, column in enumerate(columns)):
        return None
    return base[place : place + len(columns), : len(columns[0])]


def _convert(columns: list[np.ndarray], factor: float, offset: float, *, own: bool = False) -> np.ndarray:
    """Columns as (n, k) in SI, each channel contiguous; in place where they stand beside one another and are our `own`."""
    if own and (rows := _beside(columns)) is not None:
        if factor != 1.0:
            rows *= factor
        if offset:
            rows += offset
        return rows.T
    out = np.empty((len(columns), len(columns[0])))
    for row, column in zip(out, columns, strict=True):
        if factor == 1.0:
            row[:] = column
        else:
            np.multiply(column, factor, out=row, casting="unsafe")
    if offset:
        out += offset
    return out.T


def _stack(columns: list[np.ndarray]) -> np.ndarray:
    """Columns as (n, k), with NaN for whatever is not finite."""
    rows = _beside(columns)
    values = _convert(columns, 1.0, 0.0) if rows is None else rows.T
    return values if all_finite(values) else np.where(np.isfinite(values), values, np.nan)


def _unit(name: str, columns: list[np.ndarray], accel: list[np.ndarray] | None, rate: float | None) -> _guess.Guess:
    values = _stack(columns)
    if not np.isfinite(values).all(axis=1).any():
        # `Log` refuses it by name
        return _guess.Guess(si_unit(name), "there is nothing to tell it from", "")
    if name == "gyro":
        return _guess.gyro_unit(values, None if accel is None else _stack(accel), rate)
    return {"accel": _guess.accel_unit, "mag": _guess.mag_unit, "temperature": _guess.temperature_unit}[name](values)


def _refuse_unknown_unit(name: str, header: str) -> None:
    """A unit in square brackets is a statement: where it is not understood, nothing is guessed against it."""
    match = re.search(r"\[([^\]]*[A-Za-z][^\]]*)\]", header)
    if match:
        raise DataError(
            f"the header {header!r} gives {match[1]!r}, which is no unit of {name} that is known; give the unit, or the size of one count, "
            f"as in units={{'{name}': '0.01 {si_unit(name)}'}} (--units {name}='0.01 {si_unit(name)}')"
        )


def _read_time(
    table: Table, indices: list[int], units: dict[str, str], told: dict[str, str], guessed: bool, rate: float | int | None, signals: Signals
) -> None:
    """Stamps in s: dates as they are, whole numbers relative to the first so that no digit is lost, decimals as they are."""
    column = _numbers(table, indices[0], "iufbM")
    if column.dtype.kind == "M":
        signals.time, signals.units["time"] = column, "date"
        if guessed:
            signals.notes.append(f"time: column {_label(indices, table.names)}, dates; override with --columns time=0")
        return
    if len(indices) == 2:
        seconds, nanoseconds = (np.asarray(_numbers(table, i)).astype(np.float64) for i in indices)
        if np.nanmin(nanoseconds) < 0 or np.nanmax(nanoseconds) >= 1e9:
            raise DataError(
                f"columns {_label(indices, table.names)} are not seconds and nanoseconds: the second must stay within 0 and 1e9; "
                "name one time column with columns={'time': ...} (--columns time=...)"
            )
        first = seconds[np.isfinite(seconds)][0]
        signals.epoch_ns = int(first) * 10**9
        signals.time, signals.units["time"] = (seconds - first) + nanoseconds * 1e-9, "s + ns"
        if guessed:
            signals.notes.append(f"time: columns {_label(indices, table.names)}, s and ns; override with --columns time=0 --units time=s")
        return
    guess = _stated("time", units, told) or _guess.time_unit(column, indices[0] in table.integer, rate)
    factor, offset = scale(guess.unit, "time")
    signals.units["time"] = guess.unit
    if guess.reason:
        signals.notes.append(_note("time", indices, table.names, guess))
    if column.dtype.kind in "iu":
        first, ns = int(column[0]), 1e9 * factor
        signals.epoch_ns = first * round(ns) if ns == round(ns) else round(first * ns)
        signals.time = (column.astype(np.int64) - first) * factor
    else:
        signals.time = column * factor if factor != 1.0 else column
    signals.epoch_ns += round(offset) * 10**9


def _spelled(indices: list[int], to: str, between: str) -> str:
    """A run of numbers by its ends, others one by one."""
    run = len(indices) > 1 and indices == list(range(indices[0], indices[-1] + 1))
    return f"{indices[0]}{to}{indices[-1]}" if run else between.join(map(str, indices))


def _label(indices: list[int], names: list[str]) -> str:
    known = [names[i] for i in indices if names[i]]
    return _spelled(indices, "-", ", ") + (f" ({', '.join(known)})" if known else "")


def _note(name: str, indices: list[int], names: list[str], guess: _guess.Guess) -> str:
    why = f" ({guess.reason})" if guess.reason else ""
    where = f"column{'s' * (len(indices) > 1)} {_label(indices, names)}"
    options = f"--columns {name}={_spelled(indices, ':', ',')} --units {name}={guess.other or guess.unit}"
    return f"{name}: {where}, {guess.unit}{why}; override with {options}"


def differentiate(signals: Signals) -> None:
    """Time integrals to rates: y_k = (x_(k+1) - x_k) / tau_0, stamped as x_k; missing over a step longer than 1.5 periods."""
    wrong = [name for name in ("mag", "temperature") if name in signals.sensors]
    if wrong:
        raise DataError(
            f'data="phase" (--data phase) is for angles and velocities, and there is {" and ".join(wrong)} too; choose columns without '
            "them with columns= (--columns)"
        )
    time, period = signals.time, None if signals.rate is None else 1.0 / signals.rate
    across = np.zeros(0, np.int64)
    if time is not None:
        steps = np.diff(time) / np.timedelta64(1, "s") if time.dtype.kind == "M" else np.diff(time)
        good = steps[np.isfinite(steps) & (steps > 0)]
        if not len(good) or np.any(steps <= 0):
            raise DataError('data="phase" (--data phase) needs time stamps that rise from sample to sample; sort the file by time')
        period = float(np.mean(good[good < 1.5 * float(np.median(good))]))
        across = np.flatnonzero(~(steps < 1.5 * period))
        signals.time = time[:-1]
    for name, values in signals.sensors.items():
        signals.sensors[name] = np.diff(values, axis=0) / period
        signals.sensors[name][across] = np.nan
    signals.notes.append('the values are taken as time integrals: their differences over the sampling period are used (data="phase")')
