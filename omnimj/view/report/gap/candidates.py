"""The parts of the gap report that tell what is missing and how sure that is."""

from __future__ import annotations

from collections.abc import Callable

from matplotlib.figure import Figure

from omnimj.estimate.gap import sentences
from omnimj.estimate.gap.records import CandidateResult, Finding, NamedEffect, Stage
from omnimj.estimate.gap.sentences import format_percent
from omnimj.view.plots import candidates as gap_plots_naming
from omnimj.view.plots.drawing import svg
from omnimj.view.report import page
from omnimj.view.report.gap import finding_tables

_NOTHING = 0.01  # share that a free curve takes away and that is not worth a picture


def effects(finding: Finding) -> str:
    """Each effect with its parameters and rivals; the candidates of every round."""
    parts = [f"<p>{page.text(sentences.as_sentence(finding.reason))}</p>"] if finding.reason else []
    for k, effect in enumerate(finding.effects):
        parts.append(_effect(effect, k if len(finding.effects) > 1 else None))
    if finding.flexible:
        parts.append(_free_curves(finding))
    parts.append(_rounds(finding))
    return "".join(parts)


def _effect(effect: NamedEffect, k: int | None) -> str:
    number = "" if k is None else f"{k + 1}. "
    rivals = effect.indistinguishable_from
    beside = (
        "<p class='ambiguous'>These data cannot tell it from "
        f"{page.text(sentences.join_words(rivals, 'or'))}.</p>"
        if rivals
        else ""
    )
    return (
        f"<h3>{number}<code>{page.text(sentences.effect_label(effect))}</code>: "
        f"{page.text(effect.words)}</h3>{beside}{finding_tables.fitted_parameters(effect)}"
    )


def _rounds(finding: Finding) -> str:
    if not finding.stages:
        return ""
    figures, tables = [], []
    many = len(finding.stages) > 1
    for k, stage in enumerate(finding.stages):
        heading = f"Round {k + 1}: the candidates" if many else "The candidates"
        if any(c.gain is not None for c in stage.candidates):
            figures.append(
                _drawn(
                    f"ladder-{k}", heading, _round_words(finding, k), stage, gap_plots_naming.candidate_gains
                )
            )
        round_name = f"Round {k + 1}, all" if many else "All"
        tables.append(
            f"<details><summary>{round_name} {len(stage.candidates)} candidates, as a "
            f"table</summary>{finding_tables.candidate_gains(stage)}</details>"
        )
    return f"<div class='columns plots'>{''.join(figures)}</div>{''.join(tables)}"


def _round_words(finding: Finding, k: int) -> str:
    stage = finding.stages[k]
    out = sum(c.gain is None for c in stage.candidates)
    left = f" {out} more {'was' if out == 1 else 'were'} left behind by the screening." if out else ""
    leader = _leader(stage)
    goes_on = k < len(finding.stages) - 1
    if leader is not None and (goes_on or leader.verdict == "named"):
        end = f"{leader.label} leads and goes into the model."
    else:
        end = (
            f"No interval lies above the margin of {format_percent(stage.margin)} as a whole: the "
            f"search ends."
        )
    return f"How much of the held-out mismatch each takes away, with 90 % intervals. {end}{left}"


def _drawn(name: str, heading: str, caption: str, stage: Stage, draw: Callable[[Stage], Figure]) -> str:
    return page.figure(svg(draw(stage), name, page.text(heading)), heading, caption)


def _free_curves(finding: Finding) -> str:
    if max(finding.flexible.values()) < _NOTHING:
        names = sentences.join_words([sentences.variable_words(name) for name in finding.flexible], "or")
        return f"<p>{page.text(f'A free curve over {names} would explain nothing beyond that.')}</p>"
    caption = (
        "A free curve has no name and no meaning, but it says what the missing thing depends on: the "
        "longest bar is where to look."
    )
    picture = svg(gap_plots_naming.free_curves(finding), "free", "Free curves")
    figure = page.figure(picture, "What a free curve would explain", caption)
    rows = [
        [page.cell(sentences.variable_words(name)), page.cell(format_percent(share), "number")]
        for name, share in sorted(finding.flexible.items(), key=lambda item: -item[1])
    ]
    return (
        f"<div class='columns'>{figure}<div>{page.table(rows, ('free curve over', 'takes away'))}</div></div>"
    )


def how_sure(finding: Finding) -> str:
    """Gain against margin and chance, rivals, and how much the data know."""
    lines = []
    margin = finding.stages[0].margin if finding.stages else None
    for effect in finding.effects:
        gain = effect.gain
        low = (
            ""
            if gain.low is None or gain.high is None
            else f" (90 %: {finding_tables.format_percent_interval(gain)})"
        )
        asked = "" if margin is None else f"; the lower bound must be above {format_percent(margin)}"
        number, counted = sentences.format_chance(effect)
        lines.append(
            f"{sentences.effect_label(effect)} takes {format_percent(gain.value)}{low} of the "
            f"held-out mismatch "
            f"away{asked}. By chance: {number}, {counted}."
        )
        lines += [f"Not beaten: {rival}." for rival in effect.indistinguishable_from]
    if not finding.effects:
        lines.append(_nothing_named(finding))
    lines.append(
        f"{finding.samples} block means are worth {finding.effective_samples:.0f} independent ones, since "
        "neighbouring ones are correlated."
    )
    told = "<ul>" + "".join(f"<li>{page.text(line)}</li>" for line in lines) + "</ul>"
    caption = (
        "Grey: what curves without meaning gain when they are fitted with the same freedom. A name must "
        "lie clear of them and of the margin."
    )
    figures = [
        _drawn(f"decoys-{k}", _decoy_heading(finding, k), caption, stage, gap_plots_naming.decoy_gains)
        for k, stage in enumerate(finding.stages)
        if len(stage.decoys)
    ]
    return f"{told}<div class='columns plots'>{''.join(figures)}</div>"


def _leader(stage: Stage) -> CandidateResult | None:
    """The first candidate that was tried on held-out runs."""
    return next((c for c in stage.candidates if c.gain is not None), None)


def _decoy_heading(finding: Finding, k: int) -> str:
    leader = _leader(finding.stages[k])
    name = "chance alone" if leader is None else f"{leader.label} against chance"
    return f"Round {k + 1}: {name}" if len(finding.stages) > 1 else sentences.as_sentence(name).rstrip(".")


def _nothing_named(finding: Finding) -> str:
    best = _leader(finding.stages[-1]) if finding.stages else None
    if best is None or best.gain is None:
        return "No candidate came as far as a fit on held-out runs."
    return (
        f"The best candidate, {best.label}, takes {format_percent(best.gain.value)} of the held-out mismatch "
        f"away; a lower bound above {format_percent(finding.stages[-1].margin)} is asked for, so "
        f"nothing is named."
    )
