"""The part of the gap report that shows how much smaller the gap is: numbers, runs, spectra."""

from __future__ import annotations

from matplotlib.figure import Figure

from omnimj.gap.per_run import has_after, run_gaps, runs_of, typical_run, worst_run
from omnimj.gap.records import Finding
from omnimj.gap.sentences import in_noise
from omnimj.view import gap_plots_runs, gap_plots_where, gap_tables, page
from omnimj.view.drawing import svg

_SPECTRA = 3


def how_much_smaller(finding: Finding) -> str:
    """Table per channel, the same per place as a figure, two runs, spectra."""
    figures = []
    if finding.heldout:
        caption = "Held-out runs: every channel in bold, then the places of the gap by their numbers above."
        if not has_after(finding):
            caption = "Held-out runs: how far every channel is from the noise."
        figures.append(
            _figure("shrinkage", "Channel by channel", caption, gap_plots_where.shrinkage(finding))
        )
    if finding.overlays:
        figures += _runs(finding)
    if gap_plots_runs.has_spectra(finding):
        figures.append(_spectra(finding))
    words = (
        "RMS mismatch. Between repeats: by how much repeated runs of one condition differ, which no model "
        "can go below; noise: what one block mean may be off by."
    )
    if has_after(finding):
        words += (
            " Before: the given model, refitted where it is uncertain; after: with what is missing added."
        )
    return f"<p>{words}</p>{gap_tables.gaps(finding)}<div class='columns plots'>{''.join(figures)}</div>"


def _figure(name: str, heading: str, caption: str, figure: Figure) -> str:
    return page.figure(svg(figure, name, page.text(heading)), heading, caption)


def _runs(finding: Finding) -> list[str]:
    windows, by_name = runs_of(finding), {gap.run: gap for gap in run_gaps(finding)}
    figures = []
    for run, kind in ((worst_run(finding), "worst"), (typical_run(finding), "typical")):
        if run is None:
            continue
        gap = by_name[run]
        held = "held-out " if gap.heldout else ""
        size = f"{in_noise(gap.total_before)}{' before' if gap.total_after is not None else ''}"
        if gap.total_after is not None:
            size += f", {in_noise(gap.total_after)} after"
        driven = gap_tables.conditions(gap.conditions)
        caption = f"{driven}. " if driven != "–" else ""
        caption += f"Over all channels {size}. Each channel above, its mismatch (measured − simulated) below."
        heading = f"The {kind} {held}run: {run}"
        figures.append(
            _figure(f"run-{kind}", heading, caption, gap_plots_runs.overlay(finding, windows[run]))
        )
    return figures


def _spectra(finding: Finding) -> str:
    used = [o for o in finding.overlays if o.heldout] or list(finding.overlays)
    channels = gap_plots_runs.telling_channels(finding, used, _SPECTRA)
    caption = (
        "Held-out mismatch by frequency. Dotted: the noise if it were white. What rises above it on the "
        "left is slow and can be physics; what lies on it is noise."
    )
    return _figure("spectra", "Spectra of the mismatch", caption, gap_plots_runs.spectra(finding, channels))
