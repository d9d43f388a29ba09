"""Thresholds of the published method from twin runs: `python -m omnimj.diagnosis.published_thresholds`.

Prints the content of `models/published_thresholds.toml`. A threshold is the largest residual of fault-free
runs, for force residuals also of runs with slip, on natural stone with training seeds (sections 5.2 and 5.3).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from omnimj.control.detection.detector import VARIANTS, DetectorOptions
from omnimj.control.detection.published.decision import PublishedThresholds
from omnimj.control.detection.published.rig import PublishedRigDetector
from omnimj.control.detection.published.robot import PublishedRobotDetector
from omnimj.control.fault_tolerant import FaultTolerantController
from omnimj.signals import Trace
from omnimj.simulate.driving import drive, drive_rig
from omnimj.simulate.plants import make_plant
from omnimj.simulate.run import make_controller
from omnimj.simulate.scenario.scenario import Scenario, read_scenario

TRAINING_SEEDS = (1000, 1001)
"""Seeds of the training runs; evaluation uses other seeds."""
RIG_CURRENTS = tuple(round(0.15 * k, 2) for k in range(3, 11))
"""Motor currents of the rig runs, as in section 4.3 [A]."""
DIRECTIONS = tuple(math.pi / 4.0 * k for k in range(8))
"""Driving directions along x, y and both, section 5.3 [rad]."""
MANOEUVRE = "kind = 'profile', acceleration = 1.0, start_time = 0.5, cruise_time = 2.0"
"""Manoeuvre of the tests of 5 s: at high speed 1 s acceleration, 2 s at 1 m/s, 1 s deceleration."""
TURN = "kind = 'profile', speed = 0.0, yaw_cruise_time = 2.0, start_time = 0.5"
NYLON = "kind = 'slip', onset = 0.0, floor = 'nylon'"


@dataclass(frozen=True)
class TrainingRun:
    """Training run, with the residuals for which it counts."""

    scenario: Scenario
    seed: int
    slips: bool
    """True if a wheel slips: the run then counts for the force residuals only, Eqs. 5.8 and 5.21."""

    @property
    def is_rig(self) -> bool:
        """True for a run of the rig, False for one of the robot."""
        return self.scenario.is_rig


def rig_test(current: float, faults: str = "") -> Scenario:
    """Scenario of the rig with a constant current on natural stone for 1.2 s."""
    overrides = (f"current={current}", "duration=1.2", f"faults=[{faults}]", "checks={}")
    return read_scenario("rig_constant_current", overrides)


def robot_test(table: str, faults: str = "", *overrides: str) -> Scenario:
    """Scenario of the robot on natural stone for 5 s.

    Args:
      table: Keys of its `[drive]`.
      faults: Inline tables of its `[[faults]]`.
      overrides: More `KEY=VALUE` texts.
    """
    own = (f"drive={{{table}}}", "duration=5.0", f"faults=[{faults}]", "checks={}")
    return read_scenario("degraded_motor", (*own, *overrides))


def training_runs() -> Iterator[TrainingRun]:
    """Yield the runs on which the shipped thresholds are calibrated."""
    for seed in TRAINING_SEEDS:
        for current in RIG_CURRENTS:
            yield TrainingRun(rig_test(current), seed, False)
            yield TrainingRun(rig_test(current, f"{{{NYLON}, wheel = 1}}"), seed, True)
        for speed in ("low", "high"):
            for direction in DIRECTIONS:
                table = f"{MANOEUVRE}, speed = '{speed}', direction = {direction}"
                yield TrainingRun(robot_test(table), seed, False)
        for rate in (-2.0, -1.0, 1.0, 2.0):
            yield TrainingRun(robot_test(f"{TURN}, yaw_rate = {rate}"), seed, False)
        for wheel in range(1, 5):
            table = f"{MANOEUVRE}, speed = 'high', direction = {math.pi / 2.0 * (wheel % 2)}"
            yield TrainingRun(robot_test(table, f"{{{NYLON}, wheel = {wheel}}}"), seed, True)


def run_with_residuals(run: TrainingRun, choice: DetectorOptions, plant: str = "twin") -> Trace:
    """Drive a run with the method as an observer: infinite thresholds, no recovery.

    Args:
      run: Training run.
      choice: Options of the method, of which `recovery` is not used.
      plant: Name of the plant, as for `make_plant`.

    Returns:
      The run with the residuals in the detector's log.
    """
    scenario, never = run.scenario, PublishedThresholds(*([math.inf] * 4))
    floor, choice = scenario.floors[scenario.floor], dataclasses.replace(choice, recovery=False)
    driven = make_plant(scenario, plant, run.seed)
    try:
        if scenario.is_rig:
            current = np.full(round(scenario.duration / driven.period) + 1, scenario.rig_input.current)
            rig = PublishedRigDetector(scenario.rig, floor, scenario.rig_input.mass, never, choice)
            return drive_rig(driven, current, detector=rig)
        robot = PublishedRobotDetector(scenario.robot, floor, never, choice)
        controller = FaultTolerantController(make_controller(scenario), robot)
        return drive(driven, controller, scenario.robot_drive.reference)
    finally:
        driven.close()


def largest_residuals(run: TrainingRun, choice: DetectorOptions) -> dict[str, float]:
    """Largest residuals of a run by name of their threshold; r3 … r6 signed, as in the dissertation."""
    trace, prefix = run_with_residuals(run, choice), "rig_" if run.is_rig else ""
    found = {}
    for kind in ("wheel_speed", "force"):
        if run.slips and kind == "wheel_speed":
            continue
        columns = [values for name, values in trace.columns.items() if name.startswith(f"residual_{kind}")]
        values = np.array(columns) if choice.printed else np.abs(columns)
        found[f"{prefix}{kind}"] = float(values.max())
    return found


def fault_free_thresholds(variant: str) -> PublishedThresholds:
    """Thresholds of Eqs. 5.3, 5.8, 5.13 and 5.21 over `training_runs`.

    Args:
      variant: One of `VARIANTS`; each has its own observer and therefore its own thresholds.
    """
    largest = {field.name: 0.0 for field in dataclasses.fields(PublishedThresholds)}
    for run in training_runs():
        for name, value in largest_residuals(run, DetectorOptions(variant)).items():
            largest[name] = max(largest[name], value)
    return PublishedThresholds(**largest)


def as_toml(variant: str, thresholds: PublishedThresholds) -> str:
    """Return one table of `published_thresholds.toml`."""
    lines = [f"[{variant}]"]
    for field in dataclasses.fields(PublishedThresholds):
        value, unit = getattr(thresholds, field.name), field.metadata["unit"]
        lines.append(f'{field.name} = {{ value = {value:.4f}, unit = "{unit}", source = "measured" }}')
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(
        "# Thresholds of the published method: the largest residuals of fault-free runs of the twin (of the"
    )
    print("# force residuals also of runs with slip), on natural stone, training seeds. Made by")
    print("#   python -m omnimj.diagnosis.published_thresholds > models/published_thresholds.toml")
    for name in VARIANTS:
        print(f"\n{as_toml(name, fault_free_thresholds(name))}", end="")
