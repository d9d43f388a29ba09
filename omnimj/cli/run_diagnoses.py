"""What was diagnosed in a run, in a few lines for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omnimj.cli.terminal import format_table
from omnimj.parameters import Rig, Robot
from omnimj.signals import Trace
from omnimj.simulate.judging import DiagnosisGroup, FaultMatch, match_diagnoses
from omnimj.view.wording import (
    ambiguity_name,
    describe_layout,
    fault_details,
    fault_name,
    is_diagnosed,
    number,
    recovery_periods,
)

_MAX_ROWS = 12  # rows: a method that cries wolf must not push the checks off the screen


def format_diagnoses(metrics: Mapping[str, Any], wheels: int) -> str:
    """A table of truth and diagnosis, or a line; empty for a run without a method.

    Args:
      metrics: Content of `metrics.json`.
      wheels: Number of wheels of the plant.
    """
    if not is_diagnosed(metrics):
        return ""
    if not metrics.get("truth", True):
        return _format_without_truth(metrics)
    found = match_diagnoses(metrics["faults"], metrics["diagnoses"], wheels)
    if not found.pairs and not found.false_alarms:
        return "diagnosis: nothing was wrong, and nothing was diagnosed"
    if not metrics["diagnoses"]:
        wrong = "; ".join(_format_fault(one) for one in found.pairs)
        return f"diagnosis: nothing was diagnosed; true: {wrong}"
    rows = []
    for one in found.pairs:
        for k, naming in enumerate(one.groups or (None,)):
            rows.append((_format_fault(one) if k == 0 else "", *_format_naming(one, naming)))
    rows += [
        ("–", _format_diagnosis(naming), _format_time(naming), "false alarm") for naming in found.false_alarms
    ]
    left = len(rows) - _MAX_ROWS
    lines = [format_table(("true fault", "diagnosed", "at", "delay"), rows[:_MAX_ROWS])]
    if left > 0:
        lines.append(f"and {left} more, in metrics.json")
    return "\n".join(lines)


def format_recovery(trace: Trace, metrics: Mapping[str, Any], constants: Robot | Rig) -> str:
    """What recovery did, when, and what cannot be held then; empty for a run as planned."""
    ways = recovery_periods(trace, metrics)
    if not ways:
        return ""
    lines = [
        format_table(("recovery", "when", "consequence"), [(w.name, w.when, w.consequence) for w in ways])
    ]
    limits = describe_layout(constants)
    return "\n".join([*lines, *([limits] if limits else [])])


def _format_without_truth(metrics: Mapping[str, Any]) -> str:
    """What was diagnosed where nobody knows what was wrong."""
    expected = len(metrics["scenario_faults"])
    note = f"the scenario's file has {expected} of its own, true only if the device runs it too"
    words = "diagnosis: nobody knows the faults of a robot behind a wire" + (f"; {note}" if expected else "")
    found = match_diagnoses((), metrics["diagnoses"], 1).false_alarms
    if not found:
        return f"{words}\nnothing was diagnosed"
    lines = [
        words,
        format_table(
            ("diagnosed", "at"), [(_format_diagnosis(one), _format_time(one)) for one in found[:_MAX_ROWS]]
        ),
    ]
    if len(found) > _MAX_ROWS:
        lines.append(f"and {len(found) - _MAX_ROWS} more, in metrics.json")
    return "\n".join(lines)


def _format_fault(one: FaultMatch) -> str:
    fault = one.fault
    details = fault_details({key: value for key, value in fault.items() if key != "channel"})
    onset = "never" if fault["onset"] is None else f"from {fault['onset']:g} s"
    return f"{fault_name(fault)}{f' ({details})' if details else ''} {onset}"


def _format_naming(one: FaultMatch, naming: DiagnosisGroup | None) -> tuple[str, str, str]:
    if naming is None:
        return ("nothing" if one.is_diagnosable else "no name for it"), "–", "–"
    return _format_diagnosis(naming), _format_time(naming), f"{number(naming.delay, 3)} s"


def _format_diagnosis(naming: DiagnosisGroup) -> str:
    times = len(naming.diagnoses)
    also = " or ".join(ambiguity_name(text) for text in naming.last.get("ambiguous_with") or ())
    name = fault_name(naming.last) + (f" or {also}" if also else "")
    return f"{name} ({times} times)" if times > 1 else name


def _format_time(naming: DiagnosisGroup) -> str:
    return f"{naming.first['time']:.3f} s"
