"""Study of real sets, `omnimj gap --scoreboard`: each is imported, searched and compared with publications.

The folder:
  scoreboard_plan.json    settings
  unpacked/               archives of known sets, unpacked
  sets/NAME/              files of the search of a set; `dataset/` in it where its logs were imported
  results/NAME.json       what the table shows of a set
  scoreboard.json, scoreboard.md
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import omnimj
from omnimj.errors import SimulationError
from omnimj.estimate.gap.records import Finding
from omnimj.estimate.gap.sentences import effect_label
from omnimj.recording.json_files import to_jsonable, write_json, write_text
from omnimj.studies.runner import StudyFolder, TrialFolder, guarded, run_study
from omnimj.studies.scoreboard.sets import Expected, KnownSet, MissingSet, RealSet, find_sets
from omnimj.studies.statistics import Table, format_markdown, format_number
from omnimj.studies.workers import Progress, WorkerPool

PLAN, NUMBERS, TEXT = "scoreboard_plan.json", "scoreboard.json", "scoreboard.md"
_CONTENTS = ("results/*.json", "sets/*", NUMBERS, TEXT, "report.html")

Search = Callable[[RealSet, Path, Path, int, bool], Finding]
"""Set, its dataset, folder for its files, seed, accept → finding; a function of a module, for workers."""
HEADING = "Gap workflow on real measurements"
_HEAD = ("set", "named", "expected", "found", "before", "after", "smaller by", "minutes")


@dataclass(frozen=True)
class ScoreboardConfig:
    """Settings of a scoreboard."""

    out: Path
    search: Search
    """Searches one dataset and writes its files."""
    known: tuple[KnownSet, ...]
    paths: tuple[Path, ...] = ()
    """Folders of datasets and machines, and unpacked archives."""
    data: Path | None = None
    """Folder in which known sets are looked for."""
    seed: int = 0
    accept: bool = False
    workers: int = 1
    force: bool = False

    def plan(self) -> dict[str, Any]:
        """Return the settings that stored results depend on; sets may be added."""
        return {"seed": self.seed, "accept": self.accept}


@dataclass(frozen=True)
class ScoreboardResult:
    """Rows and tables of a scoreboard."""

    rows: tuple[Row, ...]
    missing: tuple[MissingSet, ...]
    lines: tuple[str, ...]
    tables: tuple[Table, ...]
    interrupted: bool
    failed: int


def run_scoreboard(
    config: ScoreboardConfig, report: Progress, executor: Executor | None = None
) -> ScoreboardResult:
    """Search all sets without a result, and compare all results with publications; see `run_study`."""
    return run_study(_Scoreboard(config), report, executor)


class _Scoreboard:
    """Steps of a scoreboard for the study runner."""

    def __init__(self, config: ScoreboardConfig):
        self.config, self.workers = config, config.workers
        self._results = TrialFolder(config.out / "results")
        self._sets: Sequence[RealSet] = ()
        self._missing: Sequence[MissingSet] = ()

    def prepare(self) -> None:
        config = self.config
        find_sets(
            config.paths, None, config.out, config.known
        )  # a wrong path is reported before the folder is made
        StudyFolder(config.out, PLAN, "a scoreboard", _CONTENTS).claim(config.plan(), config.force)
        self._sets, self._missing = find_sets(
            config.paths, config.data, config.out / "unpacked", config.known
        )

    def work(self, pool: WorkerPool, report: Progress) -> None:
        """Search the sets without a result, or whose files have changed since."""
        config, tasks = self.config, {}
        for one in self._sets:
            mark, stored = one.fingerprint(), self._results.read(one.name)
            if stored is None or "error" in stored or stored.get("fingerprint") != mark:
                (self._results.path / f"{one.name}.json").unlink(missing_ok=True)
                folder = config.out / "sets" / one.name
                tasks[one.name] = (config.search, one, folder, config.seed, config.accept)
        pool.run_all(search_set, tasks, self._results.write, "searching", report)

    def judge(self, interrupted: bool) -> ScoreboardResult:
        """Compare every stored result with what is published, and write the table."""
        config = self.config
        results, errors = self._results.collect([one.name for one in self._sets])
        rows = tuple(
            Row(one.name, one.expected, one.source, results.get(one.name), errors.get(one.name, ""))
            for one in self._sets
        )
        tables = tuple(score_tables(rows, self._missing))
        lines = tuple(introduction(rows, self._missing))
        content = {
            "plan": config.plan(),
            "version": omnimj.__version__,
            "interrupted": interrupted,
            "sets": [row.content() for row in rows],
            "missing": [vars(one) for one in self._missing],
        }
        write_json(config.out / NUMBERS, to_jsonable(content))
        write_text(config.out / TEXT, format_markdown(HEADING, lines, [one for one in tables if one.rows]))
        return ScoreboardResult(rows, tuple(self._missing), lines, tables, interrupted, len(errors))


@guarded
def search_set(search: Search, one: RealSet, folder: Path, seed: int, accept: bool) -> dict[str, Any]:
    """Import a set if its logs need it, search it, and return what the table shows."""
    mark = one.fingerprint()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    finding = search(one, _dataset(one, folder), folder, seed, accept)
    if finding.failure:
        raise SimulationError(finding.failure)
    before, after = finding.heldout_total
    return {
        "fingerprint": mark,
        "verdict": finding.verdict,
        "incomplete": finding.incomplete,
        "effects": [
            {
                "label": effect_label(effect),
                "parameters": {name: vars(value) for name, value in effect.parameters.items()},
                "indistinguishable_from": effect.indistinguishable_from,
            }
            for effect in finding.effects
        ],
        "before": before,
        "after": after,
        "minutes": finding.seconds / 60.0,
    }


def _dataset(one: RealSet, folder: Path) -> Path:
    """Folder of the set's dataset, imported where its logs need it."""
    if one.mapping is None:
        return one.logs[0]
    from omnimj.recording.importing.workflow import ImportConfig, plan_import, write_import

    write_import(plan_import(ImportConfig(one.logs, one.mapping)), folder / "dataset")
    return folder / "dataset"


@dataclass(frozen=True)
class Row:
    """Result of a set beside what is published about it."""

    name: str
    expected: Expected
    source: str
    result: Mapping[str, Any] | None
    """Result of the search; None where it is missing."""
    error: str = ""

    @property
    def named(self) -> tuple[str, ...]:
        """Labels of the named effects."""
        return tuple(effect["label"] for effect in self._effects)

    @property
    def _effects(self) -> Sequence[Mapping[str, Any]]:
        return () if self.result is None else self.result["effects"]

    @property
    def found(self) -> tuple[str, ...]:
        """Expected effects that were named, or are among the rivals that the data do not exclude."""
        sets = [{one["label"], *one["indistinguishable_from"]} for one in self._effects]
        names = set().union(*sets)
        return tuple(label for label in self.expected if label in names or label.partition(" ")[0] in names)

    @property
    def shrink(self) -> float | None:
        """1 − after/before of the held-out mismatch."""
        if self.result is None or self.result["after"] is None or not self.result["before"]:
            return None
        return 1.0 - self.result["after"] / self.result["before"]

    def content(self) -> dict[str, Any]:
        """Entry of `scoreboard.json`."""
        shown = {key: value for key, value in (self.result or {}).items() if key != "fingerprint"}
        return {
            "name": self.name,
            "expected": self.expected,
            "source": self.source or None,
            "found": self.found,
            "shrink": self.shrink,
            "error": self.error or None,
            **shown,
        }


def score_tables(rows: Sequence[Row], missing: Sequence[MissingSet]) -> Iterator[Table]:
    """Yield the table of all sets, also of known ones that are missing, and that of the published values."""
    cells = [_cells(row) for row in rows]
    cells += [(one.name, "not there", *("–" for _ in _HEAD[2:])) for one in missing]
    title = "Named and expected effects; held-out mismatch before and after, RMS in units of noise"
    yield Table(title, _HEAD, tuple(cells))
    head = ("set", "effect", "parameter", "found", "90 %", "published", "source")
    yield Table("Published values", head, tuple(cell for row in rows for cell in _values(row)))


def _cells(row: Row) -> tuple[str, ...]:
    expected = ", ".join(row.expected) or "–"
    result = row.result
    if result is None:
        return (row.name, row.error or "not searched yet", expected, *("–" for _ in _HEAD[3:]))
    verdict = result["verdict"].replace("_", " ")
    words = ", ".join(map(_with_rivals, result["effects"])) or verdict
    words += "; incomplete" if result["incomplete"] else ""
    found = f"{len(row.found)} of {len(row.expected)}" if row.expected else "–"
    rivals = sum(label not in row.named for label in row.found)
    found += f", {rivals} as rival" if rivals else ""
    smaller = "–" if row.shrink is None else f"{100.0 * row.shrink:.0f} %"
    sizes = (format_number(result["before"]), format_number(result["after"]))
    return (row.name, words, expected, found, *sizes, smaller, f"{result['minutes']:.1f}")


def _with_rivals(effect: Mapping[str, Any]) -> str:
    return " or ".join((effect["label"], *effect["indistinguishable_from"]))


def _values(row: Row) -> Iterator[tuple[str, ...]]:
    by_label = {effect["label"]: effect["parameters"] for effect in row._effects}
    for label, values in row.expected.items():
        for name, value in values.items():
            own = by_label.get(label, {}).get(name)
            found = "–" if own is None else f"{own['value']:.3g} {own['unit']}"
            ends = "–" if own is None else f"{format_number(own['low'])} … {format_number(own['high'])}"
            yield row.name, label, name, found, ends, f"{value:.3g}", row.source


def introduction(rows: Sequence[Row], missing: Sequence[MissingSet]) -> Iterator[str]:
    """Yield how many sets were searched, and where each set that is not there can be had."""
    searched = sum(row.result is not None for row in rows)
    there = f"{searched} of {len(rows)} sets that are there were searched"
    yield f"{there}; {len(missing)} known ones are not there."
    for one in missing:
        yield f"{one.name} is not there: {one.get}, and give --data DIR"
