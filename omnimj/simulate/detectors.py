"""Fault detectors by method: `robust`, `published` or `off`."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

from omnimj.control.detection.detector import DetectorOptions, RecordingDetector
from omnimj.control.detection.published.decision import layout_mismatch, select_thresholds
from omnimj.control.detection.published.rig import PublishedRigDetector
from omnimj.control.detection.published.robot import PublishedRobotDetector
from omnimj.control.detection.robust import ObserverGains, RobustDetector
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Floor, Rig, Robot
from omnimj.simulate.scenario import checks
from omnimj.simulate.scenario.scenario import Scenario

METHODS = checks.METHODS
"""Diagnosis methods: the robust one for missions, the published one, and none."""

RIG_METHODS = ("published", "off")
"""Methods for the test rig; its single wheel offers no redundancy to the robust method."""


def require_known_method(method: str) -> None:
    """Refuse an unknown method.

    Raises:
      UnknownNameError: No such method; the message lists the choices.
    """
    if method not in METHODS:
        raise UnknownNameError("--method", "method", method, METHODS)


def available_methods(scenario: Scenario) -> tuple[str, ...]:
    """Methods available for a scenario, the default one first.

    There is no diagnosis at the kinematic level, and the published method is for one layout of wheels.
    """
    if scenario.level == "kinematic":
        return ("off",)
    if scenario.is_rig:
        return RIG_METHODS
    fits = not layout_mismatch(scenario.robot)
    return tuple(name for name in METHODS if fits or name != "published")


def default_method(scenario: Scenario) -> str:
    """Method used when the user chooses none."""
    return available_methods(scenario)[0]


@dataclass(frozen=True)
class DetectorConfig:
    """Nominal machine and floor that a detector assumes, and its options."""

    machine: Robot | Rig
    """Constants of the model file; its effects are ignored."""
    floor: Floor
    """Floor that the published method assumes."""
    mass: float | None = None
    """Mass of the loaded rig [kg]; the first of its masses when None."""
    choice: DetectorOptions = field(default_factory=DetectorOptions)
    """Options of the `[diagnosis]` table."""
    thresholds: Thresholds | None = None
    """Thresholds of the robust method; the shipped ones when None."""
    observer: ObserverGains | None = None
    """Observer gains of the robust method; the shipped ones when None."""
    expected_floor: Floor | None = None
    """Floor that the robust method expects; None: it knows nothing of the floor."""


def make_detector(
    name: str, scenario: Scenario, thresholds: Thresholds | None = None
) -> RecordingDetector | None:
    """Make the detector of a method for the robot or rig of a scenario; None for `off`.

    The detector assumes the constants of the model file, without faults. The published method assumes the
    scenario's floor without patches, the robust one that which `[diagnosis]` states, or `drive.creep_floor`.

    Args:
      name: One of `METHODS`.
      scenario: Scenario, whose `[diagnosis]` table holds the method's options.
      thresholds: Thresholds of the robust method; the shipped ones when None.

    Raises:
      UnknownNameError: No such method.
      InputError: A robot that does not suit the method, or thresholds of another method.
    """
    mass = scenario.rig_input.mass if scenario.is_rig else None
    floor = scenario.floors[scenario.floor]
    observer = None if scenario.gains is None else scenario.gains.observer
    return detector_for(
        name,
        DetectorConfig(
            scenario.constants,
            floor,
            mass,
            scenario.diagnosis,
            thresholds,
            observer,
            scenario.expected_floor,
        ),
    )


def detector_for(name: str, config: DetectorConfig) -> RecordingDetector | None:
    """Make the detector of a method for a machine, with or without a scenario; None for `off`.

    Raises:
      UnknownNameError: No such method.
      InputError: A machine that does not suit the method, or thresholds of another method.
    """
    require_known_method(name)
    if config.thresholds is not None and name != "robust":
        raise InputError("--thresholds", f"the method is {name!r}", "they are those of 'robust'")
    return None if name == "off" else _detector(config.machine, name, config)


@functools.singledispatch
def _detector(machine: Robot, name: str, config: DetectorConfig) -> RecordingDetector:
    if name == "robust":
        return RobustDetector(
            machine, thresholds=config.thresholds, gains=config.observer, floor=config.expected_floor
        )
    return PublishedRobotDetector(machine, config.floor, select_thresholds(config.choice), config.choice)


@_detector.register
def _(machine: Rig, name: str, config: DetectorConfig) -> RecordingDetector:
    if name == "robust":
        raise InputError("--method", f"found {name!r}", "the rig has one wheel", RIG_METHODS)
    limits = select_thresholds(config.choice)
    return PublishedRigDetector(machine, config.floor, config.mass, limits, config.choice)
