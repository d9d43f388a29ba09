"""`report.html` of an evaluation (tables, plots, cases), of the gap benchmark or of the scoreboard."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from omnimj.studies.evaluation.scoring import AMBIGUOUS, CaseEvents, CaseScore
from omnimj.studies.evaluation.study import EvaluationResult
from omnimj.studies.random_truth import NONE
from omnimj.studies.statistics import Table as TextTable
from omnimj.view import wording
from omnimj.view.plots.diagnosis import event_lanes
from omnimj.view.plots.evaluation import confusion_picture, delay_curves, headings, paths, with_and_without
from omnimj.view.report.page import (
    MOST_FIGURES,
    Figure,
    RunSection,
    Table,
    number,
    run_key,
    run_table,
    table,
    write_page,
)

_HEAD = ("case", "suite", "floor", "speed", "plant", "truth", "diagnosed", "outcome")
_DELAYS = ("delay since onset", "in use")
_OUTCOMES = ("missed", "wrong", AMBIGUOUS, "false alarm", "isolated", "no alarm")
"""Outcomes, those to look at first in front."""


def write_evaluation_report(path: Path, result: EvaluationResult) -> None:
    """Write the report of an evaluation."""
    sections = case_sections(result.scores, result.events, result.suite)
    write_page(
        path,
        "evaluation",
        plain_text(result.heading),
        lines=list(map(plain_text, result.lines)),
        tables=_titled(result.tables),
        files="evaluation.json and cases/",
        figures=evaluation_figures(result),
        cases=case_table(result.scores, result.suite, sections) if result.scores else None,
        sections=sections,
    )


def write_tables_report(
    path: Path, heading: str, lines: Sequence[str], tables: Sequence[TextTable], files: str
) -> None:
    """Write the report of the gap benchmark or of the scoreboard: paragraphs, then tables that are not empty.

    `files` names the files with all numbers.
    """
    write_page(
        path,
        "evaluation",
        heading,
        lines=list(map(plain_text, lines)),
        tables=_titled([one for one in tables if one.rows]),
        files=files,
        figures=[],
        cases=None,
        sections=[],
    )


def _titled(tables: Sequence[TextTable]) -> list[tuple[str, Table]]:
    return [(plain_text(one.title), table(one.rows, one.head)) for one in tables]


def plain_text(line: str) -> str:
    """Remove the marks of Markdown from a line."""
    return line.replace("**", "").replace("`", "")


def evaluation_figures(result: EvaluationResult) -> list[list[Figure]]:
    """Return rows of figures: confusion matrix, delays, excursions."""
    if not result.scores:
        return []
    words = "rows: truth; shades: share of its cases; numbers: cases; green boxes: correct diagnoses"
    drawing = confusion_picture(result.summary.confusion)
    rows = [[Figure(drawing, "confusion", "Confusion matrix", words, "broad")]]
    faulty = [score for score in result.scores if score.fault != NONE]
    if any(score.was_in_use for score in faulty):
        words = "share of cases with an alarm within that time"
        rows.append(
            [
                Figure(delay_curves(faulty, in_use), f"delay-{in_use:d}", f"Delay since {since}", words)
                for in_use, since in ((False, "onset"), (True, "first use"))
            ]
        )
    if any(score.heading_off is not None for score in faulty):
        words = "below the dashed line recovery helps"
        rows.append(
            [
                Figure(
                    with_and_without(faulty, excursion, f"{name} excursion [{unit}]"),
                    name,
                    f"{name.capitalize()} excursion",
                    words,
                )
                for excursion, name, unit in ((headings, "heading", "°"), (paths, "path", "m"))
            ]
        )
    return rows


def outcome_of(score: CaseScore) -> str:
    """Return the outcome of a case in words: one of `_OUTCOMES`, possibly with false alarms."""
    if score.fault == NONE:
        return "false alarm" if score.false_alarms else "no alarm"
    if score.isolated:
        found = "isolated"
    elif score.diagnosed == NONE:
        found = "missed"
    else:
        found = AMBIGUOUS if score.diagnosed == AMBIGUOUS else "wrong"
    early = " after a false alarm" if score.early_alarms else ""
    unused = "" if score.was_in_use else ", not in use"
    return f"{found}{early}{unused}"


def case_table(scores: Sequence[CaseScore], suite: str, sections: Sequence[RunSection]) -> Table:
    """List all cases: conditions, truth, diagnosis, outcome, delays."""
    rows = []
    for score in scores:
        where = suite, _words(score.floor), score.speed, score.plant
        delays = (_delay(score.delay, score), _delay(score.delay_in_use, score))
        truth = _truth(score)
        rows.append(
            (score.name, (*where, truth, _words(score.diagnosed), outcome_of(score), *map(number, delays)))
        )
    return run_table(rows, _HEAD + _DELAYS, sections)


def case_sections(
    scores: Sequence[CaseScore], events: Mapping[str, CaseEvents], suite: str
) -> list[RunSection]:
    """Make the parts of the page about the cases to look at first: those with a wrong outcome."""
    known = [score for score in scores if score.name in events]
    return [_section(s, events[s.name], suite) for s in sorted(known, key=_urgency)[:MOST_FIGURES]]


def _urgency(score: CaseScore) -> tuple[bool, int]:
    """Sort key: a part in use first, then by outcome."""
    outcome = outcome_of(score)
    unused = score.fault != NONE and not score.was_in_use
    return unused, next(k for k, name in enumerate(_OUTCOMES) if outcome.startswith(name))


def _section(score: CaseScore, events: CaseEvents, suite: str) -> RunSection:
    found = "" if score.isolated or score.diagnosed == NONE else f", diagnosed {_words(score.diagnosed)}"
    note = f"{outcome_of(score)}: {_truth(score)}{found}"
    facts = _facts(score, events, suite)
    return RunSection(score.name, [_figure(score, events)], note, table=facts)


def _figure(score: CaseScore, events: CaseEvents) -> Figure:
    metrics = {"faults": events.faults, "diagnoses": events.diagnoses}
    truth = wording.fault_spans(metrics, events.duration)
    diagnosed = wording.diagnosis_spans(metrics, events.duration)
    name = run_key(score.name).replace("run-", "events-", 1)
    words = "Shaded: a fault is present." if truth else "There is no fault."
    return Figure(event_lanes(events.duration, truth, diagnosed), name, "Truth and diagnosis", words)


def _facts(score: CaseScore, events: CaseEvents, suite: str) -> Table:
    """List conditions, faults, delays and excursions."""
    conditions = (
        f"{suite}, {score.speed} speed, {score.plant} plant, floor {_words(score.floor)}, "
        f"payload {100.0 * score.payload:+.0f} % of the mass"
    )
    rows = [("conditions", conditions)]
    for fault in events.faults:
        numbers = {key: value for key, value in fault.items() if key != "channel"}
        rows.append((wording.fault_name(fault), wording.fault_details(numbers) or "–"))
    if events.faults:
        rows.append(("first alarm after onset", _delay(score.delay, score)))
        rows.append(("first alarm after first use", _delay(score.delay_in_use, score)))
    for name, found, without, unit, scale in (
        ("heading excursion", score.heading, score.heading_off, "°", math.degrees(1.0)),
        ("path excursion", score.path, score.path_off, " m", 1.0),
    ):
        if found is not None and without is not None:
            words = f"{wording.number(scale * found, 3)}{unit}, {wording.number(scale * without, 3)}{unit}"
            rows.append((f"{name} with recovery, and without", words))
    return table(rows)


def _truth(score: CaseScore) -> str:
    """Name the true faults of a case: `motor 3`, `slip 1 and motor 2`, `none`."""
    labels = " and ".join(fault.label for fault in score.faults) or score.truth
    return _words(labels)


def _delay(value: float | None, score: CaseScore) -> str:
    if score.fault == NONE or value is None:
        return "–"
    return "never" if math.isinf(value) else f"{value:.2f} s"


def _words(name: str) -> str:
    return name.replace("_", " ")
