"""What controller and method of a case believe: the nominal robot on the nominal floor, nothing wrong."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

from omnimj.errors import InputError
from omnimj.evaluation.cases import Case, reference_of
from omnimj.scenario.drive import Drive
from omnimj.scenario.overrides import split_override
from omnimj.scenario.scenario import Scenario, read_scenario

_PATTERN = "degraded_motor"  # any robot scenario at the physics level: what is a case's own is replaced
_SETTABLE = ("drive.yaw_loop", "drive.heading_hold", "drive.heading_feedback")


def check_settings(settings: Iterable[str]) -> None:
    """Whether these are settings of method or cascade, not of the cases.

    Raises:
      InputError: A text that is not KEY=VALUE, a key that is the cases' own, or a value that breaks its rule.
    """
    for text in settings:
        key = split_override(text)[0]
        if not key.startswith("diagnosis.") and key not in _SETTABLE:
            rule = "cases are drawn; settings are those of the method and of the cascade's loops"
            raise InputError(f"--set {key}", "is none of them", rule, ("diagnosis.…", *_SETTABLE))
    read_scenario(_PATTERN, ("faults=[]", "checks={}", *settings))


def believed(case: Case, settings: Iterable[str] = ()) -> Scenario:
    """The case as a scenario without any fault.

    Args:
      case: Its errors and faults are left out.
      settings: `KEY=VALUE` texts for method and cascade, as `check_settings` allows them.
    """
    healthy = ("faults=[]", "checks={}", f"floor={case.floor}", f"duration={case.duration!r}")
    scenario = read_scenario(_PATTERN, (*healthy, *settings))
    assert isinstance(scenario.drive, Drive)
    drive = dataclasses.replace(
        scenario.drive, reference=reference_of(case, scenario.period), start=(0.0, 0.0, 0.0)
    )
    return dataclasses.replace(scenario, name=case.name, description=case.suite, drive=drive)
