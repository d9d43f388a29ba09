"""Cases of the benchmark: every effect in three sizes, pairs, triples, none, and effects outside the library.

All cases are drawn from one seed and shuffled, so that the number of a case does not reveal its truth. A
third of the machines also deviate from the equations of the library (`STRUCTURES`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnimj.effects import RIG, Effect, EffectParameter, effects_of
from omnimj.estimate.replay.base_parameters import base_parameters
from omnimj.estimate.replay.interface import BaseParameter, CandidateParameter
from omnimj.parameters import read_floors, read_rig
from omnimj.recording.dataset import ROBOT_WHEELS
from omnimj.studies.gap_benchmark.unmodelled import KINDS, STRUCTURES, UnmodelledEffect, draw_unmodelled

SIZES: Mapping[str, float] = {"faint": 0.25, "clear": 0.7, "obvious": 2.0}
"""Names of sizes → share of the noticeable amplitude, typical − vanishing."""
TUNING_SEEDS = range(10)
"""Seeds with which the workflow was tuned; not used to evaluate it."""
FLOORS = ("natural_stone", "pvc", "paperboard")
"""Floors of the runs."""

FOREIGN = 1 / 3
"""Share of the cases whose machine deviates from the equations."""
DEVIATION = (0.5, 1.5)
"""Range of the size of a deviation, relative to the noticeable one."""
WITHIN = 0.8
"""Share of the stated half-width within which true parameters lie."""

_NULL, _PAIRS, _TRIPLES = 60, 60, 30  # numbers of cases per trial
_ABSENT = 2  # cases per trial of each effect that the model has and the machine lacks
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
    """`null`, `single`, `pair`, `triple`, `absent` or `outside`."""
    hidden: tuple[HiddenEffect, ...]
    outside: UnmodelledEffect | None
    structure: UnmodelledEffect | None
    """Deviation of the machine from the equations of the library; none when None."""
    base: Mapping[str, float]
    """True values of the parameters that the model declares uncertain."""
    seed: int
    """Seed of the runs and of the sensor noise."""
    plant: str = RIG
    """Machine of the datasets."""
    maker: str = ""
    """Maker of the dataset, where the case decides it."""

    @property
    def unmodelled(self) -> tuple[UnmodelledEffect, ...]:
        """All physics of the true machine outside the library."""
        return tuple(one for one in (self.outside, self.structure) if one is not None)

    def to_dict(self) -> dict[str, Any]:
        """Return the case as JSON-compatible values."""
        return dataclasses.asdict(self)


def case_from_dict(plain: Mapping[str, Any]) -> Case:
    """Return the case from the record of `Case.to_dict`."""
    hidden = tuple(HiddenEffect(**one) for one in plain["hidden"])
    outside, structure = (
        None if plain[key] is None else UnmodelledEffect(**plain[key]) for key in ("outside", "structure")
    )
    return Case(**{**plain, "hidden": hidden, "outside": outside, "structure": structure})


def draw_cases(seed: int, trials: int = 1) -> list[Case]:
    """Draw all cases in the order of their names; each trial has every kind of case."""
    boxes = base_parameters(read_rig(), read_floors(), FLOORS, ())
    wanted: list[tuple[str, tuple[str, ...], str]] = []
    for _ in range(trials):
        wanted += [("single", (name,), size) for name in effects_of(RIG) for size in SIZES]
        wanted += [("pair", (), "")] * _PAIRS + [("triple", (), "")] * _TRIPLES + [("null", (), "")] * _NULL
        wanted += [("absent", (name,), "obvious") for name in _absent_effects() for _ in range(_ABSENT)]
        wanted += [("outside", (name,), size) for name in KINDS for size in ("clear", "obvious")]
    order = np.random.default_rng(np.random.SeedSequence(seed)).permutation(len(wanted))
    digits = max(3, len(str(len(wanted) - 1)))
    cases = []
    for k, place in enumerate(order.tolist()):
        kind, names, size = wanted[place]
        random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1, place)))
        hidden, outside = _draw(kind, names, size, random)
        base, noise = _true_base(boxes, random), int(random.integers(2**62))
        structure = None if kind == "outside" else _draw_structure(random)
        cases.append(Case(f"case_{k:0{digits}d}", kind, hidden, outside, structure, base, noise))
    return cases


def _draw_structure(random: np.random.Generator) -> UnmodelledEffect | None:
    """Draw a deviation of the machine from the equations, or none."""
    if random.random() >= FOREIGN:
        return None
    return draw_unmodelled(str(random.choice(list(STRUCTURES))), float(random.uniform(*DEVIATION)), random)


def _absent_effects() -> dict[str, dict[str, float]]:
    """Return effects whose physics the model has and the true machine lacks, with their values."""
    rig = read_rig()
    return {
        "lateral_coupling": {
            "roller_dry": -rig.wheel.roller_dry,
            "roller_viscous": -rig.wheel.roller_viscous,
            "rail_dry": -rig.rig.rail_dry,
        },
        "rail_coulomb": {"force": -rig.rig.rail_friction},
    }


def _draw(
    kind: str, names: Sequence[str], size: str, random: np.random.Generator
) -> tuple[tuple[HiddenEffect, ...], UnmodelledEffect | None]:
    """Draw the truth of one case."""
    if kind == "null":
        return (), None
    if kind == "absent":
        return (HiddenEffect(names[0], _absent_effects()[names[0]], size),), None
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
    """Draw one effect: some amplitudes at a size, one sign for all, shapes within the range of the runs."""
    amplitudes = effect.amplitudes
    chosen = [p for p in amplitudes if random.random() < 0.7] or [random.choice(np.array(amplitudes))]
    values: dict[str, float | str] = {p.name: float(p.null_value or 0.0) for p in amplitudes}
    share = SIZES[size]
    signs = [s for s in (1.0, -1.0) if all(_fits(p, s * share) for p in chosen)]
    if effect.name in _ONLY_MORE:
        signs = [1.0]
    sign = float(random.choice(signs)) if signs else 1.0
    for p in chosen:
        values[p.name] = float(np.clip(value_at(p, sign * share), p.low, p.high))
    values.update(_shape(effect, random))
    selectors = [selector for selector in effect.selectors if not selector.optional]
    for selector in selectors:
        values[selector.name] = str(random.choice(np.array(selector.on(ROBOT_WHEELS))))
    return HiddenEffect(effect.name, {p.name: values[p.name] for p in (*effect.parameters, *selectors)}, size)


def value_at(p: EffectParameter | CandidateParameter, share: float) -> float:
    """Return the value at a share of the way from no effect to the typical value."""
    null_value = p.null_value or 0.0
    return null_value + share * (p.typical - null_value)


def _fits(p: EffectParameter, share: float) -> bool:
    return p.low <= value_at(p, share) <= p.high


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
        half = 0.5 * WITHIN * (p.high - p.low)
        found[p.name] = float(np.clip(p.nominal + half * random.uniform(-1.0, 1.0), p.low, p.high))
    return found
