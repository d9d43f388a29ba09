"""Results of a tuning as text: the gains file for `omnimj run --gains`, and rows of tables."""

from __future__ import annotations

import json
from collections.abc import Iterator

import omnimj
from omnimj.control.gains import GAIN_NAMES, GAIN_TABLES, PROVENANCE_TABLE, unit_of
from omnimj.recording.write_dataset import toml_text
from omnimj.studies.tuning.cost import TERMS, Score
from omnimj.studies.tuning.study import Comparison, TuningResult


def format_gains_file(outcome: TuningResult, command: str) -> str:
    """Format the gains file; the same trials and command give the same text."""
    return "\n".join((*_head(outcome), *_gains(outcome), *_origin(outcome, command))) + "\n"


def _head(outcome: TuningResult) -> Iterator[str]:
    yield "# Gains of cascade, recovery and observer: omnimj run SCENARIO --gains THIS_FILE"
    if not outcome.is_better:
        yield "# NOT BETTER than the gains before on the judging seeds: see [tuned]."
    yield ""


def _gains(outcome: TuningResult) -> Iterator[str]:
    """Yield the tuned gains, and those before that differ from the model's."""
    tuned = {axis.name: axis for axis in outcome.axes}
    listed = [name for name in GAIN_NAMES if name in tuned or name in outcome.config.changed]
    for table in GAIN_TABLES:
        own = [name for name in listed if name.startswith(f"{table}.")]
        if own:
            yield f"[{table}]"
        for name in own:
            value = outcome.gains.value(name)
            source = "tuned" if name in tuned else "chosen"
            entry = f'{{ value = {value!r}, unit = "{unit_of(name)}", source = "{source}" }}'
            words = f"before: {tuned[name].start:g}" if name in tuned else "as before, not searched"
            yield f"{name.partition('.')[2]} = {entry}  # {words}"
        if own:
            yield ""


def _origin(outcome: TuningResult, command: str) -> Iterator[str]:
    config = outcome.config
    yield f"[{PROVENANCE_TABLE}]"
    yield f"command = {toml_text(command)}"
    yield f"version = {toml_text(omnimj.__version__)}"
    yield f"scenarios = {json.dumps(list(config.scenarios), ensure_ascii=False)}"
    yield f"plant = {toml_text(config.plant)}"
    yield f"seed = {config.seed}"
    yield f"trials = {config.trials}  # per scenario and candidate"
    yield f"candidates = {len(outcome.tried)}"
    yield f"saturation_limit = {config.limits.saturation!r}  # s"
    yield f"phase_margin_limit = {config.limits.phase_margin!r}  # degrees"
    yield f"overshoot_limit = {config.limits.overshoot!r}"
    yield f"better = {str(outcome.is_better).lower()}"
    for verdict in outcome.comparisons:
        yield ""
        yield f"[{PROVENANCE_TABLE}.judged_on_{verdict.plant}]"
        yield f"seed = {verdict.seed}"
        yield f"draws = {verdict.draws}"
        yield f"better = {str(verdict.is_better).lower()}"
        for when, found in (("before", verdict.before), ("after", verdict.after)):
            yield f"cost_{when} = {_number(found.cost)}"
            yield f"violation_{when} = {_number(found.violation)}"
            yield f"false_alarms_{when} = {found.false_alarms}"
            yield f"missed_{when} = {found.missed}"
            yield f"phase_margin_{when} = {_number(found.loops.phase)}  # degrees"
            yield f"overshoot_{when} = {_number(found.loops.overshoot)}"


def _number(value: float) -> str:
    return repr(float(f"{value:.6g}"))


def comparison_rows(verdict: Comparison) -> list[tuple[str, str, str]]:
    """Return rows with cost, its terms and limited quantities before and after, on the judging seeds."""
    before, after = verdict.before, verdict.after
    rows = [("cost", _cost_number(before.cost), _cost_number(after.cost))]
    for name, term in TERMS.items():
        label = f"{name.replace('_', ' ')} ({term.group}, weight {term.weight:g})"
        rows.append((label, _cost_number(before.terms[name]), _cost_number(after.terms[name])))
    for label, of in (
        ("false alarms", lambda s: str(s.false_alarms)),
        ("faults not found", lambda s: str(s.missed)),
        ("longest at the current limit", lambda s: f"{s.saturation:.3f} s"),
        ("smallest phase margin", lambda s: f"{s.loops.phase:.1f}°"),
        ("largest overshoot", lambda s: f"{100.0 * s.loops.overshoot:.0f} %"),
        ("runs that failed", lambda s: str(s.broke)),
    ):
        rows.append((label, of(before), of(after)))
    return rows


def format_verdict(outcome: TuningResult) -> str:
    """State in one sentence whether the tuned gains are better, and where not."""
    if outcome.is_better:
        return "better than the gains before on the judging seeds"
    if all(axis.start == value for axis, value in zip(outcome.axes, outcome.values, strict=True)):
        return "NOT BETTER than the gains before: no better candidate was found, they are unchanged"
    places = [f"{v.plant} ({_why(v.before, v.after)})" for v in outcome.comparisons if not v.is_better]
    return f"NOT BETTER than the gains before on the judging seeds: {', '.join(places)}"


def _why(before: Score, after: Score) -> str:
    if after.violation > before.violation:
        return "they violate limits" if before.violation == 0.0 else "they violate limits by more"
    return f"cost {after.cost:.4g} instead of {before.cost:.4g}"


def _cost_number(value: float) -> str:
    return f"{value:.4f}"
