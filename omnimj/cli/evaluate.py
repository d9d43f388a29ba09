"""`omnimj evaluate`: how good a method is over many randomised runs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import (
    add_executor,
    add_gains,
    add_thresholds,
    parse_names,
    read_gains_file,
    read_thresholds,
    whole_number,
)
from omnimj.cli.terminal import ProgressBar, announce_compilation, format_table, note_compiled
from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.studies.evaluation.study import EvaluationResult

HELP = "drive many randomised cases with a method and judge what it diagnosed and what its recovery is worth"
EXAMPLE = """examples:
  omnimj evaluate --trials 200 --seed 100 --workers 2 --out out/missions
  omnimj evaluate --suite manoeuvres --faults motor,slip --seed 100 --out out/manoeuvres
  omnimj evaluate --faults none --plant twin --trials 180 --seed 100 --out out/quiet
  omnimj evaluate --trials 500 --executor dask:tcp://127.0.0.1:8786 --out out/cluster
  omnimj evaluate --faults none --floor natural_stone --seed 11 --record --out out/stone
  omnimj calibrate out/stone/recordings --false-alarms-per-hour 0.1 --out thresholds.toml

Seeds 0 to 99 are for setting thresholds: an evaluation with one of them says that it judges nothing.
An --out that was broken off goes on where it stood; more --trials are added to those that are there."""

REPORT = "report.html"
_FINE = 1000  # steps of the progress bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the sub-command."""
    words = "missions (default; 60 s of random legs), manoeuvres (5 s, 24 directions, two speeds)"
    parser.add_argument("--suite", metavar="S", default="missions", help=words)
    parser.add_argument("--method", metavar="M", default="off", help="way to diagnose (default off)")
    add_thresholds(parser)
    add_gains(parser)
    words = "a setting of the method or of the cascade's loops, e.g. diagnosis.variant=printed; repeatable"
    parser.add_argument(
        "--set", metavar="KEY=VALUE", dest="settings", action="append", default=[], help=words
    )
    words = "planar (default), twin, or both with a comma: drawn for each case"
    parser.add_argument("--plant", metavar="P", type=parse_names, default=("planar",), help=words)
    words = "how many cases (default 100)"
    parser.add_argument("--trials", metavar="N", type=whole_number(1, 10**5 - 1), default=100, help=words)
    words = "of all that is drawn (default 100); 0 to 99 are for setting thresholds and judge nothing"
    parser.add_argument("--seed", metavar="N", type=whole_number(0, 2**63 - 1), default=100, help=words)
    words = "processes (default 1)"
    parser.add_argument("--workers", metavar="N", type=whole_number(1, 256), default=1, help=words)
    add_executor(parser)
    words = "classes to draw from: none, motor, slip, locked, free, hard_over, all_wheel_slip, sensor, two"
    words = f"{words} (default all), weak (a motor lacks a tenth)"
    parser.add_argument("--faults", metavar="NAMES", type=parse_names, help=words)
    words = "floors to draw from: natural_stone, pvc, paperboard, natural_stone_capped (default all)"
    parser.add_argument("--floor", metavar="NAMES", type=parse_names, help=words)
    words = "keep what the sensors said, as a dataset in DIR/recordings"
    parser.add_argument("--record", action="store_true", help=words)
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="where the result goes")
    words = "write into --out although it is not empty; another evaluation there is replaced"
    parser.add_argument("--force", action="store_true", help=words)
    parser.add_argument("--json", action="store_true", help="print evaluation.json instead of the tables")


def run(arguments: Any) -> int:
    """Drives, judges, writes, prints.

    Returns:
      0, whatever the numbers say; 130 after Ctrl-C with what was finished; 1 when a case broke down.

    Raises:
      InputError: An option out of its range, or a folder that holds something else.
      SimulationError: A worker died; what was finished is kept.
    """
    from omnimj.recording.folder import atomic_file
    from omnimj.studies.evaluation.cases import FLOORS, CasePopulation
    from omnimj.studies.evaluation.study import NUMBERS, EvaluationConfig, check_config, run_evaluation
    from omnimj.studies.random_truth import CLASSES
    from omnimj.studies.workers import open_executor
    from omnimj.view.report.evaluation import write_evaluation_report

    choice = CasePopulation(
        arguments.suite,
        arguments.seed,
        arguments.plant,
        arguments.floor or FLOORS,
        arguments.faults or CLASSES,
    )
    order = EvaluationConfig(
        arguments.out,
        choice,
        arguments.method,
        tuple(arguments.settings),
        arguments.trials,
        arguments.workers,
        arguments.force,
        read_thresholds(arguments.thresholds, arguments.method),
        arguments.record,
        read_gains_file(arguments.gains),
    )
    check_config(order)
    if arguments.record and arguments.executor is not None:
        found = f"found with --executor {arguments.executor}"
        raise InputError("--record", found, "recordings would stay on the disks of its workers")
    for plant in choice.plants:
        announce_compilation(plant, "uto_robot")
    with open_executor(arguments.executor) as executor, ProgressBar() as bar:
        outcome = run_evaluation(
            order,
            lambda phrase, share: bar.show(round(_FINE * min(max(share, 0.0), 1.0)), _FINE, phrase),
            executor,
        )
    for plant in {score.plant for score in outcome.scores}:
        note_compiled(plant, "uto_robot")
    with atomic_file(arguments.out / REPORT) as temporary:
        write_evaluation_report(temporary, outcome)
    if arguments.json:
        print((arguments.out / NUMBERS).read_text(encoding="utf-8"), end="")
    else:
        print(_format_evaluation(outcome, arguments.out))
    return 130 if outcome.interrupted else 1 if outcome.failed else 0


def _format_evaluation(outcome: EvaluationResult, folder: Path) -> str:
    parts = ["\n".join(line.replace("**", "") for line in (outcome.heading.replace("`", ""), *outcome.lines))]
    parts += [f"{one.title}\n{format_table(one.head, one.rows)}" for one in outcome.tables]
    if outcome.interrupted:
        parts.append("interrupted; the same command goes on from here")
    parts.append(f"written to {folder}")
    return "\n\n".join(parts)
