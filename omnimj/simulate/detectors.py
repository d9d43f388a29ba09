"""Fault detectors by method: `robust`, `published` or `off`."""

from __future__ import annotations

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


def make_detector(
    name: str, scenario: Scenario, thresholds: Thresholds | None = None
) -> RecordingDetector | None:
    """Make the detector of a method for the robot or rig of a scenario; None for `off`.

    The detector assumes the constants of the model file, without faults. The published method assumes the
    scenario's floor without patches, the robust one
    `Scenario.expected_floor`.

    Args:
      name: One of `METHODS`.
      scenario: Scenario, whose `[diagnosis]` table holds the method's options.
      thresholds: Thresholds of the robust method; the shipped ones when None.

    Raises:
      UnknownNameError: No such method.
      InputError: A robot that does not suit the method, or thresholds of another method.
    """
    return detector_for(
        name,
        scenario.constants,
        scenario.floors[scenario.floor],
        mass=scenario.rig_input.mass if scenario.is_rig else None,
        choice=scenario.diagnosis,
        thresholds=thresholds,
        observer=None if scenario.gains is None else scenario.gains.observer,
        expected_floor=scenario.expected_floor,
    )


def detector_for(
    name: str,
    machine: Robot | Rig,
    floor: Floor,
    *,
    mass: float | None = None,
    choice: DetectorOptions | None = None,
    thresholds: Thresholds | None = None,
    observer: ObserverGains | None = None,
    expected_floor: Floor | None = None,
) -> RecordingDetector | None:
    """Make the detector of a method for a machine, with or without a scenario; None for `off`.

    Args:
      name: One of `METHODS`.
      machine: Nominal constants; its effects are ignored.
      floor: Floor that the published method assumes.
      mass: Mass of the loaded rig [kg]; the first of its masses when None.
      choice: Options of the `[diagnosis]` table; the usual ones when None.
      thresholds: Thresholds of the robust method; the shipped ones when None.
      observer: Observer gains of the robust method; the shipped ones when None.
      expected_floor: Floor that the robust method expects; None: it knows nothing of the floor.

    Raises:
      UnknownNameError: No such method.
      InputError: A machine that does not suit the method, or thresholds of another method.
    """
    require_known_method(name)
    if thresholds is not None and name != "robust":
        raise InputError("--thresholds", f"the method is {name!r}", "they are those of 'robust'")
    if name == "off":
        return None
    if name == "robust":
        if isinstance(machine, Rig):
            raise InputError("--method", f"found {name!r}", "the rig has one wheel", RIG_METHODS)
        return RobustDetector(machine, thresholds=thresholds, gains=observer, floor=expected_floor)
    choice = choice or DetectorOptions()
    limits = select_thresholds(choice)
    if isinstance(machine, Rig):
        return PublishedRigDetector(machine, floor, mass, limits, choice)
    return PublishedRobotDetector(machine, floor, limits, choice)
