"""`Segments`: Welch's spectrum of a record that arrives chunk by chunk, or in parts on several workers."""

from typing import Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from .._frozen import replaced
from .._precision import is_traced
from .._quality import checked_rate, checked_whole
from .._types import AnyArray
from ._checks import check_options, checked_segment
from ._density import spectrum_of
from ._ordinates import welch
from ._result import Spectrum

_TOGETHER = 1 << 20  # number of samples that are transformed at a time


class Segments(eqx.Module):
    r"""Sums of Welch's periodograms: accepts chunks of any length, merges with its neighbour, and needs constant memory.

    Segments begin at multiples of their distance in the whole record. A part keeps less than a segment of samples at each end, from
    which merging forms the segments across the border. However the record was cut, the result equals, to rounding,
    `density(y, rate, method="welch", segment=...)`. It is frozen: `update` and `merge` return a new one.

    Parameters
    ----------
    rate : sampling rate in Hz.
    segment : length of the segments in samples.
    overlap : share of a segment that the next one contains too.
    channels : number of channels; with 1 (default) the chunks are (n,) or (n, 1), and the result is (values,).
    start : position of the first sample in the record. It is needed only for a part to be merged, if the part does not start at a
        multiple of the distance between segments.

    Raises
    ------
    DataError
        If an option is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).standard_normal(10_000)
    >>> parts = [jaxcal.spectrum.Segments(100.0, 256, start=at).update(y[at : at + 2500]) for at in range(0, 10_000, 2500)]
    >>> found = jaxcal.batch.reduce(parts).result(average=None)
    >>> whole = jaxcal.spectrum.density(y, 100.0, method="welch", segment=256, average=None)
    >>> bool(np.allclose(found.density, whole.density, rtol=1e-12))
    True

    References
    ----------
    P. D. Welch, IEEE Trans. Audio Electroacoust. 15, 1967, 70-73.
    """

    rate: float
    segment: int
    step: int
    channels: int
    start: int | None
    samples: int
    count: int
    _sums: AnyArray
    _head: AnyArray
    _tail: AnyArray

    def __init__(self, rate: Any, segment: int, *, overlap: float = 0.5, channels: int = 1, start: int | None = None):
        self.rate = checked_rate(rate)
        length = segment if isinstance(segment, int | np.integer) else 0
        self.segment, self.step = checked_segment(segment, overlap, "welch", max(int(length), 4))
        self.channels, self.start = checked_whole("channels", channels, 1), None if start is None else checked_whole("start", start, 0)
        self.samples = self.count = 0
        self._sums = np.zeros((self.channels, self.segment // 2))
        self._head = self._tail = np.zeros((0, self.channels))

    def update(self, chunk: Any) -> "Segments":
        """A new `Segments` with the next samples of the record added.

        Parameters
        ----------
        chunk : (n,) or (n, channels) samples without gaps.

        Raises
        ------
        DataError
            If the chunk has another number of channels, is empty, or contains values that are not finite.
        """
        if is_traced(chunk):
            raise DataError("Segments take data at hand, not traced values; use jaxcal.spectrum.density inside jit or grad", code="traced")
        x = np.asarray(chunk)
        if x.dtype.kind not in "fiu" or x.ndim not in (1, 2) or (1 if x.ndim == 1 else x.shape[1]) != self.channels or not len(x):
            raise DataError(f"a chunk must be numbers (n, {self.channels}), time first; got {x.dtype} {x.shape}", code="shape")
        x = x.reshape(len(x), -1).astype(np.float64)
        if not np.isfinite(x).all():
            where = self.samples + int(np.flatnonzero(~np.isfinite(x).all(axis=1))[0])
            raise DataError(f"sample {where} is missing or infinite; take a stretch without gaps", code="gaps")
        end = self._origin + self.samples
        begun = x[max(self._next - end, 0) :] if self._next > end else np.concatenate([self._tail, x])
        sums, count = self._transformed(begun, None)
        head = np.concatenate([self._head, x[: self.segment - 1 - len(self._head)]])
        tail = begun[count * self.step :].copy()
        return replaced(self, samples=self.samples + len(x), count=self.count + count, _sums=self._sums + sums, _head=head, _tail=tail)

    def merge(self, other: "Segments") -> "Segments":
        """A new `Segments` for this part of the record and the part in `other`, which must follow it without a missing sample.

        Raises
        ------
        DataError
            If the parts differ in their options, or are not neighbours.
        """
        if not isinstance(other, Segments):
            raise DataError(f"only Segments can be merged; got {type(other).__name__}", code="parts")
        for name in ("rate", "segment", "step", "channels"):
            if getattr(self, name) != getattr(other, name):
                raise DataError(f"the parts do not join: {name} is {getattr(self, name)!r} and {getattr(other, name)!r}", code="parts")
        border = self._origin + self.samples
        if other.start not in (None, border):
            raise DataError(f"the parts do not join: the first ends at sample {border}, the second starts at {other.start}", code="parts")
        if other.start is None and border % self.step:
            raise DataError(
                f"the parts do not join: the second does not start at a multiple of {self.step} samples, the distance of segments; "
                f"make it with Segments(..., start={border})",
                code="parts",
            )
        bridge = np.concatenate([self._tail, other._head[max(self._next - border, 0) :]])
        across = max(-(-(border - self._next) // self.step), 0)  # number of segments that begin in the first part
        sums, count = self._transformed(bridge, across)
        # a short second part may end before all of these
        tail = other._tail if count == across else bridge[count * self.step :].copy()
        head = np.concatenate([self._head, other._head[: self.segment - 1 - len(self._head)]])
        count, total = self.count + count + other.count, self._sums + sums + other._sums
        return replaced(self, samples=self.samples + other.samples, count=count, _sums=total, _head=head, _tail=tail)

    def result(self, *, sided: int = 2, average: Any = "octave", confidence: float = 0.95, keep_tail: bool = False) -> Spectrum:
        """The spectrum so far; the options are those of `density`.

        Raises
        ------
        DataError
            If no segment is complete, or a channel is constant.
        """
        check_options("welch", sided, average, confidence)
        if not self.count:
            raise DataError(f"no segment is complete: {self.samples} samples, of which {self.segment} are needed", code="too_short")
        found = self._sums / self.count
        if (dead := np.flatnonzero(~found.any(axis=1))).size:
            raise DataError(f"channel {dead[0]} is constant (every sample equal): it has no spectrum; leave it out", code="constant")
        cut = (self.segment, self.step, self.count)
        return spectrum_of(found, self.rate, "welch", sided, average, confidence, bool(keep_tail), cut, self.channels == 1)

    @property
    def _origin(self) -> int:
        return self.start or 0

    @property
    def _next(self) -> int:
        """Start of the first segment that is not complete."""
        ends = self._origin + self.samples
        first = -(-self._origin // self.step) * self.step
        return first if ends < first + self.segment else first + ((ends - first - self.segment) // self.step + 1) * self.step

    def _transformed(self, x: np.ndarray, most: int | None) -> tuple[np.ndarray, int]:
        """Sums over the complete segments of x, which begins with a segment, and their number, limited to `most`."""
        count = max((len(x) - self.segment) // self.step + 1, 0)
        count = count if most is None else min(count, most)
        total, block = np.zeros_like(self._sums), max(_TOGETHER // self.segment, 1)
        for first in range(0, count, block):
            number = min(block, count - first)
            stretch = x[first * self.step : (first + number - 1) * self.step + self.segment]
            total += number * welch(np.ascontiguousarray(stretch.T), 1.0 / self.rate, self.segment, self.step)
        return total, count
