"""The statistics by name: which differences they average, how many differences there are, and how they are scaled."""

import dataclasses
import functools
import math

import numpy as np

from .._errors import DataError
from .._types import Any, Int, Sizes


@dataclasses.dataclass(frozen=True)
class Kind:
    """One statistic: differences of `order` of the phase (or of its running sum, if `modified`), at all points or every m-th.

    An `error` of time keeps the line in the phase, and needs a stretch without gaps.
    """

    name: str
    order: int  # 2 Allan, 3 Hadamard: d in the edf formulas
    modified: bool  # first averages the phase over m points
    overlapped: bool  # all starting points, not every m-th
    timed: bool = False  # multiplied by tau/sqrt(3)
    error: bool = False

    @property
    def difference(self) -> int:
        """Order of the difference of the summed array: 3 for the running sum of phase (NIST SP 1065, 5.2.5)."""
        return 3 if self.modified else self.order

    def count(self, samples: Any, m: Int[np.ndarray, " clusters"]) -> Int[np.ndarray, " clusters"]:
        """Number of differences in a record of `samples` rate samples (one more phase point) at cluster sizes m."""
        if not self.overlapped:
            return samples // m - self.order + 1
        return samples - self.difference * m + (2 if self.modified else 1)

    def largest(self, samples: int) -> int:
        """Largest cluster size with at least one difference."""
        if not self.overlapped:
            return samples // self.order
        return (samples + (1 if self.modified else 0)) // self.difference

    def scale(self, m: np.ndarray, rate: float) -> np.ndarray:
        """Factor from the mean squared difference to the variance."""
        m = np.asarray(m, dtype=np.float64)
        if self.error:
            return np.full(m.shape, rate**-2.0)
        factor = 1.0 / ((2.0 if self.order == 2 else 6.0) * m**2)
        if self.modified:
            factor = factor / m**2
        if self.timed:
            factor = factor * (m / rate) ** 2 / 3.0
        return factor


def difference_weights(order: int) -> np.ndarray:
    """Weights of the points in a difference of an order, such as -1, 3, -3, 1."""
    return np.diff(np.eye(order + 1), order, axis=0)[0]


@functools.cache
def autocorrelation(order: int) -> np.ndarray:
    """Weights of the lags 0, 1, ... in the square of such a difference, such as 20, -15, 6, -1."""
    own = difference_weights(order)
    return np.correlate(own, own, "full")[order:]


_KINDS = {
    kind.name: kind
    for kind in (
        Kind("adev", order=2, modified=False, overlapped=False),
        Kind("oadev", order=2, modified=False, overlapped=True),
        Kind("mdev", order=2, modified=True, overlapped=True),
        Kind("tdev", order=2, modified=True, overlapped=True, timed=True),
        Kind("hdev", order=3, modified=False, overlapped=False),
        Kind("ohdev", order=3, modified=False, overlapped=True),
        Kind("mtie", order=1, modified=False, overlapped=True, error=True),
        Kind("tierms", order=1, modified=False, overlapped=True, error=True),
    )
}


def find_kind(name: "str | Kind") -> Kind:
    """The statistic called `name`, or the given one."""
    if isinstance(name, Kind):
        return name
    if name not in _KINDS:
        raise DataError(f"unknown kind {name!r}; expected one of {', '.join(_KINDS)}", code="kind")
    return _KINDS[name]


#: number of cluster sizes up to which every record uses the block kernel, and every size has a noise type of its own
MANY = 512
#: cluster sizes per decade of the "log" grid
PER_DECADE = 15


def whole_sizes(m: Any) -> Int[np.ndarray, " clusters"]:
    """Given cluster sizes as an array of whole numbers; refuses anything else."""
    sizes = np.atleast_1d(np.asarray(m))
    kind = sizes.dtype.kind
    if sizes.ndim != 1 or sizes.size == 0 or kind not in "iuf" or (kind == "f" and np.any(sizes != np.round(sizes))):
        raise DataError(f"cluster sizes must be a list of whole numbers of samples; got {m!r} (tau in s is m / rate)", code="m")
    return sizes.astype(np.int64)


def round_sizes(grid: str, largest: int, *more: str) -> Int[np.ndarray, " clusters"]:
    """Sizes of the grids "octave" and "decade"; the error message lists `more` grids of the caller."""
    if grid == "octave":
        return 2 ** np.arange(int(np.log2(largest)) + 1)
    if grid == "decade":
        return (10 ** np.arange(int(np.log10(largest)) + 1)[:, None] * np.array([1, 2, 4])).ravel()
    raise DataError(f"unknown grid {grid!r}; expected {', '.join(['log', 'octave', 'decade', *more])} or integers", code="grid")


def cluster_sizes(m: Sizes, kind: str | Kind, samples: int) -> Int[np.ndarray, " clusters"]:
    """Cluster sizes in samples at which `deviation` evaluates a record: those of a named grid, or the given ones, checked.

    Parameters
    ----------
    m : "log" (about 15 per decade), "octave" (1, 2, 4, ...), "decade" (1, 2, 4, 10, 20, 40, ...), "all", or integers.
    kind : name of the statistic, such as "oadev".
    samples : number of rate samples.

    Raises
    ------
    DataError
        If the record is too short for the statistic, or a given size is not an integer within 1 .. the largest possible size.

    Examples
    --------
    >>> from jaxcal.allan import cluster_sizes
    >>> cluster_sizes("octave", "oadev", 100).tolist()
    [1, 2, 4, 8, 16, 32]
    """
    kind = find_kind(kind)
    largest = kind.largest(samples)
    if largest < 1 or samples < 2:
        need = kind.difference - (1 if kind.modified else 0)
        need = max(need, 2)
        raise DataError(
            f"{kind.name} needs a record of at least {need} rate samples or {need + 1} phase points; got {samples}", code="too_short"
        )
    if isinstance(m, str):
        if m == "log":
            decades = math.log10(largest)
            powers = np.linspace(0.0, decades, math.ceil(decades * PER_DECADE) + 1)
            return np.unique(np.rint(10.0**powers).astype(np.int64))
        sizes = np.arange(1, largest + 1) if m == "all" else round_sizes(m, largest, "all")
        return sizes[sizes <= largest]
    sizes = whole_sizes(m)
    if sizes.min() < 1 or sizes.max() > largest:
        bad = sizes[(sizes < 1) | (sizes > largest)]
        raise DataError(f"cluster size {bad[0]} is outside 1 .. {largest}, those of {kind.name} for {samples} samples", code="m")
    return sizes
