"""Place recorded time stamps on a uniform grid, and report every repair as a finding."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from ._answer import Finding
from ._errors import DataError
from ._log_findings import LOG
from ._message import Message
from ._quality import all_finite
from ._units import units_of

#: ranges at which counters wrap, of stamps (ticks) and of readings (steps)
WRAPS = (2.0**15, 2.0**16, 2.0**31, 2.0**32)
#: a step longer than this many periods that later steps do not make up is a gap
GAP = 1.5
#: largest relative difference between rate= and the stamps
_RATE_TOLERANCE = 0.005

#: periods of a jump that may part two recordings in one file
_FAR = 50

#: share of samples with the stamp of the one before, and of those the share with other values, above which stamps are coarse
_SHARED, _DIFFER = 0.05, 0.1

#: samples in the running median of the stamps' differences from the grid
_SMOOTH = 101

ADVICE = Message(
    "check that the right column is read as time ({option.columns:time=...}), or leave the stamps out ({option.columns:time=none}) and "
    "give {option.rate}"
)


@dataclasses.dataclass(frozen=True)
class Placement:
    """Position of each sample: `source` rows (None: all, in order) go to `slot`s (None: one after the other) of a grid of `size`."""

    source: np.ndarray | None
    slot: np.ndarray | None
    size: int
    rate: float
    start: float
    stamps: np.ndarray | None = None  # of the samples, sorted and unwrapped
    findings: tuple[Finding, ...] = ()


def counted(size: int, rate: float | None) -> Placement:
    """Place samples without stamps one after the other, at a given rate."""
    if rate is None:
        raise DataError(Message("no time stamps: give {option.rate:HZ}, or the time column"), code="no_rate")
    if size < 2:
        raise DataError(f"{size} sample: a recording needs at least 2", code="too_short")
    return Placement(None, None, size, rate, 0.0)


def place(stamps: np.ndarray, rate: float | None, equal: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Placement:
    """Place samples with the given stamps (s, in any order) on a uniform grid.

    `rate` is checked against the stamps, and kept if it agrees. ``equal(i, j)`` tells for which pairs of rows all sensors have the
    same values.
    """
    found: list[Finding] = []
    source = None
    if not all_finite(stamps):
        source = np.flatnonzero(np.isfinite(stamps))
        found.append(LOG("no_stamp", count=len(stamps) - len(source)))
        stamps = stamps[source]
    if len(stamps) < 2:
        count = f"{len(stamps)} sample{'s' * (len(stamps) != 1)}"
        raise DataError(f"{count}: a recording needs at least 2; check the file, or the columns that are read", code="too_short")
    mean_step = (float(stamps.max()) - float(stamps.min())) / (len(stamps) - 1)
    if mean_step and not 1e-9 < mean_step < 1e9:
        said = "the time stamps are {step:.3g} s apart on average; give their unit with {option.units:time=...}, or {advice}"
        raise DataError(Message(said, step=mean_step, advice=ADVICE), code="time_unit")
    steps = np.diff(stamps)
    if steps.min() < 0:
        stamps = _unwrap(stamps, found)
    stamps, source = _one_recording(stamps, source, found)
    steps = np.diff(stamps)
    if steps.min() <= 0:
        if steps.min() < 0:
            stamps, source = _sort(stamps, source, found)
        if stamps[-1] == stamps[0]:
            raise _no_clock("all {count} time stamps are equal ({value:g} s)", "equal_stamps", count=len(stamps), value=float(stamps[0]))
        stamps, source = _drop_duplicates(stamps, source, equal, found)
        steps = np.diff(stamps)

    period, even = _period(stamps, steps)
    missing, at = _gaps(steps, period, even)
    regular = np.ones(len(steps), bool)
    regular[at] = False
    kept = steps if not len(at) else steps[regular]
    if not kept.any():
        raise _no_clock("no two of the {count} time stamps follow each other without a gap", "only_gaps", count=len(stamps))
    estimate = len(kept) / float(kept.sum())
    waits = np.flatnonzero(steps > GAP * period) if not even else np.zeros(0, np.int64)
    rises = (waits if len(waits) > 3 or even else np.flatnonzero(steps > 0)) + 1
    if len(rises) > 3:
        # fewer samples may share the first and the last of repeated stamps, so leave these out
        inner = steps[rises[0] : rises[-1]][regular[rises[0] : rises[-1]]]
        estimate = len(inner) / float(inner.sum()) if inner.any() else estimate
    # use no more digits than the stamps carry, so that steps of 0.01 s give 100 Hz
    carried = np.spacing(np.abs(stamps[[0, -1]]).max()) / (stamps[-1] - stamps[0])
    estimate = float(f"{estimate:.{int(np.clip(-np.log10(carried), 6, 12))}g}")
    jitter = float(np.sqrt(np.mean((kept - 1.0 / estimate) ** 2)) * estimate)
    _describe(stamps, steps, estimate, jitter, even, found)
    chosen = _agreed_rate(rate, estimate, found)

    slot, size = None, len(stamps)
    if len(at):
        increments = np.ones(len(steps), np.int64)
        increments[at] += missing
        slot = np.concatenate([[0], np.cumsum(increments)])
        size = int(slot[-1]) + 1
    return Placement(source, slot, size, chosen, float(stamps[0]), stamps, tuple(found))


def _no_clock(said: str, code: str, **facts: Any) -> DataError:
    """Error for stamps that are no clock, with what to do."""
    return DataError(Message(said + "; {advice}", advice=ADVICE, **facts), code=code)


def nearest(own: Placement, grid: Placement) -> tuple[np.ndarray, np.ndarray]:
    """Row of a grid nearest to each sample on another grid (-1: none), and by how much later than the row the sample is, s."""
    slot, when, then = _slots(grid), _instants(grid), _instants(own)
    at = np.interp(then, when, slot)
    # up to half a step before the first row and after the last one
    for end, beyond in ((0, then < when[0]), (-1, then > when[-1])):
        at[beyond] = slot[end] + (then[beyond] - when[end]) * grid.rate
    row = np.full(len(at), -1)
    inside = (at > -0.5) & (at < grid.size - 0.5)
    row[inside] = np.round(at[inside])
    return row, (at - row) / grid.rate


def _slots(grid: Placement) -> np.ndarray:
    return np.arange(grid.size) if grid.slot is None else grid.slot


def _instants(grid: Placement) -> np.ndarray:
    """When each sample was taken, s, by its clock. Stamps jitter about evenly spaced samples, and a gap shifts them by a part of a step."""
    slot = _slots(grid)
    if grid.stamps is None:
        return slot / grid.rate
    even = np.polynomial.Polynomial.fit(slot, grid.stamps, 1)(slot)
    return np.maximum.accumulate(even + scipy.ndimage.median_filter(grid.stamps - even, _SMOOTH, mode="reflect"))


def _unwrap(stamps: np.ndarray, found: list[Finding]) -> np.ndarray:
    """Undo the overflow of a 16, 31 or 32 bit counter: a step back that becomes an ordinary step if the counter's range is added."""
    steps = np.diff(stamps)
    back = np.flatnonzero(steps < 0)
    period = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    for ticks in WRAPS:
        for tick in sorted(units_of("time").values()):
            span = ticks * tick
            if span < 20 * period:
                continue
            wrapped = back[np.abs(steps[back] + span - period) < min(10 * period, span / 4)]
            # after a wrap the counter continues from below; after a late stamp it jumps up again
            wrapped = wrapped[[not np.any(steps[i + 1 : i + 50] > span / 2) for i in wrapped]]
            if len(wrapped):
                turns = np.zeros(len(stamps))
                turns[wrapped + 1] = span
                found.append(LOG("wraps", count=len(wrapped), bits=int(np.log2(ticks)), tick=tick))
                return stamps + np.cumsum(turns)
    return stamps


def _one_recording(stamps: np.ndarray, source: np.ndarray | None, found: list[Finding]) -> tuple[np.ndarray, np.ndarray | None]:
    """The longest of several recordings in one file: where the stamps start again, or go on after a gap in other steps."""
    steps = np.diff(stamps)
    period = float(np.median(steps[steps > 0])) if np.any(steps > 0) else np.inf
    far, alike = _FAR * period, _FAR + 1

    def even(part: np.ndarray) -> float:
        """The usual step of stamps that are a clock; otherwise NaN."""
        if len(part) < alike:
            return np.nan
        usual = float(np.median(part))
        return usual if usual > 0.0 and np.mean(np.abs(part - usual) < 0.2 * usual) > 0.9 else np.nan

    def apart(i: int) -> bool:
        if steps[i] < 0:  # parts in the wrong order are sorted, and a late stamp is followed by a jump back to the others
            return bool(stamps[i + 1 :].max() > stamps[: i + 1].min()) and not np.any(steps[i + 1 : i + alike] > -steps[i] / 2)
        return bool(abs(np.log(even(steps[:i]) / even(steps[i + 1 :]))) > 0.05)

    back = np.flatnonzero(steps < -far)
    cuts = [i for i in {*(back.tolist() if len(back) <= 2 else ()), int(np.argmax(steps))} if abs(steps[i]) > far and apart(i)]
    if not cuts:
        return stamps, source
    edges = np.array([0, *(i + 1 for i in sorted(cuts)), len(stamps)])
    longest = int(np.argmax(np.diff(edges)))
    part = slice(edges[longest], edges[longest + 1])
    found.append(LOG("recordings", count=len(edges) - 1, rows=f"{part.start} to {part.stop - 1}", total=len(stamps)))
    return stamps[part], np.arange(len(stamps))[part] if source is None else source[part]


def _sort(stamps: np.ndarray, source: np.ndarray | None, found: list[Finding]) -> tuple[np.ndarray, np.ndarray | None]:
    largest = -np.diff(stamps).min()
    if largest <= 0:
        return stamps, source
    late = np.count_nonzero(np.maximum.accumulate(stamps) > stamps)
    found.append(LOG("unsorted", count=late, back=float(largest)))
    order = np.argsort(stamps, kind="stable")
    steps = np.diff(stamps)
    backs, period = np.count_nonzero(steps < 0), float(np.median(steps[steps > 0])) if np.any(steps > 0) else np.inf
    far = np.count_nonzero(steps < -5 * period)
    # a late sample is put in its place; a clock that goes far back again and again has no place for it
    if far > max(2, 0.005 * len(steps)) or (backs > 0.05 * len(steps) and np.median(np.diff(stamps[order])) < 0.6 * period):
        said = ("the time stamps go back {count} times, by up to {back:.4g} s, as those of a counter that begins again and again, or of "
                "several recordings in turn")  # fmt: skip
        raise _no_clock(said, "irregular", count=backs, back=float(largest))
    return stamps[order], order if source is None else source[order]


def _drop_duplicates(stamps, source, equal, found: list[Finding]) -> tuple[np.ndarray, np.ndarray | None]:
    """Keep one of the samples with equal stamp and equal values; samples with different values are spaced evenly later.

    Where many samples share a stamp and differ, the stamps are coarse, and coarse values are equal by chance: these are no copies.
    """
    same = np.flatnonzero(np.diff(stamps) == 0)
    if not len(same):
        return stamps, source
    rows = np.arange(len(stamps)) if source is None else source
    copies = same[equal(rows[same], rows[same + 1])]
    if len(same) > _SHARED * len(stamps) and len(same) - len(copies) > _DIFFER * len(same):
        copies = same[:0]
    if len(copies):
        found.append(LOG("copies", count=len(copies)))
    if others := len(same) - len(copies):
        found.append(LOG("same_stamp", count=others))
    keep = np.ones(len(stamps), bool)
    keep[copies + 1] = False
    if len(copies) == len(stamps) - 1:
        raise DataError(f"the {len(stamps)} samples are copies of one; check the file", code="copies")
    return (stamps[keep], rows[keep]) if len(copies) else (stamps, source)


def _period(stamps: np.ndarray, steps: np.ndarray) -> tuple[float, bool]:
    """Sampling period, robust against gaps, and whether single steps show it (False for bursts or coarse stamps)."""
    if steps.max() < 1.05 * steps.min():  # for nearly equal steps, all medians agree
        return float(np.mean(steps)), True
    median = float(np.median(steps if steps.min() > 0 else steps[steps > 0]))
    block = max(1, min(256, len(steps) // 8))
    typical = float(np.median(stamps[block::block] - stamps[:-block:block])) / block
    # if half of the samples are lost, the median and the mean step agree on the wrong period
    if abs(typical / median - 1.0) > 0.05 or np.count_nonzero(steps < 0.75 * median) > 0.1 * len(steps):
        lossy = _period_of_lossy(stamps, steps)
        if lossy is None and abs(typical / median - 1.0) > 0.05:
            _refuse_irregular(stamps, steps, typical)
            return typical, False
        median = lossy or median
    near = (steps > 0.5 * median) & (steps < GAP * median)
    if not near.any():
        _refuse_irregular(stamps, steps, typical)
        return typical, False
    return float(np.mean(steps if near.all() else steps[near])), True


def _period_of_lossy(stamps: np.ndarray, steps: np.ndarray) -> float | None:
    """Period if long steps are lost samples: they are whole multiples of the period and, unlike coarse stamps, deviate from any line."""
    shortest = np.quantile(steps, 0.1)
    period = float(np.mean(steps[steps <= GAP * shortest]))
    ratio = steps / period if period > 0 else np.zeros(1)
    whole = (np.abs(ratio - np.round(ratio)) < 0.2) & (ratio > 0.5)
    lossy = np.mean(whole) > 0.98 and _clock_deviation(stamps, 512) > 0.75 * period and not _in_bursts(steps, period)
    return period if lossy else None


def _in_bursts(steps: np.ndarray, period: float) -> bool:
    """Whether samples come in bursts: long waits, each in proportion to the number of samples before it; lost samples have no such law."""
    waits = np.flatnonzero(steps > GAP * period)
    if len(waits) < 8 or steps.sum() < 1.5 * period * len(steps):
        return False
    counts = np.diff(waits)
    lasted = np.diff(np.concatenate([[0.0], np.cumsum(steps)])[waits + 1])
    rest = lasted - counts * (lasted.sum() / counts.sum())
    return bool(np.std(rest) < 0.25 * np.mean(lasted))


def _refuse_irregular(stamps: np.ndarray, steps: np.ndarray, period: float) -> None:
    """Refuse stamps that are no clock. Bursts and coarse stamps stay near an even clock, within about the wait between two bursts."""
    if period == 0.0:
        raise _no_clock("most of the {count} time stamps equal their neighbours", "equal_stamps", count=len(stamps))
    long = steps[steps > GAP * period]
    wait, burst = (float(np.median(long)), len(steps) // len(long)) if len(long) else (period, 1)
    deviation = _clock_deviation(stamps, max(512, 4 * burst))
    if deviation > 1.5 * wait:
        raise _no_clock("the time stamps stray {steps:.3g} steps from an even clock", "irregular", steps=deviation / period)


def _clock_deviation(stamps: np.ndarray, length: int) -> float:
    """Largest distance from a line through (index, stamp), typical for blocks of `length` samples."""
    length = min(length, len(stamps))
    blocks = stamps[: len(stamps) // length * length].reshape(-1, length)
    blocks = blocks - blocks.mean(axis=1, keepdims=True)
    index = np.arange(length) - (length - 1) / 2
    slope = blocks @ index / (index @ index)
    return float(np.median(np.abs(blocks - slope[:, None] * index[None, :]).max(axis=1)))


def _gaps(steps: np.ndarray, period: float, even: bool) -> tuple[np.ndarray, np.ndarray]:
    """Number of missing samples in each step that is a gap, and indices of these steps.

    A long step is a gap only if the lag behind an even clock stays. The short steps around it make up for a late stamp, or for the wait
    between two bursts.
    """
    long = np.flatnonzero(steps > GAP * period)
    if not len(long):
        return np.zeros(0, np.int64), long
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    # the window must be wide enough for a burst
    window = 20 if even else int(np.clip(3 * (len(steps) // len(long)), 20, 5000))
    lag = np.concatenate([[0.0], np.cumsum(steps - period)])
    least_after = minimum_filter1d(lag, window, mode="nearest", origin=-(window // 2))[long + 1]
    most_before = maximum_filter1d(lag, window, mode="nearest", origin=(window - 1) // 2)[long]
    lost = least_after - most_before
    if even:
        # the extremes of 20 jittered stamps are 1.87 sigma out on either side
        lost += 2 * 1.87 * np.std(steps[(steps > 0.5 * period) & (steps < GAP * period)]) / np.sqrt(2.0)
        missing = lost
    else:
        missing = least_after - minimum_filter1d(lag, window, mode="nearest", origin=(window - 1) // 2)[long]
    real = lost > 0.5 * period
    missing, at = np.maximum(np.round(missing[real] / period), 1.0), long[real]
    n, total = len(steps) + 1, float(missing.sum())
    if total > max(n, 1_000_000, min(10 * n, 20_000_000)):
        said = (
            "the recording of {n} samples has {total:.3g} missing ones ({gaps} gaps, the longest {longest}); split it at the long gaps, "
            "or, if the time unit is wrong, give it with {option.units:time=...}"
        )
        raise DataError(Message(said, n=n, total=total, gaps=len(at), longest=span(float(steps[at].max()))), code="too_many_missing")
    if len(at) > 0.6 * len(steps):
        raise _no_clock("{gaps} of {steps} steps in time are gaps", "irregular", gaps=len(at), steps=len(steps))
    return missing.astype(np.int64), at


def _describe(stamps, steps, rate: float, jitter: float, even: bool, found: list[Finding]) -> None:
    """Add findings on the regularity of the stamps."""
    single = ""
    if np.spacing(np.float32(np.abs(stamps[-1]))) > 0.01 / rate and all(
        np.array_equal(part.astype(np.float32), part) for part in (stamps[:1000], stamps)
    ):
        single = " (they are single precision)"
    if not even:
        head = steps[:4096] if steps[:4096].any() else steps
        lengths = np.unique(np.round(head * rate, 3)) / rate
        resolution = min(np.diff(lengths).min(initial=np.inf), lengths[lengths > 0].min())
        code = "coarse_stamps" if len(lengths) < 4 else "bursts"
        found.append(LOG(code, rate=rate, resolution=float(resolution), single=single))
    else:
        found += LOG.over("jitter", jitter, percent=100 * jitter, rate=rate, single=single)


def _agreed_rate(rate: float | None, estimate: float, found: list[Finding]) -> float:
    if rate is None:
        return estimate
    difference = rate / estimate - 1.0
    if abs(difference) > _RATE_TOLERANCE:
        said = (
            "a rate of {rate:g} Hz contradicts the time stamps, which say {estimate:.6g} Hz; leave {option.rate} out, correct the time "
            "unit ({option.units:time=...}), or leave the stamps out ({option.columns:time=none})"
        )
        raise DataError(Message(said, rate=rate, estimate=estimate), code="rate_contradicts")
    if abs(difference) > 1e-6:
        found.append(LOG("rate_given", rate=rate, estimate=estimate))
    return float(rate)


def span(seconds: float) -> str:
    """A length of time in words, such as 2 h 46 min 40 s."""
    if seconds >= 2 * 365.25 * 86400:
        return f"{seconds / (365.25 * 86400):.1f} years"
    if seconds >= 2 * 86400:
        return f"{seconds / 86400:.1f} days"
    if seconds < 60:
        return f"{seconds:.4g} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min {rest} s" if hours else f"{minutes} min {rest} s"
