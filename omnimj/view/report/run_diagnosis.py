"""Diagnosis section of the report of a run: true faults beside diagnoses, and supporting plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omnimj.signals import Trace
from omnimj.simulate.judging import DiagnosisGroup, DiagnosisMatching, FaultMatch, match_diagnoses
from omnimj.simulate.scenario.scenario import Scenario
from omnimj.view import wording
from omnimj.view.diagnosis_words import FULL
from omnimj.view.plots import diagnosis as plots
from omnimj.view.report.page import Cell, Figure, Table, table
from omnimj.view.residuals import families
from omnimj.view.wording import Span

_HEAD = ("fault", "from – to", "diagnosed", "at", "delay", "confidence", "could also be", "cleared")
_NUMBERS = ("from – to", "at", "delay", "cleared")
_UNKNOWN = "The true faults of a robot on a link are unknown; the table lists the diagnoses of the method."


@dataclass(frozen=True)
class DiagnosisSection:
    """Content of the diagnosis section."""

    verdict: str
    table: Table | None
    figures: list[Figure]


def diagnosis_section(
    trace: Trace, scenario: Scenario, metrics: Mapping[str, Any], spans: Sequence[Span]
) -> DiagnosisSection:
    """Compare the true faults of a run with its diagnoses."""
    wheels = scenario.constants.wheel_count
    matching = match_diagnoses(metrics.get("faults") or (), metrics.get("diagnoses") or (), wheels)
    has_truth = bool(metrics.get("truth", True))
    verdict = _verdict(metrics, matching) if has_truth else _UNKNOWN
    return DiagnosisSection(verdict, _table(matching, has_truth), _figures(trace, scenario, metrics, spans))


def _verdict(metrics: Mapping[str, Any], matching: DiagnosisMatching) -> str:
    """Summarise detection, isolation and false alarms in sentences."""
    faults = [match for match in matching.pairs if match.is_diagnosable]
    alarms = sum(len(group.diagnoses) for group in matching.false_alarms)
    false = f"{alarms} false alarm{'s' if alarms > 1 else ''}"
    if not faults:
        if not alarms:
            return "There was no fault that the method can diagnose, and nothing was diagnosed."
        return f"There was no fault that the method can diagnose, but {false}."
    if not metrics.get("diagnoses"):
        held = "A fault held" if len(faults) == 1 else f"{len(faults)} faults held"
        return f"{held}, and nothing was diagnosed."
    isolated = sum(bool(match.groups) for match in faults)
    sentences = []
    if metrics.get("detection_delay") is not None:
        sentences.append(
            f"First alarm {wording.number(metrics['detection_delay'], 3)} s after the first onset."
        )
    if len(faults) == 1:
        sentences.append("The fault was diagnosed." if isolated else "The fault was not diagnosed.")
    else:
        sentences.append(f"{isolated} of {len(faults)} faults were diagnosed.")
    if isolated == len(faults) and metrics.get("isolated") is not None:
        alone = "and isolated" if metrics["isolated"] else "but not isolated"
        sentences[-1] = f"{sentences[-1][:-1]} {alone}."
    sentences.append(f"{false[0].upper()}{false[1:]}." if alarms else "No false alarm.")
    return " ".join(sentences)


def _table(matching: DiagnosisMatching, has_truth: bool) -> Table | None:
    rows = [
        _row(match, k, group) for match in matching.pairs for k, group in enumerate(match.groups or (None,))
    ]
    truth, delay = ("–", "false alarm") if has_truth else ("unknown", "–")
    rows += [(truth, "", *_format_group(group, delay)) for group in matching.false_alarms]
    if not rows:
        return None
    return table([list(map(_cell, _HEAD, row)) for row in rows], _HEAD, "stacked")


def _cell(head: str, text: str) -> Cell:
    is_empty = text in ("", "–") or (head, text) == ("could also be", "nothing")
    kinds = ["number"] * (head in _NUMBERS) + ["none"] * is_empty
    return Cell(text, " ".join(kinds))


def _row(match: FaultMatch, k: int, group: DiagnosisGroup | None) -> tuple[str, ...]:
    """Return a table row: a fault and the k-th group of its diagnoses; only row 0 describes the fault."""
    fault, end = match.fault, match.fault.get("end")
    truth, held = "as above", ""
    if k == 0:
        details = wording.fault_details({key: v for key, v in fault.items() if key != "channel"})
        truth = f"{wording.fault_name(fault)}{f' ({details})' if details else ''}"
        until = "end" if end is None else f"{end:g} s"
        held = "never" if fault["onset"] is None else f"{fault['onset']:g} s – {until}"
    if group is None:
        missed = "nothing" if match.is_diagnosable else "outside the method's fault classes"
        return truth, held, missed, "–", "–", "–", "–", "–"
    return truth, held, *_format_group(group, f"{wording.number(group.delay, 3)} s")


def _format_group(group: DiagnosisGroup, delay: str) -> tuple[str, ...]:
    first, last, times = group.first, group.last, len(group.diagnoses)
    name = wording.fault_name(last)
    left = last.get("effectiveness")
    if last.get("test") == "friction":
        name = name.replace(wording.FAULT_NAMES["motor"], "wheel braked")
    elif left is not None:
        name += ", no loss left" if left >= FULL else f", {100.0 * left:.0f} % left"
    if times > 1:
        name += f" ({times} times)"
    other = ", ".join(wording.ambiguity_name(text) for text in last.get("ambiguous_with") or ()) or "nothing"
    confidence = last.get("confidence")
    return (
        name,
        f"{first['time']:.3f} s",
        delay,
        "–" if confidence is None else f"{100.0 * confidence:.3g} %",
        other,
        "not cleared" if group.cleared is None else f"{group.cleared:.3f} s",
    )


def _figures(
    trace: Trace, scenario: Scenario, metrics: Mapping[str, Any], spans: Sequence[Span]
) -> list[Figure]:
    method, is_rig = str(metrics["method"]), scenario.is_rig
    diagnosed = wording.diagnosis_spans(metrics, float(trace["time"][-1]))
    figures = []
    if spans or diagnosed or "mode" in trace:
        words = "True faults, diagnoses, and the mode of the method."
        drawing = plots.state_lanes(trace, spans, diagnosed, method, is_rig)
        figures.append(Figure(drawing, "states", "Truth and diagnosis", words))
    shaded = " Shaded: a fault is present." if spans else ""
    for family in families(list(trace.columns), method, scenario.diagnosis.printed):
        drawing = plots.residual_families(trace, [family], spans)
        words = f"{family.words}{shaded}".strip()
        figures.append(Figure(drawing, f"residual-{family.name}", family.heading, words))
    if "effectiveness_1" in trace:
        words = f"Estimated effectiveness of each wheel's drive; 1 is healthy.{shaded}"
        drawing = plots.effectiveness(trace, spans)
        figures.append(Figure(drawing, "effectiveness", "Effectiveness", words))
    return figures
