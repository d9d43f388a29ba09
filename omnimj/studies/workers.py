"""Workers of a study: own processes, or any `concurrent.futures` executor, opened by its address.

An address names threads of this process, a Dask cluster or jobs of a SLURM cluster. Results do not depend on
the executor, since a trial has its own seed. Every result is stored as it arrives: Ctrl-C or a worker that
dies costs only the trials that were running.
"""

from __future__ import annotations

import multiprocessing
import os
import re
import shutil
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from contextlib import contextmanager
from typing import Any

from omnimj.errors import InputError, MissingLibrary, OmnimjError, SimulationError

Progress = Callable[[str, float], None]
"""Called with a phrase and the finished share, 0 … 1; may raise KeyboardInterrupt."""
CHOICES = ("threads", "dask:tcp://HOST:PORT", "slurm:jobs=N,cores=N,memory=8GB,walltime=HH:MM:SS")
"""Forms of an address."""
_SCHEDULER = re.compile(r"dask:((?:tcp|tls)://(?:[^\s/:\[\]]+|\[[0-9A-Fa-f:]+\]):(\d{1,5}))")
_CONNECT_TIMEOUT = 10.0  # [s]
_SLURM = {
    "jobs": r"[1-9]\d{0,3}",
    "cores": r"[1-9]\d{0,2}",
    "memory": r"[1-9]\d{0,4}(MB|GB)",
    "walltime": r"\d{1,3}:[0-5]\d:[0-5]\d",
    "queue": r"[\w.-]+",
    "account": r"[\w.-]+",
}
_SLURM_DEFAULTS = {"jobs": "1", "cores": "1", "memory": "4GB", "walltime": "01:00:00"}


class WorkerPool:
    """Executor of a study's trials."""

    def __init__(self, executor: Executor, is_own: bool):
        self._executor, self._is_own = executor, is_own

    def run_all(
        self,
        function: Callable[..., Any],
        tasks: Mapping[str, tuple],
        store: Callable[[str, Any], None],
        phrase: str,
        report: Progress,
    ) -> None:
        """Run all tasks and store each result as it arrives; store a failed one as `{"error": …}`.

        A worker that dies loses only its current task; the others are completed as far as the executor has
        workers left.

        Args:
          function: Function of a module, since workers import it by name.
          tasks: Name → arguments.
          store: Called with the name and the result.
          phrase: Activity for the progress report.
          report: Called after each task.

        Raises:
          SimulationError: Workers died; the message says how many results are missing.
        """
        futures = {self._executor.submit(function, *arguments): name for name, arguments in tasks.items()}
        lost = []
        try:
            report(phrase, 0.0)
            for done, future in enumerate(as_completed(futures), start=1):
                try:
                    store(futures[future], future.result())
                except BrokenExecutor:
                    lost.append(futures[future])
                except OmnimjError as error:
                    store(futures[future], {"error": str(error)})
                report(f"{phrase}: {done} of {len(futures)}", done / len(futures))
        except KeyboardInterrupt:
            if not self._is_own:  # own processes are terminated anyway
                for future in futures:
                    future.cancel()
            raise
        if lost:
            raise SimulationError(_lost_message(sorted(lost), len(futures)))


def run_in_workers(
    work: Callable[[WorkerPool], None], workers: int, executor: Executor | None = None
) -> bool:
    """Run work, called once with the pool, on own processes or on an executor, which is left open.

    Returns:
      True if the work was completed; False after Ctrl-C.

    Raises:
      SimulationError: A worker died.
    """
    before = set(multiprocessing.active_children())
    pool = executor or ProcessPoolExecutor(
        workers, multiprocessing.get_context("spawn"), initializer=_ignore_interrupts
    )
    finished = False
    try:
        work(WorkerPool(pool, executor is None))
        finished = True
    except KeyboardInterrupt:
        pass
    except BrokenExecutor:
        raise SimulationError(_lost_message()) from None
    finally:
        if executor is None:
            _shut_down(pool, before, finished)
    return finished


def _lost_message(names: Sequence[str] = (), count: int = 0) -> str:
    """Return the message after workers died, with the missing results where they are known."""
    missing = ""
    if names:
        missing = f"; {len(names)} of {count} are missing ({names[0]}{', …' if len(names) > 1 else ''})"
    return f"a worker died{missing}; finished results are kept, and the same command continues from there"


def _shut_down(pool: Executor, before: set, finished: bool) -> None:
    """Shut down own workers; terminate them if the work was interrupted.

    Futures are not cancelled then: the pool's management thread fails on cancelled futures when its workers
    vanish.
    """
    pool.shutdown(wait=finished)
    if not finished:
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()


def _ignore_interrupts() -> None:
    """Ignore Ctrl-C, since the parent terminates its workers; exit if the parent is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None  # every worker has a parent
    parent.join()
    os._exit(1)  # no process is left that could receive a result


class WorkerLost(BrokenExecutor):
    """A task whose workers died on every attempt."""


@contextmanager
def open_executor(
    address: str | None, workers: int = 1, timeout: float = _CONNECT_TIMEOUT
) -> Iterator[Executor | None]:
    """Open the executor at an address for the duration of the block; None without an address.

    Args:
      address: One of `CHOICES`.
      workers: Number of threads.
      timeout: Time in which a scheduler must answer [s].

    Raises:
      InputError: The address has the wrong form, no scheduler answers, or a library or SLURM is missing.
    """
    if address is None:
        yield None
    elif address == "threads":
        with _open_threads(workers) as threads:
            yield threads
    elif address.startswith("slurm:"):
        with _open_slurm(address) as executor:
            yield executor
    else:
        with _open_dask(address, timeout) as executor:
            yield executor


@contextmanager
def _open_threads(workers: int) -> Iterator[Executor]:
    """Threads of this process: the compiled loop drives without the interpreter's lock, nothing is copied."""
    pool = ThreadPoolExecutor(workers)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def parse_scheduler(address: str) -> str:
    """Return the scheduler `tcp://HOST:PORT` of `dask:tcp://HOST:PORT`.

    Raises:
      InputError: The address has the wrong form.
    """
    found = _SCHEDULER.fullmatch(address)
    if found is None or not 0 < int(found[2]) < 65536:
        raise InputError("--executor", f"found {address!r}", "an executor is one of these", CHOICES)
    return found[1]


@contextmanager
def _open_dask(address: str, timeout: float) -> Iterator[Executor]:
    scheduler = parse_scheduler(address)
    place = f"--executor {address}"
    try:
        import distributed
    except ImportError:
        raise MissingLibrary(place, "distributed", "dask") from None
    try:
        client = distributed.Client(scheduler, timeout=timeout, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(place, f"no scheduler answers ({reason})", "is a Dask scheduler running?") from None
    try:
        yield DaskExecutor(client, (distributed.KilledWorker,))
    finally:
        client.close()


def parse_slurm(address: str) -> dict[str, str]:
    """Return the options of `slurm:KEY=VALUE,…` with the defaults of those that are not given.

    Raises:
      InputError: A key is unknown or given twice, or a value has the wrong form.
    """
    options: dict[str, str] = {}
    for part in filter(None, address.removeprefix("slurm:").split(",")):
        key, _, value = part.partition("=")
        if key not in _SLURM or key in options:
            problem = "is given twice" if key in options else "is not an option"
            raise InputError(f"--executor {address}", f"{key!r} {problem}", "give each once", tuple(_SLURM))
        if not re.fullmatch(_SLURM[key], value):
            rule = "write it like this: slurm:jobs=4,cores=8,memory=16GB,walltime=02:00:00,queue=short"
            raise InputError(f"--executor {address}", f"{key} is {value!r}", rule)
        options[key] = value
    return _SLURM_DEFAULTS | options


def job_options(options: Mapping[str, str]) -> dict[str, Any]:
    """Arguments of dask-jobqueue for one job of the options of `parse_slurm`: one process per core."""
    cores = int(options["cores"])
    job = {"cores": cores, "processes": cores, "memory": options["memory"], "walltime": options["walltime"]}
    return job | {key: options[key] for key in ("queue", "account") if key in options}


@contextmanager
def _open_slurm(address: str) -> Iterator[Executor]:
    options, place = parse_slurm(address), f"--executor {address}"
    try:
        import distributed
        from dask_jobqueue import SLURMCluster
    except ImportError:
        raise MissingLibrary(place, "dask-jobqueue", "slurm") from None
    if shutil.which("sbatch") is None:
        raise InputError(place, "there is no sbatch on this machine", "run it on a login node of the cluster")
    with SLURMCluster(**job_options(options)) as cluster:
        cluster.scale(jobs=int(options["jobs"]))
        with distributed.Client(cluster, set_as_default=False) as client:
            yield DaskExecutor(client, (distributed.KilledWorker,))


class DaskExecutor(Executor):
    """Executor of a Dask client that reports lost tasks like every other executor, as `WorkerLost`.

    Args:
      client: `distributed.Client`.
      lost: Exceptions by which the client reports that workers died on every attempt.
    """

    def __init__(self, client: Any, lost: tuple[type[BaseException], ...]):
        self._inner: Executor = client.get_executor(pure=False)
        self._lost = lost

    def submit(self, fn: Callable, /, *args: Any, **kwargs: Any) -> Future:
        """Submit a task, as in `concurrent.futures.Executor`."""
        theirs, ours = self._inner.submit(fn, *args, **kwargs), Future()

        def forward_result(done: Future) -> None:
            if not ours.set_running_or_notify_cancel():
                return
            if done.cancelled():
                ours.set_exception(WorkerLost("the cluster cancelled the task"))
                return
            error = done.exception()
            if error is None:
                ours.set_result(done.result())
            elif isinstance(error, (*self._lost, CancelledError)):
                ours.set_exception(WorkerLost(str(error)))
            else:
                ours.set_exception(error)

        def forward_cancellation(done: Future) -> None:
            if done.cancelled():
                theirs.cancel()

        ours.add_done_callback(forward_cancellation)
        theirs.add_done_callback(forward_result)
        return ours

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Shut the executor down, as in `concurrent.futures.Executor`."""
        self._inner.shutdown(wait=wait)
