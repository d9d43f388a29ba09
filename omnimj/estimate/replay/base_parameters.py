"""Uncertain parameters of a machine (constants, floors, mass, lags), and machines with further effects."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from omnimj.effects import FLOOR_SCALES, AppliedEffects, scale_floor, with_effects
from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.replay.interface import BaseParameter, CandidateEffect, Setting
from omnimj.parameters import Floor, Rig, Robot
from omnimj.physics.effect_terms import mark_active, write_curve
from omnimj.physics.planar import PlanarConstants, planar_constants
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array

_SHARES = (1.0, 0.7, 0.4, 0.0)  # trial shares of a payload's distance from the centre
_LAG = 0.004  # [s] largest lag of a channel that is no delay

Machine = TypeVar("Machine", Rig, Robot)


@dataclass(frozen=True)
class AdjustedMachine(Generic[Machine]):
    """Machine with values of its uncertain parameters."""

    machine: Machine
    floors: dict[str, Floor]
    lags: dict[str, float]
    """Channel → lag [s]."""
    mass_scale: float
    """True over declared mass of the runs; 1 where the machine's own mass is the parameter."""


def base_parameters(
    machine: Rig | Robot, floors: Mapping[str, Floor], used: Sequence[str], channels: Sequence[str]
) -> tuple[BaseParameter, ...]:
    """Uncertain parameters of the machine, the floors in use, and the lags of channels."""
    found = []
    for name, origin in machine.provenance.items():
        table, _, key = name.partition(".")
        if origin.uncertainty <= 0.0 or table == "effects" or not hasattr(machine, table):
            continue
        value, half = getattr(getattr(machine, table), key), origin.uncertainty
        if name == "rig.masses":
            found.append(_scale("mass.scale", half / value[0], "mass over what the runs say"))
        elif isinstance(value, float):
            low = max(value - half, 0.0) if value >= 0.0 else value - half
            found.append(BaseParameter(name, origin.unit, value, low, value + half))
    for floor in dict.fromkeys(used):
        half = floors[floor].uncertainty
        for letter, together in FLOOR_SCALES.items():
            if half > 0.0 and any(key in floors[floor].numbers for key in together):
                found.append(_scale(f"{floor}.{letter}", half, f"{letter} over that of {floor}"))
    found += [BaseParameter(f"{name}.lag", "s", 0.0, -_LAG, _LAG, f"lateness of {name}") for name in channels]
    return tuple(found)


def _scale(name: str, half: float, words: str) -> BaseParameter:
    return BaseParameter(name, "1", 1.0, 1.0 - half, 1.0 + half, words)


def adjust_machine(
    machine: Machine, floors: Mapping[str, Floor], base: Sequence[BaseParameter], values: Array
) -> AdjustedMachine[Machine]:
    """The machine with other values of its uncertain parameters, shape (len(base),)."""
    tables: dict[str, dict[str, float]] = {}
    scales: dict[str, dict[str, float]] = {}
    lags: dict[str, float] = {}
    mass_scale = 1.0
    for parameter, number in zip(base, values, strict=True):
        table, _, key = parameter.name.rpartition(".")
        value = float(number)
        if key == "lag":
            lags[table] = value
        elif parameter.name == "mass.scale":
            mass_scale = value
        elif table in floors:
            scales.setdefault(table, {})[key] = value
        else:
            tables.setdefault(table, {})[key] = value
    changed = {
        name: dataclasses.replace(getattr(machine, name), **entries) for name, entries in tables.items()
    }
    return AdjustedMachine(
        dataclasses.replace(machine, **changed) if changed else machine,
        {name: scale_floor(floor, scales.get(name, {})) for name, floor in floors.items()},
        lags,
        mass_scale,
    )


def add_effects(machine: Machine, chosen: Iterable[tuple[CandidateEffect, Array]]) -> Machine:
    """The machine with further effects, given as candidates with values of shape (parameters,)."""
    effects: dict[str, dict[str, Any]] = {}
    for candidate, values in chosen:
        name = _free_name(candidate.effect, {*machine.effects, *effects})
        effects[name] = {**candidate.values(values), **candidate.selectors}
    return with_effects(machine, effects) if effects else machine


def adjusted_machine(
    machine: Machine,
    floors: Mapping[str, Floor],
    base: Sequence[BaseParameter],
    candidates: Mapping[str, CandidateEffect],
    setting: Setting,
) -> AdjustedMachine[Machine]:
    """The machine with the base parameters and effects of a setting."""
    adjusted = adjust_machine(machine, floors, base, setting.base)
    chosen = [(candidates[label], values) for label, values in setting.effects.items()]
    return dataclasses.replace(adjusted, machine=add_effects(adjusted.machine, chosen))


def _free_name(name: str, taken: set[str]) -> str:
    """Name for one more instance of an effect."""
    return next(c for c in (name, *(f"{name}_{k}" for k in range(2, 10))) if c not in taken)


def standing_constants(changed: AppliedEffects, mass: float) -> PlanarConstants:
    """Packed robot with its payload, which is moved inward if a wheel would lift off.

    Args:
      mass: Declared mass [kg].
    """
    robot = dataclasses.replace(changed.machine, body=dataclasses.replace(changed.machine.body, mass=mass))
    extra, x, y = changed.payload
    for share in _SHARES:
        place = (extra, share * x, share * y)
        try:
            return planar_constants(
                robot, changed.misalignment, changed.radius_scale, 1.0, place, changed.slope
            )
        except InputError:
            if share == _SHARES[-1]:
                raise
    raise AssertionError  # the last share returns or raises


FreeCurve = tuple[str, Array, tuple[float, float]]
"""Free force over one variable: its name, the force at the knots, shape (KNOTS,) [N], first and last knot."""


def with_free_curve(terms: Array, curve: FreeCurve | None) -> Array:
    """Packed effect terms, shape (n, TERMS), with a free force; a copy."""
    changed = terms.copy()
    if curve is not None:
        over, force, ends = curve
        write_curve(changed, over, force.tolist(), *ends)
        mark_active(changed)
    return changed


def floor_name(dataset: Dataset, run: Run, floors: Mapping[str, Floor]) -> str:
    """Return the name of the floor of a run.

    Raises:
      InputError: The run has none.
      UnknownNameError: Unknown floor.
    """
    name = run.conditions.get("floor")
    place = dataset.path / "dataset.toml"
    if name is None:
        raise InputError(f"{place}: runs.{run.name}", "'floor' is missing", "say which floor", floors)
    if name not in floors:
        raise UnknownNameError(f"{place}: runs.{run.name}.floor", "floor", name, floors)
    return str(name)
