"""Which way to diagnose a run."""

from __future__ import annotations

from dataclasses import dataclass, field

from omnimj.control.detection.detector import DetectorOptions, FaultDetector
from omnimj.control.detection.published.decision import layout_mismatch, select_thresholds
from omnimj.control.detection.published.rig import PublishedRigDetector
from omnimj.control.detection.published.robot import PublishedRobotDetector
from omnimj.control.detection.robust import ObserverGains, RobustDetector
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Floor, Rig, Robot
from omnimj.simulate.scenario import checks
from omnimj.simulate.scenario.scenario import RigInput, Scenario

METHODS = checks.METHODS
"""Ways to diagnose: on missions, as published, not at all."""

RIG_METHODS = ("published", "off")
"""The same on the test rig, whose one wheel leaves nothing to decouple."""


def require_known_method(method: str) -> None:
    """Refuses what this version cannot do.

    Raises:
      UnknownNameError: A method that this version does not have.
    """
    if method not in METHODS:
        raise UnknownNameError("--method", "method", method, METHODS)


def available_methods(scenario: Scenario) -> tuple[str, ...]:
    """The methods that a scenario can be driven with; nothing is diagnosed at the kinematic level.

    The published method is for one layout of wheels.
    """
    if scenario.level == "kinematic":
        return ("off",)
    if isinstance(scenario.constants, Rig):
        return RIG_METHODS
    fits = not layout_mismatch(scenario.constants)
    return tuple(name for name in METHODS if fits or name != "published")


def default_method(scenario: Scenario) -> str:
    """The method of a run that asks for none."""
    return available_methods(scenario)[0]


@dataclass(frozen=True)
class DetectorConfig:
    """What a method is told of the machine: nothing of patches and faults."""

    machine: Robot | Rig
    """Constants of the model file; its effects are left out."""
    floor: Floor
    mass: float | None = None
    """That the rig was loaded to [kg]; the first of its masses when None."""
    choice: DetectorOptions = field(default_factory=DetectorOptions)
    """The form of the published method."""
    thresholds: Thresholds | None = None
    """Of the robust method; the shipped ones when None."""
    observer: ObserverGains | None = None
    """Of the robust method; as shipped when None."""


def make_detector(
    name: str, scenario: Scenario, thresholds: Thresholds | None = None
) -> FaultDetector | None:
    """The method of that name for the robot or rig of a scenario; None for `off`.

    It believes in the constants of the model file and in the scenario's floor; of patches and faults it knows
    nothing.

    Args:
      name: Of `METHODS`.
      scenario: Its `[diagnosis]` table chooses the method's form.
      thresholds: Of the robust method; the shipped ones when None.

    Raises:
      UnknownNameError: A method that this version does not have.
      InputError: A robot that the method is not for, or thresholds for another method.
    """
    mass = scenario.drive.mass if isinstance(scenario.drive, RigInput) else None
    floor = scenario.floors[scenario.floor]
    observer = None if scenario.gains is None else scenario.gains.observer
    return detector_for(
        name, DetectorConfig(scenario.constants, floor, mass, scenario.diagnosis, thresholds, observer)
    )


def detector_for(name: str, believed: DetectorConfig) -> FaultDetector | None:
    """The method of that name for a machine, with or without a scenario; None for `off`.

    Raises:
      UnknownNameError: A method that this version does not have.
      InputError: A machine that the method is not for, or thresholds for another method.
    """
    require_known_method(name)
    machine, floor, choice = believed.machine, believed.floor, believed.choice
    if believed.thresholds is not None and name != "robust":
        raise InputError("--thresholds", f"the method is {name!r}", "they are those of 'robust'")
    if name == "off":
        return None
    if name == "robust":
        if isinstance(machine, Rig):
            raise InputError("--method", f"found {name!r}", "the rig has one wheel", RIG_METHODS)
        return RobustDetector(machine, thresholds=believed.thresholds, gains=believed.observer)
    limits = select_thresholds(choice)
    if isinstance(machine, Rig):
        return PublishedRigDetector(machine, floor, believed.mass, limits, choice)
    return PublishedRobotDetector(machine, floor, limits, choice)
