"""`omnimj identify`: floors from rig runs, a robot from its own; `omnimj validate`: the model compared."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import (
    MODEL,
    Command,
    add_accept,
    add_floors,
    add_results,
    add_workers,
    command_line,
    exit_code,
)
from omnimj.cli.identify_robot import format_robot, identify_robot_dataset
from omnimj.cli.progress import progress_bar
from omnimj.cli.terminal import (
    announce_compilation,
    format_json,
    format_table,
    format_value,
    note_compiled,
)
from omnimj.cli.validate_robot import validate_robot_dataset
from omnimj.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from omnimj.estimate.identification.records import (
        Cell,
        Estimate,
        Identification,
        IdentifiedFloor,
        Validation,
    )
    from omnimj.estimate.robot.records import RobotIdentification
    from omnimj.parameters import Floor
    from omnimj.recording.dataset import Dataset


IDENTIFY_FILES = ("floors.toml", "identification.json", "report.html")


def add_identify_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj identify`."""
    words = "folder of rig runs, or of healthy drives of a robot, with dataset.toml; or a folder of datasets"
    parser.add_argument("dataset", type=Path, help=words)
    parser.add_argument("--model", metavar="FILE", type=Path, help=MODEL)
    add_workers(parser)
    add_accept(parser)
    add_results(parser, "identification.json")


def run_identify(arguments: Any) -> int:
    """Identify the floors of a rig, or a robot, or those of each dataset of a folder; 1 if one failed."""
    from omnimj.cli.fleet import is_fleet, run_fleet
    from omnimj.estimate.identification.records import Identification

    if is_fleet(arguments.dataset):
        return run_fleet(arguments, identify_in_fleet, _FLEET_HEAD, _fleet_row)
    found, content = _identify_dataset(arguments)
    if not isinstance(found, Identification):
        print(format_json(content) if arguments.json else format_robot(found, arguments.out))
        return 0
    print(format_json(content) if arguments.json else _format_identification(found, arguments.out))
    return exit_code(found.interrupted)


_FLEET_HEAD = ("dataset", "floors", "mu_s", "mu_c")


def identify_in_fleet(arguments: Any) -> dict[str, Any]:
    """Identify the floors of one dataset of several, write its files and return a summary."""
    from omnimj.estimate.identification.records import Identification

    found, _ = _identify_dataset(arguments)
    if not isinstance(found, Identification):
        floors = {floor.floor: floor.chosen.numbers for floor in found.floors}
        return {"floors": floors, "robot": {one.name: one.value for one in found.estimates}}
    return {"floors": {floor.floor: {e.name: e.value for e in floor.estimates} for floor in found.floors}}


def _fleet_row(name: str, summary: Mapping[str, Any]) -> tuple[str, ...]:
    floors = summary["floors"]
    values = (", ".join(format_value(one.get(key)) for one in floors.values()) for key in ("mu_s", "mu_c"))
    return name, ", ".join(floors), *values


def _identify_dataset(arguments: Any) -> tuple[Identification | RobotIdentification, dict[str, Any]]:
    """Identify every floor or the robot of a dataset, and write all files."""
    from omnimj.estimate.gap.check.acceptance import fault_records, sound_dataset
    from omnimj.estimate.identification.files import identification_content
    from omnimj.estimate.identification.identify import identify
    from omnimj.estimate.rig_runs import FLOOR_FRICTION, require_rig
    from omnimj.parameters import read_rig
    from omnimj.recording.folder import check_folder
    from omnimj.recording.read_dataset import read_dataset

    check_folder(arguments.out, arguments.force)
    dataset = read_dataset(arguments.dataset)
    if dataset.plant == "uto_robot":
        return identify_robot_dataset(arguments, dataset)
    rig = read_rig(arguments.model)
    require_rig(dataset, FLOOR_FRICTION)
    dataset, check = sound_dataset(dataset, rig, arguments.accept)
    with progress_bar(arguments) as bar:
        found = identify(dataset, rig, bar.show)
    if found.interrupted and not found.floors:
        raise KeyboardInterrupt
    content = identification_content(found, command_line(arguments))
    content["data_faults"] = fault_records(check)
    _write_identification(arguments, found, content)
    return found, content


def _write_identification(arguments: Any, found: Identification, content: dict[str, Any]) -> None:
    from omnimj.estimate.identification.files import write_floors
    from omnimj.recording.folder import make_folder
    from omnimj.recording.json_files import write_json
    from omnimj.view.report.identification import write_identification_report

    make_folder(arguments.out, arguments.force, IDENTIFY_FILES)
    write_floors(arguments.out / IDENTIFY_FILES[0], found)
    write_json(arguments.out / IDENTIFY_FILES[1], content)
    write_identification_report(arguments.out / IDENTIFY_FILES[2], found, content["command"])


def _format_identification(found: Identification, out: Path) -> str:
    lines = list(found.notes)
    for floor in found.floors:
        lines += ["", *_format_floor(floor)]
    lines += ["", *(["interrupted"] if found.interrupted else []), f"written to {out}"]
    return "\n".join(lines).lstrip("\n")


def _format_floor(floor: IdentifiedFloor) -> list[str]:
    low, high = floor.curve.covered
    lines = [f"{floor.floor}: {len(floor.runs)} runs, masses {', '.join(f'{m:g}' for m in floor.masses)} kg"]
    rows = [
        (e.name, format_value(e.value, "" if e.unit == "1" else e.unit), format_interval(e))
        for e in floor.estimates
    ]
    lines.append(format_table(("parameter", "value", "90 % interval"), rows))
    if low == low:
        lines.append(f"curve F/F_N over {1000 * low:.3g} … {1000 * high:.3g} mm/s of slip")
    lines += [f"- {sentence}" for sentence in floor.undetermined]
    if floor.left_out:
        lines.append(f"- not fitted, since they show no slip: {', '.join(floor.left_out)}")
    return lines


def format_interval(estimate: Estimate) -> str:
    """Format an interval as `0.118 … 0.122`, or in words if one end is open."""
    if estimate.low is None and estimate.high is None:
        return "not determined"
    if estimate.low is None:
        return f"≤ {estimate.high:.4g}, open below"
    if estimate.high is None:
        return f"≥ {estimate.low:.4g}, open above"
    return f"{estimate.low:.4g} … {estimate.high:.4g}"


VALIDATE_FILES = ("validation.json", "report.html")
CHOICES = ("twin", "planar", "both")


def add_validate_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj validate`."""
    words = "folder of rig runs, or of drives of a robot with a measured pose, with dataset.toml"
    parser.add_argument("dataset", type=Path, help=words)
    parser.add_argument("--model", metavar="FILE", type=Path, help=MODEL)
    add_floors(parser)
    parser.add_argument("--plant", metavar="P", default="both", help="twin, planar or both (default)")
    words = "of a robot: record this run beside its simulation, recording.rrd for rerun"
    parser.add_argument("--recording", metavar="RUN", help=words)
    add_accept(parser)
    add_results(parser, "validation.json")


def run_validate(arguments: Any) -> int:
    """Simulate every measured run again and write the comparison."""
    from omnimj.recording.folder import check_folder

    if arguments.plant not in CHOICES:
        raise UnknownNameError("--plant", "plant", arguments.plant, CHOICES)
    plants = ("twin", "planar") if arguments.plant == "both" else (arguments.plant,)
    check_folder(arguments.out, arguments.force)
    from omnimj.parameters.floor import all_floors
    from omnimj.recording.read_dataset import read_dataset

    floors = all_floors(arguments.floors)
    dataset = read_dataset(arguments.dataset, floors)
    if dataset.plant == "uto_robot":
        return validate_robot_dataset(arguments, dataset, floors)
    return _validate_rig_dataset(arguments, dataset, floors, plants)


def _validate_rig_dataset(
    arguments: Any, dataset: Dataset, floors: Mapping[str, Floor], plants: tuple[str, ...]
) -> int:
    from omnimj.estimate.gap.check.acceptance import fault_records, sound_dataset
    from omnimj.estimate.identification.files import validation_content
    from omnimj.estimate.identification.validation import validate
    from omnimj.estimate.rig_runs import DISSERTATION_TABLE, require_rig
    from omnimj.parameters import read_rig

    rig = read_rig(arguments.model)
    require_rig(dataset, DISSERTATION_TABLE)
    if arguments.recording is not None:
        found, rule = f"found {arguments.recording!r}", "only drives of a robot are recorded: leave it out"
        raise InputError("--recording", found, rule)
    dataset, check = sound_dataset(dataset, rig, arguments.accept)
    for plant in plants:
        announce_compilation(plant, "quarter_rig", quiet=arguments.quiet)
    with progress_bar(arguments) as bar:
        found = validate(dataset, rig, floors, plants, bar.show)
    if not found.runs:
        raise KeyboardInterrupt
    for plant in plants:
        note_compiled(plant, "quarter_rig")
    content = validation_content(found, command_line(arguments))
    content["data_faults"] = fault_records(check)
    _write_validation(arguments, found, content)
    print(format_json(content) if arguments.json else _format_validation(found, arguments.out))
    return exit_code(found.interrupted)


def _write_validation(arguments: Any, found: Validation, content: dict[str, Any]) -> None:
    from omnimj.recording.folder import make_folder
    from omnimj.recording.json_files import write_json
    from omnimj.view.report.validation import write_validation_report

    make_folder(arguments.out, arguments.force, VALIDATE_FILES)
    write_json(arguments.out / VALIDATE_FILES[0], content)
    write_validation_report(arguments.out / VALIDATE_FILES[1], found, content["command"])


def _format_validation(found: Validation, out: Path) -> str:
    sideways = any(cell.lateral_speed for cell in found.cells)
    head = ["mass kg", "floor", *(["lateral m/s"] if sideways else []), "current A"]
    head += [f"{plant} m/s" for plant in found.plants] + ["published m/s"]
    lines = [*found.notes, format_table(head, [_row(cell, found.plants, sideways) for cell in found.cells])]
    means = ", ".join(f"{plant} {found.mean(plant):.4f}" for plant in found.plants)
    lines.append(f"RMS error of the carriage's speed, mean over {len(found.cells)} conditions: {means} m/s")
    if found.effects:
        lines.append(f"effects of the model: {', '.join(found.effects)}")
    if found.interrupted:
        lines.append("interrupted")
    lines.append(f"written to {out}")
    return "\n".join(lines)


def _row(cell: Cell, plants: tuple[str, ...], sideways: bool) -> list[str]:
    row = [f"{cell.mass:g}", cell.floor, *([f"{cell.lateral_speed:+.2f}"] if sideways else [])]
    row += [f"{cell.current:.2f}", *(f"{cell.rms[plant]:.4f}" for plant in plants)]
    return [*row, " → ".join(f"{value:.3f}" for value in cell.published) or "–"]


IDENTIFY = Command(
    "identify",
    "identify floors from rig runs, or a robot from healthy drives, with confidence intervals",
    """rig runs: writes floors.toml (for omnimj validate --floors), identification.json, report.html
drives of a robot: writes model.toml, floors.toml, thresholds.toml, identification.json, report.md

examples:
  omnimj record rig_currents --out data/currents
  omnimj identify data/currents --out out/floors
  omnimj validate data/validation --floors out/floors/floors.toml --out out/validation
  omnimj identify data/healthy --model my_robot.toml --out out/robot
  omnimj diagnose data/missions --model out/robot/model.toml --floors out/robot/floors.toml --out out/logs""",
    add_identify_arguments,
    run_identify,
)


VALIDATE = Command(
    "validate",
    "drive a model as measured, and compare: a rig with the published table, a robot by floor and speed",
    """rig runs: measured currents drive the model; speed errors beside the published ones
drives of a robot: the wheels turn as measured; velocity, currents and heading by floor and speed

examples:
  omnimj record rig_validation --out data/validation
  omnimj validate data/validation --out out/validation
  omnimj validate data/validation --model out/gap/model.toml --plant twin --out out/after
  omnimj validate data/soft --model robotino --floors floors.toml --recording run_7 --out out/robot""",
    add_validate_arguments,
    run_validate,
)
