"""`report.html` of the gap workflow: what is missing, where, how sure, how much smaller, what next."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import omnimj
from omnimj.estimate.gap import sentences
from omnimj.estimate.gap.records import (
    Finding,
    MismatchRegime,
    has_second_model,
    overlays_by_run,
    run_gaps,
    typical_run,
    worst_run,
)
from omnimj.estimate.gap.sentences import format_amount, format_in_noise, format_number, format_percent
from omnimj.view.plots import mismatch as gap_plots_runs
from omnimj.view.plots import mismatch as gap_plots_where
from omnimj.view.plots.drawing import svg
from omnimj.view.report import page
from omnimj.view.report.gap import finding_tables
from omnimj.view.report.gap.candidates import effects, how_sure

# The part of the gap report that shows how much smaller the gap is: numbers, runs, spectra.

_SPECTRA = 3


def how_much_smaller(finding: Finding) -> str:
    """Table per channel, the same per place as a figure, two runs, spectra."""
    figures = []
    if finding.heldout:
        caption = "Held-out runs: every channel in bold, then the places of the gap by their numbers above."
        if not has_second_model(finding):
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
    if has_second_model(finding):
        words += (
            " Before: the given model, refitted where it is uncertain; after: with what is missing added."
        )
    return (
        f"<p>{words}</p>{finding_tables.channel_mismatches(finding)}<div class='columns "
        f"plots'>{''.join(figures)}</div>"
    )


def _figure(name: str, heading: str, caption: str, figure: Figure) -> str:
    return page.figure(svg(figure, name, page.text(heading)), heading, caption)


def _runs(finding: Finding) -> list[str]:
    windows, by_name = overlays_by_run(finding), {gap.run: gap for gap in run_gaps(finding)}
    figures = []
    for run, kind in ((worst_run(finding), "worst"), (typical_run(finding), "typical")):
        if run is None:
            continue
        gap = by_name[run]
        held = "held-out " if gap.heldout else ""
        size = f"{format_in_noise(gap.total_before)}{' before' if gap.total_after is not None else ''}"
        if gap.total_after is not None:
            size += f", {format_in_noise(gap.total_after)} after"
        driven = finding_tables.format_conditions(gap.conditions)
        caption = f"{driven}. " if driven != "–" else ""
        caption += f"Over all channels {size}. Each channel above, its mismatch (measured − simulated) below."
        heading = f"The {kind} {held}run: {run}"
        figures.append(
            _figure(f"run-{kind}", heading, caption, gap_plots_runs.overlay(finding, windows[run]))
        )
    return figures


def _spectra(finding: Finding) -> str:
    used = [o for o in finding.overlays if o.heldout] or list(finding.overlays)
    channels = gap_plots_runs.largest_mismatch_channels(finding, used, _SPECTRA)
    caption = (
        "Held-out mismatch by frequency. Dotted: the noise if it were white. What rises above it on the "
        "left is slow and can be physics; what lies on it is noise."
    )
    return _figure("spectra", "Spectra of the mismatch", caption, gap_plots_runs.spectra(finding, channels))


_STYLE = """
.tiles { display: flex; flex-wrap: wrap; gap: 12px 34px; margin: 1.1rem 0 .4rem; padding: 0; }
.tiles div { max-width: 24ch; } .tiles dt { font-size: .86rem; color: var(--muted); }
.tiles dd { margin: 0; font-size: 1.3rem; font-weight: 600; font-variant-numeric: tabular-nums; }
.tiles dd small { display: block; font-size: .8rem; font-weight: 400; color: var(--muted); }
td.share { min-width: 5.5rem; }
td.share i { display: block; height: 5px; margin-top: 3px; background: #0072B2; border-radius: 2px;
  print-color-adjust: exact; -webkit-print-color-adjust: exact; }
td small { display: block; color: var(--muted); } h3 { font-size: 1.02rem; margin: 1.3rem 0 .3rem; }
details { margin: .6rem 0; } summary { cursor: pointer; color: var(--muted); }
ul { margin: .3rem 0; padding-left: 1.2rem; max-width: 75ch; } .columns { margin-top: .8rem; }
.plots { align-items: start; gap: 26px 34px;
  grid-template-columns: repeat(auto-fill, minmax(min(100%, 440px), 1fr)); }
.ambiguous { color: #7A4B00; }
@media (max-width: 520px) { .tiles { gap: 12px 4%; } .tiles div { width: 48%; } }
"""
_KINDS = {"named": "good", "ambiguous": "ambiguous", "unexplained": "bad", "no_gap": "good"}
_USES = {
    "quarter_rig": "omnimj validate DATASET --out OUT",
    "uto_robot": "omnimj run SCENARIO --out OUT",
    "linear_axis": "omnimj gap DATASET --out OUT",
}
_SIGNS = {"named": "✓", "ambiguous": "?", "unexplained": "✗", "no_gap": "✓"}


def write_gap_report(
    path: Path,
    finding: Finding,
    new_model: str | None = None,
    new_floors: str | None = None,
    command: str = "",
) -> None:
    """Writes the report as one HTML file that needs nothing else.

    Args:
      path: The file to write.
      finding: What was found.
      new_model: File name of the new model beside it; None where there is none.
      new_floors: File name of the refitted floors beside it; None where there are none.
      command: What repeats the work.
    """
    parts = [
        _head(finding),
        page.section("Was the data in order?", _data(finding)),
        page.section("Where the gap is", _where(finding)),
        page.section(_what_heading(finding), effects(finding)),
        _base(finding),
        page.section("How sure", how_sure(finding)),
        page.section(
            "How much smaller" if has_second_model(finding) else "How large", how_much_smaller(finding)
        ),
        page.section("What next", _next(finding, new_model, new_floors)),
        page.section("How it was done", _done(finding, command)),
        _foot(new_model, new_floors),
    ]
    heading = f"Gap of {sentences.dataset_name(finding)} · omnimj"
    path.write_text(page.document(heading, "\n".join(parts), _STYLE), encoding="utf-8")


def drawn(name: str, heading: str, caption: str, draw: Callable[[], Figure]) -> str:
    """A figure of the page with its heading and what to see in it."""
    return page.figure(svg(draw(), name, page.text(heading)), heading, caption)


def _head(finding: Finding) -> str:
    gaps = run_gaps(finding)
    lead = sentences.summarize_runs(finding, len(gaps), any(gap.partly for gap in gaps))
    verdict = f"{_SIGNS[finding.verdict]} {sentences.headline(finding)}"
    kind = _KINDS[finding.verdict]
    if finding.failure:
        verdict, kind = f"Not finished. So far: {verdict}", "plain"
    name = sentences.dataset_name(finding)
    return (
        f"<h1>Gap of {page.text(name)}</h1><p class='lead'>{page.text(lead)}</p>"
        f"<p class='verdict {kind}'>{page.text(verdict)}</p>"
        f"<p>{page.text(sentences.summarize_finding(finding))}</p>{_tiles(finding)}"
    )


def _tiles(finding: Finding) -> str:
    tiles = []
    channel = sentences.main_channel(finding)
    if channel is not None:
        gap, (unit, words) = finding.heldout[channel], finding.channels[channel]
        shown = format_amount(gap.before, unit)
        if gap.after is not None:
            shown = f"{format_number(gap.before)} → {format_amount(gap.after, unit)}"
        tiles.append((f"RMS mismatch in the {words}", shown, "on held-out runs"))
    if finding.shrink is not None:
        tiles.append(
            ("the whole gap is smaller by", format_percent(finding.shrink), "all channels, in units of noise")
        )
    if finding.where and finding.verdict != "no_gap":
        place = finding.where[0]
        words = f"{finding.channels[place.channel][1]}: {sentences.format_regime(place)}"
        tiles.append(("largest share of the gap", format_percent(place.share), words))
    for effect in finding.effects[:1]:
        shown, rest = sentences.format_chance(effect)
        tiles.append(("could it be chance?", shown, rest))
    content = "".join(
        f"<div><dt>{page.text(a)}</dt><dd>{page.text(b)}<small>{page.text(c)}</small></dd></div>"
        for a, b, c in tiles
    )
    return f"<dl class='tiles'>{content}</dl>"


def _data(finding: Finding) -> str:
    sensors = [c for stage in finding.stages[:1] for c in stage.candidates if c.is_sensor]
    notes = list(finding.data_notes) or ["The check of the data found nothing to report."]
    if sensors:
        names = sentences.join_words([c.label for c in sensors])
        won = [
            sentences.effect_label(e)
            for e in finding.effects
            if any(c.label == sentences.effect_label(e) for c in sensors)
        ]
        end = f"{sentences.join_words(won)} was named." if won else "none of them was named."
        notes.append(f"Sensors were suspected like the machine: {names} were candidates; {end}")
    return "<ul>" + "".join(f"<li>{page.text(note)}</li>" for note in notes) + "</ul>"


def _where(finding: Finding) -> str:
    if not finding.where:
        return "<p>No place carries more of the mismatch than another.</p>"
    top = finding.where[0]
    unit, words = finding.channels[top.channel]
    told = (
        f"{format_percent(top.share)} of the squared mismatch, in units of noise, lies in the {words}: "
        f"{top.regime}. There it is {format_amount(top.before, unit)} RMS."
    )
    figures = [
        _against(finding, k, *pair) for k, pair in enumerate(gap_plots_where.regime_variables(finding)[:3])
    ]
    if finding.verdict == "no_gap":
        told = f"All of it is within the noise; what little there is lies here. {told}"
    gaps = run_gaps(finding)
    if gaps:
        caption = (
            "The runs with the largest mismatch over all channels, rings before, dots after. A run at 1 is "
            "explained as well as its noise allows."
        )
        figures.append(drawn("runs", "Run by run", caption, lambda: gap_plots_where.by_run(gaps)))
    table = finding_tables.mismatch_locations(finding)
    by_run = (
        "<details><summary>The same by run, as a "
        f"table</summary>{finding_tables.worst_runs(finding, gaps)}<p>Mismatch: RMS over all "
        f"channels, in multiples "
        "of their noise.</p></details>"
        if gaps
        else ""
    )
    return f"<p>{page.text(told)}</p>{table}<div class='columns plots'>{''.join(figures)}</div>{by_run}"


def _against(finding: Finding, k: int, variable: str, place: MismatchRegime) -> str:
    name, words = sentences.variable_words(variable), finding.channels[place.channel][1]
    shaded = " Shaded: the place named above." if any(np.isfinite(place.bounds[variable])) else ""
    caption = (
        f"Measured − simulated in the {words}, a dot per block of every run; lines are averages. A model "
        f"that lacks nothing scatters about zero everywhere.{shaded}"
    )
    draw = gap_plots_where.against_regime
    return drawn(f"regime-{k}", f"Mismatch over {name}", caption, lambda: draw(finding, variable, place))


def _what_heading(finding: Finding) -> str:
    return {
        "named": "What is missing",
        "ambiguous": "What is missing: one of several",
        "unexplained": "What is missing: nothing in the library explains it",
        "no_gap": "What is missing: nothing",
    }[finding.verdict]


def _base(finding: Finding) -> str:
    from omnimj.view.plots.candidates import refitted_parameters

    if not finding.refitted:
        words = "The model declares no parameter as uncertain, so none was refitted."
        return page.section("Parameters that were uncertain", f"<p>{words}</p>")
    bound = [p.name for p in finding.refitted if p.at_bound]
    words = (
        "Refitted before anything is called missing, so that a mis-tuned model is not taken for new physics."
    )
    if bound:
        words += (
            f" {sentences.join_words(bound)} {'is' if len(bound) == 1 else 'are'} at the side of "
            f"the box: its "
            "stated uncertainty may be too small."
        )
    caption = "A box is the stated uncertainty of one parameter; a mark at its side asks for a second look."
    figure = drawn(
        "boxes", "Where they went in their boxes", caption, lambda: refitted_parameters(finding.refitted)
    )
    content = f"<p>{page.text(words)}</p>{finding_tables.refitted_parameters(finding)}"
    content += f"<div class='columns plots'>{figure}</div>"
    return page.section("Parameters that were uncertain", content)


def _next(finding: Finding, new_model: str | None, new_floors: str | None) -> str:
    parts = [f"<p>{page.text(sentences.next_step(finding))}</p>"]
    if finding.next_experiment:
        wanted = finding.next_experiment
        parts.append("<h3>The run to drive</h3>")
        parts.append(finding_tables.experiment_settings(wanted.get("run") or {}))
        parts.append(f"<p>{page.text(sentences.format_separation(finding))}</p>")
        parts.append(finding_tables.rival_separation(wanted.get("parting")))
    if new_model is not None:
        use = f"{_USES.get(finding.plant, 'omnimj gap DATASET --out OUT')} --model {new_model}"
        lies = f"The new model lies beside this page as <code>{page.text(new_model)}</code>"
        if new_floors is not None:
            use += f" --floors {new_floors}"
            lies += f", the refitted floors as <code>{page.text(new_floors)}</code>"
        parts.append(f"<p>{lies}:</p>{page.command(use)}")
    return "".join(parts)


def _done(finding: Finding, command: str) -> str:
    held = ", ".join(finding.heldout_runs) or "–"
    rows = [
        ("held-out runs", page.cell(held)),
        ("N, block means", page.cell(f"{finding.samples}", "number")),
        ("N_eff, as many independent ones", page.cell(f"{finding.effective_samples:.0f}", "number")),
        ("simulations", page.cell(f"{finding.simulations}", "number")),
        ("time taken", page.cell(f"{finding.seconds:.0f} s", "number")),
        ("omnimj", page.cell(omnimj.__version__)),
    ]
    words = (
        "Whole runs were held out, by condition: what is called held out was not fitted. The mismatch of "
        "neighbouring blocks is correlated, so N_eff and not N says how much the data know; intervals are "
        "90 %."
    )
    again = f"<p>To do it again:</p>{page.command(command)}" if command else ""
    table = page.table([(page.text(name), cell) for name, cell in rows])
    return f"<p>{words}</p>{table}{again}"


def _foot(new_model: str | None, new_floors: str | None) -> str:
    beside = "<code>gap.json</code> (every number above), <code>before_after.rrd</code> "
    beside += (
        "(both simulations beside the measured motion, open it with <code>rerun before_after.rrd</code>)"
    )
    if new_model is not None:
        beside += f", <code>{page.text(new_model)}</code> (the new model)"
    if new_floors is not None:
        beside += f", <code>{page.text(new_floors)}</code> (the refitted floors)"
    return (
        f"<footer><p>Beside this page: {beside}. All values in SI units. Written by omnimj "
        f"{page.text(omnimj.__version__)}.</p></footer>"
    )
