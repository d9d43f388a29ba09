"""The tables of the gap report; every number in them is in `gap.json`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from omnimj.estimate.gap.records import (
    ChannelGap,
    Finding,
    Interval,
    MismatchRegime,
    NamedEffect,
    RunGap,
    Stage,
    has_second_model,
)
from omnimj.estimate.gap.sentences import format_amount, format_number, format_percent, variable_words
from omnimj.view.report import page

_RUNS = 10
_BOUND = 4  # digits
_UNITS = {
    "current": "A",
    "mass": "kg",
    "payload": "kg",
    "lateral_speed": "m/s",
    "speed": "m/s",
    "duration": "s",
    "force": "N",
}


def mismatch_locations(finding: Finding) -> str:
    """Share, channel and regime in words and as bounds, RMS before and after."""
    second = any(place.after is not None for place in finding.where)
    rows = []
    for k, place in enumerate(finding.where, start=1):
        unit, words = finding.channels.get(place.channel, ("", place.channel))
        rows.append(
            [
                page.cell(f"{k}"),
                share_bar(place.share),
                f"<td><b>{page.text(words)}</b><br>{page.text(place.regime)}{_bounds(finding, place)}</td>",
                page.cell(format_amount(place.before, unit), "number"),
                *([page.cell(format_amount(place.after, unit), "number")] if second else []),
            ]
        )
    head = ["", "share of the gap", "where", "RMS before", *(["RMS after"] if second else [])]
    return page.table(rows, head)


def share_bar(share: float) -> str:
    """A cell with a share as a number and as a bar."""
    width = 100.0 * min(max(share, 0.0), 1.0)
    return f"<td class='number share'>{format_percent(share)}<i style='width:{width:.0f}%'></i></td>"


def _bounds(finding: Finding, place: MismatchRegime) -> str:
    words = "; ".join(
        format_bounds(name, *limits, finding.regimes.get(name, ""), either_sign(place, name))
        for name, limits in place.bounds.items()
    )
    return f"<small>{page.text(words)}</small>" if words else ""


def either_sign(place: MismatchRegime, variable: str) -> bool:
    """Whether the place's bounds hold for the size of a variable: its words then say `(either sign)`."""
    return place.bounds[variable][0] >= 0.0 and f"{variable_words(variable)} (either sign)" in place.regime


def format_bounds(name: str, low: float, high: float, unit: str, is_size: bool = False) -> str:
    """`0.25 ≤ position < 0.35 m`; an open side is left out."""
    variable = f"|{variable_words(name)}|" if is_size else variable_words(name)
    if is_size and low < 1e-6 * high:
        low = -float("inf")  # no size lies below
    below, above = low == -float("inf"), high == float("inf")
    if below and above:
        return f"any {variable}"
    if above:
        return f"{variable} ≥ {format_amount(low, unit, _BOUND)}"
    if below:
        return f"{variable} < {format_amount(high, unit, _BOUND)}"
    return f"{format_number(low, _BOUND)} ≤ {variable} < {format_amount(high, unit, _BOUND)}"


def worst_runs(finding: Finding, gaps: Sequence[RunGap]) -> str:
    """The runs with the largest mismatch: conditions, and RMS per channel."""
    second = has_second_model(finding)
    rows = [
        [
            page.cell(f"{gap.run}{held_out_suffix(gap)}"),
            page.cell(format_conditions(gap.conditions)),
            page.cell(format_amount(gap.total_before, "1"), "number"),
            *([page.cell(format_amount(gap.total_after, "1"), "number")] if second else []),
        ]
        for gap in gaps[:_RUNS]
    ]
    head = ["run", "driven with", "mismatch before", *(["after"] if second else [])]
    return page.table(rows, head)


def held_out_suffix(gap: RunGap) -> str:
    """What stands behind the name of a run that was held out, or parts of it."""
    if gap.partly:
        return " · held out in part"
    return " · held out" if gap.heldout else ""


def format_conditions(values: Mapping[str, float | str]) -> str:
    """`current 0.9 A, floor natural stone`."""
    return (
        ", ".join(f"{name.replace('_', ' ')} {format_setting(name, value)}" for name, value in values.items())
        or "–"
    )


def format_setting(name: str, value: object) -> str:
    """One number of a run with the unit that its name has, or a word."""
    if isinstance(value, bool) or not isinstance(value, float | int):
        return str(value).replace("_", " ")
    return format_amount(value, _UNITS.get(name, ""), 5)


def fitted_parameters(effect: NamedEffect) -> str:
    """Each parameter with its 90 % interval."""
    rows = []
    for name, value in effect.parameters.items():
        rows.append(
            [
                page.cell(name.replace("_", " ")),
                page.cell(format_amount(value.value, value.unit, digits_for_interval(value)), "number"),
                page.cell(format_interval(value), "number"),
            ]
        )
    return page.table(rows, ("parameter", "fitted", "90 % interval"))


def digits_for_interval(value: Interval) -> int:
    """Digits that show the interval in two figures: 3 at least, 7 at most."""
    if value.low is None or value.high is None or not value.low < value.high:
        return 3
    size = max(abs(value.value), abs(value.low), abs(value.high))
    return min(max(math.ceil(math.log10(size / (value.high - value.low))) + 2, 3), 7)


def format_interval(value: Interval) -> str:
    """`0.71 to 1.12`, a dash where no bound is known."""
    if value.low is None and value.high is None:
        return "–"
    low = "unbounded" if value.low is None else format_number(value.low, digits_for_interval(value))
    high = "unbounded" if value.high is None else format_number(value.high, digits_for_interval(value))
    return f"{low} to {high}"


def refitted_parameters(finding: Finding) -> str:
    """The parameters that were declared uncertain."""
    rows = [
        [
            page.cell(p.name),
            page.cell(format_amount(p.nominal, p.unit, 4), "number"),
            page.cell(f"{format_number(p.low, 4)} to {format_number(p.high, 4)}", "number"),
            f"<td class='number'>{page.text(format_amount(p.fitted, p.unit, 4))}{_side(p.at_bound)}</td>",
        ]
        for p in finding.refitted
    ]
    return page.table(rows, ("parameter", "in the model", "stated uncertainty", "refitted"))


def _side(at_bound: bool) -> str:
    return "<small>at the side of its box</small>" if at_bound else ""


def channel_mismatches(finding: Finding) -> str:
    """RMS of every channel, held-out runs and training runs, before, after, floor and noise."""
    rows = []
    for name, (unit, words) in finding.channels.items():
        row = [page.cell(words)]
        for group in (finding.heldout, finding.train):
            row += _before_after(group.get(name), unit, has_second_model(finding))
        gap = finding.heldout.get(name)
        row.append(page.cell(format_amount(None if gap is None else gap.floor, unit), "number"))
        row.append(page.cell(format_amount(finding.noise.get(name), unit), "number"))
        rows.append(row)
    pair = ["held out: before", "after"] if has_second_model(finding) else ["held out"]
    other = ["training: before", "after"] if has_second_model(finding) else ["training"]
    return page.table(rows, ["channel", *pair, *other, "between repeats", "noise"])


def _before_after(gap: ChannelGap | None, unit: str, second: bool) -> list[str]:
    if gap is None:
        return [page.cell("–", "number")] * (1 + second)
    cells = [page.cell(format_amount(gap.before, unit), "number")]
    return [*cells, page.cell(format_amount(gap.after, unit), "number")] if second else cells


def candidate_gains(stage: Stage) -> str:
    """All candidates of one round: what the screening said, the held-out gain, the verdict."""
    rows = [
        [
            page.cell(f"{c.label}{' · sensor' if c.is_sensor else ''}"),
            page.cell(format_percent(c.screened), "number"),
            page.cell("–" if c.gain is None else format_percent(c.gain.value), "number"),
            page.cell("–" if c.gain is None else format_percent_interval(c.gain), "number"),
            page.cell(c.verdict),
        ]
        for c in stage.candidates
    ]
    return page.table(rows, ("candidate", "could explain at best", "held-out gain", "90 % interval", ""))


def format_percent_interval(gain: Interval) -> str:
    """`74 % to 83 %`."""
    if gain.low is None or gain.high is None:
        return "–"
    return f"{format_percent(gain.low)} to {format_percent(gain.high)}"


def rival_separation(distances: object) -> str:
    """How far the rivals' predictions part in the run to drive, in units of noise."""
    if isinstance(distances, float | int):
        distances = {"the rivals": distances}
    if not isinstance(distances, Mapping) or not distances:
        return ""
    rows = [
        [page.cell(name), page.cell(format_amount(far, "1"), "number")] for name, far in distances.items()
    ]
    return page.table(rows, ("rival", "its prediction parts by [multiples of the noise]"))


def experiment_settings(values: Mapping[str, object]) -> str:
    """What to drive, a row per number."""
    return page.table(
        [
            (page.text(name.replace("_", " ")), page.cell(format_setting(name, value), "number"))
            for name, value in values.items()
        ]
    )
