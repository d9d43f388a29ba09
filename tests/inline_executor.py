"""Work of a study done at once in this process, without a progress report."""

from __future__ import annotations

from concurrent.futures import Executor, Future


def quiet(phrase: str, share: float) -> None:
    """Reports nothing."""


class InlineExecutor(Executor):
    """Runs every task when it is submitted, and notes its function's name and its arguments."""

    def __init__(self):
        self.calls: list[tuple[str, tuple]] = []

    @property
    def arguments(self) -> list[tuple]:
        """Arguments of all calls."""
        return [arguments for _, arguments in self.calls]

    def submit(self, fn, /, *args, **kwargs) -> Future:
        self.calls.append((getattr(fn, "__name__", ""), args))
        future: Future = Future()
        future.set_result(fn(*args, **kwargs))
        return future
