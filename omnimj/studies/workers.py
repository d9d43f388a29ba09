"""Does many pieces of work in processes of its own, or in any executor of `concurrent.futures`.

Every result is kept as it comes: Ctrl-C and a worker that dies cost what was under way, nothing else.
"""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    as_completed,
)
from contextlib import contextmanager
from typing import Any

from omnimj.errors import InputError, OmnimjError, SimulationError

Progress = Callable[[str, float], None]
"""Called with a phrase and the share that is done; may raise KeyboardInterrupt."""


class WorkerPool:
    """Those who do the work: processes started here, or somebody's executor."""

    def __init__(self, pool: Executor, is_own: bool):
        self._pool, self._is_own = pool, is_own

    def run_all(
        self,
        function: Callable[..., Any],
        tasks: Mapping[str, tuple],
        keep: Callable[[str, Any], None],
        phrase: str,
        report: Progress,
    ) -> None:
        """Does all tasks, each result kept as it comes; what broke down is kept as `{"error": …}`.

        A worker that dies takes what it was doing with it and nothing else: all the others' work is waited
        for, where the executor has any left.

        Args:
          function: Of a module, since it travels by name.
          tasks: Name → arguments.
          keep: Called with the name and what the function returned.
          phrase: What is being done, for the report.
          report: Called after each.

        Raises:
          SimulationError: Workers died; it says how much is missing.
        """
        futures = {self._pool.submit(function, *given): name for name, given in tasks.items()}
        lost = []
        try:
            report(phrase, 0.0)
            for done, future in enumerate(as_completed(futures), start=1):
                try:
                    keep(futures[future], future.result())
                except BrokenExecutor:
                    lost.append(futures[future])
                except OmnimjError as error:
                    keep(futures[future], {"error": str(error)})
                report(f"{phrase}: {done} of {len(futures)}", done / len(futures))
        except KeyboardInterrupt:
            if not self._is_own:  # own processes end with all they have
                for future in futures:
                    future.cancel()
            raise
        if lost:
            raise SimulationError(_lost_message(sorted(lost), len(futures)))


def run_in_workers(
    work: Callable[[WorkerPool], None], workers: int, executor: Executor | None = None
) -> bool:
    """Does work that needs many hands.

    Args:
      work: Called once; what it finished before an interruption is its own to keep.
      workers: Processes, when they are started here.
      executor: Used instead, and left open; processes of its own when None.

    Returns:
      Whether the work came to its end; False after Ctrl-C.

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


def _lost_message(names: Sequence[str] = (), of: int = 0) -> str:
    """What a user is told when workers died."""
    missing = (
        f"; {len(names)} of {of} are missing ({names[0]}{', …' if len(names) > 1 else ''})" if names else ""
    )
    return f"a worker died{missing}; what was finished is kept, and the same command goes on from there"


def _shut_down(pool: Executor, before: set, finished: bool) -> None:
    """Ends the workers; at once when the work was broken off.

    Nothing is cancelled then: the pool's own thread stumbles over cancelled work when its workers vanish.
    """
    pool.shutdown(wait=finished)
    if not finished:
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()


def _ignore_interrupts() -> None:
    """Ctrl-C is for the parent, which ends its workers itself; one that is killed takes them along."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None  # a worker has one
    parent.join()
    os._exit(1)  # nobody is left to hand a result to


# Executors by address: `dask:tcp://HOST:PORT`, a cluster's scheduler.

_ADDRESS = re.compile(r"dask:((?:tcp|tls)://(?:[^\s/:\[\]]+|\[[0-9A-Fa-f:]+\]):(\d{1,5}))")
_CONNECT_TIMEOUT = 10.0  # [s] in which a scheduler says something, or nobody is there


class WorkerLost(BrokenExecutor):
    """A piece of work whose worker died, as often as it was tried."""


def parse_scheduler(address: str) -> str:
    """`tcp://HOST:PORT` of `dask:tcp://HOST:PORT`.

    Raises:
      InputError: Any other text.
    """
    found = _ADDRESS.fullmatch(address)
    if found is None or not 0 < int(found[2]) < 65536:
        raise InputError("--executor", f"found {address!r}", "write dask:tcp://HOST:PORT")
    return found[1]


@contextmanager
def open_executor(address: str | None, answers: float = _CONNECT_TIMEOUT) -> Iterator[Executor | None]:
    """The executor at an address, for as long as the block lasts; None without one.

    Args:
      address: `dask:tcp://HOST:PORT`.
      answers: Time in which its scheduler must answer [s].

    Raises:
      InputError: No such address, nobody there, or the library is not installed.
    """
    if address is None:
        yield None
        return
    scheduler = parse_scheduler(address)
    place = f"--executor {address}"
    try:
        import distributed
    except ImportError:
        raise InputError(place, "distributed is not installed", "pip install 'omnimj[dask]'") from None
    try:
        client = distributed.Client(scheduler, timeout=answers, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        told = " ".join(str(error).split()) or type(error).__name__
        raise InputError(place, f"nobody answers there ({told})", "is a Dask scheduler running?") from None
    try:
        yield DaskExecutor(client, (distributed.KilledWorker,))
    finally:
        client.close()


class DaskExecutor(Executor):
    """A Dask client's executor whose lost work looks like that of any other executor: `WorkerLost`.

    Args:
      client: `distributed.Client`.
      lost: Errors that say that a worker died, as often as the work was tried.
    """

    def __init__(self, client: Any, lost: tuple[type[BaseException], ...]):
        self._inner: Executor = client.get_executor(pure=False)
        self._lost = lost

    def submit(self, fn: Callable, /, *args: Any, **kwargs: Any) -> Future:
        """As of every executor."""
        theirs, ours = self._inner.submit(fn, *args, **kwargs), Future()

        def passed_on(done: Future) -> None:
            if not ours.set_running_or_notify_cancel():
                return
            if done.cancelled():
                ours.set_exception(WorkerLost("the cluster gave the work up"))
                return
            error = done.exception()
            if error is None:
                ours.set_result(done.result())
            elif isinstance(error, (*self._lost, CancelledError)):
                ours.set_exception(WorkerLost(str(error)))
            else:
                ours.set_exception(error)

        def given_up(done: Future) -> None:
            if done.cancelled():
                theirs.cancel()

        ours.add_done_callback(given_up)
        theirs.add_done_callback(passed_on)
        return ours

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As of every executor."""
        self._inner.shutdown(wait=wait)
