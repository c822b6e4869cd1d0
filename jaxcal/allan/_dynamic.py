"""`dynamic`: the deviation in windows that move along the record, a surface over time and cluster time."""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .._answer import Curve, Finding, Result, Section
from .._answer._curves import of_channel
from .._arrays import power_of_two
from .._errors import DataError
from .._frozen import channel_of, replaced
from .._precision import host_float64, is_traced
from .._quality import checked_confidence, checked_rate, checked_record, refuse_infinite
from .._types import AnyArray, Array, Float, Int
from ._findings import FINDINGS, times
from ._kernels._difference_sums import difference_of
from ._kernels._phase import double_add, integrate, padded_length, running_sum_of_phase
from ._kinds import Kind, cluster_sizes, find_kind
from ._noise_type._identify import identify, types_for_intervals
from ._uncertainty._edf import degrees_of_freedom, interval_factors

_ROW = 256  # number of squares summed together; a prefix sum runs over these rows
_TYPED = 256  # number of windows in which noise types are identified
_KINDS = ("oadev", "ohdev", "mdev", "tdev")


class DynamicDeviation(Result):
    """A time-domain deviation in windows along the record.

    Attributes
    ----------
    time : (windows,) centres of the windows in s, from the first sample.
    tau : (clusters,) cluster time in s.
    m : (clusters,) cluster size in samples.
    deviation : (windows, clusters) or (windows, clusters, channels), in the unit of the record (tdev: that unit times s). NaN if gaps
        leave no difference in a window, and in a channel without samples; `findings` reports both.
    lower, upper : limits of the interval at level `confidence`, same shape and unit.
    edf : equivalent degrees of freedom of the variance, same shape.
    count : number of differences averaged, same shape.
    alpha : noise type (see `Deviation`), same shape.
    kind : name of the statistic.
    rate : sampling rate in Hz.
    window : length of a window in s.
    confidence : level of the intervals.
    findings : on results that gaps prevent.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).standard_normal(1000)
    >>> found = jaxcal.allan.dynamic(y, 1.0, window=250.0, m=[1, 10])
    >>> found.deviation.shape, found.time[:2].tolist()
    ((7, 2), [125.0, 250.0])
    """

    time: AnyArray
    tau: AnyArray
    m: AnyArray
    deviation: AnyArray
    lower: AnyArray
    upper: AnyArray
    edf: AnyArray
    count: AnyArray
    alpha: AnyArray
    kind: str = eqx.field(static=True)
    rate: float = eqx.field(static=True)
    window: float = eqx.field(static=True)
    confidence: float = eqx.field(static=True)
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    _figure = ("dynamic", False)

    @property
    def headline(self) -> str:
        """Statistic, and number and length of the windows."""
        return f"{self.kind} in {len(self.time)} windows of {self.window:g} s"

    def sections(self) -> list[Section]:
        """The surface of each channel: one row for each window and cluster time."""
        many = self.deviation.ndim > 2
        named = {str(i): self.channel(i) for i in range(self.deviation.shape[2])} if many else {"surface": self}
        windows, clusters = self.deviation.shape[:2]
        unit = "unit s" if self.kind == "tdev" else "unit"
        places = {"time": ("time", np.repeat(self.time, clusters)), "tau": ("time", np.tile(self.tau, windows))}
        quantities = {"deviation": unit, "lower": unit, "upper": unit, "edf": "ratio", "count": "ratio", "alpha": "ratio"}
        return [
            Curve(key, self.kind, places | {name: (unit, np.ravel(getattr(one, name))) for name, unit in quantities.items()})
            for key, one in named.items()
        ]

    def channel(self, index: int) -> "DynamicDeviation":
        """The same result for one of several channels."""
        return replaced(channel_of(self, "deviation", index, axes=3), findings=of_channel(self.findings, index))


@host_float64
def dynamic(
    y: Any, rate: Any, *, window: Any, step: Any = None, m: Any = "log", kind: str = "oadev", confidence: float | int = 0.95
) -> DynamicDeviation:
    r"""Dynamic Allan deviation: how the deviation at each cluster time changes along the record.

    With :math:`E_m(k) = \sum_{j<k} D_m(j)^2` over all overlapping differences of the record, a window of W samples that begins at p has

    .. math:: \sigma^2(p, m) = \frac{E_m(p + W - 2m + 1) - E_m(p)}{2 m^2 (W - 2m + 1)}

    so that any number of windows costs one pass for each cluster size. The result equals `deviation` of each window alone.

    Parameters
    ----------
    y : (n,) or (n, channels) rate samples. NaN marks a gap: differences that touch it are left out and counted.
    rate : sampling rate in Hz.
    window : length of the windows in s.
    step : distance between windows in s; half a window by default.
    m : cluster sizes in samples, as for `deviation`, for the length of a window.
    kind : "oadev" (default), "ohdev", "mdev" or "tdev".
    confidence : level of the intervals, 0.95 by default.

    Returns
    -------
    DynamicDeviation
        time and tau in s, deviation and limits in the unit of y. The intervals equal those of `deviation` in each window. With more
        than 256 windows, noise types are identified in 256 of them, and the others use those of the nearest.

    Raises
    ------
    DataError
        If y is not a record of finite numbers (apart from NaN), a window or step does not suit it, or an option is unknown.

    Examples
    --------
    Noise that doubles after 200 s:

    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).standard_normal(40_000)
    >>> y[20_000:] *= 2.0
    >>> found = jaxcal.allan.dynamic(y, 100.0, window=100.0, m=[1, 10])
    >>> found.time.tolist()
    [50.0, 100.0, 150.0, 200.0, 250.0, 300.0, 350.0]
    >>> bool(abs(found.deviation[-1, 0] / found.deviation[0, 0] - 2) < 0.05)
    True

    References
    ----------
    L. Galleani and P. Tavella, "The dynamic Allan variance", IEEE Trans. UFFC 56, 2009; the prefix sums are our own.
    """
    statistic, rate = find_kind(kind), checked_rate(rate)
    if kind not in _KINDS:
        raise DataError(f"the windows of a dynamic {kind} have no differences in common; use {', '.join(_KINDS)}")
    if is_traced(y):
        raise DataError("dynamic takes a record at hand, not a traced one; use jaxcal.allan.deviation inside jit or grad")
    confidence, y = checked_confidence(confidence), checked_record(y)
    width = _in_samples("window", window, rate)
    stride = max(width // 2, 1) if step is None else _in_samples("step", step, rate)
    if width > len(y):
        raise DataError(f"the window of {width / rate:g} s is longer than the record of {len(y) / rate:g} s; choose a shorter one")
    sizes = cluster_sizes(m, statistic, width)
    starts = np.arange(0, len(y) - width + 1, stride)
    columns = y if y.ndim == 2 else y[:, None]
    found = [
        _one_channel(columns[:, c], f"channel {c}" if y.ndim == 2 else "y", starts, width, sizes, statistic)
        for c in range(columns.shape[1])
    ]
    squares, count, noise = (np.stack(values, axis=-1) for values in zip(*found, strict=True))
    alive = ~np.isnan(columns).all(axis=0)
    if not alive.any():
        raise DataError(f"y holds nothing but NaN in {len(y)} samples")
    findings = [FINDINGS("empty", f"channel {c}") for c in np.flatnonzero(~alive)]
    kept = (count > 0).any(axis=(0, 2))
    if not kept.any():
        raise DataError(
            f"no window has a difference free of gaps: {int(np.isnan(columns).any(axis=1).sum())} of {len(y)} samples are missing"
        )
    if not kept.all():
        findings.append(FINDINGS("no_difference", tau=times(sizes[~kept] / rate)))
        squares, count, noise, sizes = squares[:, kept], count[:, kept], noise[:, kept], sizes[kept]
    empty = count == 0
    if empty[:, :, alive].any():
        findings.append(FINDINGS("gaps_in_windows", some=int(empty[:, :, alive].any(axis=(1, 2)).sum()), windows=len(starts)))
    full = statistic.count(width, sizes)[:, None]
    mean = np.where(empty, np.nan, squares / np.maximum(count, 1))
    deviation = np.sqrt(mean * statistic.scale(sizes, rate)[:, None])
    types = np.stack([types_for_intervals(each, sizes, width, "rate") for each in noise])
    edf = np.where(empty, np.nan, np.maximum(_whole_edf(types, sizes, statistic, width) * (count / full), 1.0))
    low, high = interval_factors(edf, confidence)
    arrays = {"deviation": deviation, "lower": deviation * low, "upper": deviation * high, "edf": edf, "count": count, "alpha": noise}
    if y.ndim == 1:
        arrays = {name: value[:, :, 0] for name, value in arrays.items()}
    return DynamicDeviation(
        time=(starts + width / 2) / rate, tau=sizes / rate, m=sizes, kind=kind, rate=rate, window=width / rate, confidence=confidence,
        findings=tuple(findings), **arrays,
    )  # fmt: skip


def _in_samples(name: str, seconds, rate: float) -> int:
    try:
        value = float(seconds)
    except (TypeError, ValueError):
        value = np.nan
    if not (np.isfinite(value) and round(value * rate) >= 1):
        raise DataError(f"{name} must be a length of time in s, at least one sample ({1 / rate:g} s); got {seconds!r}")
    return round(value * rate)


def _one_channel(column, name: str, starts, width: int, sizes, statistic: Kind):
    """Sums of squares, counts and noise types of one channel, (windows, clusters)."""
    samples, gone = len(column), np.isnan(column)
    refuse_infinite(column, name)
    if gone.all():
        none = np.zeros((len(starts), len(sizes)), np.int64)
        return none.astype(np.float64), none, none
    theta, missing = np.zeros(padded_length(samples)), None
    integrate(np.where(gone, np.mean(column[~gone]), column) if gone.any() else column, theta[: samples + 1], 1)
    if gone.any():
        missing = np.zeros(len(theta), np.int32)
        np.cumsum(gone, out=missing[1 : samples + 1])
    # pad windows and cluster sizes to the bucket, so that neighbouring lengths share one compiled program
    begin = np.pad(starts, (0, power_of_two(len(starts), 64) - len(starts)))
    fill = (0, -len(sizes) % 16)
    # the differences of a window have their starting points in it, from its first sample on
    m, number = np.pad(sizes, fill, constant_values=1), np.pad(statistic.count(width, sizes), fill)
    squares, count = _window_sums(theta, missing, begin, m, number, order=statistic.difference, modified=statistic.modified)
    window, cluster = slice(len(starts)), slice(len(sizes))
    squares, count = np.asarray(squares).T[window, cluster], np.asarray(count).T[window, cluster]
    return squares, count, _noise_types(theta, missing, starts, width, sizes, statistic)


@functools.partial(jax.jit, static_argnames=("order", "modified"))
def _window_sums(
    theta: Float[Array, " padded"],
    missing: Int[Array, " padded"] | None,
    begin: Int[Array, " windows"],
    m: Int[Array, " clusters"],
    number: Int[Array, " clusters"],
    *,
    order: int,
    modified: bool,
) -> tuple[Float[Array, "clusters windows"], Int[Array, "clusters windows"]]:
    """Sum of squared differences with starting points begin .. begin + number - 1, and the number of them that touch no gap.

    The prefix sum is stored as a sum within a row plus an unevaluated sum of two numbers over the rows before, so that a quiet window
    after a loud one keeps its digits.
    """
    length = theta.shape[0]
    parts = running_sum_of_phase(theta) if modified else (theta,)
    # extend the arrays by the reach of the largest cluster size; no window uses the values from there
    parts = tuple(jnp.concatenate([part, jnp.zeros_like(part)]) for part in parts)
    lost = None if missing is None else jnp.concatenate([missing, jnp.zeros_like(missing)])

    def one(args):
        size, differences = args
        total = difference_of(parts, lambda part, j: lax.dynamic_slice(part, (j * size,), (length,)), order)
        end = begin + differences
        if lost is None:
            squares, counts = total * total, jnp.broadcast_to(differences, begin.shape)
        else:
            last = lax.dynamic_slice(lost, (order * size - (1 if modified else 0),), (length,))
            valid = last == lost[:length]
            squares = jnp.where(valid, total * total, 0.0)
            prefix = jnp.concatenate([jnp.zeros(1, begin.dtype), jnp.cumsum(valid.astype(begin.dtype))])
            counts = prefix[end] - prefix[begin]
        return _between(squares, begin, end), counts

    return lax.map(one, (m, number))


def _between(squares, begin, end):
    """Sum of squares[begin:end] for each window."""
    rows = squares.reshape(-1, _ROW)
    inside = jnp.cumsum(rows, axis=1)
    high, low = lax.associative_scan(double_add, (inside[:, -1], jnp.zeros_like(inside[:, -1])))

    def prefix(k):
        row, place = k // _ROW, k % _ROW
        before = jnp.where(row > 0, row - 1, 0)
        part = jnp.where(place > 0, inside[jnp.minimum(row, rows.shape[0] - 1), jnp.maximum(place - 1, 0)], 0.0)
        return jnp.where(row > 0, high[before], 0.0), jnp.where(row > 0, low[before], 0.0), part

    first, last = prefix(begin), prefix(end)
    return (last[0] - first[0]) + ((last[1] - first[1]) + (last[2] - first[2]))


def _noise_types(theta, missing, starts, width: int, sizes, statistic: Kind) -> np.ndarray:
    """Noise types of each window, (windows, clusters)."""
    told = np.unique(np.linspace(0, len(starts) - 1, min(len(starts), _TYPED)).round().astype(int))
    types = []
    for start in starts[told]:
        reach = slice(start, start + width + 1)
        lost = None if missing is None or missing[start] == missing[start + width] else missing[reach]
        types.append(identify(theta[reach], lost, sizes, statistic, width, "rate"))
    nearest = np.searchsorted((told[1:] + told[:-1]) / 2, np.arange(len(starts)))
    return np.stack(types).astype(np.int64)[nearest]


def _whole_edf(noise: np.ndarray, sizes: np.ndarray, statistic: Kind, width: int) -> np.ndarray:
    """Degrees of freedom of windows without gaps, from a table over cluster sizes and noise types."""
    types = np.arange(-4, 3)
    table = degrees_of_freedom(sizes[:, None], types[None, :], statistic, width)
    return table[np.arange(len(sizes))[None, :, None], noise + 4]
