"""Tables of the gap report; all their numbers are also in `gap.json`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from omnimj.effects import Interval
from omnimj.estimate.gap.records import (
    Finding,
    NamedEffect,
    RunGap,
    Stage,
    has_second_model,
)
from omnimj.estimate.gap.sentences import format_amount, format_number, format_percent, variable_words
from omnimj.view.plots.mismatch import either_sign
from omnimj.view.report.page import Cell, RunSection, Table, number, run_table, table

_BOUND_DIGITS = 4
_UNITS = {
    "current": "A",
    "mass": "kg",
    "payload": "kg",
    "lateral_speed": "m/s",
    "speed": "m/s",
    "duration": "s",
    "force": "N",
}


def mismatch_locations(finding: Finding) -> Table:
    """List regimes of mismatch: share, channel, regime in words and as bounds, RMS before and after."""
    second = any(place.after is not None for place in finding.where)
    rows = []
    for k, place in enumerate(finding.where, start=1):
        unit, words = finding.channels.get(place.channel, ("", place.channel))
        bounds = "; ".join(
            format_bounds(name, *limits, finding.regimes.get(name, ""), either_sign(place, name))
            for name, limits in place.bounds.items()
        )
        bar = round(100.0 * min(max(place.share, 0.0), 1.0))
        amounts = (place.before, place.after) if second else (place.before,)
        rows.append(
            (
                k,
                Cell(format_percent(place.share), "number share", bar=bar),
                Cell(place.regime, title=words, note=bounds),
                *(number(format_amount(amount, unit)) for amount in amounts),
            )
        )
    return table(rows, ("", "share of the gap", "where", "RMS before", *(["RMS after"] if second else [])))


def format_bounds(name: str, low: float, high: float, unit: str, is_size: bool = False) -> str:
    """Format an interval, `is_size` of a magnitude, as `0.25 ≤ position < 0.35 m`, without infinite ends."""
    variable = f"|{variable_words(name)}|" if is_size else variable_words(name)
    if is_size and low < 1e-6 * high:
        low = -math.inf  # zero is no bound of an absolute value
    below, above = low == -math.inf, high == math.inf
    if below and above:
        return f"any {variable}"
    if above:
        return f"{variable} ≥ {format_amount(low, unit, _BOUND_DIGITS)}"
    if below:
        return f"{variable} < {format_amount(high, unit, _BOUND_DIGITS)}"
    return f"{format_number(low, _BOUND_DIGITS)} ≤ {variable} < {format_amount(high, unit, _BOUND_DIGITS)}"


def run_mismatches(finding: Finding, gaps: Sequence[RunGap], sections: Sequence[RunSection]) -> Table:
    """List all runs, the largest mismatch first: use, conditions, and RMS over all channels."""
    second = has_second_model(finding)
    rows = [
        (
            gap.run,
            (
                describe_use(gap),
                format_conditions(gap.conditions),
                number(format_amount(gap.total_before, "1")),
                *([number(format_amount(gap.total_after, "1"))] if second else []),
            ),
        )
        for gap in gaps
    ]
    amounts = ("mismatch before", "after") if second else ("mismatch",)
    return run_table(rows, ("run", "use", "conditions", *amounts), sections)


def describe_use(gap: RunGap) -> str:
    """State whether a run was held out or fitted."""
    if gap.partly:
        return "held out in part"
    return "held out" if gap.heldout else "training"


def format_conditions(values: Mapping[str, float | str]) -> str:
    """Format the conditions of a run as `current 0.9 A, floor natural stone`."""
    words = (f"{name.replace('_', ' ')} {format_setting(name, value)}" for name, value in values.items())
    return ", ".join(words) or "–"


def format_setting(name: str, value: object) -> str:
    """Format a setting of a run: a number with the unit known from its name, or a word."""
    if isinstance(value, bool) or not isinstance(value, float | int):
        return str(value).replace("_", " ")
    return format_amount(value, _UNITS.get(name, ""), 5)


def fitted_parameters(effect: NamedEffect) -> Table:
    """List the parameters of an effect with their 90 % intervals."""
    rows = [
        (
            name.replace("_", " "),
            number(format_amount(value.value, value.unit, digits_for_interval(value))),
            number(format_interval(value)),
        )
        for name, value in effect.parameters.items()
    ]
    return table(rows, ("parameter", "fitted", "90 % interval"))


def digits_for_interval(value: Interval) -> int:
    """Return the number of digits, 3 to 7, that resolves the width of an interval to two digits."""
    if value.low is None or value.high is None or not value.low < value.high:
        return 3
    size = max(abs(value.value), abs(value.low), abs(value.high))
    return min(max(math.ceil(math.log10(size / (value.high - value.low))) + 2, 3), 7)


def format_interval(value: Interval) -> str:
    """Format an interval as `0.71 to 1.12`; a dash without bounds."""
    if value.low is None and value.high is None:
        return "–"
    digits = digits_for_interval(value)
    low, high = ("unbounded" if x is None else format_number(x, digits) for x in (value.low, value.high))
    return f"{low} to {high}"


def refitted_parameters(finding: Finding) -> Table:
    """List the refitted parameters, which the model declares as uncertain."""
    rows = []
    for p in finding.refitted:
        note = "at the edge of its box" if p.at_bound else ""
        if p.stated_by:
            note = f"{p.stated_by} states the whole deviation"
        stated = number(f"{format_number(p.low, 4)} to {format_number(p.high, 4)}")
        fitted = number(format_amount(p.fitted, p.unit, 4), note)
        rows.append((p.name, number(format_amount(p.nominal, p.unit, 4)), stated, fitted))
    return table(rows, ("parameter", "in the model", "stated uncertainty", "refitted"))


def channel_mismatches(finding: Finding) -> Table:
    """List RMS mismatch by channel on held-out and training runs, before and after, with floor and noise."""
    second = has_second_model(finding)
    rows = []
    for name, (unit, words) in finding.channels.items():
        heldout, train = finding.heldout.get(name), finding.train.get(name)
        amounts = []
        for gap in (heldout, train):
            amounts += [gap and gap.before, gap and gap.after][: 1 + second]
        amounts += [heldout and heldout.floor, finding.noise.get(name)]
        rows.append((words, *(number(format_amount(amount, unit)) for amount in amounts)))
    pair = ["held out: before", "after"] if second else ["held out"]
    other = ["training: before", "after"] if second else ["training"]
    return table(rows, ("channel", *pair, *other, "between repeats", "noise"))


def candidate_gains(stage: Stage) -> Table:
    """List all candidate effects of one round: upper limit from screening, held-out gain, verdict."""
    rows = [
        (
            f"{c.label}{' · sensor' if c.is_sensor else ''}",
            number(format_percent(c.screened)),
            number("–" if c.gain is None else format_percent(c.gain.value)),
            number("–" if c.gain is None else format_percent_interval(c.gain)),
            c.verdict,
        )
        for c in stage.candidates
    ]
    return table(rows, ("candidate", "could explain at best", "held-out gain", "90 % interval", "verdict"))


def format_percent_interval(gain: Interval) -> str:
    """Format an interval of shares as `74 % to 83 %`; a dash without bounds."""
    if gain.low is None or gain.high is None:
        return "–"
    return f"{format_percent(gain.low)} to {format_percent(gain.high)}"


def rival_separation(distances: object) -> Table | None:
    """List distances between predictions of rival effects for the next run, in multiples of the noise."""
    if isinstance(distances, float | int):
        distances = {"the rivals": distances}
    if not isinstance(distances, Mapping) or not distances:
        return None
    rows = [(name, number(format_amount(distance, "1"))) for name, distance in distances.items()]
    return table(rows, ("rival", "distance of its prediction [multiples of the noise]"))


def experiment_settings(values: Mapping[str, object]) -> Table:
    """List the settings of the next run."""
    return table(
        [(name.replace("_", " "), number(format_setting(name, value))) for name, value in values.items()]
    )
