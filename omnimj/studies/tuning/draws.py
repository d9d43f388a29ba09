"""What a candidate is driven with: a scenario on a drawn floor, with a drawn payload, errors and fault.

Every candidate gets the same draws (common random numbers), so that what differs is the candidate.
"""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.errors import InputError
from omnimj.parameters import read_robot
from omnimj.plant.faults import Fault, fault_record
from omnimj.signals import KINDS_OF_DIAGNOSIS
from omnimj.simulate.scenario.scenario import Scenario, absolute_scenario, read_scenario
from omnimj.studies.evaluation.cases import FLOORS
from omnimj.studies.random_truth import NONE, ParameterErrors, draw_faults, draw_parameter_errors

AS_WRITTEN = "as written"
FAULTS = (AS_WRITTEN, "motor", NONE, "slip")
"""What goes wrong in a draw, in turn: what the scenario says, a weak motor, nothing, a slip."""
JUDGING = 100
"""Judging seed less training seed: seeds from 100 on are never tuned with, as `omnimj evaluate` has it."""
_ONSETS = 0.35, 0.65  # shares of the duration between which a drawn fault begins
_WORLD, _FAULT, _NOISE = range(3)


@dataclass(frozen=True)
class Draw:
    """One run's truth."""

    name: str
    """`nylon_patch_100_003`: scenario, seed, number."""
    scenario: str
    """Name or absolute path: a worker may be in another folder."""
    model: Path | None
    """Model file of the robot; the shipped one when None."""
    plant: str
    """`planar` or `twin`."""
    floor: str
    fault: str
    """One of `FAULTS`."""
    faults: tuple[Fault, ...]
    errors: ParameterErrors
    noise: int
    """Seed of the sensors."""

    def to_dict(self) -> dict[str, Any]:
        """In JSON's own kinds."""
        return {
            "scenario": Path(self.scenario).stem,
            "plant": self.plant,
            "floor": self.floor,
            "fault": self.fault,
            "faults": [fault_record(fault) for fault in self.faults],
            "payload": self.errors.payload,
            "errors": {**self.errors.constants, **self.errors.floor},
            "torque_constants": list(self.errors.torque_constants),
            "noise": self.noise,
        }

    @property
    def is_broken(self) -> bool:
        """Whether anything goes wrong that can be diagnosed."""
        return self.fault != NONE


def draw_trial(
    text: str, scenario: Scenario, seed: int, index: int, plant: str, model: Path | None = None
) -> Draw:
    """Number `index` of the draws of a scenario; the same scenario, seed and number draw the same.

    Args:
      text: The scenario's name or path, for those who drive it.
      scenario: As read.
      seed: Below 100 for tuning, from 100 on for judging.
      index: From 0; what goes wrong takes turns with it.
      plant: `planar` or `twin`.
      model: Model file of the robot.
    """
    key = zlib.crc32(scenario.name.encode())

    def stream(what: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(key, index, what)))

    world, fault = stream(_WORLD), FAULTS[(index + key) % len(FAULTS)]
    floor = FLOORS[int(world.integers(len(FLOORS)))]
    kept = tuple(f for f in scenario.faults if f.kind not in KINDS_OF_DIAGNOSIS)
    onsets = (_ONSETS[0] * scenario.duration, _ONSETS[1] * scenario.duration)
    faults = scenario.faults if fault == AS_WRITTEN else kept
    if fault not in (AS_WRITTEN, NONE):
        drawn = draw_faults(stream(_FAULT), fault, onsets, False)
        faults = (*kept, *(_on_a_wheel(one, len(scenario.wheel_positions)) for one in drawn))
    return Draw(
        name=f"{scenario.name}_{seed:03d}_{index:03d}" + ("" if plant == "planar" else f"_{plant}"),
        scenario=absolute_scenario(text),
        model=None if model is None else model.absolute(),
        plant=plant,
        floor=floor,
        fault=fault,
        faults=faults,
        errors=draw_parameter_errors(world, len(scenario.wheel_positions)),
        noise=int(stream(_NOISE).integers(2**62)),
    )


def _on_a_wheel(fault: Fault, wheels: int) -> Fault:
    """Drawn for four wheels; a robot with fewer has them in turn."""
    wheel = fault.wheel
    return fault if wheel is None else dataclasses.replace(fault, wheel=1 + (wheel - 1) % wheels)


def read_tuned_scenarios(texts: tuple[str, ...], model: Path | None) -> Mapping[str, Scenario]:
    """The scenarios by name or path, each fit for being tuned with.

    Raises:
      InputError: One of the rig, of another robot, of the kinematic level or with obstacles, or one twice.
      UnknownNameError: No such scenario.
    """
    found: dict[str, Scenario] = {}
    for text in texts:
        scenario = read_scenario(text, (), model)
        if scenario.plant != "uto_robot" or scenario.level != "physics" or scenario.scene is not None:
            rule = "a robot's scenario with forces, on a flat floor, is needed"
            raise InputError(f"SCENARIO {text}", "cannot be tuned with", rule)
        own = read_robot(model).file
        if scenario.constants.file.resolve() != own.resolve():
            rule = "all scenarios are of one robot: give --model"
            raise InputError(f"SCENARIO {text}", f"is of the robot in {scenario.constants.file}", rule)
        if scenario.name in {known.name for known in found.values()}:
            raise InputError(f"SCENARIO {text}", f"'{scenario.name}' is there twice")
        found[text] = scenario
    return MappingProxyType(found)


def apply_draw(scenario: Scenario, draw: Draw, with_truth: bool) -> Scenario:
    """The scenario as it is in a draw.

    Args:
      scenario: As read.
      draw: The draw.
      with_truth: With faults and patches, for plant and judge; without, for the controller.
    """
    as_written = draw.fault == AS_WRITTEN
    return dataclasses.replace(
        scenario,
        floor=draw.floor,
        faults=draw.faults if with_truth else (),
        patches=scenario.patches if with_truth and as_written else (),
        checks=(),
    )
