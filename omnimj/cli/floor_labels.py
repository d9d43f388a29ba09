"""`omnimj diagnose --floor-labels`: which wheel stands on which floor."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import command_line, parse_names
from omnimj.cli.progress import progress_bar
from omnimj.cli.terminal import format_json, format_table
from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.diagnosis.floor_labels.calibration import LabelCalibration
    from omnimj.diagnosis.floor_labels.currents import FloorPlan
    from omnimj.diagnosis.floor_labels.edge import EdgeLine
    from omnimj.diagnosis.floor_labels.files import LabelledDataset
    from omnimj.diagnosis.floor_labels.runs import PreparedRun
    from omnimj.recording.dataset import Dataset

_AUTO = "auto"
_OTHERS = ("method", "thresholds", "gains")
"""Options of the fault diagnosis, which has no part in this."""


def add_floor_label_arguments(parser: argparse.ArgumentParser) -> None:
    """Add `--floor-labels`, `--calibrate-on` and `--edge-line`."""
    group = parser.add_argument_group("which wheel stands on which floor, from currents and wheel speeds")
    words = "floors on which wheels may stand, with commas; no inertial unit is needed"
    group.add_argument("--floor-labels", metavar="A,B", type=parse_names, help=words)
    words = "folders of runs that stay on one of these floors, for noise and threshold"
    group.add_argument("--calibrate-on", metavar="DIR", type=Path, nargs="+", help=words)
    words = "truth from the camera: B lies beyond x cos a + y sin a = c, in m and degrees (a = 0 if absent); "
    words += "auto: placed by the other half of the runs"
    group.add_argument("--edge-line", metavar="C,A|auto", type=_edge_line, help=words)


def _edge_line(text: str) -> tuple[float, float] | str:
    if text == _AUTO:
        return text
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 2 or not all(map(math.isfinite, numbers)):
        raise argparse.ArgumentTypeError(
            f"found {text[:40]!r}; an offset [m], with an angle [deg] after a comma, or auto is needed"
        )
    return numbers[0], math.radians(numbers[1]) if len(numbers) == 2 else 0.0


def wants_floor_labels(arguments: Any) -> bool:
    """Whether `--floor-labels` is given, with all that it needs and nothing else."""
    if arguments.floor_labels is None:
        for name in ("calibrate_on", "edge_line"):
            if getattr(arguments, name) is not None:
                option = "--" + name.replace("_", "-")
                raise InputError(
                    option, "is given without --floor-labels", "name the floors, e.g. green,table"
                )
        return False
    if arguments.calibrate_on is None:
        raise InputError("--floor-labels", "--calibrate-on is missing", "runs on one floor set the threshold")
    for name in _OTHERS:
        if getattr(arguments, name) is not None:
            rule = "it belongs to the diagnosis of faults; give only one of the two"
            raise InputError(f"--{name}", "is given beside --floor-labels", rule)
    return True


def run_floor_labels(arguments: Any) -> int:
    """Label the floor under each wheel in all runs of a dataset, and write the results."""
    from omnimj.diagnosis.floor_labels.files import REPORT_FILE, write_labels
    from omnimj.recording.folder import check_folder
    from omnimj.view.report.floor_labels import write_floor_report

    check_folder(arguments.out, arguments.force)
    found = _labelled(arguments)
    command = command_line(arguments)
    content = write_labels(arguments.out, arguments.force, found, command)
    write_floor_report(arguments.out / REPORT_FILE, found, command)
    print(format_json(content) if arguments.json else _format(found, arguments.out))
    return 0


def _labelled(arguments: Any) -> LabelledDataset:
    from omnimj.diagnosis.floor_labels.calibration import calibrate_labels
    from omnimj.diagnosis.floor_labels.currents import FloorPlan
    from omnimj.diagnosis.floor_labels.files import LabelledDataset
    from omnimj.diagnosis.floor_labels.runs import label_runs, prepare_runs, score_board
    from omnimj.diagnosis.replay import require_other_folder
    from omnimj.parameters import read_robot
    from omnimj.parameters.floor import all_floors, find_floor
    from omnimj.recording.read_dataset import read_dataset

    floors = all_floors(arguments.floors)
    chosen = tuple(find_floor(name, "--floor-labels", floors) for name in arguments.floor_labels)
    plan = FloorPlan(read_robot(arguments.model), chosen)
    dataset = read_dataset(arguments.dataset, floors)
    others = [read_dataset(folder, floors) for folder in arguments.calibrate_on]
    for one in (dataset, *others):
        _check_machine(plan, one)
        require_other_folder(one, arguments.out)
    if arguments.edge_line is not None:
        _require_pose(dataset)
    calibration = calibrate_labels(plan, others)
    with progress_bar(arguments) as bar:
        prepared = prepare_runs(plan, dataset, bar.show)
    lines = _lines(arguments, plan, prepared, calibration)
    runs = tuple(label_runs(plan, dataset, prepared, calibration, lines))
    board = score_board(runs) if lines else None
    return LabelledDataset(plan, dataset, calibration, lines, runs, board)


def _check_machine(plan: FloorPlan, dataset: Dataset) -> None:
    robot = plan.robot
    if dataset.plant != robot.plant:
        rule = "only wheels of a robot stand on different floors"
        raise InputError(dataset.path, f"plant is {dataset.plant!r}", rule, (robot.plant,))
    if dataset.wheels != robot.wheel_count:
        found, rule = (
            f"has {robot.wheel_count} [[wheels]]",
            f"the logs of {dataset.path} have {dataset.wheels}",
        )
        raise InputError(robot.file, found, rule)


def _require_pose(dataset: Dataset) -> None:
    for run in dataset.runs:
        if not {"x", "y", "heading"} <= set(run.columns):
            rule = "the truth of an edge needs a measured x, y and heading"
            raise InputError(f"{dataset.path}: run {run.name!r}", "has no measured pose", rule)


def _lines(
    arguments: Any, plan: FloorPlan, prepared: Sequence[PreparedRun], calibration: LabelCalibration
) -> dict[str, EdgeLine]:
    from omnimj.diagnosis.floor_labels.edge import EdgeLine
    from omnimj.diagnosis.floor_labels.runs import lines_of_other_half

    if arguments.edge_line is None:
        return {}
    if arguments.edge_line == _AUTO:
        return lines_of_other_half(plan, prepared, calibration)
    if len(plan.floors) != 2:
        raise InputError(
            "--edge-line", f"found {len(plan.floors)} floors", "an edge line separates exactly two floors"
        )
    return {made.run.name: EdgeLine(*arguments.edge_line) for made in prepared}


def _format(found: LabelledDataset, out: Path) -> str:
    from omnimj.view.report.floor_labels import SCORE_HEAD, describe_crossings, describe_start, score_rows

    names = found.floors
    rows = [(run.name, describe_start(run, names), describe_crossings(run, names)) for run in found.runs]
    lines = [format_table(("run", "floors at the start", "crossings"), rows), ""]
    many = sum(len(run.crossings) for run in found.runs)
    with_any = sum(bool(run.crossings) for run in found.runs)
    seen = sum(bool(len(run.time)) for run in found.runs)
    lines.append(f"{many} crossings in {with_any} of {seen} runs that drive steadily")
    calibration = found.calibration
    lines.append(
        f"threshold {calibration.price:.3g} from {calibration.runs} runs on one floor "
        f"(most needed {calibration.needed:.3g}, {calibration.hardest})"
    )
    if found.board is not None:
        lines += ["", *_line_words(found), format_table(SCORE_HEAD, score_rows(found.board))]
    lines.append(f"written to {out}")
    return "\n".join(lines)


def _line_words(found: LabelledDataset) -> list[str]:
    words = []
    for line in dict.fromkeys(found.lines.values()):
        text = f"edge at {line.offset:.3f} m, {math.degrees(line.angle):.1f} deg"
        if line.offset_range is not None:
            low, high = line.offset_range
            text += f" (90 % range {low:.3f} to {high:.3f} m), placed by the other half of the runs"
        words.append(text)
    return words
