"""A scenario: one TOML file with plant, floor, drive, faults and checks."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from omnimj.control.detection.detector import DetectorOptions
from omnimj.control.gains import Gains
from omnimj.effects import check_effects
from omnimj.errors import InputError
from omnimj.parameters import Rig, Robot, read_rig, read_robot
from omnimj.parameters.floor import Floor, all_floors, find_floor, own_floors
from omnimj.parameters.reading import Rule, check_choice, read_toml, require_keys
from omnimj.plant.faults import Fault, read_fault
from omnimj.plant.ground import Patch, read_patch
from omnimj.signals import Array
from omnimj.simulate.kinematic import KinematicCase
from omnimj.simulate.metrics import metric_units
from omnimj.simulate.scenario.checks import Check, read_checks
from omnimj.simulate.scenario.drive import Drive, read_drive
from omnimj.simulate.scenario.listing import find_scenario
from omnimj.simulate.scenario.overrides import (
    KnownKeys,
    apply_override,
    attribute_to_overrides,
    known_keys,
    split_override,
)
from omnimj.simulate.scenario.tables import (
    number_entry,
    read_diagnosis,
    read_floors_key,
    read_kinematics,
    read_model_key,
    read_scene_key,
    table_entries,
    text_entry,
)

PLANTS = (Robot.plant, Rig.plant)
LEVELS = ("physics", "kinematic")
EQUATIONS = ("corrected", "published")

_DURATION = Rule(0.01, 1800.0, False)
_MAX_STEPS = 2_000_000  # a trace with as many rows takes about a gigabyte


@dataclass(frozen=True)
class RigInput:
    """Input of the test rig."""

    current: float
    """Constant set value from the start [A]."""
    mass: float
    """Mass m_T of the quarter body [kg]."""
    lateral_speed: float
    """Lateral speed of the gantry [m/s]."""
    has_path: ClassVar[bool] = False
    """False, since a rig has no path to follow."""


@dataclass(frozen=True)
class Scenario:
    """One validated scenario."""

    name: str
    """Name of the file without its suffix."""
    description: str
    """One line of text."""
    constants: Robot | Rig
    """Constants of the plant, from its model file."""
    floor: str
    """Name of the floor outside the patches, a key of `floors`."""
    floors: Mapping[str, Floor]
    """All floors by name."""
    duration: float
    """Length of the run [s]."""
    level: str
    """`physics`, or `kinematic` (without forces)."""
    drive: Drive | RigInput
    """Planned motion of the robot, or input of the rig."""
    faults: tuple[Fault, ...]
    """True faults, unknown to the controller."""
    patches: tuple[Patch, ...]
    """Areas with another floor."""
    kinematics: KinematicCase | None
    """Kinematics and kinematic faults; None at the level `physics`."""
    checks: tuple[Check, ...]
    """Bounds on the metrics."""
    equations: str
    """Equations of the planar plant: `corrected`, or `published` as printed."""
    scene: Path | None
    """MJCF scene around the robot (ramps, thresholds, height fields); a flat floor when None."""
    diagnosis: DetectorOptions
    """Options of the diagnosis methods."""
    overrides: tuple[str, ...]
    """The `KEY=VALUE` texts that were applied."""
    own_floors: frozenset[str] = frozenset()
    """Floors that a user's file describes; the robust method expects their creep and drag."""
    gains: Gains | None = None
    """Gains of recovery and observer; the shipped ones when None. The cascade's gains are in `constants`."""

    @property
    def is_rig(self) -> bool:
        """True if the test rig is driven, not a robot."""
        return self.plant == Rig.plant

    @property
    def plant(self) -> str:
        """`uto_robot` or `quarter_rig`."""
        return self.constants.plant

    @property
    def robot(self) -> Robot:
        """Constants of the robot; only for a robot scenario."""
        assert isinstance(self.constants, Robot)
        return self.constants

    @property
    def robot_drive(self) -> Drive:
        """Planned motion; only for a robot scenario."""
        assert isinstance(self.drive, Drive)
        return self.drive

    @property
    def rig(self) -> Rig:
        """Constants of the rig; only for a rig scenario."""
        assert isinstance(self.constants, Rig)
        return self.constants

    @property
    def rig_input(self) -> RigInput:
        """Current, mass and lateral speed; only for a rig scenario."""
        assert isinstance(self.drive, RigInput)
        return self.drive

    @property
    def expected_floor(self) -> Floor | None:
        """Floor that the diagnosis expects; None if none is stated.

        By default that of the feed-forward, or else that of the hall where a user's file describes it.
        """
        stated = self.diagnosis.floor
        if stated is None and isinstance(self.drive, Drive):
            stated = self.drive.creep_floor
        if stated is None and self.floor in self.own_floors:
            stated = self.floor
        return self.floors[stated] if stated else None

    @property
    def period(self) -> float:
        """Control period [s]."""
        return 1.0 / self.constants.sensors.sample_rate

    @property
    def wheel_positions(self) -> Array:
        """Wheel positions p_i in the body frame, shape (n, 2) [m]."""
        return np.zeros((1, 2)) if self.is_rig else self.robot.wheel_positions

    @property
    def metric_units(self) -> dict[str, str]:
        """Names of the scenario's metrics and their units."""
        wheels, kinematic = self.constants.wheel_count, self.level == "kinematic"
        return metric_units(self.plant, wheels, self.drive.has_path, kinematic)


def read_scenario(
    name_or_path: str | Path,
    overrides: Sequence[str] = (),
    model_file: Path | None = None,
    floors_file: Path | None = None,
) -> Scenario:
    """Read a shipped scenario by name, or any scenario file by path.

    Args:
      name_or_path: `nylon_patch`, or `my/own.toml`.
      overrides: `KEY=VALUE` texts, applied in order before anything is validated.
      model_file: The plant's model file; the shipped one when None.
      floors_file: File with floors that are added to those of the scenario or, under the same name, replace
        them.

    Raises:
      InputError: A value is missing or breaks its rule; the message names place, value and rule.
      UnknownNameError: No such scenario, key, floor or kind; the message lists the choices.
    """
    path = find_scenario(name_or_path)
    with attribute_to_overrides(path.name, overrides):
        return _read(path, overrides, model_file, floors_file)


def _read(
    path: Path, overrides: Sequence[str], model_file: Path | None, floors_file: Path | None
) -> Scenario:
    place = path.name
    tree = read_toml(path)
    plant = tree.get("plant")
    if plant is None:
        raise InputError(f"{place}: plant", "is missing", "a scenario has one", PLANTS)
    check_choice(f"{place}: plant", plant, PLANTS, "plant")
    model_file = read_model_key(tree, path) if model_file is None else model_file
    read_machine, read_own = _READERS[plant]
    constants = read_machine(model_file)
    check_effects(constants)
    known = known_keys(plant, constants.wheel_count)
    _apply_overrides(tree, overrides, known)
    require_keys(place, tree, tuple(known[""]), f"key of a {plant} scenario")
    _require_few_steps(tree, place, constants)
    floors = all_floors(read_floors_key(tree, path), floors_file)
    diagnosis = read_diagnosis(tree.get("diagnosis", {}), f"{place}: diagnosis")
    if diagnosis.floor:
        find_floor(diagnosis.floor, f"{place}: diagnosis.floor", floors)
    return Scenario(
        name=path.stem,
        description=text_entry(tree, "description", place),
        constants=constants,
        floor=find_floor(text_entry(tree, "floor", place), f"{place}: floor", floors).name,
        floors=MappingProxyType(floors),
        own_floors=own_floors(floors_file),
        duration=number_entry(tree, "duration", place, _DURATION),
        equations=_equations(tree, place),
        scene=read_scene_key(tree, path),
        diagnosis=diagnosis,
        overrides=tuple(overrides),
        **read_own(tree, place, constants, floors),
    )


def _apply_overrides(tree: dict[str, Any], overrides: Sequence[str], known: KnownKeys) -> None:
    for text in overrides:
        key, value = split_override(text)
        if key == "plant":
            raise InputError("--set plant", "a scenario belongs to its plant", "choose another scenario")
        if key == "model":
            raise InputError("--set model", "is read before anything is set", "use --model")
        apply_override(tree, key, value, known)


def _read_robot_scenario(
    tree: Mapping, place: str, robot: Robot, floors: Mapping[str, Floor]
) -> dict[str, Any]:
    wheels, duration = len(robot.wheels), number_entry(tree, "duration", place, _DURATION)
    level = check_choice(f"{place}: level", tree.get("level", "physics"), LEVELS, "level")
    if "drive" not in tree:
        raise InputError(place, "[drive] is missing")
    drive = read_drive(tree["drive"], f"{place}: drive", duration, 1.0 / robot.sensors.sample_rate)
    if drive.creep_floor is not None:
        find_floor(drive.creep_floor, f"{place}: drive.creep_floor", floors)
    kinematics = _read_level(tree, place, level, wheels)
    if kinematics is not None and drive.heading_hold:
        raise InputError(
            f"{place}: drive.heading_hold", "does not exist at the kinematic level", "leave it out"
        )
    if kinematics is not None and drive.creep_floor is not None:
        raise InputError(f"{place}: drive.creep_floor", "the kinematic level has no creep", "leave it out")
    units = metric_units("uto_robot", wheels, drive.has_path, level == "kinematic")
    return {
        "level": level,
        "drive": drive,
        "faults": _read_faults(
            tree, place, wheels, floors, duration, robot.body.mass - wheels * robot.body.unsprung_mass
        ),
        "patches": tuple(
            read_patch(table, f"{place}: patches.{i}", floors)
            for i, table in enumerate(table_entries(tree, "patches", place))
        ),
        "kinematics": kinematics,
        "checks": read_checks(tree.get("checks", {}), f"{place}: checks", tuple(units)),
    }


def _read_level(tree: Mapping, place: str, level: str, wheels: int) -> KinematicCase | None:
    """Read `[kinematics]`, and refuse tables that have no effect at the scenario's level."""
    if level == "physics":
        if "kinematics" in tree:
            found = "is not allowed at the physics level"
            raise InputError(f"{place}: kinematics", found, "it needs level = 'kinematic'")
        return None
    for key in ("faults", "patches"):
        if tree.get(key):
            raise InputError(f"{place}: {key}", "have no effect at the kinematic level", "use [kinematics]")
    return read_kinematics(tree.get("kinematics", {}), f"{place}: kinematics", wheels)


def _read_rig_scenario(tree: Mapping, place: str, rig: Rig, floors: Mapping[str, Floor]) -> dict[str, Any]:
    duration, limit = number_entry(tree, "duration", place, _DURATION), rig.motor.current_limit
    lateral = rig.rig.lateral_travel / duration
    drive = RigInput(
        current=number_entry(tree, "current", place, Rule(-limit, limit, False)),
        mass=number_entry(tree, "mass", place, Rule(rig.wheel.mass, 100.0, True), rig.rig.masses[0]),
        lateral_speed=number_entry(tree, "lateral_speed", place, Rule(-lateral, lateral, False), 0.0),
    )
    return {
        "level": "physics",
        "drive": drive,
        "faults": _read_faults(tree, place, 1, floors, duration, drive.mass - rig.wheel.mass),
        "patches": (),
        "kinematics": None,
        "checks": read_checks(
            tree.get("checks", {}), f"{place}: checks", tuple(metric_units("quarter_rig", 1, False, False))
        ),
    }


def _read_faults(
    tree: Mapping, place: str, wheels: int, floors: Mapping[str, Floor], duration: float, sprung: float
) -> tuple[Fault, ...]:
    faults = []
    for i, table in enumerate(table_entries(tree, "faults", place)):
        fault = read_fault(table, f"{place}: faults.{i}", wheels, floors, duration)
        if fault.kind == "payload" and float(fault.numbers["mass"]) <= -sprung:
            found = f"found {fault.numbers['mass']:g}"
            rule = f"must be above {-sprung:g}, the whole sprung mass taken off"
            raise InputError(f"{place}: faults.{i}.mass", found, rule)
        faults.append(fault)
    return tuple(faults)


def _equations(tree: Mapping, place: str) -> str:
    place = f"{place}: equations"
    found = check_choice(place, tree.get("equations", EQUATIONS[0]), EQUATIONS, "form of the equations")
    if found != EQUATIONS[0] and tree.get("level") == "kinematic":
        raise InputError(place, f"found {found!r}", "the kinematic level has kinematics.plant")
    return found


def _require_few_steps(tree: Mapping, place: str, constants: Robot | Rig) -> None:
    duration, rate = number_entry(tree, "duration", place, _DURATION), constants.sensors.sample_rate
    if duration * rate > _MAX_STEPS:
        rule = f"at most {_MAX_STEPS / rate:g} s at a sample rate of {rate:g} Hz"
        raise InputError(f"{place}: duration", f"found {duration:g}", rule)


_READERS: Mapping[str, tuple[Callable, Callable]] = MappingProxyType(
    {Robot.plant: (read_robot, _read_robot_scenario), Rig.plant: (read_rig, _read_rig_scenario)}
)  # by plant: reader of the model file, reader of the plant's own part of a scenario


def scenario_gains(scenario: Scenario) -> Gains:
    """Gains of a robot scenario."""
    return Gains(scenario.robot.control) if scenario.gains is None else scenario.gains


def require_cascade(scenario: Scenario) -> None:
    """Refuse a scenario that is driven without the cascade, where gains have no effect.

    Raises:
      InputError: A scenario of the test rig, or at the kinematic level.
    """
    if scenario.is_rig:
        raise InputError("--gains", f"{scenario.name} is driven on the test rig", "it has no cascade")
    if scenario.level != "physics":
        raise InputError("--gains", f"{scenario.name} is at the kinematic level", "it has no cascade")


def with_gains(scenario: Scenario, gains: Gains) -> Scenario:
    """Copy of a scenario with other gains.

    Raises:
      InputError: As for `require_cascade`.
    """
    require_cascade(scenario)
    return dataclasses.replace(
        scenario, constants=dataclasses.replace(scenario.robot, control=gains.control), gains=gains
    )


def scenario_digest(text: str, scenario: Scenario) -> str:
    """Hash of a scenario's file and of the numbers of its machine and floors, independent of their folders.

    Equal hashes mean scenarios that are equal in everything that affects a run.

    Args:
      text: Name or path of the scenario.
      scenario: The scenario read from there.
    """
    machine = dataclasses.replace(scenario.constants, file=Path(), provenance={})
    floors = {name: dict(floor.numbers) for name, floor in scenario.floors.items()}
    content = repr((read_toml(find_scenario(text)), machine, floors))
    return hashlib.sha256(content.encode()).hexdigest()


def absolute_scenario(text: str) -> str:
    """Name or absolute path of a scenario, for processes that work in another folder."""
    path = find_scenario(text)
    return text if path.stem == text else str(path.absolute())
