"""The same scenario with the other methods, for `omnimj run --compare`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from omnimj.cli.progress import ProgressBar
from omnimj.cli.tables import table
from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.scenario.running import Run
    from omnimj.scenario.scenario import Scenario


def methods_beside(scenario: Scenario, method: str) -> tuple[str, ...]:
    """The methods that a run with `method` can be compared with.

    Raises:
      InputError: There is none, or one of them is not for this robot; told before anything is driven.
    """
    from omnimj.scenario.methods import make_method, methods_of

    others = tuple(name for name in methods_of(scenario) if name != method)
    if not others:
        rule = f"{scenario.name} is at the kinematic level, where there is nothing to diagnose from"
        raise InputError("--compare", "there is no other method", rule)
    for name in others:
        make_method(name, scenario)
    return others


@dataclass(frozen=True)
class Beside:
    """What was driven for comparison."""

    runs: dict[str, Run] = field(default_factory=dict)
    """Those of two rows or more, by method."""
    failures: dict[str, str] = field(default_factory=dict)
    """When and how a run broke down, by method."""
    interrupted: bool = False
    """Whether Ctrl-C ended the last one; those before it are whole."""


def drive_beside(scenario: Scenario, plant: str | None, methods: tuple[str, ...], seed: int) -> Beside:
    """Drives the scenario once with each method.

    Args:
      scenario: What was asked for.
      plant: As for `run_scenario`.
      methods: From `methods_beside`.
      seed: The same for all.
    """
    from omnimj.scenario.running import run_scenario

    runs: dict[str, Run] = {}
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
                return Beside(runs, failures, True)
    except KeyboardInterrupt:  # between two runs: what was driven is kept
        return Beside(runs, failures, True)
    return Beside(runs, failures)


def _phase(bar: ProgressBar, method: str) -> Any:
    def show(done: int, total: int) -> None:
        bar.show(done, total, f"method {method}")

    return show


def metrics_beside(beside: Beside) -> dict[str, Any]:
    """Content of `compared` in `metrics.json`."""
    return {
        method: {**run.metrics, "failure": beside.failures.get(method)} for method, run in beside.runs.items()
    }


def say_failures(beside: Beside) -> None:
    """One line on stderr for each run that broke down."""
    for method, failure in beside.failures.items():
        print(f"omnimj: method {method}: {failure}", file=sys.stderr)


def told_comparison(units: dict[str, str], metrics: dict[str, Any]) -> str:
    """The methods side by side; empty when there is only one."""
    from omnimj.view.compared import compare

    if not metrics.get("compared"):
        return ""
    comparison = compare(units, metrics)
    return table(("", *comparison.methods), comparison.rows)
