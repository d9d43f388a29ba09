"""`omnimj evaluate` scores a method over random runs; `omnimj sensitivity` ranks uncertain parameters."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import (
    MODEL,
    Command,
    add_floors,
    add_gains,
    add_overrides,
    add_results,
    add_seed,
    add_thresholds,
    add_workers,
    exit_code,
    parse_names,
    positive_number,
    read_gains_file,
    read_thresholds,
    whole_number,
)
from omnimj.cli.progress import run_on_executor
from omnimj.cli.terminal import announce_compilation, format_study, note_compiled, print_study
from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.studies.evaluation.study import EvaluationResult
    from omnimj.studies.sensitivity.study import SensitivityResult


REPORT = "report.html"


def add_evaluate_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj evaluate`."""
    words = "missions (default; 60 s of random legs), manoeuvres (5 s, 24 directions, two speeds)"
    parser.add_argument("--suite", metavar="S", default="missions", help=words)
    parser.add_argument(
        "--method", metavar="M", default="off", help="fault detection: robust, published or off (default)"
    )
    words = "model of a robot with four wheels, e.g. from omnimj identify, whose intervals bound the draws"
    parser.add_argument("--model", metavar="FILE", type=Path, help=words)
    add_floors(parser)
    add_thresholds(parser)
    add_gains(parser)
    words = "change a setting of the method or the cascade, e.g. diagnosis.variant=printed; repeatable"
    parser.add_argument(
        "--set", metavar="KEY=VALUE", dest="settings", action="append", default=[], help=words
    )
    words = "planar (default), twin, or both separated by a comma: drawn for each case"
    parser.add_argument("--plant", metavar="P", type=parse_names, default=("planar",), help=words)
    words = "number of cases (default 100)"
    parser.add_argument("--trials", metavar="N", type=whole_number(1, 10**5 - 1), default=100, help=words)
    add_seed(parser, "seed of all cases; 0 to 99 are for setting thresholds and judge nothing", default=100)
    add_workers(parser)
    words = "classes to draw from: none, motor, slip, locked, free, hard_over, all_wheel_slip, sensor, two"
    words = f"{words} (default all), weak (a motor lacks a tenth)"
    parser.add_argument("--faults", metavar="NAMES", type=parse_names, help=words)
    words = "floors to draw from: natural_stone, pvc, paperboard, natural_stone_capped (default all)"
    parser.add_argument("--floor", metavar="NAMES", type=parse_names, help=words)
    words = "nominal (default): the physics of the controller's model; drawn: gear law, wheel radii, ripple, "
    words += "sensor delays and more differ in each case"
    parser.add_argument("--structure", metavar="S", default="nominal", help=words)
    words = "keep the measurements as a dataset in DIR/recordings"
    parser.add_argument("--record", action="store_true", help=words)
    add_results(parser, "evaluation.json", "evaluation")


def run_evaluate(arguments: Any) -> int:
    """Drive the cases, score them and write the results; 1 if a case failed."""
    from omnimj.studies.evaluation.cases import FLOORS, CasePopulation
    from omnimj.studies.evaluation.study import NUMBERS, EvaluationConfig, check_config, run_evaluation
    from omnimj.studies.random_truth import CLASSES
    from omnimj.view.report.evaluation import write_evaluation_report

    choice = CasePopulation(
        arguments.suite,
        arguments.seed,
        arguments.plant,
        arguments.floor or FLOORS,
        arguments.faults or CLASSES,
        structure=arguments.structure,
        model=_absolute(arguments.model),
        floors_file=_absolute(arguments.floors),
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
        read_gains_file(arguments.gains, arguments.model),
    )
    check_config(order)
    if arguments.record and arguments.executor not in (None, "threads"):
        found = f"found with --executor {arguments.executor}"
        raise InputError("--record", found, "recordings would stay on the disks of its workers")
    for plant in choice.plants:
        announce_compilation(plant, "uto_robot", quiet=arguments.quiet)
    outcome = run_on_executor(arguments, run_evaluation, order)
    for plant in {score.plant for score in outcome.scores}:
        note_compiled(plant, "uto_robot")
    write_evaluation_report(arguments.out / REPORT, outcome)
    print_study(arguments.out, NUMBERS, lambda: _format_evaluation(outcome, arguments.out), arguments.json)
    return exit_code(outcome.interrupted, outcome.failed)


def _format_evaluation(outcome: EvaluationResult, folder: Path) -> str:
    lines = (outcome.heading.replace("`", ""), *outcome.lines)
    head = "\n".join(line.replace("**", "") for line in lines)
    return format_study([head], outcome.tables, (), outcome.interrupted, folder)


_MAX_ROWS = 12  # rows of the table in the terminal
_MAX_SHARE = 0.9  # largest value of --range


def add_sensitivity_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj sensitivity`."""
    parser.add_argument("scenario", help="a name from `omnimj scenarios`, or a path to a TOML file")
    words = "number of trajectories; each one changes every parameter once (default 10)"
    parser.add_argument("--trajectories", metavar="N", type=whole_number(2, 1000), default=10, help=words)
    parser.add_argument("--plant", metavar="P", default="planar", help="planar (default) or twin")
    words = "fault detection: robust (default), published (default on the rig) or off"
    parser.add_argument("--method", metavar="M", help=words)
    words = f"{MODEL}: the controller's model, and the ranges"
    parser.add_argument("--model", metavar="FILE", type=Path, help=words)
    add_floors(parser)
    words = "sources of the parameters that are changed (default chosen), e.g. chosen,text"
    parser.add_argument("--source", metavar="NAMES", type=parse_names, default=("chosen",), help=words)
    words = "half-width of ranges without a stated uncertainty, as a share of the value (default 0.2)"
    parser.add_argument(
        "--range", metavar="SHARE", type=positive_number(_MAX_SHARE), default=0.2, dest="share", help=words
    )
    add_seed(parser, "seed of the sensors' noise, the same in all runs, and of the trajectories", 2**62)
    add_workers(parser)
    add_overrides(parser, "floor=pvc")
    add_results(parser, "sensitivity.json", "study")


def _absolute(file: Path | None) -> Path | None:
    """Return a path for workers with another working directory, or the name of a shipped model."""
    return file.absolute() if file is not None and file.exists() else file


def run_sensitivity(arguments: Any) -> int:
    """Drive the trajectories, rank the parameters and write the results; 1 if a run failed."""
    from omnimj.simulate.scenario.scenario import absolute_scenario
    from omnimj.studies.sensitivity.study import NUMBERS, SensitivityConfig, check_config, run_sensitivity
    from omnimj.studies.sensitivity.trial import TrialConfig, nominal_scenario
    from omnimj.view.report.sensitivity import write_sensitivity_files

    trial = TrialConfig(
        absolute_scenario(arguments.scenario),
        tuple(arguments.overrides),
        _absolute(arguments.model),
        _absolute(arguments.floors),
        arguments.plant,
        arguments.method,
    )
    order = SensitivityConfig(
        arguments.out,
        trial,
        arguments.trajectories,
        arguments.seed,
        arguments.share,
        arguments.source,
        arguments.workers,
        arguments.force,
    )
    scenario = nominal_scenario(trial)
    announce_compilation(order.trial.plant, scenario.plant, quiet=arguments.quiet)
    check_config(order)
    outcome = run_on_executor(arguments, run_sensitivity, order)
    if outcome.runs:
        note_compiled(order.trial.plant, scenario.plant)
    write_sensitivity_files(arguments.out, outcome)
    print_study(arguments.out, NUMBERS, lambda: _format_study(outcome, arguments.out), arguments.json)
    return exit_code(outcome.interrupted, outcome.errors)


def _format_study(outcome: SensitivityResult, folder: Path) -> str:
    from omnimj.studies.sensitivity.tables import (
        format_excluded,
        measure_first_sentence,
        measure_first_table,
        results_table,
        summary_sentences,
    )

    head = "\n".join(summary_sentences(outcome))
    tables = (measure_first_table(outcome, _MAX_ROWS), results_table(outcome))
    excluded = ["\n".join(("Left out", *format_excluded(outcome)))] if outcome.excluded else []
    notes = (*excluded, measure_first_sentence(outcome))
    return format_study([head], tables, notes, outcome.interrupted, folder)


EVALUATE = Command(
    "evaluate",
    "drive many random cases with a method, and judge its diagnoses and its recovery",
    """examples:
  omnimj evaluate --trials 200 --seed 100 --workers 2 --out out/missions
  omnimj evaluate --suite manoeuvres --faults motor,slip --seed 100 --out out/manoeuvres
  omnimj evaluate --faults none --plant twin --trials 180 --seed 100 --out out/quiet
  omnimj evaluate --trials 500 --executor dask:tcp://127.0.0.1:8786 --out out/cluster
  omnimj evaluate --faults motor,slip --structure drawn --seed 100 --out out/drawn
  omnimj evaluate --faults none --floor natural_stone --seed 11 --record --out out/stone
  omnimj calibrate out/stone/recordings --false-alarms-per-hour 0.1 --out thresholds.toml

Seeds 0 to 99 are for setting thresholds: an evaluation with one of them states that it judges nothing.
The same command resumes an interrupted --out; a larger --trials adds cases to it.""",
    add_evaluate_arguments,
    run_evaluate,
    resumes=True,
)


SENSITIVITY = Command(
    "sensitivity",
    "rank the chosen, not measured parameters by their effect on the results: what to measure first",
    """examples:
  omnimj sensitivity degraded_motor --out out/sensitivity
  omnimj sensitivity nylon_patch --trajectories 20 --workers 2 --out out/nylon
  omnimj sensitivity rig_constant_current --source chosen,text --out out/rig

Every parameter of the model files with source = "chosen", and of the scenario's floors, is varied over its
range: its `uncertainty` where the file states one, else 20 % of its value either way (--range). Whole numbers
change by one at least; a parameter that is 0 without a stated uncertainty is left out. Only the plant
changes: the controller keeps the model file, as it will on your robot until you have measured. The change of
a result across the range is the elementary effect (Morris); its mean size over the trajectories, μ*, ranks
the parameters. Effects that cannot be distinguished from noise are not ranked. Where a decision tips, such as
an alarm, few trajectories are chance: what is marked "perhaps" needs more of them.
The same command resumes an interrupted --out; a larger --trajectories adds to it.""",
    add_sensitivity_arguments,
    run_sensitivity,
    resumes=True,
)
