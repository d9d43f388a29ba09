"""Tables of an evaluation for Markdown, command line and report."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import isinf

from omnimj.studies.evaluation.cases import SUITES, CasePopulation, is_judging_seed
from omnimj.studies.evaluation.goals import format_goal, judge_goals
from omnimj.studies.evaluation.scoring import AMBIGUOUS, HEADING_FLOOR, PATH_FLOOR, SEVERAL, label_sort_key
from omnimj.studies.evaluation.summary import Delays, FactorSummary, GroupSummary, PairSummary, Summary
from omnimj.studies.random_structure import structure_sentence
from omnimj.studies.random_truth import ALL_CLASSES, NONE
from omnimj.studies.statistics import EventRate, Table, format_rate

_WRONG_PLACE = "elsewhere"


def format_heading(population: CasePopulation, method: str, settings: Sequence[str] = ()) -> str:
    """Return the title of reports and tables."""
    with_settings = f" with {', '.join(f'`{text}`' for text in settings)}" if settings else ""
    of_model = "" if population.model is None else f", model `{population.model.name}`"
    return (
        f"Evaluation of `{method}`{with_settings} on {population.suite}, structure {population.structure}"
        f"{of_model}"
    )


def summary_sentences(population: CasePopulation, summary: Summary, planned: int, failed: int) -> list[str]:
    """Return sentences on the origin of the numbers."""
    seed = (
        f"Seed {population.seed} was not used to set thresholds (0–99 are for that)."
        if is_judging_seed(population.seed)
        else f"Seed {population.seed} is for setting thresholds (0–99): **these numbers do not judge it**."
    )
    suite = SUITES[population.suite]
    lines = [
        seed,
        f"{summary.cases} of {planned} cases, {summary.hours:.3g} h: {suite.name}, {suite.description}; "
        f"{_drawn(population)}; "
        f"plant {', '.join(population.plants)}; floors {', '.join(population.floors)}; payload within ±20 % "
        "of the mass; true parameters differ from those of the controller (torque constants ±3 %, friction "
        "±20 %, mass ±3 %, inertias ±5 %, floor ±20 %).",
        structure_sentence(population.structure),
        "Rates with Wilson 95 % bounds and sample size; false alarms with the one-sided Poisson 95 % bound. "
        "A wheel is in use while it needs more than 2 N of traction (20 ms mean), taken from the same case "
        "driven without fault and without any method. Faults that were never in use are counted and left "
        "out. A case without an alarm has a delay of ∞ (“never”).",
        "Excursions count from the onset of the fault and are compared with the same case driven without any "
        f"method; they are at least {HEADING_FLOOR:g} rad and {PATH_FLOOR:g} m in ratios.",
        "Goals are met or missed by the measured figures; “too few to be sure” means that the bounds do not "
        "confirm it. The suite does not judge the smallest loss, circles and pivots, and computing time.",
    ]
    if failed:
        lines.append(f"{failed} cases failed and are left out: `errors` in evaluation.json.")
    return lines


def _drawn(population: CasePopulation) -> str:
    """Describe the faults from which cases are drawn."""
    broken = [name for name in ALL_CLASSES if name in population.faults and name != NONE]
    if not broken:
        return "no faults"
    share = f"{100.0 * SUITES[population.suite].healthy:.0f} %" if NONE in population.faults else "none"
    return f"{share} without a fault, else {', '.join(broken)}"


def result_tables(summary: Summary) -> list[Table]:
    """Return the tables: goals, groups, pairs, classes, confusion by class, factors."""
    head = (
        "",
        "cases",
        "not in use",
        "found",
        "isolated",
        "delay since onset",
        "in use",
        "to diagnosis, in use",
    )
    found = [
        _goals(summary),
        Table("Groups with a goal", head, tuple(_group(one) for one in summary.goals if one.cases)),
        Table(
            "Two at once, by kinds of pair",
            ("", "pairs driven", *head[1:], "pairs missed"),
            tuple(map(_pair, summary.pairs)),
        ),
        Table("By class of fault", head, tuple(map(_group, summary.classes))),
        confusion_by_class(summary),
        Table(
            "By factor",
            ("", "", "cases", "false alarms", "isolated", "delay in use", "heading ratio"),
            tuple(map(_factor, summary.factors)),
        ),
    ]
    return [table for table in found if table.rows]


def _goals(summary: Summary) -> Table:
    """Return the table of goals that a case was driven for; it includes measured figures without a goal."""
    rows = [format_goal(one) for one in judge_goals(summary) if one.count]
    return Table("Goals", ("measure", "goal", "measured", "n", "met"), tuple(rows))


def format_event_rate(found: EventRate) -> str:
    """Format an event rate: `0/h (≤ 0.1, 0 in 30 h)`."""
    if found.per_hour is None or found.upper is None:
        return "–"
    return f"{found.per_hour:.3g}/h (≤ {found.upper:.3g}, {found.events} in {found.hours:.3g} h)"


def format_delays(found: Delays) -> str:
    """Format quantiles: `0.12 s, 95 % 0.3 s (n 20)`."""
    if found.median is None or found.p95 is None:
        return "–"
    if isinf(found.median):
        return f"never (n {found.count})"
    return f"{_time(found.median)}, 95 % {_time(found.p95)} (n {found.count})"


def _time(value: float) -> str:
    return "never" if isinf(value) else f"{value:.3g} s"


def _pair(found: PairSummary) -> tuple[str, ...]:
    name, *cells = _group(found.group)
    return (name, f"{found.driven} of {found.pairs}", *cells, "; ".join(found.missed) or "none")


def _group(group: GroupSummary) -> tuple[str, ...]:
    return (
        group.name,
        str(group.cases),
        str(group.unused),
        format_rate(group.found),
        format_rate(group.isolated),
        format_delays(group.delay),
        format_delays(group.delay_in_use),
        format_delays(group.named_in_use),
    )


def _factor(found: FactorSummary) -> tuple[str, ...]:
    return (
        found.factor,
        found.value,
        str(found.cases),
        format_event_rate(found.alarms),
        format_rate(found.isolated),
        format_delays(found.delay_in_use),
        "–" if found.heading.median is None else f"{found.heading.median:.2f} (n {found.heading.count})",
    )


def confusion_by_class(summary: Summary) -> Table:
    """Return truth × diagnosis by class; the right class at a wrong wheel or channel is `elsewhere`."""
    counts: dict[str, dict[str, int]] = {}
    for truth, row in summary.confusion.items():
        own = counts.setdefault(_class(truth), {})
        for given, count in row.items():
            right = _class(given) if given == truth or _class(given) != _class(truth) else _WRONG_PLACE
            own[right] = own.get(right, 0) + count
    columns = _columns(counts.values())
    rows = [
        (truth, *(str(row.get(name, "")) for name in columns), str(sum(row.values())))
        for truth, row in counts.items()
    ]
    return Table("Truth (rows) and diagnosis (columns), cases", ("", *columns, "all"), tuple(rows))


def _columns(rows: Iterable[dict[str, int]]) -> Sequence[str]:
    names = {name for row in rows for name in row}
    last = (_WRONG_PLACE, AMBIGUOUS, SEVERAL)
    return [*sorted(names - set(last), key=label_sort_key), *(name for name in last if name in names)]


def _class(label: str) -> str:
    return label.partition(" ")[0]
