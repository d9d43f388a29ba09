"""Plants of the gap workflow: model file, data check and replay of each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from omnimj.effects import AXIS, MJCF, check_effects
from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.gap.check import rig as rig_check
from omnimj.estimate.gap.check import robot as robot_check
from omnimj.estimate.gap.check.columns import column_suspicions
from omnimj.estimate.gap.check.magnitudes import (
    beyond_reach,
    magnitude_suspicions,
    rig_limits,
    robot_limits,
)
from omnimj.estimate.gap.check.suspicions import Suspicion
from omnimj.estimate.gap.check.time_base import TimeLink
from omnimj.estimate.replay.interface import Replay
from omnimj.estimate.replay.robot.runs import require_layout
from omnimj.estimate.robot.identify import require_robot
from omnimj.parameters import Floor, Rig, Robot, read_rig, read_robot
from omnimj.parameters.mjcf_model import read_model_tree
from omnimj.parameters.model_file import model_path
from omnimj.recording.dataset import Dataset, Run

Machine = Any
"""`Rig`, `Robot`, or the machine of an MJCF file, to which an `axis.toml` leads as well."""


class GapPlant(NamedTuple):
    """Plant as the gap workflow uses it; `machine` is what `read` returns."""

    model: str | None
    """Shipped model file, below the folder of models; None where there is none and `read` checks the file."""
    read: Callable[[Path | None], Any]
    """Model file → machine; the shipped one for None."""
    suspicions: Callable[[Dataset, Any], Iterator[Suspicion]]
    """Dataset, machine → contradictions in the recorded channels."""
    time_links: Callable[[Sequence[Run], Any], list[TimeLink]]
    """Runs, machine → clear links between rates and their integrals."""
    make_replay: Callable[[Dataset, Any, Mapping[str, Floor]], Replay]
    """Dataset, machine, floors → replay."""
    require: Callable[[Dataset, Any], None] = lambda dataset, machine: None
    """Raises InputError for machines to which the replay's equations do not apply."""
    sample_rate: Callable[[Dataset, Any], float] = lambda dataset, machine: machine.sensors.sample_rate
    """Rate at which the machine is logged [1/s]."""


def find_plant(name: str) -> GapPlant:
    """Plant by name.

    Raises:
      UnknownNameError: No such plant.
    """
    if name not in PLANTS:
        raise UnknownNameError("plant", "plant", name, PLANTS)
    return PLANTS[name]


def read_machine(plant: str, path: Path | str | None) -> Machine:
    """Read the model file of a plant and check its effects.

    Raises:
      InputError: The file belongs to another plant, or is wrong in itself.
    """
    kind = find_plant(plant)
    if kind.model is None:
        return kind.read(None if path is None else Path(path))
    if plant == AXIS and path is not None and Path(path).suffix == ".xml":
        return PLANTS[MJCF].read(Path(path))
    if path is not None:
        path = model_path(path, kind.model)
        found = read_model_tree(path).get("plant")
        if found != plant:
            raise InputError(f"{path}: plant", f"found {found!r}", f"the dataset's plant is {plant!r}")
    machine = kind.read(path)
    if isinstance(machine, Rig | Robot):
        check_effects(machine)
    return machine


def in_terms_of(dataset: Dataset, machine: Machine) -> Dataset:
    """Dataset in the columns of its machine: the logs of a linear axis whose model is an MJCF file.

    Raises:
      InputError: The MJCF file does not describe an axis.
    """
    if machine.plant == dataset.plant or machine.plant != MJCF:
        return dataset
    from omnimj.simulate.machine.linear_axis import as_machine_logs  # loads MuJoCo

    return as_machine_logs(dataset, machine)


def _rig_suspicions(dataset: Dataset, rig: Rig) -> Iterator[Suspicion]:
    names = (*rig_check.NOISY, *rig_check.COUNTERS)
    yield from column_suspicions(dataset, names, rig_check.SPEEDS, rig_check.COUNTERS)
    large = list(magnitude_suspicions(dataset.runs, rig_limits(rig), rig_check.SPEEDS))
    yield from large
    yield from rig_check.rig_suspicions(dataset.runs, rig, beyond_reach(large))


def _robot_suspicions(dataset: Dataset, robot: Robot) -> Iterator[Suspicion]:
    wheels = len(robot.wheels)
    speeds = tuple(f"wheel_speed_{i}" for i in range(1, wheels + 1))
    yield from column_suspicions(dataset, robot_check.noisy(wheels), speeds, ())
    large = list(magnitude_suspicions(dataset.runs, robot_limits(robot), speeds))
    yield from large
    yield from robot_check.robot_suspicions(dataset.runs, robot, beyond_reach(large))


def _require_robot(dataset: Dataset, robot: Robot) -> None:
    """Refuse robots with another number of wheels than the logs, and layouts that the replay cannot drive."""
    require_robot(dataset, robot)
    if not dataset.pose_measured:
        require_layout(dataset, robot)


# replays are imported on use: they load MuJoCo


def _rig_replay(dataset: Dataset, rig: Rig, floors: Mapping[str, Floor]) -> Replay:
    from omnimj.estimate.replay.rig.replay import RigReplay

    return RigReplay(dataset, rig, floors)


def _robot_replay(dataset: Dataset, robot: Robot, floors: Mapping[str, Floor]) -> Replay:
    if dataset.pose_measured:
        from omnimj.estimate.replay.steady.replay import SteadyReplay

        return SteadyReplay(dataset, robot, floors)
    from omnimj.estimate.replay.robot.replay import RobotReplay

    return RobotReplay(dataset, robot, floors)


def _read_machine_file(path: Path | None) -> Any:
    from omnimj.plant.mujoco.machine import read_machine_file

    return read_machine_file(path)


def _machine_suspicions(dataset: Dataset, machine: Any) -> Iterator[Suspicion]:
    from omnimj.estimate.gap.check.machine import machine_suspicions

    return machine_suspicions(dataset, machine)


def _machine_time_links(runs: Sequence[Run], machine: Any) -> list[TimeLink]:
    from omnimj.estimate.gap.check.machine import machine_time_links

    return machine_time_links(runs, machine)


def _machine_replay(dataset: Dataset, machine: Any, floors: Mapping[str, Floor]) -> Replay:
    from omnimj.estimate.replay.mjcf.replay import MachineReplay

    return MachineReplay(dataset, machine)


def _require_machine(dataset: Dataset, machine: Any) -> None:
    from omnimj.estimate.replay.mjcf.columns import measured_parts, stated_masses
    from omnimj.estimate.replay.mjcf.contacts import free_runs

    measured_parts(dataset, machine)
    for run in dataset.runs:
        stated_masses(run, machine, dataset.path)
    free_runs(dataset.runs, machine, dataset.path)


def _logged_rate(dataset: Dataset, machine: Any) -> float:
    """Median rate of the runs: an MJCF file states none [1/s]."""
    return float(1.0 / np.median([np.median(np.diff(run.time)) for run in dataset.runs]))


# a linear axis: logs and names of its own for a machine with an MJCF file


def _read_axis(path: Path | None) -> Any:
    from omnimj.simulate.machine.linear_axis import read_axis

    return read_axis(path)


def _axis_suspicions(dataset: Dataset, axis: Any) -> Iterator[Suspicion]:
    from omnimj.simulate.machine.linear_axis import as_machine_logs, named_as_logged

    machine = named_as_logged(axis, dataset)
    for found in _machine_suspicions(as_machine_logs(dataset, machine), machine):
        yield found.renamed(machine.column_names)


def _axis_time_links(runs: Sequence[Run], axis: Any) -> list[TimeLink]:
    from omnimj.simulate.machine.linear_axis import as_machine_logs

    dataset = Dataset(axis.file, AXIS, tuple(runs))
    return _machine_time_links(as_machine_logs(dataset, axis).runs, axis)


def _axis_replay(dataset: Dataset, axis: Any, floors: Mapping[str, Floor]) -> Replay:
    from omnimj.simulate.machine.linear_axis import as_machine_logs, named_as_logged

    machine = named_as_logged(axis, dataset)
    return _machine_replay(as_machine_logs(dataset, machine), machine, floors)


def _axis_rate(dataset: Dataset, axis: Any) -> float:
    """Rate of controller and log of an `axis.toml`, the step of its model [1/s]."""
    return 1.0 / axis.mj_model.opt.timestep


PLANTS: Mapping[str, GapPlant] = {
    "quarter_rig": GapPlant(
        "quarter_rig/rig.toml", read_rig, _rig_suspicions, rig_check.rig_time_links, _rig_replay
    ),
    "uto_robot": GapPlant(
        "uto_robot/robot.toml",
        read_robot,
        _robot_suspicions,
        robot_check.robot_time_links,
        _robot_replay,
        _require_robot,
    ),
    AXIS: GapPlant(
        "linear_axis/axis.toml",
        _read_axis,
        _axis_suspicions,
        _axis_time_links,
        _axis_replay,
        sample_rate=_axis_rate,
    ),
    MJCF: GapPlant(
        None,
        _read_machine_file,
        _machine_suspicions,
        _machine_time_links,
        _machine_replay,
        _require_machine,
        _logged_rate,
    ),
}
