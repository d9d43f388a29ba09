"""`report.html` of a run: what was driven, whether it held, and the plots worth looking at."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import omnimj
from omnimj.parameters import Rig, Robot
from omnimj.signals import Trace
from omnimj.view import wording
from omnimj.view.comparison import compare, runs_by_method
from omnimj.view.picture import Picture
from omnimj.view.plots import comparison as plots_compared
from omnimj.view.plots import runs
from omnimj.view.plots.drawing import svg, window
from omnimj.view.report import page, run_diagnosis
from omnimj.view.wording import ScenarioLike, Span, describe_layout, recovery_periods

# The part of a run's report that sets several methods side by side.

HEADING = "With other methods"
STYLE = """
table.compared { margin-bottom: 1.1rem; }
@media (max-width: 520px) { table.compared { font-size: .86rem; }
  table.compared th, table.compared td { padding-right: .5rem; }
  table.compared td, table.compared tbody th { overflow-wrap: anywhere; }
  table.compared tbody th { width: 26%; } }
"""


def compared_section(
    trace: Trace,
    others: Mapping[str, Trace],
    scenario: ScenarioLike,
    metrics: Mapping[str, Any],
    spans: Sequence[Span],
) -> str:
    """Table and overlaid plots; empty for a run that has none beside it.

    Args:
      trace: Of the run that was asked for.
      others: Of those beside it, by method.
      scenario: What was asked for.
      metrics: Content of `metrics.json`; `compared` holds those of the others.
      spans: When faults held in the run that was asked for.
    """
    runs = runs_by_method(metrics)
    if not runs:
        return ""
    comparison = compare(scenario.metric_units, metrics)
    head = "".join(f"<th scope='col'>{page.text(words)}</th>" for words in ("", *comparison.methods))
    rows = "".join(
        f"<tr><th scope='row'>{page.text(name)}</th>{''.join(page.cell(t, 'number') for t in texts)}</tr>"
        for name, *texts in comparison.rows
    )
    table = f"<table class='compared'><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
    words = f"Same scenario, same seed. The rest of this page is about the method {metrics['method']}."
    content = f"<p>{page.text(words)}</p><div class='wide'>{table}</div>"
    return page.section(
        HEADING,
        content + _report_compared_figures({str(metrics["method"]): trace, **others}, scenario, spans),
    )


def _report_compared_figures(
    traces: Mapping[str, Trace], scenario: ScenarioLike, spans: Sequence[Span]
) -> str:
    if isinstance(scenario.constants, Rig):
        words = "The rig is driven with given currents: no method changes how it moves."
        return f"<p>{page.text(words)}</p>"
    first = next(iter(traces.values()))
    shaded = f" Shaded: a fault holds in the run with {next(iter(traces))}." if spans else ""
    drawn = []
    if "heading" in first or "yaw" in first:
        words = f"How far from the plan, and how fast.{shaded}"
        drawn.append(("courses", "Courses", words, plots_compared.courses(traces, spans)))
    if "x" in first:
        words = "From above; squares: where each run ended."
        drawn.append(("paths", "Paths", words, plots_compared.paths(traces, scenario.patches)))
    figures = "".join(
        page.figure(svg(figure, f"compared-{name}", page.text(heading)), heading, words)
        for name, heading, words, figure in drawn
    )
    return f"<div class='columns plots'>{figures}</div>" if figures else ""


_MOVES = 0.01  # [m/s] of a gantry that is not at rest


def write_report(
    path: Path,
    trace: Trace,
    scenario: ScenarioLike,
    metrics: Mapping[str, Any],
    picture: Picture | None = None,
    others: Mapping[str, Trace] | None = None,
) -> None:
    """Writes a run's report as one HTML file that needs nothing else.

    Args:
      path: The file to write.
      trace: What was recorded.
      scenario: What was asked for.
      metrics: Content of `metrics.json`.
      picture: A rendered or drawn picture; its way of making is named in the report.
      others: Runs of the same scenario with other methods, by method; `metrics["compared"]` has their
        metrics.
    """
    duration = float(trace["time"][-1])
    spans = wording.fault_spans(metrics, duration)
    content = [
        _head(scenario, metrics),
        "<div class='columns'>",
        _picture(picture, metrics) if picture else "",
        f"<div>{_run_table(scenario, metrics)}</div>",
        "</div>",
        "<div class='columns'>",
        page.section("Checks", _checks(scenario, metrics)),
        page.section("Other results", _results(scenario, metrics)),
        "</div>",
    ]
    content.append(_recovered(trace, metrics))
    if wording.is_diagnosed(metrics):
        content.append(run_diagnosis.diagnosis_section(trace, scenario, metrics, spans))
    elif metrics.get("faults"):
        content.append(page.section("Faults given to the plant", _faults(metrics)))
    content.append(compared_section(trace, others or {}, scenario, metrics, spans))
    figures = _figures(trace, scenario, spans)
    content.append(page.section("Plots", f"<div class='columns plots'>{''.join(figures)}</div>"))
    content.append(_foot(metrics))
    heading, style = f"{wording.title(metrics)} · omnimj", STYLE
    path.write_text(page.document(heading, "\n".join(content), style), encoding="utf-8")


def _head(scenario: ScenarioLike, metrics: Mapping[str, Any]) -> str:
    checks = metrics.get("checks") or ()
    unjudged = sum(not check.get("judged", True) for check in checks)
    failed = sum(not check["ok"] for check in checks) - unjudged
    if not checks:
        kind, verdict = "plain", "No checks in this scenario"
    elif failed:
        kind, verdict = "bad", f"✗ Failed: {failed} of {len(checks)} checks"
    elif unjudged:
        words = f"{unjudged} of {len(checks)} checks need a truth that nobody knows, the others hold"
        kind, verdict = (
            "plain",
            f"Not judged: {words if unjudged < len(checks) else 'all checks need a truth'}",
        )
    else:
        kind, verdict = (
            "good",
            "✓ Passed: the check holds" if len(checks) == 1 else f"✓ Passed: all {len(checks)} checks hold",
        )
    return (
        f"<h1>{page.text(wording.title(metrics))}</h1><p class='lead'>{page.text(scenario.description)}</p>"
        f"{_ended_early(metrics)}<p class='verdict {kind}'>{page.text(verdict)}</p>"
    )


def _ended_early(metrics: Mapping[str, Any]) -> str:
    """What broke the run off; nothing for one that came to its end."""
    if not metrics.get("interrupted"):
        return ""
    why = metrics.get("failure") or f"interrupted at {wording.number(metrics.get('duration'))} s"
    return f"<p class='verdict bad'>{page.text(f'✗ Broken off: {why}')}</p>"


def _picture(picture: Picture, metrics: Mapping[str, Any]) -> str:
    words = f"{wording.title(metrics)}: {picture.subject}"
    if picture.path is None:
        return f"<p>{page.text(picture.caption)}</p>"
    return page.figure(
        page.image(picture.path, words), picture.subject.capitalize(), picture.caption, "picture"
    )


def _run_table(scenario: ScenarioLike, metrics: Mapping[str, Any]) -> str:
    floor = str(metrics.get("floor", scenario.floor)).replace("_", " ")
    if metrics.get("plant") == "kinematic":
        floor = "none: motion without forces"
    patches = [f"{p.floor.replace('_', ' ')} {p.size[0]:g} m × {p.size[1]:g} m" for p in scenario.patches]
    rows = [
        ("scenario", metrics.get("scenario", "–")),
        ("machine", scenario.plant.replace("_", " ")),
        *_layout(scenario.constants),
        ("plant", metrics.get("plant", "–")),
        ("floor", floor + "".join(f"; patch of {patch}" for patch in patches)),
        ("method", metrics.get("method", "–")),
        ("seed", metrics.get("seed", "–")),
        ("duration", f"{wording.number(metrics.get('duration'))} s"),
        ("omnimj", omnimj.__version__),
    ]
    table = page.table([(page.text(name), page.cell(value)) for name, value in rows])
    command = page.command(wording.repeat_command(scenario, metrics))
    return f"{table}<p>To drive it again:</p>{command}"


def _layout(constants: Robot | Rig) -> list[tuple[str, str]]:
    """How many wheels, and what cannot be lost of them; nothing for the rig."""
    if isinstance(constants, Rig):
        return []
    limits = describe_layout(constants)
    return [("wheels", f"{len(constants.wheels)}{f': {limits}' if limits else ''}")]


def _checks(scenario: ScenarioLike, metrics: Mapping[str, Any]) -> str:
    checks = metrics.get("checks") or ()
    if not checks:
        return "<p>The scenario asks for nothing that could fail.</p>"
    rows = []
    for check in checks:
        unit = scenario.metric_units.get(check["name"], "")
        sign = "≥" if check.get("bound") == "min" else "≤"
        limit = check.get("limit")
        rows.append(
            (
                page.state(bool(check["ok"]), bool(check.get("judged", True))),
                page.cell(check["name"].replace("_", " ")),
                page.cell(wording.measure(check.get("value"), unit), "number"),
                page.cell(f"{sign} {wording.measure(limit, unit)}" if limit is not None else "–", "number"),
            )
        )
    return page.table(rows, ("", "check", "value", "must be"))


def _results(scenario: ScenarioLike, metrics: Mapping[str, Any]) -> str:
    judged = {check["name"] for check in metrics.get("checks") or ()}
    units = dict(scenario.metric_units)
    rows = []
    for key, unit in units.items():
        value = metrics.get(key)
        if value is None or key in judged:
            continue
        shown = ("yes" if value else "no") if isinstance(value, bool) else wording.measure(value, unit)
        rows.append((page.text(key.replace("_", " ")), page.cell(shown, "number")))
    speed = metrics.get("realtime_factor")
    if speed is not None:
        rows.append(("simulated at", page.cell(f"{wording.number(speed, 3)} × real time", "number")))
    return page.table(rows) if rows else "<p>No results beyond the checks.</p>"


def _recovered(trace: Trace, metrics: Mapping[str, Any]) -> str:
    """What recovery did and could not hold; empty for a run as planned."""
    ways = recovery_periods(trace, metrics)
    if not ways:
        return ""
    rows = [(page.cell(way.name), page.cell(way.when), page.cell(way.gives_up)) for way in ways]
    return page.section(
        "What recovery could hold", page.table(rows, ("recovery", "when", "what it gives up"))
    )


def _faults(metrics: Mapping[str, Any]) -> str:
    rows = []
    for fault in metrics["faults"]:
        end = fault.get("end")
        rows.append(
            (
                page.cell(wording.FAULT_NAMES.get(fault["kind"], fault["kind"])),
                page.cell(wording.number(fault.get("wheel")), "number"),
                page.cell(f"{fault['onset']:g} s", "number"),
                page.cell("end of run" if end is None else f"{end:g} s", "number"),
                page.cell(wording.fault_details(fault) or "–"),
            )
        )
    return page.table(rows, ("fault", "wheel", "from", "to", "size"))


def _figures(trace: Trace, scenario: ScenarioLike, spans: Sequence[Span]) -> list[str]:
    constants = scenario.constants
    wanted = (
        _rig_figures(trace, constants.wheel.radius, spans)
        if isinstance(constants, Rig)
        else _robot_figures(trace, constants, scenario.patches, spans)
    )
    return [
        page.figure(svg(draw(), name, page.text(heading)), heading, caption)
        for name, heading, caption, draw in wanted
    ]


Wanted = list[tuple[str, str, str, Callable[[], Figure]]]


def _robot_figures(trace: Trace, robot: Robot, patches: Sequence[Any], spans: Sequence[Span]) -> Wanted:
    shaded = " Shaded: a fault holds." if spans else ""
    forces = "current_1" in trace
    wanted: Wanted = []
    if "x" in trace:
        words = "From above; arrows point where the robot's x axis points."
        wanted.append(("path", "Path", words, lambda: runs.path(trace, patches, spans, robot)))
    if "heading" in trace or "yaw" in trace:
        words = "Driven and planned; how far the robot is from where it should be at each instant." + shaded
        wanted.append(("heading", "Heading and place", words, lambda: runs.deviation(trace, spans)))
    words = "Measured after the gear, and what the controller asked for." if forces else "As demanded."
    wanted.append(("wheel-speeds", "Wheel speeds", words + shaded, lambda: runs.wheel_speeds(trace, spans)))
    if forces:
        words = "Of the motors, as the amplifiers report them, and as commanded." + shaded
        wanted.append(("currents", "Currents", words, lambda: runs.currents(trace, spans)))
    return wanted + _truth_figures(trace, shaded, spans)


def _truth_figures(trace: Trace, shaded: str, spans: Sequence[Span]) -> Wanted:
    """What only a simulation knows."""
    wanted: Wanted = []
    averaged = f"Lines: means over {1000 * window(trace['time']):.0f} ms; bands: smallest and largest."
    quantities = (
        (
            "slip_velocity",
            "Slip velocity",
            "slip velocity [m/s]",
            "Rim speed less ground speed, V_r = r·φ̇ − V.",
        ),
        (
            "traction_force",
            "Traction",
            "traction [N]",
            "Pushes the robot along the wheel's driving direction.",
        ),
        (
            "normal_force",
            "Normal force",
            "normal force [N]",
            "It ripples as roller after roller takes the load.",
        ),
    )
    for column, heading, label, words in quantities:
        if f"{column}_1" not in trace:
            continue

        def draw(column: str = column, label: str = label) -> Figure:
            return runs.per_wheel(trace, column, label, spans, zero=column != "normal_force")

        wanted.append((column, heading, f"{words} {averaged}", draw))
    if "twist_x" in trace and "heading" in trace:
        words = "Along the axes of the floor; dashed: planned." + shaded
        wanted.append(("velocity", "Velocity", words, lambda: runs.velocity(trace, spans)))
    return wanted


def _rig_figures(trace: Trace, radius: float, spans: Sequence[Span]) -> Wanted:
    words = f"Rim speed with r = {radius:g} m; the gap between the lines is slip."
    wanted: Wanted = [
        ("speeds", "Wheel and carriage", words, lambda: runs.rig_speeds(trace, radius, spans)),
        ("slip", "Slip velocity", "V_r = r·φ̇ − V.", lambda: runs.rig_slip(trace, radius, spans)),
    ]
    if "traction_force_1" in trace:
        words = "At the wheel's contact with the floor, along the rail and along the axle."
        wanted.append(("forces", "Traction and lateral force", words, lambda: runs.rig_forces(trace, spans)))
        words = "It ripples as roller after roller takes the load."
        wanted.append(("normal", "Normal force", words, lambda: runs.rig_normal_force(trace, spans)))
    words = "Of the motor, as the amplifier reports it, and as commanded."
    wanted.append(("current", "Current", words, lambda: runs.rig_current(trace, spans)))
    if np.any(np.abs(trace["lateral_speed"]) > _MOVES):
        words = "How fast the gantry moves the wheel along its axle."
        wanted.append(("lateral", "Lateral speed", words, lambda: runs.rig_lateral_speed(trace, spans)))
    return wanted


def _foot(metrics: Mapping[str, Any]) -> str:
    others = metrics.get("compared") or ()
    traces = "".join(f", <code>trace_{page.text(method)}.parquet</code>" for method in others)
    return (
        f"<footer><p>Beside this page: <code>trace.parquet</code>{traces} (every signal of every step), "
        "<code>metrics.json</code> (the numbers above), <code>run.rrd</code> (the run in 3-D, open it with "
        f"<code>rerun run.rrd</code>). All values in SI units unless an axis says otherwise. "
        f"Written by omnimj {page.text(omnimj.__version__)}.</p></footer>"
    )
