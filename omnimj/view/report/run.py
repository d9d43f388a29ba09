"""`report.html` of a run: setup, checks, results, diagnosis, comparison of methods, and plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import omnimj
from omnimj.parameters import Rig, Robot
from omnimj.signals import Trace
from omnimj.simulate.scenario.scenario import Scenario
from omnimj.view import wording
from omnimj.view.comparison import compare
from omnimj.view.picture import Picture
from omnimj.view.plots import comparison as comparison_plots
from omnimj.view.plots import runs as plots
from omnimj.view.plots.thinning import window
from omnimj.view.report import page
from omnimj.view.report.page import Figure, Table, check_state, number, table
from omnimj.view.report.run_diagnosis import diagnosis_section
from omnimj.view.wording import Span, describe_layout, recovery_periods

_MOVES = 0.01  # [m/s] above which the gantry counts as moving


def write_report(
    path: Path,
    trace: Trace,
    scenario: Scenario,
    metrics: Mapping[str, Any],
    picture: Picture | None = None,
    others: Mapping[str, Trace] | None = None,
) -> None:
    """Write the report of a run from its signals and the content of `metrics.json`.

    `others` are traces of the same scenario by method, whose metrics are in `metrics["compared"]`.
    """
    spans = wording.fault_spans(metrics, float(trace["time"][-1]))
    is_diagnosed = wording.is_diagnosed(metrics)
    page.write_page(
        path,
        "run",
        f"{wording.title(metrics)} · omnimj",
        heading=wording.title(metrics),
        description=scenario.description,
        ended_early=_ended_early(metrics),
        verdict=run_verdict(metrics),
        picture=_picture(picture, metrics),
        missing_picture=picture.caption if picture and picture.path is None else "",
        setup=_setup(scenario, metrics),
        command=wording.repeat_command(scenario, metrics),
        checks=checks_table(scenario, metrics),
        results=_results(scenario, metrics),
        recovery=_recovery(trace, metrics),
        diagnosis=diagnosis_section(trace, scenario, metrics, spans) if is_diagnosed else None,
        faults=None if is_diagnosed else _faults(metrics),
        comparison=_comparison(scenario, metrics),
        comparison_figures=_comparison_figures(trace, others or {}, scenario, metrics, spans),
        method=metrics.get("method", "–"),
        is_rig=scenario.is_rig,
        figures=run_figures(trace, scenario, spans),
        compared_methods=list(metrics.get("compared") or ()),
    )


def run_verdict(metrics: Mapping[str, Any]) -> tuple[str, str]:
    """Return CSS class and text of the verdict over all checks."""
    checks = metrics.get("checks") or ()
    unjudged = sum(not check.get("judged", True) for check in checks)
    failed = sum(not check["ok"] for check in checks) - unjudged
    if not checks:
        return "plain", "No checks in this scenario"
    if failed:
        return "bad", f"✗ Failed: {failed} of {len(checks)} checks"
    if unjudged == len(checks):
        return "plain", "Not judged: every check needs the true state, which is unknown on hardware"
    if unjudged:
        words = f"{unjudged} of {len(checks)} checks need the true state, which is unknown; the others hold"
        return "plain", f"Not judged: {words}"
    holds = "the check holds" if len(checks) == 1 else f"all {len(checks)} checks hold"
    return "good", f"✓ Passed: {holds}"


def _ended_early(metrics: Mapping[str, Any]) -> str:
    """Return the reason for an early end of the run; empty for a complete run."""
    if not metrics.get("interrupted"):
        return ""
    return metrics.get("failure") or f"interrupted at {wording.number(metrics.get('duration'))} s"


def _picture(picture: Picture | None, metrics: Mapping[str, Any]) -> Figure | None:
    if picture is None or picture.path is None:
        return None
    label = f"{wording.title(metrics)}: {picture.subject}"
    return page.picture(picture.path, label, picture.subject.capitalize(), picture.caption)


def _setup(scenario: Scenario, metrics: Mapping[str, Any]) -> Table:
    floor = str(metrics.get("floor", scenario.floor)).replace("_", " ")
    if metrics.get("plant") == "kinematic":
        floor = "none: motion without forces"
    patches = [f"{p.floor.replace('_', ' ')} {p.size[0]:g} m × {p.size[1]:g} m" for p in scenario.patches]
    rows = [
        ("scenario", metrics.get("scenario", "–")),
        ("machine", scenario.plant.replace("_", " ")),
        *([] if scenario.is_rig else [_layout(scenario.robot)]),
        ("plant", metrics.get("plant", "–")),
        ("floor", floor + "".join(f"; patch of {patch}" for patch in patches)),
        ("method", metrics.get("method", "–")),
        ("seed", metrics.get("seed", "–")),
        ("duration", f"{wording.number(metrics.get('duration'))} s"),
        ("omnimj", omnimj.__version__),
    ]
    return table(rows)


def _layout(robot: Robot) -> tuple[str, str]:
    """Return the row on the number of wheels and the indispensable ones."""
    limits = describe_layout(robot)
    return "wheels", f"{len(robot.wheels)}{f': {limits}' if limits else ''}"


def checks_table(scenario: Scenario, metrics: Mapping[str, Any]) -> Table | None:
    """List the checks: result, value and bound; None for a run without any."""
    rows = []
    for check in metrics.get("checks") or ():
        unit, limit = scenario.metric_units.get(check["name"], ""), check.get("limit")
        sign = "≥" if check.get("bound") == "min" else "≤"
        rows.append(
            (
                check_state(bool(check["ok"]), bool(check.get("judged", True))),
                check["name"].replace("_", " "),
                number(wording.measure(check.get("value"), unit)),
                number("–" if limit is None else f"{sign} {wording.measure(limit, unit)}"),
            )
        )
    return table(rows, ("", "check", "value", "must be")) if rows else None


def _results(scenario: Scenario, metrics: Mapping[str, Any]) -> Table | None:
    judged = {check["name"] for check in metrics.get("checks") or ()}
    rows = []
    for key, unit in scenario.metric_units.items():
        value = metrics.get(key)
        if value is None or key in judged:
            continue
        shown = ("yes" if value else "no") if isinstance(value, bool) else wording.measure(value, unit)
        rows.append((key.replace("_", " "), number(shown)))
    speed = metrics.get("realtime_factor")
    if speed is not None:
        rows.append(("simulated at", number(f"{wording.number(speed, 3)} × real time")))
    return table(rows) if rows else None


def _recovery(trace: Trace, metrics: Mapping[str, Any]) -> Table | None:
    rows = [(period.name, period.when, period.consequence) for period in recovery_periods(trace, metrics)]
    return table(rows, ("recovery", "when", "consequence")) if rows else None


def _faults(metrics: Mapping[str, Any]) -> Table | None:
    rows = [
        (
            wording.FAULT_NAMES.get(fault["kind"], fault["kind"]),
            number(wording.number(fault.get("wheel"))),
            number(f"{fault['onset']:g} s"),
            number("end of run" if fault.get("end") is None else f"{fault['end']:g} s"),
            wording.fault_details(fault) or "–",
        )
        for fault in metrics.get("faults") or ()
    ]
    return table(rows, ("fault", "wheel", "from", "to", "size")) if rows else None


def _comparison(scenario: Scenario, metrics: Mapping[str, Any]) -> Table | None:
    """Tabulate the results of all methods side by side; None for a run with one method."""
    if not metrics.get("compared"):
        return None
    found = compare(scenario.metric_units, metrics)
    rows = [(name, *map(number, texts)) for name, *texts in found.rows]
    return table(rows, ("", *found.names), "compared", row_headings=True)


def _comparison_figures(
    trace: Trace,
    others: Mapping[str, Trace],
    scenario: Scenario,
    metrics: Mapping[str, Any],
    spans: Sequence[Span],
) -> list[Figure]:
    """Overlay the runs of all methods; none for the rig, whose prescribed currents no method changes."""
    if not metrics.get("compared") or scenario.is_rig:
        return []
    method = str(metrics["method"])
    traces = {method: trace, **others}
    shaded = f" Shaded: a fault is present in the run with {method}." if spans else ""
    figures = []
    if "heading" in trace or "yaw" in trace:
        words = f"Distance from the plan, and speed.{shaded}"
        figures.append(Figure(comparison_plots.courses(traces, spans), "compared-courses", "Courses", words))
    if "x" in trace:
        words = "From above; squares: the end of each run."
        drawing = comparison_plots.paths(traces, scenario.patches)
        figures.append(Figure(drawing, "compared-paths", "Paths", words))
    return figures


def run_figures(trace: Trace, scenario: Scenario, spans: Sequence[Span]) -> list[Figure]:
    """Plot the signals of a run of robot or rig."""
    if scenario.is_rig:
        return _rig_figures(scenario.rig, trace, spans)
    return _robot_figures(scenario.robot, trace, scenario.patches, spans)


def _robot_figures(robot: Robot, trace: Trace, patches: Sequence[Any], spans: Sequence[Span]) -> list[Figure]:
    shaded = " Shaded: a fault is present." if spans else ""
    has_currents = "current_1" in trace
    figures = []
    if "x" in trace:
        words = "From above; arrows show the direction of the robot's x axis."
        figures.append(Figure(plots.path(trace, patches, spans, robot), "path", "Path", words))
    if "heading" in trace or "yaw" in trace:
        words = "Driven and planned; distance from the planned position at each instant." + shaded
        figures.append(Figure(plots.deviation(trace, spans), "heading", "Heading and position", words))
    if "wheel_speed_1" in trace:
        words = "Measured after the gear, and the controller's targets." if has_currents else "Commanded."
        figures.append(
            Figure(plots.wheel_speeds(trace, spans), "wheel-speeds", "Wheel speeds", words + shaded)
        )
    if has_currents:
        words = "Motor currents reported by the amplifiers, and commands." + shaded
        figures.append(Figure(plots.currents(trace, spans), "currents", "Currents", words))
    return figures + _truth_figures(trace, spans)


_TRUE_SIGNALS = (
    ("slip_velocity", "Slip velocity", "slip velocity [m/s]", "Rim speed less ground speed, V_r = r·φ̇ − V."),
    ("traction_force", "Traction", "traction [N]", "Drives the robot along the wheel's driving direction."),
    (
        "normal_force",
        "Normal force",
        "normal force [N]",
        "It ripples as one roller after another takes the load.",
    ),
)
"""Column, heading, axis label and caption of signals known only in simulation."""


def _truth_figures(trace: Trace, spans: Sequence[Span]) -> list[Figure]:
    """Plot the signals known only in simulation."""
    averaged = f"Lines: means over {1000 * window(trace['time']):.0f} ms; pale: the samples."
    figures = []
    for column, heading, label, words in _TRUE_SIGNALS:
        if f"{column}_1" in trace:
            drawing = plots.per_wheel(trace, column, label, spans, zero=column != "normal_force")
            figures.append(Figure(drawing, column, heading, f"{words} {averaged}"))
    if "twist_x" in trace and "heading" in trace:
        words = "Along the axes of the floor; dashed: planned." + (
            " Shaded: a fault is present." if spans else ""
        )
        figures.append(Figure(plots.velocity(trace, spans), "velocity", "Velocity", words))
    return figures


_RIG_FIGURES = (
    ("speeds", "Wheel and carriage", "Rim speed with r = {radius:g} m; the gap between the lines is slip."),
    ("slip", "Slip velocity", "V_r = r·φ̇ − V."),
    (
        "forces",
        "Traction and lateral force",
        "At the wheel's contact with the floor, along the rail and along the axle.",
    ),
    ("normal", "Normal force", "It ripples as one roller after another takes the load."),
    ("current", "Current", "Motor current reported by the amplifier, and command."),
    ("lateral", "Lateral speed", "Speed of the gantry along the wheel's axle."),
)
"""Plot, heading and caption of the signals of a rig."""


def _rig_figures(rig: Rig, trace: Trace, spans: Sequence[Span]) -> list[Figure]:
    radius = rig.wheel.radius
    drawings = plots.rig_plots(trace, radius, spans)
    moves = bool(np.any(np.abs(trace["lateral_speed"]) > _MOVES))
    return [
        Figure(drawings[name], name, heading, words.format(radius=radius))
        for name, heading, words in _RIG_FIGURES
        if name in drawings and (moves or name != "lateral")
    ]
