"""`report.html` of a diagnosis of recorded runs: table of all runs, then each run with its residuals."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from omnimj.diagnosis.replay import DiagnosisConfig, RunDiagnosis
from omnimj.resources import model_display_name
from omnimj.signals import Diagnosis
from omnimj.view.diagnosis_words import (
    NOTHING_FOUND,
    UNFIT,
    describe,
    describe_evidence,
    describe_kind,
    describe_undiagnosed,
    describe_unjudged,
    severity,
    summarize_runs,
)
from omnimj.view.plots import diagnosis as plots
from omnimj.view.plots.thinning import BINS
from omnimj.view.report.page import (
    FEW_RUNS,
    MOST_FIGURES,
    Cell,
    Figure,
    RunSection,
    Table,
    number,
    run_key,
    run_table,
    table,
    write_page,
)
from omnimj.view.residuals import Family, families
from omnimj.view.wording import diagnosis_spans

_NAMED = 3  # runs that are named beside a finding
_BINS_OF_A_PAGE = 16_000
_DRAWN = ("loss", "friction", "slip")  # tests of the robust method whose statistics the plots show
_MOST_OPEN = 3  # runs with a diagnosis whose sections are open from the beginning


def bins_for(runs: int) -> int:
    """Most bins of a line on a page of several runs, which keeps the page small enough for a browser."""
    return min(BINS, _BINS_OF_A_PAGE // max(min(runs, MOST_FIGURES), 1))


def run_section(run: RunDiagnosis, method: str, method_names: Sequence[str], bins: int = BINS) -> RunSection:
    """Make the part of the page about one run; no plots where `bins`, the most bins of a line, is 0."""
    lines = [] if run.diagnoses else [f"{describe_undiagnosed(run).capitalize()}."]
    if describe_unjudged(run):
        lines.append(
            f"For {run.cannot_judge:.1f} of {run.judged:.1f} s the wheels turn too slowly for a diagnosis."
        )
    figures = _figures(run, families(method_names, method), bins) if bins and method_names else []
    found = diagnoses_table(run.diagnoses, "stacked")
    return RunSection(run.name, figures, "", [*lines, *run.notes], found, bool(run.diagnoses))


def diagnoses_table(diagnoses: Sequence[Diagnosis], kind: str = "") -> Table | None:
    """List the diagnoses of a run; None without any."""
    head = ("diagnosis", "time", "confidence", "decided by")
    return table(list(map(_row, diagnoses)), head, kind) if diagnoses else None


def _row(diagnosis: Diagnosis) -> tuple[Cell | str, ...]:
    what, when, *others = describe(diagnosis)
    return (what, number(when), *others)


def _figures(run: RunDiagnosis, shown: Sequence[Family], bins: int) -> list[Figure]:
    if len(run.trace["time"]) < 2 or not shown or shown[0].residuals[0].column not in run.trace:
        return []
    key = run_key(run.name).removeprefix("run-")
    diagnoses = {"diagnoses": [dataclasses.asdict(d) for d in run.diagnoses]}
    spans = diagnosis_spans(diagnoses, float(run.trace["time"][-1]))
    shaded = " Shaded: a diagnosis holds." if spans else ""
    words = f"Dotted: the threshold, where there is one.{shaded}{_elsewhere(run)}"
    drawing = plots.residual_families(run.trace, shown, spans, bins)
    figures = [Figure(drawing, f"r-{key}", "Residuals", words)]
    if "effectiveness_1" in run.trace:
        words = f"Estimated effectiveness of each wheel's drive.{shaded}"
        drawing = plots.effectiveness(run.trace, spans, bins)
        figures.append(Figure(drawing, f"e-{key}", "Effectiveness", words))
    return figures


def _elsewhere(run: RunDiagnosis) -> str:
    """State which diagnoses were decided by a statistic that these plots do not show."""
    others = [d for d in run.diagnoses if d.test and d.test not in _DRAWN]
    named = dict.fromkeys(f"{describe_kind(d)} ({describe_evidence(d)})" for d in others)
    return f" Decided by a test that is not drawn here: {'; '.join(named)}." if named else ""


def write_diagnosis_report(
    path: Path,
    config: DiagnosisConfig,
    runs: Sequence[RunDiagnosis],
    sections: Sequence[RunSection],
    command: str = "",
    interrupted: bool = False,
) -> None:
    """Write the report of the finished runs of a diagnosis, whose traces are not needed."""
    name = config.dataset.path.resolve().name
    order = {run.name: k for k, run in enumerate(sorted(runs, key=_worst))}
    runs = sorted(runs, key=lambda run: order[run.name])
    sections = sorted(sections, key=lambda section: order[section.name])
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
        found=_found(runs),
        overview=_overview(runs, sections),
        sections=sections,
        command=command,
        model_file=config.machine.constants.file,
        has_thresholds=config.thresholds is not None,
    )


def _worst(run: RunDiagnosis) -> float:
    """Rank of a run by its worst diagnosis, those without any last."""
    return min((severity(d) for d in run.diagnoses), default=math.inf)


def _found(runs: Sequence[RunDiagnosis]) -> Table | None:
    """Return what was found in how many runs, worst first; None if there is only one run."""
    if len(runs) < 2:
        return None
    concerned: dict[str, list[str]] = {}
    ranks: dict[str, float] = {}
    for run in runs:
        for d in run.diagnoses:
            words = describe_kind(d)
            names = concerned.setdefault(words, [])
            ranks[words] = min(ranks.get(words, math.inf), severity(d))
            if run.name not in names:
                names.append(run.name)
    kinds = sorted(concerned, key=lambda words: (ranks[words], -len(concerned[words])))
    rows = [
        (_finding(words, runs), _share(len(concerned[words]), len(runs)), _names(concerned[words]))
        for words in kinds
    ]
    unfit = [run for run in runs if run.does_not_fit is not None]
    healthy = [run for run in runs if not run.diagnoses and run.judged > 0.0 and run.does_not_fit is None]
    empty = [run for run in runs if run.judged <= 0.0]
    for words, some in ((UNFIT, unfit), (NOTHING_FOUND, healthy), ("no usable samples", empty)):
        if some:
            names = [run.name for run in some]
            rows.append((_finding(words, runs), _share(len(some), len(runs)), _names(names)))
    return table(rows, ("found", "runs", "first of them"))


def _finding(words: str, runs: Sequence[RunDiagnosis]) -> Cell:
    """Cell that shows only its runs when it is clicked, where the page has a search field."""
    return Cell(words, find=words if len(runs) > FEW_RUNS else "")


def _share(count: int, runs: int) -> Cell:
    return number(f"{count} of {runs}")


def _names(names: Sequence[str]) -> str:
    return ", ".join(names[:_NAMED]) + (", …" if len(names) > _NAMED else "")


def _overview(runs: Sequence[RunDiagnosis], sections: Sequence[RunSection]) -> Table:
    rows: list[tuple[str, tuple[Any, ...]]] = []
    for run in runs:
        unjudged = number(f"{run.cannot_judge:.1f} s")
        if not run.diagnoses:
            rows.append((run.name, (describe_undiagnosed(run), "–", "–", "–", unjudged)))
        rows += [(run.name, (*_row(d), unjudged)) for d in run.diagnoses]
    head = ("run", "diagnosis", "time", "confidence", "decided by", "not judged")
    return run_table(rows, head, sections)
