"""Interface between a plant and the search for missing effects: one `Replay` per plant.

A replay drives a plant's equations with the measured inputs of every run and returns block means of the
simulated sensors, aligned with the measured ones. It has no access to the origin of the data.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from omnimj.effects import FLOOR, Effect, EffectParameter, effects_of
from omnimj.signals import Array

EXCITED, NOT_SOUGHT = "excited", "not sought"
"""Beginnings of notes of a replay: joints that move enough, and effects that cannot show."""
MOST_EFFECTS = 4
"""Usual largest number of effects in a model."""
KNOTS = 8
"""Number of knots of a free curve."""
_SPEEDS = (0.02, 0.1, 0.4)  # trial ends of friction near standstill, as shares of the speed range
_PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)


@dataclass(frozen=True)
class Channel:
    """Measured quantity that is compared."""

    name: str
    unit: str
    words: str
    """Description: `speed of the carriage`."""
    run_offset_spread: float = 0.0
    """Standard deviation of an offset that differs from run to run (an accelerometer's bias) [unit]."""
    equation_error: float = 0.0
    """Standard deviation of the equations' known error in block means of a healthy machine [unit]."""


@dataclass(frozen=True)
class Segment:
    """Part of a run that is simulated in one go; a window where a run is long."""

    run: str
    condition: str
    """Condition shared by repeats; data are held out by whole conditions."""
    first: int
    last: int
    """The segment comprises the rows of blocks first … last − 1."""
    time: Array
    """Block centres, shape (last − first,) [s]."""
    is_repeat: bool = True
    """False where runs of one condition are similar but are no repeats, such as drives in neighbouring
    directions."""


@dataclass(frozen=True)
class BaseParameter:
    """Uncertain parameter, refitted inside its box before any effect is considered."""

    name: str
    unit: str
    nominal: float
    low: float
    high: float
    words: str = ""


@dataclass(frozen=True)
class CandidateParameter:
    """Parameter of a candidate effect, or the product of two that is fitted in its place.

    Bounds, null value and typical value are those of the fitted number.
    """

    name: str
    unit: str
    low: float
    high: float
    typical: float
    null_value: float | None
    """Value at which the effect vanishes; None for a shape parameter (a place, a width)."""
    trials: tuple[float, ...] = ()
    """Trial values of a shape parameter for the screening."""
    spread: float = math.inf
    """Standard deviation of a shape about its typical value, as far as it is known beforehand."""
    times: str = ""
    """Shape whose product with the parameter is fitted in its place: the moment m d instead of the mass m, of
    which the data show nothing else where they leave the distance d open."""
    least: float = -math.inf
    """Smallest value of a parameter whose product is fitted."""


@dataclass(frozen=True)
class CandidateEffect:
    """Effect with its selectors fixed (channel, wheel), as a candidate of the search."""

    label: str
    """`rail_viscous`, or with its selector `sensor_delay (wheel_speed)`."""
    effect: str
    words: str
    parameters: tuple[CandidateParameter, ...]
    selectors: Mapping[str, str | int] = field(default_factory=dict)
    is_sensor: bool = False
    """True for an effect of the measurement, as opposed to the machine."""
    turns_with_wheel: bool = False
    """True if the replay gives it the phase of the measured angle, from which that of a twin departs."""
    has_threshold: bool = False
    """True if a small amplitude changes nothing."""
    quantity: str = ""
    """Base parameter that is the same quantity; empty without one."""
    has_impacts: bool = False
    """True if predictions have no fine derivative by its amplitude."""
    is_outside: ClassVar[bool] = False
    """True for structure outside the library, which is described and not named."""

    def values(self, numbers: Array) -> dict[str, float]:
        """Return the parameters of the effect, shape (parameters,), by name."""
        fitted = dict(
            zip([p.name for p in self.parameters], np.asarray(numbers, float).tolist(), strict=True)
        )
        return {
            p.name: max(fitted[p.name] / fitted[p.times], p.least) if p.times else fitted[p.name]
            for p in self.parameters
        }

    def numbers(self, values: Mapping[str, float | str]) -> Array:
        """Return the numbers to be fitted, shape (parameters,): the inverse of `values`."""
        return np.array([float(values[p.name]) * float(values.get(p.times, 1.0)) for p in self.parameters])

    def relative_size(self, values: Array) -> float:
        """Largest amplitude over its typical size, |a − null| / |typical − null|; infinite without any."""
        sizes = [
            abs(value - p.null_value) / abs(p.typical - p.null_value)
            for p, value in zip(self.parameters, values.tolist(), strict=True)
            if p.null_value is not None and p.typical != p.null_value
        ]
        return max(sizes, default=math.inf)


@dataclass(frozen=True)
class Structure(CandidateEffect):
    """Structure outside the library, which the search may have in its model beside the effects."""

    causes: str = ""
    """Possible causes, as a list in one sentence."""
    is_outside: ClassVar[bool] = True

    def describe(self, numbers: Array) -> Description:
        """Describe it with its fitted numbers, shape (parameters,)."""
        raise NotImplementedError


class Description(NamedTuple):
    """Structure outside the library with its size."""

    words: str
    """`a force of 0.49 N that repeats every 0.228 m along the rail`."""
    values: Mapping[str, float]
    """Its numbers in SI units, by name."""


@dataclass(frozen=True)
class Setting:
    """Parameter values of one simulation."""

    base: Array
    """Values of the base parameters, shape (len(base),)."""
    effects: Mapping[str, Array] = field(default_factory=dict)
    """Candidate's label → its fitted numbers."""
    curve: tuple[str, Array] | None = None
    """Free force over one variable: its name and the force at the knots, shape (KNOTS,) [N]."""


@dataclass(frozen=True)
class Experiment:
    """Run that a user could make."""

    name: str
    words: str
    run: Mapping[str, Any]
    """Settings of the run: current, mass, floor, …"""


class Replay(Protocol):
    """Replay of a dataset; blocks are rows, channels are columns, NaN is masked."""

    plant: str
    channels: tuple[Channel, ...]
    segments: tuple[Segment, ...]
    measured: Array
    """Block means, shape (blocks, channels)."""
    base: tuple[BaseParameter, ...]
    candidates: tuple[CandidateEffect, ...]
    curves: Mapping[str, float]
    """Variable of each free curve → typical force [N]."""
    structures: tuple[Structure, ...]
    """Structure outside the library, of which the model may have one."""
    most_effects: int
    """Largest number of effects in a model."""
    notes: tuple[str, ...]
    """Remarks on the logs for whoever reads the finding, one sentence each."""
    backward_elimination: bool
    """True if the search fits all effects and drops what is not needed, instead of adding one after another:
    for effects that act on the same few channels, and simulations that cost little."""

    def simulate(self, settings: Sequence[Setting]) -> list[Array]:
        """Simulate the sensors by the equations, one array of shape (blocks, channels) per setting."""
        ...

    def simulate_twin(self, setting: Setting) -> Array | None:
        """Simulate the sensors by the MuJoCo twin, shape (blocks, channels); None without a twin."""
        ...

    def regimes(self) -> Mapping[str, tuple[str, Array]]:
        """Variable → unit and its measured value in every block, shape (blocks,)."""
        ...

    def candidate_experiments(self) -> tuple[Experiment, ...]:
        """Runs that a user could make."""
        ...

    def predict(self, settings: Sequence[Setting], experiment: Experiment) -> list[Array]:
        """Predict block means of a candidate run, one array of shape (blocks, channels) per setting."""
        ...


def average_blocks(values: Array, size: int) -> Array:
    """Means of `size` consecutive rows of (n,) or (n, channels), NaN where one is; a remainder is dropped."""
    count = len(values) // size
    return np.asarray(values[: count * size]).reshape(count, size, *values.shape[1:]).mean(axis=1)


def candidate_effects(
    plant: str,
    spans: Mapping[str, tuple[float, float]],
    without: tuple[str, ...] = (),
    wheels: int = 1,
    floors: Sequence[str] = (),
) -> tuple[CandidateEffect, ...]:
    """Candidate effects of a plant from the catalogue; one candidate for every choice of a selector,
    of an optional one none. Effects of a floor are candidates for each of `floors`, where these are given.

    Args:
      spans: Range covered by the runs: `speed` and `position` → lowest, highest; shapes are tried inside.
      without: Labels that cannot show in these data (a channel that was not recorded).
    """
    candidates = []
    for effect in effects_of(plant).values():
        choices = [[(s.name, c) for c in s.on(wheels)] for s in effect.selectors if not s.optional]
        if floors and FLOOR in effect.selectors:
            choices.append([(FLOOR.name, floor) for floor in floors])
        for chosen in itertools.product(*choices):
            text = ", ".join(str(c) if n != "wheel" else f"wheel {c}" for n, c in chosen)
            label = f"{effect.name} ({text})" if text else effect.name
            if label not in without:
                candidates.append(_candidate(effect, label, dict(chosen), spans))
    return tuple(candidates)


def _candidate(
    effect: Effect, label: str, selectors: dict[str, str | int], spans: Mapping[str, tuple[float, float]]
) -> CandidateEffect:
    parameters = tuple(
        CandidateParameter(p.name, p.unit, p.low, p.high, p.typical, p.null_value, _trials(p, spans))
        for p in effect.parameters
    )
    return CandidateEffect(
        label,
        effect.name,
        effect.words,
        parameters,
        selectors,
        is_sensor=effect.where == "sensors",
        turns_with_wheel=effect.turns_with_wheel,
        has_threshold=effect.has_threshold,
        quantity=effect.quantity,
        has_impacts=effect.has_impacts,
    )


def _trials(p: EffectParameter, spans: Mapping[str, tuple[float, float]]) -> tuple[float, ...]:
    """Trial values of a shape parameter."""
    if p.null_value is not None:
        return ()
    low, high = spans.get("position", (0.0, 1.0))
    width = max(high - low, 1e-6)
    fast = max(abs(v) for v in spans.get("speed", (0.0, 1.0)))
    wanted: tuple[float, ...] = (p.typical,)
    if p.unit == "m/s":
        wanted = tuple(share * fast for share in _SPEEDS)
    elif p.name == "width":
        wanted = (0.05 * width, 0.15 * width)
    elif p.name == "start":
        wanted = tuple(low + a * width for a in (0.0, 0.25, 0.5, 0.75))
    elif p.name == "end":
        wanted = tuple(low + b * width for b in (0.25, 0.5, 0.75, 1.0))
    elif p.name == "rest_position":
        wanted = (low, 0.5 * (low + high), high)
    elif p.name == "position":
        wanted = tuple(low + share * width for share in _PLACES)
    elif p.name == "poles":
        wanted = (1.0, 2.0, 3.0, 4.0, 6.0, 7.0, 8.0, 12.0)
    elif p.name == "direction":
        wanted = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, -2.5, -2.0, -1.5, -1.0, -0.5)
    return tuple(min(max(value, p.low), p.high) for value in wanted)
