"""Runs a scenario: plant, controller and loop put together, metrics taken."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from omnimj.control.cascade.controller import Controller
from omnimj.control.detection.detector import FaultDetector
from omnimj.control.detection.robust import RobustDetector
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.fault_tolerant import FaultTolerantController
from omnimj.control.recovery import Recovery
from omnimj.errors import InputError
from omnimj.link.host.plant import HardwarePlant
from omnimj.parameters import Robot
from omnimj.plant.interface import Plant
from omnimj.signals import Array, Trace
from omnimj.simulate.detectors import make_detector, require_known_method
from omnimj.simulate.kinematic import drive_kinematic
from omnimj.simulate.loop import Callbacks, Progress, Rows, Snapshot, drive, drive_rig
from omnimj.simulate.plants import KINEMATIC, LinkOptions, make_plant, plant_name, warm_up
from omnimj.simulate.scenario.drive import Drive
from omnimj.simulate.scenario.scenario import RigInput, Scenario
from omnimj.simulate.summary import summarize

_FEWEST_ROWS = 2  # a run that ended before is no run


@dataclass(frozen=True)
class PoseTrack:
    """Poses of the twin through a run, for the 3-D recording."""

    mj_model: Any
    """The twin's compiled model."""
    time: Array
    """Shape (m,) [s]."""
    position: Array
    """Generalised positions, shape (m, nq)."""


@dataclass(frozen=True)
class RunResult:
    """A scenario that was driven."""

    scenario: Scenario
    trace: Trace
    metrics: dict[str, Any]
    """The content of `metrics.json`; empty when the run was interrupted before its second row."""
    poses: PoseTrack | None = None
    """None for plants without poses."""

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the run."""
        return bool(self.trace.about["interrupted"])


@dataclass
class _PoseRecorder:
    """Collects snapshots and passes them on."""

    beside: Snapshot | None
    times: list[float] = field(default_factory=list)
    positions: list[Array] = field(default_factory=list)

    def take(self, now: float, pose: Array) -> None:
        self.times.append(now)
        self.positions.append(np.array(pose))
        if self.beside is not None:
            self.beside(now, pose)


def run_scenario(
    scenario: Scenario,
    plant: str | None = None,
    method: str = "off",
    seed: int = 0,
    progress: Progress | None = None,
    snapshot: Snapshot | None = None,
    on_start: Callable[[Plant], None] | None = None,
    rows: Rows | None = None,
    thresholds: Thresholds | None = None,
    wire: LinkOptions | None = None,
    truth: Scenario | None = None,
) -> RunResult:
    """Drives a scenario once.

    Args:
      scenario: From `read_scenario`.
      plant: `twin`, `planar`, the address of a device; by the scenario's level when None.
      method: `off` or `published`.
      seed: Of the sensors' noise.
      progress: Called now and then with the rows done and the rows in all.
      snapshot: Called with time and pose at every pose that is recorded, for a live view.
      on_start: Called with the plant before the first step.
      rows: Called now and then with the newest rows of the trace, for a live view.
      thresholds: Of the robust method; the shipped ones when None.
      wire: How an address is used; as usual when None.
      truth: The same scenario with other constants or floors: the plant is made of it, while controller and
        method believe `scenario`. What they believe is the truth when None.

    Returns:
      Trace, metrics and poses; ended early by Ctrl-C or by a failure (`trace.about["failure"]`) with what was
      recorded until then.

    Raises:
      InputError: A plant or method that this version does not have, or that does not fit the scenario.
      LinkLost: There is nobody at the address who can be driven.
    """
    require_known_method(method)
    name = plant_name(scenario, plant)
    if name == KINEMATIC and method != "off":
        rule = f"{scenario.name} is at the kinematic level, where there are no currents to diagnose from"
        raise InputError("--method", f"found {method!r}", rule, ("off",))
    about = {
        "scenario": scenario.name,
        "plant": name,
        "method": method,
        "seed": seed,
        "floor": scenario.floor,
    }
    poses = None
    if name == KINEMATIC:
        trace = _run_kinematic(scenario, about)
    else:
        taken = _PoseRecorder(snapshot)
        watch = Callbacks(progress, taken.take, rows)
        made_of = scenario if truth is None else truth
        plant_of = functools.partial(make_plant, made_of, name, seed, wire)
        trace, poses = _run_physics(scenario, plant_of, about, watch, taken, on_start, thresholds)
    told = summarize(scenario, trace) if len(trace["time"]) >= _FEWEST_ROWS else {}
    return RunResult(scenario, trace, told, poses)


def _run_physics(
    scenario: Scenario,
    plant_of: Callable[[], Plant],
    about: dict[str, Any],
    watch: Callbacks,
    poses: _PoseRecorder,
    on_start: Callable[[Plant], None] | None,
    thresholds: Thresholds | None,
) -> tuple[Trace, PoseTrack | None]:
    method = make_detector(about["method"], scenario, thresholds)
    plant = plant_of()
    try:
        if on_start is not None:
            on_start(plant)
        if isinstance(scenario.drive, RigInput):
            current = np.full(round(scenario.duration / plant.period) + 1, scenario.drive.current)
            trace = drive_rig(plant, current, watch, about, method)
        else:
            controller = make_diagnosing_controller(scenario, method)
            if isinstance(plant, HardwarePlant) and not plant.is_lock_step:
                warm_up(scenario, controller)
            trace = drive(plant, controller, scenario.drive.reference, watch, about)
        if isinstance(plant, HardwarePlant):
            trace = Trace(trace.columns, {**trace.about, "link": plant.record.as_record()})
        if not poses.times:
            return trace, None
        mj_model = getattr(plant, "mj_model", None)
        return trace, PoseTrack(mj_model, np.array(poses.times), np.stack(poses.positions))
    finally:
        plant.close()


def make_controller(scenario: Scenario) -> Controller:
    """The controller of a robot scenario, with the loops its `[drive]` asks for."""
    robot, asked = scenario.constants, scenario.drive
    assert isinstance(robot, Robot)
    assert isinstance(asked, Drive)
    return Controller(
        robot,
        yaw_loop=asked.yaw_loop,
        heading_hold=asked.heading_hold,
        heading_feedback=asked.heading_feedback,
        period=scenario.period,
    )


def make_diagnosing_controller(
    scenario: Scenario, method: FaultDetector | None
) -> Controller | FaultTolerantController:
    """The controller with a method beside it, and with recovery where the method leaves that to it.

    Args:
      scenario: Of a robot; its `[diagnosis]` table may switch recovery off.
      method: From `make_detector`; None: the cascade alone.
    """
    controller, robot, asked = make_controller(scenario), scenario.constants, scenario.drive
    if method is None:
        return controller
    assert isinstance(robot, Robot)
    assert isinstance(asked, Drive)
    recovery = None
    choice = scenario.diagnosis
    if isinstance(method, RobustDetector) and choice.recovery:
        gains = None if scenario.gains is None else scenario.gains.recovery
        recovery = Recovery(
            robot, scenario.period, asked.heading_hold, choice.dither, choice.self_test, gains
        )
    return FaultTolerantController(controller, method, recovery)


def _run_kinematic(scenario: Scenario, about: dict[str, Any]) -> Trace:
    robot, asked, case = scenario.constants, scenario.drive, scenario.kinematics
    assert isinstance(robot, Robot)
    assert isinstance(asked, Drive)
    assert case is not None
    begin = time.perf_counter()
    trace = drive_kinematic(
        robot,
        asked.reference,
        case,
        yaw_gain=robot.control.yaw_rate_proportional if asked.yaw_loop else 0.0,
        heading_feedback=asked.heading_feedback,
    )
    factor = scenario.duration / max(time.perf_counter() - begin, 1e-9)
    return Trace(trace.columns, {**about, "interrupted": False, "failure": None, "realtime_factor": factor})
