"""`report.html` of a diagnosis of recorded runs: table of all runs, then each run with its residuals."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from omnimj.diagnosis.replay import DiagnosisConfig, RunDiagnosis
from omnimj.resources import model_display_name
from omnimj.view.plots import diagnosis as plots
from omnimj.view.plots.thinning import BINS
from omnimj.view.report.page import Figure, Table, number, plot, table, write_page
from omnimj.view.report.run_sections import MOST_FIGURES, RunSection, make_section, run_key, run_table
from omnimj.view.residuals import Family, families
from omnimj.view.wording import (
    describe_confidence,
    describe_diagnosis,
    describe_time,
    describe_undiagnosed,
    describe_unjudged,
    diagnosis_spans,
    summarize_runs,
)

_BINS_OF_A_PAGE = 16_000
_MOST_OPEN = 3  # runs with a diagnosis whose sections are open from the beginning


def bins_for(runs: int) -> int:
    """Most bins of a line on a page of several runs, which keeps the page small enough for a browser."""
    return min(BINS, _BINS_OF_A_PAGE // max(min(runs, MOST_FIGURES), 1))


def run_section(run: RunDiagnosis, method: str, method_names: Sequence[str], bins: int = BINS) -> RunSection:
    """Make the part of the page about one run.

    Args:
      run: Diagnosis of the run, with its trace.
      method: Name of the detection method.
      method_names: Columns of the method's log.
      bins: Most bins of a line; 0 for no plots.
    """
    lines, found = [f"{describe_undiagnosed(run).capitalize()}."], None
    if run.diagnoses:
        rows = [
            (describe_diagnosis(d), number(describe_time(d)), describe_confidence(d)) for d in run.diagnoses
        ]
        lines, found = [], table(rows, ("diagnosis", "time", "confidence"))
    if describe_unjudged(run):
        lines.append(
            f"For {run.cannot_judge:.1f} of {run.judged:.1f} s the wheels turn too slowly for a diagnosis."
        )
    figures = _figures(run, families(method_names, method), bins) if bins and method_names else []
    return make_section(run.name, figures, "", [*lines, *run.notes], found, bool(run.diagnoses))


def _figures(run: RunDiagnosis, shown: Sequence[Family], bins: int) -> list[Figure]:
    if len(run.trace["time"]) < 2 or not shown or shown[0].residuals[0].column not in run.trace:
        return []
    key = run_key(run.name).removeprefix("run-")
    diagnoses = {"diagnoses": [dataclasses.asdict(d) for d in run.diagnoses]}
    spans = diagnosis_spans(diagnoses, float(run.trace["time"][-1]))
    shaded = " Shaded: a diagnosis holds." if spans else ""
    words = f"Dotted: the threshold, where there is one.{shaded}"
    drawing = plots.residual_families(run.trace, shown, spans, bins)
    figures = [plot(drawing, f"r-{key}", "Residuals", words)]
    if "effectiveness_1" in run.trace:
        words = f"Estimated effectiveness of each wheel's drive.{shaded}"
        drawing = plots.effectiveness(run.trace, spans, bins)
        figures.append(plot(drawing, f"e-{key}", "Effectiveness", words))
    return figures


def write_diagnosis_report(
    path: Path,
    config: DiagnosisConfig,
    runs: Sequence[RunDiagnosis],
    sections: Sequence[RunSection],
    command: str = "",
    interrupted: bool = False,
) -> None:
    """Write the report of a diagnosis of recorded runs.

    Args:
      path: HTML file to write.
      config: Configuration of the diagnosis.
      runs: Diagnoses of the finished runs; traces are not needed.
      sections: Results of `run_section`.
      command: Command line that repeats the diagnosis.
      interrupted: True if runs are missing because of Ctrl-C.
    """
    name = config.dataset.path.resolve().name
    if sum(section.is_open for section in sections) > _MOST_OPEN:
        sections = [dataclasses.replace(section, is_open=False) for section in sections]
    write_page(
        path,
        "diagnosis",
        f"Diagnosis of {name} · omnimj",
        name=name,
        method=config.method,
        runs=len(runs),
        model=model_display_name(config.machine.constants.file),
        seconds=sum(run.judged for run in runs),
        is_bad=any(run.diagnoses for run in runs),
        verdict=summarize_runs(runs).capitalize(),
        interrupted=interrupted,
        notes=config.dataset.notes,
        overview=_overview(runs, sections),
        sections=sections,
        command=command,
        model_file=config.machine.constants.file,
        has_thresholds=config.thresholds is not None,
    )


def _overview(runs: Sequence[RunDiagnosis], sections: Sequence[RunSection]) -> Table:
    rows: list[tuple[str, tuple[Any, ...]]] = []
    for run in runs:
        unjudged = number(f"{run.cannot_judge:.1f} s")
        if not run.diagnoses:
            rows.append((run.name, (describe_undiagnosed(run), "–", "–", unjudged)))
        for d in run.diagnoses:
            described = describe_diagnosis(d), number(describe_time(d)), describe_confidence(d)
            rows.append((run.name, (*described, unjudged)))
    return run_table(rows, ("run", "diagnosis", "time", "confidence", "not judged"), sections)
