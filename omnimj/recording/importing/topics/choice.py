"""Choices made when topics are joined to one table: time base, stamps, rule between samples."""

from __future__ import annotations

from dataclasses import dataclass

JOINS = ("linear", "previous")
"""Rules for values between two messages: straight line, or the value of the message before."""
STAMPS = ("header", "log")
"""Clocks: the stamp that the sender wrote into the message, or the time at which it was logged."""


@dataclass(frozen=True)
class TopicChoice:
    """Rules by which messages become rows; `[topics]` of a mapping file."""

    base: str | None = None
    """Topic whose stamps are the rows; chosen when None."""
    join: str = JOINS[0]
    """One of `JOINS`; whole numbers, switches and set values hold their last value under either."""
    stamps: str | None = None
    """One of `STAMPS`; when None, header stamps where every joined topic has usable ones."""


@dataclass(frozen=True)
class TopicSummary:
    """One topic of a file, as the preview shows it."""

    name: str
    type_name: str
    messages: int
    rate: float
    """Messages per second by the median step; 0 with fewer than two."""
    stamps: str
    """Which stamps are used, and why not the others, in words."""
    joined: str
    """Description of how its values come to the rows."""
