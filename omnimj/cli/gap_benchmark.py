"""`omnimj gap --benchmark`: how often effects that were hidden by a seed are found."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import whole_number
from omnimj.cli.progress import ProgressBar
from omnimj.cli.tables import table
from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.gap.benchmark import Outcome

REPORT = "report.html"
_FINE = 1000  # steps of the progress bar


def add_benchmark_arguments(parser: argparse.ArgumentParser) -> None:
    """Options that mean something with `--benchmark` alone."""
    group = parser.add_argument_group("benchmark", "made-up datasets with sealed truths; no DATASET is given")
    words = "hide effects drawn by --seed, search blind, score; an --out that was broken off goes on"
    group.add_argument("--benchmark", action="store_true", help=words)
    count, cpus = whole_number(1, 1000), whole_number(1, 256)
    words = "how often the whole set of 130 cases is drawn (default 1)"
    group.add_argument("--trials", metavar="N", type=count, default=1, help=words)
    words = "only the first N cases, which are in random order"
    group.add_argument("--cases", metavar="N", type=whole_number(1, 10**6), help=words)
    group.add_argument("--workers", metavar="N", type=cpus, default=1, help="processes (default 1)")
    words = "what makes the data: twin (default), or planar, which is quicker"
    group.add_argument("--made-by", metavar="M", default="twin", help=words)
    words = "plant of the datasets (default and only one: quarter_rig)"
    group.add_argument("--plant", metavar="P", default="quarter_rig", help=words)


def run_gap_benchmark(arguments: Any) -> int:
    """Makes, searches, scores, writes, prints.

    Returns:
      0, whatever the numbers say; 130 after Ctrl-C with what was finished; 1 when a dataset broke the search.

    Raises:
      InputError: An option that has no meaning here, or a folder that holds something else.
      UnknownNameError: No such maker or plant.
    """
    given = {"DATASET": arguments.dataset, "--model": arguments.model, "--holdout": arguments.holdout}
    for name, value in given.items():
        if value:
            raise InputError("--benchmark", f"found {name}", "it makes its own data for the shipped model")
    from omnimj.gap.benchmark import NUMBERS, Order, run_benchmark
    from omnimj.recording.folder import whole_file
    from omnimj.view.benchmark_report import write_benchmark_report

    order = Order(
        arguments.out,
        arguments.seed,
        arguments.trials,
        arguments.cases,
        arguments.made_by,
        arguments.workers,
        arguments.plant,
    )
    with ProgressBar() as bar:
        outcome = run_benchmark(
            order, lambda phrase, share: bar.show(round(_FINE * min(max(share, 0.0), 1.0)), _FINE, phrase)
        )
    with whole_file(arguments.out / REPORT) as temporary:
        write_benchmark_report(temporary, outcome.lines, outcome.tables)
    if arguments.json:
        print((arguments.out / NUMBERS).read_text(encoding="utf-8"), end="")
    else:
        print(_told(outcome, arguments.out))
    return 130 if outcome.interrupted else 1 if outcome.failed else 0


def _told(outcome: Outcome, folder: Path) -> str:
    parts = ["\n".join(line.replace("**", "") for line in outcome.lines)]
    parts += [f"{one.title}\n{table(one.head, one.rows)}" for one in outcome.tables if one.rows]
    if outcome.interrupted:
        parts.append("interrupted; the same command goes on from here")
    parts.append(f"written to {folder}")
    return "\n\n".join(parts)
