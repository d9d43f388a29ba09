"""Descriptions of runs in words: faults, diagnoses, recovery, and the command that repeats a run."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from omnimj.control.recovery.modes import MODE_CONSEQUENCES, MODE_NAMES, NORMAL, PIVOTING, indispensable
from omnimj.control.robot_constants import robot_constants
from omnimj.parameters import Rig, Robot
from omnimj.signals import Trace, equal_stretches

if TYPE_CHECKING:
    from omnimj.simulate.scenario.scenario import Scenario

FAULT_NAMES: Mapping[str, str] = {
    "motor": "motor loss",
    "free": "motor free",
    "locked": "wheel locked",
    "hard_over": "motor runs away",
    "slip": "slip",
    "all_wheel_slip": "all wheels slip",
    "misalignment": "axle misaligned",
    "wheel_radius": "wheel radius off",
    "payload": "payload",
    "slope": "slope",
    "sensor": "sensor",
    "demand_lost": "demand lost",
}
UNITS: Mapping[str, str] = {
    "braking_torque": "N·m",
    "current": "A",
    "angle": "rad",
    "direction": "rad",
    "mass": "kg",
    "x": "m",
    "y": "m",
}
DETECTOR_MODE_NAMES: Mapping[str, tuple[str, ...]] = {
    "robust": ("healthy", "suspect", "faulty", "cannot judge"),
    "published": ("no fault", "slip", "torque constant is estimated", "torque constant was estimated"),
    "published on the rig": ("no fault", "slip", "motor fault"),
}
"""Names of the modes by method; the column `mode` holds their index."""
RECOVERY = "recovery"
"""Name of the lane of recovery actions."""
NOT_DIAGNOSED = "off"
"""Name of the method of a run without fault detection."""
_COUNTS = {3: "three", 4: "four", 5: "five", 6: "six"}
_PLACE = ("kind", "wheel", "wheels", "onset", "end")


@dataclass(frozen=True)
class Span:
    """Fault or diagnosis with its interval."""

    label: str
    """Label such as `slip, wheel 2`."""
    lane: str
    """Affected part: `wheel_2`, or `robot`."""
    state: str
    """Label without the wheel: `slip`."""
    start: float
    """Start [s]."""
    end: float
    """End [s]."""


def fault_spans(metrics: Mapping[str, Any], duration: float) -> list[Span]:
    """Convert the faults of `metrics.json` to intervals within the run, [0, duration] [s]."""
    spans = []
    for fault in metrics.get("faults") or ():
        end = fault.get("end")
        start, end = max(float(fault["onset"]), 0.0), duration if end is None else min(float(end), duration)
        if start < end:
            spans.append(_span(fault["kind"], fault.get("wheel"), _state(fault), start, end))
    return spans


def diagnosis_spans(metrics: Mapping[str, Any], duration: float) -> list[Span]:
    """Convert the diagnoses of `metrics.json` to one interval per diagnosis and wheel."""
    spans: list[Span] = []
    for diagnosis in metrics.get("diagnoses") or ():
        cleared = diagnosis.get("cleared")
        # `cleared` is the time at which the diagnosis was cleared; otherwise it still holds
        stands = isinstance(cleared, bool) or not isinstance(cleared, int | float)
        end = duration if stands else min(float(cleared), duration)
        state = FAULT_NAMES.get(diagnosis["kind"], diagnosis["kind"])
        if diagnosis.get("channel"):
            state = f"{state} {diagnosis['channel']}".replace("_", " ")
        wheels = diagnosis.get("wheels") or (None,)
        spans += [_span(diagnosis["kind"], wheel, state, float(diagnosis["time"]), end) for wheel in wheels]
    return spans


def recovery_spans(trace: Trace) -> list[Span]:
    """Convert the column `recovery` to intervals of each mode other than normal driving."""
    if "recovery" not in trace:
        return []
    mode, time = trace["recovery"].astype(int), trace["time"]
    starts = equal_stretches(mode)
    ends = np.append(time[starts[1:]], time[-1])
    names = [
        MODE_NAMES[value] if 0 <= value < len(MODE_NAMES) else f"recovery {value}" for value in mode[starts]
    ]
    return [
        Span(name, RECOVERY, name, float(time[start]), float(end))
        for name, start, end in zip(names, starts, ends, strict=True)
        if name != MODE_NAMES[NORMAL]
    ]


def _span(kind: str, wheel: int | None, state: str, start: float, end: float) -> Span:
    name = FAULT_NAMES.get(kind, kind)
    if wheel is None:
        return Span(state if kind == "sensor" else name, "robot", state, start, end)
    return Span(f"{name}, wheel {wheel}", f"wheel_{wheel}", state, start, end)


def _state(fault: Mapping[str, Any]) -> str:
    name = FAULT_NAMES.get(fault["kind"], fault["kind"])
    if fault["kind"] == "sensor":
        return f"{fault.get('channel', '?')} {fault.get('mode', '?')}".replace("_", " ")
    return name


def is_diagnosed(metrics: Mapping[str, Any]) -> bool:
    """Check that a fault-detection method was active in a run."""
    return metrics.get("method", NOT_DIAGNOSED) != NOT_DIAGNOSED


def mode_name(method: str, is_rig: bool, mode: int) -> str:
    """Return the meaning of a number in the column `mode`."""
    names = DETECTOR_MODE_NAMES.get(f"{method} on the rig" if is_rig else method) or DETECTOR_MODE_NAMES.get(
        method, ()
    )
    return names[mode] if 0 <= mode < len(names) else f"mode {mode}"


def fault_name(record: Mapping[str, Any]) -> str:
    """Name a fault or a diagnosis: `motor loss, wheel 1`, `slip, wheels 1, 3`, `sensor yaw rate`."""
    kind = FAULT_NAMES.get(record["kind"], str(record["kind"]))
    if record.get("channel"):
        return f"{kind} {str(record['channel']).replace('_', ' ')}"
    wheels = record.get("wheels") or ((record["wheel"],) if record.get("wheel") is not None else ())
    if not wheels:
        return kind
    return f"{kind}, wheel{'s' if len(wheels) > 1 else ''} {', '.join(str(wheel) for wheel in wheels)}"


def ambiguity_name(text: str) -> str:
    """Name an entry of `ambiguous_with`: `motor 3` becomes `motor loss, wheel 3`."""
    kind, _, place = text.partition(" ")
    if place.isdecimal():
        return fault_name({"kind": kind, "wheel": int(place)})
    return fault_name({"kind": kind, "channel": place})


def fault_details(fault: Mapping[str, Any]) -> str:
    """Format the numbers of a fault: `loss 57 %`, `grip 0.3`, `braking torque 0.02 N·m`."""
    words = []
    for key, value in fault.items():
        if key in _PLACE or value is None:
            continue
        if key == "loss":
            words.append(f"loss {100.0 * value:g} %")
        elif isinstance(value, float | int) and not isinstance(value, bool):
            words.append(f"{key.replace('_', ' ')} {value:.4g} {UNITS.get(key, '')}".rstrip())
        else:
            words.append(f"{key.replace('_', ' ')} {value}")
    return ", ".join(words)


def number(value: object, digits: int = 4) -> str:
    """Format a number for a table; a dash for None."""
    if value is None:
        return "–"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if math.isnan(value):
        return "not a number"
    return f"{value:.{digits}g}"


def percent(ratio: float) -> str:
    """Format a ratio in percent; a dash where it is not finite."""
    return f"{100.0 * ratio:.3g} %" if math.isfinite(ratio) else "–"


def measure(value: object, unit: str) -> str:
    """Format a number with its unit, an angle also in degrees as in plots."""
    if value is None:
        return number(None)
    shown = f"{number(value)} {unit}".strip()
    if unit == "rad" and isinstance(value, int | float) and not isinstance(value, bool):
        return f"{shown} ({number(math.degrees(value), 3)}°)"
    return shown


def title(metrics: Mapping[str, Any]) -> str:
    """Return the title of a run: `nylon_patch` becomes `Nylon patch`."""
    return str(metrics.get("scenario", "run")).replace("_", " ").capitalize()


def repeat_command(scenario: Scenario, metrics: Mapping[str, Any]) -> str:
    """Return the command line that repeats the run."""
    if metrics.get("command"):
        return str(metrics["command"])
    words = ["omnimj", "run", str(metrics.get("scenario", "SCENARIO"))]
    plant = str(metrics.get("plant", "twin"))
    if plant not in (scenario.plant, "twin"):  # the twin is the default
        words += ["--plant", plant]
    for key in ("method", "seed"):
        if metrics.get(key) is not None:
            words += [f"--{key}", str(metrics[key])]
    for pair in scenario.overrides:
        words += ["--set", pair]
    return shlex.join([*words, "--out", "OUT"])


@dataclass(frozen=True)
class RecoveryPeriod:
    """Recovery mode with the intervals in which it was active."""

    name: str
    """Name of the mode, such as `turning about wheel 2`."""
    spans: tuple[Span, ...]
    """Intervals of the mode in order of time."""
    consequence: str
    """Degrees of freedom left uncontrolled in this mode."""

    @property
    def duration(self) -> float:
        """Total duration [s]."""
        return sum(span.end - span.start for span in self.spans)

    @property
    def when(self) -> str:
        """Interval as `0.85 – 4.5 s`, or for several also their number and total duration."""
        first, last = self.spans[0].start, self.spans[-1].end
        words = f"{first:.3g} – {last:.3g} s"
        if len(self.spans) == 1:
            return words
        return f"{words}, {len(self.spans)} times, {self.duration:.3g} s in all"


def recovery_periods(trace: Trace, metrics: Mapping[str, Any]) -> list[RecoveryPeriod]:
    """Return the recovery modes of a run in the order of their first use, without normal driving."""
    found: dict[tuple[str, str], list[Span]] = {}
    sentences: dict[str, str] = dict(zip(MODE_NAMES, MODE_CONSEQUENCES, strict=True))
    for span in recovery_spans(trace):
        name, consequence = span.state, sentences.get(span.state, "")
        if span.state == MODE_NAMES[PIVOTING]:
            wheel = _pivot_wheel(trace, metrics, span)
            name = span.state if wheel is None else f"turning about wheel {wheel}"
        found.setdefault((name, consequence), []).append(span)
    return [RecoveryPeriod(name, tuple(spans), consequence) for (name, consequence), spans in found.items()]


def _pivot_wheel(trace: Trace, metrics: Mapping[str, Any], span: Span) -> int | None:
    """Return the wheel about which the robot turns, the slowest of those diagnosed as faulty."""
    rows = (trace["time"] >= span.start) & (trace["time"] <= span.end)
    broken = {
        int(wheel)
        for diagnosis in metrics.get("diagnoses") or ()
        if float(diagnosis["time"]) <= span.end
        for wheel in diagnosis.get("wheels") or ()
        if f"wheel_speed_{wheel}" in trace
    }
    if not broken or not rows.any():
        return None
    return min(broken, key=lambda wheel: float(np.abs(trace[f"wheel_speed_{wheel}"][rows]).mean()))


def describe_layout(constants: Robot | Rig) -> str:
    """Describe the wheels that a robot of this layout cannot lose; empty where any single wheel can be lost.

    The columns of B without wheel i must have rank 3 to produce any force and moment.
    """
    if isinstance(constants, Rig):
        return ""
    n, needed = len(constants.wheels), indispensable(robot_constants(constants).forces)
    if not needed:
        return ""
    if len(needed) == n:
        return f"{_COUNTS.get(n, str(n))} wheels need every wheel to control all three degrees of freedom"
    which = f"wheel{'s' if len(needed) > 1 else ''} {', '.join(map(str, needed))}"
    return f"without {which} it cannot control all three degrees of freedom"
