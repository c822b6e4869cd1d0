"""`Accumulator`: the deviation of a record that arrives chunk by chunk, or that does not fit into memory."""

import itertools
import mmap
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._answer import Finding
from .._errors import DataError
from .._frozen import replaced
from .._precision import is_traced
from .._quality import checked_confidence, checked_rate, checked_whole
from .._types import Checked, Leaf, Samples, Sizes
from . import _stretch
from ._findings import FINDINGS, times
from ._kernels._route import PARALLEL_FROM
from ._kinds import PER_DECADE, Kind, find_kind, round_sizes, whole_sizes
from ._noise_type._b1_ratio import fewest_averages, noise_type_of_ratio
from ._noise_type._identify import FEWEST, identify, types_for_intervals
from ._result import Deviation, assembled
from ._stretch import Points, Stretch, completed, lengthened, new_stretch, reach_of, rounded, side_by_side, strides
from ._uncertainty._edf import degrees_of_freedom, interval_factors

_KINDS = ("adev", "oadev", "mdev", "tdev", "hdev", "ohdev")
_FOLLOWED = 10**10  # largest cluster size of a named grid


class Accumulator(eqx.Module):
    r"""Deviation of a stream: it accepts chunks of any length, merges with its neighbour, and needs constant memory.

    It is frozen, as all models here: `update` and `merge` return a new one and leave the old one unchanged. ::

        acc = jaxcal.allan.Accumulator(rate, "log")
        for chunk in chunks:
            acc = acc.update(chunk)
        deviation = acc.result()

    **What is exact.** Up to the cluster size `exact`, the result equals `jaxcal.allan.deviation` of the whole record, to rounding: it
    contains every overlapping difference, also across the borders of chunks and of merged parts. For larger clusters, the differences of
    oadev and ohdev start at every s-th sample only, where s divides m: the power of two next below m/128, or else the largest divisor up
    to m/128. The phase is then kept at so few points that a cluster size costs 20 kB; the sizes of the named grids are rounded (by 0.4 %
    at most), so that the power of two divides them. The variance
    of the result rises by less than 0.1 % for white noise, flicker and random walk of the rate (by less than 1 % if the record is hardly
    longer than one difference). White noise of phase would lose more, by up to s; it has no weight at such cluster sizes. adev and hdev
    are exact everywhere.

    **Digits.** The phase is kept relative to the mean of the latest 1,048,576 samples, which does not affect any difference. So neither the
    length of the stream nor a wandering mean costs digits. Chunks may be float32; they are summed in float64.

    **Cost.** oadev of a float32 file on the default grid: 31, 16 and 13 ns of processor time a sample at 10^6, 10^7 and 10^8 samples,
    shared by the cores; 0.3 GB in all (`benchmarks/_stream.py`).

    **Noise type.** It is identified as by `deviation`, but from the first 1,024 averages at each cluster size, where `deviation` uses those
    in the middle of a longer record. So the type, and with it the interval, may differ near the boundary between two types.

    Parameters
    ----------
    rate : sampling rate in Hz.
    m : cluster sizes in samples: "log" (default, 15 per decade), "octave", "decade", or integers. A grid grows with the record.
    channels : number of channels, 1 by default. With 1 the chunks are (n,) or (n, 1), and the result is (clusters,).
    kind : "adev", "oadev" (default), "hdev", "ohdev", or, up to `exact`, "mdev" and "tdev".
    exact : largest cluster size in samples for which every overlapping difference is used. It costs 4 to 6 times `exact` numbers per
        channel.
    start : position of the first sample of this part in the record. It is needed only for a part to be merged, if starting points are
        not at every sample and the part does not start at a multiple of their distance.
    confidence : level of the intervals, 0.95 by default.
    alpha : noise type for the degrees of freedom (2 .. -2), to replace the one identified at each cluster size.

    Raises
    ------
    DataError
        If an option is unknown or out of range.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).standard_normal(10_000)
    >>> acc = jaxcal.allan.Accumulator(100.0, [1, 10, 100])
    >>> for chunk in np.array_split(y, 7):
    ...     acc = acc.update(chunk)
    >>> whole = jaxcal.allan.deviation(y, 100.0, m=[1, 10, 100])
    >>> bool(np.allclose(acc.result().deviation, whole.deviation, rtol=1e-12))
    True

    References
    ----------
    W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP 1065, 2008, section 5. Loss due to the stride: the covariance of
    overlapping differences (C. A. Greenhall and W. J. Riley, PTTI 2003) summed over every s-th lag.
    """

    rate: float
    m: tuple[int, ...]
    channels: int
    kind: str
    exact: int
    confidence: float
    alpha: float | int | None
    _named: bool
    _taken: Stretch
    _waiting: tuple[np.ndarray, ...]
    _dropped: tuple[int, ...]

    def __init__(
        self, rate: Leaf, m: Sizes = "log", channels: Checked[int] = 1, kind: str = "oadev", *, exact: Checked[int] = 65_536,
        start: Samples | None = None, confidence: Leaf = 0.95, alpha: Checked[float] | None = None,
    ) -> None:  # fmt: skip
        if kind not in _KINDS:
            raise DataError(f"unknown kind {kind!r} for a stream; expected one of {', '.join(_KINDS)}", code="kind")
        self.rate, self.channels = checked_rate(rate), checked_whole("channels", channels, 1)
        self.exact, place = checked_whole("exact", exact, 1), None if start is None else checked_whole("start", start, 0)
        self.m, self.kind = tuple(_sizes(m, find_kind(kind), self.exact).tolist()), kind
        self.confidence, self.alpha = float(checked_confidence(confidence)), alpha
        self._named, self._waiting, self._dropped = isinstance(m, str), (), ()
        self._taken = new_stretch(self._plan, self._stride, self.channels, place)

    @property
    def _plan(self) -> np.ndarray:
        """The cluster sizes in ascending order, each once."""
        return np.unique(self.m)

    @property
    def _stride(self) -> np.ndarray:
        """Distance of their starting points."""
        return strides(self._plan, find_kind(self.kind), self.exact)

    @property
    def samples(self) -> int:
        """Number of samples so far."""
        return self._taken.samples + sum(len(chunk) for chunk in self._waiting)

    def update(self, chunk: Samples) -> "Accumulator":
        """A new accumulator with the next samples of the record.

        Parameters
        ----------
        chunk : (n,) or (n, channels) rate samples, n >= 1; float32 or float64. A memory map is read piece by piece. NaN marks a gap.

        Returns
        -------
        Accumulator
            The state after the chunk; this accumulator does not change.

        Raises
        ------
        DataError
            If the chunk is empty, has another number of channels, or contains infinite values or anything but numbers.

        Examples
        --------
        >>> import jaxcal
        >>> acc = jaxcal.allan.Accumulator(100.0, [1, 2])
        >>> acc = acc.update([1.0, 2.0, 4.0]).update([3.0])
        >>> acc.samples
        4
        """
        given, chunk = chunk, self._checked(chunk)
        length = len(chunk) + sum(len(piece) for piece in self._waiting)
        if length < _stretch.PIECE:
            waiting, last = list(self._waiting), np.array(chunk, dtype=np.float64)
            if np.isinf(last).any():
                raise DataError("the chunk has infinite values; replace them by NaN to mark a gap", code="infinite")
            # pieces at least halve in length from one to the next, so that short chunks are not copied each time
            while waiting and len(waiting[-1]) <= len(last):
                last = np.concatenate([waiting.pop(), last])
            return replaced(self, _waiting=(*waiting, last))
        piece = _stretch.PIECE
        edges = np.arange(piece - length + len(chunk), len(chunk) + 1, piece).tolist()
        first, rest = np.concatenate([*self._waiting, chunk[: edges[0]]]), np.array(chunk[edges[-1] :], dtype=np.float64)
        pieces = itertools.chain([first], (chunk[a:b] for a, b in itertools.pairwise(edges)))
        return replaced(self, _taken=self._advanced(pieces, given), _waiting=(rest,) if len(rest) else ())

    def merge(self, other: "Accumulator") -> "Accumulator":
        """A new accumulator for this part of the record and the part in `other`, which must follow it without a missing sample.

        Parameters
        ----------
        other : the accumulator of the part that follows, with the same rate, m, channels, kind and `exact`.

        Returns
        -------
        Accumulator
            The same as if one accumulator had received both parts.

        Raises
        ------
        DataError
            If a part is empty, the parts differ in their options, they do not follow one another, or the second part's starting points
            do not continue those of the first. In the last case the message gives the `start` that is needed.

        Examples
        --------
        >>> import numpy as np
        >>> import jaxcal
        >>> y = np.random.default_rng(0).standard_normal(1000)
        >>> first = jaxcal.allan.Accumulator(100.0, [1, 10]).update(y[:333])
        >>> second = jaxcal.allan.Accumulator(100.0, [1, 10]).update(y[333:])
        >>> first.merge(second).samples
        1000
        """
        if not isinstance(other, Accumulator):
            raise DataError(f"only an Accumulator can be merged; got {type(other).__name__}", code="parts")
        for name in ("kind", "rate", "channels", "m", "exact"):
            mine, its = getattr(self, name), getattr(other, name)
            if mine != its:
                shown = "" if name == "m" else f" ({mine!r} and {its!r})"
                raise DataError(f"the parts do not join: they differ in {name}{shown}; make both with the same options", code="parts")
        for which, part in (("first", self), ("second", other)):
            if part.samples == 0:
                raise DataError(f"the {which} part holds no samples; there is nothing to merge", code="no_samples")
        border = self._taken.origin + self.samples
        if other._taken.start not in (None, border):
            raise DataError(f"the parts do not join: the first ends at sample {border}, the second starts at {other._taken.start}",
                            code="parts")  # fmt: skip
        dropped = {*self._dropped, *other._dropped, *(self._astray(other.samples, border) if other._taken.start is None else ())}
        joined = side_by_side(find_kind(self.kind), self._plan, self._flushed(), other._flushed())
        return replaced(self, _taken=joined, _waiting=(), _dropped=tuple(sorted(dropped)))

    def result(self) -> Deviation:
        """The deviation so far.

        Returns
        -------
        Deviation
            The cluster sizes that have a difference; a finding names given sizes that have none. `count` and `skipped` count the
            differences used (see `exact`). A channel without any sample is NaN, and a finding names it.

        Raises
        ------
        DataError
            If no cluster size has a difference free of gaps.

        Examples
        --------
        >>> import jaxcal
        >>> acc = jaxcal.allan.Accumulator(1.0, [1, 1000]).update([1.0, 2.0, 4.0, 3.0])
        >>> acc.result().m.tolist(), acc.result().notes
        ([1], ('No difference without gaps at tau = 1000 s, which is left out.',))
        """
        plan, taken, statistic = self._plan, self._flushed(), find_kind(self.kind)
        samples, alive = taken.samples, taken.present > 0
        if samples == 0:
            raise DataError("the accumulator holds no samples; give it chunks with acc = acc.update(chunk)", code="no_samples")
        if not alive.any():
            raise DataError(f"every channel holds nothing but NaN in {samples} samples", code="no_numbers")
        stride, levels = self._stride, taken.levels
        order = np.concatenate([np.flatnonzero(stride == level.stride) for level in levels])  # of the sums of all levels in the plan
        squares, count = (np.concatenate([getattr(level, name) for level in levels])[np.argsort(order)] for name in ("squares", "count"))
        points = (taken.origin + samples) // stride + -taken.origin // stride + 1
        expected = np.maximum(points - reach_of(statistic, plan // stride), 0)
        begun = (expected > 0) & ~np.isin(plan, self._dropped)
        kept = begun & np.all(count[:, alive] > 0, axis=1)
        if not kept.any():
            smallest = statistic.difference * int(plan[0]) - (1 if statistic.modified else 0)
            reason = f"{samples} samples, of which {smallest} are needed" if not begun.any() else "every difference touches a gap"
            raise DataError(f"no cluster size has a difference free of gaps: {reason}", code="no_difference")
        noise = self._noise_types(taken)
        # in the order in which they were given
        where = np.searchsorted(plan, np.array(self.m))
        chosen = where[kept[where]]
        m = plan[chosen]
        squares, count, expected, noise = squares[chosen], count[chosen], expected[chosen][:, None], noise[chosen]
        with np.errstate(invalid="ignore"):  # 0/0 in a channel without samples gives NaN, which a finding reports
            deviation = np.sqrt(squares / count * statistic.scale(m, self.rate)[:, None])
        types = types_for_intervals(noise, m, samples, "rate")
        edf = np.maximum(degrees_of_freedom(m[:, None], types, statistic, samples) * (count / expected), 1.0)
        edf = np.where(alive, edf, np.nan)
        factors, findings = (edf, *interval_factors(edf, self.confidence)), tuple(self._findings(begun, kept, alive))
        skipped, flat = expected - count, self.channels == 1
        noise = noise.astype(np.int64)
        return assembled(statistic, self.rate, m, deviation, factors, count, noise, skipped, self.confidence, findings, flat)

    def _checked(self, chunk):
        if is_traced(chunk):
            raise DataError("an Accumulator takes data at hand; use jaxcal.allan.deviation inside jit or grad", code="traced")
        chunk = np.asarray(chunk)
        if chunk.dtype.kind not in "fiu" and chunk.size:
            raise DataError(f"a chunk must hold real numbers; got dtype {chunk.dtype}", code="not_numbers")
        if chunk.size == 0:
            raise DataError("the chunk is empty; leave it out", code="empty")
        columns = chunk[:, None] if chunk.ndim == 1 else chunk
        if columns.ndim != 2 or columns.shape[1] != self.channels:
            raise DataError(f"a chunk must be (n, {self.channels}), time first; got shape {chunk.shape}", code="shape")
        return columns

    def _advanced(self, pieces: Iterator[np.ndarray], source: Any = None) -> Stretch:
        taken, plan, kind = self._taken, self._plan, find_kind(self.kind)
        dense = int(np.count_nonzero(self._stride == 1))
        workers = min(os.cpu_count() or 1, 16) if jax.default_backend() == "cpu" else 1
        with ThreadPoolExecutor(workers + 2) as pool:  # two wait for the others
            before = None
            for piece in pieces:
                busy = workers > 1 and len(piece) * dense * self.channels >= PARALLEL_FROM
                taken, lacking = lengthened(kind, plan, taken, piece, pool.map if busy else map, workers if busy else 1)
                # the sums of a piece are formed while the next one is read
                lacking = pool.submit(lacking).result if busy else lacking
                taken, before = completed(taken, before) if before else taken, lacking
                _let_go(source)
            return completed(taken, before) if before else taken

    def _flushed(self) -> Stretch:
        return self._advanced(iter([np.concatenate(self._waiting)])) if self._waiting else self._taken

    def _astray(self, following: int, border: int) -> set[int]:
        """Cluster sizes whose starting points another part does not continue; refuses those that matter."""
        plan, stride = self._plan, self._stride
        astray = plan[border % stride != 0]
        needed = astray[astray * find_kind(self.kind).order <= self.samples + following]
        if len(needed):
            raise DataError(
                f"the parts do not join: at cluster size {needed[0]} not every sample is a starting point, and those of the second part do "
                f"not continue those of the first; make the second with Accumulator(..., start={border}), or cut the record "
                f"at a multiple of {stride[plan == needed[0]][0]} samples", code="parts",
            )  # fmt: skip
        return {int(size) for size in astray}

    def _noise_types(self, taken: Stretch) -> np.ndarray:
        """Noise types at the cluster sizes of the plan, (sizes, channels)."""
        if self.alpha is not None:
            return np.full((len(self._plan), self.channels), float(self.alpha))
        found, carried, kind = [], np.zeros(self.channels), find_kind(self.kind)
        for size, marks in zip(self._plan.tolist(), taken.marks, strict=True):
            carried = np.array([_noise_type(kind, size, marks, c, taken.samples, carried[c]) for c in range(self.channels)])
            found.append(carried)
        return np.stack(found)

    def _findings(self, begun: np.ndarray, kept: np.ndarray, alive: np.ndarray) -> Iterator[Finding]:
        tau, dropped = self._plan / self.rate, np.isin(self._plan, self._dropped)
        lost = ~kept & ~dropped & (begun | (not self._named))
        if lost.any():
            yield FINDINGS("no_difference", tau=times(tau[lost]))
        if dropped.any() and not self._named:
            yield FINDINGS("not_followed", tau=times(tau[dropped]))
        for c in np.flatnonzero(~alive):
            yield FINDINGS("empty", f"channel {c}")


def _noise_type(kind: Kind, size: int, marks: Points, c: int, samples: int, carried: float) -> float:
    averages, phase, lost = marks.number - 1, marks.phase[c], marks.lost[c]
    gaps = lost if averages > 0 and lost[-1] > lost[0] else None
    if averages < fewest_averages(kind):
        return carried
    if averages < FEWEST:
        weight = None if gaps is None else (lost[1:] == lost[:-1]).astype(np.float64)
        return noise_type_of_ratio(np.diff(phase), weight, size, kind, samples, carried)
    if np.count_nonzero(lost[1:] == lost[:-1]) >= FEWEST:
        return identify(phase, gaps, np.ones(1, np.int64), kind, averages, "rate")[0]
    return carried


def _let_go(source: Any) -> None:
    """Release the pages of a memory map that have been read; otherwise they count as memory of the process."""
    pages = getattr(source, "_mmap", None)
    # in a copy-on-write map this would lose the user's changes
    if isinstance(pages, mmap.mmap) and getattr(source, "mode", "c") in ("r", "r+") and hasattr(mmap, "MADV_DONTNEED"):
        pages.madvise(mmap.MADV_DONTNEED)


def _sizes(m, kind: Kind, exact: int) -> np.ndarray:
    """Cluster sizes of a grid, for any length of the record, or the given ones."""
    largest = exact if kind.modified else _FOLLOWED
    if isinstance(m, str):
        if m == "log":
            sizes = np.round(10.0 ** (np.arange(0, PER_DECADE * np.log10(largest) + 1e-9) / PER_DECADE)).astype(np.int64)
        else:
            sizes = round_sizes(m, largest)
        return np.unique(rounded(sizes[sizes <= largest], kind, exact))
    sizes = whole_sizes(m)
    bad = sizes[(sizes < 1) | (sizes > 1 << 52)]
    if bad.size:
        raise DataError(f"a cluster size must be at least 1 sample; got {bad[0]}", code="m")
    if kind.modified and sizes.max() > exact:
        raise DataError(f"{kind.name} of a stream ends at cluster size {exact}; got {sizes.max()}. Raise exact=, or use oadev", code="m")
    return sizes
