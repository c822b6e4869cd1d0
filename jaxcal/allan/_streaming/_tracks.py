"""Differences at a stride of starting points, from a stream: the phase is kept only at the points that they use.

A cluster size m with stride s uses the starting points 0, s, 2s, ... The points i s + j m, i = 0, 1, ..., form track j. Once the point
on the last track has arrived, its difference is formed and its points are dropped. So each track holds about m/s points, however large
m is.
"""

import dataclasses
import itertools
from collections.abc import Sequence

import equinox as eqx
import numpy as np

#: a position after any sample, for a cluster size that is no longer followed
NEVER = 1 << 62

Rows = tuple[tuple[np.ndarray, ...], ...]


class Tracks(eqx.Module):
    """Points kept for each cluster size and track, and the sums so far. Rows hold position, phase and missing samples of each channel."""

    m: np.ndarray  # (sizes,) cluster sizes, and below their strides
    stride: np.ndarray
    order: int = eqx.field(static=True)  # order of the difference
    due: np.ndarray  # (sizes, order + 1) position of the next point of each track
    ahead: np.ndarray  # (sizes, order + 1) number of points still to come whose difference starts before this stretch of samples
    lead: Rows  # such points that have arrived, kept for the stretch before
    held: Rows  # points whose difference is not complete
    squares: np.ndarray  # (sizes, channels) sum of squared differences, and below the number of those that touch no gap
    count: np.ndarray
    seen: np.ndarray  # (sizes,) number of differences, with or without gaps


@dataclasses.dataclass(frozen=True, slots=True)
class Piece:
    """Phase at the positions now .. now + w of each channel, in one frame, and number of missing samples before each point."""

    now: int
    phase: Sequence[np.ndarray]
    lost: Sequence[np.ndarray | None]
    lost_before: np.ndarray

    def rows(self, first: int, number: int, stride: int) -> np.ndarray:
        """The points first, first + stride, ..., counted from `now`."""
        channels = len(self.phase)
        out = np.empty((number, 1 + 2 * channels))
        out[:, 0] = self.now + first + stride * np.arange(number)
        for c in range(channels):
            out[:, 1 + c] = self.phase[c][first::stride][:number]
            out[:, 1 + channels + c] = self.missing(c, first, number, stride)
        return out

    def missing(self, channel: int, first: int, number: int, stride: int) -> np.ndarray:
        """Number of missing samples before such points, since the stretch began."""
        lost = self.lost[channel]
        if lost is None:
            return np.full(number, float(self.lost_before[channel]))
        return lost[first::stride][:number] + float(self.lost_before[channel])


def new_tracks(m: np.ndarray, stride: np.ndarray, order: int, channels: int, start: int | None) -> Tracks:
    """Tracks without points. `start` is the position of the first sample; None if it is unknown but a multiple of every stride."""
    sizes = len(m)
    begin, tracks = start or 0, np.arange(order + 1)
    own = -(-begin // stride)[:, None]
    lowest = np.iinfo(np.int64).min // 4 if start is None else 0
    # points of differences that start earlier lie after `begin`; the point at `begin` is the last of the stretch before
    first = np.maximum(lowest, (begin - tracks * m[:, None]) // stride[:, None] + 1)
    first[:, 0] = own[:, 0]
    first = np.minimum(first, own)
    empty = np.empty((0, 1 + 2 * channels))
    rows = tuple((empty,) * (order + 1) for _ in range(sizes))
    zero = np.zeros((sizes, channels))
    return Tracks(
        m=m, stride=stride, order=order, due=first * stride[:, None] + tracks * m[:, None], ahead=own - first,
        lead=rows, held=rows, squares=zero, count=zero.astype(np.int64), seen=np.zeros(sizes, np.int64),
    )  # fmt: skip


def at_the_beginning(tracks: Tracks) -> Tracks:
    """The tracks of a stretch that turns out to begin the record: no difference starts before it."""
    none = tuple(tuple(rows[:0] for rows in row) for row in tracks.lead)
    due = tracks.due + tracks.ahead * tracks.stride[:, None]
    return eqx.tree_at(lambda t: (t.due, t.ahead, t.lead), tracks, (due, np.zeros_like(tracks.ahead), none))


def extended(tracks: Tracks, piece: Piece, tilt: np.ndarray, to_first: tuple[np.ndarray, np.ndarray]) -> Tracks:
    """The tracks after another piece.

    `tilt` is the (channels,) slope that transforms stored points, counted from piece.now, into the frame of the piece. `to_first` is the
    offset and slope that transform the piece into the frame of `lead`.
    """
    channels, last, order = len(piece.phase), len(piece.phase[0]) - 1, tracks.order
    held = list(_tilted(tracks.held, piece.now, tilt))
    lead, due, ahead = list(tracks.lead), tracks.due.copy(), tracks.ahead.copy()
    squares, count, seen = tracks.squares.copy(), tracks.count.copy(), tracks.seen.copy()
    for b in np.flatnonzero((due <= piece.now + last).any(axis=1)):
        stride, first, number = int(tracks.stride[b]), [], []
        leading, rest = list(lead[b]), []
        for j in range(order + 1):
            begin = int(due[b, j]) - piece.now
            come = max((last - begin) // stride + 1, 0)
            due[b, j] += come * stride
            early = min(come, int(ahead[b, j]))
            if early:
                rows = piece.rows(begin, early, stride)
                rows[:, 1 : 1 + channels] += to_first[0] + to_first[1] * (rows[:, :1] - piece.now)
                leading[j] = np.concatenate([leading[j], rows])
                ahead[b, j] -= early
            first.append(begin + early * stride)
            number.append(come - early)
        lead[b] = tuple(leading)
        complete = number[-1]  # the last track stores nothing: its points complete a difference at once
        for c in range(channels if complete else 0):
            points = [
                np.concatenate([held[b][j][:, 1 + c], piece.phase[c][first[j] :: stride][: number[j]]])[:complete] for j in range(order + 1)
            ]
            ends = None
            if piece.lost[c] is not None or piece.lost_before[c]:
                begun = np.concatenate([held[b][0][:, 1 + channels + c], piece.missing(c, first[0], number[0], stride)])
                ends = begun[:complete], piece.missing(c, first[-1], complete, stride)
            total, valid = _sum_of_squares(points, ends)
            squares[b, c] += total
            count[b, c] += valid
        seen[b] += complete
        for j in range(order + 1):
            passed = max(complete - len(held[b][j]), 0)
            fresh = piece.rows(first[j] + passed * stride, number[j] - passed, stride)
            rest.append(np.concatenate([held[b][j][complete:], fresh]))
        held[b] = tuple(rest)
    return eqx.tree_at(
        lambda t: (t.due, t.ahead, t.lead, t.held, t.squares, t.count, t.seen), tracks,
        (due, ahead, tuple(lead), tuple(held), squares, count, seen),
    )  # fmt: skip


def joined(a: Tracks, b: Tracks, border: int, shift: int, frames: tuple, lost: np.ndarray) -> Tracks:
    """The tracks of two neighbouring stretches that share the phase point at `border`; `shift` maps positions of `b` to those of `a`.

    `frames` are (offset, slope) from the border for three transformations: a.held into the frame of b.lead, b.lead into that of a.lead, and
    b.lead into that of b.held. `lost` is the (channels,) number of missing samples of `a`.
    """
    channels = len(lost)
    value, missing = slice(1, 1 + channels), slice(1 + channels, None)
    (up, up_tilt), (back, back_tilt), (on, on_tilt) = frames
    ahead, due = a.ahead.copy(), np.maximum(a.due, b.due + shift)
    squares, count, seen = a.squares + b.squares, a.count + b.count, a.seen + b.seen
    leads, helds = [], []
    for i in range(len(a.m)):
        lead, cross = [], []
        for j in range(a.order + 1):
            mine = a.held[i][j].copy()
            # the difference that starts at the border belongs to the second stretch
            mine = mine[mine[:, 0] < border] if j == 0 else mine
            mine[:, value] += up + up_tilt * (mine[:, :1] - border)
            mine[:, missing] -= lost
            come = b.lead[i][j].copy()
            come[:, 0] += shift
            come = come[come[:, 0] >= a.due[i, j]]  # the differences of earlier points would start before the record
            early = come[: int(ahead[i, j])].copy()
            come = come[len(early) :]
            ahead[i, j] -= len(early)
            early[:, value] += back + back_tilt * (early[:, :1] - border)
            early[:, missing] += lost
            lead.append(np.concatenate([a.lead[i][j], early]))
            cross.append(np.concatenate([mine, come]))
        complete = len(cross[-1])
        for c in range(channels if complete else 0):
            ends = cross[0][:complete, 1 + channels + c], cross[-1][:, 1 + channels + c]
            total, valid = _sum_of_squares([rows[:complete, 1 + c] for rows in cross], ends)
            squares[i, c] += total
            count[i, c] += valid
        seen[i] += complete
        held = []
        for j in range(a.order + 1):
            rest, own = cross[j][complete:], b.held[i][j].copy()
            rest[:, value] += on + on_tilt * (rest[:, :1] - border)
            own[:, 0] += shift
            rows = np.concatenate([rest, own])
            rows[:, missing] += lost
            held.append(rows)
        leads.append(tuple(lead))
        helds.append(tuple(held))
    return Tracks(
        m=a.m, stride=a.stride, order=a.order, due=due, ahead=ahead, lead=tuple(leads), held=tuple(helds),
        squares=squares, count=count, seen=seen,
    )  # fmt: skip


def _tilted(held: Rows, now: int, tilt: np.ndarray) -> Rows:
    """Apply the slope to all rows in one array, because there are hundreds of short ones."""
    flat = [rows for tracks in held for rows in tracks]
    if not flat:
        return held
    whole = np.concatenate(flat)
    whole[:, 1 : 1 + len(tilt)] += tilt * (whole[:, :1] - now)
    edges = np.cumsum([0, *(len(rows) for rows in flat)]).tolist()
    parts = iter([whole[a:b] for a, b in itertools.pairwise(edges)])
    return tuple(tuple(next(parts) for _ in tracks) for tracks in held)


def _sum_of_squares(points: list[np.ndarray], ends: tuple[np.ndarray, np.ndarray] | None) -> tuple[float, int]:
    """Sum of the squared differences, formed from neighbours first; with `ends`, only over those without a missing sample in their span."""
    while len(points) > 1:
        points = [b - a for a, b in itertools.pairwise(points)]
    d = points[0]
    if ends is not None:
        d = d[ends[0] == ends[1]]
    d *= d
    return float(np.sum(d)), len(d)  # a dot product would start the threads of the linear algebra library
