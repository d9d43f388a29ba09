"""`omnimj sensitivity`: what to measure on one's own robot first."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import MODEL, add_executor, add_floors, parse_names, whole_number
from omnimj.cli.terminal import ProgressBar, announce_compilation, format_table, note_compiled

if TYPE_CHECKING:
    from omnimj.studies.sensitivity.study import SensitivityResult

HELP = "which numbers that were chosen, not measured, matter to which result: what to measure first"
EXAMPLE = """examples:
  omnimj sensitivity degraded_motor --out out/sensitivity
  omnimj sensitivity nylon_patch --trajectories 20 --workers 2 --out out/nylon
  omnimj sensitivity rig_constant_current --source chosen,text --out out/rig

Every number of the model files with source = "chosen", and those of the scenario's floors, is moved through
its range: its `uncertainty` where the file states one, else 20 % of its value either way (--range); whole
numbers move by one at least, and a number that is 0 without a stated uncertainty is left out. The PLANT gets
the changed number while the controller goes on believing the model file, as it will on your robot until you
have measured. The change of a result across a number's range is its elementary effect (Morris); the mean size
over the trajectories, μ*, ranks the numbers. What is not distinguishable from noise is not ranked. Where a
decision tips, such as an alarm, a few trajectories are chance: what is marked "perhaps" needs more of them.
An --out that was broken off goes on where it stood; more --trajectories are added to those that are there."""

_FINE = 1000  # steps of the progress bar
_MAX_ROWS = 12  # parameters in the terminal's table
_MAX_SHARE = 0.9  # largest --range


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the sub-command."""
    parser.add_argument("scenario", help="a name from `omnimj scenarios`, or a path to a TOML file")
    words = "how often each number is moved (default 10)"
    parser.add_argument("--trajectories", metavar="N", type=whole_number(2, 1000), default=10, help=words)
    parser.add_argument("--plant", metavar="P", default="planar", help="planar (default) or twin")
    words = "diagnosis: robust (default), published (default on the rig) or off"
    parser.add_argument("--method", metavar="M", help=words)
    words = f"{MODEL}: what the controller believes, and its ranges"
    parser.add_argument("--model", metavar="FILE", type=Path, help=words)
    add_floors(parser)
    words = "origins of the numbers that are moved (default chosen), e.g. chosen,text"
    parser.add_argument("--source", metavar="NAMES", type=parse_names, default=("chosen",), help=words)
    words = "half-width of a range that no file states, as a share of the value (default 0.2)"
    parser.add_argument("--range", metavar="SHARE", type=_share, default=0.2, dest="share", help=words)
    words = "of the sensors' noise, the same in all runs, and of the trajectories (default 0)"
    parser.add_argument("--seed", metavar="N", type=whole_number(0, 2**62), default=0, help=words)
    words = "processes (default 1)"
    parser.add_argument("--workers", metavar="N", type=whole_number(1, 256), default=1, help=words)
    add_executor(parser)
    words = "change a value of the scenario file, e.g. floor=pvc; may be given many times"
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], dest="overrides", help=words
    )
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="where the result goes")
    words = "write into --out although it is not empty; another study there is replaced"
    parser.add_argument("--force", action="store_true", help=words)
    parser.add_argument("--json", action="store_true", help="print sensitivity.json instead of the tables")


def _share(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value <= _MAX_SHARE:
        raise argparse.ArgumentTypeError(f"found {text[:40]!r}; must be above 0 and at most {_MAX_SHARE}")
    return value


def _absolute(file: Path | None) -> Path | None:
    """A worker may be in another folder."""
    return None if file is None else file.absolute()


def run(arguments: Any) -> int:
    """Drives, measures, writes, prints.

    Returns:
      0, whatever the numbers say; 130 after Ctrl-C with what was finished; 1 when a run broke down.

    Raises:
      InputError: An option out of its range, or a folder that holds something else.
      SimulationError: A worker died; what was finished is kept.
    """
    from omnimj.simulate.scenario.scenario import absolute_scenario
    from omnimj.studies.sensitivity.study import NUMBERS, SensitivityConfig, check_config, run_sensitivity
    from omnimj.studies.sensitivity.trial import TrialConfig, nominal_scenario
    from omnimj.studies.workers import open_executor
    from omnimj.view.report.sensitivity import write_sensitivity_files

    asked = TrialConfig(
        absolute_scenario(arguments.scenario),
        tuple(arguments.overrides),
        _absolute(arguments.model),
        _absolute(arguments.floors),
        arguments.plant,
        arguments.method,
    )
    order = SensitivityConfig(
        arguments.out,
        asked,
        arguments.trajectories,
        arguments.seed,
        arguments.share,
        arguments.source,
        arguments.workers,
        arguments.force,
    )
    scenario = nominal_scenario(asked)
    announce_compilation(order.trial.plant, scenario.plant)
    check_config(order)
    with open_executor(arguments.executor) as executor, ProgressBar() as bar:
        outcome = run_sensitivity(
            order,
            lambda phrase, share: bar.show(round(_FINE * min(max(share, 0.0), 1.0)), _FINE, phrase),
            executor,
        )
    if outcome.runs:
        note_compiled(order.trial.plant, scenario.plant)
    write_sensitivity_files(arguments.out, outcome)
    if arguments.json:
        print((arguments.out / NUMBERS).read_text(encoding="utf-8"), end="")
    else:
        print(_format_study(outcome, arguments.out))
    return 130 if outcome.interrupted else 1 if outcome.errors else 0


def _format_study(outcome: SensitivityResult, folder: Path) -> str:
    from omnimj.studies.sensitivity.tables import (
        format_excluded,
        measure_first_sentence,
        measure_first_table,
        results_table,
        summary_sentences,
    )

    parts = ["\n".join(summary_sentences(outcome))]
    parts += [
        f"{one.title}\n{format_table(one.head, one.rows)}"
        for one in (measure_first_table(outcome, _MAX_ROWS), results_table(outcome))
        if one.rows
    ]
    if outcome.excluded:
        parts.append("\n".join(("Left out", *format_excluded(outcome))))
    parts.append(measure_first_sentence(outcome))
    if outcome.interrupted:
        parts.append("interrupted; the same command goes on from here")
    parts.append(f"written to {folder}")
    return "\n\n".join(parts)
