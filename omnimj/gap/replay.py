"""What the search for a missing effect needs to know of a plant: one `Replay` per kind of plant.

A replay drives a plant's equations with the measured inputs of every run and returns block means of what the
sensors would have said, row beside row with the measured ones. It knows nothing of how the data were made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from omnimj.signals import Array


@dataclass(frozen=True)
class Channel:
    """One measured quantity that is compared."""

    name: str
    unit: str
    words: str
    """As a person says it: `speed of the carriage`."""
    wander: float = 0.0
    """Standard deviation of an offset that is drawn anew for every run (an accelerometer's bias) [unit]."""
    roughness: float = 0.0
    """Standard deviation by which block means of the equations are known to miss a healthy machine [unit]."""


@dataclass(frozen=True)
class Piece:
    """A stretch of one run that is simulated in one go; a window of it where a run is long."""

    run: str
    condition: str
    """What repeats share; data are held out by whole conditions."""
    first: int
    last: int
    """Its rows of blocks: first … last − 1."""
    time: Array
    """Block centres, shape (last − first,) [s]."""


@dataclass(frozen=True)
class BaseParameter:
    """A parameter declared uncertain: refitted inside its box before anything is called missing."""

    name: str
    unit: str
    nominal: float
    low: float
    high: float
    words: str = ""


@dataclass(frozen=True)
class Shape:
    """One parameter of a candidate."""

    name: str
    unit: str
    low: float
    high: float
    typical: float
    vanishes: float | None
    """Value at which the effect vanishes; None for a parameter that only shapes it (a place, a width)."""
    trials: tuple[float, ...] = ()
    """Values tried in the screening; one of a shape parameter each, or none."""


@dataclass(frozen=True)
class CandidateForm:
    """One effect with its selectors fixed (which channel, which wheel), as the search sees it."""

    label: str
    """`rail_viscous`, or with its selector `sensor_delay (wheel_speed)`."""
    effect: str
    words: str
    parameters: tuple[Shape, ...]
    selectors: Mapping[str, str | int] = field(default_factory=dict)
    is_sensor: bool = False
    """Whether it is the measurement and not the machine that would be wrong."""


@dataclass(frozen=True)
class Setting:
    """One set of numbers that a replay simulates."""

    base: Array
    """Values of the base parameters, shape (len(base),)."""
    effects: Mapping[str, Array] = field(default_factory=dict)
    """Candidate's label → values of its parameters."""
    curve: tuple[str, Array] | None = None
    """A free force over one variable: its name and the force at the knots, shape (KNOTS,)."""


@dataclass(frozen=True)
class Experiment:
    """A run that the user could make."""

    name: str
    words: str
    run: Mapping[str, Any]
    """The numbers of the run: current, mass, floor, …"""


KNOTS = 8
"""Knots of a free curve."""


class Replay(Protocol):
    """A plant as the search sees it; blocks are rows, channels are columns, NaN is masked."""

    plant: str
    channels: tuple[Channel, ...]
    pieces: tuple[Piece, ...]
    measured: Array
    """Block means, shape (blocks, channels)."""
    base: tuple[BaseParameter, ...]
    candidates: tuple[CandidateForm, ...]
    curves: Mapping[str, float]
    """Variables over which a free curve may be laid → a typical force [N]."""

    def simulate(self, settings: Sequence[Setting]) -> list[Array]:
        """What the sensors would have said, one array of shape (blocks, channels) per setting."""
        ...

    def anchor(self, setting: Setting) -> Array | None:
        """The same from the MuJoCo twin; None where there is none."""
        ...

    def regimes(self) -> Mapping[str, tuple[str, Array]]:
        """Variable → unit and its value in every block, shape (blocks,), from the measurement alone."""
        ...

    def menu(self) -> tuple[Experiment, ...]:
        """Runs that the user could make."""
        ...

    def predict(self, settings: Sequence[Setting], experiment: Experiment) -> list[Array]:
        """Block means of the channels in such a run, one array of shape (blocks, channels) per setting."""
        ...


def blocks(values: Array, size: int) -> Array:
    """Means of `size` consecutive samples, the rest at the end left out; NaN where any sample is NaN.

    Args:
      values: Shape (n,) or (n, channels).
      size: Samples per block.
    """
    count = len(values) // size
    return np.asarray(values[: count * size]).reshape(count, size, *values.shape[1:]).mean(axis=1)
