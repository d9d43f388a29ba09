"""The page of a tuning: gains, what they are worth on the judging seeds, and how the search went."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import omnimj
from omnimj.studies.tuning.reporting import comparison_rows, format_verdict
from omnimj.studies.tuning.study import TuningResult
from omnimj.view.plots.drawing import svg
from omnimj.view.plots.tuning import convergence, landscape_picture, pareto
from omnimj.view.report import page

_STYLE = "td { font-variant-numeric: tabular-nums; }"


def write_tuning_report(path: Path, outcome: TuningResult, command: str) -> None:
    """Writes the report as one HTML file that needs nothing else.

    Args:
      path: The file to write.
      outcome: What was found.
      command: The command line that makes it again.
    """
    parts = [*_head(outcome), *_tables(outcome), page.section("In pictures", "".join(_figures(outcome)))]
    parts.append(page.section("How it was done", _method(outcome, command)))
    parts.append(f"<footer>omnimj {page.text(omnimj.__version__)}</footer>")
    path.write_text(page.document("Tuned gains · omnimj", "\n".join(parts), _STYLE), encoding="utf-8")


def _head(outcome: TuningResult) -> Iterator[str]:
    names = ", ".join(Path(text).stem for text in outcome.order.scenarios)
    yield "<h1>Tuned gains</h1>"
    words = f"{len(outcome.tried)} candidates over randomised runs of {names}, judged on other seeds."
    yield f"<p class='lead'>{page.text(words)}</p>"
    kind, words = "good" if outcome.is_better else "bad", format_verdict(outcome)
    yield f"<p class='verdict {kind}'>{page.text(words[0].upper() + words[1:])}</p>"


def _tables(outcome: TuningResult) -> Iterator[str]:
    rows = [
        [page.cell(axis.name), page.cell(f"{axis.start:g}"), page.cell(f"{value:g}"), page.cell(axis.unit)]
        for axis, value in zip(outcome.axes, outcome.values, strict=True)
    ]
    yield page.section("Gains", page.table(rows, ("gain", "before", "tuned", "unit")))
    for verdict in outcome.verdicts:
        rows = [[page.cell(words) for words in row] for row in comparison_rows(verdict)]
        heading = f"Seed {verdict.seed}, {verdict.draws} runs on the {verdict.plant} plant"
        yield page.section(heading, page.table(rows, ("", "before", "tuned")))
    rows = [
        [
            page.cell(before.loop),
            page.cell(before.where),
            page.cell(_margin_words(before.crossover, before.phase)),
            page.cell(_margin_words(after.crossover, after.phase)),
        ]
        for before, after in zip(outcome.margins_before, outcome.margins_after, strict=True)
    ]
    heading = "Crossover and phase margin of every loop, in closed form"
    yield page.section(heading, page.table(rows, ("loop", "where", "before", "tuned")))


def _margin_words(crossover: float, phase: float) -> str:
    return "no crossover" if crossover == 0.0 else f"{crossover:.2f} Hz, {phase:.0f}°"


def _figures(outcome: TuningResult) -> Iterator[str]:
    yield "<div class='columns plots'>"
    words = "on the training draws; every candidate is driven with the same"
    yield page.figure(svg(convergence(outcome), "convergence", "cost by candidate"), "The search", words)
    words = "all candidates that break no limit; the front gives up one for the other"
    picture = svg(pareto(outcome), "pareto", "speed against robustness")
    yield page.figure(picture, "Speed against robustness", words)
    for k, found in enumerate(outcome.landscapes):
        words = "each cell is driven, on a part of the training draws; a white cell breaks a limit"
        name = " and ".join(a.name.partition(".")[2].replace("_", " ") for a in (found.across, found.up))
        picture = svg(landscape_picture(found), f"landscape-{k}", f"cost over {name}")
        yield page.figure(picture, f"Cost around the result: {name}", words)
    yield "</div>"


def _method(outcome: TuningResult, command: str) -> str:
    order = outcome.order
    words = (
        f"CMA-ES over the logarithms of {len(outcome.axes)} gains, {order.trials} draws per scenario with "
        f"seed {order.seed} on the {order.plant} plant: floor, payload ±20 %, errors of the constants, fault "
        "and noise. The cost is a weighted mean of terms relative to the gains before. Hard limits go "
        "before it: "
        f"no false alarm, no sound wheel at its largest current for more than {order.limits.saturation:g} s, "
        f"a phase margin of at least {order.limits.phase_margin:g}° in every loop, no "
        f"wheel more than {100.0 * order.limits.overshoot:g} % beyond a step of its speed (linear, at rest)."
    )
    return f"<p>{page.text(words)}</p>{page.command(command)}"
