"""Descriptions of runs in words: faults, diagnoses, recovery, and the command that repeats a run."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from omnimj.control.recovery.modes import MODE_CONSEQUENCES, MODE_NAMES, NORMAL, PIVOTING, indispensable
from omnimj.control.robot_constants import robot_constants
from omnimj.parameters import Rig, Robot
from omnimj.signals import Diagnosis, Trace, equal_stretches

if TYPE_CHECKING:
    from omnimj.diagnosis.replay import RunDiagnosis
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
FULL = 0.97
"""Effectiveness from which no torque of a motor is said to be missing: the tolerance of healthy ones."""
NOTHING_FOUND = "nothing found"
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
    """Return the recovery modes of a run in the order of their first use, without normal driving.

    Args:
      trace: Signals of the run.
      metrics: Content of `metrics.json`, for the diagnosed wheels.
    """
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
        return f"{_COUNTS.get(n, str(n))} wheels cannot lose one and be steered and turned at will"
    which = f"wheel{'s' if len(needed) > 1 else ''} {', '.join(map(str, needed))}"
    return f"it cannot lose {which} and be steered and turned at will"


def describe_diagnosis(diagnosis: Diagnosis) -> str:
    """Describe a diagnosis: `motor 2 is weak: 43 % left`."""
    d, wheels = diagnosis, ", ".join(str(wheel) for wheel in diagnosis.wheels)
    if d.kind == "motor":
        return _describe_motor(d, wheels)
    if d.kind == "sensor":
        return f"sensor {d.channel or wheels} is wrong"
    words = {
        "slip": f"wheel {wheels} slips",
        "locked": f"wheel {wheels} is locked",
        "free": f"motor {wheels} gives nothing",
        "hard_over": f"motor {wheels} runs away",
        "all_wheel_slip": "all wheels slip",
    }
    return words.get(d.kind, f"{d.kind.replace('_', ' ')} {wheels}".strip())


def _describe_motor(diagnosis: Diagnosis, wheels: str) -> str:
    left = diagnosis.effectiveness
    if diagnosis.ambiguous_with == (f"locked {wheels}",):
        return f"wheel {wheels} stands while its motor pushes"
    if diagnosis.test == "friction":
        return f"wheel {wheels} is braked"
    if left is not None and left >= FULL:
        return f"motor {wheels} seemed weak; no loss is left"
    return f"motor {wheels} is weak" + ("" if left is None else f": {100.0 * left:.0f} % left")


_STATISTICS: Mapping[str, tuple[str, str, float]] = {
    "loss": ("missing force", "nats", 1.0),
    "friction": ("added friction", "nats", 1.0),
    "learnt loss": ("loss learnt while driving", "%", 100.0),
    "accelerometer": ("jump of its bias", "nats", 1.0),
    "slip": ("slip distance", "mm", 1000.0),
    "current": ("set current not followed", "blocks", 1.0),
    "standing": ("standing against floor or motor", "blocks", 1.0),
    "readings": ("frozen or noisy readings", "", 1.0),
    "yaw rates": ("converter and gyro apart", "rad", 1.0),
    "wheel speed": ("speed that no slip explains", "blocks", 1.0),
}
"""Statistic of each test of the robust method, its unit, and the factor to it."""


def describe_evidence(diagnosis: Diagnosis) -> str:
    """Describe what decided: `missing force, 31 nats ≥ 23.5`; a dash where a method names no test."""
    if not diagnosis.test:
        return "–"
    words, unit, factor = _STATISTICS.get(diagnosis.test, (diagnosis.test, "", 1.0))
    if diagnosis.statistic is None or diagnosis.threshold is None:
        return words
    statistic, threshold = (f"{factor * x:.3g}" for x in (diagnosis.statistic, diagnosis.threshold))
    if statistic == threshold:
        statistic, threshold = (f"{factor * x:.4g}" for x in (diagnosis.statistic, diagnosis.threshold))
    return f"{words}, {statistic} {unit} ≥ {threshold}".replace("  ", " ")


def describe_time(diagnosis: Diagnosis) -> str:
    """Describe the interval of a diagnosis: `from 3.210 s`, or `3.210 … 4.000 s`."""
    if diagnosis.cleared is None:
        return f"from {diagnosis.time:.3f} s"
    return f"{diagnosis.time:.3f} … {diagnosis.cleared:.3f} s"


def describe_confidence(diagnosis: Diagnosis) -> str:
    """Describe the confidence in a diagnosis: `99 %`, with the alternatives."""
    others = f", or {', '.join(diagnosis.ambiguous_with)}" if diagnosis.ambiguous_with else ""
    return f"{100.0 * diagnosis.confidence:.0f} %{others}"


def describe_kind(diagnosis: Diagnosis) -> str:
    """Describe a diagnosis without its numbers, alike for several runs: `motor 2 is weak`."""
    return describe_diagnosis(diagnosis).partition(":")[0]


def severity(diagnosis: Diagnosis) -> float:
    """Rank a diagnosis, the worst first: what no longer drives, what drives less, sensors."""
    ranks = ("locked", "hard_over", "free", "motor", "all_wheel_slip", "slip", "sensor")
    rank = ranks.index(diagnosis.kind) if diagnosis.kind in ranks else len(ranks)
    left = diagnosis.effectiveness if diagnosis.kind == "motor" else 0.0
    left = None if diagnosis.test == "friction" else left  # says nothing of the friction
    return rank + min(max(0.5 if left is None else left, 0.0), 1.0) * 0.9


def describe_undiagnosed(run: RunDiagnosis) -> str:
    """Describe a run without a diagnosis."""
    return NOTHING_FOUND if run.judged > 0.0 else "no usable samples"


def describe_unjudged(run: RunDiagnosis) -> str:
    """Describe the total time without a possible diagnosis; empty if there was none."""
    if run.cannot_judge <= 0.0:
        return ""
    return f"cannot judge {run.cannot_judge:.1f} of {run.judged:.1f} s"


def summarize_runs(runs: Sequence[RunDiagnosis]) -> str:
    """Summarise the diagnoses of all runs in one sentence."""
    count = sum(len(run.diagnoses) for run in runs)
    many = f"{len(runs)} run{'s' if len(runs) != 1 else ''}"
    if not count:
        return f"{NOTHING_FOUND} in {many}"
    concerned = sum(bool(run.diagnoses) for run in runs)
    return f"{count} diagnos{'es' if count != 1 else 'is'} in {concerned} of {many}"
