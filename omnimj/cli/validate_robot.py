"""`omnimj validate` for the logs of a robot: measured drives beside twin and equations."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import command_line, exit_code
from omnimj.cli.progress import progress_bar
from omnimj.cli.terminal import announce_compilation, format_json, format_table, note_compiled
from omnimj.errors import UnknownNameError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from omnimj.estimate.drives.records import DriveValidation, Group
    from omnimj.parameters import Floor, Robot
    from omnimj.recording.dataset import Dataset
    from omnimj.signals import Array

RECORDING = "recording.rrd"
"""File of the run that `--recording` names."""
_FILES = ("validation.json", "report.html", RECORDING)
_MACHINE = "robot_wheel_speeds"
_HEAD = (
    "floor",
    "wheels m/s",
    "runs",
    "plant",
    "body m/s",
    "simulated m/s",
    "error",
    "current error A",
    "of A",
    "yaw rate error rad/s",
    "of rad/s",
    "end of path",
)
_MOST_NOTES = 8
_LEGEND = """\
wheels: speed of the body if its wheels rolled without slip; plant "rolling" is that body
error: of the mean body velocity, RMS over runs of the vector error, over the mean speed
current error: RMS over runs of the error of the mean current, by wheel; of: measured RMS over all wheels
yaw rate error: RMS over runs of the error of the mean yaw rate; of: its measured RMS
end of path: median distance of the ends over the path's length, for the simulated velocities along the
  measured heading / for the simulated path"""


def validate_robot_dataset(arguments: Any, dataset: Dataset, floors: Mapping[str, Floor]) -> int:
    """Simulate every measured drive again and write the comparison."""
    from omnimj.estimate.drives.validate import drives_content, require_drives, validate_drives
    from omnimj.parameters import read_robot

    robot = read_robot(arguments.model)
    require_drives(dataset, robot)
    _check_recording(arguments, dataset)
    plants = ("twin", "planar") if arguments.plant == "both" else (arguments.plant,)
    for plant in plants:
        announce_compilation(plant, _MACHINE, quiet=arguments.quiet)
    with progress_bar(arguments) as bar:
        found = validate_drives(dataset, robot, floors, plants, bar.show)
    if not found.runs:
        raise KeyboardInterrupt
    for plant in plants:
        note_compiled(plant, _MACHINE)
    content = drives_content(found, command_line(arguments))
    _write(arguments, found, content, robot)
    print(format_json(content) if arguments.json else format_drives(found, arguments.out))
    return exit_code(found.interrupted)


def _check_recording(arguments: Any, dataset: Dataset) -> None:
    names = tuple(run.name for run in dataset.runs)
    if arguments.recording is not None and arguments.recording not in names:
        raise UnknownNameError("--recording", "run", arguments.recording, names)


def _write(arguments: Any, found: DriveValidation, content: dict[str, Any], robot: Robot) -> None:
    from omnimj.recording.folder import make_folder
    from omnimj.recording.json_files import write_json
    from omnimj.view.report.validation import write_drives_report
    from omnimj.view.rerun.side_by_side import write_side_by_side

    out = arguments.out
    make_folder(out, arguments.force, _FILES)
    write_json(out / _FILES[0], content)
    write_drives_report(out / _FILES[1], found, content["command"])
    shown = [run for run in found.runs if run.run == arguments.recording and run.plant == found.plants[0]]
    for run in shown:
        write_side_by_side(out / RECORDING, run, robot)


def format_drives(found: DriveValidation, out: Path) -> str:
    """Format a validation as a table of floors, speeds and plants."""
    notes = found.notes if len(found.notes) <= _MOST_NOTES else (_many(len(found.notes)),)
    table = format_table(_HEAD, [_row(group) for group in found.groups])
    lines = [*notes, *found.marker_notes, "", table, "", _LEGEND]
    if found.effects:
        lines.append(f"effects of the model: {', '.join(found.effects)}")
    if found.interrupted:
        lines.append("interrupted")
    lines.append(f"written to {out}")
    return "\n".join(lines)


def _many(notes: int) -> str:
    return f"{notes} notes on masked samples: see report.html"


def _row(group: Group) -> tuple[str, ...]:
    from omnimj.view.wording import percent

    ends = f"{percent(group.end_by_measured_heading)} / {percent(group.end_by_own_heading)}"
    return (
        group.floor,
        f"{group.wheel_rolling:.2f}",
        str(len(group.runs)),
        group.plant,
        f"{group.measured_speed:.4f}",
        f"{group.simulated_speed:.4f}",
        percent(group.velocity_error),
        _currents(group.current_error),
        _currents(_over_wheels(group.measured_current)),
        f"{group.yaw_rate_error:.4f}",
        f"{group.measured_yaw_rate:.4f}",
        ends,
    )


def _over_wheels(values: Array) -> list[float]:
    known = [value**2 for value in values.tolist() if math.isfinite(value)]
    return [math.sqrt(sum(known) / len(known))] if known else [math.nan]


def _currents(values: Array | list[float]) -> str:
    known = [f"{value:.3f}" if math.isfinite(value) else "–" for value in values]
    return "–" if set(known) == {"–"} else " ".join(known)
