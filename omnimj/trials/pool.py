"""Does many pieces of work in processes of its own, or in any executor of `concurrent.futures`.

Every result is kept as it comes: Ctrl-C and a worker that dies cost what was under way, nothing else.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, as_completed
from typing import Any

from omnimj.errors import OmnimjError, SimulationError

Report = Callable[[str, float], None]
"""Called with a phrase and the share that is done; may raise KeyboardInterrupt."""


class Workers:
    """Those who do the work: processes started here, or somebody's executor."""

    def __init__(self, pool: Executor, is_own: bool):
        self._pool, self._is_own = pool, is_own

    def do_all(
        self,
        function: Callable[..., Any],
        tasks: Mapping[str, tuple],
        keep: Callable[[str, Any], None],
        phrase: str,
        report: Report,
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
            raise SimulationError(_told_lost(sorted(lost), len(futures)))


def with_workers(work: Callable[[Workers], None], workers: int, executor: Executor | None = None) -> bool:
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
    pool = executor or ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_deaf)
    finished = False
    try:
        work(Workers(pool, executor is None))
        finished = True
    except KeyboardInterrupt:
        pass
    except BrokenExecutor:
        raise SimulationError(_told_lost()) from None
    finally:
        if executor is None:
            _end(pool, before, finished)
    return finished


def _told_lost(names: Sequence[str] = (), of: int = 0) -> str:
    """What a user is told when workers died."""
    missing = (
        f"; {len(names)} of {of} are missing ({names[0]}{', …' if len(names) > 1 else ''})" if names else ""
    )
    return f"a worker died{missing}; what was finished is kept, and the same command goes on from there"


def _end(pool: Executor, before: set, finished: bool) -> None:
    """Ends the workers; at once when the work was broken off.

    Nothing is cancelled then: the pool's own thread stumbles over cancelled work when its workers vanish.
    """
    pool.shutdown(wait=finished)
    if not finished:
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()


def _deaf() -> None:
    """Ctrl-C is for the parent, which ends its workers itself; one that is killed takes them along."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with_the_parent, daemon=True).start()


def _leave_with_the_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None  # a worker has one
    parent.join()
    os._exit(1)  # nobody is left to hand a result to
