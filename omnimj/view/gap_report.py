"""`report.html` of the gap workflow: what is missing, where, how sure, how much smaller, what next."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import omnimj
from omnimj.gap import sentences
from omnimj.gap.per_run import has_after, run_gaps
from omnimj.gap.records import Finding, Place
from omnimj.gap.sentences import amount, digits, percent
from omnimj.view import gap_plots_where, gap_tables, page
from omnimj.view.drawing import svg
from omnimj.view.gap_report_naming import effects, how_sure
from omnimj.view.gap_report_runs import how_much_smaller

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
        page.section("How much smaller" if has_after(finding) else "How large", how_much_smaller(finding)),
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
    lead = sentences.runs(finding, len(gaps), any(gap.partly for gap in gaps))
    verdict = f"{_SIGNS[finding.verdict]} {sentences.headline(finding)}"
    kind = _KINDS[finding.verdict]
    if finding.failure:
        verdict, kind = f"Not finished. So far: {verdict}", "plain"
    name = sentences.dataset_name(finding)
    return (
        f"<h1>Gap of {page.text(name)}</h1><p class='lead'>{page.text(lead)}</p>"
        f"<p class='verdict {kind}'>{page.text(verdict)}</p>"
        f"<p>{page.text(sentences.summary(finding))}</p>{_tiles(finding)}"
    )


def _tiles(finding: Finding) -> str:
    tiles = []
    channel = sentences.main_channel(finding)
    if channel is not None:
        gap, (unit, words) = finding.heldout[channel], finding.channels[channel]
        shown = amount(gap.before, unit)
        if gap.after is not None:
            shown = f"{digits(gap.before)} → {amount(gap.after, unit)}"
        tiles.append((f"RMS mismatch in the {words}", shown, "on held-out runs"))
    if finding.shrink is not None:
        tiles.append(
            ("the whole gap is smaller by", percent(finding.shrink), "all channels, in units of noise")
        )
    if finding.where and finding.verdict != "no_gap":
        place = finding.where[0]
        words = f"{finding.channels[place.channel][1]}: {sentences.regime(place)}"
        tiles.append(("largest share of the gap", percent(place.share), words))
    for effect in finding.effects[:1]:
        shown, rest = sentences.chance(effect)
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
        names = sentences.joined([c.label for c in sensors])
        won = [
            sentences.label(e) for e in finding.effects if any(c.label == sentences.label(e) for c in sensors)
        ]
        end = f"{sentences.joined(won)} was named." if won else "none of them was named."
        notes.append(f"Sensors were suspected like the machine: {names} were candidates; {end}")
    return "<ul>" + "".join(f"<li>{page.text(note)}</li>" for note in notes) + "</ul>"


def _where(finding: Finding) -> str:
    if not finding.where:
        return "<p>No place carries more of the mismatch than another.</p>"
    top = finding.where[0]
    unit, words = finding.channels[top.channel]
    told = (
        f"{percent(top.share)} of the squared mismatch, in units of noise, lies in the {words}: "
        f"{top.regime}. There it is {amount(top.before, unit)} RMS."
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
    table = gap_tables.where(finding)
    by_run = (
        "<details><summary>The same by run, as a "
        f"table</summary>{gap_tables.runs(finding, gaps)}<p>Mismatch: RMS over all channels, in multiples "
        "of their noise.</p></details>"
        if gaps
        else ""
    )
    return f"<p>{page.text(told)}</p>{table}<div class='columns plots'>{''.join(figures)}</div>{by_run}"


def _against(finding: Finding, k: int, variable: str, place: Place) -> str:
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
    from omnimj.view.gap_plots_naming import boxes

    if not finding.refitted:
        words = "The model declares no parameter as uncertain, so none was refitted."
        return page.section("Parameters that were uncertain", f"<p>{words}</p>")
    bound = [p.name for p in finding.refitted if p.at_bound]
    words = (
        "Refitted before anything is called missing, so that a mis-tuned model is not taken for new physics."
    )
    if bound:
        words += (
            f" {sentences.joined(bound)} {'is' if len(bound) == 1 else 'are'} at the side of the box: its "
            "stated uncertainty may be too small."
        )
    caption = "A box is the stated uncertainty of one parameter; a mark at its side asks for a second look."
    figure = drawn("boxes", "Where they went in their boxes", caption, lambda: boxes(finding.refitted))
    content = f"<p>{page.text(words)}</p>{gap_tables.refitted(finding)}"
    content += f"<div class='columns plots'>{figure}</div>"
    return page.section("Parameters that were uncertain", content)


def _next(finding: Finding, new_model: str | None, new_floors: str | None) -> str:
    parts = [f"<p>{page.text(sentences.next_step(finding))}</p>"]
    if finding.next_experiment:
        wanted = finding.next_experiment
        parts.append("<h3>The run to drive</h3>")
        parts.append(gap_tables.experiment(wanted.get("run") or {}))
        parts.append(f"<p>{page.text(sentences.separates(finding))}</p>")
        parts.append(gap_tables.parting(wanted.get("parting")))
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
