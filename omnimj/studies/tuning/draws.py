"""Random draws over which candidates are driven: scenario, floor, payload, parameter errors and fault.

All candidates share the same draws (common random numbers), so that scores differ by the candidate alone.
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
"""Faults of successive draws, cyclically: those of the scenario, a motor fault, none, a slip."""
JUDGING = 100
"""Judging seed − training seed: seeds from 100 on are for evaluation only, as in `omnimj evaluate`."""
_ONSETS = 0.35, 0.65  # shares of the duration between which a drawn fault begins
_WORLD, _FAULT, _NOISE = range(3)


@dataclass(frozen=True)
class Draw:
    """Truth of one run."""

    name: str
    """Name of scenario, seed and number: `nylon_patch_100_003`."""
    scenario: str
    """Name or absolute path, since a worker may run in another folder."""
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
    """Seed of the sensor noise."""

    def to_dict(self) -> dict[str, Any]:
        """Return the draw as JSON-compatible values."""
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
        """True if there is a fault that can be diagnosed."""
        return self.fault != NONE


def draw_trial(
    text: str, scenario: Scenario, seed: int, index: int, plant: str, model: Path | None = None
) -> Draw:
    """Draw the truth of one run; the same scenario, seed and number give the same draw."""
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
        errors=draw_parameter_errors(world, scenario.robot),
        noise=int(stream(_NOISE).integers(2**62)),
    )


def _on_a_wheel(fault: Fault, wheels: int) -> Fault:
    """Map a fault that was drawn for four wheels to a robot with fewer."""
    wheel = fault.wheel
    return fault if wheel is None else dataclasses.replace(fault, wheel=1 + (wheel - 1) % wheels)


def read_tuned_scenarios(texts: tuple[str, ...], model: Path | None) -> Mapping[str, Scenario]:
    """Read scenarios by name or path and check that each is suitable for tuning.

    Raises:
      InputError: A scenario is of the rig or another robot, has no forces or has obstacles, or is repeated.
      UnknownNameError: A scenario does not exist.
    """
    found: dict[str, Scenario] = {}
    for text in texts:
        scenario = read_scenario(text, (), model)
        if scenario.plant != "uto_robot" or scenario.level != "physics" or scenario.scene is not None:
            rule = "a scenario of a robot with forces on a flat floor is needed"
            raise InputError(f"SCENARIO {text}", "cannot be used for tuning", rule)
        own = read_robot(model).file
        if scenario.constants.file.resolve() != own.resolve():
            rule = "all scenarios must be of one robot: pass --model"
            raise InputError(f"SCENARIO {text}", f"is of the robot in {scenario.constants.file}", rule)
        if scenario.name in {known.name for known in found.values()}:
            raise InputError(f"SCENARIO {text}", f"'{scenario.name}' occurs twice")
        found[text] = scenario
    return MappingProxyType(found)


def apply_draw(scenario: Scenario, draw: Draw, with_truth: bool) -> Scenario:
    """Return the scenario with the floor of a draw; for the plant, `with_truth`, also faults and patches."""
    as_written = draw.fault == AS_WRITTEN
    return dataclasses.replace(
        scenario,
        floor=draw.floor,
        faults=draw.faults if with_truth else (),
        patches=scenario.patches if with_truth and as_written else (),
        checks=(),
    )
