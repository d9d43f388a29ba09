"""The benchmark's numbers as a table for people: Markdown, beside `benchmark.json`."""

from __future__ import annotations

from omnimj.gap.benchmark_cases import TUNING_SEEDS
from omnimj.gap.benchmark_scoring import VISIBLE
from omnimj.gap.benchmark_summary import HELD_OUT_GOAL, GroupSummary, Summary
from omnimj.trials.tables import Table, number, percent

HEADING = "Blind benchmark of `omnimj gap`"

_METHODS = {
    "base": "refit of the base",
    "sparse": "sparse regression",
    "bic": "forward selection, BIC",
}


def tables(summary: Summary) -> list[Table]:
    """Methods beside the goals, then the workflow by size, by effect and by kind of case."""
    head = ("size", "cases", "mismatch", "covered", "top-1", "no_gap", "unexplained", "in interval", "error")
    named = ("effect", *head[1:], "named instead")
    return [
        _methods(summary),
        Table("By size (one hidden effect)", head, tuple(_cells(g) for g in summary.sizes if g.cases)),
        Table(
            "By effect (one hidden effect, all sizes)",
            named,
            tuple((*_cells(g), g.instead or "–") for g in summary.effects),
        ),
        Table(
            "By kind of case; below `triple` truths outside of the library",
            ("kind", "cases", "mismatch", "no_gap", "unexplained", "names something", "most often"),
            tuple(
                (
                    g.name,
                    str(g.cases),
                    number(g.visibility),
                    str(g.no_gap),
                    str(g.unexplained),
                    str(g.cases - g.no_gap - g.unexplained),
                    g.instead or "–",
                )
                for g in summary.kinds
                if g.cases
            ),
        ),
    ]


def _methods(summary: Summary) -> Table:
    methods = summary.methods
    names = tuple(_METHODS.get(m.method, m.method) for m in methods)
    none = ("–",) * (len(methods) - 1)
    rows = [
        ("coverage, where it names", "≥ 95 %", *(percent(m.covered_where_named) for m in methods)),
        ("coverage, all visible", "", *(percent(m.covered_visible) for m in methods)),
        ("top-1, where it names", "≥ 80 %", *(percent(m.first_where_named) for m in methods)),
        ("top-1, all visible", "", *(percent(m.first_visible) for m in methods)),
        ("mean set", "≤ 1.6", *(number(m.mean_set) for m in methods)),
        ("wrong names per case", "", *(number(m.wrong_names) for m in methods)),
        ("false naming, nothing hidden", "≤ 5 %", *(percent(m.false_on_null) for m in methods)),
        ("false naming, out of library", "≤ 10 %", *(percent(m.false_outside) for m in methods)),
        ("abstains on a visible effect", "", percent(summary.abstained_visible), *none),
        (
            "held-out gap over true model's: median",
            f"≤ {HELD_OUT_GOAL}",
            *(number(m.median_heldout) for m in methods),
        ),
        (f"… at most {HELD_OUT_GOAL}", "", *(percent(m.good_heldout) for m in methods)),
        ("parameters in their 90 % interval", "≥ 85 %", percent(summary.inside), *none),
        ("… of the planted numbers", "", percent(summary.inside_planted), *none),
        ("parameter error over size, median", "", number(summary.error), *none),
        ("time per dataset, median and longest", "", _seconds(summary), *none),
    ]
    return Table("Against the goals", ("", "goal", *names), tuple(rows))


def _cells(group: GroupSummary) -> tuple[str, ...]:
    return (
        group.name,
        str(group.cases),
        number(group.visibility),
        percent(group.covered),
        percent(group.first),
        str(group.no_gap),
        str(group.unexplained),
        percent(group.inside),
        number(group.error),
    )


def _seconds(summary: Summary) -> str:
    return "–" if summary.seconds is None else f"{summary.seconds[0]:.0f} s, {summary.seconds[1]:.0f} s"


def header(seed: int, made_by: str, scored: int, planned: int, failed: int) -> list[str]:
    """What the numbers are of, sentence by sentence."""
    judged = (
        f"Seed {seed} is one that the method was tuned with (0–9): **these numbers do not judge it**."
        if seed in TUNING_SEEDS
        else f"Seed {seed} was not used while the method was tuned (0–9 were)."
    )
    lines = [
        judged,
        f"{scored} of {planned} datasets, made by the {made_by} model of the rig through its sensors, its "
        "constants off their nominal values inside the stated uncertainty.",
        "Rates with Wilson 95 % bounds and what they are of. Mismatch: of the refitted base, in units of "
        f"noise; an effect below {VISIBLE} does not show and is not counted as visible.",
    ]
    if failed:
        lines.append(f"{failed} searches or fits broke down and are left out: `errors` in benchmark.json.")
    return lines
