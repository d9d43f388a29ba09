"""Workers of a study: own processes, or any `concurrent.futures` executor (see `executors`).

Every result is stored as it arrives: Ctrl-C or a worker that dies costs only the trials that were running.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    ProcessPoolExecutor,
    as_completed,
)
from typing import Any

from omnimj.errors import OmnimjError, SimulationError

Progress = Callable[[str, float], None]
"""Called with a phrase and the finished share, 0 … 1; may raise KeyboardInterrupt."""


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
