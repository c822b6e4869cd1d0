"""Find the clock of a table: its column, its unit, and the evidence for them.

A column that counts rows is not a clock, whatever its name. Of several clocks, the one with more distinct values is used, and the others
must agree with it.
"""

import dataclasses
import re
from typing import Any

import numpy as np

from .._answer import Finding
from .._errors import DataError
from .._message import Message
from . import _stamps
from ._choose import Selection, increasing, numbers_of
from ._columns import listing, scale
from ._findings import READ
from ._names import is_counter, is_other, parse, plain
from ._readers._bounds import PIECE
from ._stamps import Clock

#: sizes of counters of 16, 31 and 32 bits, by which a clock jumps back when its counter wraps
_WRAPS = (2.0**16, 2.0**31, 2.0**32)
_STATED = re.compile(
    r"(?:sampl\w{0,20}[ _-]{0,3}(?:rate|freq\w*)|update[ _-]*rate|output[ _-]*(?:data[ _-]*)?rate|data[ _-]*rate|\bodr|frequency|\bfreq|"
    r"\bfs|\brate|abtastrate|taxa|\bat)\b[\"']?(?:\s*\[?\(?hz\)?\]?)?[\s:=,;\"']*([0-9]+(?:[.,][0-9]+)?)\s*(k?hz)?", re.IGNORECASE,
)  # fmt: skip
_LIKE_TIME = re.compile(
    r"time(?!te?r)|stamp|clock|elapsed|epoch|zeit|(?<![a-z])(?:ms|us|ns|sec|seconds|millis|micros)(?![a-z])", re.IGNORECASE
)
_IN_BRACKETS = re.compile(r"[\[(]\s*(min|s|ms|us|ns)\s*[\])]$")
_STEPS_OF_TIME = re.compile(r"(?:dt|delta?|deltat|deltatime|timedelta|timediff|timestep|samplingtime|interval)(?:s|ms|us|ns)?")
OF_NAME = "the name of the file states"
_FILE_RATE = re.compile(r"(?<![0-9a-z.])([0-9]+(?:[.p][0-9]+)?)[ _-]?(k?hz)(?![a-z])", re.IGNORECASE)


def newest_first(table) -> None:
    """Reverse a table whose time stamps fall from row to row."""
    if not any(table.names) and any(increasing(column) for column in table.columns):
        return  # a clock without a name rises, and what falls is a signal
    for i, (name, column) in enumerate(zip(table.names, table.columns, strict=True)):
        meaning, stamps = parse(name), column.dtype.kind == "M" or i in table.clocks
        if column.dtype.kind not in "iufM" or not (stamps or (meaning.kind == "time" if meaning else not any(table.names))):
            continue
        falls = column[1:] < column[:-1]
        if len(falls) > 2 and np.mean(falls) > 0.95 and (stamps or meaning or _even(-column[:PIECE].astype(float))):
            table.columns[:] = [np.ascontiguousarray(one[::-1]) for one in table.columns]
            table.findings.append(READ("newest_first", clock=label_of(table, [i])))
            return


def stated_rate(preamble: str, stem: str) -> tuple[float, str] | None:
    """The sampling rate stated in the text above a table, or else in the file name, with its source; or None."""
    preamble = re.sub(r"[ \t]+", " ", preamble)  # runs of blanks would take long
    for text, pattern, source in ((preamble, _STATED, "the header states"), (stem, _FILE_RATE, OF_NAME)):
        found = [one for one in pattern.findall(text) if one[1] or not re.search(r"\bat\W+" + re.escape(one[0]), text, re.IGNORECASE)]
        values = {float(number.replace(",", ".").replace("p", ".")) * (1e3 if unit.lower() == "khz" else 1.0) for number, unit in found}
        values = {value for value in values if 0.01 <= value <= 1e6}
        if len(values) == 1:
            return values.pop(), source
    return None


def clock_of(table, found: Selection, units: dict[str, str], rate: float | int | None) -> Clock | None:
    """The clock of a table, or None if it has none."""
    wanted = found.columns.get("time")
    if wanted is not None and "time" not in found.guessed:
        return reading_of(table, wanted, units.get("time") or _named_unit(table, found, wanted), rate, found, explicit="time" in units)
    clocks, counters, faults = [], [], []
    sets = _candidates(table, found, wanted)
    for indices in [*sets, *_rising(table, found)]:
        if (clocks or faults) and indices not in sets:
            break  # what only rises is a clock where no name speaks of one
        stated = units.get("time") or _named_unit(table, found, indices)
        if _counts_rows(table, indices, stated):
            counters += indices
            continue
        try:
            clock = reading_of(table, indices, stated, rate, found, explicit="time" in units)
        except DataError as error:
            faults.append(error)
            continue
        silent = "time" not in units and len(indices) == 1 and _unnamed(table, found, indices[0])
        if silent and not re.match("starts at|dates|times of day|.*agrees with|.*Julian", clock.reason):
            clock = dataclasses.replace(clock, sure=False, reason=f"it rises as time does, but its name does not say so; {clock.reason}")
        clocks.append(clock)
    found.counters = [table.names[i] or str(i) for i in counters]
    if counters:
        found.findings.append(READ("counts_rows", columns=", ".join(found.counters)))
    if not clocks:
        if faults:
            raise faults[0]
        found.columns.pop("time", None)
        return None
    if len(clocks) > 1:
        clocks = [one for one in clocks if one.distinct > 1.5 / max(len(one.time), 1)] or clocks[:1]
    best = max(clocks, key=lambda one: (round(min(one.distinct, 0.9), 1), one.sure))
    others = [one for one in clocks if one is not best and one.distinct > 0.01 and np.isfinite(one.mean) and one.mean > 0]
    for other in others:
        best = _compare(table, best, other, found)
    found.columns["time"] = best.columns
    found.guessed.add("time")
    return best


def _candidates(table, found: Selection, wanted: list[int] | None) -> list[list[int]]:
    """Columns that may be the clock: columns with a time in their name, dates, or else an increasing column."""
    named = [i for i, one in enumerate(found.names) if one is not None and one.kind == "time" and one.axis == ""]
    fraction = [i for i, one in enumerate(found.names) if one is not None and one.kind == "time" and one.axis == "nsec"]
    dates = [i for i, column in enumerate(table.columns) if column.dtype.kind == "M" and i not in table.days]
    sets = [[i] for i in dict.fromkeys([*named, *dates, *sorted(table.clocks)]) if _varies(table, i)]
    whole = next((i for i in named if (one := found.names[i]) is not None and one.unit == "s" and i not in table.clocks), None)
    parts = {i: _stamps.SECONDS[one.unit] for i in named if (one := found.names[i]) is not None and one.unit in ("ms", "us", "ns")}
    pairs = [[j, i] for i, size in parts.items() for (j,) in sets if j not in parts and _stamps.is_fraction(table, j, i, size)]
    if fraction:
        pairs = [] if whole is None else [[whole, fraction[0]]]
    day = [[min(table.days), min(table.clocks)]] if table.days and table.clocks else []
    for joined in (*pairs[:1], *day, *filter(None, [_stamps.of_day(table)])):
        sets = [joined, *(one for one in sets if not set(one) & set(joined))]
    if wanted is not None and wanted not in sets:
        sets.insert(0, wanted)
    return sets


def _rising(table, found: Selection) -> list[list[int]]:
    """The column that rises as time does, if there is one."""
    used = {i for indices in found.columns.values() for i in indices}
    free = [i for i, one in enumerate(table.columns) if i not in used and found.names[i] is None and increasing(one)]
    free = [i for i in free if not (any(table.names) and is_counter(table.names[i]))]
    speaking = [i for i in free if not _unnamed(table, found, i)]
    silent = [i for i in free if i not in speaking and not is_other(table.names[i]) and _even(table.columns[i])]
    return [[i] for i in [*speaking, *silent]][:1]


def _even(values) -> bool:
    """Whether most steps of a column are alike, as those of a clock are."""
    low, middle, high = np.percentile(np.diff(np.asarray(values[:PIECE], np.float64)), [25, 50, 75])
    return bool(high - low <= 0.5 * middle)


def _unnamed(table, found: Selection, index: int) -> bool:
    """Whether a column has a name in which nothing speaks of time."""
    name = table.names[index]
    return found.names[index] is None and bool(name) and not _LIKE_TIME.search(name) and not _IN_BRACKETS.search(name.strip())


def _varies(table, index: int) -> bool:
    column = table.columns[index]
    return column.dtype.kind in "iufM" and not bool((np.isnat(column) if column.dtype.kind == "M" else ~np.isfinite(column)).all())


def _named_unit(table, found: Selection, indices: list[int]) -> str | None:
    one, written = found.names[indices[0]], _IN_BRACKETS.search((table.names[indices[0]] or "").strip())
    if one is None and written and len(indices) == 1:  # a name that speaks of time by its unit alone, as X [s]
        return written[1]
    return one.unit if one is not None and one.kind == "time" else None


def _counts_rows(table, indices: list[int], stated: str | None) -> bool:
    """Whether a column counts rows: consecutive whole numbers, without a stated unit."""
    column = table.columns[indices[0]]
    if len(indices) > 1 or indices[0] in table.clocks or column.dtype.kind not in "iuf" or stated is not None:
        return False
    steps = np.diff(column[: 1 << 17])
    steps = steps[np.isfinite(steps)]
    if not len(steps) or not np.all(column[:1000][np.isfinite(column[:1000])] % 1 == 0):
        return False
    counter = any(table.names) and is_counter(table.names[indices[0]])
    return bool(np.median(steps) <= 16 if counter else np.mean(steps == 1) > 0.95)


def reading_of(
    table, indices: list[int], stated: str | None, rate: float | int | None, found: Selection, what: str = "sensor", explicit: bool = False
) -> Clock:
    """Time stamps of columns. Whole numbers become relative to the first, so that no digit is lost; dates and decimals stay as they are."""
    columns = [numbers_of(table, i, dates=True) for i in indices]
    if len(indices) > 2:
        return _stamps.together(table, indices, [3600.0, 60.0, 1.0, _stamps.fraction_size(table.names[indices[-1]])][: len(indices)])
    if len(indices) == 2:
        part = 1.0 if indices[1] in table.clocks else _stamps.SECONDS.get(_named_unit(table, found, indices[1:]) or "", 1e-9)
        return _stamps.together(table, indices, [1.0, part])
    (column,), (index,) = columns, indices
    if column.dtype.kind == "M":
        return Clock(indices, column, "date", "dates")
    if index in table.clocks:
        return Clock(indices, _stamps.since_midnight(column), "time of day", "times of day")
    if not explicit and (dates := _stamps.from_date_digits(column)) is not None:
        return Clock(indices, dates, "date", "dates, written as digits")
    if stated is None and rate is None and (digits := _stamps.from_digits(column)) is not None:
        return Clock(indices, _stamps.since_midnight(digits), "time of day", "times of day, written as digits")
    if stated == "sampletimefine":
        steps = np.diff(column)
        step = float(np.median(steps[steps > 0])) if np.any(steps > 0) else np.nan
        unit = "us" if step > 2500 else "1e-4 s"
        guess = unit, f"SampleTimeFine with a median step of {step:g}, as {'Movella DOT' if unit == 'us' else 'Xsens MT'} counts", "s", True
    elif stated is not None:
        other = {"s": "ms", "ms": "s", "us": "ms", "ns": "us"}.get(stated, "s")
        guess = (stated, "" if explicit else "from the name", other, True)
    else:
        guess = _stamps.unit_by_step(column, index in table.integer, rate, _stamps.USUAL[what])
    unit, reason, other, sure = guess
    factor, offset = scale(unit, "time")
    epoch = 0
    if column.dtype.kind in "iu":
        first, ns = int(column[0]), 1e9 * factor
        epoch = first * round(ns) if ns == round(ns) else round(first * ns)
        time = (column.astype(np.int64) - first) * factor
    else:
        time = column * factor if factor != 1.0 else column
    return Clock(indices, time, unit, reason, other, sure, epoch + round(offset) * 10**9)


def _compare(table, best: Clock, other: Clock, found: Selection) -> Clock:
    """Compare two clocks, which must agree; a certain one determines the unit of an uncertain one."""
    shown = [" and ".join(table.names[i] or str(i) for i in one.columns) for one in (best, other)]
    ratio = best.mean / other.mean
    coarse = 2.0 / max(len(best.time) * other.distinct, 1)  # two ticks of the coarser clock
    if abs(ratio - 1.0) < 0.02 + coarse:
        return dataclasses.replace(best, reason=f"{best.reason}; agrees with {shown[1]}", sure=best.sure or other.sure)
    if other.sure and not best.sure:
        for unit, seconds in _stamps.SECONDS.items():
            if abs(ratio * seconds / _stamps.SECONDS.get(best.unit, np.nan) - 1.0) < 0.02 + coarse:
                again = reading_of(table, best.columns, unit, None, found, explicit=False)
                return dataclasses.replace(again, reason=f"agrees with {shown[1]}", sure=True)
    if best.sure and other.sure:
        percent, column = 100 * abs(1 / ratio - 1), ",".join(map(str, other.columns))
        found.findings.append(READ("clocks_differ", chosen=shown[0], other=shown[1], percent=percent, column=column))
    return best


def refuse_restarts(clock: Clock) -> None:
    """Refuse a table in which time starts again, because it has several recordings one below the other."""
    seconds = clock.seconds
    with np.errstate(invalid="ignore"):
        back = np.flatnonzero(np.diff(seconds) < 0)
    period = clock.period
    if not len(back) or not np.isfinite(period):
        return
    drops = seconds[back] - seconds[back + 1]
    unit = _stamps.SECONDS.get(clock.unit, 1e-4 if clock.unit == "1e-4 s" else 1.0)
    span = float(np.ptp(seconds[np.isfinite(seconds)]))
    wraps = np.array([*(size * tick for size in _WRAPS for tick in (unit, 1e-9, 1e-6, 1e-3)), _stamps.DAY])
    wraps = wraps[wraps > 20 * period]
    long = drops > max(0.2 * span, 50 * period)
    restarts = []
    for at, drop in zip(back[long].tolist()[:1000], drops[long].tolist(), strict=False):
        after = seconds[at + 1 : at + 21]
        after = after[np.isfinite(after)]
        goes_on = len(after) > 3 and np.median(np.abs(np.diff(after))) < 5 * period and after.max() < seconds[at]
        if goes_on and not np.any(np.abs(drop - wraps) < np.maximum(0.01 * wraps, 20 * period)):
            restarts.append(at + 1)
    if restarts:
        rows = ", ".join(str(row + 1) for row in restarts[:6]) + (" ..." if len(restarts) > 6 else "")
        shown = f"time begins again at row{'s' * (len(restarts) > 1)} {rows} (it jumps back by {float(drops.max()):.4g} s)"
        said = f"{shown}: several recordings, or copies of one, are one below the other; keep those of one, as the first {restarts[0]}"
        raise DataError(said, code="several_recordings")


def check_rate(clock: Clock, stated: tuple[float, str] | None, found: list[Finding], names: str) -> None:
    """Compare a clock with a rate stated elsewhere, and with plausible rates."""
    rate = 1.0 / clock.period if clock.period else np.nan
    if not np.isfinite(rate):
        return
    if rate > _stamps.USUAL["highest"] and clock.unit in _stamps.SECONDS and clock.unit != "ns":
        raise _wrong_unit("the clock {names} in {unit} ({why}) would be {rate:.4g} Hz, which no recording has", clock, names, rate)
    mean = 1.0 / clock.mean if clock.mean else rate
    if stated is not None and min(abs(rate / stated[0] - 1), abs(mean / stated[0] - 1)) > 0.1:
        for power in (-6, -4, -3, -1, 1, 3, 4, 6):
            if abs(rate / stated[0] * 10.0**power - 1) < 0.1:
                said = "{source} {stated:g} Hz, but the clock {names} in {unit} ({why}) gives {rate:.4g} Hz"
                raise _wrong_unit(said, clock, names, rate, source=stated[1], stated=stated[0])
        if stated[1] != "the file states":  # in this case `_build` in `_read` adds the finding
            found.append(READ("rate_differs", source=stated[1], stated=stated[0], rate=rate))
    if rate < 0.5 and clock.unit != "date" and stated is None:
        found.append(READ("slow_clock", clock=names, unit=clock.unit, step=clock.period))


def _wrong_unit(said: str, clock: Clock, names: str, rate: float, **more: Any) -> DataError:
    """Error for a clock whose rate is impossible, or contradicts the one that is stated."""
    remedy = ": its unit is wrong; give it with {option.units:time={other}}, or {option.rate} and {option.columns:time=none}"
    facts = {"names": names, "unit": clock.unit, "why": clock.reason or "as given", "rate": rate, "other": clock.other or "s", **more}
    return DataError(Message(said + remedy, **facts), code="time_unit")


def no_clock(table, counters: list[str]) -> DataError:
    """Error for a table without a clock and without a rate."""
    counted = f"; {', '.join(counters)} counts rows and is no time" if counters else ""
    for i, name in enumerate(table.names):
        column = table.columns[i]
        if _STEPS_OF_TIME.fullmatch(plain(name)) and column.dtype.kind in "iuf" and (step := float(np.nanmedian(column))) > 0:
            counted += f"; {name} holds the steps of time, {step:g} in the median: 1 over it, in s, is the rate"
    words = [i for i, name in enumerate(table.names) if name and table.columns[i].dtype.kind == "O" and _LIKE_TIME.search(name)]
    for i in words[:1]:
        shown = next((str(value) for value in table.columns[i] if value is not None), "")
        counted += f"; {table.names[i]} holds {shown[:40]!r}, which is not understood: write seconds, or 2024-05-01 12:00:00.010"
    said = "there is no time column among {listed}{counted}; give {option.rate:HZ}, or name the column with {option.columns:time=...}"
    return DataError(Message(said, listed=listing(table.names, len(table.columns)), counted=counted), code="no_rate")


def label_of(table: Any, indices: list[int]) -> str:
    """Label columns by name, or by number if they have none."""
    return " and ".join(table.names[i] or f"column {i}" for i in indices)
