"""Time stamps in one or two columns: unit from size and step, seconds with a separate fraction, times written as digits."""

import dataclasses
import re

import numpy as np

from .._errors import DataError
from .._message import Message
from .._units import factor
from ._columns import scale

SECONDS = {unit: factor(unit, "time") for unit in ("s", "ms", "us", "ns")}
DAY = factor("d", "time")
#: clocks that the size of their stamps tells in this century: who counts so, the unit, limits of the stamps, and of the step (s)
_EPOCHS = (
    ("in Modified Julian Dates", "mjd", 40_000.0, 100_000.0, 4.0),  # with a longer step the numbers may also be seconds
    *(("since 1970", unit, 1e9 / size, 4e9 / size, 10.0) for unit, size in SECONDS.items()),
    ("in Windows", "1e-7 s", 1.25e17, 1.6e17, 10.0), ("in .NET", "1e-7 s", 6.3e17, 6.7e17, 10.0), ("in MATLAB", "d", 7.3e5, 7.7e5, 4.0),
)  # fmt: skip
#: unit, upper limit of its median step, and the range of steps in which it may also be this unit or the next; whole numbers are not in s
_STEPS = (("s", 0.5, 0.2, 3.0), ("ms", 300.0, 100.0, 1000.0), ("us", 3e5, 1e5, 1e6), ("ns", np.inf, np.inf, np.inf))


@dataclasses.dataclass
class Clock:
    """Time stamps in s (or dates) from `columns`, their unit, the reason for it, and whether there is evidence besides plausibility."""

    columns: list[int]
    time: np.ndarray
    unit: str
    reason: str = ""
    other: str = "s"
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


def pair(table, indices: list[int], columns: list[np.ndarray], size: float) -> Clock:
    """Clock from two columns: a date and a time of day, or seconds and a fraction in units of `size` s."""
    fraction = np.asarray(columns[1]).astype(np.float64)
    if columns[0].dtype.kind == "M" and columns[1].dtype.kind != "M":
        seconds = fraction if indices[1] in table.clocks else fraction * size
        ns = np.where(np.isfinite(seconds), np.round(seconds * 1e9), 0).astype(np.int64).astype("timedelta64[ns]")
        time = columns[0] + ns
        time[~np.isfinite(seconds)] = np.datetime64("NaT")
        return Clock(indices, time, "date", "a date and a time of day" if indices[1] in table.clocks else "dates and a fraction of seconds")
    whole = np.asarray(columns[0]).astype(np.float64)
    known = np.isfinite(whole) & np.isfinite(fraction) if "M" not in (columns[0].dtype.kind, columns[1].dtype.kind) else np.zeros(1, bool)
    if not known.any() or fraction[known].min() < 0 or fraction[known].max() * size >= 1.0:
        shown = f"columns {indices[0]} and {indices[1]} ({', '.join(table.names[i] for i in indices)})"
        said = "{shown} are no seconds with a fraction from 0 to {most:.9g}; name one time column with {option.columns:time=...}"
        raise DataError(Message(said, shown=shown, most=1 / size), code="two_columns")
    if indices[0] in table.clocks:
        return Clock(indices, since_midnight(whole + fraction * size), "time of day", "times of day and a fraction of seconds")
    first = whole[known][0]
    small = next((unit for unit, one in SECONDS.items() if one == size), "ns")
    return Clock(indices, (whole - first) + fraction * size, f"s + {small}", f"s and {small}", "s", True, int(first) * 10**9)


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
    """Size in s of the unit that a name ends with, ms, us or ns; 0 for other names."""
    word = re.sub(
        r"sec(?:onds?)?|econds?", "s", re.sub(r"milli|micro|nano", lambda match: {"c": "u"}.get(match[0][2], match[0][0]), name.lower())
    )
    word = re.sub(r"[^a-z]", "", word)
    return next((size for unit, size in SECONDS.items() if unit != "s" and word.endswith(unit)), 0.0)


def _within(column: np.ndarray, top: int) -> bool:
    return column.dtype.kind in "iuf" and bool(np.isfinite(column).all() and column.min() >= 0 and column.max() < top)


def since_midnight(clock: np.ndarray) -> np.ndarray:
    """Unwrap times of day in s, which restart at midnight, or after an hour if the hours are missing."""
    turn = DAY if np.nanmax(clock) >= 3600 else 3600.0
    return clock + turn * np.cumsum(np.concatenate([[0], np.diff(clock) < -turn / 2]))


def is_fraction(table, whole: int, part: int, size: float) -> bool:
    """Whether a column counts fractions of a second, and returns to zero when another column begins a new second."""
    column, seconds = table.columns[part], table.columns[whole]
    if column.dtype.kind not in "iuf" or part in table.clocks or not np.isfinite(column).all():
        return False
    if column.min() < 0 or not 0.5 < column.max() * size < 1.0:
        return False
    falls = np.diff(column.astype(np.float64)) * size < -0.5
    if seconds.dtype.kind == "M":
        steps = np.diff(seconds) / np.timedelta64(1, "s")
    elif seconds.dtype.kind in "iuf":
        steps = np.diff(seconds.astype(np.float64))
    else:
        return False
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
        whole = seconds.astype(np.int64)
        ns = np.round((fraction / size + (seconds - whole)) * 1e9).astype(np.int64)
        year, month, day, hour, minute, second = (whole // 10**k % 100 if k < 10 else whole // 10**k for k in (10, 8, 6, 4, 2, 0))
        if min(month.min(), day.min()) < 1 or np.any(np.max([month, day, hour, minute, second], axis=1) > [12, 31, 23, 59, 59]):
            return None
        months = ((year - 1970) * 12 + month - 1).astype("datetime64[M]")
        days = months.astype("datetime64[D]") + (day - 1)
        return (
            days.astype("datetime64[ns]")
            + (hour * 3600 + minute * 60 + second) * np.timedelta64(10**9, "ns")
            + ns.astype("timedelta64[ns]")
        )
    return None


def unit_by_step(stamps: np.ndarray, integer: bool, rate: float | int | None) -> tuple[str, str, bool]:
    """Unit of time stamps without a stated unit: from agreement with `rate`, from an epoch, or from the median step."""
    steps = np.diff(stamps)
    steps = steps[(steps > 0) & np.isfinite(steps)]
    if not len(steps):
        said = "the time column never rises; name another one with {option.columns:time=...}, or give {option.rate:HZ}"
        raise DataError(Message(said), code="never_rises")
    step = float(np.median(steps))
    seen = f"median step {step:.3g}, {'integer' if integer else 'decimal'}"
    start = float(stamps[np.isfinite(stamps)][0])
    if rate is not None:
        mean = (len(stamps) - 1) / float(np.nanmax(stamps) - np.nanmin(stamps))
        for unit, seconds in SECONDS.items():
            if min(abs(1 / (step * seconds) / rate - 1), abs(mean / seconds / rate - 1)) < 0.05:
                return unit, f"{seen}: agrees with a rate of {rate:g} Hz", True
    for who, unit, first, last, most in _EPOCHS:
        seconds = step * scale(unit, "time")[0]
        # require a plausible rate, or the given one, because a time since boot may look like an epoch
        likely = 1e-6 < seconds < most or (rate is not None and abs(1 / seconds / rate - 1) < 0.05)
        if first <= start <= last and likely and not (integer and unit == "mjd"):
            return unit, f"starts at {start:.6g}, as time {who} does", True
    rows = _STEPS[integer:]
    at = next(i for i, (_, upper, _, _) in enumerate(rows) if step < upper)
    unit, _, low, _ = rows[at]
    other = rows[at + 1][0] if step >= low else rows[at - 1][0] if at and step <= rows[at - 1][3] else ""
    if other:
        return unit, f"{seen}; uncertain, could be {other}", False
    if integer and step < 4:
        return unit, f"{seen}; uncertain, could be a counter", False
    return unit, seen, True
