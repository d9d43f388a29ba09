"""Run a scenario: build plant, detector and controller, drive them in the loop, compute the metrics."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from omnimj.control.cascade.controller import Controller
from omnimj.control.compiled import CompiledController
from omnimj.control.detection.detector import FaultDetector
from omnimj.control.detection.robust import RobustDetector
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.fault_tolerant import FaultTolerantController
from omnimj.control.recovery import Recovery
from omnimj.display import Displayed
from omnimj.errors import InputError
from omnimj.link.host.plant import HardwarePlant
from omnimj.plant.faults import Fault
from omnimj.signals import Array, Trace
from omnimj.simulate.detectors import make_detector, require_known_method
from omnimj.simulate.driving import Controller as LoopController
from omnimj.simulate.driving import drive, drive_rig
from omnimj.simulate.kinematic import drive_kinematic
from omnimj.simulate.loop import NO_CALLBACKS, Callbacks, Snapshot
from omnimj.simulate.plants import (
    KINEMATIC,
    LinkOptions,
    make_kinematic_plant,
    make_plant,
    make_simulated,
    plant_name,
)
from omnimj.simulate.scenario.scenario import Scenario
from omnimj.simulate.suites.missions import mission
from omnimj.simulate.summary import summarize

_FEWEST_ROWS = 2  # a shorter run has no metrics
_WARM_UP_TIME = 4.0  # [s]


@dataclass(frozen=True)
class PoseTrack:
    """Poses of the twin during a run, for the 3-D recording."""

    mj_model: Any
    """The twin's compiled model."""
    time: Array
    """Shape (m,) [s]."""
    position: Array
    """Generalised positions qpos of MuJoCo, shape (m, nq)."""


@dataclass(frozen=True)
class RunResult(Displayed):
    """Result of `run_scenario`."""

    scenario: Scenario
    trace: Trace
    metrics: dict[str, Any]
    """The content of `metrics.json`; empty when the run was interrupted before its second row."""
    poses: PoseTrack | None = None
    """None for a plant without poses."""

    @property
    def interrupted(self) -> bool:
        """True if Ctrl-C or a failure ended the run."""
        return bool(self.trace.about["interrupted"])


@dataclass
class _PoseRecorder:
    """Collector of the plant's poses, which also passes them on."""

    forward: Snapshot | None
    times: list[float] = field(default_factory=list)
    positions: list[Array] = field(default_factory=list)

    def take(self, now: float, pose: Array) -> None:
        self.times.append(now)
        self.positions.append(np.array(pose))
        if self.forward is not None:
            self.forward(now, pose)

    def track(self, plant: Any) -> PoseTrack | None:
        if not self.times:
            return None
        return PoseTrack(getattr(plant, "mj_model", None), np.array(self.times), np.stack(self.positions))


def run_scenario(
    scenario: Scenario,
    plant: str | None = None,
    method: str = "off",
    seed: int = 0,
    callbacks: Callbacks = NO_CALLBACKS,
    thresholds: Thresholds | None = None,
    link: LinkOptions | None = None,
    truth: Scenario | None = None,
) -> RunResult:
    """Drive a scenario once and compute its metrics.

    Args:
      scenario: Scenario from `read_scenario`.
      plant: `twin`, `planar`, or the address of a device; chosen by the scenario's level when None.
      method: Diagnosis method: `robust`, `published` or `off`.
      seed: Seed of the sensor noise.
      callbacks: Callbacks for progress and live view.
      thresholds: Thresholds of the robust method; the shipped ones when None.
      link: Options of a link to a device; the defaults when None.
      truth: Same scenario with other constants or floors for the plant, while controller and detector
        assume the nominal ones of `scenario`; None: `scenario` itself.

    Returns:
      Trace, metrics and poses; if Ctrl-C or a failure (`trace.about["failure"]`) ended the run early, they
      cover the rows recorded until then.

    Raises:
      InputError: A plant or method that does not exist or does not fit the scenario.
      LinkLost: No device that can be driven answers at the address.
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
    if name == KINEMATIC:
        feedback, reference = scenario.robot_drive.heading_feedback, scenario.robot_drive.reference
        kinematic = make_kinematic_plant(scenario)
        if callbacks.start is not None:
            callbacks.start(kinematic)
        trace, poses = drive_kinematic(kinematic, reference, feedback, callbacks, about), None
    else:
        detector = make_detector(method, scenario, thresholds)
        made_of = scenario if truth is None else truth
        driven = make_plant(made_of, name, seed, link)
        try:
            recorder = _PoseRecorder(callbacks.snapshot)
            callbacks = dataclasses.replace(callbacks, snapshot=recorder.take)
            trace = _drive(scenario, driven, detector, callbacks, about)
            poses = recorder.track(driven)
        finally:
            driven.close()
    metrics = summarize(scenario, trace) if len(trace["time"]) >= _FEWEST_ROWS else {}
    return RunResult(scenario, trace, metrics, poses)


def _drive(
    scenario: Scenario,
    plant: Any,
    detector: FaultDetector | None,
    callbacks: Callbacks,
    about: dict[str, Any],
) -> Trace:
    if callbacks.start is not None:
        callbacks.start(plant)
    if scenario.is_rig:
        current = np.full(round(scenario.duration / plant.period) + 1, scenario.rig_input.current)
        return drive_rig(plant, current, callbacks, about, detector)
    controller = make_diagnosing_controller(scenario, detector)
    on_hardware = isinstance(plant, HardwarePlant)
    if on_hardware and not plant.is_lock_step:
        warm_up(scenario, controller)
    trace = drive(plant, controller, scenario.robot_drive.reference, callbacks, about)
    if on_hardware:
        trace = Trace(trace.columns, {**trace.about, "link": plant.record.as_record()})
    return trace


def make_controller(scenario: Scenario) -> Controller:
    """Make the controller of a robot scenario, with the loops that its `[drive]` table switches on."""
    drive = scenario.robot_drive
    assumed = None if drive.creep_floor is None else scenario.floors[drive.creep_floor]
    return Controller(
        scenario.robot,
        yaw_loop=drive.yaw_loop,
        heading_hold=drive.heading_hold,
        heading_feedback=drive.heading_feedback,
        period=scenario.period,
        creep_floor=assumed,
    )


def make_diagnosing_controller(
    scenario: Scenario, detector: FaultDetector | None
) -> FaultTolerantController | CompiledController:
    """Make a controller with a fault detector and, for the robust method, with recovery.

    Args:
      scenario: A robot scenario; its `[diagnosis]` table may switch recovery off.
      detector: Detector from `make_detector`; None: the cascade alone.
    """
    controller = make_controller(scenario)
    if detector is None:
        return CompiledController(controller)
    recovery, options = None, scenario.diagnosis
    if not isinstance(detector, RobustDetector):
        return FaultTolerantController(controller, detector)
    if options.recovery:
        gains = None if scenario.gains is None else scenario.gains.recovery
        recovery = Recovery(
            scenario.robot,
            scenario.period,
            scenario.robot_drive.heading_hold,
            options.dither,
            options.self_test,
            gains,
        )
    return CompiledController(controller, detector, recovery)


def warm_up(scenario: Scenario, controller: LoopController) -> None:
    """Run a controller through two faults in a short simulation, to load all its compiled code.

    Loading a kernel takes many control periods, and a robot driven in real time does not wait. A controller
    keeps no state, so the simulation leaves no trace in it.

    Args:
      scenario: A robot scenario.
      controller: Controller of that scenario.

    Raises:
      KeyboardInterrupt: Ctrl-C ended the simulation.
    """
    reference = mission(np.random.default_rng(0), _WARM_UP_TIME, scenario.period)
    faults = (
        Fault("motor", 0.3 * _WARM_UP_TIME, wheel=1, numbers={"loss": 0.7}),
        Fault("slip", 0.6 * _WARM_UP_TIME, wheel=2, numbers={"grip": 0.1}),
    )
    plant = make_simulated("planar", scenario.robot, scenario.floor, scenario.floors, faults=faults)
    try:
        trace = drive(plant, controller, reference)
    finally:
        plant.close()
    if trace.about["interrupted"] and not trace.about["failure"]:
        raise KeyboardInterrupt
