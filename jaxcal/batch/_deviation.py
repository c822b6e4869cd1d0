"""`deviation`: for many logs, and for logs larger than memory; `reduce`: merge partial results of one record."""

import dataclasses
import itertools
import os
import pathlib
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Any, TypeVar

import jax
import numpy as np

from .._answer import Finding
from .._errors import DataError
from .._quality import checked_confidence, checked_rate, checked_record
from .._types import Checked, Leaf, Numbers, PathLike, Samples, Sizes
from ..allan import Accumulator, Deviation, deviation as _deviation
from ..allan._deviation import Begun, begin
from ..allan._findings import FINDINGS
from ..allan._kernels._phase import IN_CACHE, padded_length
from ..allan._kinds import MANY, Kind, cluster_sizes, find_kind
from ..allan._stretch import rounded
from ..allan._uncertainty._edf import known_uncertainty
from ..io._chunks import Chunks, array_chunks, open_chunks

T = TypeVar("T", bound=Any)


def deviation(
    source: Checked["PathLike | Numbers | Chunks | Sequence[Any]"], rate: Leaf, *, kind: str = "oadev", m: Sizes = "log",
    confidence: float | int = 0.95, alpha: Samples | None = None, columns: Checked[str | int | Sequence[str | int]] | None = None,
    chunk: int = 4_194_304, exact: int = 65_536, workers: int | None = None, executor: Executor | None = None,
) -> Any:  # fmt: skip
    """Allan, modified Allan, time or Hadamard deviation of a file larger than memory, or of many logs.

    A record of up to `chunk` samples goes through `jaxcal.allan.deviation`. A longer one is read `chunk` samples at a time through
    `jaxcal.allan.Accumulator`. The result is the same up to the cluster size `exact`; larger clusters use a stride of starting points. A
    list of logs of any lengths is shared among the cores. All logs of up to 262,143 samples share one compiled program; longer logs need
    one for each doubling of the length.

    Parameters
    ----------
    source : a path to a .npy, .npz, Parquet or HDF5 file, an array or memory map (n,) or (n, channels), or a list of these, each one
        a separate record. Convert other logs first (`jaxcal.io.convert`).
    rate : sampling rate in Hz, one for all logs, or a list with one for each.
    kind : statistic, see `jaxcal.allan.deviation`.
    m : cluster sizes in samples, as in `jaxcal.allan.deviation`; not "all" for a record longer than `chunk`.
    confidence : level of the intervals, 0.95 by default.
    alpha : noise type for the degrees of freedom (2 .. -2), to replace the one identified at each cluster size.
    columns : channels by number (arrays, .npy) or name (Parquet), or arrays by name (.npz, HDF5). By default all columns
        that contain numbers and are not named as a time.
    chunk : number of samples in memory at a time.
    exact : largest cluster size for which every overlapping difference of a longer record is used; mdev and tdev end there.
    workers : threads for those logs of a list that are longer than `chunk`, have several channels, or need a statistic of the whole record;
        by default Python's pool decides. All other logs share a single thread. With `executor`: number of stretches into which the
        record is cut.
    executor : a `concurrent.futures.Executor` for one record longer than `chunk`. Each worker opens the file by its path and processes one
        stretch; the parts are merged in a tree (`reduce`). Up to rounding the result is that of a single pass.

    Returns
    -------
    Deviation
        tau in s, deviation and its limits in the unit of the record. For a list of logs: a list of results in the same order.

    Raises
    ------
    DataError
        If a record cannot be read or is not a record; for a list, the message names the log.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).standard_normal(50_000).astype(np.float32)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "log.npy")
    ...     np.save(path, y)
    ...     found = jaxcal.batch.deviation(path, 100.0, m=[1, 10, 100], chunk=10_000)
    >>> bool(np.allclose(found.deviation, jaxcal.allan.deviation(y, 100.0, m=[1, 10, 100]).deviation, rtol=1e-12))
    True
    >>> [len(each.m) for each in jaxcal.batch.deviation([y[:1000], y[:2000]], 100.0, m="octave")]
    [9, 10]

    References
    ----------
    See `jaxcal.allan.deviation`.
    """
    if isinstance(chunk, bool) or not isinstance(chunk, int | np.integer) or chunk < 1:
        raise DataError(f"chunk must be a whole number of samples, at least 1; got {chunk!r}", code="chunk")
    options: dict[str, Any] = {"kind": kind, "m": m, "confidence": confidence, "alpha": alpha}
    if not isinstance(source, list | tuple):
        try:
            return _one(_opened(source, columns), rate, int(chunk), exact, options, _shared(executor, workers, source, columns))
        except DataError as error:
            if isinstance(source, str | os.PathLike):
                raise error.of(os.fspath(source)) from error
            raise
    if executor is not None:
        raise DataError("executor= shares one record among workers; a list of logs is shared among threads (workers=)", code="executor")
    rates = list(rate) if isinstance(rate, Sequence | np.ndarray) and not isinstance(rate, str) else [rate] * len(source)
    if len(rates) != len(source):
        raise DataError(f"{len(rates)} rates for {len(source)} logs; give one for each, or a single one", code="rates")
    if not source:
        raise DataError("the list of logs is empty", code="empty")

    def named(index: int, function: Callable, *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except DataError as error:
            name = f" ({source[index]})" if isinstance(source[index], str | os.PathLike) else ""
            raise error.of(f"log {index}{name}") from error

    records = [named(i, _opened, each, columns) for i, each in enumerate(source)]
    rates = [named(i, checked_rate, each) for i, each in enumerate(rates)]
    statistic, confidence = find_kind(kind), checked_confidence(confidence)
    found: dict[int, Deviation] = {}

    def begun(i: int) -> Begun:
        sizes = cluster_sizes(m, statistic, records[i].samples)
        y = checked_record(records[i].read(0, records[i].samples)[:, 0])
        return begin(y, rates[i], statistic, sizes, confidence, alpha)

    # One thread for the short records, whose sums are computed in the background: start each before waiting for the one before.
    # With short NumPy steps, several threads would only wait for the interpreter and for one another.
    short = [i for i, record in enumerate(records) if record.flat and record.samples < min(chunk + 1, IN_CACHE) and _plain(m, statistic)]
    with jax.enable_x64(True):
        for at in range(0, len(short), MANY):
            waits: list[tuple[int, Begun]] = []
            for i in short[at : at + MANY]:
                waits.append((i, named(i, begun, i)))
                waits[max(len(waits) - 2, 0)][1].sums()
            whole = [one.whole for _, one in waits if one.whole]
            known = dict(zip(whole, known_uncertainty(whole), strict=True))
            found |= {i: named(i, wait, known[wait.whole] if wait.whole else None) for i, wait in waits}

    def alone(i: int) -> Deviation:
        return named(i, _one, records[i], rates[i], int(chunk), exact, options)

    others = [i for i in range(len(records)) if i not in found]
    ahead = list({padded_length(records[i].samples): i for i in reversed(others)}.values())
    with ThreadPoolExecutor(workers) as pool:
        # compute the first log of each bucket of lengths before the others, or two threads would compile the same program twice
        for turn in (ahead, [i for i in others if i not in ahead]):
            found.update(zip(turn, pool.map(alone, turn), strict=True))
    return [found[i] for i in range(len(records))]


def _plain(m: Any, statistic: Kind) -> bool:
    """Whether there are few cluster sizes, and the statistic uses differences of the record itself."""
    return not statistic.error and (m != "all" if isinstance(m, str) else np.size(m) <= MANY)


def _shared(executor: Any, workers: int | None, source: Any, columns: Any) -> Callable[..., Accumulator] | None:
    """A function (make, samples, chunk) -> accumulator of the whole record, computed by the workers of an executor; None without one."""
    if executor is None:
        return None
    if not isinstance(executor, Executor):
        raise DataError(f"executor must be a concurrent.futures.Executor; got {type(executor).__name__}", code="executor")
    parts = workers or getattr(executor, "_max_workers", None) or os.cpu_count() or 1

    def passed(make: Callable[[int], Accumulator], samples: int, chunk: int) -> Accumulator:
        # use whole chunks, so that a worker holds the same samples at a time as a single pass
        edges = sorted({min(-(-samples * i // parts // chunk) * chunk, samples) for i in range(parts + 1)})
        futures = [executor.submit(_stretch, make(start), source, columns, start, stop, chunk) for start, stop in itertools.pairwise(edges)]
        try:
            return reduce([future.result() for future in futures])
        finally:
            for future in futures:
                future.cancel()

    return passed


def _stretch(empty: Accumulator, source: Any, columns: Any, start: int, stop: int, chunk: int) -> Accumulator:
    """In a worker: accumulate the samples from `start` to `stop`."""
    record, found = _opened(source, columns), empty
    for at in range(start, stop, chunk):
        found = found.update(record.read(at, min(at + chunk, stop)))
    return found


def _one(record: Chunks, rate: Any, chunk: int, exact: int, options: dict[str, Any], shared: Any = None) -> Deviation:
    if record.samples <= chunk:
        y = record.read(0, record.samples)
        return _deviation(y[:, 0] if record.flat else y, rate, **options)
    statistic = find_kind(options["kind"])
    sizes = cluster_sizes(options["m"], statistic, record.samples)
    if isinstance(options["m"], str) and options["m"] == "all":
        raise DataError(f'm="all" needs the whole record in memory: give chunk={record.samples}, or choose m="log"', code="grid")
    sizes = np.unique(rounded(sizes, statistic, exact)) if isinstance(options["m"], str) else sizes
    findings: tuple[Finding, ...] = ()
    if statistic.modified and isinstance(options["m"], str) and sizes[-1] > exact:
        sizes = sizes[sizes <= exact]
        findings = (FINDINGS("ends_early", kind=statistic.name, chunk=chunk, exact=exact),)

    def make(start: int) -> Accumulator:
        return Accumulator(rate, channels=record.channels, exact=exact, start=start, **{**options, "m": sizes})

    if shared is not None:
        accumulator = shared(make, record.samples, chunk)
    else:
        accumulator = make(0)
        for samples in record.of(chunk):
            accumulator = accumulator.update(samples)
    found = accumulator.result()
    tables = ("deviation", "lower", "upper", "edf", "count", "alpha", "skipped") if record.channels == 1 and not record.flat else ()
    columns = {name: getattr(found, name)[:, None] for name in tables}
    return dataclasses.replace(found, findings=(*findings, *found.findings), **columns)


def _opened(source: Any, columns: Any) -> Chunks:
    if isinstance(source, str | os.PathLike):
        record = open_chunks(pathlib.Path(source), columns)
    else:
        record = array_chunks(source if isinstance(source, np.ndarray) else np.asarray(source), columns)
    if record.samples == 0:
        raise DataError("the record is empty", code="empty")
    return record


def reduce(parts: Iterable[T]) -> T:
    """Merge partial results of neighbouring stretches of one record, in a tree.

    Each part is merged with its neighbour, then each pair with the next. No part goes through more than log2(n) merges of n parts, so that
    rounding errors do not grow with n, and different pairs could be merged in parallel.

    Parameters
    ----------
    parts : partial results in the order of the record, each with a method `merge(other)`, such as `jaxcal.allan.Accumulator`.

    Returns
    -------
    The same result as if one accumulator had received the whole record.

    Raises
    ------
    DataError
        If there are no parts, or they are not neighbours.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).standard_normal(1000)
    >>> parts = [jaxcal.allan.Accumulator(100.0, [1, 10]).update(each) for each in np.array_split(y, 5)]
    >>> jaxcal.batch.reduce(parts).samples
    1000
    """
    level = list(parts)
    if not level:
        raise DataError("there are no parts to merge", code="parts")
    if missing := [type(part).__name__ for part in level if not hasattr(part, "merge")]:
        raise DataError(f"{missing[0]} cannot be merged; give parts such as jaxcal.allan.Accumulator", code="parts")
    while len(level) > 1:
        pairs = [level[i].merge(level[i + 1]) for i in range(0, len(level) - 1, 2)]
        level = pairs + level[2 * len(pairs) :]
    return level[0]
