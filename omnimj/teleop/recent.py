"""The newest minutes of a drive that has no planned end."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from omnimj.signals import Array, Trace


class Recent:
    """Keeps blocks of rows, the oldest of which go."""

    def __init__(self, rows: int):
        """At least so many of the newest rows are kept; none with 0."""
        self._most, self._held = rows, 0
        self._names: tuple[str, ...] = ()
        self._blocks: deque[Array] = deque()

    @property
    def rows(self) -> int:
        """That are held now."""
        return self._held

    def add(self, names: tuple[str, ...], block: Array) -> None:
        """Takes rows, shape (m, columns), which the caller may write over afterwards."""
        if self._most == 0:
            return
        self._names = names
        self._blocks.append(block.copy())
        self._held += len(block)
        while self._held - len(self._blocks[0]) >= self._most:
            self._held -= len(self._blocks.popleft())

    def trace(self, about: Mapping[str, Any]) -> Trace:
        """What is held, as a trace; its time is that of the plant."""
        table = np.concatenate(self._blocks) if self._blocks else np.empty((0, len(self._names)))
        columns = np.ascontiguousarray(table.T)
        return Trace(dict(zip(self._names, columns, strict=True)), about)
