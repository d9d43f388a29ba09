"""What a run comes to, in words for the terminal."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import format_link
from omnimj.cli.terminal import ProgressBar, format_table, format_value
from omnimj.errors import InputError
from omnimj.resources import model_display_name

# The same scenario with the other methods, for `omnimj run --compare`.

if TYPE_CHECKING:
    from omnimj.simulate.loop import Callbacks
    from omnimj.simulate.run import RunResult
    from omnimj.simulate.scenario.scenario import Scenario


def other_methods(scenario: Scenario, method: str) -> tuple[str, ...]:
    """The methods that a run with `method` can be compared with.

    Raises:
      InputError: There is none, or one of them is not for this robot; told before anything is driven.
    """
    from omnimj.simulate.detectors import available_methods, make_detector

    others = tuple(name for name in available_methods(scenario) if name != method)
    if not others:
        rule = f"{scenario.name} is at the kinematic level, where there is nothing to diagnose from"
        raise InputError("--compare", "there is no other method", rule)
    for name in others:
        make_detector(name, scenario)
    return others


@dataclass(frozen=True)
class Comparison:
    """What was driven for comparison."""

    runs: dict[str, RunResult] = field(default_factory=dict)
    """Those of two rows or more, by method."""
    failures: dict[str, str] = field(default_factory=dict)
    """When and how a run broke down, by method."""
    interrupted: bool = False
    """Whether Ctrl-C ended the last one; those before it are whole."""


def drive_comparison(
    scenario: Scenario, plant: str | None, methods: tuple[str, ...], seed: int
) -> Comparison:
    """Drives the scenario once with each method.

    Args:
      scenario: What was asked for.
      plant: As for `run_scenario`.
      methods: From `other_methods`.
      seed: The same for all.
    """
    from omnimj.simulate.run import run_scenario

    runs: dict[str, RunResult] = {}
    failures: dict[str, str] = {}
    try:
        for method in methods:
            with ProgressBar() as bar:
                run = run_scenario(scenario, plant, method, seed, _phase(bar, method))
            if run.metrics:
                runs[method] = run
            if run.trace.about["failure"]:
                failures[method] = run.trace.about["failure"]
            elif run.interrupted:
                return Comparison(runs, failures, True)
    except KeyboardInterrupt:  # between two runs: what was driven is kept
        return Comparison(runs, failures, True)
    return Comparison(runs, failures)


def _phase(bar: ProgressBar, method: str) -> Callbacks:
    from omnimj.simulate.loop import Callbacks

    def show(done: int, total: int) -> None:
        bar.show(done, total, f"method {method}")

    return Callbacks(progress=show)


def comparison_metrics(beside: Comparison) -> dict[str, Any]:
    """Content of `compared` in `metrics.json`."""
    return {
        method: {**run.metrics, "failure": beside.failures.get(method)} for method, run in beside.runs.items()
    }


def print_failures(beside: Comparison) -> None:
    """One line on stderr for each run that broke down."""
    for method, failure in beside.failures.items():
        print(f"omnimj: method {method}: {failure}", file=sys.stderr)


def format_comparison(units: dict[str, str], metrics: dict[str, Any]) -> str:
    """The methods side by side; empty when there is only one."""
    from omnimj.view.comparison import compare

    if not metrics.get("compared"):
        return ""
    comparison = compare(units, metrics)
    return format_table(("", *comparison.methods), comparison.rows)


if TYPE_CHECKING:
    from omnimj.simulate.loop import Callbacks
    from omnimj.simulate.run import RunResult

_RESULTS = ("path_error_max", "tracking_error_max", "max_yaw_excursion", "final_speed", "travel")


def _verdict(checks: Sequence[Mapping[str, Any]]) -> str:
    unjudged = sum(not check.get("judged", True) for check in checks)
    if not checks:
        return "not judged: there is nothing to check"
    failed = sum(not check["ok"] for check in checks) - unjudged
    beside = f"; {unjudged} not judged, since they need a truth that nobody knows" if unjudged else ""
    if failed:
        return f"failed: {failed} of {len(checks)} checks{beside}"
    if unjudged == len(checks) > 0:
        return f"not judged: all {unjudged} checks need a truth that nobody knows"
    return f"passed{beside}"


def _format_results(metrics: Mapping[str, Any], units: Mapping[str, str]) -> str:
    """What a run without checks comes to all the same."""
    found = [
        (name, format_value(metrics[name], units[name])) for name in _RESULTS if metrics.get(name) is not None
    ]
    return "\n".join(("no checks", *([format_table(("result", "value"), found)] if found else [])))


def format_run(finished: RunResult, out: Path | None) -> str:
    """What was driven, the table of checks, what was diagnosed, the verdict."""
    from omnimj.cli.run_diagnoses import format_diagnoses, format_recovery

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
    lines += [part for words in (diagnosed, recovery, comparison, link) if words for part in ("", words)] + [
        ""
    ]
    if finished.interrupted:
        lines.append("interrupted")
    else:
        lines.append(_verdict(metrics["checks"]))
    if out is not None:
        lines.append(f"written to {out}")
    return "\n".join(lines)
