"""`omnimj tune`: search for the gains of cascade, recovery and observer over random runs."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import (
    INTERRUPTED,
    ROBOT_MODEL,
    Command,
    add_seed,
    add_thresholds,
    add_workers,
    command_line,
    parse_names,
    positive_number,
    read_gains_file,
    read_thresholds,
    require_writable,
    whole_number,
)
from omnimj.cli.progress import run_on_executor
from omnimj.cli.terminal import announce_compilation, format_table, note_compiled, print_result
from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.studies.tuning.study import TuningConfig, TuningResult


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj tune`."""
    words = "names from `omnimj scenarios`, or paths to TOML files; of a robot on a flat floor"
    parser.add_argument("scenarios", metavar="SCENARIO", nargs="+", help=words)
    parser.add_argument("--out", metavar="FILE", type=Path, required=True, help="the gains file to write")
    words = (
        "gains or groups of them: control, recovery, observer, control.speed_proportional, … (default all)"
    )
    parser.add_argument("--only", metavar="NAMES", type=parse_names, default=(), help=words)
    words = "least and largest value of a gain, NAME=LOW:HIGH (default: a factor of 4 either way); repeatable"
    parser.add_argument("--bound", metavar="TEXT", action="append", default=[], dest="bounds", help=words)
    parser.add_argument("--plant", metavar="P", default="planar", help="planar (default) or twin")
    add_seed(parser, "seed of draws and search, 0 to 99; the result is judged with 100 more", 99)
    words = "random runs per scenario for each candidate (default 4)"
    parser.add_argument("--trials", metavar="N", type=whole_number(1, 1000), default=4, help=words)
    many = parser.add_mutually_exclusive_group()
    words = "generations of the search (default 20)"
    many.add_argument("--generations", metavar="N", type=whole_number(1, 10**4), default=20, help=words)
    words = "the same as a number of candidates, in whole generations"
    many.add_argument("--evaluations", metavar="N", type=whole_number(1, 10**6), help=words)
    words = "random runs per scenario to judge the result with (default 8)"
    parser.add_argument("--judging", metavar="N", type=whole_number(1, 1000), default=8, help=words)
    words = "further judging runs per scenario on the twin (default 0)"
    parser.add_argument("--twin", metavar="N", type=whole_number(0, 1000), default=0, help=words)
    words = "grid points per side of the plots of the cost around the result (default 7; 0: none)"
    parser.add_argument("--landscape", metavar="N", type=_points, default=7, help=words)
    limit = positive_number(1e3)
    words = "longest time at the largest current for a healthy wheel (default 0.5)"
    parser.add_argument("--saturation", metavar="SECONDS", type=limit, default=0.5, help=words)
    words = "smallest phase margin of any loop (default 40)"
    parser.add_argument("--phase-margin", metavar="DEGREES", type=limit, default=40.0, help=words)
    words = "largest overshoot of a step in wheel speed, as a share (default 0.3)"
    parser.add_argument("--overshoot", metavar="SHARE", type=limit, default=0.3, help=words)
    words = f"{ROBOT_MODEL} (default: uto_robot)"
    parser.add_argument("--model", metavar="FILE", type=Path, help=words)
    words = "initial gains, in a file as tune writes it (default: the model's and the shipped ones)"
    parser.add_argument("--gains", metavar="FILE", type=Path, help=words)
    add_thresholds(parser)
    add_workers(parser)
    parser.add_argument("--force", action="store_true", help="replace FILE, and trials with other settings")
    words = "print the result as JSON instead of the table"
    parser.add_argument("--json", action="store_true", help=words)


def _points(text: str) -> int:
    found = whole_number(0, 99)(text)
    if found == 1:
        raise argparse.ArgumentTypeError("found '1'; must be 0, or at least 2")
    return found


def run(arguments: Any) -> int:
    """Search for gains, judge them on other seeds, and write them with a report; 1 if they are not better."""
    from omnimj.recording.json_files import write_text
    from omnimj.studies.tuning.reporting import format_gains_file
    from omnimj.studies.tuning.study import check_config, run_tuning
    from omnimj.view.report.tuning import write_tuning_report

    config = _config(arguments)
    require_writable(config.out, arguments.force)
    if not config.out.parent.is_dir():
        raise InputError(f"--out {config.out}", f"cannot be written: there is no folder {config.out.parent}")
    report = config.out.with_name(f"{config.out.stem}_report.html")
    require_writable(report, arguments.force)
    check_config(config)
    for plant in (config.plant, *(("twin",) if config.twin else ())):
        announce_compilation(plant, "uto_robot", quiet=arguments.quiet)
    outcome = run_on_executor(arguments, run_tuning, config)
    if outcome is None:
        words = f"finished trials are kept in {config.folder}, and the same command continues"
        print(f"omnimj: interrupted; {words}", file=sys.stderr)
        return INTERRUPTED
    note_compiled(config.plant, "uto_robot")
    command = command_line(arguments)
    text = json.dumps(_as_plain(outcome), indent=2) if arguments.json else _format_tuning(outcome)
    print_result(text)
    write_text(config.out, format_gains_file(outcome, command))
    write_tuning_report(report, outcome, command)
    if not arguments.json:
        print(f"\nwritten to {config.out} and {report}")
    return 0 if outcome.is_better else 1


def _config(arguments: Any) -> TuningConfig:
    from omnimj.studies.tuning.cost import Limits
    from omnimj.studies.tuning.search import parse_bound, select_gains
    from omnimj.studies.tuning.study import TuningConfig, generations_for

    chosen = select_gains(arguments.only)
    generations = arguments.generations
    if arguments.evaluations is not None:
        generations = generations_for(arguments.evaluations, chosen)
    return TuningConfig(
        out=arguments.out,
        scenarios=tuple(arguments.scenarios),
        names=chosen,
        bounds=dict(parse_bound(text) for text in arguments.bounds),
        plant=arguments.plant,
        seed=arguments.seed,
        trials=arguments.trials,
        judging=arguments.judging,
        twin=arguments.twin,
        generations=generations,
        landscape=arguments.landscape,
        limits=Limits(arguments.saturation, arguments.phase_margin, arguments.overshoot),
        workers=arguments.workers,
        force=arguments.force,
        model=arguments.model,
        gains=read_gains_file(arguments.gains, arguments.model),
        thresholds=read_thresholds(arguments.thresholds, "robust"),
    )


def _format_tuning(outcome: TuningResult) -> str:
    """Format gains before and after, their scores on the judging seeds, and the verdict."""
    from omnimj.studies.tuning.reporting import comparison_rows, format_verdict

    rows = [
        (axis.name, f"{axis.start:g}", f"{value:g}", axis.unit)
        for axis, value in zip(outcome.axes, outcome.values, strict=True)
    ]
    parts = [format_table(("gain", "before", "tuned", "unit"), rows)]
    for verdict in outcome.comparisons:
        words = f"judged with seed {verdict.seed}, {verdict.draws} runs on the {verdict.plant} plant"
        parts.append(f"{words}\n{format_table(('', 'before', 'tuned'), comparison_rows(verdict))}")
    parts.append(format_verdict(outcome))
    return "\n\n".join(parts)


def _as_plain(outcome: TuningResult) -> dict[str, Any]:
    from omnimj.recording.json_files import to_jsonable

    return to_jsonable(
        {
            "gains": {axis.name: value for axis, value in zip(outcome.axes, outcome.values, strict=True)},
            "before": {axis.name: axis.start for axis in outcome.axes},
            "candidates": len(outcome.tried),
            "better": outcome.is_better,
            "judged": [
                {
                    "plant": verdict.plant,
                    "seed": verdict.seed,
                    "draws": verdict.draws,
                    "better": verdict.is_better,
                    "before": dataclasses.asdict(dataclasses.replace(verdict.before, terms={}))
                    | {"terms": verdict.before.terms},
                    "after": dataclasses.asdict(dataclasses.replace(verdict.after, terms={}))
                    | {"terms": verdict.after.terms},
                }
                for verdict in outcome.comparisons
            ],
            "margins": [dataclasses.asdict(margin) for margin in outcome.margins_after],
        }
    )


TUNE = Command(
    "tune",
    "search the gains of cascade, recovery and observer over random runs, and judge them on other seeds",
    """examples:
  omnimj tune nylon_patch degraded_motor circle_8m square_path --out tuned_gains.toml
  omnimj tune circle_8m --only control --trials 8 --generations 30 --workers 2 --out circle_gains.toml
  omnimj tune degraded_motor --executor dask:tcp://127.0.0.1:8786 --out gains.toml
  omnimj run circle_8m --gains tuned_gains.toml

Candidates are driven with seed N, 0 to 99; the result is judged with seed 100 + N, which is never tuned with.
The exit code is 0 when the result is better there, 1 when it is not; FILE states which.
Trials are kept in a folder beside FILE: the same command resumes an interrupted search.""",
    add_arguments,
    run,
    resumes=True,
)
