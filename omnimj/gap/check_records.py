"""What the check of the data finds, as frozen records."""

from __future__ import annotations

from dataclasses import dataclass

SURE = 2.0
"""Strength from which on a suspicion is sure."""

KINDS = ("sign", "scale", "delay", "bias", "wrap", "glitch", "clipping", "frozen", "swapped", "duplicated")
"""Kinds of suspicions."""


@dataclass(frozen=True)
class Suspicion:
    """Something that is probably wrong with a channel, seen without any model of friction."""

    channel: str
    kind: str
    """One of `KINDS`."""
    size: float
    """Factor of a scale (that of a known unit where one is near), s of a delay, the channel's unit of a bias,
    the value where it is cut off, the number of the other wheel, a count; −1 for a sign."""
    strength: float
    """Times what healthy recordings reach at most; at least 1."""
    words: str
    """One sentence."""
    or_channels: tuple[str, ...] = ()
    """Other channels that would explain the same as well."""
    runs: tuple[str, ...] = ()
    """The runs where it was seen, where not in all."""

    @property
    def is_sure(self) -> bool:
        """Whether chance and a healthy machine are out of the question, and so is another channel."""
        return self.strength >= SURE and not self.or_channels


@dataclass(frozen=True)
class DataCheck:
    """What the data say of themselves before any model is asked."""

    notes: tuple[str, ...]
    """One sentence each."""
    suspicions: tuple[Suspicion, ...]
    """The strongest first."""
