"""Why bytes are not a frame, and how often that happened."""

from __future__ import annotations

import enum


class Drop(enum.IntEnum):
    """Why bytes were dropped; in this order it is looked for."""

    TOO_SHORT = 1
    TOO_LONG = 2
    STUFFING = 3
    """No stuffed packet; only where bytes come as a stream."""
    CHECKSUM = 4
    PROTOCOL = 5
    TYPE = 6
    FLAGS = 7
    """A reserved bit is set."""
    LENGTH = 8
    """No such message has so many bytes."""
    NO_KEY = 9
    """It has a tag, and we have no key."""
    NO_TAG = 10
    """We have a key, and it has no tag."""
    TAG = 11
    """Made with another key, or changed on its way."""
    SCHEMA = 12
    """Its payload is laid out in another way than ours."""
    VALUE = 13
    """It says something that no message may say."""


class DropCounts:
    """How many were dropped, by reason."""

    __slots__ = ("_counts",)

    def __init__(self) -> None:
        self._counts = [0] * (max(Drop) + 1)

    def add(self, drop: Drop) -> None:
        """Counts one."""
        self._counts[drop] += 1

    def __getitem__(self, drop: Drop) -> int:
        return self._counts[drop]

    @property
    def total(self) -> int:
        """For whatever reason."""
        return sum(self._counts)

    def __str__(self) -> str:
        found = [f"{drop.name.lower()} {self[drop]}" for drop in Drop if self[drop]]
        return ", ".join(found) or "none"
