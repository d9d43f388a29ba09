"""`omnimj gap` from a dataset's folder to a finding: read, check, replay, search."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from omnimj.effects import check_effects
from omnimj.errors import InputError
from omnimj.gap.check import check_dataset, corrected
from omnimj.gap.find import About, find
from omnimj.gap.holdout import held_out_conditions
from omnimj.gap.records import Finding
from omnimj.gap.replay import Replay
from omnimj.gap.robot_layout import require_layout
from omnimj.parameters import Axis, Floor, Rig, Robot, read_axis, read_rig, read_robot
from omnimj.parameters.floor import all_floors
from omnimj.parameters.model_file import model_path
from omnimj.parameters.toml_file import read_toml
from omnimj.recording.dataset import Dataset
from omnimj.recording.read_dataset import read_dataset

Machine = Rig | Robot | Axis


_USUAL = {
    "quarter_rig": "quarter_rig/rig.toml",
    "uto_robot": "uto_robot/robot.toml",
    "linear_axis": "linear_axis/axis.toml",
}


def read_machine(plant: str, path: Path | None) -> Machine:
    """The model file of a plant, its effects checked.

    Raises:
      InputError: The file is of another plant, or wrong in itself.
    """
    if path is not None:
        path = model_path(path, _USUAL[plant])
        found = read_toml(path).get("plant")
        if found != plant:
            raise InputError(f"{path}: plant", f"found {found!r}", f"the dataset's plant is {plant!r}")
    machine = {"quarter_rig": read_rig, "uto_robot": read_robot, "linear_axis": read_axis}[plant](path)
    check_effects(machine)
    return machine


def make_replay(dataset: Dataset, machine: Machine, floors: Mapping[str, Floor]) -> Replay:
    """The dataset as the search sees it.

    Raises:
      InputError: A run lacks what a replay needs.
    """
    if isinstance(machine, Rig):
        from omnimj.gap.rig import RigReplay

        return RigReplay(dataset, machine, floors)
    if isinstance(machine, Robot):
        from omnimj.gap.robot import RobotReplay

        return RobotReplay(dataset, machine, floors)
    from omnimj.gap.axis import AxisReplay

    return AxisReplay(machine, dataset.runs)


def find_gap(
    dataset: Path,
    model: Path | None = None,
    holdout: Sequence[str] = (),
    report: Callable[[str, float], None] | None = None,
    seed: int = 0,
    floors_file: Path | None = None,
) -> Finding:
    """Finds where a model and measured runs part, and what the model lacks.

    Args:
      dataset: Folder of the measured runs.
      model: The plant's model file; the shipped one when None.
      holdout: Runs or conditions to judge by; drawn by the seed when empty.
      report: Called with a phrase and the share of it that is done; KeyboardInterrupt raised there ends the
        search with what it has.
      seed: Of what is held out and of the random curves.
      floors_file: Floors beside the shipped ones, or in their place where names are alike.

    Raises:
      InputError: The dataset or the model file is wrong.
      UnknownNameError: A floor, plant or run that is not known.
    """
    floors = all_floors(floors_file)
    read = read_dataset(dataset, floors)
    machine = read_machine(read.plant, model)
    if isinstance(machine, Robot):
        require_layout(read, machine)
    conditions = held_out_conditions(holdout, read.runs)
    check = check_dataset(read, machine)
    usable = corrected(read, check)
    replay = make_replay(usable, machine, floors)
    about = About(
        str(dataset), (*read.notes, *check.notes), {run.name: run.conditions for run in usable.runs}
    )
    finding = find(replay, about, conditions, seed, report)
    return replace(finding, data_notes=about.notes)
