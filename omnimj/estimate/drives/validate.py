"""Validation of a robot's model: all measured drives again, with the wheels turning as measured.

Nothing is fitted but the angle by which the marker is turned on the robot, one for each floor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import omnimj
from omnimj.control.robot_constants import robot_constants
from omnimj.effects import ChannelEffect, apply_effects
from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.drives.compare import FEWEST_RUNS, marker_angle, run_numbers, speed_groups, with_marker
from omnimj.estimate.drives.records import DrivenRun, DriveValidation
from omnimj.estimate.drives.replay import ROLLING, measured_drive, replay_drive
from omnimj.estimate.replay.base_parameters import floor_name
from omnimj.estimate.robot.blocks import robot_rows
from omnimj.estimate.robot.identify import require_robot
from omnimj.estimate.robot.pose_check import require_like_motion
from omnimj.estimate.threads import Progress, completed_in_threads
from omnimj.parameters import Floor, Robot
from omnimj.recording.dataset import Dataset
from omnimj.recording.json_files import rounded_values

PLANTS = ("twin", "planar")
"""Plants that can be driven by wheel speeds."""


def require_drives(dataset: Dataset, robot: Robot) -> None:
    """Check that a dataset has drives of this robot with a measured pose that moves as its wheels do.

    Raises:
      InputError: It has not.
    """
    require_robot(dataset, robot)
    if not dataset.pose_measured:
        rule = "runs of a robot are validated against a measured x, y, heading: say 'pose_measured = true'"
        raise InputError(f"{dataset.path / 'dataset.toml'}: pose_measured", "found false", rule)
    if len(dataset.runs) < FEWEST_RUNS:
        return  # slip in one direction makes a wheel look like another
    require_like_motion(dataset.path, robot_rows(dataset, robot), robot_constants(robot))


def validate_drives(
    dataset: Dataset,
    robot: Robot,
    floors: Mapping[str, Floor],
    plants: Sequence[str] = PLANTS,
    progress: Progress | None = None,
) -> DriveValidation:
    """Drive every run again on every plant, and beside them the body that rolls without slip.

    Ctrl-C keeps the completed runs.

    Raises:
      InputError: Runs without a measured pose or floor, or of a robot with other wheels.
      UnknownNameError: No such plant or floor.
      SimulationError: The simulation left finite numbers.
    """
    require_drives(dataset, robot)
    for plant in plants:
        if plant not in PLANTS:
            raise UnknownNameError("--plant", "plant", plant, PLANTS)
    known, kinds = dict(floors), (*plants, ROLLING)
    drives = [measured_drive(run, robot, floor_name(dataset, run, floors)) for run in dataset.runs]
    done, interrupted = completed_in_threads(
        lambda drive: [replay_drive(p, drive, robot, known) for p in kinds], drives, len(kinds), progress
    )
    return judged(dataset, robot, kinds, done, interrupted)


def judged(
    dataset: Dataset,
    robot: Robot,
    plants: Sequence[str],
    runs: Sequence[DrivenRun],
    interrupted: bool = False,
) -> DriveValidation:
    """Judge simulated drives: the marker's angle on each floor, numbers of the runs and of their groups."""
    declared = apply_effects(robot).channels.get("heading", ChannelEffect()).offset
    floors = tuple(dict.fromkeys(run.floor for run in runs))
    marker: dict[str, dict[str, float | None]] = {
        plant: {
            floor: marker_angle([run for run in runs if (run.plant, run.floor) == (plant, floor)])
            for floor in floors
        }
        for plant in plants
    }
    turned = [
        with_marker(run, declared if (found := marker[run.plant][run.floor]) is None else found)
        for run in runs
    ]
    numbers = tuple(run_numbers(run, robot) for run in turned)
    return DriveValidation(
        dataset=dataset.path,
        model=robot.file,
        effects=tuple(robot.effects),
        plants=tuple(plants),
        groups=speed_groups(numbers),
        numbers=numbers,
        runs=tuple(turned),
        marker=marker,
        marker_notes=tuple(_marker_notes(marker, floors)),
        notes=dataset.notes,
        interrupted=interrupted,
    )


def _marker_notes(marker: Mapping[str, Mapping[str, float | None]], floors: Sequence[str]) -> list[str]:
    """Sentences on the marker's angle, one for each floor."""
    notes = []
    for floor in floors:
        found = {plant: angles[floor] for plant, angles in marker.items()}
        if None in found.values():
            notes.append(f"{floor}: fewer than {FEWEST_RUNS} runs, the marker's angle is that of the model")
            continue
        words = ", ".join(f"{1000.0 * (angle or 0.0):+.1f} mrad ({plant})" for plant, angle in found.items())
        notes.append(f"{floor}: marker turned on the robot, estimated from these runs: {words}")
    return notes


def drives_content(found: DriveValidation, command: str = "") -> dict[str, Any]:
    """Content of `validation.json`: SI units, errors of speeds and lengths as ratios, null: unknown."""
    return {
        "dataset": str(found.dataset),
        "model": str(found.model),
        "effects": list(found.effects),
        "omnimj": omnimj.__version__,
        "command": command,
        "interrupted": found.interrupted,
        "notes": [*found.marker_notes, *found.notes],
        "plants": list(found.plants),
        "marker_angle": rounded_values(found.marker),
        "table": [rounded_values(vars(group)) for group in found.groups],
        "runs": [rounded_values(vars(run)) for run in found.numbers],
    }
