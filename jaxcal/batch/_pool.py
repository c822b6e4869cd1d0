"""Who computes: processes of our own, each with one log at a time, or any executor."""

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

_STARTS = 3  # workers that may be killed one after another before they have begun
_starting = threading.Lock()


class Worker(SpawnProcess):
    """A fresh process whose libraries find their limits when they are loaded: later they no longer ask."""

    environment: dict[str, str]

    def start(self) -> None:
        with _starting:
            kept = {name: os.environ.get(name) for name in self.environment}
            os.environ.update(self.environment)
            try:
                super().start()
            finally:
                for name, value in kept.items():
                    if value is None:
                        del os.environ[name]
                    else:
                        os.environ[name] = value


class Context(SpawnContext):
    """Of workers with this environment."""

    def __init__(self, environment: dict[str, str]) -> None:
        self.environment = environment
        self.worker: Worker | None = None  # the latest

    def Process(self, *arguments: Any, **options: Any) -> Worker:
        """As the class of that name, which an executor calls."""
        worker = Worker(*arguments, **options)
        worker.environment = self.environment
        self.worker = worker
        return worker


def limits(threads: int) -> dict[str, str]:
    """Environment of a worker: so many threads, no claim on all of an accelerator's memory, the compilation cache of this process."""
    import jax

    count = str(threads)
    found = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS", "NPROC"), count)
    found |= {"PYTHON_CPU_COUNT": count, "XLA_PYTHON_CLIENT_PREALLOCATE": os.environ.get("XLA_PYTHON_CLIENT_PREALLOCATE", "false")}
    if threads == 1:
        found["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_multi_thread_eigen=false".strip()
    for name in ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs", "jax_persistent_cache_min_entry_size_bytes"):
        value = jax.config.values[name]
        if value is not None:
            found[name.upper()] = str(value)
    return found


def _begin() -> None:
    """In a worker: leave interrupts to the parent, and end with it, however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    count = int(os.environ["PYTHON_CPU_COUNT"])
    os.cpu_count = lambda: count  # from Python 3.13 on the variable alone does it

    def follow() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def _hello() -> int:
    return os.getpid()


class Lane:
    """One process. When it dies no other is touched, and it is known whose log it was; the next log finds a fresh one."""

    def __init__(self, environment: dict[str, str]) -> None:
        self.context = Context(environment)
        self.pool: ProcessPoolExecutor | None = None
        self.hello: Future | None = None
        self.began = 0.0

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future:
        if self.pool is None:
            self.pool = ProcessPoolExecutor(1, mp_context=self.context, initializer=_begin)
            self.hello = self.pool.submit(_hello)
            self.hello.add_done_callback(self._clock)  # what a process takes to begin is not the log's
        self._clock()
        return self.pool.submit(function, *arguments)

    def _clock(self, _: Any = None) -> None:
        self.began = time.monotonic()

    @property
    def started(self) -> bool:
        """Whether the process got as far as its first log."""
        return self.hello is not None and self.hello.done() and self.hello.exception() is None

    @property
    def refused(self) -> bool:
        """Whether the process ended by itself before it began, rather than by a signal."""
        worker = self.context.worker
        return not self.started and worker is not None and (worker.exitcode or 0) > 0

    def kill(self) -> None:
        """End the process at once."""
        if self.context.worker is not None:
            self.context.worker.kill()

    def close(self, *, at_once: bool) -> None:
        if self.pool is None:
            return
        if at_once:
            self.kill()
        self.pool.shutdown(wait=True, cancel_futures=True)
        self.pool = self.hello = None


class OwnCrew:
    """Processes of our own."""

    def __init__(self, workers: int, threads: int) -> None:
        environment = limits(threads)
        self._idle = [Lane(environment) for _ in range(workers)]
        self._busy: dict[Future, Lane] = {}
        self._failed_starts = 0

    @property
    def room(self) -> bool:
        return bool(self._idle)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future:
        lane = self._idle.pop()
        try:
            future = lane.submit(function, *arguments)
        except BrokenExecutor:  # it died between two logs
            lane.close(at_once=False)
            future = lane.submit(function, *arguments)
        self._busy[future] = lane
        return future

    def release(self, future: Future) -> bool:
        """The worker of a finished log is free again. Whether the worker died of the log."""
        lane = self._busy.pop(future)
        self._idle.append(lane)
        if not isinstance(future.exception(), BrokenExecutor):
            self._failed_starts = 0
            return False
        begun, refused = lane.started, lane.refused
        lane.close(at_once=False)
        self._failed_starts = 0 if begun else self._failed_starts + 1
        if refused or self._failed_starts >= _STARTS:
            raise DataError(
                "the worker processes end before they begin; in a script call jaxcal.batch.run below "
                'if __name__ == "__main__":, or give an executor of threads'
            )
        return begun

    def ask(self) -> None:
        """Our own processes tell when they end."""

    def overdue(self, seconds: float) -> list[Future]:
        """Kill the workers whose log takes longer; their futures."""
        late = [future for future, lane in self._busy.items() if lane.started and time.monotonic() - lane.began > seconds]
        for future in late:
            self._busy[future].kill()
        return late

    def close(self, *, at_once: bool) -> None:
        for lane in [*self._idle, *self._busy.values()]:
            lane.close(at_once=at_once)


class GivenCrew:
    """Somebody's executor: it is neither restarted nor shut down."""

    def __init__(self, executor: Executor, logs: int) -> None:
        self._executor, self._logs, self._flying = executor, logs, set()
        self._question: Future | None = None

    @property
    def room(self) -> bool:
        return len(self._flying) < self._logs

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future:
        future = self._executor.submit(function, *arguments)
        self._flying.add(future)
        return future

    def release(self, future: Future) -> bool:
        self._flying.remove(future)
        return False

    def ask(self) -> None:
        """Raise what the executor raises when it takes no more: one whose cluster is gone may never answer for the logs it holds."""
        if self._question is not None:
            self._question.cancel()
        self._question = self._executor.submit(int)

    def overdue(self, seconds: float) -> list[Future]:
        return []

    def close(self, *, at_once: bool) -> None:
        for future in [*self._flying, *([] if self._question is None else [self._question])]:
            future.cancel()
