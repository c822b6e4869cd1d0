"""Sums of squared differences of a stretch of samples that comes piece by piece.

Differences of the phase do not see a line in it. So the phase is kept relative to the mean of the latest piece, as far back as the
cluster sizes reach: it stays small, and its digits are not lost, however long the stream and wherever its mean wanders.

A stretch has two frames. In the first the phase is zero at its first point and the level is the mean of its first piece: `head`,
`marks` and the leading points of `tracks` are kept there, for a stretch that comes before. The second moves on with each piece.
"""

import itertools
import mmap
from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._errors import DataError
from .._kernels._difference_sums import block_sums
from .._kernels._phase import BLOCK, aligned, running_sum_of_phase
from .._kinds import Kind
from ._tracks import NEVER, Piece, Tracks, extended, new_tracks

#: samples that are taken in at a time
PIECE = 1 << 20
#: points per cluster size between starting points, at least, where not all are taken
PER_CLUSTER = 128
#: averages kept for the noise type, at each cluster size
AVERAGES = 1 << 13
_BUCKET = 16  # numbers of cluster sizes for which one program is compiled


class Plan(eqx.Module):
    """What is computed: cluster sizes in ascending order, the first `dense` of them at every starting point."""

    kind: Kind
    m: np.ndarray
    stride: np.ndarray
    dense: int

    @property
    def reach(self) -> int:
        """Phase points that the longest dense difference spans."""
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


class Stretch(eqx.Module):
    """Everything that is kept of a stretch of samples; channels first, but in tables by cluster size.

    Attributes
    ----------
    start : position of its first sample, None if not known.
    samples : number of samples.
    present : (channels,) samples that are not missing.
    first_level, level : (channels,) levels of the two frames.
    here : (channels,) phase at the last point in the second frame: rounding errors.
    net : (channels,) phase at the last point in the first frame.
    head, tail : phase at the first points, and at the last, latest first, of each channel.
    head_lost, tail_lost : number of missing samples between the first point and each, and between each and the last.
    squares, count : (dense, channels) sums of squares, and differences that touch no gap.
    tracks : the cluster sizes beyond.
    marks : for each cluster size phase (first frame) and missing samples at points m apart, side by side: (points, 2 channels). The
        first is at the first sample, or, where `start` is known, at the first multiple of m in the record.
    mark_due : (sizes,) where the next such point is, counted from the first sample.
    """

    start: int | None
    samples: int
    present: np.ndarray
    first_level: np.ndarray
    level: np.ndarray
    here: np.ndarray
    net: np.ndarray
    head: tuple[np.ndarray, ...]
    tail: tuple[np.ndarray, ...]
    head_lost: tuple[np.ndarray | None, ...]
    tail_lost: tuple[np.ndarray | None, ...]
    squares: np.ndarray
    count: np.ndarray
    tracks: Tracks
    marks: tuple[np.ndarray, ...]
    mark_due: np.ndarray

    @property
    def origin(self) -> int:
        """Position of the first sample; 0 where it is not known."""
        return self.start or 0


def new_stretch(plan: Plan, channels: int, start: int | None) -> Stretch:
    """A stretch without a sample."""
    zero = np.zeros(channels)
    # where its place is known, the points for the noise types are those that one pass over the record would take
    due = plan.m if start is None else np.where(start % plan.m == 0, plan.m, -start % plan.m)
    marks = tuple(np.zeros((int(m == first), 2 * channels)) for m, first in zip(plan.m, due, strict=True))
    return Stretch(
        start=start, samples=0, present=np.zeros(channels, np.int64), first_level=zero, level=zero, here=zero, net=zero,
        head=(np.zeros(1),) * channels, tail=(np.zeros(1),) * channels, head_lost=(None,) * channels, tail_lost=(None,) * channels,
        squares=np.zeros((plan.dense, channels)), count=np.zeros((plan.dense, channels), np.int64),
        tracks=new_tracks(plan.m[plan.dense :], plan.stride[plan.dense :], plan.kind.order, channels, start),
        marks=marks, mark_due=due.copy(),
    )  # fmt: skip


def lengthened(plan: Plan, old: Stretch, samples: np.ndarray, run: Callable, parts: int) -> Stretch:
    """The stretch with up to PIECE more samples, (w, channels).

    Parameters
    ----------
    run : `map`, or that of a pool of threads.
    parts : into how many the work on one channel is shared.
    """
    width, channels = samples.shape
    phase, lost, level, gone = zip(*run(lambda c: _integrated(samples[:, c], old, c), range(channels)), strict=True)
    level, gone = np.array(level), np.array(gone)
    first_level = np.where(old.present > 0, old.first_level, level)
    tilt, drift = old.level - level, level - first_level
    lost_before = old.samples - old.present
    here = np.array([p[-1] for p in phase])
    squares, count, sums, new = old.squares.copy(), old.count.copy(), (), {}
    if plan.dense:
        buffers = list(run(lambda c: _laid_out(plan, old, c, phase[c], lost[c], float(tilt[c])), range(channels)))
        sums = _dense_sums(plan, buffers, old.samples, width, run, parts)
        kept = min(plan.reach, old.samples + width + 1)
        new["tail"] = tuple(b[0][:kept].copy() for b in buffers)
        new["tail_lost"] = tuple(None if b[1] is None or not b[1][:kept].any() else b[1][:kept].copy() for b in buffers)
        need = plan.reach - len(old.head[0])
        if need > 0:
            slopes = drift[:, None] * np.arange(1, min(need, width) + 1)
            ends = old.net - old.here
            new["head"] = tuple(
                np.concatenate([old.head[c], phase[c][1 : need + 1] + ends[c] + slopes[c]]) for c in range(channels)
            )  # fmt: skip
            new["head_lost"] = tuple(
                _more_lost(old.head_lost[c], lost[c], len(old.head[c]), min(need, width), int(lost_before[c])) for c in range(channels)
            )
    piece = Piece(now=old.origin + old.samples, phase=phase, lost=lost, lost_before=lost_before)
    tracks = extended(old.tracks, piece, tilt, (old.net - old.here, drift))
    marks, mark_due = _more_marks(plan, old, Piece(now=old.samples, phase=phase, lost=lost, lost_before=lost_before), drift)
    for c, total, valid in sums:
        squares[:, c] += total[: plan.dense]
        count[:, c] += valid[: plan.dense]
    return Stretch(
        start=old.start, samples=old.samples + width, present=old.present + width - gone, first_level=first_level, level=level, here=here,
        net=old.net + (here - old.here) + drift * width, squares=squares, count=count, tracks=tracks, marks=marks, mark_due=mark_due,
        **({name: getattr(old, name) for name in ("head", "tail", "head_lost", "tail_lost")} | new),
    )  # fmt: skip


def _integrated(samples: np.ndarray, old: Stretch, c: int):
    """Phase in the frame of the piece (its first value is the last of the piece before), missing samples, level, how many missing."""
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


def _laid_out(plan: Plan, old: Stretch, c: int, phase, lost, tilt: float):
    """Phase in reverse order of time, the new points first, as the block kernel wants its starting points; and missing samples."""
    width, tail = len(phase) - 1, old.tail[c]
    buffer = aligned(plan.padded)  # what lies beyond the points stays arbitrary
    buffer[:width] = phase[:0:-1]
    np.multiply(np.arange(len(tail)), -tilt, out=buffer[width : width + len(tail)])
    buffer[width : width + len(tail)] += tail
    tail_lost = old.tail_lost[c]
    if lost is None and tail_lost is None:
        return buffer, None
    counted = np.zeros(plan.padded, np.int32)
    gone = 0 if lost is None else int(lost[-1])
    counted[:width] = 0 if lost is None else gone - lost[:0:-1]
    counted[width : width + len(tail)] = gone if tail_lost is None else gone + tail_lost
    return buffer, counted


def _dense_sums(plan: Plan, buffers, before: int, width: int, run: Callable, parts: int):
    """Channel, sums and counts over the differences that end in the piece; a pool's threads begin at once."""
    kind, m = plan.kind, plan.m[: plan.dense]
    filled = -(-plan.dense // _BUCKET) * _BUCKET - plan.dense
    number = np.clip(kind.count(before + width, m), 0, width)
    # sizes that fill the bucket have no difference
    sizes, number = np.pad(m, (0, filled), constant_values=1), np.pad(number, (0, filled))
    edges = np.linspace(0, -(-width // BLOCK), parts + 1).astype(int)
    tasks = [(c, a, b) for c in range(len(buffers)) for a, b in itertools.pairwise(edges.tolist())]
    ready = list(run(lambda b: _on_device(plan, *b), buffers))

    def one(task):
        c, first, last = task
        with jax.enable_x64(True):  # thread-local
            held, missing = ready[c]
            sums = block_sums(
                held, missing, *(jnp.asarray(v) for v in (sizes, number, np.int64(first), np.int64(last), np.int64(kind.modified))),
                order=kind.difference, strided=False, rule="none" if missing is None else "span",
            )  # fmt: skip
            return c, *(np.asarray(s) for s in sums)

    return run(one, tasks)


def _on_device(plan: Plan, buffer: np.ndarray, counted: np.ndarray | None):
    with jax.enable_x64(True):
        theta = jax.device_put(buffer, may_alias=True)
        parts = running_sum_of_phase(theta) if plan.kind.modified else (theta,)
        return parts, None if counted is None else jnp.asarray(counted)


def _more_lost(old, lost, length: int, number: int, before: int):
    """Missing samples before each point of the head, with those of the piece."""
    if old is None and lost is None and before == 0:
        return None
    old = np.zeros(length, np.int64) if old is None else old
    fresh = np.full(number, before, np.int64)
    return np.concatenate([old, fresh if lost is None else fresh + lost[1 : number + 1]])


def _more_marks(plan: Plan, old: Stretch, piece: Piece, drift: np.ndarray):
    """The points that the noise types are told from, until there are enough."""
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


def pieces_of(waiting: tuple[np.ndarray, ...], chunk: np.ndarray, length: int) -> tuple[Iterator[np.ndarray], np.ndarray]:
    """What waited and the chunk, cut into whole pieces, and the rest."""
    held = sum(len(piece) for piece in waiting)
    edges = np.arange(PIECE - held, len(chunk) + 1, PIECE).tolist()
    first = np.concatenate([*waiting, chunk[: edges[0]]])
    return itertools.chain([first], (chunk[a:b] for a, b in itertools.pairwise(edges))), np.array(chunk[edges[-1] :], dtype=np.float64)


def let_go(source: Any) -> None:
    """Gives back the pages of a memory map that have been read: they count as memory of the process until the system wants them."""
    pages = getattr(source, "_mmap", None)
    # of a copy-on-write map the user's changes would be lost
    if isinstance(pages, mmap.mmap) and getattr(source, "mode", "c") in ("r", "r+") and hasattr(mmap, "MADV_DONTNEED"):
        pages.madvise(mmap.MADV_DONTNEED)
