"""`report.html` of a diagnosis of recorded runs: a table for all, then each run with what was looked at."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import omnimj
from omnimj.diagnosis.replay import DiagnosisConfig, RunDiagnosis
from omnimj.resources import model_display_name
from omnimj.view.plots import diagnosis as diagnosis_plots
from omnimj.view.plots.drawing import svg
from omnimj.view.report import page
from omnimj.view.wording import (
    Span,
    describe_confidence,
    describe_diagnosis,
    describe_time,
    describe_undiagnosed,
    describe_unjudged,
    diagnosis_spans,
    summarize_runs,
)

MOST_FIGURES = 40
"""Runs that are drawn at most: a page must still open."""


def run_section(run: RunDiagnosis, method_names: Sequence[str], drawn: bool = True) -> str:
    """The part of the page about one run.

    Args:
      run: With its trace.
      method_names: Columns of the method's log.
      drawn: Whether it gets plots.
    """
    words = [f"<p>{describe_undiagnosed(run).capitalize()}.</p>"]
    if run.diagnoses:
        rows = [
            (
                page.cell(describe_diagnosis(d)),
                page.cell(describe_time(d), "number"),
                page.cell(describe_confidence(d)),
            )
            for d in run.diagnoses
        ]
        words = [page.table(rows, ("what", "when", "how sure"))]
    if describe_unjudged(run):
        words.append(f"<p>Of {run.judged:.1f} s the method says for {run.cannot_judge:.1f} s that it cannot ")
        words.append("judge: the wheels turn too slowly to tell.</p>")
    words += [f"<p>{page.text(note)}</p>" for note in run.notes]
    figures = _figures(run, method_names) if drawn else ""
    plots = f"<div class='columns plots'>{figures}</div>" if figures else ""
    return page.section(run.name, "".join(words) + plots)


def _figures(run: RunDiagnosis, names: Sequence[str]) -> str:
    if len(run.trace["time"]) < 2 or not names or names[0] not in run.trace:
        return ""
    spans = _spans(run)
    shaded = " Shaded: a diagnosis stands." if spans else ""
    key = "".join(c if c.isascii() and c.isalnum() else f"-{ord(c):x}-" for c in run.name)
    caption = f"Dotted: the threshold, where there is one.{shaded}"
    drawn = svg(diagnosis_plots.recorded_residuals(run.trace, names, spans), f"r-{key}", "residuals")
    found = page.figure(drawn, "Residuals", caption)
    if "effectiveness_1" in names:
        drawn = svg(diagnosis_plots.recorded_effectiveness(run.trace, spans), f"e-{key}", "effectiveness")
        found += page.figure(
            drawn, "Effectiveness", f"What is believed to be left of each wheel's drive.{shaded}"
        )
    return found


def _spans(run: RunDiagnosis) -> list[Span]:
    """When each diagnosis stood, within the run."""
    told = {"diagnoses": [dataclasses.asdict(d) for d in run.diagnoses]}
    return diagnosis_spans(told, float(run.trace["time"][-1]))


def write_diagnosis_report(
    path: Path,
    order: DiagnosisConfig,
    runs: Sequence[RunDiagnosis],
    sections: Sequence[str],
    command: str = "",
    interrupted: bool = False,
) -> None:
    """Writes the report as one HTML file that needs nothing else.

    Args:
      path: The file to write.
      order: What was asked for.
      runs: Finished runs; their traces are not needed.
      sections: From `run_section`.
      command: The command line that makes it again.
      interrupted: Whether runs are missing.
    """
    name = order.dataset.path.resolve().name
    content = [
        _head(order, runs, name, interrupted),
        page.section("All runs", _table(runs)),
        *sections,
        _foot(order, command),
    ]
    path.write_text(page.document(f"Diagnosis of {name} · omnimj", "\n".join(content)), encoding="utf-8")


def _head(order: DiagnosisConfig, runs: Sequence[RunDiagnosis], name: str, interrupted: bool) -> str:
    found = any(run.diagnoses for run in runs)
    stopped = "<p class='verdict bad'>Stopped before the last run</p>" if interrupted else ""
    notes = "".join(f"<li>{page.text(note)}</li>" for note in order.dataset.notes)
    seconds = sum(run.judged for run in runs)
    return (
        f"<h1>Diagnosis of {page.text(name)}</h1>"
        f"<p class='lead'>Method {page.text(order.method)} over {len(runs)} recorded runs of "
        f"{page.text(model_display_name(order.machine.constants.file))}, {seconds:.4g} s in all.</p>"
        f"<p class='verdict {'bad' if found else 'good'}'>{page.text(summarize_runs(runs).capitalize())}</p>"
        f"{stopped}" + (f"<ul>{notes}</ul>" if notes else "")
    )


def _table(runs: Sequence[RunDiagnosis]) -> str:
    rows = []
    for run in runs:
        name, cannot = page.cell(run.name), page.cell(f"{run.cannot_judge:.1f} s", "number")
        if not run.diagnoses:
            rows.append((name, page.cell(describe_undiagnosed(run)), page.cell("–"), page.cell("–"), cannot))
        for d in run.diagnoses:
            told = (
                page.cell(describe_diagnosis(d)),
                page.cell(describe_time(d), "number"),
                page.cell(describe_confidence(d)),
            )
            rows.append((name, *told, cannot))
    return page.table(rows, ("run", "what", "when", "how sure", "cannot judge"))


def _foot(order: DiagnosisConfig, command: str) -> str:
    again = f"<p>To make it again:</p>{page.command(command)}" if command else ""
    own = "" if order.thresholds is None else " Thresholds from a calibration."
    return (
        f"<footer>{again}<p>Model {page.text(order.machine.constants.file)}.{own} Beside this page: "
        "<code>diagnoses.json</code>, and a trace of each run with what the method held at each row. "
        f"Written by omnimj {page.text(omnimj.__version__)}.</p></footer>"
    )
