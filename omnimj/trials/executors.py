"""Executors by address: `dask:tcp://HOST:PORT`, a cluster's scheduler."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import contextmanager
from typing import Any

from omnimj.errors import InputError

_SHAPE = re.compile(r"dask:((?:tcp|tls)://(?:[^\s/:\[\]]+|\[[0-9A-Fa-f:]+\]):(\d{1,5}))")
_ANSWERS = 10.0  # [s] in which a scheduler says something, or nobody is there


class WorkerLost(BrokenExecutor):
    """A piece of work whose worker died, as often as it was tried."""


def scheduler_of(address: str) -> str:
    """`tcp://HOST:PORT` of `dask:tcp://HOST:PORT`.

    Raises:
      InputError: Any other text.
    """
    found = _SHAPE.fullmatch(address)
    if found is None or not 0 < int(found[2]) < 65536:
        raise InputError("--executor", f"found {address!r}", "write dask:tcp://HOST:PORT")
    return found[1]


@contextmanager
def open_executor(address: str | None, answers: float = _ANSWERS) -> Iterator[Executor | None]:
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
    scheduler = scheduler_of(address)
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
