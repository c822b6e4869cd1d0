"""Readings that are no measurement: repeated, stuck, cut by a dead band or by the range. And values in steps, and a warm-up."""

from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import quantile, runs
from .._errors import DataError
from .._log_findings import LOG
from .._precision import real_numbers
from .._quality import all_finite
from .._timebase import WRAPS
from ._stretch import Stretch

#: repeats in a row that are a stuck sensor rather than a slow one or a repeated packet
STUCK = 50
#: so many long runs of repeats, in that share of the samples, are a slow sensor
_FEWEST, _SLOW = 3, 0.2
#: samples from which a spread is found to 1 %, and in which the step of the values is looked for
SAMPLE = 20_000
#: share of equal neighbours above which the noise is hidden by the step of the values: below, it is at least 0.45 steps
HIDDEN = 0.5
#: chance of a false finding in a record of noise
CHANCE = 0.01
#: efficiency of a spread by a median of sizes, relative to one by squares
EFFICIENCY = 0.37
#: share of the ends of repeats at which all axes change, relative to other rows: 1 for repeated readings, near 0 for equal coarse ones
_ALL_CHANGE = 0.7
#: samples at the end of the range that are no accident, and nonzero values just outside of a dead band that show its edge
FEW = 10
_DIGITS = 1e5  # steps of this many of the smallest: the digits of a float look like steps of the values
_LINE = 10.0  # a line of a spectrum is so much higher than its median; of noise, no line is higher than 5 times
_WARM_UP = 60.0  # s: length of the parts whose medians are compared


def columns_of(values: Any) -> np.ndarray:
    """Readings as (n, axes), of (n,) or (n, axes) real numbers."""
    values = real_numbers(values)
    if values.ndim not in (1, 2):
        raise DataError(f"values have shape {values.shape}; expected (n,) or (n, axes)", code="shape")
    return values.reshape(len(values), -1 if values.size else 1)


def held(values: Any) -> np.ndarray:
    """(n,) whether a row repeats the one before in all axes because no new reading came, and not because the values are coarse.

    When a reading is repeated, all axes stay, and at its end all axes change. Coarse values change one by one.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.evidence._values import held
    >>> y = np.random.default_rng(0).normal(size=(100, 3))
    >>> np.flatnonzero(held(np.repeat(y, 3, axis=0)))[:4].tolist(), int(held(np.round(y)).sum())
    ([1, 2, 4, 5], 0)
    """
    values = np.asarray(values)
    out = np.zeros(len(values), bool)
    alive = [column for column in values.T if np.fmin.reduce(column) < np.fmax.reduce(column)]
    if len(alive) < 2:
        return out
    equal = [column[1:] == column[:-1] for column in alive]
    repeats, changed = np.logical_and.reduce(equal), ~np.logical_or.reduce(equal)
    count = np.count_nonzero(repeats)
    if count < 3:
        return out
    # half of the repeats, less three: more than chance makes of as many rows with a new reading if each axis stays by its own share
    fresh, partly = len(repeats) - count, np.array([np.count_nonzero(one) - count for one in equal])
    half = 0.5 * (count - 3)
    chance = (fresh + half) * float(np.prod((partly + half) / max(fresh + half, 1.0)))
    starts, stops = runs(repeats)
    ends = np.concatenate([starts[starts > 0] - 1, stops[stops < len(repeats)]])
    usual = np.count_nonzero(changed) / max(fresh, 1)
    if chance > half or not usual > 0.0 or np.mean(changed[ends]) < _ALL_CHANGE * usual:
        return out
    out[1:] = repeats
    # a long run among short ones counts only if it begins and ends with new readings: else a coarse sensor lies still
    before = np.concatenate([[True], changed])[starts]
    after = np.concatenate([changed, [True]])[stops]
    for start, stop in zip(*(ends[(stops - starts >= STUCK) & ~(before & after)] for ends in (starts, stops)), strict=True):
        out[start + 1 : stop + 1] = False
    return out


def of_values(sensor: str, values: np.ndarray, rate: float, unit: str) -> list[Stretch]:
    """What is seen in the readings (n, axes) of a sensor themselves, at rest or not."""
    found: list[Stretch] = []
    if sensor != "temperature":
        starts, stops = runs(held(values))
        lengths = stops - starts
        long = lengths >= STUCK
        long &= np.count_nonzero(long) <= _FEWEST or lengths[long].sum() < _SLOW * len(values)
        axes = tuple(range(values.shape[1]))
        for first, last in zip(starts[long].tolist(), stops[long].tolist(), strict=True):
            found.append(Stretch("stuck", sensor, axes, first / rate, last / rate, samples=last - first))
        if not long.all():
            first, last, count = starts[~long][0], stops[~long][-1], lengths[~long].sum()
            found.append(Stretch("held", sensor, axes, float(first / rate), float(last / rate), samples=int(count)))
        for axis, column in enumerate(values.T):
            found += _zeroed(sensor, axis, column, rate, unit) if sensor == "gyro" else []
            found += _clipped(sensor, axis, column, rate, unit)
        found += _stopped(sensor, values, rate, found)
        found += _lost(sensor, values, rate)
        found += _resampled(sensor, values, rate, found)
    return [*found, *_coarse(sensor, values, rate, unit), *_warm_up(sensor, values, rate, unit)]


def unwrapped(sensor: str, values: np.ndarray, rate: float, unit: str) -> tuple[np.ndarray, list[Stretch]]:
    """The readings (n, axes) of a sensor, joined where a counter of 16 or 32 bits overflows, and these overflows.

    Such a jump is nearly as large as the whole range of the values, and an ordinary change is left if the range of the counter is taken
    off. The level is the one nearest to zero.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.evidence._values import unwrapped
    >>> y = np.round(np.random.default_rng(0).normal(size=(1000, 1)) * 30 + 20)
    >>> joined, found = unwrapped("gyro", y.astype(np.int16).astype(np.uint16).astype(float), 100.0, "counts")
    >>> bool((joined == y).all()), found[0].kind, found[0].size
    (True, 'wrapped', 65536.0)
    """
    found = []
    for axis, column in enumerate(values.T):
        step = common_step(_nearby(np.abs(np.diff(column[:SAMPLE]))))
        if not step or np.fmax.reduce(column) - np.fmin.reduce(column) < 0.5 * step * WRAPS[0]:
            continue
        there = np.flatnonzero(np.isfinite(column))
        known = column[there]
        change = np.diff(known)
        size = np.abs(change)
        far = size > 0.75 * np.ptp(known)
        if not far.any():
            continue
        usual = float(size[~far].max(initial=0.0))
        for span in (step * count for count in WRAPS if step * count > 4.0 * usual > 0.0):
            if np.abs(size[far] - span).max() <= 2.0 * usual:
                turns = np.concatenate([[0.0], np.cumsum(np.where(far, -np.sign(change), 0.0))])
                known = known + span * turns
                values = values.copy()
                values[there, axis] = known - span * np.round(np.median(known) / span)
                found.append(Stretch("wrapped", sensor, (axis,), *_between(there[1:][far], rate), span, unit, int(np.count_nonzero(far))))
                break
    return values, found


def masked(one: Stretch, values: np.ndarray, rate: float) -> np.ndarray:
    """(n, axes) which readings of a sensor belong to a stretch."""
    out = np.zeros(values.shape, bool)
    part = slice(round(one.start * rate), round(one.stop * rate))
    axes = list(one.axes)
    if one.kind == "held":
        out[part] = held(values)[part, None]
    elif one.kind in ("zeroed", "clipped"):
        out[part, axes] = values[part, axes] == (one.size if one.kind == "clipped" else 0.0)
    else:
        out[part, axes] = True
    return out


def at_own_rate(values: np.ndarray, rate: float) -> tuple[np.ndarray, float]:
    """The readings (m, axes) of a sensor that is slower than the log, and its own rate; those of any other sensor as they are.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.evidence._values import at_own_rate
    >>> slow = np.full((12, 1), np.nan)
    >>> slow[[0, 3, 9]] = 1.0
    >>> found, rate = at_own_rate(slow, 30.0)
    >>> found[:, 0].tolist(), rate
    ([1.0, 1.0, nan, 1.0], 10.0)
    """
    there = np.zeros(0, int) if all_finite(values) else np.flatnonzero(np.isfinite(values).any(axis=1))
    steps = np.diff(there)
    if len(there) < 3 or np.median(steps) < 2:
        return values, rate
    usual = float(steps[steps <= 1.5 * np.min(steps)].mean())
    slot = np.concatenate([[0], np.cumsum(np.maximum(np.round(steps / usual), 1.0))]).astype(int)
    out = np.full((slot[-1] + 1, values.shape[1]), np.nan)
    out[slot] = values[there]
    return out, rate / usual


def _between(at: np.ndarray, rate: float) -> tuple[float, float]:
    return float(at[0] / rate), float((at[-1] + 1) / rate)


def _zeroed(sensor: str, axis: int, column: np.ndarray, rate: float, unit: str) -> list[Stretch]:
    """Exact zeros inside of a hole in the values: a dead band. Its size is the smallest other value."""
    at = np.flatnonzero(column == 0.0)
    if len(at) < FEW or len(at) == len(column):
        return []
    sizes = np.abs(column[np.isfinite(column) & (column != 0.0)])
    if len(sizes) < FEW:
        return []
    smallest = float(sizes.min())
    near = np.unique(sizes[sizes <= 2.0 * smallest])
    # without a dead band, there are as many values up to the smallest as between it and its double
    if len(near) < FEW or np.median(np.diff(near)) * 3.0 > smallest:
        return []
    return [Stretch("zeroed", sensor, (axis,), *_between(at, rate), smallest, unit, len(at))]


def _stopped(sensor: str, values: np.ndarray, rate: float, found: list[Stretch]) -> list[Stretch]:
    """An axis that repeats one value from some time to the end, or from the start, while another axis goes on."""
    equal = values[1:] == values[:-1]
    stretches = []
    for axis, same in enumerate(equal.T):
        first, last = len(same) - int(np.argmin(same[::-1])), int(np.argmin(same))
        for start, stop in ((a, b) for a, b in ((first, len(same)), (0, last)) if b - a >= STUCK):
            # a coarse axis repeats its values elsewhere, too; those of a dead band and of the end of the range are known
            rest = np.concatenate([same[:start], same[stop:]])
            known = {one.size if one.kind == "clipped" else 0.0 for one in found if one.kind in ("clipped", "zeroed") and axis in one.axes}
            if not len(rest) or rest.mean() >= HIDDEN or values[start, axis] in known:
                continue
            if equal[start:stop].mean(axis=0).min() < HIDDEN:
                begins = start + (start > 0)
                stretches.append(Stretch("stuck", sensor, (axis,), begins / rate, (stop + 1) / rate, samples=stop + 1 - begins))
    return stretches


def _lost(sensor: str, values: np.ndarray, rate: float) -> list[Stretch]:
    """Rows of exact zeros, far from all other readings: readings that were lost."""
    if sensor == "gyro" or values.shape[1] < 3:
        return []
    zero = (values == 0.0).all(axis=1)
    if not zero.any() or zero.all():
        return []
    sizes = np.sqrt(np.einsum("ij,ij->i", values, values))[~zero]
    smallest = np.fmin.reduce(sizes, initial=np.inf)
    if not smallest > 0.5 * np.nanmedian(sizes):  # gravity and the field of the Earth have no zeros
        return []
    at = np.flatnonzero(zero)
    return [Stretch("zeroed", sensor, (0, 1, 2), *_between(at, rate), samples=len(at))]


def _clipped(sensor: str, axis: int, column: np.ndarray, rate: float, unit: str) -> list[Stretch]:
    """Many samples at an extreme value, more than three times as many as at the next one, that are reached and left by movement."""
    low, high = np.fmin.reduce(column), np.fmax.reduce(column)
    found = []
    for extreme in (low, high) if low < high else ():
        at = np.flatnonzero(column == extreme)
        if len(at) < FEW:
            continue
        others = column[(column != extreme) & np.isfinite(column)]
        neighbour = others.min() if extreme == low else others.max()
        inside = column == extreme
        edge = np.flatnonzero(inside[1:] != inside[:-1])
        ends = np.where(inside[edge], column[edge + 1], column[edge])  # beside the end of the range
        ends = np.abs(ends[np.isfinite(ends)] - extreme)
        # a coarse sensor at rest has few levels, any of them may be frequent, and it changes by one of them
        if (
            abs(neighbour - extreme) < 0.05 * (high - low)
            and len(at) > 3 * np.count_nonzero(column == neighbour)
            and (len(ends) and np.median(ends) > 2.0 * resolution(column))
        ):
            found.append(Stretch("clipped", sensor, (axis,), *_between(at, rate), float(extreme), unit, len(at)))
    return found


def clipped(values: np.ndarray) -> np.ndarray:
    """(n,) which rows have an axis at the end of its range, of a sensor that was cut off there."""
    there = (column == one.size for column in values.T for one in _clipped("", 0, column, 1.0, ""))
    return np.any([np.zeros(len(values), bool), *there], axis=0)


def _resampled(sensor: str, values: np.ndarray, rate: float, found: list[Stretch]) -> list[Stretch]:
    """Readings that were interpolated to another rate: the size of their second differences has the beat of both rates.

    In public logs, slow changes of the size are below 0.02 of the rate. Beyond, the strongest line was 21 times the median where nothing
    was interpolated, and from 127,000 times on in three logs where it was.
    """
    out = np.asarray(~np.isfinite(values).all(axis=1))
    for one in found:
        if one.kind == "stuck":  # as in a simulation without noise
            return []
        if one.kind == "held":
            out |= masked(one, values, rate)[:, 0]
    first = values[: 2 * SAMPLE][~out[: 2 * SAMPLE]] if out[:SAMPLE].any() else values
    bent = np.diff(first[:SAMPLE].T, 2)
    bent = bent[:, : scipy.fft.prev_fast_len(max(bent.shape[1], 1))]  # a transform of some lengths takes several times as long
    usual = quantile(np.abs(bent), 0.9)[:, None] if bent.shape[1] > STUCK**2 else np.zeros(1)
    if not usual.all():
        return []
    spectrum = np.fft.rfft(bent)  # without a hum, which beats with the rate, too
    height = np.abs(spectrum)
    spectrum /= np.maximum(height / (_LINE * quantile(height, 0.5)[:, None]), 1.0)
    second = np.abs(np.fft.irfft(spectrum, bent.shape[1])) / usual
    size = np.minimum(second, 1.0).sum(axis=0)
    power = np.abs(np.fft.rfft(size - size.mean())) ** 2
    first = len(size) // STUCK  # slow changes of the size are none
    line = first + int(np.argmax(power[first:]))
    if not power[line] > LOG["resampled"].limits[0] * np.median(power):
        return []
    if np.mean(second < 1.0 / _DIGITS) > 0.2:  # three points between two readings lie on a line, and the beat has harmonics
        line = first + int(np.argmax(power[first:] > 0.1 * power[line]))
    else:
        line = len(size) - line
    axes = tuple(range(values.shape[1]))
    return [Stretch("resampled", sensor, axes, 0.0, len(values) / rate, rate * line / len(size), "Hz", len(values))]


def _coarse(sensor: str, values: np.ndarray, rate: float, unit: str) -> list[Stretch]:
    """Axes whose values come in steps of the same size."""
    alike: dict[str, list[int]] = {}
    for axis, column in enumerate(values[:SAMPLE].T):
        if step := resolution(column):
            alike.setdefault(f"{step:.4g}", []).append(axis)
    return [Stretch("coarse", sensor, tuple(axes), 0.0, len(values) / rate, float(step), unit) for step, axes in alike.items()]


def resolution(column: np.ndarray) -> float:
    """Step of the values, if their differences are so few multiples of one that this is no accident; otherwise 0.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.evidence._values import resolution
    >>> y = np.random.default_rng(0).normal(size=1000)
    >>> resolution(y), round(resolution(0.25 * np.round(4 * y)), 3)
    (0.0, 0.25)
    """
    return common_step(np.abs(np.diff(first_known(column))))


def first_known(column: np.ndarray) -> np.ndarray:
    """The first readings that are there, enough for a spread."""
    first = column[:SAMPLE]
    return first if np.isfinite(first).all() else column[np.isfinite(column)][:SAMPLE]


def _nearby(steps: np.ndarray) -> np.ndarray:
    """Steps without those so large that only an overflow, or the digits of a float, make them."""
    steps = steps[steps > 0]
    return steps[steps < _DIGITS * steps.min(initial=np.inf)]


def common_step(steps: np.ndarray) -> float:
    """The step of which all are whole multiples, or 0."""
    steps = steps[steps > 0]
    if len(steps) < FEW or steps.max() > _DIGITS * (smallest := float(steps.min())):
        return 0.0
    counts = (part / smallest for part in (steps[:STUCK], steps))  # the first ones settle it for most
    return smallest if all(np.abs(count - np.round(count)).max() < 0.01 for count in counts) else 0.0


def _warm_up(sensor: str, values: np.ndarray, rate: float, unit: str) -> list[Stretch]:
    """The first minute differs from the second by more than later minutes differ. A minute is the median of its seconds."""
    second = max(round(rate), 1)
    part = second * round(_WARM_UP * rate / second)
    count = len(values) // part if part else 0
    if count < FEW:
        return []
    parts = values[: count * part].T.reshape(-1, count, part // second, second)
    with np.errstate(invalid="ignore"):
        medians = np.median(parts.mean(axis=3), axis=2).T
    medians = medians[np.isfinite(medians).all(axis=1)]
    if len(medians) < FEW:
        return []
    steps = np.diff(medians, axis=0)
    scatter = 1.4826 * np.median(np.abs(steps[1:]), axis=0)
    known = scatter + [0.5 * resolution(column) / second for column in values.T]  # means of seconds come in steps if the values do
    limit = -scipy.special.stdtrit(EFFICIENCY * (len(steps) - 1), 0.1 * CHANCE) * known  # for each axis
    axes = np.flatnonzero((np.abs(steps[0]) > limit) & (scatter > 0))
    if not len(axes):
        return []
    moved = float(np.abs(medians[0] - np.median(medians[1:], axis=0))[axes].max())
    return [Stretch("warm_up", sensor, tuple(axes.tolist()), 0.0, _WARM_UP, moved, unit)]
