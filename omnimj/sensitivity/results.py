"""What a run of a scenario amounts to, as numbers that can be compared between runs."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.scenario.metrics import DIAGNOSIS_UNITS
from omnimj.scenario.running import Run
from omnimj.scenario.scenario import Scenario
from omnimj.signals import KINDS_OF_DIAGNOSIS

RESOLUTION: Mapping[str, float] = MappingProxyType(
    {"m": 1e-3, "m/s": 1e-3, "rad": 1e-3, "A": 1e-3, "s": 1e-3}
)
"""Changes below it, by unit, are nothing that a robot's sensors or a check could tell: a millimetre, a
milliradian (the heading converter has steps of 1.5), a milliampere (the monitor: 2.4), one control period."""

_PLACE = {"final_x": "m", "final_y": "m", "final_heading": "rad"}
_OF_ONE_WHEEL = re.compile(r".*_\d+")


def result_units(scenario: Scenario, method: str) -> dict[str, str]:
    """The results of a scenario and their units.

    The metrics of `metrics.json`, of single wheels those alone that the scenario's checks ask for; where it
    ends; rms of the slip over time and wheels. Without a method there is nothing to say of diagnoses.
    """
    asked = {check.name for check in scenario.checks}
    single = len(scenario.wheel_positions) == 1
    units = {
        name: unit
        for name, unit in scenario.metric_units.items()
        if (single or name in asked or not _OF_ONE_WHEEL.fullmatch(name))
        and (method != "off" or name not in DIAGNOSIS_UNITS)
    }
    units["rms_slip"] = "m/s"
    return units if single else {**units, **_PLACE}


def results_of(run: Run, units: Mapping[str, str]) -> dict[str, float | None]:
    """The results of a run; None for one that it does not have.

    A fault that was never noticed has a delay until the end of the run: less than it is, and finite.

    Args:
      run: That came to its end.
      units: From `result_units`.
    """
    metrics, trace = run.metrics, run.trace
    found: dict[str, Any] = {name: metrics.get(name) for name in units}
    if "detection_delay" in units:
        found["detection_delay"] = _delay(metrics)
    if "slip_velocity_1" in trace:
        found["rms_slip"] = np.sqrt(np.mean(np.square(trace.wheels("slip_velocity"))))
    if "heading" in trace:
        last = (trace["x"][-1], trace["y"][-1], np.unwrap(trace["heading"])[-1])
        found |= dict(zip(_PLACE, last, strict=True))
    return {name: _number(found.get(name)) for name in units}


def _delay(metrics: Mapping[str, Any]) -> float | None:
    if metrics["detection_delay"] is not None:
        return metrics["detection_delay"]
    onsets = [fault["onset"] for fault in metrics["faults"] if fault["kind"] in KINDS_OF_DIAGNOSIS]
    return metrics["duration"] - min(onsets) if onsets else None


def _number(value: Any) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)
