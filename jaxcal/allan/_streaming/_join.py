"""Two neighbouring stretches of a stream as one: the differences across their border, and both ends carried into common frames."""

import numpy as np

from .._kinds import Kind
from ._phase_stream import AVERAGES, Plan, Stretch
from ._tracks import NEVER, at_the_beginning, joined


def side_by_side(plan: Plan, a: Stretch, b: Stretch) -> Stretch:
    """Two neighbouring stretches as one."""
    kind, channels = plan.kind, len(a.level)
    border = a.origin + a.samples
    shift = border - b.origin  # zero where the second stretch knows its place
    start, first_tracks = a.start, a.tracks
    if start is None and b.start is not None:  # the place of the second says that the first begins the record
        start, first_tracks = 0, at_the_beginning(a.tracks)
    lost = a.samples - a.present
    squares, count = a.squares + b.squares, a.count + b.count
    rise, ends = a.level - b.first_level, {}
    if plan.dense:
        each = []
        for c in range(channels):
            before, after = _before(a, c, rise[c]), (b.head[c], _known(b.head_lost[c], len(b.head[c])))
            across = [np.concatenate([x[:0:-1], y]) for x, y in zip((before[0], -before[1]), after, strict=True)]
            found = [_across(across[0], across[1], len(before[0]) - 1, int(m), kind) for m in plan.m[: plan.dense]]
            squares[:, c] += np.array([f[0] for f in found])
            count[:, c] += np.array([f[1] for f in found])
            each.append((*_head(plan, a, b, c, after), *_tail(plan, b, c, before)))
        ends = dict(zip(("head", "head_lost", "tail", "tail_lost"), zip(*each, strict=True), strict=True))
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
        net=a.net + b.net + (b.first_level - a.first_level) * b.samples, squares=squares, count=count,
        tracks=joined(first_tracks, b.tracks, border, shift, frames, lost), marks=tuple(marks), mark_due=np.array(due, np.int64),
        **({name: getattr(a, name) for name in ("head", "tail", "head_lost", "tail_lost")} | ends),
    )  # fmt: skip


def _known(lost: np.ndarray | None, length: int) -> np.ndarray:
    return np.zeros(length, np.int64) if lost is None else lost.astype(np.int64)


def _before(a: Stretch, c: int, rise: float) -> tuple[np.ndarray, np.ndarray]:
    """Phase of the last points of the first stretch in the first frame of the second, latest first, and samples missing since."""
    tail = a.tail[c]
    return tail - a.here[c] - rise * np.arange(len(tail)), _known(a.tail_lost[c], len(tail))


def _head(plan: Plan, a: Stretch, b: Stretch, c: int, after: tuple[np.ndarray, np.ndarray]):
    """The head of both, with the points of the second where the first is too short."""
    if len(a.head[c]) <= a.samples:
        return a.head[c], a.head_lost[c]
    phase = after[0] + a.net[c] + (b.first_level[c] - a.first_level[c]) * np.arange(len(after[0]))
    lost = np.concatenate([_known(a.head_lost[c], len(a.head[c])), after[1][1:] + a.samples - a.present[c]])[: plan.reach]
    return np.concatenate([a.head[c], phase[1:]])[: plan.reach], lost if lost.any() else None


def _tail(plan: Plan, b: Stretch, c: int, before: tuple[np.ndarray, np.ndarray]):
    """The tail of both, with the points of the first that the second does not push out, in the second frame of the second."""
    if len(b.tail[c]) <= b.samples:
        return b.tail[c], b.tail_lost[c]
    ago = np.arange(len(before[0])) + b.samples
    phase = before[0] - b.net[c] + b.here[c] - (b.first_level[c] - b.level[c]) * ago
    lost = np.concatenate([_known(b.tail_lost[c], len(b.tail[c])), before[1][1:] + b.samples - b.present[c]])[: plan.reach]
    return np.concatenate([b.tail[c], phase[1:]])[: plan.reach], lost.astype(np.int32) if lost.any() else None


def _across(theta: np.ndarray, lost: np.ndarray, border: int, m: int, kind: Kind) -> tuple[float, int]:
    """Sum of squares and count of the differences that start before and end after the border."""
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
    return float(np.sum(d)), len(d)  # a dot product would start the linear algebra library's threads
