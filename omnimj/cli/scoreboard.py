"""`omnimj gap --scoreboard`: the gap search on every available set of real measurements, in one table."""

from __future__ import annotations

import argparse
import itertools
import re
import tempfile
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import exit_code
from omnimj.cli.progress import run_on_executor
from omnimj.cli.terminal import format_study, print_study
from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.estimate.gap.records import Finding
    from omnimj.studies.scoreboard.sets import RealSet
    from omnimj.studies.scoreboard.study import ScoreboardResult
    from omnimj.studies.statistics import Table

_BETWEEN = r"[,;] (?![^(]*\))"  # between effects, not between the parts of one
REPORT, NUMBERS = "report.html", "scoreboard.json"


def add_scoreboard_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `--scoreboard`."""
    group = parser.add_argument_group(
        "scoreboard",
        "DATASET: any number of dataset folders, folders of a machine with its logs, or unpacked archives",
    )
    words = "search every set of real measurements and compare with published effects; "
    words += "an interrupted --out is resumed, without --out the table is only printed"
    group.add_argument("--scoreboard", action="store_true", help=words)
    words = "folder in which known public sets are looked for: Robotino (table, gray, green), XL330"
    group.add_argument("--data", metavar="DIR", type=Path, help=words)


def run_scoreboard_command(arguments: Any) -> int:
    """Search all sets that are there and print the table; 1 if a set could not be searched."""
    given = {"--model": arguments.model, "--floors": arguments.floors, "--holdout": arguments.holdout}
    for name, value in given.items():
        if value:
            raise InputError("--scoreboard", f"found {name}", "each set has its own, see omnimj gap --help")
    is_kept = arguments.out is not None
    with nullcontext(arguments.out) if is_kept else tempfile.TemporaryDirectory(prefix="omnimj_") as place:
        folder = Path(place)
        outcome = _run(arguments, folder)
        print_study(folder, NUMBERS, lambda: _format(outcome, folder, is_kept), arguments.json)
    return exit_code(outcome.interrupted, outcome.failed)


def _run(arguments: Any, folder: Path) -> ScoreboardResult:
    from omnimj.studies.scoreboard.sets import known_sets
    from omnimj.studies.scoreboard.study import HEADING, ScoreboardConfig, run_scoreboard
    from omnimj.view.report.evaluation import write_tables_report

    order = ScoreboardConfig(
        folder,
        search_and_write,
        known_sets(),
        tuple(arguments.dataset),
        arguments.data,
        arguments.seed,
        arguments.accept,
        arguments.workers,
        arguments.force,
    )
    outcome = run_on_executor(arguments, run_scoreboard, order)
    files = f"{NUMBERS}, reports of the searches in sets/"
    write_tables_report(folder / REPORT, HEADING, outcome.lines, outcome.tables, files)
    return outcome


def _format(outcome: ScoreboardResult, folder: Path, is_kept: bool) -> str:
    # origins are long: they stand in the files
    shown = [_one_effect_per_line(outcome.tables[0]), *_without_last_column(outcome.tables[1:])]
    text = format_study((), shown, outcome.lines, outcome.interrupted and is_kept, folder)
    return text if is_kept else text.rpartition("\n\n")[0]


def _one_effect_per_line(table: Table) -> Table:
    """The table of all sets with a line for each named and each expected effect."""
    rows = []
    for name, named, expected, *numbers in table.rows:
        is_searched = numbers[-1] != "–"
        columns = [re.split(_BETWEEN, named) if is_searched else [named], re.split(_BETWEEN, expected)]
        for k, (one, other) in enumerate(itertools.zip_longest(*columns, fillvalue="")):
            rows.append((name if k == 0 else "", one, other, *(numbers if k == 0 else [""] * len(numbers))))
    return replace(table, rows=tuple(rows))


def _without_last_column(tables: Sequence[Table]) -> list[Table]:
    return [replace(one, head=one.head[:-1], rows=tuple(row[:-1] for row in one.rows)) for one in tables]


def search_and_write(one: RealSet, dataset: Path, folder: Path, seed: int, accept: bool) -> Finding:
    """Search the dataset of a set and write the files of `omnimj gap`."""
    from omnimj.cli.gap import gap_content, new_texts, write_outputs
    from omnimj.estimate.gap.find import find_gap

    finding = find_gap(dataset, one.model, (), None, seed, one.floors, accept=accept)
    texts, refused = new_texts(finding, one.model, one.floors)
    command = f"omnimj gap {dataset} --seed {seed} --out DIR"
    command += "".join(f" --{key} {file}" for key in ("model", "floors") if (file := getattr(one, key)))
    content = gap_content(finding, texts, command)
    write_outputs(folder, True, finding, one.model, content, texts)
    if refused is not None:
        raise refused
    return finding
