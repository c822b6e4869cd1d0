"""`deviation`: compute the time-domain statistics of a record, on the host or in a trace."""

import dataclasses
import functools
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._answer import Finding
from .._errors import DataError
from .._precision import host_float64
from .._quality import checked_confidence, checked_rate, checked_record, refuse_infinite
from .._types import Any, Int, Leaf, Samples, Sizes
from ..evidence._uneven import widened
from ._findings import FINDINGS, times
from ._kernels._difference_sums import direct_sums
from ._kernels._phase import IN_CACHE, aligned, integrate, padded_length, running_sum_of_phase
from ._kernels._route import PARALLEL_FROM, record_sums, sums_in_cache
from ._kernels._time_error import measure_whole
from ._kinds import MANY, Kind, cluster_sizes, find_kind
from ._noise_type._identify import identify, noise_types, types_for_intervals
from ._result import Deviation, assembled
from ._uncertainty._edf import Whole, degrees_of_freedom, interval_factors, known_uncertainty, tabulated_factors

#: function that gives the sums, which may still be computed; counts; noise types: (clusters, channels) each
_Measured = tuple[Callable[[], Any], Any, Any]


@host_float64
def deviation(
    y: Samples, rate: Leaf, *, kind: str | Kind = "oadev", m: Sizes = "log", data: str = "rate", confidence: float | int = 0.95,
    alpha: Samples | None = None,
) -> Deviation:  # fmt: skip
    r"""Allan, modified Allan, time or Hadamard deviation, with noise type and interval.

    With the phase :math:`\theta_k = \sum_{t<k} (y_t - \bar y)` in units of samples,

    .. math:: \sigma^2(m\,dt) = \frac{1}{2 m^2 M} \sum_k (\theta_{k+2m} - 2\theta_{k+m} + \theta_k)^2

    over all M starting points k (oadev) or every m-th one (adev). hdev and ohdev use third differences and 6 m^2; mdev first averages
    the phase over m points; tdev is mdev times tau/sqrt(3). Every cluster size is computed exactly.

    ======== ==================================================================================== ============ =================
    kind     variance                                                                             cluster size unit
    ======== ==================================================================================== ============ =================
    mtie     largest range of the phase in a window of m samples, no interval                     1 .. n       times s
    tierms   rms change of the phase over m samples, no interval                                  1 .. n       times s
    ======== ==================================================================================== ============ =================

    More than 512 cluster sizes, or all (``m="all"``), cost O(n log^2 n) in a record without gaps. FFT correlations then replace the direct
    sums, with a relative error of the variance below 1e-8; cluster sizes where rounding could exceed this are summed directly. With gaps,
    adev and hdev are as fast, but the overlapping statistics need the direct sums: n^2/4 differences for all cluster sizes of oadev, which
    takes minutes for 10^6 samples. More than 5e11 differences are refused. With more than 512 cluster sizes, the noise type is identified
    at up to 512 of them and kept up to the next, and the degrees of freedom agree with their formula to 1e-3.

    Parameters
    ----------
    y : (n,) or (n, channels) rate samples in any unit (rad/s, m/s^2), or phase in that unit times s. NaN marks a gap: differences that
        touch it are left out and counted. The total statistics, mtie and tierms need a record without gaps: they use the
        longest stretch without gaps, and a finding reports it. If only some channels contain samples, the others give NaN and a finding.
    rate : sampling rate in Hz.
    kind : "adev", "oadev" (default), "mdev", "tdev", "hdev", "ohdev",
        "mtie" or "tierms". A traced record (jit, grad, vmap) allows the first seven.
    m : cluster sizes in samples: "log" (default, about 15 per decade), "octave", "decade", "all", or integers.
    data : "rate" (default) or "phase".
    confidence : level of the intervals, 0.95 by default.
    alpha : noise type for the degrees of freedom (2 .. -2), to replace the one identified at each cluster size. Of a traced record none
        is identified: it is 0, white noise of the rate, unless given.

    Returns
    -------
    Deviation
        tau in s, deviation and its limits in the unit of y, edf, counts and noise types.

    Raises
    ------
    DataError
        If y is not a record of finite numbers (apart from NaN), y is too short for the statistic or a cluster size, an option is
        unknown, a statistic cannot be traced, or a record with gaps would need more than 5e11 differences.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> white = np.random.default_rng(0).standard_normal(100_000)
    >>> result = jaxcal.allan.deviation(white, rate=100.0, m=[1, 100])
    >>> bool(abs(result.deviation[1] / 0.1 - 1) < 0.05)
    True

    References
    ----------
    W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP 1065, 2008, section 5; IEEE Std 952-1997, annex C;
    intervals: Greenhall and Riley, PTTI 2003; noise type: Riley and Greenhall, EFTF 2004, and with fewer than 30 averages
    the ratio B1 (NIST SP 1065, section 5.5).
    """
    statistic, rate = find_kind(kind), checked_rate(rate)
    if data not in ("rate", "phase"):
        raise DataError(f'unknown data {data!r}; expected "rate" (samples of rate or force) or "phase" (their integral)', code="data")
    confidence, record = checked_confidence(confidence), checked_record(y)
    empty = empty_channels(record)
    if empty is not None:
        rest = {"kind": kind, "m": m, "data": data, "confidence": confidence, "alpha": alpha}
        return _with_empty(deviation(record[:, ~empty], rate, **rest), empty)
    sizes = cluster_sizes(m, statistic, record.shape[0] - (1 if data == "phase" else 0))
    return begin(record, rate, statistic, sizes, confidence, alpha, data=data)()


class Begun(NamedTuple):
    """A deviation whose sums may still be computed: a call waits for them and gives the result.

    The degrees of freedom of many records take less time together (`known_uncertainty` of their `whole`) and may be given.
    """

    sums: Callable[[], Any]
    whole: Whole | None  # of a record without gaps
    finish: Callable[..., Deviation]

    def __call__(self, known: Any = None) -> Deviation:
        return self.finish(known)


def begin(
    y, rate: float, statistic: Kind, sizes: Int[np.ndarray, " clusters"], confidence: float, alpha: Any, *, data="rate",
    uneven: bool = True,
) -> Begun:  # fmt: skip
    """Start `deviation` for a checked record at given cluster sizes.

    The sums of a short record are computed in the background, so a caller with many records should start one before waiting for another.
    A caller with degrees of freedom of its own need not know whether the noise is `uneven`.
    """
    samples = y.shape[0] - (1 if data == "phase" else 0)
    columns = y if y.ndim == 2 else y[:, None]
    findings: tuple[Finding, ...] = ()
    if not isinstance(y, np.ndarray):
        if statistic.error:
            raise DataError(
                f"{statistic.name} is computed on the host, outside of jit, grad and vmap; take another kind of a traced record",
                code="traced",
            )  # fmt: skip
        measured = _traced(columns, sizes, statistic, rate, data, samples, alpha)
    elif statistic.error:
        names = [f"channel {index}" if columns.shape[1] > 1 else "y" for index in range(columns.shape[1])]
        missing = [None if np.isfinite(np.sum(column)) else _missing(column, name) for column, name in zip(columns.T, names, strict=True)]
        total, count, findings = measure_whole(columns, missing, sizes, statistic, rate, data)
        measured = lambda: total, count, np.zeros(count.shape)
    else:
        measured = _measured(columns, sizes, statistic, rate, data, samples, alpha)
    (sums, count, noise), whole = measured, None
    few = isinstance(y, np.ndarray) and not statistic.error and len(sizes) <= MANY
    if few and (count == statistic.count(samples, sizes)[:, None]).all():
        types = types_for_intervals(noise, sizes, samples, data)
        whole = Whole(sizes.tobytes(), types.tobytes(), columns.shape[1], statistic, samples, confidence)

    def finish(known):
        return _finished(y, columns, rate, statistic, sizes, confidence, samples, measured, whole, known, data, findings, uneven)

    return Begun(sums, whole, finish)


def _finished(y, columns, rate, statistic: Kind, sizes, confidence, samples: int, measured, whole, known, data, findings, uneven: bool):
    """The result from sums, counts and noise types, (clusters, channels). The sums come last, because they may still be computed."""
    sums, count, noise = measured
    xp, kept = np if isinstance(y, np.ndarray) else jnp, slice(None)
    expected = statistic.count(samples, sizes)[:, None]
    if xp is np:
        some = np.all(count > 0, axis=1)
        if not some.any():
            lost = int(np.isnan(columns).any(axis=1).sum())
            raise DataError(f"no cluster size has a difference free of gaps: {lost} of {len(y)} samples are missing", code="no_difference")
        if not some.all():
            kept = some
            findings = (*findings, FINDINGS("no_difference", tau=times(sizes[~kept] / rate)))
            count, noise, sizes, expected = count[kept], noise[kept], sizes[kept], expected[kept]
    else:
        count = eqx.error_if(count, xp.any(count == 0), "a cluster size has no difference free of gaps; choose smaller m")
        expected = jnp.asarray(expected, dtype=count.dtype)
    if statistic.error:  # of which no distribution is known
        edf, low, high = (np.full(count.shape, np.nan) for _ in range(3))
    elif whole:
        edf, low, high = known_uncertainty([whole])[0] if known is None else known
    else:
        types = types_for_intervals(noise, sizes, samples, data) if xp is np else noise
        edf, low, high = _uncertainty(types, count, expected, sizes, statistic, samples, confidence, xp)
    if xp is np and uneven and not statistic.error:
        wider, said = widened(edf, columns, 2 if data == "phase" else 1, samples / rate, FINDINGS)
        if (wider < edf).any():
            edf, findings = wider, (*findings, *said)
            low, high = interval_factors(edf, confidence)
    scale = statistic.scale(sizes, rate)[:, None].astype(low.dtype)
    factor = scale / count
    result = xp.sqrt(sums()[kept] * factor)
    factors, skipped = (edf, low, high), expected - count
    return assembled(statistic, rate, sizes, result, factors, count, noise.astype(np.int64), skipped, confidence, findings, y.ndim == 1)


def empty_channels(y):
    """Which channels contain only NaN while others contain samples; None if there are no such channels."""
    if not isinstance(y, np.ndarray) or y.ndim == 1 or not np.isnan(y[0]).any():
        return None
    empty = np.array([bool(np.isnan(column[0]) and np.isnan(column).all()) for column in y.T])
    return empty if empty.any() and not empty.all() else None


def _with_empty(found: Deviation, empty) -> Deviation:
    """The result of the channels with samples, extended by NaN and a finding for channels without samples."""
    values = {"count": 0, "alpha": 0, "skipped": found.count[:, 0] + found.skipped[:, 0]}
    arrays = {}
    for name in ("deviation", "lower", "upper", "edf", "count", "alpha", "skipped"):
        array = getattr(found, name)
        arrays[name] = np.empty((len(array), len(empty)), array.dtype)
        arrays[name][:, ~empty] = array
        arrays[name][:, empty] = np.reshape(values.get(name, np.nan), (-1, 1))
    said = tuple(FINDINGS("empty", f"channel {index}") for index in np.flatnonzero(empty))
    return dataclasses.replace(found, findings=(*said, *found.findings), **arrays)


def _missing(column, name: str):
    """Where a column is NaN; refuses infinite values and columns without any sample."""
    refuse_infinite(column, name)
    gone = np.isnan(column)
    if gone.all():
        raise DataError(f"{name} holds nothing but NaN; leave it out", code="no_numbers")
    return gone


def _uncertainty(noise, count, expected, sizes, statistic: Kind, samples, confidence: float, xp):
    """The edf and the interval factors; in a trace, the factors are read from a table."""
    edf = xp.asarray(degrees_of_freedom(sizes[:, None], noise, statistic, samples), dtype=expected.dtype if xp is jnp else float)
    edf = xp.maximum(edf * (count / expected), 1.0)
    if xp is np:
        return edf, *interval_factors(edf, confidence)
    return edf, *tabulated_factors(edf, 2.0 * samples, confidence, jnp)


def _traced(columns, sizes, statistic: Kind, rate: float, data: str, samples: int, alpha):
    """Sums, counts and noise types of a traced record, by plain algebra that JAX can differentiate."""
    gone = jnp.isnan(columns)
    missing, rule, less = _gap_rule(gone, statistic, data, jnp)
    clean = jnp.where(gone, 0.0, columns)
    if data == "rate":
        present = jnp.sum(~gone, axis=0).astype(columns.dtype)
        mean = jnp.sum(clean, axis=0) / present
        theta = jnp.cumsum(jnp.where(gone, 0.0, columns - mean[None, :]), axis=0)
        theta = jnp.concatenate([jnp.zeros_like(theta[:1]), theta])
    else:
        line = jnp.linspace(0.0, 1.0, samples + 1, dtype=columns.dtype)[:, None]
        theta = (clean - clean[:1] - line * (clean[-1:] - clean[:1])) * rate
    parts = theta
    if statistic.modified:
        parts = jnp.concatenate([jnp.zeros_like(theta[:1]), jnp.cumsum(theta, axis=0)])
    number = statistic.count(samples, sizes)

    def channel(arrays):
        part, lost = arrays
        return direct_sums(
            (part,), lost, jnp.asarray(sizes), jnp.asarray(number), less,
            order=statistic.difference, strided=not statistic.overlapped, rule=rule,
        )  # fmt: skip

    total, count = jax.lax.map(channel, (parts.T, missing.T))
    return lambda: total.T, count.T.astype(columns.dtype), np.full(total.T.shape, 0.0 if alpha is None else float(alpha))


def _gap_rule(gone, statistic: Kind, data: str, xp):
    """Marks of missing samples for the kernels, the gap rule, and by how much the reach is shorter than order*m."""
    if data == "phase" and not statistic.modified:
        return gone.astype(np.int32), "points", 0
    running = xp.cumsum(gone, axis=0, dtype=np.int32)
    running = xp.concatenate([xp.zeros_like(running[:1]), running])
    if statistic.modified and data == "rate":
        # there is one more phase point than rate samples: extend the marks by repeating the last
        running = xp.concatenate([running, running[-1:]])
    return running, "span", 1 if statistic.modified and data == "rate" else 0


def _measured(columns, sizes, statistic: Kind, rate: float, data: str, samples: int, alpha) -> _Measured:
    """The sums, counts and noise types of a record on the host."""
    ascending, back, number = _arranged(sizes.tobytes(), samples, statistic)
    channels = columns.shape[1]
    near = samples < IN_CACHE and len(sizes) <= MANY and jax.default_backend() == "cpu"
    if near and data == "rate" and statistic.overlapped:
        length, sums = padded_length(samples if statistic.modified else IN_CACHE - 1), []
        noise = np.full((len(sizes), channels), np.nan if alpha is None else float(alpha))
        for index, column in enumerate(columns.T):
            theta = aligned(length)
            if not integrate(column, theta[: samples + 1]):
                break  # a record with a gap is handled below
            sums.append(sums_in_cache(theta, ascending, number, statistic))
            if alpha is None:  # while the sums are computed in the background
                noise[:, index] = identify(theta[: samples + 1], None, ascending, statistic, samples, data)[back]
        else:
            count = np.repeat(number[back, None], channels, axis=1)
            return lambda: np.stack([wait() for wait in sums], axis=1)[back], count, noise
    workers = 1
    # a thread that the caller started, as `batch` does for each log, already has a core
    if channels * int(number.sum()) >= PARALLEL_FROM and threading.current_thread() is threading.main_thread():
        workers = min(os.cpu_count() or 1, 16) if jax.default_backend() == "cpu" else 1
    # threads share one record if it is alone or has many cluster sizes; otherwise each thread takes a channel
    split = workers if channels == 1 or len(sizes) > MANY else 1

    def channel(index, run):
        with jax.enable_x64(True):  # thread-local
            prepared = _prepare(columns[:, index], f"channel {index}" if channels > 1 else "y", statistic, rate, data, samples, run, split)
            total, count = record_sums(prepared, ascending, number, statistic, split, run)
            if alpha is None:
                return total, count, noise_types(prepared[1], prepared[2], ascending, statistic, samples, data)
            return total, count, np.full(len(ascending), float(alpha))

    if workers == 1:
        found = [channel(index, map) for index in range(channels)]
    else:
        with ThreadPoolExecutor(workers) as pool:
            over, within = (map, pool.map) if split > 1 else (pool.map, map)
            found = list(over(lambda index: channel(index, within), range(channels)))
    total, count, noise = (np.stack(values, axis=1)[back] for values in zip(*found, strict=True))
    return lambda: total, count, noise


@functools.lru_cache(maxsize=64)
def _arranged(held: bytes, samples: int, statistic: Kind) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ascending cluster sizes, their places in the given order, and their numbers of differences; records of one length share them."""
    sizes = np.frombuffer(held, np.int64)
    order = np.argsort(sizes, kind="stable")
    return sizes[order], np.argsort(order, kind="stable"), statistic.count(samples, sizes[order])


def _prepare(column, name: str, statistic: Kind, rate: float, data: str, samples: int, run: Callable, parts: int):
    """Padded arrays of one channel for the block kernel, and its phase and gap marks for the noise identification."""
    length = padded_length(samples)
    marks = missing = None
    rule, less = "none", 0
    buffer = aligned(length)  # values beyond the record stay arbitrary
    held = buffer[: samples + 1]
    whole = integrate(column, held, run, parts) if data == "rate" else bool(np.isfinite(np.sum(column)))
    gone = None if whole else _missing(column, name)
    if gone is not None and gone.any():
        marks, rule, less = _gap_rule(gone[:, None], statistic, data, np)
        marks = marks[:, 0]
        missing = jnp.asarray(np.pad(marks, (0, length - len(marks))))
        if data == "phase":
            marks = gone.astype(np.int32)
        else:
            integrate(np.where(gone, np.mean(column[~gone]), column), held)
    if data == "phase":
        clean = np.where(gone, 0.0, column) if gone is not None else column
        np.subtract(clean, np.linspace(clean[0], clean[-1], samples + 1), out=held)
        held *= rate
    theta = jax.device_put(buffer, may_alias=True)
    summed = running_sum_of_phase(theta) if statistic.modified else (theta,)
    return summed, held, marks, missing, rule, less
