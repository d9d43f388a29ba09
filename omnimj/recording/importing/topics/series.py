"""Numbers of one topic over time, as its messages bring them."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnimj.errors import InputError
from omnimj.signals import Array

NO_STAMP = -(2**63)
"""Stamp of a message without one."""
MOST_NUMBERS = 100_000_000
"""Limit on the numbers that are held of one file, 0.8 GB."""
_MOST_LAYOUTS = 64
_LARGEST_STAMP = 2**62

ReadMessage = Callable[[memoryview], tuple[int | None, tuple[Any, ...], list[float]]]
Names = Callable[[tuple[Any, ...]], tuple[str, ...]]


class Budget:
    """Count of the numbers that are held of one file."""

    def __init__(self, path: object):
        self._path, self._held = path, 0

    def spend(self, numbers: int) -> None:
        """Count further numbers."""
        self._held += numbers
        if self._held > MOST_NUMBERS:
            rule = "name the topics that you need with --topics"
            raise InputError(self._path, f"has more than {MOST_NUMBERS} numbers in its topics", rule)


@dataclass(frozen=True)
class Samples:
    """Samples of messages that have the same fields."""

    names: tuple[str, ...]
    logged: NDArray[np.int64]
    """Times of logging, shape (n,) [ns]."""
    stamps: NDArray[np.int64]
    """Stamps of the headers, `NO_STAMP` without one, shape (n,) [ns]."""
    values: Array
    """Shape (n, fields)."""


class _Layout:
    def __init__(self, names: tuple[str, ...]):
        self.names = names
        self.logged, self.stamps, self.values = array("q"), array("q"), array("d")


class Series:
    """Collector of the messages of one topic."""

    def __init__(self, place: object, read: ReadMessage, names: Names, budget: Budget):
        self._place, self._read, self._names, self._budget = place, read, names, budget
        self._layouts: dict[tuple[Any, ...], _Layout] = {}
        self.count = 0

    def take(self, logged: int, payload: memoryview) -> None:
        """Read one message and keep its numbers."""
        try:
            stamp, key, values = self._read(payload)
        except Exception as error:  # damaged messages raise errors of many kinds
            reason = " ".join(str(error).split())[:120] or type(error).__name__
            raise InputError(self._place, f"message {self.count + 1} cannot be read ({reason})") from None
        self.count += 1
        layout = self._layouts.get(key)
        if layout is None:
            if len(self._layouts) == _MOST_LAYOUTS:
                found = f"its messages have {_MOST_LAYOUTS} different sets of fields"
                raise InputError(self._place, found, "leave it out with --topics")
            layout = self._layouts[key] = _Layout(self._names(key))
        if logged > _LARGEST_STAMP:
            raise InputError(self._place, f"message {self.count} was logged at {logged} ns", "no such time")
        self._budget.spend(len(values) + 2)
        layout.logged.append(logged)
        layout.stamps.append(NO_STAMP if stamp is None or abs(stamp) > _LARGEST_STAMP else stamp)
        layout.values.extend(values)

    def samples(self) -> Iterator[Samples]:
        """Yield the samples by set of fields; each array shares the memory in which it was collected."""
        for layout in self._layouts.values():
            values = np.frombuffer(layout.values, dtype=float) if layout.names else np.empty(0)
            yield Samples(
                layout.names,
                np.frombuffer(layout.logged, dtype=np.int64),
                np.frombuffer(layout.stamps, dtype=np.int64),
                values.reshape(len(layout.logged), len(layout.names)),
            )
