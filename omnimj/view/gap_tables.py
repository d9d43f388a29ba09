"""The tables of the gap report; every number in them is in `gap.json`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from omnimj.gap.per_run import RunGap, has_after
from omnimj.gap.records import ChannelGap, Finding, Interval, NamedEffect, Place, Stage
from omnimj.gap.sentences import amount, digits, percent, variable_words
from omnimj.view import page

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


def where(finding: Finding) -> str:
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
                page.cell(amount(place.before, unit), "number"),
                *([page.cell(amount(place.after, unit), "number")] if second else []),
            ]
        )
    head = ["", "share of the gap", "where", "RMS before", *(["RMS after"] if second else [])]
    return page.table(rows, head)


def share_bar(share: float) -> str:
    """A cell with a share as a number and as a bar."""
    width = 100.0 * min(max(share, 0.0), 1.0)
    return f"<td class='number share'>{percent(share)}<i style='width:{width:.0f}%'></i></td>"


def _bounds(finding: Finding, place: Place) -> str:
    words = "; ".join(
        interval_words(name, *limits, finding.regimes.get(name, ""), either_sign(place, name))
        for name, limits in place.bounds.items()
    )
    return f"<small>{page.text(words)}</small>" if words else ""


def either_sign(place: Place, variable: str) -> bool:
    """Whether the place's bounds hold for the size of a variable: its words then say `(either sign)`."""
    return place.bounds[variable][0] >= 0.0 and f"{variable_words(variable)} (either sign)" in place.regime


def interval_words(name: str, low: float, high: float, unit: str, is_size: bool = False) -> str:
    """`0.25 ≤ position < 0.35 m`; an open side is left out."""
    variable = f"|{variable_words(name)}|" if is_size else variable_words(name)
    if is_size and low < 1e-6 * high:
        low = -float("inf")  # no size lies below
    below, above = low == -float("inf"), high == float("inf")
    if below and above:
        return f"any {variable}"
    if above:
        return f"{variable} ≥ {amount(low, unit, _BOUND)}"
    if below:
        return f"{variable} < {amount(high, unit, _BOUND)}"
    return f"{digits(low, _BOUND)} ≤ {variable} < {amount(high, unit, _BOUND)}"


def runs(finding: Finding, gaps: Sequence[RunGap]) -> str:
    """The runs with the largest mismatch: conditions, and RMS per channel."""
    second = has_after(finding)
    rows = [
        [
            page.cell(f"{gap.run}{held_out(gap)}"),
            page.cell(conditions(gap.conditions)),
            page.cell(amount(gap.total_before, "1"), "number"),
            *([page.cell(amount(gap.total_after, "1"), "number")] if second else []),
        ]
        for gap in gaps[:_RUNS]
    ]
    head = ["run", "driven with", "mismatch before", *(["after"] if second else [])]
    return page.table(rows, head)


def held_out(gap: RunGap) -> str:
    """What stands behind the name of a run that was held out, or parts of it."""
    if gap.partly:
        return " · held out in part"
    return " · held out" if gap.heldout else ""


def conditions(values: Mapping[str, float | str]) -> str:
    """`current 0.9 A, floor natural stone`."""
    return (
        ", ".join(f"{name.replace('_', ' ')} {setting(name, value)}" for name, value in values.items()) or "–"
    )


def setting(name: str, value: object) -> str:
    """One number of a run with the unit that its name has, or a word."""
    if isinstance(value, bool) or not isinstance(value, float | int):
        return str(value).replace("_", " ")
    return amount(value, _UNITS.get(name, ""), 5)


def parameters(effect: NamedEffect) -> str:
    """Each parameter with its 90 % interval."""
    rows = []
    for name, value in effect.parameters.items():
        rows.append(
            [
                page.cell(name.replace("_", " ")),
                page.cell(amount(value.value, value.unit, fine(value)), "number"),
                page.cell(interval(value), "number"),
            ]
        )
    return page.table(rows, ("parameter", "fitted", "90 % interval"))


def fine(value: Interval) -> int:
    """Digits that show the interval in two figures: 3 at least, 7 at most."""
    if value.low is None or value.high is None or not value.low < value.high:
        return 3
    size = max(abs(value.value), abs(value.low), abs(value.high))
    return min(max(math.ceil(math.log10(size / (value.high - value.low))) + 2, 3), 7)


def interval(value: Interval) -> str:
    """`0.71 to 1.12`, a dash where no bound is known."""
    if value.low is None and value.high is None:
        return "–"
    low = "unbounded" if value.low is None else digits(value.low, fine(value))
    high = "unbounded" if value.high is None else digits(value.high, fine(value))
    return f"{low} to {high}"


def refitted(finding: Finding) -> str:
    """The parameters that were declared uncertain."""
    rows = [
        [
            page.cell(p.name),
            page.cell(amount(p.nominal, p.unit, 4), "number"),
            page.cell(f"{digits(p.low, 4)} to {digits(p.high, 4)}", "number"),
            f"<td class='number'>{page.text(amount(p.fitted, p.unit, 4))}{_side(p.at_bound)}</td>",
        ]
        for p in finding.refitted
    ]
    return page.table(rows, ("parameter", "in the model", "stated uncertainty", "refitted"))


def _side(at_bound: bool) -> str:
    return "<small>at the side of its box</small>" if at_bound else ""


def gaps(finding: Finding) -> str:
    """RMS of every channel, held-out runs and training runs, before, after, floor and noise."""
    rows = []
    for name, (unit, words) in finding.channels.items():
        row = [page.cell(words)]
        for group in (finding.heldout, finding.train):
            row += _before_after(group.get(name), unit, has_after(finding))
        gap = finding.heldout.get(name)
        row.append(page.cell(amount(None if gap is None else gap.floor, unit), "number"))
        row.append(page.cell(amount(finding.noise.get(name), unit), "number"))
        rows.append(row)
    pair = ["held out: before", "after"] if has_after(finding) else ["held out"]
    other = ["training: before", "after"] if has_after(finding) else ["training"]
    return page.table(rows, ["channel", *pair, *other, "between repeats", "noise"])


def _before_after(gap: ChannelGap | None, unit: str, second: bool) -> list[str]:
    if gap is None:
        return [page.cell("–", "number")] * (1 + second)
    cells = [page.cell(amount(gap.before, unit), "number")]
    return [*cells, page.cell(amount(gap.after, unit), "number")] if second else cells


def candidates(stage: Stage) -> str:
    """All candidates of one round: what the screening said, the held-out gain, the verdict."""
    rows = [
        [
            page.cell(f"{c.label}{' · sensor' if c.is_sensor else ''}"),
            page.cell(percent(c.screened), "number"),
            page.cell("–" if c.gain is None else percent(c.gain.value), "number"),
            page.cell("–" if c.gain is None else percent_interval(c.gain), "number"),
            page.cell(c.verdict),
        ]
        for c in stage.candidates
    ]
    return page.table(rows, ("candidate", "could explain at best", "held-out gain", "90 % interval", ""))


def percent_interval(gain: Interval) -> str:
    """`74 % to 83 %`."""
    if gain.low is None or gain.high is None:
        return "–"
    return f"{percent(gain.low)} to {percent(gain.high)}"


def parting(distances: object) -> str:
    """How far the rivals' predictions part in the run to drive, in units of noise."""
    if isinstance(distances, float | int):
        distances = {"the rivals": distances}
    if not isinstance(distances, Mapping) or not distances:
        return ""
    rows = [[page.cell(name), page.cell(amount(far, "1"), "number")] for name, far in distances.items()]
    return page.table(rows, ("rival", "its prediction parts by [multiples of the noise]"))


def experiment(values: Mapping[str, object]) -> str:
    """What to drive, a row per number."""
    return page.table(
        [
            (page.text(name.replace("_", " ")), page.cell(setting(name, value), "number"))
            for name, value in values.items()
        ]
    )
