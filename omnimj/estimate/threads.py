"""One thread pool for all simulations of a process."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

_T = TypeVar("_T")
_R = TypeVar("_R")

Progress = Callable[[int, int], None]
"""Called with the number of completed parts and the number of all."""


@functools.cache
def _helpers() -> ThreadPoolExecutor:
    """Threads beside the calling one, so that one caller has as many as there are cores.

    Several callers share them: studies with many trials at a time do not multiply the number of threads.
    """
    return ThreadPoolExecutor(max((os.cpu_count() or 1) - 1, 1), thread_name_prefix="simulation")


def map_in_threads(
    function: Callable[[_T], _R], arguments: Sequence[_T], threads: int | None = None
) -> list[_R]:
    """Map a function over arguments in threads; the kernels release the interpreter lock.

    The calling thread works as well and waits for no helper that has not begun, so that calls may be nested.

    Args:
      function: Function of one argument; an exception ends the map and propagates.
      threads: Number of threads at most; the machine's cores when None.

    Returns:
      The results in the order of the arguments.
    """
    results: list[Any] = [None] * len(arguments)
    left = iter(range(len(arguments)))  # shared: each thread takes the next argument that is left

    def work() -> None:
        for k in left:
            results[k] = function(arguments[k])

    count = min(threads or os.cpu_count() or 1, len(arguments))
    helpers = [_helpers().submit(work) for _ in range(count - 1)]
    try:
        work()
    finally:
        for _ in left:  # after an exception or Ctrl-C the helpers stop, too
            pass
        begun = [helper for helper in helpers if not helper.cancel()]
    for helper in begun:
        helper.result()
    return results


def completed_in_threads(
    function: Callable[[_T], Iterable[_R]], arguments: Sequence[_T], each: int, progress: Progress | None
) -> tuple[list[_R], bool]:
    """Results of a function that has `each` of them per argument, and whether Ctrl-C left some out."""
    done: list[_R] = []
    try:
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:  # the plants step without the interpreter
            for own in pool.map(function, arguments):
                done.extend(own)
                if progress is not None:
                    progress(len(done), len(arguments) * each)
    except KeyboardInterrupt:
        return done, True
    return done, False
