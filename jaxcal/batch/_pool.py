"""The workers of a run: processes of its own, each with one log at a time, or any given executor."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

from .._errors import DataError

TRIES = 2  # workers in a row that may be killed before they begin, or by one log, or executors that may lose a log, before it has failed
_starting = threading.Lock()


class _Process(SpawnProcess):
    """A fresh process with its environment set before its libraries load, because they read their limits only then."""

    environment: dict[str, str]

    def start(self) -> None:
        with _starting:
            kept = {name: os.environ[name] for name in self.environment if name in os.environ}
            os.environ.update(self.environment)
            try:
                super().start()
            finally:
                for name in self.environment:
                    del os.environ[name]
                os.environ.update(kept)


class _Context(SpawnContext):
    """Makes processes with this environment, and remembers the latest."""

    def __init__(self, environment: dict[str, str]) -> None:
        self.environment = environment
        self.latest: _Process | None = None

    def Process(self, *arguments: Any, **options: Any) -> _Process:
        """Make a process; an executor calls this method by the name of the class that it replaces."""
        self.latest = _Process(*arguments, **options)
        self.latest.environment = self.environment
        return self.latest


def room(workers: int) -> float:
    """Bytes that a worker may hold by default: an equal share of four fifths of the memory, and at least 2 GB."""
    try:
        total = float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (ValueError, OSError, AttributeError):
        return float("inf")
    return max(0.8 * total / workers, 2e9)


def limits(threads: int) -> dict[str, str]:
    """Environment of a worker: number of threads, no reservation of an accelerator's memory, the compilation cache of this process.

    Further threads of a BLAS would wait in a loop, as `jaxcal.cli.main` says.
    """
    from .._jax import ONE_THREAD, setting

    count = str(threads)
    found = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    found |= dict.fromkeys(("POLARS_MAX_THREADS", "NPROC", "PYTHON_CPU_COUNT"), count)
    # the C library keeps the memory of a log for the next one: taking it anew, page by page, costs a tenth of the time of a log
    found |= {"MALLOC_MMAP_THRESHOLD_": str(1 << 25), "MALLOC_TRIM_THRESHOLD_": str(1 << 28)}
    found |= {"XLA_PYTHON_CLIENT_PREALLOCATE": os.environ.get("XLA_PYTHON_CLIENT_PREALLOCATE", "false")}
    if threads == 1:
        found["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {ONE_THREAD}".strip()
    names = ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs", "jax_persistent_cache_min_entry_size_bytes")
    return found | {name.upper(): str(value) for name in names if (value := setting(name)) is not None}


def _begin() -> None:
    """In a worker: ignore interrupts, which the parent handles, and end when the parent ends for any reason."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    count = int(os.environ["PYTHON_CPU_COUNT"])
    os.cpu_count = lambda: count  # from Python 3.13 on, the variable alone is enough

    def follow() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


class Worker:
    """One process, and its logs in turn. If it dies, no other process is affected, and the log it held is the first; the next log gets a
    fresh process.
    """

    def __init__(self, environment: dict[str, str]) -> None:
        self.context = _Context(environment)
        self.pool: ProcessPoolExecutor | None = None
        self.hello: Future | None = None
        self.began = 0.0
        self.logs: list[Future] = []

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future:
        if self.pool is None:
            self.pool = ProcessPoolExecutor(1, mp_context=self.context, initializer=_begin)
            self.hello = self.pool.submit(os.getpid)
            self.hello.add_done_callback(self.clock)  # the start of a process does not count as time of the log
        if not self.logs:
            self.clock()
        self.logs.append(self.pool.submit(function, *arguments))
        return self.logs[-1]

    def clock(self, _: Any = None) -> None:
        self.began = time.monotonic()

    @property
    def started(self) -> bool:
        """Whether the process reached its first log."""
        return self.hello is not None and self.hello.done() and self.hello.exception() is None

    @property
    def refused(self) -> bool:
        """Whether the process ended by itself before it began, and not by a signal."""
        process = self.context.latest
        return not self.started and process is not None and (process.exitcode or 0) > 0

    @property
    def memory(self) -> int:
        """Bytes that the process holds; 0 if the system does not report it."""
        process = self.context.latest
        try:
            with open(f"/proc/{process.pid if process is not None else 0}/statm") as file:
                return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
        except (OSError, ValueError, IndexError):
            return 0

    def kill(self) -> None:
        """End the process at once."""
        if self.context.latest is not None:
            self.context.latest.kill()

    def close(self, *, at_once: bool) -> None:
        if self.pool is not None:
            if at_once:
                self.kill()
            self.pool.shutdown(wait=True, cancel_futures=True)
            self.pool = self.hello = None
            self.logs = []


class WorkerPool:
    """Processes of the run itself, each with one log at a time, and one that waits for it while there are enough for all."""

    def __init__(self, workers: int, threads: int) -> None:
        environment = limits(threads)
        self._workers = [Worker(environment) for _ in range(workers)]
        self._busy: dict[Future, Worker] = {}
        self._fallen: dict[Future, bool] = {}  # a log whose process was found dead by the next one, and whether it had begun
        self._failed_starts = 0

    def room(self, waiting: int) -> bool:
        """Whether a worker takes a further log, if so many wait."""
        return min(len(worker.logs) for worker in self._workers) < 1 + (waiting > len(self._workers))

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future:
        worker = min(self._workers, key=lambda worker: len(worker.logs))
        try:
            future = worker.submit(function, *arguments)
        except BrokenExecutor:  # the process has died
            self._fallen |= dict.fromkeys(worker.logs[:1], worker.started)
            worker.close(at_once=False)
            future = worker.submit(function, *arguments)
        self._busy[future] = worker
        return future

    def release(self, future: Future) -> bool:
        """Free the worker of a finished log. Returns whether the log killed the worker."""
        worker = self._busy.pop(future)
        first = future in worker.logs[:1]
        worker.logs = [one for one in worker.logs if one is not future]
        if future in self._fallen:
            return self._fallen.pop(future)
        if not isinstance(future.exception(), BrokenExecutor):
            self._failed_starts = 0
            worker.clock()
        if not (first and isinstance(future.exception(), BrokenExecutor)):  # a log that waited behind another did not kill it
            return False
        begun, refused = worker.started, worker.refused
        worker.close(at_once=False)
        self._failed_starts = 0 if begun else self._failed_starts + 1
        if refused or self._failed_starts >= TRIES:
            said = 'the workers end before they begin; in a script call jaxcal.batch.run below if __name__ == "__main__":, or give threads'
            raise DataError(said, code="no_guard")
        return begun

    def ask(self) -> None:
        """Do nothing: the end of a process of the pool is noticed anyway."""

    def beyond(self, seconds: Callable[[Future], float], memory: float) -> dict[Future, str]:
        """Kill workers whose log takes longer than its `seconds` or more than `memory` bytes. Returns their futures with the reason."""
        now = time.monotonic()
        found: dict[Future, str] = {}
        for future, worker in self._busy.items():
            if not worker.started or future not in worker.logs[:1]:
                continue
            held = worker.memory
            if now - worker.began > seconds(future):
                found[future] = f"it took longer than {seconds(future):g} s and was given up"
            elif held > memory:
                found[future] = (
                    f"it took more than {memory / 1e9:.3g} GB of memory and was given up; use fewer workers, a larger memory=, or a "
                    "part of it (start, stop)"
                )
        for future in found:
            self._busy[future].kill()
        return found

    def close(self, *, at_once: bool) -> None:
        for worker in self._workers:
            worker.close(at_once=at_once)


class GivenExecutor:
    """An executor given by the caller: it is neither restarted nor shut down."""

    def __init__(self, executor: Executor, logs: int) -> None:
        self._executor, self._logs, self._flying = executor, logs, set()
        self._question: Future | None = None

    def room(self, _: int) -> bool:
        """Whether the executor takes a further log."""
        return len(self._flying) < self._logs

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future:
        future = self._executor.submit(function, *arguments)
        self._flying.add(future)
        return future

    def release(self, future: Future) -> bool:
        self._flying.remove(future)
        return False

    def ask(self) -> None:
        """Submit an empty task, so that an executor that takes no more raises; a lost cluster may never answer for the logs it holds."""
        if self._question is not None:
            self._question.cancel()
        self._question = self._executor.submit(int)

    def close(self, *, at_once: bool) -> None:
        for future in [*self._flying, *([] if self._question is None else [self._question])]:
            future.cancel()
