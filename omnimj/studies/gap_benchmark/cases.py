"""Cases of the benchmark: every effect in three sizes, pairs, triples, none, and effects outside the library.

All cases are drawn from one seed and shuffled, so that the number of a case does not reveal its truth.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnimj.effects import RIG, Effect, EffectParameter, effects_of
from omnimj.estimate.replay.base_parameters import base_parameters
from omnimj.estimate.replay.interface import BaseParameter
from omnimj.parameters import read_floors, read_rig
from omnimj.physics.effect_terms import TERM
from omnimj.signals import Array

_GRAVITY = 9.81
_FAR = 1e3  # [m] a patch up to here covers the whole rail


@dataclass(frozen=True)
class UnmodelledKind:
    """Kind of effect outside the library, for which the workflow must not name any effect."""

    words: str
    amplitude: float
    """Noticeable amplitude, the unit of sizes."""
    unit: str
    shortest: float
    longest: float
    """Upper end of the range of its length [m, s or m/s, by kind]."""


KINDS: Mapping[str, UnmodelledKind] = {
    "floor_drift": UnmodelledKind(
        "the floor loses grip while it warms, within and between runs", 0.3, "1", 1.0, 3.0
    ),
    "bent_rail": UnmodelledKind(
        "the rail is wavy: a grade that changes its sign along it", 0.02, "rad", 0.3, 0.8
    ),
    "rail_joints": UnmodelledKind("a force that repeats along the rail", 1.5, "N", 0.08, 0.2),
    "drying_rail": UnmodelledKind("rail friction that fades after the start", 2.0, "N", 0.2, 0.8),
    "speed_hump": UnmodelledKind("rail friction that peaks at one speed", 2.0, "N", 0.3, 0.8),
    "drifting_accelerometer": UnmodelledKind(
        "the accelerometer's offset grows with time", 0.4, "m/s3", 1.0, 1.0
    ),
    "sideways_crosstalk": UnmodelledKind(
        "the carriage's encoder feels the gantry's speed", 0.06, "1", 1.0, 1.0
    ),
    "eccentric_encoder": UnmodelledKind(
        "the measuring wheel of the carriage runs out of true", 0.04, "1", 0.01, 0.02
    ),
}


@dataclass(frozen=True)
class RunContext:
    """Conditions of a run that an effect depends on."""

    session: float
    """Position in the series of runs, 0 … 1."""
    mass: float
    """m_T [kg]."""


@dataclass(frozen=True)
class UnmodelledEffect:
    """Effect of one of `KINDS` with its numbers."""

    kind: str
    amplitude: float
    length: float
    phase: float

    def write_terms(self, row: Array, run: RunContext, time: float, position: float, speed: float) -> None:
        """Write the terms of the next sample into a wheel's row, in place.

        Args:
          row: Terms of `physics.effect_terms`, shape (TERMS,).
          run: Conditions of the run.
          time: Time since the start of the run [s].
          position: Position of the carriage [m].
          speed: Speed of the carriage [m/s].
        """
        row[TERM["active"]] = 1.0
        if self.kind == "floor_drift":
            warm = 0.5 * run.session + 0.5 * (1.0 - math.exp(-time / self.length))
            stretch = [TERM[name] for name in ("patch", "patch_start", "patch_end")]
            row[stretch] = -self.amplitude * warm, -_FAR, _FAR
        elif self.kind == "bent_rail":
            row[TERM["cable_force"]] = run.mass * self.force_per_mass(position)
        elif self.kind == "rail_joints":
            row[TERM["cable_force"]] = self.amplitude * self._wave(position)
        elif self.kind == "drying_rail":
            row[TERM["guide_dry"]] = self.amplitude * math.exp(-time / self.length)
        elif self.kind == "speed_hump":
            row[TERM["guide_dry"]] = self.amplitude * math.exp(-(((abs(speed) - self.length) / 0.1) ** 2))

    def force_per_mass(self, position: float) -> float:
        """Return gravity along a bent rail [m/s²]; 0 for every other kind."""
        if self.kind != "bent_rail":
            return 0.0
        return -_GRAVITY * math.sin(self.amplitude * self._wave(position))

    def bend_readings(self, columns: Mapping[str, Array], position: Array) -> dict[str, Array]:
        """Return the sensor readings with this effect.

        Args:
          columns: Readings without it, shape (k,) each.
          position: True position of the carriage, shape (k,) [m].
        """
        bent = dict(columns)
        if self.kind == "drifting_accelerometer":
            bent["carriage_acceleration"] = (
                columns["carriage_acceleration"] + self.amplitude * columns["time"]
            )
        elif self.kind == "sideways_crosstalk":
            bent["carriage_speed"] = columns["carriage_speed"] + self.amplitude * columns["lateral_speed"]
        elif self.kind == "eccentric_encoder":
            wave = np.sin(position / self.length + self.phase)
            bent["carriage_speed"] = columns["carriage_speed"] * (1.0 + self.amplitude * wave)
        elif self.kind == "bent_rail":
            felt = np.array([self.force_per_mass(x) for x in position.tolist()])
            bent["carriage_acceleration"] = columns["carriage_acceleration"] - felt
        return bent

    def _wave(self, position: float) -> float:
        return math.sin(2.0 * math.pi * position / self.length + self.phase)


def draw_unmodelled(kind: str, size: float, random: np.random.Generator) -> UnmodelledEffect:
    """Draw an effect outside the library.

    Args:
      kind: One of `KINDS`.
      size: Amplitude relative to the noticeable one.
      random: Random generator, which also draws the sign if the kind has one.
    """
    about = KINDS[kind]
    has_sign = kind in ("drifting_accelerometer", "sideways_crosstalk")
    sign = float(random.choice((-1.0, 1.0))) if has_sign else 1.0
    length, phase = random.uniform(about.shortest, about.longest), random.uniform(0.0, 2.0 * math.pi)
    return UnmodelledEffect(kind, sign * size * about.amplitude, float(length), float(phase))


SIZES: Mapping[str, float] = {"faint": 0.25, "clear": 0.7, "obvious": 2.0}
"""Names of sizes → share of the noticeable amplitude, typical − vanishing."""
TUNING_SEEDS = range(10)
"""Seeds with which the workflow was tuned; not used to evaluate it."""
FLOORS = ("natural_stone", "pvc", "paperboard")
"""Floors of the runs."""

_NULL, _PAIRS, _TRIPLES = 20, 8, 2  # numbers of cases per trial
_WITHIN = 0.8  # share of the stated half-width within which true parameters lie
_ONLY_MORE = ("lateral_coupling", "rail_coulomb", "rail_stribeck", "rail_position", "bearing_friction")
"""Effects that only add friction: the nominal rig has little that could be removed."""
_ALIKE = (
    frozenset({"torque_constant", "current_scale"}),
    frozenset({"rail_coulomb", "rolling_resistance", "bearing_friction"}),
)
"""Effects that runs of one kind cannot separate: two of a set are never hidden together."""
_POLES = (1, 2, 3, 4, 6, 8, 12)


@dataclass(frozen=True)
class HiddenEffect:
    """Effect of the true machine that the model lacks."""

    effect: str
    values: Mapping[str, float | str]
    """Values of parameters and selectors."""
    size: str
    """One of `SIZES`."""

    @property
    def label(self) -> str:
        """Effect with its choices in brackets: `sensor_delay (wheel_speed)`."""
        chosen = [str(v) for v in self.values.values() if isinstance(v, str)]
        return f"{self.effect} ({', '.join(chosen)})" if chosen else self.effect


@dataclass(frozen=True)
class Case:
    """One dataset of the benchmark and its truth."""

    name: str
    """Neutral name: `case_017`."""
    kind: str
    """`null`, `single`, `pair`, `triple` or `outside`."""
    hidden: tuple[HiddenEffect, ...]
    outside: UnmodelledEffect | None
    base: Mapping[str, float]
    """True values of the parameters that the model declares uncertain."""
    seed: int
    """Seed of the runs and of the sensor noise."""

    def to_dict(self) -> dict[str, Any]:
        """Return the case as JSON-compatible values."""
        return dataclasses.asdict(self)


def case_from_dict(plain: Mapping[str, Any]) -> Case:
    """Return the case from the record of `Case.to_dict`."""
    hidden = tuple(HiddenEffect(**one) for one in plain["hidden"])
    outside = None if plain["outside"] is None else UnmodelledEffect(**plain["outside"])
    return Case(plain["name"], plain["kind"], hidden, outside, plain["base"], plain["seed"])


def draw_cases(seed: int, trials: int = 1) -> list[Case]:
    """Draw all cases in the order of their names; each trial has every kind of case.

    Args:
      seed: Seed of the cases.
      trials: Number of times that the whole set is drawn.
    """
    boxes = base_parameters(read_rig(), read_floors(), FLOORS, ())
    wanted: list[tuple[str, tuple[str, ...], str]] = []
    for _ in range(trials):
        wanted += [("single", (name,), size) for name in effects_of(RIG) for size in SIZES]
        wanted += [("pair", (), "")] * _PAIRS + [("triple", (), "")] * _TRIPLES + [("null", (), "")] * _NULL
        wanted += [("outside", (name,), size) for name in KINDS for size in ("clear", "obvious")]
    order = np.random.default_rng(np.random.SeedSequence(seed)).permutation(len(wanted))
    digits = max(3, len(str(len(wanted) - 1)))
    cases = []
    for k, place in enumerate(order.tolist()):
        kind, names, size = wanted[place]
        random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1, place)))
        hidden, outside = _draw(kind, names, size, random)
        base, noise = _true_base(boxes, random), int(random.integers(2**62))
        cases.append(Case(f"case_{k:0{digits}d}", kind, hidden, outside, base, noise))
    return cases


def _draw(
    kind: str, names: Sequence[str], size: str, random: np.random.Generator
) -> tuple[tuple[HiddenEffect, ...], UnmodelledEffect | None]:
    """Draw the truth of one case."""
    if kind == "null":
        return (), None
    if kind == "outside":
        return (), draw_unmodelled(names[0], SIZES[size], random)
    names = names or _together(2 if kind == "pair" else 3, random)
    sizes = [size or str(random.choice(["clear", "obvious"])) for _ in names]
    effects = effects_of(RIG)
    return tuple(draw_effect(effects[n], s, random) for n, s in zip(names, sizes, strict=True)), None


def _together(count: int, random: np.random.Generator) -> list[str]:
    """Draw effects that can be hidden together."""
    names = list(effects_of(RIG))
    while True:
        chosen = [str(n) for n in random.choice(names, count, replace=False)]
        if not any(len(alike.intersection(chosen)) > 1 for alike in _ALIKE):
            return chosen


def draw_effect(effect: Effect, size: str, random: np.random.Generator) -> HiddenEffect:
    """Draw one effect: some amplitudes at a size, one sign for all, shapes within the range of the runs.

    Args:
      effect: The effect.
      size: One of `SIZES`.
      random: Random generator.
    """
    amplitudes = effect.amplitudes
    chosen = [p for p in amplitudes if random.random() < 0.7] or [random.choice(np.array(amplitudes))]
    values: dict[str, float | str] = {p.name: float(p.null_value or 0.0) for p in amplitudes}
    share = SIZES[size]
    signs = [s for s in (1.0, -1.0) if all(_fits(p, s * share) for p in chosen)]
    if effect.name in _ONLY_MORE:
        signs = [1.0]
    sign = float(random.choice(signs)) if signs else 1.0
    for p in chosen:
        values[p.name] = float(np.clip(_at(p, sign * share), p.low, p.high))
    values.update(_shape(effect, random))
    for selector in effect.selectors:
        values[selector.name] = str(random.choice(np.array(selector.choices)))
    return HiddenEffect(
        effect.name, {p.name: values[p.name] for p in (*effect.parameters, *effect.selectors)}, size
    )


def _at(p: EffectParameter, share: float) -> float:
    null_value = p.null_value or 0.0
    return null_value + share * (p.typical - null_value)


def _fits(p: EffectParameter, share: float) -> bool:
    return p.low <= _at(p, share) <= p.high


def _shape(effect: Effect, random: np.random.Generator) -> dict[str, float]:
    """Draw places, widths and speeds that most runs of the carriage pass."""
    start = float(random.uniform(0.15, 0.55))
    drawn = {
        "position": float(random.uniform(0.15, 0.9)),
        "width": float(random.uniform(0.04, 0.12)),
        "velocity": float(random.uniform(0.05, 0.25)),
        "rest_position": float(random.uniform(0.0, 0.8)),
        "poles": float(random.choice(_POLES)),
        "start": start,
        "end": start + float(random.uniform(0.2, 0.5)),
    }
    return {p.name: drawn.get(p.name, p.typical) for p in effect.parameters if p.null_value is None}


def _true_base(boxes: Sequence[BaseParameter], random: np.random.Generator) -> dict[str, float]:
    """Draw true values of the uncertain parameters of the shipped model, inside their boxes."""
    found = {}
    for p in boxes:
        half = 0.5 * _WITHIN * (p.high - p.low)
        found[p.name] = float(np.clip(p.nominal + half * random.uniform(-1.0, 1.0), p.low, p.high))
    return found
