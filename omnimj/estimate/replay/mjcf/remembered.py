"""Thread-safe cache that drops the least recently used result first."""

from __future__ import annotations

import threading
from collections.abc import Hashable
from typing import Generic, TypeVar

T = TypeVar("T")


class Remembered(Generic[T]):
    """Some results by their keys."""

    def __init__(self, most: int):
        """Remember up to `most` results."""
        self._most, self._lock = most, threading.Lock()
        self._found: dict[Hashable, T] = {}

    def get(self, key: Hashable) -> T | None:
        """The result of a key; None if it is not kept."""
        with self._lock:
            if key in self._found:
                self._found[key] = self._found.pop(key)  # now the most recently used
            return self._found.get(key)

    def keep(self, key: Hashable, result: T) -> None:
        """Keep a result."""
        with self._lock:
            self._found[key] = result
            while len(self._found) > self._most:
                del self._found[next(iter(self._found))]
