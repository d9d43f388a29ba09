"""`omnimj record`: datasets of a simulated plant in the form that a data logger writes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import Command, add_floors, add_seed, command_line, exit_code, whole_number
from omnimj.cli.progress import progress_bar
from omnimj.cli.terminal import announce_compilation, format_json, note_compiled
from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.simulate.suites.recording import RecordingResult
    from omnimj.simulate.suites.suite import Suite


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj record`."""
    parser.add_argument("suite", help="test plan, see below")
    parser.add_argument(
        "--effect",
        metavar="NAME[:KEY=VALUE,…]",
        action="append",
        default=[],
        dest="effects",
        help="physics that the model lacks, hidden in the data; repeatable",
    )
    add_seed(parser, "seed of the sensors' noise and of random conditions")
    parser.add_argument("--model", metavar="FILE", type=Path, help="a copy of the plant's model file")
    add_floors(parser)
    parser.add_argument(
        "--repeats",
        metavar="N",
        type=whole_number(1, 26),
        help="repeats of every condition, which give the repeatability (default: as in the suite)",
    )
    parser.add_argument(
        "--format", metavar="F", default="parquet", dest="table_format", help="parquet (default) or csv"
    )
    words = "record the robot's pose at HZ samples per second, as a camera does, and no inertial unit"
    parser.add_argument("--pose-rate", metavar="HZ", type=whole_number(20, 1000), help=words)
    parser.add_argument(
        "--plant", metavar="P", help="twin (default) or planar; machines with an MJCF file have the twin"
    )
    parser.add_argument("--out", metavar="DATASET", type=Path, required=True, help="folder of the dataset")
    parser.add_argument(
        "--force", action="store_true", help="replace an earlier dataset that omnimj wrote to --out"
    )
    parser.add_argument("--json", action="store_true", help="print a summary as JSON")


def run(arguments: Any) -> int:
    """Simulate the runs of the suite and write the dataset."""
    from omnimj.simulate.suites.catalogue import find_suite

    suite = find_suite(arguments.suite)
    effects = _effects(arguments.effects, suite.plant)
    recorded = _record(arguments, suite, effects)
    print(_json(arguments, recorded) if arguments.json else _format_recorded(arguments, suite, recorded))
    return exit_code(recorded.interrupted)


def _effects(texts: list[str], plant: str) -> dict[str, Any]:
    if not texts:
        return {}
    from omnimj.effects import MJCF, find_effect, parse_effect

    effects: dict[str, Any] = {}
    for text in texts:
        find_effect(text.partition(":")[0].strip(), plant, f"--effect {text}")
        # parts of an MJCF file are known once it is read
        name, values = parse_effect(text, None if plant == MJCF else plant)
        if name in effects:
            rule = f"a second one is called {name}_2"
            raise InputError(f"--effect {text}", f"{name!r} is given twice", rule)
        effects[name] = values
    return effects


def _record(arguments: Any, suite: Suite, effects: dict[str, Any]) -> RecordingResult:
    from omnimj.recording.folder import check_folder
    from omnimj.simulate.suites.recording import RecordingConfig, plant_for, record_suite

    arguments.plant = plant_for(suite, arguments.plant)
    check_folder(arguments.out, arguments.force)
    # before the imports that compile
    announce_compilation(arguments.plant, suite.plant, quiet=arguments.quiet)
    order = RecordingConfig(
        arguments.out,
        arguments.seed,
        arguments.repeats,
        arguments.plant,
        arguments.model,
        arguments.floors,
        effects,
        arguments.table_format,
        arguments.force,
        arguments.pose_rate,
    )
    with progress_bar(arguments) as bar:
        recorded = record_suite(suite, order, bar.show)
    if recorded.runs:
        note_compiled(arguments.plant, suite.plant)
    return recorded


def _json(arguments: Any, recorded: RecordingResult) -> str:
    summary = {
        "suite": arguments.suite,
        "plant": arguments.plant,
        "seed": arguments.seed,
        "effects": arguments.effects,
        "dataset": str(arguments.out),
        "runs": list(recorded.runs),
        "planned": recorded.planned,
        "samples": recorded.samples,
        "interrupted": recorded.interrupted,
        "command": command_line(arguments),
    }
    return format_json(summary)


def _format_recorded(arguments: Any, suite: Suite, recorded: RecordingResult) -> str:
    lines = [
        f"{suite.name}: {suite.description}",
        f"{suite.plant}, plant {arguments.plant}, seed {arguments.seed}, "
        f"{len(recorded.runs)} of {recorded.planned} runs, {recorded.samples} samples",
        f"effects: {', '.join(arguments.effects) or 'none'}",
    ]
    if recorded.interrupted:
        lines.append("interrupted")
    if recorded.runs:
        lines.append(f"written to {arguments.out}; it names neither effects nor seed")
    return "\n".join(lines)


RECORD = Command(
    "record",
    "record a test plan with the twin as a dataset, optionally with hidden effects",
    """suites:
  rig_currents    identification: 0.15 … 1.5 A on three floors, full mass
  rig_validation  validation: 0.45 … 1.5 A on three floors with three masses
  rig_lateral     sideways motion: four currents at eight lateral speeds on natural stone
  rig_mixed       for the gap: reversals, coasting, braking, slow and fast, straight and sideways
  robot_missions  six random missions of 20 s with the controller, on three floors
  axis_moves      the linear axis: fast, slow, short and crawling motions under position control
  machine_moves   the same of any machine with an MJCF file, given by --model

examples:
  omnimj record rig_currents --out data/currents
  omnimj record rig_mixed --effect rail_viscous:coefficient=2 --seed 7 --out data/hidden
  omnimj record robot_missions --pose-rate 50 --out data/camera""",
    add_arguments,
    run,
)
