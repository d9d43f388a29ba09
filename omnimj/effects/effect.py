"""What an effect is: a named piece of physics with parameters, and what it changes in a machine."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

RIG, ROBOT, AXIS = "quarter_rig", "uto_robot", "linear_axis"
"""The plants, by the names of their folders under `models/`."""

Values = Mapping[str, Any]
"""Parameters (floats) and selectors (text or whole numbers) of one effect by name."""

Hook = Callable[[Any, Values], None]
"""Writes an effect into `omnimj.effects.changes.Changes`; gets every parameter and selector."""


@dataclass(frozen=True)
class EffectParameter:
    """One number of an effect."""

    name: str
    unit: str
    low: float
    high: float
    """Physical bounds, generous."""
    typical: float
    """A size that is worth noticing."""
    vanishes: float | None = 0.0
    """Value at which the effect is gone; None: a shape (place, width, speed), which takes nothing away."""


@dataclass(frozen=True)
class Selector:
    """A choice that an effect needs besides numbers, such as a channel or a wheel."""

    name: str
    choices: tuple[str | int, ...]


@dataclass(frozen=True)
class Effect:
    """A real change of a machine that a gap may be named after."""

    name: str
    words: str
    """What it is, in plain words."""
    where: str
    """`rail`, `wheel`, `motor`, `floor`, `body` or `sensors`."""
    plants: tuple[str, ...]
    """Machines that it can act on."""
    parameters: tuple[EffectParameter, ...]
    selectors: tuple[Selector, ...] = ()
    hooks: tuple[Hook, ...] = ()
    """What writes it into a machine."""

    @property
    def amplitudes(self) -> tuple[EffectParameter, ...]:
        """Parameters at whose vanishing values the effect is gone."""
        return tuple(p for p in self.parameters if p.vanishes is not None)

    def vanishing(self) -> dict[str, float]:
        """Values of all parameters at which the effect is gone; shapes at their typical values."""
        return {p.name: p.typical if p.vanishes is None else p.vanishes for p in self.parameters}

    def typical(self) -> dict[str, float]:
        """Typical values of all parameters."""
        return {p.name: p.typical for p in self.parameters}
