"""One thread pool for all simulations of a process."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

_T = TypeVar("_T")
_R = TypeVar("_R")


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
