"""Time stamps in one or two columns: unit from size and step, seconds with a separate fraction, times written as digits."""

import contextlib
import dataclasses
import re

import numpy as np

from .._errors import DataError
from .._message import Message
from .._units import factor
from ._columns import scale
from ._names import TIME_UNITS, words_of

SECONDS = {unit: factor(unit, "time") for unit in ("s", "ms", "us", "ns")}
DAY = factor("d", "time")
#: what a column of numbers may count: who counts so ("": time since some start), the unit, and limits of the first stamp
_HYPOTHESES = (
    *(("", unit, -np.inf, np.inf) for unit in SECONDS), *(("since 1970", unit, 1e9 / size, 4e9 / size) for unit, size in SECONDS.items()),
    ("in Modified Julian Dates", "mjd", 40_000.0, 100_000.0), ("in Windows", "1e-7 s", 1.25e17, 1.6e17),
    ("in .NET", "1e-7 s", 6.3e17, 6.7e17), ("in MATLAB", "d", 7.3e5, 7.7e5), ("in Julian Dates", "d", 2.4e6, 2.5e6),
)  # fmt: skip
#: decimal logarithm of odds above which a clock is no guess: another unit would be less than one in a hundred
_SURE = 2.0
#: Hz: the most common rate of recordings of sensors and of clocks, and the highest of any
USUAL = {"sensor": 70.0, "clock": 0.01, "highest": 20_000.0}


@dataclasses.dataclass
class Clock:
    """Time stamps in s (or dates) from `columns`, their unit, the reason for it, and whether there is evidence besides plausibility."""

    columns: list[int]
    time: np.ndarray
    unit: str
    reason: str = ""
    other: str = ""
    sure: bool = True
    epoch_ns: int = 0

    @property
    def seconds(self) -> np.ndarray:
        """Time stamps in s; dates are relative to the first."""
        if self.time.dtype.kind == "M":
            ns = self.time.astype("datetime64[ns]").astype(np.int64)
            return np.where(np.isnat(self.time), np.nan, (ns - ns[0]) * 1e-9)
        return self.time

    @property
    def period(self) -> float:
        """Median positive step, s, or the mean step if several samples share a time stamp; NaN without a positive step."""
        steps = np.diff(self.seconds)
        steps = steps[np.isfinite(steps) & (steps >= 0)]
        rising = steps[steps > 0]
        if not len(rising):
            return np.nan
        return float(np.median(rising)) if len(rising) > 0.7 * len(steps) else float(np.median(rising)) * len(rising) / len(steps)

    @property
    def mean(self) -> float:
        """Mean step, s."""
        seconds = self.seconds[np.isfinite(self.seconds)]
        return float(seconds.max() - seconds.min()) / max(len(seconds) - 1, 1) if len(seconds) else np.nan

    @property
    def distinct(self) -> float:
        """Share of the samples with distinct time stamps."""
        seconds = self.seconds[: 1 << 16]
        seconds = seconds[np.isfinite(seconds)]
        return len(np.unique(seconds)) / len(seconds) if len(seconds) else 0.0


def together(table, indices: list[int], sizes: list[float]) -> Clock:
    """Clock from the parts of a time in several columns, in units of `sizes` s: a date and a time of day, hours to fractions of seconds."""
    first, *rest = (np.asarray(table.columns[i]) for i in indices)
    dated, of_day = first.dtype.kind == "M", indices[0] in table.clocks or len(indices) > 2
    fraction = indices[-1] not in table.clocks and sizes[-1] < 1.0
    parts = [column.astype(np.float64) * size for column, size in zip(rest, sizes[1:], strict=True) if column.dtype.kind != "M"]
    known = np.isfinite([*parts, parts[-1] if dated else first.astype(np.float64)]).all(axis=0) if parts else np.zeros(1, bool)
    if not known.any() or (fraction and not 0.0 <= parts[-1][known].min() <= parts[-1][known].max() < 1.0):
        shown = f"columns {', '.join(map(str, indices))} ({', '.join(table.names[i] for i in indices)})"
        said = "{shown} are no seconds with a fraction from 0 to {most:.9g}; name one time column with {option.columns:time=...}"
        raise DataError(Message(said, shown=shown, most=1 / sizes[-1]), code="two_columns")
    later = np.asarray(sum(parts))
    if dated:
        ns = np.where(known, np.round(later * 1e9), 0).astype(np.int64).astype("timedelta64[ns]")
        return Clock(indices, np.where(known, first + ns, np.datetime64("NaT")), "date", "dates and times in columns of their own")
    if of_day:
        return Clock(indices, since_midnight(first * sizes[0] + later), "time of day", "times of day in columns of their own")
    begin, small = first[known][0], next((unit for unit, one in SECONDS.items() if one == sizes[1]), "ns")
    return Clock(indices, first.astype(np.float64) - begin + later, f"s + {small}", f"s and {small}", epoch_ns=int(begin) * 10**9)


def of_day(table) -> list[int] | None:
    """Columns of the hour, the minute and the second, and of a fraction of it if there is one; None if a table has no such columns."""
    words = [re.sub(r"^(?:time|utc|gps|rtc|clock)(?=.)|[^a-z]", "", name.lower()) for name in table.names]
    found = []
    for names, top in (("h hh hr hour hours", 24), ("m mm min minute minutes", 60), ("s ss sec second seconds", 60)):
        fits = [i for i, word in enumerate(words) if word in names.split() and _within(table.columns[i], top)]
        if len(fits) != 1:
            return None
        found.append(fits[0])
    hours, minutes, seconds = (np.asarray(table.columns[i]) for i in found)
    if np.ptp(seconds) == 0 or np.any(hours % 1) or np.any(minutes % 1):
        return None
    sizes = {i: fraction_size(table.names[i]) for i, word in enumerate(words) if word}
    return [*found, *[i for i, size in sizes.items() if size and is_fraction(table, found[2], i, size)][:1]]


def fraction_size(name: str) -> float:
    """Size in s of the unit among the words of a name, ms, us or ns; 0 for other names."""
    units = (TIME_UNITS.get(word, "") for word in words_of(name))
    return next((SECONDS[unit] for unit in units if unit in ("ms", "us", "ns")), 0.0)


def _within(column: np.ndarray, top: int) -> bool:
    return column.dtype.kind in "iuf" and bool(np.isfinite(column).all() and column.min() >= 0 and column.max() < top)


def since_midnight(clock: np.ndarray) -> np.ndarray:
    """Unwrap times of day in s, which restart at midnight, or after an hour if the hours are missing."""
    turn = DAY if np.nanmax(clock) >= 3600 else 3600.0
    return clock + turn * np.cumsum(np.concatenate([[0], np.diff(clock) < -turn / 2]))


def is_fraction(table, whole: int, part: int, size: float) -> bool:
    """Whether a column counts fractions of a second, and returns to zero when another column begins a new second."""
    column, seconds = table.columns[part], table.columns[whole]
    if column.dtype.kind not in "iuf" or seconds.dtype.kind not in "Miuf" or part in table.clocks or not np.isfinite(column).all():
        return False
    if column.min() < 0 or not 0.5 < column.max() * size < 1.0:
        return False
    falls = np.diff(column.astype(np.float64)) * size < -0.5
    steps = np.diff(seconds) / np.timedelta64(1, "s") if seconds.dtype.kind == "M" else np.diff(seconds.astype(np.float64))
    return bool(falls.any() and np.mean((steps[falls] == 1.0) | (steps[falls] == -59.0)) > 0.9 and np.mean(steps[~falls] == 0.0) > 0.9)


def from_digits(column: np.ndarray) -> np.ndarray | None:
    """Convert times of day written as digits HHMMSS, with or without decimals, or HHMMSSmmm, to s; None for other numbers.

    A counter takes all values; in times of day, seconds and minutes never exceed 59, and the number jumps when a minute begins.
    """
    values = column[np.isfinite(column)].astype(np.float64) if column.dtype.kind in "iuf" else np.zeros(0)
    if len(values) < 20 or values.min() < 0 or values.max() >= 240_000e6:
        return None
    for size in (1.0, 1e3, 1e6):
        hours, minutes, seconds = values / size // 1e4, values / size // 100 % 100, values / size % 100
        if hours.max() >= 24 or minutes.max() >= 60 or seconds.max() >= 60 or np.ptp(values) <= 40 * size:
            continue
        clock = hours * 3600 + minutes * 60 + seconds
        steps, begun = np.diff(clock), np.diff(minutes) != 0
        typical = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
        if np.any(begun) and typical > 0 and np.abs(steps[begun]).max() < max(5 * typical, 2.0):
            out = np.full(len(column), np.nan)
            out[np.isfinite(column)] = clock
            return out
    return None


def from_date_digits(column: np.ndarray) -> np.ndarray | None:
    """Convert dates written as digits YYYYMMDDHHMMSS, perhaps with a fraction of a second, to dates; None for other numbers."""
    if column.dtype.kind not in "iuf" or len(column) < 3 or not np.isfinite(column).all():
        return None
    for size in (1, 1000, 1_000_000):
        if not 19e12 * size < column.min() <= column.max() < 21e12 * size:
            continue
        seconds, fraction = np.divmod(column, size if column.dtype.kind in "iu" else float(size))
        ns = np.round((fraction / size + (seconds - seconds.astype(np.int64))) * 1e9).astype("timedelta64[ns]")
        digits = [f"{one[:4]}-{one[4:6]}-{one[6:8]}T{one[8:10]}:{one[10:12]}:{one[12:]}" for one in seconds.astype(np.int64).astype(str)]
        with contextlib.suppress(ValueError):
            return np.array(digits, "datetime64[ns]") + ns
    return None


def unit_by_step(stamps: np.ndarray, integer: bool, rate: float | int | None, usual: float) -> tuple[str, str, str, bool]:
    """Unit of time stamps without a stated unit, the reason, the next best unit, and whether it is certain.

    Every hypothesis gets points, decimal logarithms of odds: the rates and lengths that recordings have, a start some time after the
    sensor was switched on, an epoch of this century, agreement with `rate`, and jitter that fits the size of a tick. `usual` is the most
    common rate of such recordings, Hz.
    """
    seen = stamps[np.isfinite(stamps)]
    steps = np.diff(seen)
    rising = steps[steps > 0]
    if not len(rising):
        said = "the time column never rises; name another one with {option.columns:time=...}, or give {option.rate:HZ}"
        raise DataError(Message(said), code="never_rises")
    step, mean = Clock([], seen, "").period, float(seen.max() - seen.min()) / (len(seen) - 1)
    start, stray = float(seen[0]), _loop_of_ticks(seen[:1000], rising[:1000]) if integer else False
    whole = not np.any(seen[:1000] % 1)  # whole numbers written with decimals are seconds
    offset = 0.0 if min(abs(start), abs(start - step)) < 0.1 * step else start  # it counts from the first sample
    found = []
    for who, unit, first, last in _HYPOTHESES:
        size = scale(unit, "time")[0]
        period, length, since = step * size, step * size * len(seen), offset * size
        if not first <= start <= last:
            continue
        points = -min(0.34 * np.log10(usual * period) ** 2, 4.0)  # a decade from the usual rate is rarer by two
        points -= 10.0 * (period * USUAL["highest"] < 1)
        points -= 0.3 * max(0.0, np.log10(10 / length), np.log10(length / DAY))
        if who:
            points += 3.0
        elif since > 0:
            points -= 0.7 * max(0.0, np.log10(0.1 / since), np.log10(since / (30 * DAY)))
        points += 1.5 * (whole and unit == "s" and not integer and not who)
        if rate is not None:
            points += 20.0 * (min(abs(1 / period / rate - 1), abs(1 / (mean * size) / rate - 1)) < 0.05)
        found.append((points - 5.0 * (stray and size < 1e-4), unit, who))
    points, unit, who = max(found)
    other_points, other, _ = max(one for one in found if one[1] != unit)
    reason = f"median step {step:.3g}, {'integer' if integer else 'decimal'}"
    if points > 5.0:
        return unit, f"{reason}: agrees with a rate of {rate:g} Hz", other, True
    if who:
        reason = f"starts at {start:.6g}, as time {who} does"
    doubt = other if points - other_points < _SURE else "a counter" if integer and step < 4 and not who else ""
    return unit, reason + f"; uncertain, could be {doubt}" * bool(doubt), other, not doubt


def _loop_of_ticks(stamps: np.ndarray, rising: np.ndarray) -> bool:
    """Whether steps differ by a tick or two and add up: a loop that a tick of 1 us would measure far more finely, and no even clock."""
    if np.ptp(np.quantile(rising, [0.02, 0.98])) > 2 or len(stamps) < 10:
        return False
    stamps = stamps - stamps[0]
    line = np.polynomial.Polynomial.fit(np.arange(len(stamps)), stamps, 1)(np.arange(len(stamps)))
    return bool(np.ptp(stamps - line) > 2.5)
