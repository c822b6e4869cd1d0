"""Sums of squared differences of a stretch of samples that arrives piece by piece, and the merging of two neighbouring stretches.

Differences of the phase do not depend on a line in it. So the phase is kept relative to the mean of the latest piece, as far back as
the cluster sizes reach. It stays small and keeps its digits, for any length of the stream and any wandering of its mean.

A stretch has two frames. In the first frame the phase is zero at the first point, and the level is the mean of the first piece: `head`,
`marks` and the leading points of `tracks` are kept in it, for a stretch that comes before. The second frame moves on with each piece.
Where two stretches meet, the differences across their border are formed, and both ends are transformed into common frames.
"""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._errors import DataError
from .._kernels._difference_sums import block_sums
from .._kernels._phase import BLOCK, aligned, running_sum_of_phase
from .._kinds import Kind
from ._tracks import NEVER, Piece, Tracks, at_the_beginning, extended, joined, new_tracks

#: number of samples processed at a time
PIECE = 1 << 20
#: number of differences above which a second thread saves more time than it costs
PARALLEL_FROM = 4_000_000
#: smallest number of points per cluster between starting points, if not all are used
PER_CLUSTER = 128
#: number of averages kept for the noise type, at each cluster size
AVERAGES = 1 << 13
_BUCKET = 16  # step of the numbers of cluster sizes for which a program is compiled


class Plan(eqx.Module):
    """The cluster sizes to compute, in ascending order; the first `dense` of them use every starting point."""

    kind: Kind
    m: np.ndarray
    stride: np.ndarray
    dense: int

    @property
    def reach(self) -> int:
        """Number of phase points that the longest dense difference spans."""
        return self.kind.difference * int(self.m[self.dense - 1]) if self.dense else 1

    @property
    def padded(self) -> int:
        """Length of the array that the kernel reads: a multiple of a block, so that few programs are compiled."""
        return -(-(PIECE + self.reach + BLOCK) // (4 * BLOCK)) * 4 * BLOCK


def make_plan(m: np.ndarray, kind: Kind, exact: int) -> Plan:
    """Plan for distinct cluster sizes in ascending order."""
    if not kind.overlapped:
        return Plan(kind=kind, m=m, stride=m, dense=0)
    dense = int(np.searchsorted(m, exact, side="right"))
    stride = np.ones_like(m)
    stride[dense:] = 2 ** np.log2(np.maximum(m[dense:] // PER_CLUSTER, 1)).astype(np.int64)
    return Plan(kind=kind, m=m, stride=stride, dense=dense)


class End(NamedTuple):
    """Phase at the points of one end of a stretch, and number of missing samples between the end and each point; None without any."""

    phase: np.ndarray
    lost: np.ndarray | None

    @property
    def counted(self) -> np.ndarray:
        """The numbers of missing samples, as zeros if there are none."""
        return _counted(self.lost, len(self.phase))

    def followed(self, phase: np.ndarray, lost: np.ndarray, reach: int) -> "End":
        """The end with further points, at most `reach` in all."""
        counted = np.concatenate([self.counted, lost])[:reach]
        return End(np.concatenate([self.phase, phase])[:reach], counted if counted.any() else None)


class Stretch(eqx.Module):
    """The stored data of a stretch of samples; channels are the first axis, except in tables by cluster size."""

    start: int | None  # position of its first sample, None if unknown
    samples: int
    present: np.ndarray  # (channels,) number of samples that are not missing
    first_level: np.ndarray  # (channels,) levels of the two frames
    level: np.ndarray
    here: np.ndarray  # (channels,) phase at the last point in the second frame: rounding errors only
    net: np.ndarray  # (channels,) phase at the last point in the first frame
    head: tuple[End, ...]  # the first points of each channel
    tail: tuple[End, ...]  # the last points, latest first
    squares: np.ndarray  # (dense, channels) sums of squares
    count: np.ndarray  # (dense, channels) number of differences that touch no gap
    tracks: Tracks  # the larger cluster sizes
    #: for each cluster size, phase (first frame) and missing samples at points m apart, side by side: (points, 2 channels). The
    #: first point is at the first sample or, if `start` is known, at the first multiple of m in the record
    marks: tuple[np.ndarray, ...]
    mark_due: np.ndarray  # (sizes,) position of the next such point, counted from the first sample

    @property
    def origin(self) -> int:
        """Position of the first sample; 0 if unknown."""
        return self.start or 0


def new_stretch(plan: Plan, channels: int, start: int | None) -> Stretch:
    """A stretch without samples."""
    zero = np.zeros(channels)
    # if the position is known, use the same points for the noise types as a single pass over the record
    due = plan.m if start is None else np.where(start % plan.m == 0, plan.m, -start % plan.m)
    marks = tuple(np.zeros((int(m == first), 2 * channels)) for m, first in zip(plan.m, due, strict=True))
    return Stretch(
        start=start, samples=0, present=np.zeros(channels, np.int64), first_level=zero, level=zero, here=zero, net=zero,
        head=(End(np.zeros(1), None),) * channels, tail=(End(np.zeros(1), None),) * channels,
        squares=np.zeros((plan.dense, channels)), count=np.zeros((plan.dense, channels), np.int64),
        tracks=new_tracks(plan.m[plan.dense :], plan.stride[plan.dense :], plan.kind.order, channels, start),
        marks=marks, mark_due=due.copy(),
    )  # fmt: skip


def lengthened(plan: Plan, old: Stretch, samples: np.ndarray, run: Callable, parts: int) -> Stretch:
    """The stretch with up to PIECE more samples, (w, channels); `run` maps, and `parts` threads share the work on one channel."""
    width, channels = samples.shape
    phase, lost, level, gone = zip(*run(lambda c: _integrated(samples[:, c], old, c), range(channels)), strict=True)
    level, gone = np.array(level), np.array(gone)
    first_level = np.where(old.present > 0, old.first_level, level)
    tilt, drift = old.level - level, level - first_level
    lost_before = old.samples - old.present
    here = np.array([p[-1] for p in phase])
    squares, count, sums, head, tail = old.squares.copy(), old.count.copy(), (), old.head, old.tail
    if plan.dense:
        buffers = list(run(lambda c: _laid_out(plan, old.tail[c], phase[c], lost[c], float(tilt[c])), range(channels)))
        sums = _dense_sums(plan, buffers, old.samples, width, run, parts)
        kept = min(plan.reach, old.samples + width + 1)
        tail = tuple(End(b[:kept].copy(), None if g is None or not g[:kept].any() else g[:kept].copy()) for b, g in buffers)
        need = min(plan.reach - len(old.head[0].phase), width)
        if need > 0:
            first, slopes, ends = slice(1, need + 1), drift[:, None] * np.arange(1, need + 1), old.net - old.here
            more = [(phase[c][first] + ends[c] + slopes[c], _counted(lost[c], width + 1)[first] + lost_before[c]) for c in range(channels)]
            head = tuple(end.followed(*points, plan.reach) for end, points in zip(old.head, more, strict=True))
    piece = Piece(now=old.origin + old.samples, phase=phase, lost=lost, lost_before=lost_before)
    tracks = extended(old.tracks, piece, tilt, (old.net - old.here, drift))
    marks, mark_due = _more_marks(plan, old, Piece(now=old.samples, phase=phase, lost=lost, lost_before=lost_before), drift)
    for c, total, valid in sums:
        squares[:, c] += total[: plan.dense]
        count[:, c] += valid[: plan.dense]
    return Stretch(
        start=old.start, samples=old.samples + width, present=old.present + width - gone, first_level=first_level, level=level, here=here,
        net=old.net + (here - old.here) + drift * width, head=head, tail=tail,
        squares=squares, count=count, tracks=tracks, marks=marks, mark_due=mark_due,
    )  # fmt: skip


def _integrated(samples: np.ndarray, old: Stretch, c: int):
    """Phase in the frame of the piece, starting at the last value of the piece before; missing samples; level; their number."""
    x = np.array(samples, dtype=np.float64)
    total, lost, gone = float(np.sum(x)), None, 0
    if np.isfinite(total):
        level = total / len(x)
    else:
        infinite = np.flatnonzero(np.isinf(x))
        if len(infinite):
            name, where = f"channel {c}" if len(old.level) > 1 else "the record", old.samples + int(infinite[0])
            raise DataError(f"{name} has an infinite value at sample {where}; replace it by NaN to mark a gap")
        missing = np.isnan(x)
        gone = int(missing.sum())
        level = float(np.mean(x[~missing])) if gone < len(x) else float(old.level[c])
        x = np.where(missing, level, x)
        lost = np.concatenate([np.zeros(1, np.int32), np.cumsum(missing, dtype=np.int32)])
    x -= level
    phase = np.empty(len(x) + 1)
    phase[0] = old.here[c]
    x[0] += phase[0]
    np.cumsum(x, out=phase[1:])
    return phase, lost, level, gone


def _laid_out(plan: Plan, tail: End, phase, lost, tilt: float):
    """Phase in reverse order of time, new points first, so that the kernel finds its starting points at the front; and missing samples."""
    width, length = len(phase) - 1, len(tail.phase)
    buffer = aligned(plan.padded)  # values beyond the points stay arbitrary
    buffer[:width] = phase[:0:-1]
    np.multiply(np.arange(length), -tilt, out=buffer[width : width + length])
    buffer[width : width + length] += tail.phase
    if lost is None and tail.lost is None:
        return buffer, None
    counted, lost = np.zeros(plan.padded, np.int32), _counted(lost, width + 1)
    counted[:width] = lost[-1] - lost[:0:-1]
    counted[width : width + length] = lost[-1] + tail.counted
    return buffer, counted


def _dense_sums(plan: Plan, buffers, before: int, width: int, run: Callable, parts: int):
    """Channel, sums and counts over the differences that end in the piece; threads of a pool start at once."""
    kind, m = plan.kind, plan.m[: plan.dense]
    filled = -(-plan.dense // _BUCKET) * _BUCKET - plan.dense
    number = np.clip(kind.count(before + width, m), 0, width)
    # the sizes that fill the bucket have no differences
    sizes, number = np.pad(m, (0, filled), constant_values=1), np.pad(number, (0, filled))
    edges = np.linspace(0, -(-width // BLOCK), parts + 1).astype(int)
    tasks = [(c, a, b) for c in range(len(buffers)) for a, b in itertools.pairwise(edges.tolist())]
    ready = list(run(lambda b: _on_device(plan, *b), buffers))

    def one(task):
        c, first, last = task
        with jax.enable_x64(True):  # thread-local
            held, missing = ready[c]
            sums = block_sums(
                held, missing, sizes, number, np.int64(first), np.int64(last), np.int64(kind.modified),
                order=kind.difference, strided=False, rule="none" if missing is None else "span",
            )  # fmt: skip
            return c, *(np.asarray(s) for s in sums)

    return run(one, tasks)


def _on_device(plan: Plan, buffer: np.ndarray, counted: np.ndarray | None):
    with jax.enable_x64(True):
        theta = jax.device_put(buffer, may_alias=True)
        parts = running_sum_of_phase(theta) if plan.kind.modified else (theta,)
        return parts, None if counted is None else jnp.asarray(counted)


def _counted(lost: np.ndarray | None, length: int) -> np.ndarray:
    return np.zeros(length, np.int64) if lost is None else lost


def _more_marks(plan: Plan, old: Stretch, piece: Piece, drift: np.ndarray):
    """Collect the points from which noise types are identified, until there are enough."""
    channels, last = len(piece.phase), len(piece.phase[0]) - 1
    marks, due = list(old.marks), old.mark_due.copy()
    for i in np.flatnonzero(due <= piece.now + last):
        m, begin = int(plan.m[i]), int(due[i]) - piece.now
        number = min((last - begin) // m + 1, AVERAGES + 1 - len(marks[i]))
        rows = piece.rows(begin, number, m)
        rows[:, 1 : 1 + channels] += old.net - old.here + drift * (rows[:, :1] - piece.now)
        marks[i] = np.concatenate([marks[i], rows[:, 1:]])
        due[i] = due[i] + number * m if len(marks[i]) <= AVERAGES else NEVER
    return tuple(marks), due


def side_by_side(plan: Plan, a: Stretch, b: Stretch) -> Stretch:
    """Merge two neighbouring stretches into one."""
    kind, channels = plan.kind, len(a.level)
    border = a.origin + a.samples
    shift = border - b.origin  # zero if the position of the second stretch is known
    start, first_tracks = a.start, a.tracks
    if start is None and b.start is not None:  # the position of the second shows that the first begins the record
        start, first_tracks = 0, at_the_beginning(a.tracks)
    lost = a.samples - a.present
    squares, count = a.squares + b.squares, a.count + b.count
    rise, head, tail = a.level - b.first_level, a.head, a.tail
    if plan.dense:
        ends = []
        for c in range(channels):
            before, after = _before(a, c, rise[c]), b.head[c]
            phase = np.concatenate([before.phase[:0:-1], after.phase])
            gone = np.concatenate([-before.counted[:0:-1], after.counted])
            found = [_across(phase, gone, len(before.phase) - 1, int(m), kind) for m in plan.m[: plan.dense]]
            squares[:, c] += np.array([f[0] for f in found])
            count[:, c] += np.array([f[1] for f in found])
            ends.append((_head(plan, a, b, c), _tail(plan, b, c, before)))
        head, tail = zip(*ends, strict=True)
    on = b.first_level - b.level
    frames = (
        (-a.here, rise),
        (a.net, b.first_level - a.first_level),
        (b.here - b.net - on * b.samples, on),
    )  # fmt: skip
    marks, due = [], []
    for i in range(len(plan.m)):
        m = int(plan.m[i])
        mine, more = a.marks[i], b.marks[i].copy()
        first = 0 if b.start is None else -b.start % m
        more[:, :channels] += a.net + (b.first_level - a.first_level) * (first + np.arange(len(more))[:, None] * m)
        if b.start is None:
            more[:, channels:] += lost + 1  # no average spans the border
        else:
            more[:, channels:] += lost
            more = more[1 if first == 0 else 0 :]  # the border is the last point of the first stretch
        marks.append(np.concatenate([mine, more])[: AVERAGES + 1])
        due.append(NEVER if len(marks[-1]) > AVERAGES else a.samples + int(b.mark_due[i]))
    return Stretch(
        start=start, samples=a.samples + b.samples, present=a.present + b.present, first_level=a.first_level, level=b.level, here=b.here,
        net=a.net + b.net + (b.first_level - a.first_level) * b.samples, head=head, tail=tail, squares=squares, count=count,
        tracks=joined(first_tracks, b.tracks, border, shift, frames, lost), marks=tuple(marks), mark_due=np.array(due, np.int64),
    )  # fmt: skip


def _before(a: Stretch, c: int, rise: float) -> End:
    """The last points of the first stretch, latest first, in the first frame of the second stretch."""
    phase, lost = a.tail[c]
    return End(phase - a.here[c] - rise * np.arange(len(phase)), lost)


def _head(plan: Plan, a: Stretch, b: Stretch, c: int) -> End:
    """The head of both, with points of the second stretch if the first is too short."""
    mine, more = a.head[c], b.head[c]
    if len(mine.phase) <= a.samples:
        return mine
    phase = more.phase + a.net[c] + (b.first_level[c] - a.first_level[c]) * np.arange(len(more.phase))
    return mine.followed(phase[1:], more.counted[1:] + a.samples - a.present[c], plan.reach)


def _tail(plan: Plan, b: Stretch, c: int, before: End) -> End:
    """The tail of both, with points of the first stretch if the second is too short, in the second frame of the second stretch."""
    if len(b.tail[c].phase) <= b.samples:
        return b.tail[c]
    ago = np.arange(len(before.phase)) + b.samples
    phase = before.phase - b.net[c] + b.here[c] - (b.first_level[c] - b.level[c]) * ago
    return b.tail[c].followed(phase[1:], before.counted[1:] + b.samples - b.present[c], plan.reach)


def _across(theta: np.ndarray, lost: np.ndarray, border: int, m: int, kind: Kind) -> tuple[float, int]:
    """Sum of squares and number of the differences that start before the border and end after it."""
    span = kind.difference * m - (1 if kind.modified else 0)
    low, high = max(border - span + 1, 0), min(border, len(theta) - span)  # starting points low .. high - 1
    if high <= low:
        return 0.0, 0
    used = theta[low : high + span]
    if kind.modified:
        used = used - used.mean()
        used = np.concatenate([[0.0], np.cumsum(used)])
    d = used
    for _ in range(kind.difference):
        d = d[m:] - d[:-m]
    valid = lost[low:high] == lost[low + span : high + span]
    d = d[valid]
    d *= d
    return float(np.sum(d)), len(d)  # a dot product would start the threads of the linear algebra library
