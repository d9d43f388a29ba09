"""Summary of a run for the terminal: checks, diagnoses beside the truth, recovery, comparison, link."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from omnimj.cli.terminal import format_table, format_value
from omnimj.parameters import Rig, Robot
from omnimj.resources import model_display_name
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

if TYPE_CHECKING:
    from omnimj.simulate.run import RunResult


def format_comparison(units: dict[str, str], metrics: dict[str, Any]) -> str:
    """Format a table of all methods side by side; empty if there is only one."""
    from omnimj.view.comparison import compare

    if not metrics.get("compared"):
        return ""
    comparison = compare(units, metrics)
    return format_table(("", *comparison.names), comparison.rows)


_MAX_ROWS = 12  # rows of diagnoses, so that many false alarms do not push the checks off the screen
_RESULTS = ("path_error_max", "tracking_error_max", "max_yaw_excursion", "final_speed", "travel")


def _verdict(checks: Sequence[Mapping[str, Any]]) -> str:
    unjudged = sum(not check.get("judged", True) for check in checks)
    if not checks:
        return "not judged: there is nothing to check"
    failed = sum(not check["ok"] for check in checks) - unjudged
    beside = f"; {unjudged} not judged, since the true state is unknown" if unjudged else ""
    if failed:
        return f"failed: {failed} of {len(checks)} checks{beside}"
    if unjudged == len(checks) > 0:
        return f"not judged: all {unjudged} checks need the true state, which is unknown"
    return f"passed{beside}"


def _format_results(metrics: Mapping[str, Any], units: Mapping[str, str]) -> str:
    """Format the main results of a run without checks."""
    found = [
        (name, format_value(metrics[name], units[name])) for name in _RESULTS if metrics.get(name) is not None
    ]
    return "\n".join(("no checks", *([format_table(("result", "value"), found)] if found else [])))


def format_run(finished: RunResult) -> str:
    """Format scenario, table of checks, diagnoses and verdict of a run for the terminal."""
    metrics, units = finished.metrics, finished.scenario.metric_units
    scenario = finished.scenario
    set_ = f", with {', '.join(scenario.overrides)}" if scenario.overrides else ""
    lines = [
        f"{metrics['scenario']}: {scenario.description}{set_}",
        f"{model_display_name(scenario.constants.file)} on {metrics['floor']}, plant {metrics['plant']}, "
        f"method {metrics['method']}, seed {metrics['seed']}, "
        f"{metrics['duration']:g} s at {metrics['realtime_factor']:.3g} × real time",
        "",
    ]
    rows = []
    for check in metrics["checks"]:
        unit, sign = units[check["name"]], "≥" if check["bound"] == "min" else "≤"
        limit = f"{sign} {format_value(check['limit'], unit)}"
        verdict = "ok" if check["ok"] else "FAILED" if check.get("judged", True) else "not judged"
        rows.append((check["name"], format_value(check["value"], unit), limit, verdict))
    lines.append(
        format_table(("check", "value", "limit", ""), rows) if rows else _format_results(metrics, units)
    )
    diagnosed = format_diagnoses(metrics, len(finished.scenario.wheel_positions))
    recovery = format_recovery(finished.trace, metrics, finished.scenario.constants)
    comparison = format_comparison(units, metrics)
    link = format_link(metrics["link"]) if "link" in metrics else ""
    lines += [f"\n{words}" for words in (diagnosed, recovery, comparison, link) if words]
    verdict = "interrupted" if finished.interrupted else _verdict(metrics["checks"])
    return "\n".join([*lines, "", verdict])


def format_diagnoses(metrics: Mapping[str, Any], wheels: int) -> str:
    """Format a table of true faults and diagnoses, or one line; empty for a run without fault detection."""
    if not is_diagnosed(metrics):
        return ""
    if not metrics.get("truth", True):
        return _format_without_truth(metrics)
    found = match_diagnoses(metrics["faults"], metrics["diagnoses"], wheels)
    if not found.pairs and not found.false_alarms:
        return "diagnosis: no fault, and none was diagnosed"
    if not metrics["diagnoses"]:
        wrong = "; ".join(_format_fault(one) for one in found.pairs)
        return f"diagnosis: none; true faults: {wrong}"
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
    """Format a table of recovery modes, their times and sacrificed degrees of freedom; empty without any."""
    ways = recovery_periods(trace, metrics)
    if not ways:
        return ""
    lines = [
        format_table(("recovery", "when", "consequence"), [(w.name, w.when, w.consequence) for w in ways])
    ]
    limits = describe_layout(constants)
    return "\n".join([*lines, *([limits] if limits else [])])


def _format_without_truth(metrics: Mapping[str, Any]) -> str:
    """Format the diagnoses of a robot whose true faults are unknown."""
    words = "diagnosis: the true faults of a robot behind a wire are unknown"
    if metrics["scenario_faults"]:
        words += "; those in the scenario file apply only if the device simulates them"
    found = match_diagnoses((), metrics["diagnoses"], 1).false_alarms
    if not found:
        return f"{words}\nno fault was diagnosed"
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
        return ("nothing" if one.is_diagnosable else "not diagnosable"), "–", "–"
    return _format_diagnosis(naming), _format_time(naming), f"{number(naming.delay, 3)} s"


def _format_diagnosis(naming: DiagnosisGroup) -> str:
    times = len(naming.diagnoses)
    also = " or ".join(ambiguity_name(text) for text in naming.last.get("ambiguous_with") or ())
    name = fault_name(naming.last) + (f" or {also}" if also else "")
    return f"{name} ({times} times)" if times > 1 else name


def _format_time(naming: DiagnosisGroup) -> str:
    return f"{naming.first['time']:.3f} s"


def format_link(link: Mapping[str, Any]) -> str:
    """Format a summary of the entry `link` in `metrics.json`."""
    kept, keyed = link["deadlines"], ", keyed" if link["is_keyed"] else ""
    lines = [
        f"link: {link['address']}, {link['mode']}{keyed}; {link['sent']} frames "
        f"sent, {link['received']} received, {link['lost']} lost, {link['dropped']} dropped; "
        f"the device dropped {link['device_dropped']} and refused {link['device_refused']}"
    ]
    if link["mode"] == "lock-step":
        return f"{lines[0]}; {link['resent']} requested again"
    lines.append(
        f"deadlines: {kept['missed']} of {kept['periods']} missed, "
        f"{kept['held']} readings late, {kept['skipped']} skipped"
    )
    words = {
        "response": "command after reading",
        "late": "delay of the reading",
        "command_age": "age of the command",
    }
    spreads = (f"{words[name]} {_format_spread(kept[name])}" for name in words if kept[name]["max"] > 0.0)
    lines.append("; ".join(spreads) + " (p50 / p99 / max)")
    return "\n".join(lines)


def _format_spread(record: Mapping[str, float]) -> str:
    return " / ".join(f"{1e3 * record[name]:.3g}" for name in ("p50", "p99", "max")) + " ms"
