"""Plots of the search for missing effects: candidates, decoys, refitted parameters, free curves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from omnimj.effects import Interval
from omnimj.estimate.gap.records import Finding, Refitted, Stage
from omnimj.estimate.gap.sentences import format_amount, format_percent, variable_words
from omnimj.view import palette
from omnimj.view.plots.mismatch import reference_line, row_panel
from omnimj.view.plots.panels import SHORT, Drawing, Panel

RIVAL, BEATEN = palette.FAULT, "#8A939D"
_ROWS, _BINS = 12, 50
_VERDICT_STYLES = {  # verdict → colour, marker, filled or not
    "named": (palette.AFTER, "circle", True),
    "rival": (RIVAL, "diamond", True),
    "beaten": (BEATEN, "square", True),
    "below the margin": (BEATEN, "circle", False),
}
LEAST_GAIN = -0.25
"""Smallest gain drawn; smaller ones are clipped to it to keep the others readable, and the tooltip shows
their value."""


def candidate_gains(stage: Stage) -> Drawing:
    """Plot the held-out gain of every fitted candidate with its 90 % interval, the best at the top."""
    tried = [(c, c.gain) for c in stage.candidates if c.gain is not None][:_ROWS]
    labels = [c.label + (" ·\u00a0sensor" if c.is_sensor else "") for c, _ in tried]
    panel = row_panel(labels, "held-out gain [%]")
    ends = len(tried) - 0.5, -0.5
    reference_line(panel, 0.0, "", ends)
    _margin(panel, stage, ends)
    for verdict in dict.fromkeys(c.verdict for c, _ in tried):
        own = {row: gain for row, (c, gain) in enumerate(tried) if c.verdict == verdict}
        _intervals(panel, verdict, verdict, list(own), list(own.values()))
    panel.legend(3)
    return panel.finish()


def _intervals(
    panel: Panel, verdict: str, label: str, heights: Sequence[float], gains: Sequence[Interval]
) -> None:
    """Draw gains [%] of one verdict at the heights with their intervals."""
    color, marker, is_filled = _VERDICT_STYLES.get(verdict, (BEATEN, "circle", False))
    names: list[str] = []
    for height, gain in zip(heights, gains, strict=True):
        low, high = (gain.value if end is None else end for end in (gain.low, gain.high))
        ends = 100.0 * np.maximum([low, high], LEAST_GAIN)
        panel.line(ends, np.full(2, float(height)), color, label, width=2.4, alpha=0.75)
        interval = "" if low == high else f", {format_percent(low)} to {format_percent(high)}"
        names.append(format_percent(gain.value) + interval)
    values = [100.0 * max(gain.value, LEAST_GAIN) for gain in gains]
    markers = panel.points(values, heights, color, label, marker, 9, names=names).glyph
    markers.fill_color = color if is_filled else "white"


def decoy_gains(stage: Stage) -> Drawing:
    """Plot the gains of decoys (random curves of equal flexibility) beside that of the best candidate."""
    panel = Panel(SHORT, over_time=False, label="number of curves", x_label="held-out gain [%]")
    known = stage.decoys[np.isfinite(stage.decoys)]
    best = next(((c, c.gain) for c in stage.candidates if c.gain is not None), None)
    ends = [*known, stage.margin, *([best[1].value] if best else [])]
    # wide enough to be visible beside a distant candidate
    counts, edges = np.histogram(known, _BINS, (min(ends), max(ends)))
    x, y = np.repeat(100.0 * edges, 2), np.pad(np.repeat(counts, 2), 1)
    panel.polygon(np.column_stack([x, y]), palette.lighter(BEATEN, 0.35), f"{len(known)} random curves")
    top = max(1, *counts)
    _margin(panel, stage, (0.0, 1.05 * top))
    if best is not None:
        _intervals(panel, best[0].verdict, best[0].label, [0.5 * top], [best[1]])
    panel.limits(0.0, 1.05 * top)
    panel.legend(2)
    return panel.finish()


def _margin(panel: Panel, stage: Stage, ends: tuple[float, float]) -> None:
    reference_line(panel, 100.0 * stage.margin, f"margin {format_percent(stage.margin)}", ends)


def refitted_parameters(refitted: tuple[Refitted, ...]) -> Drawing:
    """Plot refitted parameters relative to their stated uncertainty: 0 is nominal, ±1 the limits."""
    panel = row_panel([parameter.name for parameter in refitted], "within the stated uncertainty")
    half = np.array([0.5 * (p.high - p.low) or 1.0 for p in refitted])
    low, high, fitted = (
        np.array([getattr(p, name) - p.nominal for p in refitted]) / half
        for name in ("low", "high", "fitted")
    )
    panel.bars(low, high, range(len(refitted)), 0.4, palette.lighter(palette.MUTED, 0.6))
    for at_bound, color, marker, label in (
        (False, palette.AFTER, "circle", "fitted"),
        (True, RIVAL, "diamond", "fitted, at the side of its box"),
    ):
        own = [row for row, p in enumerate(refitted) if p.at_bound == at_bound]
        names = [format_amount(refitted[row].fitted, refitted[row].unit) for row in own]
        if own:
            panel.points(fitted[own], own, color, label, marker, 9, names=names)
    panel.rule(0.0, across=False)
    panel.ticks([-1, 0, 1], ["lowest", "nominal", "highest"], across=True)
    panel.legend()
    return panel.finish()


def free_curves(finding: Finding) -> Drawing:
    """Plot the share of the remaining mismatch that a free curve over each variable explains."""
    order = sorted(finding.flexible.items(), key=lambda item: -item[1])
    labels = [f"over {variable_words(name)}" for name, _ in order]
    panel = row_panel(labels, "share of the remaining held-out mismatch [%]")
    shares = [100.0 * share for _, share in order]
    panel.bars([0.0] * len(order), shares, range(len(order)), 0.55, palette.DIAGNOSIS)
    for row, share in enumerate(shares):
        panel.text(max(share, 0.0), row, f"{share:.0f} %", x_offset=4)
    panel.x_limits(min(0.0, *shares), 100.0)
    return panel.finish()
