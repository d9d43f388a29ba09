"""The part of a run's report that says what was diagnosed: truth beside diagnosis, and the plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from omnimj.parameters import Rig
from omnimj.signals import Trace
from omnimj.simulate.judging import DiagnosisGroup, DiagnosisMatching, FaultMatch, match_diagnoses
from omnimj.view import wording
from omnimj.view.plots import diagnosis as plots_diagnosis
from omnimj.view.plots.drawing import svg
from omnimj.view.report import page
from omnimj.view.residuals import families
from omnimj.view.wording import ScenarioLike, Span

HEADING = "What was diagnosed"
_HEAD = ("what was wrong", "from – to", "diagnosed", "at", "after", "how sure", "could also be", "cleared")
_UNKNOWN = "Nobody knows what was wrong with a robot behind a wire; what follows is what the method says."


def diagnosis_section(
    trace: Trace, scenario: ScenarioLike, metrics: Mapping[str, Any], spans: Sequence[Span]
) -> str:
    """Truth beside diagnosis, and the plots behind it; empty for a run without a method.

    Args:
      trace: What was recorded.
      scenario: What was asked for.
      metrics: Content of `metrics.json`.
      spans: When faults held.
    """
    if not wording.is_diagnosed(metrics):
        return ""
    constants = scenario.constants
    wheels = 1 if isinstance(constants, Rig) else len(constants.wheels)
    pairing = match_diagnoses(metrics.get("faults") or (), metrics.get("diagnoses") or (), wheels)
    has_truth = bool(metrics.get("truth", True))
    verdict = _verdict(metrics, pairing) if has_truth else _UNKNOWN
    content = f"<p>{page.text(verdict)}</p>{_table(pairing, has_truth)}"
    figures = _figures(trace, scenario, metrics, spans)
    if figures:
        content += f"<div class='columns plots'>{''.join(figures)}</div>"
    return page.section(HEADING, content)


def _verdict(metrics: Mapping[str, Any], pairing: DiagnosisMatching) -> str:
    """In words: was there something, was it found, was it named alone, was there something false."""
    there = [one for one in pairing.pairs if one.is_diagnosable]
    alarms = sum(len(naming.diagnoses) for naming in pairing.false_alarms)
    false = f"{alarms} false alarm{'s' if alarms > 1 else ''}"
    if not there:
        words = "Nothing was wrong that a diagnosis has a name for"
        if not alarms:
            return f"{words}, and nothing was diagnosed."
        return f"{words}, but there {'were' if alarms > 1 else 'was'} {false}."
    found = sum(bool(one.groups) for one in there)
    delay = metrics.get("detection_delay")
    if not metrics.get("diagnoses"):
        words = "A fault held" if len(there) == 1 else f"{len(there)} faults held"
        return f"{words}, and nothing was diagnosed."
    words = []
    if delay is not None:
        words.append(f"First alarm {wording.number(delay, 3)} s after the first onset.")
    if len(there) == 1:
        words.append("The fault was named." if found else "The fault was not named.")
    else:
        words.append(f"{found} of {len(there)} faults were named.")
    if found and metrics.get("isolated") is not None:
        soon = "and from the onset on no wrong name stood for long" if alarms else "and nothing else was"
        each = "" if len(there) == 1 else "each "
        alone = soon if metrics["isolated"] else f"but not {each}for itself alone"
        if found == len(there):
            words[-1] = f"{words[-1][:-1]}, {alone}."
    words.append(f"{false[0].upper()}{false[1:]}." if alarms else "No false alarm.")
    return " ".join(words)


def _table(pairing: DiagnosisMatching, has_truth: bool) -> str:
    rows = [_row(one, k, naming) for one in pairing.pairs for k, naming in enumerate(one.groups or (None,))]
    unnamed = ("–", "false alarm") if has_truth else ("unknown", "–")
    rows += [((unnamed[0], "", *_told(naming, unnamed[1]))) for naming in pairing.false_alarms]
    if not rows:
        return ""
    head = "".join(f"<th scope='col'>{page.text(name)}</th>" for name in _HEAD)
    body = "".join(f"<tr>{''.join(map(_cell, _HEAD, row))}</tr>" for row in rows)
    table = f"<table class='told'><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f"<div class='wide'>{table}</div>"


def _cell(head: str, words: str) -> str:
    kinds = ["number"] if head in ("from – to", "at", "after", "cleared") else []
    kinds += ["none"] if words in ("", "–") or (head, words) == ("could also be", "nothing") else []
    kind = f" class='{' '.join(kinds)}'" if kinds else ""
    return f"<td{kind} data-head='{page.text(head)}'>{page.text(words)}</td>"


def _row(one: FaultMatch, k: int, naming: DiagnosisGroup | None) -> tuple[str, ...]:
    """A fault beside its k-th name; the fault stands in its first row only."""
    fault, end = one.fault, one.fault.get("end")
    truth, held = "as above", ""
    if k == 0:
        details = wording.fault_details({key: v for key, v in fault.items() if key != "channel"})
        truth = f"{wording.fault_name(fault)}{f' ({details})' if details else ''}"
        onset = fault["onset"]
        never, until = onset is None, "end" if end is None else f"{end:g} s"
        held = "never" if never else f"{onset:g} s – {until}"
    if naming is None:
        missed = "nothing" if one.is_diagnosable else "no diagnosis has a name for it"
        return truth, held, missed, "–", "–", "–", "–", "–"
    return (truth, held, *_told(naming, f"{wording.number(naming.delay, 3)} s"))


def _told(naming: DiagnosisGroup, after: str) -> tuple[str, ...]:
    first, last, times = naming.first, naming.last, len(naming.diagnoses)
    name = wording.fault_name(last)
    if last.get("effectiveness") is not None:
        name += f", {100.0 * last['effectiveness']:.0f} % left"
    if times > 1:
        name += f" ({times} times)"
    other = ", ".join(wording.ambiguity_name(text) for text in last.get("ambiguous_with") or ()) or "nothing"
    sure = last.get("confidence")
    return (
        name,
        f"{first['time']:.3f} s",
        after,
        "–" if sure is None else f"{100.0 * sure:.3g} %",
        other,
        "stands" if naming.cleared is None else f"{naming.cleared:.3f} s",
    )


def _figures(
    trace: Trace, scenario: ScenarioLike, metrics: Mapping[str, Any], spans: Sequence[Span]
) -> list[str]:
    method, is_rig = str(metrics["method"]), isinstance(scenario.constants, Rig)
    believed = wording.diagnosis_spans(metrics, float(trace["time"][-1]))
    drawn: list[tuple[str, str, str, Figure]] = []
    if spans or believed or "mode" in trace:
        words = "What was wrong, what the controller believed, and its mode."
        figure = plots_diagnosis.state_lanes(trace, spans, believed, method, is_rig)
        drawn.append(("states", "Truth and belief", words, figure))
    shaded = " Shaded: a fault holds." if spans else ""
    for family in families(list(trace.columns), method, scenario.diagnosis.printed):
        figure = plots_diagnosis.residual_family(trace, family, spans)
        drawn.append((f"residual-{family.name}", family.heading, f"{family.words}{shaded}".strip(), figure))
    wheels = 0
    while f"effectiveness_{wheels + 1}" in trace:
        wheels += 1
    if wheels:
        words = f"What is believed to be left of each wheel's drive; 1 is healthy.{shaded}"
        figure = plots_diagnosis.effectiveness(trace, wheels, spans)
        drawn.append(("effectiveness", "Effectiveness", words, figure))
    return [
        page.figure(svg(figure, name, page.text(heading)), heading, caption)
        for name, heading, caption, figure in drawn
    ]
