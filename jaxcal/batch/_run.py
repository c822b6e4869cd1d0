"""`run`: perform one task on many logs."""

import collections
import concurrent.futures
import contextlib
import dataclasses
import functools
import json
import math
import os
import pathlib
import pickle
import time
from collections.abc import Callable, Iterable
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from typing import Any

from .._answer import Number
from .._errors import DataError
from .._files import shown, write_atomically
from .._log import Log
from .._types import Checked, PathLike
from ._answer import answer, fingerprint, lost
from ._fleet import Entry, Fleet, overview
from ._paths import find_logs
from ._pool import TRIES, GivenExecutor, WorkerPool, room
from ._store import Store, write_manifest, write_summary
from ._tasks import check_task, identity, reading_options

#: s between checks of the clock, and without an answer until an executor is asked whether it works
_LOOK, _SILENCE = 0.5, 5.0


def run(
    paths: Checked[PathLike | Iterable[PathLike]], task: Checked[str | Callable[[Log], Any]] = "noise", *, executor: Executor | None = None,
    out: Checked[PathLike] | None = None, resume: bool = True, workers: int | None = None, options: dict[str, Any] | None = None,
    reading: dict[str, Any] | None = None, timeout: float | int | None = None, memory: float | int | None = None,
    progress: Callable[[int, int, str], None] | None = None, each: bool = False, reports: bool = False,
) -> Fleet:  # fmt: skip
    """Perform one task on many logs: a result for each log, the spread over all logs, and outliers.

    One bad log does not stop the others: it gets a result that explains the fault. After an interruption, make the same call again to
    resume. Results that still match (SHA-256 of the log, task, options, version) are kept; all others are computed.

    With `out` the folder holds the following files, each written in one step. `results/` has one JSON file per log. `manifest.json` lists
    the task, the versions, and every log with its status, reason and result file. `summary.csv`, and with polars `summary.parquet`, have a
    row per log with all coefficients and intervals. `overview.html` shows the spread of every coefficient, outliers and trends. A second
    run into the same folder is refused while the first is running.

    **Memory.** A worker holds one log at a time, and knows the next. It needs 0.3 to 0.5 GB for JAX and its programs, plus about four times
    the log as 8-byte numbers. This process holds the coefficients (20 kB per log of six channels) and, without `out`, the results. At most
    two logs per worker are handed out at a time.

    **Processes.** By default there is one worker per core. Each is a fresh process with an equal share of the cores as threads, so that
    workers do not compete. A worker compiles each program once, and uses JAX's persistent compilation cache if this process does. A worker
    that dies is replaced and its log tried again; a log fails if its worker dies twice. In a script, call `run` below
    ``if __name__ == "__main__":``.

    Parameters
    ----------
    paths : one path or a list of paths: files, folders (with their subfolders) and patterns such as "logs/*.csv".
    task : "noise", "mag", "imu", "temperature" or "allan", or a function Log -> result made of numbers, arrays, dictionaries, or results of
        jaxcal. A function is named by its module and compared by its source. For worker processes, define it at the top of a module.
    executor : a `concurrent.futures.Executor` to use instead of new processes: threads, processes, or
        ``distributed.Client(...).get_executor()``. It is not shut down.
    out : folder for the results, created if missing. None keeps the results in memory.
    resume : keep results in `out` that match. False computes every log again.
    workers : number of processes; by default one per core. With `executor`: number of logs that it works on at a time.
    options : keyword options of a named task: those of `jaxcal.noise.characterise`, `jaxcal.magnetometer.fit`,
        `jaxcal.imu.multi_position`, `jaxcal.temperature.fit` or `jaxcal.allan.deviation`.
    reading : keyword options of `jaxcal.read`, and `start` and `stop` in s.
    timeout : seconds after which a log is given up and its worker replaced; for the first log of a worker this includes compilation. The
        default is 900 s plus 10 s per MB of the log; `math.inf` sets no limit. Not for an executor.
    memory : bytes above which a worker and its log are given up. By default each worker has an equal share of four fifths of the memory,
        and at least 2 GB; `math.inf` sets no limit. Not for an executor.
    progress : called as progress(done, total, name) after each log.
    each : give a result for every IMU of a log that contains several (ULog, DataFlash, bags, groups of HDF5). By default only the IMU that
        `jaxcal.read` chooses is used, and a warning in the result says so.
    reports : write a page for each log beside its result file, as `jaxcal.report.write` does; `overview.html` leads to it. Needs `out`.

    Returns
    -------
    Fleet
        Its entries hold status, reason, coefficients, findings and the whole result of each log; `spread` compares the logs.

    Raises
    ------
    DataError
        If there are no logs, the call is wrong, another run writes to the same folder, or the executor broke. Finished results are
        kept.
    ExportError
        If results cannot be written, as on a full disk. Finished results are kept.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> import numpy as np
    >>> import jaxcal
    >>> rng = np.random.default_rng(0)
    >>> with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool:
    ...     for i in range(3):
    ...         np.savez(pathlib.Path(folder, f"unit{i}.npz"), gyro=1e-3 * rng.standard_normal((2000, 3)), rate=100.0)
    ...     _ = pathlib.Path(folder, "bad.npz").write_text("this is no log")
    ...     fleet = jaxcal.batch.run(folder, "allan", executor=pool, options={"m": "octave"})
    >>> [entry.status for entry in fleet], sorted(fleet.done[0].coefficients)[0]
    (['failed', 'done', 'done', 'done'], 'gyro_x.floor')
    """
    options, reading = dict(options or {}), dict(reading or {})
    _check(task, options, reading, executor, workers, timeout, memory)
    store = None if out is None else Store(pathlib.Path(out), bool(reports))
    logs, unreadable = find_logs(paths, None if store is None else store.folder)
    if not logs and not unreadable:
        raise DataError(f"no logs at {paths!r}; give files, folders or patterns such as 'logs/*.csv'", code="no_logs")
    if each and reading.get("topics") is not None:
        raise DataError("each= reads every IMU of a log, and topics= in reading= one of them; leave one out", code="each")
    if reports and store is None:
        raise DataError("reports= writes pages beside the result files, and needs out=, a folder for them", code="reports")
    job = _Run(logs, unreadable, (task, options, reading), store, progress or (lambda done, total, name: None), bool(each))
    with contextlib.nullcontext() if store is None else store.held():
        job.work(executor, workers, timeout, memory, resume=bool(resume))
        return job.finished()


def _check(task: Any, options: dict, reading: dict, executor: Any, workers: Any, timeout: Any, memory: Any) -> None:
    check_task(task, options)
    reading_options(reading)
    if not isinstance(task, str) and options:
        raise DataError("options= belongs to named tasks; bind those of your own function with functools.partial", code="option")
    if executor is not None and not isinstance(executor, Executor):
        raise DataError(f"executor must be a concurrent.futures.Executor; got {type(executor).__name__}", code="executor")
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int) or workers < 1):
        raise DataError(f"workers must be a whole number, at least 1; got {workers!r}", code="workers")
    for name, limit, unit in (("timeout", timeout, "seconds"), ("memory", memory, "bytes")):
        if limit is not None and not limit > 0:
            raise DataError(f"{name} must be a positive number of {unit}; got {limit!r}", code=name)
    if (timeout is not None or memory is not None) and executor is not None:
        raise DataError("timeout= and memory= work with the processes of the run; an executor's workers cannot be stopped", code="timeout")
    if executor is None:
        try:
            pickle.dumps((task, options, reading))
        except Exception as error:
            said = f"the task cannot be sent to workers ({error}); define it at the top of a module, or give an executor of threads"
            raise DataError(said, code="task") from error


@dataclasses.dataclass
class _Job:
    path: pathlib.Path
    topics: str = ""  # topics of the IMU; "" for the first
    lost: int = 0
    over: str = ""  # the limit that it exceeded

    @functools.cached_property
    def seconds(self) -> float:
        """How long the log may take by default: a quarter of an hour, plus 10 s per MB."""
        with contextlib.suppress(OSError):
            return 900.0 + 1e-5 * self.path.stat().st_size
        return 900.0


class _Run:
    def __init__(self, logs: list, unreadable: dict, call: tuple[Any, dict, dict], store: Store | None, report: Any, each: bool) -> None:
        self.logs, self.unreadable, self.call, self.store, self.report, self.each = logs, unreadable, call, store, report, each
        self.identity = json.loads(json.dumps(identity(*call)))
        self.entries: dict[tuple[pathlib.Path, str], Entry] = {}
        # the IMUs of each log by their topics; further IMUs are known once the first has been read
        self.imus: dict[pathlib.Path, list[str]] = {path: [""] for path in [*unreadable, *logs]}

    def work(self, executor: Executor | None, workers: int | None, timeout: float | None, memory: float | None, *, resume: bool) -> None:
        """Compute every log that has no result yet."""
        for folder, reason in self.unreadable.items():
            text = lost(str(folder), *self.call, reason=f"the folder cannot be listed: {reason}")
            self._keep(_Job(folder), text)
            self._enter(_Job(folder), text, None)
        waiting = collections.deque(self._left(self.store) if resume and self.store else map(_Job, self.logs))
        if not waiting:
            return
        cores = os.cpu_count() or 1
        if executor is None:
            number = min(workers or cores, len(waiting))
            pool = WorkerPool(number, max(cores // number, 1))
            memory = room(number) if memory is None else memory
        else:
            pool = GivenExecutor(executor, 2 * (workers or getattr(executor, "_max_workers", None) or cores))
        whole = False
        try:
            self._hand_out(pool, waiting, timeout, memory)
            whole = True
        finally:
            pool.close(at_once=not whole)
            if not whole:
                with contextlib.suppress(OSError, ValueError):  # a full disk must not hide the first error
                    self._note()

    def _left(self, store: Store) -> list[_Job]:
        """The logs without a matching result."""
        with ThreadPoolExecutor(min(4, os.cpu_count() or 1)) as pool:  # hashing releases the interpreter lock
            had = [path for path in self.logs if store.file_of(path).exists()]
            for path, (_, sha256) in zip(had, pool.map(fingerprint, had), strict=True):
                if sha256 is None or (first := self._loaded(store, path, "")) is None or first["log"]["sha256"] != sha256:
                    continue
                self.imus[path] = ["", *(first["log"]["others"] if self.each else [])]
                for one in self.imus[path]:
                    found = self._loaded(store, path, one) if one else first
                    if found is not None and found["log"]["sha256"] == sha256:
                        self.entries[path, one] = self._entry(_Job(path, one), found, None, None, kept=True)
        return [_Job(path, one) for path in self.logs for one in self.imus[path] if (path, one) not in self.entries]

    def _loaded(self, store: Store, path: pathlib.Path, topics: str) -> dict[str, Any] | None:
        """A result of this task that need not be tried again, or None."""
        found = store.load(path, topics)
        if found is None or found.get("task") != self.identity or found.get("again"):
            return None
        if store.reports and found["status"] == "done" and not store.page_of(path, topics).exists():
            return None
        # a result that was read without `each` does not list the other IMUs
        return found if not self.each or topics or found["log"].get("each") else None

    def _hand_out(self, pool: Any, waiting: collections.deque, timeout: float | None, memory: float | None) -> None:
        """Hand out the logs as the pool has room, and keep the results."""
        flying: dict[Future, _Job] = {}
        answered = time.monotonic()

        def fill() -> None:
            while waiting and pool.room(len(waiting)):
                job = waiting.popleft()
                page = None if self.store is None else self.store.new_page(job.path, job.topics)
                flying[asked(pool.submit, answer, str(job.path), *self.call, self.each, job.topics, page)] = job

        def asked(function: Callable, *arguments: Any) -> Any:
            try:
                return function(*arguments)
            except Exception as error:  # each library raises its own: BrokenExecutor, RuntimeError, Dask's ClosedClientError
                raise self._stopped(error) from error

        while waiting or flying:
            fill()
            ready, _ = concurrent.futures.wait(flying, timeout=_LOOK, return_when=concurrent.futures.FIRST_COMPLETED)
            if ready:
                answered = time.monotonic()
            elif time.monotonic() - answered > _SILENCE:
                answered = time.monotonic()
                asked(pool.ask)
            if memory is not None:  # only for processes of the run itself
                for future, why in pool.beyond(lambda future: timeout or flying[future].seconds, memory).items():
                    flying[future].over = why
            back = []
            for future in ready:
                job = flying.pop(future)
                back.append((job, *self._outcome(job, future, pool.release(future))))
            for job, text, _ in back:
                if text is None:
                    waiting.appendleft(job)
                else:
                    if self.each and not job.topics:
                        self.imus[job.path] = ["", *json.loads(text)["log"]["others"]]
                        waiting.extend(_Job(job.path, one) for one in self.imus[job.path][1:])
                    self._keep(job, text)  # before a worker gets its next log, so that a kill only loses the logs that workers hold
            try:
                fill()
            finally:  # if the executor takes no more, the manifest must still list what is on the disk
                for job, text, seconds in back:
                    if text is not None:
                        self._enter(job, text, seconds)

    def _outcome(self, job: _Job, future: Future, killed: bool) -> tuple[str | None, float | None]:
        """Text of the result file, or None to try again; and seconds."""
        fault = concurrent.futures.CancelledError() if future.cancelled() else future.exception()
        if fault is None:
            return future.result()
        if job.over:
            return self._lost(job, job.over), None
        if isinstance(fault, BrokenExecutor) and not killed:
            # a process of the run died before it began, or the given executor is gone
            return None, None
        if killed or isinstance(fault, concurrent.futures.CancelledError):
            job.lost += 1
            if job.lost < TRIES:
                return None, None
            reason = "its worker process died twice, as when memory runs out or a library crashes; use fewer workers, or look at the log"
            return self._lost(job, reason if killed else "the executor lost it twice"), None
        said = (str(fault).strip().splitlines() or [""])[0]
        return self._lost(job, f"the executor gave it back with {type(fault).__name__}: {said}"), None

    def _lost(self, job: _Job, reason: str) -> str:
        return lost(str(job.path), *self.call, job.topics, reason=f"{shown(job.path)}: {reason}")

    def _stopped(self, error: BaseException) -> DataError:
        done = f"{sum(entry.status == 'done' for entry in self.entries.values())} of {self._total} logs are done"
        kept = f" and kept in {self.store.folder}; the same call goes on from there" if self.store is not None else ""
        return DataError(f"the executor takes no more logs ({type(error).__name__}: {error}). {done}{kept}", code="executor")

    def _keep(self, job: _Job, text: str) -> None:
        """Write a result to the disk before anything else."""
        if self.store is not None:
            write_atomically(self.store.file_of(job.path, job.topics), text)

    def _enter(self, job: _Job, text: str, seconds: float | None) -> None:
        """Register a result that is kept."""
        entry = self._entry(job, json.loads(text), seconds, text if self.store is None else None)
        self.entries[job.path, job.topics] = entry
        self.report(len(self.entries), self._total, entry.name)

    @property
    def _total(self) -> int:
        return sum(map(len, self.imus.values()))

    def _entry(self, job: _Job, found: dict[str, Any], seconds: float | None, text: str | None, *, kept: bool = False) -> Entry:
        log, file = found["log"], None if self.store is None else self.store.file_of(job.path, job.topics)
        return Entry(
            path=job.path, topics=job.topics, status=found["status"], reason=found["reason"], again=bool(found["again"]),
            coefficients={name: _number(name, **one) for name, one in found["numbers"].items()},
            findings=tuple(found["findings"]), sha256=log["sha256"], date=log["date"] and log["date"][0], seconds=seconds, file=file,
            kept=kept, typed=found.get("typed"), _text=text,
        )  # fmt: skip

    def _note(self) -> None:
        """Write the manifest if there is a folder."""
        if self.store is not None:
            write_manifest(self.store.folder, self._ordered(), self.identity, self._total)

    def _ordered(self) -> list[Entry]:
        return [self.entries[path, one] for path, imus in self.imus.items() for one in imus if (path, one) in self.entries]

    def finished(self) -> Fleet:
        """The fleet, after writing the files about it."""
        fleet = Fleet(tuple(self._ordered()), None if self.store is None else self.store.folder)
        if fleet.out is not None:
            self._note()
            write_summary(fleet.out, fleet.entries)
            from ..report._fleet import write_fleet

            write_fleet(overview(fleet, self.identity), fleet.out / "overview.html")
        return fleet


def _number(name: str, value: Any, low: Any, high: Any, unit: str, state: Any) -> Number:
    """A number from the form of a result file, in which None is an unknown one."""
    known = (math.nan if one is None else one for one in (value, low, high))
    return Number(name, *known, quantity=unit, state=state)
