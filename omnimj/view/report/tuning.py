"""`report.html` of a gain tuning: gains, their performance on the judging seeds, and the search."""

from __future__ import annotations

from pathlib import Path

from omnimj.studies.tuning.reporting import comparison_rows, format_verdict
from omnimj.studies.tuning.study import TuningResult
from omnimj.view.plots.tuning import convergence, landscape_picture, pareto
from omnimj.view.report.page import Figure, Table, table, write_page


def write_tuning_report(path: Path, result: TuningResult, command: str) -> None:
    """Write the report of a tuning."""
    verdict = format_verdict(result)
    write_page(
        path,
        "tuning",
        "Tuned gains · omnimj",
        result=result,
        config=result.config,
        scenarios=", ".join(Path(text).stem for text in result.config.scenarios),
        verdict=verdict[0].upper() + verdict[1:],
        tables=tuning_tables(result),
        figures=tuning_figures(result),
        command=command,
    )


def tuning_tables(result: TuningResult) -> list[tuple[str, Table]]:
    """Return tables with their headings: gains, scores on the judging seeds, margins of the loops."""
    gains = [
        (axis.name, f"{axis.start:g}", f"{value:g}", axis.unit)
        for axis, value in zip(result.axes, result.values, strict=True)
    ]
    tables = [("Gains", table(gains, ("gain", "before", "tuned", "unit")))]
    for verdict in result.comparisons:
        heading = f"Seed {verdict.seed}, {verdict.draws} runs on the {verdict.plant} plant"
        tables.append((heading, table(comparison_rows(verdict), ("", "before", "tuned"))))
    margins = [
        (
            before.loop,
            before.where,
            _format_margin(before.crossover, before.phase),
            _format_margin(after.crossover, after.phase),
        )
        for before, after in zip(result.margins_before, result.margins_after, strict=True)
    ]
    heading = "Crossover and phase margin of every loop, in closed form"
    return [*tables, (heading, table(margins, ("loop", "where", "before", "tuned")))]


def _format_margin(crossover: float, phase: float) -> str:
    return "no crossover" if crossover == 0.0 else f"{crossover:.2f} Hz, {phase:.0f}°"


def tuning_figures(result: TuningResult) -> list[Figure]:
    """Return plots of the search, of its trade-off, and of the cost around the result."""
    words = "on the training draws, which are the same for every candidate"
    figures = [Figure(convergence(result), "convergence", "The search", words, label="cost by candidate")]
    words = "all candidates that violate no limit; along the front one property is traded for the other"
    figures.append(Figure(pareto(result), "pareto", "Speed against robustness", words))
    for k, found in enumerate(result.landscapes):
        words = "each cell is driven on part of the training draws; a white cell violates a limit"
        name = " and ".join(a.name.partition(".")[2].replace("_", " ") for a in (found.across, found.up))
        heading = f"Cost around the result: {name}"
        figures.append(Figure(landscape_picture(found), f"landscape-{k}", heading, words))
    return figures
