"""`report.html` of the gap workflow: missing effects, location, certainty, reduction, next step."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import omnimj
from omnimj.estimate.gap import sentences
from omnimj.estimate.gap.records import (
    CandidateResult,
    Finding,
    MismatchRegime,
    RunGap,
    Stage,
    has_second_model,
    overlays_by_run,
    run_gaps,
    typical_run,
    worst_run,
)
from omnimj.estimate.gap.sentences import (
    GLOSSARY,
    format_amount,
    format_in_noise,
    format_number,
    format_percent,
)
from omnimj.view.plots import candidates as candidate_plots
from omnimj.view.plots import mismatch as plots
from omnimj.view.plots.identification import over_slip
from omnimj.view.report import finding_tables as tables
from omnimj.view.report.page import (
    MOST_FIGURES,
    Figure,
    RunSection,
    Table,
    number,
    run_key,
    table,
    write_page,
)

_SPECTRA = 3
_MOST_NOTES = 8  # of the data check; more are folded
_NEGLIGIBLE = 0.01  # share of the mismatch below which no free curve is plotted
_VERDICT_CLASSES = {"named": "good", "ambiguous": "ambiguous", "unexplained": "bad", "no_gap": "good"}
_SIGNS = {"named": "✓", "ambiguous": "?", "unexplained": "✗", "no_gap": "✓"}
_COMMANDS = {
    "quarter_rig": "omnimj validate DATASET --out OUT",
    "uto_robot": "omnimj run SCENARIO --out OUT",
    "linear_axis": "omnimj gap DATASET --out OUT",
}


def write_gap_report(
    path: Path,
    finding: Finding,
    new_model: str | None = None,
    new_floors: str | None = None,
    command: str = "",
) -> None:
    """Write the report of the gap workflow; the new model and floors are files beside it."""
    runs = run_gaps(finding)
    sections = _run_sections(finding, runs)
    name = sentences.dataset_name(finding)
    use = f"{_COMMANDS.get(finding.plant, 'omnimj gap DATASET --out OUT')} --model {new_model}"
    write_page(
        path,
        "gap",
        f"Gap of {name} · omnimj",
        name=name,
        finding=finding,
        sentences=sentences,
        has_after=has_second_model(finding),
        lead=sentences.summarize_runs(finding, len(runs), any(run.partly for run in runs)),
        verdict=gap_verdict(finding),
        tiles=_tiles(finding),
        data_notes=_data_notes(finding),
        locations=tables.mismatch_locations(finding),
        location_figures=location_figures(finding, runs),
        effects=[tables.fitted_parameters(effect) for effect in finding.effects],
        traction_figures=traction_figures(finding),
        free_curves=_free_curves(finding),
        free_variables=sentences.join_words(list(map(sentences.variable_words, finding.flexible)), "or"),
        rounds=rounds(finding),
        at_bound=[parameter.name for parameter in finding.refitted if parameter.at_bound],
        refitted=tables.refitted_parameters(finding),
        refitted_figures=_refitted_figures(finding),
        certainty=_certainty(finding),
        decoy_figures=_decoy_figures(finding),
        channels=tables.channel_mismatches(finding),
        size_figures=size_figures(finding),
        runs=tables.run_mismatches(finding, runs, sections),
        sections=sections,
        next_run=tables.experiment_settings((finding.next_experiment or {}).get("run") or {}),
        rivals=tables.rival_separation((finding.next_experiment or {}).get("parting")),
        new_model=new_model,
        new_floors=new_floors,
        use=use + (f" --floors {new_floors}" if new_floors else ""),
        method=_method(finding),
        glossary=GLOSSARY,
        command=command,
    )


def gap_verdict(finding: Finding) -> tuple[str, str]:
    """Return CSS class and text of the verdict."""
    words = f"{_SIGNS[finding.verdict]} {sentences.headline(finding)}"
    if finding.failure:
        return "plain", f"Not finished. So far: {words}"
    return _VERDICT_CLASSES[finding.verdict], words


def _tiles(finding: Finding) -> list[tuple[str, str, str]]:
    """Return name, value and comment of each key figure."""
    tiles = []
    channel = sentences.main_channel(finding)
    if channel is not None:
        gap, (unit, words) = finding.heldout[channel], finding.channels[channel]
        shown = format_amount(gap.before, unit)
        if gap.after is not None:
            shown = f"{format_number(gap.before)} → {format_amount(gap.after, unit)}"
        tiles.append((f"RMS mismatch in the {words}", shown, "on held-out runs"))
    if finding.shrink is not None:
        words = "all channels, in units of noise"
        tiles.append(("the whole gap is smaller by", format_percent(finding.shrink), words))
    if finding.where and finding.verdict != "no_gap":
        place = finding.where[0]
        words = f"{finding.channels[place.channel][1]}: {sentences.format_regime(place)}"
        tiles.append(("largest share of the gap", format_percent(place.share), words))
    if finding.effects:
        tiles.append(("could it be chance?", *sentences.format_chance(finding.effects[0])))
    return tiles


def _data_notes(finding: Finding) -> tuple[list[str], list[str]]:
    """Return the notes to show, and those to fold."""
    notes = list(finding.data_notes) or ["The check of the data found nothing to report."]
    sensors = [c.label for stage in finding.stages[:1] for c in stage.candidates if c.is_sensor]
    if sensors:
        named = [label for label in map(sentences.effect_label, finding.effects) if label in sensors]
        end = f"{sentences.join_words(named)} was named." if named else "none of them was named."
        names = sentences.join_words(sensors)
        notes.insert(0, f"Sensor errors were candidates as well as the machine: {names}; {end}")
    return notes[:_MOST_NOTES], notes[_MOST_NOTES:]


def location_figures(finding: Finding, runs: Sequence[RunGap]) -> list[Figure]:
    """Plot the mismatch over the variables of its regimes, and run by run."""
    if not finding.where:
        return []
    figures = [
        _regime_figure(finding, k, variable, place)
        for k, (variable, place) in enumerate(plots.regime_variables(finding)[:3])
    ]
    if runs:
        caption = (
            "The runs with the largest mismatch over all channels, rings before, dots after. A run at 1 is "
            "explained as well as its noise allows."
        )
        figures.append(Figure(plots.by_run(runs), "runs", "Run by run", caption))
    return figures


def _regime_figure(finding: Finding, k: int, variable: str, place: MismatchRegime) -> Figure:
    shaded = " Shaded: the regime named above." if any(np.isfinite(place.bounds[variable])) else ""
    caption = (
        f"Measured − simulated in the {finding.channels[place.channel][1]}, a dot per block of every run; "
        f"lines are averages. The mismatch of a complete model scatters about zero everywhere.{shaded}"
    )
    drawing = plots.against_regime(finding, variable, place)
    return Figure(drawing, f"regime-{k}", f"Mismatch over {sentences.variable_words(variable)}", caption)


def traction_figures(finding: Finding) -> list[Figure]:
    """Plot traction over slip, floor by floor."""
    caption = (
        "Points: slip by pose and wheel speeds, force by the currents, neither by a traction law. "
        "Dashed: the model before, refitted; solid: with the named effects, both at the same rolling speeds."
    )
    return [
        Figure(over_slip(curves), f"traction-{k}", f"Traction over slip on {curves.floor}", caption)
        for k, curves in enumerate(finding.traction)
    ]


def _free_curves(finding: Finding) -> tuple[Figure, Table] | None:
    """Plot the explanatory power of free curves; None if negligible."""
    if not finding.flexible or max(finding.flexible.values()) < _NEGLIGIBLE:
        return None
    caption = (
        "A free curve has no name and no meaning, but shows on which variable the missing effect depends: "
        "look at the longest bar."
    )
    heading = "What a free curve would explain"
    figure = Figure(candidate_plots.free_curves(finding), "free", heading, caption)
    rows = [
        (sentences.variable_words(name), number(format_percent(share)))
        for name, share in sorted(finding.flexible.items(), key=lambda item: -item[1])
    ]
    return figure, table(rows, ("free curve over", "explains"))


def rounds(finding: Finding) -> tuple[list[Figure], list[tuple[str, Table]]]:
    """Return plots and tables of the candidates, round by round."""
    figures, all_candidates = [], []
    many = len(finding.stages) > 1
    for k, stage in enumerate(finding.stages):
        if _leader(stage) is not None:
            heading = f"Round {k + 1}: the candidates" if many else "The candidates"
            drawing = candidate_plots.candidate_gains(stage)
            figures.append(Figure(drawing, f"ladder-{k}", heading, _round_caption(finding, k)))
        summary = f"{f'Round {k + 1}, all' if many else 'All'} {len(stage.candidates)} candidates, as a table"
        all_candidates.append((summary, tables.candidate_gains(stage)))
    return figures, all_candidates


def _round_caption(finding: Finding, k: int) -> str:
    stage = finding.stages[k]
    out = sum(c.gain is None for c in stage.candidates)
    screened = f" Screening excluded {out} more." if out else ""
    end = sentences.as_sentence(stage.outcome)
    is_cut = any(c.gain is not None and c.gain.value < candidate_plots.LEAST_GAIN for c in stage.candidates)
    cut = f" A mark at {format_percent(candidate_plots.LEAST_GAIN)} stands for less." if is_cut else ""
    return f"Share of the held-out mismatch that each explains, with 90 % intervals.{cut} {end}{screened}"


def _leader(stage: Stage) -> CandidateResult | None:
    """Return the first candidate with a held-out gain; None without any."""
    return next((c for c in stage.candidates if c.gain is not None), None)


def _refitted_figures(finding: Finding) -> list[Figure]:
    if not finding.refitted:
        return []
    caption = "A box is the stated uncertainty of one parameter; a mark at its edge calls for a second look."
    heading = "Refitted values in their uncertainty boxes"
    return [Figure(candidate_plots.refitted_parameters(finding.refitted), "boxes", heading, caption)]


def _certainty(finding: Finding) -> list[str]:
    """Return sentences on gain, margin, chance, rivals and information in the data."""
    lines = []
    margin = finding.stages[0].margin if finding.stages else None
    for effect in finding.effects:
        gain = effect.gain
        has_bounds = gain.low is not None and gain.high is not None
        interval = f" (90 %: {tables.format_percent_interval(gain)})" if has_bounds else ""
        required = "" if margin is None else f"; the lower bound must be above {format_percent(margin)}"
        chance, counted = sentences.format_chance(effect)
        lines.append(
            f"{sentences.effect_label(effect)} explains {format_percent(gain.value)}{interval} of the "
            f"held-out mismatch{required}. By chance: {chance}, {counted}."
        )
        lines += [f"Not distinguishable: {rival}." for rival in effect.indistinguishable_from]
    if not finding.effects:
        lines.append(_nothing_named(finding))
    lines += sentences.summarize_given_up(finding)
    lines.append(_independence(finding))
    return lines


def _independence(finding: Finding) -> str:
    equivalent = f"{finding.effective_samples:.0f}"
    if equivalent == f"{finding.samples}":
        return f"The {finding.samples} block means are taken as independent."
    why = "since neighbouring ones are correlated"
    return f"{finding.samples} block means are equivalent to {equivalent} independent ones, {why}."


def _nothing_named(finding: Finding) -> str:
    best = _leader(finding.stages[-1]) if finding.stages else None
    if best is None or best.gain is None:
        return "No candidate reached a fit on held-out runs."
    return (
        f"The best candidate, {best.label}, explains {format_percent(best.gain.value)} of the held-out "
        f"mismatch. {sentences.as_sentence(finding.stages[-1].outcome)}"
    ).rstrip()


def _decoy_figures(finding: Finding) -> list[Figure]:
    caption = (
        "Grey: gains of random curves fitted with the same freedom. A named effect must lie clear of them "
        "and of the margin."
    )
    figures = []
    for k, stage in enumerate(finding.stages):
        if len(stage.decoys):
            leader = _leader(stage)
            name = "chance alone" if leader is None else f"{leader.label} against chance"
            many = len(finding.stages) > 1
            heading = f"Round {k + 1}: {name}" if many else sentences.as_sentence(name).rstrip(".")
            figures.append(Figure(candidate_plots.decoy_gains(stage), f"decoys-{k}", heading, caption))
    return figures


def size_figures(finding: Finding) -> list[Figure]:
    """Plot the mismatch by channel and over frequency."""
    figures = []
    if finding.heldout:
        caption = "Held-out runs: every channel, then the regimes of the gap by their numbers above."
        if not has_second_model(finding):
            caption = "Held-out runs: mismatch of every channel relative to the noise."
        figures.append(Figure(plots.shrinkage(finding), "shrinkage", "Channel by channel", caption))
    if plots.has_spectra(finding):
        used = [o for o in finding.overlays if o.heldout] or list(finding.overlays)
        channels = plots.largest_mismatch_channels(finding, used, _SPECTRA)
        caption = (
            "Held-out mismatch by frequency. Dotted: the noise if it were white. Mismatch above it at low "
            "frequencies can be physics; mismatch on the dotted line is noise."
        )
        drawing = plots.spectra(finding, channels)
        figures.append(Figure(drawing, "spectra", "Spectra of the mismatch", caption))
    return figures


def _run_sections(finding: Finding, runs: Sequence[RunGap]) -> list[RunSection]:
    """Make the parts of the page about single runs: the worst, the typical, then by their mismatch."""
    windows = overlays_by_run(finding)
    kinds = {typical_run(finding): "typical", worst_run(finding): "worst"}
    first = [run for kind in ("worst", "typical") for run in runs if kinds.get(run.run) == kind]
    shown = [*first, *(run for run in runs if run not in first)][:MOST_FIGURES]
    caption = "Each channel above, its mismatch (measured − simulated) below."
    sections = []
    for gap in shown:
        size = format_in_noise(gap.total_before)
        if gap.total_after is not None:
            size += f" before, {format_in_noise(gap.total_after)} after"
        kind = f", {kinds[gap.run]}" if gap.run in kinds else ""
        note = f"{tables.describe_use(gap)}{kind}: {size}"
        name = run_key(gap.run).replace("run-", "overlay-", 1)
        figure = Figure(plots.overlay(finding, windows[gap.run]), name, "Measured and simulated", caption)
        lines = [tables.format_conditions(gap.conditions)] if gap.conditions else []
        sections.append(RunSection(gap.run, [figure], note, lines))
    return sections


def _method(finding: Finding) -> Table:
    rows: list[tuple[str, Any]] = [
        ("held-out runs", ", ".join(finding.heldout_runs) or "–"),
        ("N, block means", number(f"{finding.samples}")),
        ("N_eff, equivalent independent ones", number(f"{finding.effective_samples:.0f}")),
        ("simulations", number(f"{finding.simulations}")),
        ("computing time", number(f"{finding.seconds:.0f} s")),
        ("omnimj", omnimj.__version__),
    ]
    return table(rows)
