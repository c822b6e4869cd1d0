"""Sums of squared differences of a stretch of samples that arrives piece by piece, and the merging of two neighbouring stretches.

Differences of the phase do not depend on a line in it. So the phase is kept relative to the mean of the latest piece, as far back as
the cluster sizes reach. It stays small and keeps its digits, for any length of the stream and any wandering of its mean.

Cluster sizes that share a stride s form a `Level`. It knows the phase at every s-th sample only, and at these points a cluster of m samples
spans m/s steps. All levels are alike: what arrives extends their last points, and the differences that end there are summed.

A stretch has two frames. In the first frame the phase is zero at the first sample, and relative to the mean of the first piece: the first
points are kept in it, for a stretch that comes before. In the second frame the phase is zero at the end, and relative to the mean of the
latest piece. Where two stretches meet, the last points of one and the first of the other give the differences across their border.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._arrays import running_sum
from .._errors import DataError
from ._kernels._phase import BLOCK, aligned, running_sum_of_phase
from ._kernels._route import by_blocks
from ._kinds import Kind
from ._noise_type._b1_ratio import POINTS

#: number of samples processed at a time
PIECE = 1 << 20
#: smallest number of points per cluster between starting points, if not all are used
PER_CLUSTER = 128


class Points(NamedTuple):
    """Phase and number of missing samples, both (channels, points), at successive multiples of a stride.

    The samples count from the beginning of the stretch for points at its beginning, and from its end for points at its end.
    """

    phase: np.ndarray
    lost: np.ndarray

    @property
    def number(self) -> int:
        return self.phase.shape[1]

    def moved(self, offset: Any, slope: Any, step: Any, lost: Any) -> "Points":
        """The points in another frame: a line is added to their phase, and `lost` more samples precede them."""
        return Points(self.phase + (offset[:, None] + slope[:, None] * step), self.lost + lost[:, None])

    def followed(self, other: "Points") -> "Points":
        """These points and further ones in the same frame."""
        return Points(np.concatenate([self.phase, other.phase], axis=1), np.concatenate([self.lost, other.lost], axis=1))

    def cut(self, where: slice) -> "Points":
        return Points(self.phase[:, where], self.lost[:, where])


class Level(NamedTuple):
    """Cluster sizes with starting points at every `stride`-th sample: `steps` of points each, ascending; points at both ends; sums."""

    stride: int
    steps: np.ndarray
    head: Points  # the first points, in the first frame
    tail: Points  # the last points, in the second frame
    squares: np.ndarray  # (sizes, channels) sums of squared differences
    count: np.ndarray  # (sizes, channels) number of differences that touch no gap


class Stretch(NamedTuple):
    """The stored data of a stretch of samples; channels are the first axis, except in tables by cluster size."""

    start: int | None  # position of its first sample, None if unknown
    samples: int
    present: np.ndarray  # (channels,) number of samples that are not missing
    first_mean: np.ndarray  # (channels,) means of the first and of the latest piece
    mean: np.ndarray
    net: np.ndarray  # (channels,) phase at the end in the first frame
    levels: tuple[Level, ...]
    marks: tuple[Points, ...]  # for each cluster size, points that far apart in the first frame, from which the noise type follows

    @property
    def origin(self) -> int:
        """Position of the first sample; 0 if unknown."""
        return self.start or 0

    @property
    def lost(self) -> np.ndarray:
        """(channels,) number of missing samples."""
        return self.samples - self.present


def strides(m: np.ndarray, kind: Kind, exact: int) -> np.ndarray:
    """Distance of the starting points: 1 up to `exact`, beyond it a divisor of m up to m/128; m if clusters do not overlap."""
    if not kind.overlapped:
        return m
    return np.array([1 if size <= exact else _divisor(size, size // PER_CLUSTER) for size in m.tolist()])


def rounded(m: np.ndarray, kind: Kind, exact: int) -> np.ndarray:
    """Cluster sizes, those beyond `exact` at a multiple of a power of two, so that they share strides."""
    step = 2 ** np.log2(np.maximum(m // PER_CLUSTER, 1)).astype(np.int64)
    return np.where((m > exact) & kind.overlapped, m // step * step, m)


@functools.cache
def _divisor(number: int, most: int) -> int:
    """The power of two next below `most`, which many cluster sizes share, or else the largest divisor that does not exceed it."""
    step = 1 << max(most, 1).bit_length() - 1
    if number % step == 0:
        return step
    root = np.arange(1, int(number**0.5) + 1)
    small = root[number % root == 0]
    both = np.concatenate([small, number // small])
    return int(both[both <= max(most, 1)].max())


def reach_of(kind: Kind, steps: Any) -> Any:
    """Number of steps from the first to the last point of a difference."""
    return kind.difference * steps - (1 if kind.modified else 0)


def new_stretch(m: np.ndarray, stride: np.ndarray, channels: int, start: int | None) -> Stretch:
    """A stretch without samples, for ascending cluster sizes."""

    def begun(step: int) -> Points:
        there = int((start or 0) % step == 0)  # the point at the border belongs to both stretches
        return Points(np.zeros((channels, there)), np.zeros((channels, there), np.int64))

    levels = []
    for step in np.unique(stride).tolist():
        steps = m[stride == step] // step
        zero = np.zeros((len(steps), channels))
        levels.append(Level(step, steps, begun(step), begun(step), zero, zero.astype(np.int64)))
    zero = np.zeros(channels)
    return Stretch(start, 0, zero.astype(np.int64), zero, zero, zero, tuple(levels), tuple(begun(size) for size in m.tolist()))


def lengthened(
    kind: Kind, m: np.ndarray, old: Stretch, samples: np.ndarray, run: Callable, workers: int
) -> tuple[Stretch, Callable[[], Any]]:
    """The stretch with up to PIECE more samples, (w, channels), and a function that gives the sums which its first level still lacks.

    `run` maps a function over channels, or over parts of a single one. The phase is laid out in reverse order of time, so that the kernel
    finds the starting points of the new differences at the front.
    """
    width, channels = samples.shape
    over, within = (run, map) if channels > 1 else (map, run)
    reaches = [reach_of(kind, level.steps) for level in old.levels]
    length = PIECE + BLOCK + (int(reaches[0][-1]) if old.levels[0].stride == 1 else 0)
    length += -length % (64 * BLOCK)  # few lengths, so that few programs are compiled
    # phase at the end minus phase, which are arbitrary beyond the points; and number of missing samples before each point, in order of time
    back = aligned(channels * length).reshape(channels, length)
    means, missing = zip(*over(lambda c: _integrated(samples[:, c], back[c], old, c), range(channels)), strict=True)
    mean = np.array(means)
    lost = np.stack(missing) if any(each[-1] for each in missing) else np.broadcast_to(missing[0], (channels, width + 1))
    gone, now, net = lost[:, -1].astype(np.int64), old.origin + old.samples, back[:, width].copy()
    first_mean = np.where(old.present > 0, old.first_mean, mean)
    tilt, drift = old.mean - mean, mean - first_mean

    def multiples(stride: int) -> range:
        return range(-now % stride or stride, width + 1, stride)

    def points(at: range) -> Points:
        where = slice(at.start, at.stop, at.step)
        return Points(net[:, None] - back[:, width::-1][:, where], lost[:, where])

    def further(head: Points, at: range, most: int) -> Points:
        some = at[: max(most - head.number, 0)]
        return _further(head, points(some), most, old.net, drift, np.arange(some.start, some.stop, some.step), old.lost) if some else head

    levels, squares, count, lacking = [], 0.0, 0, lambda: (0.0, 0)
    for level, reach in zip(old.levels, reaches, strict=True):
        at, longest, held = multiples(level.stride), int(reach[-1]), level.tail.number
        ago = np.arange(1 - held, 1) * level.stride - now % level.stride
        tail = Points(level.tail.phase + tilt[:, None] * ago, level.tail.lost)
        number = np.clip(held + len(at) - reach, 0, len(at))
        if level.stride == 1:
            back[:, width : width + held] = net[:, None] - tail.phase[:, ::-1]
            each = 1 if channels > 1 else 2 * workers
            lacking = functools.partial(_by_kernel, kind, level.steps, number, back, tail.lost, lost, over, within, each)
        else:
            squares, count = _by_slices(kind, level.steps, tail.followed(points(at)), held + len(at) - number - reach, number)
        last = points(at[-longest:]) if len(at) >= longest else tail.followed(points(at))
        last = last.cut(slice(max(last.number - longest, 0), None)).moved(-net, 0 * net, 0, -gone)
        head = further(level.head, at, longest)
        levels.append(Level(level.stride, level.steps, head, last, level.squares + squares, level.count + count))
    marks = list(old.marks)
    for i in np.flatnonzero(m - now % m <= width).tolist():
        marks[i] = further(marks[i], multiples(int(m[i])), POINTS + 1)
    return old._replace(
        samples=old.samples + width, present=old.present + width - gone, first_mean=first_mean, mean=mean,
        net=old.net + net + drift * width, levels=tuple(levels), marks=tuple(marks),
    ), lacking  # fmt: skip


def completed(stretch: Stretch, lacking: Callable[[], Any]) -> Stretch:
    """The stretch with the sums that its first level lacked."""
    (squares, count), (first, *others) = lacking(), stretch.levels
    return stretch._replace(levels=(first._replace(squares=first.squares + squares, count=first.count + count), *others))


def _further(head: Points, new: Points, most: int, net: np.ndarray, drift: np.ndarray, step: np.ndarray, lost: np.ndarray) -> Points:
    """First points of a stretch, with new ones as long as there are fewer than `most`."""
    some = slice(0, max(most - head.number, 0))
    return head.followed(new.cut(some).moved(net, drift, step[some], lost)) if some.stop else head


def _integrated(samples: np.ndarray, back: np.ndarray, old: Stretch, c: int) -> tuple[float, np.ndarray]:
    """Mean of the samples, and the number of missing ones before each point; fills in the sums of the last samples minus it, from zero."""
    x = back[1 : len(samples) + 1]
    x[:] = samples[::-1]
    total, lost = float(np.sum(x)), np.broadcast_to(np.int32(0), len(x) + 1)  # which takes no memory
    mean = total / len(x)
    if not np.isfinite(total):
        infinite = np.flatnonzero(np.isinf(samples))
        if len(infinite):
            name, where = f"channel {c}" if len(old.mean) > 1 else "the record", old.samples + int(infinite[0])
            raise DataError(f"{name} has an infinite value at sample {where}; replace it by NaN to mark a gap", code="infinite")
        missing = np.isnan(x)
        mean = float(old.mean[c]) if missing.all() else float(np.mean(x[~missing]))
        x[missing] = mean
        lost = np.append(lost[:1], np.cumsum(missing[::-1], dtype=np.int32))
    back[0] = 0.0
    running_sum(x, mean, x)
    return mean, lost


def _by_kernel(
    kind: Kind, m, number, back: np.ndarray, before: np.ndarray, lost: np.ndarray, over: Callable, within: Callable, workers: int
):
    """Sums and counts over the last `number` differences of each channel, by the block kernel; points `before` end with the first."""

    def channel(c: int):
        with jax.enable_x64(True):  # thread-local
            missing, gone, width = None, int(lost[c, -1]), lost.shape[1] - 1
            if gone > before[c, 0]:
                counted = np.zeros(back.shape[1], np.int32)
                counted[:width], counted[width : width + before.shape[1]] = gone - lost[c, :0:-1], gone - before[c, ::-1]
                missing = jnp.asarray(counted)
            theta = jax.device_put(back[c], may_alias=True)
            parts = running_sum_of_phase(theta) if kind.modified else (theta,)
            rule = "none" if missing is None else "span"
            return by_blocks(parts, missing, m, number, int(kind.modified), kind, rule, workers, within, True)

    if not number.any():
        return 0.0, 0
    return (np.stack(found, axis=1) for found in zip(*over(channel, range(len(back))), strict=True))


def _by_slices(kind: Kind, steps, points: Points, first, number) -> tuple[np.ndarray, np.ndarray]:
    """Sums and counts, (sizes, channels), over the `number` differences from the `first` point on, each (sizes,)."""
    squares = np.zeros((len(steps), len(points.phase)))
    count, whole = np.zeros(squares.shape, np.int64), bool((points.lost[:, -1:] == points.lost[:, :1]).all())
    for i in np.flatnonzero(number > 0):
        k, a, b, reach = int(steps[i]), int(first[i]), int(first[i] + number[i]), int(reach_of(kind, steps[i]))
        d = points.phase[:, a : b + reach]
        if kind.modified:
            d = np.cumsum(np.pad(d - d.mean(axis=1, keepdims=True), ((0, 0), (1, 0))), axis=1)
        for _ in range(kind.difference):
            d = d[:, k:] - d[:, :-k]
        if whole:
            squares[i], count[i] = np.einsum("ij,ij->i", d, d), b - a
        else:
            valid = points.lost[:, a:b] == points.lost[:, a + reach : b + reach]
            squares[i], count[i] = np.sum(np.where(valid, d * d, 0.0), axis=1), valid.sum(axis=1)
    return squares, count


def side_by_side(kind: Kind, m: np.ndarray, a: Stretch, b: Stretch) -> Stretch:
    """Merge two neighbouring stretches into one."""
    border, drift = a.origin + a.samples, b.first_mean - a.first_mean
    ends = -b.net - (b.first_mean - b.mean) * b.samples  # phase at the border in the second frame of `b`
    none = np.zeros(len(a.net), np.int64)

    def ahead(stride: int, points: Points, known: bool) -> tuple[Points, np.ndarray]:
        """First points of `b` beyond the border, and their distances from it; those of an unknown start begin there."""
        first = -border % stride if known else 0
        points = points.cut(slice(int(first == 0 and known), None))
        return points, (first or stride * known) + stride * np.arange(points.number)

    levels = []
    for one, two in zip(a.levels, b.levels, strict=True):
        stride, reach, shared = one.stride, reach_of(kind, one.steps), border % one.stride == 0
        longest = int(reach[-1])
        new, step = ahead(stride, two.head, True)
        points = one.tail.followed(new.moved(0 * a.mean, b.first_mean - a.mean, step, none))  # both count from the border
        # differences that start before the border and end after it
        first = np.maximum(one.tail.number - reach, 0)
        number = np.minimum(one.tail.number - shared, points.number - reach) - first
        squares, count = _by_slices(kind, one.steps, points, first, number)
        head = _further(one.head, new, longest, a.net, drift, step, a.lost)
        tail = two.tail
        if tail.number < longest:
            before = one.tail.cut(slice(0, one.tail.number - shared))
            before = before.cut(slice(max(before.number + tail.number - longest, 0), None))
            ago = ((border - 1) // stride - np.arange(before.number)[::-1]) * stride - border
            tail = before.moved(ends, a.mean - b.mean, ago, -b.lost).followed(tail)
        levels.append(Level(stride, one.steps, head, tail, one.squares + two.squares + squares, one.count + two.count + count))
    marks = []
    for size, mine, its in zip(m.tolist(), a.marks, b.marks, strict=True):
        new, step = ahead(size, its, b.start is not None)
        new = Points(new.phase, new.lost + (b.start is None))  # no average spans the border if the points do not go on evenly
        marks.append(_further(mine, new, POINTS + 1, a.net, drift, step, a.lost))
    return Stretch(
        start=0 if a.start is None and b.start is not None else a.start, samples=a.samples + b.samples, present=a.present + b.present,
        first_mean=a.first_mean, mean=b.mean, net=a.net + b.net + drift * b.samples, levels=tuple(levels), marks=tuple(marks),
    )  # fmt: skip
