"""Tables and plots of records for notebooks: what `Displayed` shows.

A table is filled by the same functions as the report of the record and rendered by a template, which escapes
every text; a plot is one of the report's.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import singledispatch
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from omnimj.diagnosis.calibration import Calibration
from omnimj.diagnosis.files import format_calibration
from omnimj.diagnosis.replay import DiagnosedRuns, RunDiagnosis
from omnimj.errors import UnknownNameError
from omnimj.estimate.drives.records import DriveValidation
from omnimj.estimate.gap import sentences
from omnimj.estimate.gap.records import Finding, overlays_by_run, run_gaps, typical_run, worst_run
from omnimj.estimate.identification.records import Identification, Validation
from omnimj.estimate.robot.files import excitation_lines, summary
from omnimj.estimate.robot.records import RobotIdentification
from omnimj.parameters import Rig, Robot
from omnimj.recording.dataset import Dataset
from omnimj.signals import Trace
from omnimj.simulate.run import RunResult
from omnimj.studies.evaluation.study import EvaluationResult
from omnimj.studies.tuning.reporting import format_verdict
from omnimj.studies.tuning.study import TuningResult
from omnimj.view import palette, wording
from omnimj.view.diagnosis_words import (
    describe_diagnosis,
    describe_undiagnosed,
    describe_unjudged,
    summarize_runs,
)
from omnimj.view.plots import mismatch
from omnimj.view.plots.document import stacked
from omnimj.view.plots.identification import identified_numbers
from omnimj.view.plots.over_time import finish
from omnimj.view.plots.panels import MIDDLE, Drawing, new_drawing
from omnimj.view.report import finding_tables
from omnimj.view.report.diagnosis import diagnoses_table, run_section
from omnimj.view.report.evaluation import evaluation_figures, plain_text
from omnimj.view.report.gap import gap_verdict, location_figures, rounds, size_figures, traction_figures
from omnimj.view.report.identification import floor_figures, parameters_table
from omnimj.view.report.page import Figure, Table, number, render_part, table
from omnimj.view.report.run import checks_table, run_figures, run_verdict
from omnimj.view.report.tuning import tuning_figures, tuning_tables
from omnimj.view.report.validation import drive_figures, groups_table, overlays

_MOST_RUNS = 30  # rows of a table


class Summary(NamedTuple):
    """HTML that a notebook shows for a record."""

    title: str
    verdict: str = ""
    kind: str = "plain"
    """CSS class of the verdict: `good`, `bad`, `ambiguous` or `plain`."""
    lines: Sequence[str] = ()
    tables: Sequence[Table | None] = ()


def html(record: Any) -> str:
    """Compact table of a record."""
    found = summarize(record)
    tables = [one for one in found.tables if one is not None]
    return render_part("notebook", **found._replace(tables=tables)._asdict())


def plot_names(record: Any) -> tuple[str, ...]:
    """Names of a record's plots."""
    if isinstance(record, Trace):
        return tuple(_grouped(record))
    return tuple(figure.name for figure in figures(record))


def layout(record: Any, names: Sequence[str]) -> Any:
    """Bokeh layout of a record's plots below each other; of the first one without names.

    Raises:
      UnknownNameError: No such plot.
    """
    kind = type(record).__name__
    if isinstance(record, Trace):
        return stacked([_columns(record, kind, names or ("wheel_speed",))])
    known = {figure.name: figure for figure in figures(record)}
    chosen = names or tuple(known)[:1]
    for name in chosen:
        if name not in known:
            raise UnknownNameError(f"{kind}.plot", "plot", name, known)
    return stacked([_drawing(known[name]) for name in chosen])


def _drawing(figure: Figure) -> Drawing:
    assert isinstance(figure.content, Drawing)
    return figure.content


@singledispatch
def summarize(record: Any) -> Summary:
    """HTML that a notebook shows for a record of this type."""
    raise TypeError(f"no table for {type(record).__name__}")


@singledispatch
def figures(record: Any) -> list[Figure]:
    """Plots of a record of this type, by name; most have none."""
    return []


@summarize.register
def _(record: RunResult) -> Summary:
    metrics, about = record.metrics, record.trace.about
    kind, verdict = run_verdict(metrics)
    named = {name: about.get(name) for name in ("plant", "method", "seed", "floor")}
    ended = [f"Ended early: {about['failure'] or 'interrupted'}"] if record.interrupted else []
    line = ", ".join(f"{name} {str(value).replace('_', ' ')}" for name, value in named.items())
    faults = [f"True fault: {span.label} from {span.start:g} s" for span in _spans(record)]
    rows = [
        (
            wording.FAULT_NAMES.get(d["kind"], d["kind"]),
            ", ".join(map(str, d["wheels"])),
            number(f"{d['time']:.3f} s"),
        )
        for d in metrics.get("diagnoses") or ()
    ]
    diagnosed = table(rows, ("diagnosed", "wheels", "at")) if rows else None
    tables = (checks_table(record.scenario, metrics), diagnosed)
    return Summary(wording.title(metrics or about), verdict, kind, [line, *ended, *faults], tables)


def _spans(record: RunResult) -> list[wording.Span]:
    time = record.trace["time"]
    return wording.fault_spans(record.metrics, float(time[-1])) if len(time) else []


@figures.register
def _(record: RunResult) -> list[Figure]:
    return run_figures(record.trace, record.scenario, _spans(record)) if len(record.trace["time"]) > 1 else []


@summarize.register
def _(record: Trace) -> Summary:
    time = record.columns.get("time", np.empty(0))
    rows = []
    for name, columns in _grouped(record).items():
        values = np.concatenate([record[column] for column in columns]) if len(time) else np.empty(0)
        finite = values[np.isfinite(values)]
        shown = [f"{end:.4g}" for end in (finite.min(), finite.max())] if len(finite) else ["–", "–"]
        many = f"{name}_1 … {len(columns)}" if len(columns) > 1 or columns[0] != name else name
        rows.append((many, *map(number, shown)))
    span = f"{len(time)} rows, {time[0]:g} to {time[-1]:g} s" if len(time) else "no rows"
    about = ", ".join(
        f"{name} {value}" for name, value in record.about.items() if isinstance(value, str | int | float)
    )
    return Summary(
        "Trace", span, lines=[about] if about else [], tables=[table(rows, ("column", "least", "greatest"))]
    )


def _grouped(trace: Trace) -> dict[str, list[str]]:
    """Columns by quantity: those of the wheels together."""
    grouped: dict[str, list[str]] = {}
    for name in trace.columns:
        stem, _, last = name.rpartition("_")
        quantity = stem if last.isdigit() and f"{stem}_1" in trace else name
        if quantity != "time":
            grouped.setdefault(quantity, []).append(name)
    return grouped


def _columns(trace: Trace, kind: str, names: Sequence[str]) -> Drawing:
    """Draw columns over time, one panel per name; a quantity of the wheels stands for all of them."""
    grouped = _grouped(trace)
    drawing = new_drawing(MIDDLE * len(names), rows=len(names))
    for panel, name in zip(drawing.panels, names, strict=True):
        own = grouped.get(name) or ([name] if name in trace else None)
        if own is None:
            raise UnknownNameError(f"{kind}.plot", "column", name, grouped)
        panel.values(name.replace("_", " "))
        for k, column in enumerate(own):
            color = palette.wheel_color(k) if len(own) > 1 else palette.MEASURED
            panel.line(trace["time"], trace[column], color, f"{k + 1}" if len(own) > 1 else "")
        if len(own) > 1:
            panel.legend()
    return finish(drawing, trace["time"], ())


@summarize.register
def _(record: RunDiagnosis) -> Summary:
    lines = [line for line in (describe_unjudged(record), *record.notes) if line]
    found = diagnoses_table(record.diagnoses)
    verdict = summarize_runs([record]) if found else describe_undiagnosed(record)
    return Summary(f"Run {record.name}", verdict, "bad" if found else "plain", lines, [found])


@figures.register
def _(record: RunDiagnosis) -> list[Figure]:
    section = run_section(record, record.method, tuple(record.trace.columns))
    names = {"r": "residuals", "e": "effectiveness"}
    return [dataclasses.replace(one, name=names[one.name[0]]) for one in section.figures]


@summarize.register
def _(record: DiagnosedRuns) -> Summary:
    rows = [
        (
            run.name,
            "; ".join(map(describe_diagnosis, run.diagnoses)) or describe_undiagnosed(run),
            number(f"{run.judged:.1f} s"),
        )
        for run in record[:_MOST_RUNS]
    ]
    left = len(record) - len(rows)
    lines = [f"… and {left} more runs"] if left > 0 else []
    any_found = any(run.diagnoses for run in record)
    found = table(rows, ("run", "found", "judged"))
    return Summary("Diagnosed runs", summarize_runs(record), "bad" if any_found else "plain", lines, [found])


@summarize.register
def _(record: Calibration) -> Summary:
    rows = [(one.name.replace("_", " "), number(f"{one.value:.4g}")) for one in record.set]
    lines = [sentences.as_sentence(line) for line in format_calibration(record)]
    return Summary(
        "Calibrated thresholds",
        f"{record.runs} runs",
        lines=lines,
        tables=[table(rows, ("threshold", "value"))],
    )


@summarize.register
def _(record: Finding) -> Summary:
    kind, verdict = gap_verdict(record)
    tables = [finding_tables.fitted_parameters(effect) for effect in record.effects if effect.parameters]
    if record.where and record.verdict != "no_gap":
        tables.append(finding_tables.mismatch_locations(record))
    tables.append(finding_tables.channel_mismatches(record))
    lines = [record.reason, *record.data_notes[:2]]
    return Summary(f"Gap of {sentences.dataset_name(record)}", verdict, kind, lines, tables)


@figures.register
def _(record: Finding) -> list[Figure]:
    runs = run_gaps(record)
    found = [
        *location_figures(record, runs),
        *traction_figures(record),
        *rounds(record)[0],
        *size_figures(record),
    ]
    windows = overlays_by_run(record)
    for name, run in (("worst-run", worst_run(record)), ("typical-run", typical_run(record))):
        if run is not None:
            found.append(Figure(mismatch.overlay(record, windows[run]), name, run, "Measured and simulated."))
    return found


@summarize.register
def _(record: Identification) -> Summary:
    lines = [line for floor in record.floors for line in floor.undetermined] + list(record.notes)
    runs = sum(len(floor.runs) for floor in record.floors)
    verdict = f"{runs} runs; below each value its 90 % interval"
    return Summary(
        f"Floors of {record.dataset.name}", verdict, lines=lines, tables=[parameters_table(record)]
    )


@figures.register
def _(record: Identification) -> list[Figure]:
    return [figure for floor in record.floors for figure in floor_figures(floor)]


@summarize.register
def _(record: RobotIdentification) -> Summary:
    rows = [
        (
            one.words,
            number(f"{one.value:.4g} {one.unit.lstrip('1')}"),
            number(f"{one.low:.4g} … {one.high:.4g}"),
            one.source,
        )
        for one in record.estimates
    ]
    open_lines = [line.removeprefix("- ") for line in excitation_lines(record)] if record.unexcited else []
    lines = [*summary(record), *(f"Not excited by the drive: {line}" for line in open_lines)]
    found = table(rows, ("number", "value", "90 % interval", "determined by"))
    return Summary(f"Robot of {record.dataset.name}", lines=lines, tables=[found])


@figures.register
def _(record: RobotIdentification) -> list[Figure]:
    words = "Bars: 90 % intervals."
    return [Figure(identified_numbers(record), "numbers", "Numbers over those of the model file", words)]


@summarize.register
def _(record: Validation) -> Summary:
    rows = [
        (
            cell.floor.replace("_", " "),
            number(f"{cell.mass:g} kg"),
            number(f"{cell.current:.2f} A"),
            number(f"{cell.lateral_speed:+.2f} m/s"),
            *(number(wording.number(cell.rms.get(plant), 3)) for plant in record.plants),
        )
        for cell in record.cells
    ]
    verdict = ", ".join(f"{record.mean(plant):.4f} m/s ({plant})" for plant in record.plants) if rows else ""
    head = ("floor", "mass", "current", "sideways", *(f"RMS error, {plant} [m/s]" for plant in record.plants))
    found = table(rows, head)
    return Summary(f"Validation on {record.dataset.name}", verdict, lines=record.notes, tables=[found])


@figures.register
def _(record: Validation) -> list[Figure]:
    return overlays(record)


@summarize.register
def _(record: DriveValidation) -> Summary:
    floors = tuple(dict.fromkeys(group.floor for group in record.groups))
    tables = [groups_table([group for group in record.groups if group.floor == floor]) for floor in floors]
    verdict = f"{len({run.run for run in record.runs})} runs on {', '.join(floors)}, a table per floor"
    return Summary(f"Validation on {record.dataset.name}", verdict, lines=record.notes, tables=tables)


@figures.register
def _(record: DriveValidation) -> list[Figure]:
    floors = tuple(dict.fromkeys(group.floor for group in record.groups))
    return [figure for floor in floors for figure in drive_figures(record, floor)]


@summarize.register
def _(record: EvaluationResult) -> Summary:
    lines = [plain_text(line) for line in record.lines]
    if record.interrupted:
        lines.append("Ended early: interrupted")
    tables = [table(one.rows, one.head) for one in record.tables if one.rows]
    return Summary(plain_text(record.heading), f"{len(record.scores)} cases", lines=lines, tables=tables)


@figures.register
def _(record: EvaluationResult) -> list[Figure]:
    return [figure for row in evaluation_figures(record) for figure in row]


@summarize.register
def _(record: TuningResult) -> Summary:
    scenarios = ", ".join(Path(text).stem for text in record.config.scenarios)
    line = f"{len(record.tried)} candidates on {scenarios}, plant {record.config.plant}"
    kind = "good" if record.is_better else "bad"
    tables = [one for _, one in tuning_tables(record)]
    return Summary("Tuned gains", format_verdict(record), kind, [line], tables)


@figures.register
def _(record: TuningResult) -> list[Figure]:
    return tuning_figures(record)


@summarize.register
def _(record: Dataset) -> Summary:
    rows = [
        (
            run.name,
            ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in run.conditions.items()),
            number(f"{len(run.time)}"),
            number(f"{run.time[-1] - run.time[0]:.4g} s" if len(run.time) else "–"),
        )
        for run in record.runs[:_MOST_RUNS]
    ]
    left = len(record.runs) - len(rows)
    lines = [*record.notes, *([f"… and {left} more runs"] if left > 0 else [])]
    found = table(rows, ("run", "conditions", "samples", "duration"))
    return Summary(
        f"Dataset {record.path.name}", f"{len(record.runs)} runs of {record.plant}", "plain", lines, [found]
    )


@summarize.register(Robot)
@summarize.register(Rig)
def _(record: Robot | Rig) -> Summary:
    rows = [
        (name.replace("_", " "), number(_shown(record, name)), _unit(origin.unit), origin.source)
        for name, origin in record.provenance.items()
    ]
    line = f"read from {record.file}"
    found = table(rows, ("quantity", "value", "unit", "source"))
    return Summary(f"Constants of {record.plant}", f"{len(rows)} quantities", lines=[line], tables=[found])


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit


def _shown(record: Robot | Rig, name: str) -> str:
    """Value of a quantity, by its key in `provenance`."""
    value: Any = record
    for key in name.split("."):
        if isinstance(value, tuple) and key.isdigit():
            value = value[int(key) - 1]
        else:
            value = value[key] if isinstance(value, Mapping) else getattr(value, key)
    return ", ".join(f"{one:g}" for one in value) if isinstance(value, tuple) else f"{value:g}"
