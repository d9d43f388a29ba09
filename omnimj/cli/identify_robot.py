"""`omnimj identify` for the logs of a robot: model, floors and thresholds from healthy driving."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import command_line
from omnimj.cli.progress import progress_bar
from omnimj.cli.terminal import format_table, format_value
from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.estimate.robot.records import RobotIdentification
    from omnimj.recording.dataset import Dataset

DEFAULT_RATE = 1.0
"""False alarms per hour of motion for which thresholds are set."""


def identify_robot_dataset(arguments: Any, dataset: Dataset) -> tuple[RobotIdentification, dict[str, Any]]:
    """Identify the robot of a dataset, write all files; return it with the content of the JSON file."""
    from omnimj.estimate.gap.check.acceptance import fault_records, sound_dataset
    from omnimj.estimate.robot.files import identification_content
    from omnimj.estimate.robot.identify import identify_robot, require_robot
    from omnimj.parameters import read_robot

    robot = read_robot(arguments.model)
    require_robot(dataset, robot)
    faults: list[dict[str, Any]] = []
    if not dataset.pose_measured:  # a pose is compared with the wheels when its delay is known
        dataset, check = sound_dataset(dataset, robot, arguments.accept)
        faults = fault_records(check)
    with progress_bar(arguments) as bar:
        found = identify_robot(dataset, robot, bar.show)
    content = identification_content(found, command_line(arguments))
    content["data_faults"] = faults
    _write_files(arguments, dataset, found, content)
    return found, content


def _write_files(
    arguments: Any, dataset: Dataset, found: RobotIdentification, content: dict[str, Any]
) -> None:
    """Write model, floors, thresholds, numbers and report; thresholds need the model on disk."""
    from omnimj.diagnosis.replay import require_other_folder
    from omnimj.estimate.robot import files
    from omnimj.estimate.robot.model_text import model_text
    from omnimj.recording.folder import make_folder
    from omnimj.recording.json_files import write_json, write_text

    out, command = arguments.out, content["command"]
    require_other_folder(dataset, out)
    make_folder(out, arguments.force, files.ROBOT_FILES)
    write_text(out / files.MODEL_FILE, model_text(found))
    write_text(out / files.FLOORS_FILE, files.floors_text(found))
    content["thresholds"] = words = _write_thresholds(out, dataset, command)
    write_json(out / files.JSON_FILE, content)
    write_text(out / files.REPORT_FILE, files.report_text(found, command, words))


def _write_thresholds(out: Path, dataset: Dataset, command: str) -> list[str]:
    """Write the thresholds for the identified model, and return sentences on them."""
    from omnimj.diagnosis.calibration import calibrate
    from omnimj.diagnosis.files import format_calibration, thresholds_toml, write_thresholds
    from omnimj.diagnosis.logs import read_machine
    from omnimj.diagnosis.replay import DiagnosisConfig, check_config
    from omnimj.estimate.robot import files
    from omnimj.parameters.floor import all_floors, own_floors

    if dataset.pose_measured:
        return ["no thresholds: the detector needs an inertial unit; those of omnimj hold"]
    machine = read_machine(dataset, out / files.MODEL_FILE)
    file = out / files.FLOORS_FILE
    config = DiagnosisConfig(dataset, machine, "robust", all_floors(file), expected_floors=own_floors(file))
    try:
        check_config(config)
        found = calibrate(config, DEFAULT_RATE)
    except InputError as error:  # the model is worth having without thresholds
        return [f"no thresholds: {error}"]
    write_thresholds(out / files.THRESHOLDS_FILE, thresholds_toml(found, dataset, command))
    return list(format_calibration(found))


def format_robot(found: RobotIdentification, out: Path) -> str:
    """Format an identified robot as a table for the terminal."""
    from omnimj.estimate.robot.files import creep_lines, excitation_lines, summary

    rows = [
        (
            one.words,
            format_value(one.value, one.unit.lstrip("1")),
            f"{one.low:.4g} … {one.high:.4g}",
            one.source,
        )
        for one in found.estimates
        if not one.name.startswith("loss_")
    ]
    lines = [*summary(found), "", format_table(("", "value", "90 % interval", "determined by"), rows), ""]
    lines += ["not excited by the drive:", *excitation_lines(found), "", "creep:", *creep_lines(found), ""]
    return "\n".join([*lines, f"written to {out}"])
