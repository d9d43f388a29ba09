"""Options of an environment, checked once: plant, motion, floor, faults, action, reward."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.errors import InputError, UnknownNameError
from omnimj.learning.registration import ENVIRONMENT
from omnimj.parameters import Floor, Robot, read_robot
from omnimj.parameters.floor import all_floors, find_floor
from omnimj.parameters.reading import Rule, check_number
from omnimj.plant.faults import Fault, read_fault
from omnimj.plant.ground import Patch
from omnimj.signals import Array
from omnimj.simulate.compiled.row import Plan
from omnimj.simulate.plants import PLANT_NAMES, make_simulated
from omnimj.simulate.scenario.drive import read_drive
from omnimj.simulate.scenario.listing import scenario_names
from omnimj.simulate.scenario.scenario import Scenario, read_scenario
from omnimj.simulate.suites.missions import ACCELERATION, YAW_ACCELERATION, demanded_twists

MISSIONS = "missions"
"""Name of the random motions."""
ACTIONS = ("twist", "wheel_speeds", "currents")
"""Kinds of action, in the order of the kernels' numbers."""
_MISSION_TIME, _MISSION_FLOOR = 10.0, "natural_stone"  # [s]
_DURATION, _MISSION_DURATION = Rule(0.05, 1800.0, False), Rule(3.0, 1800.0, False)
_DECISION = Rule(0.001, 1.0, False)
_LARGEST_ERROR, _WEIGHT = Rule(0.0, 1e4, True), Rule(0.0, 1e6, False)


@dataclass(frozen=True)
class Options:
    """Options of `omnimj/OmniDrive-v0`, as keywords of `gymnasium.make` and `gymnasium.make_vec`."""

    plant: str = "twin"
    """`twin` or `planar`, the equations without MuJoCo."""
    scenario: str | Path | Scenario = MISSIONS
    """Random motions (`missions`), or name or path of a robot scenario: drive, floor, faults, patches."""
    floor: str | None = None
    """Floor outside the patches; that of the scenario when None, natural stone for missions."""
    faults: Sequence[Mapping[str, Any]] | None = None
    """Tables as `[[faults]]` of a scenario; those of the scenario when None."""
    drive: Mapping[str, Any] | None = None
    """Table as `[drive]` of a scenario; that of the scenario when None. With it, missions are not drawn."""
    duration: float | None = None
    """Length of an episode [s]; that of the scenario when None, 10 s for missions."""
    model: str | Path | None = None
    """Model file of the robot; that of the scenario, or the shipped one, when None."""
    floors: str | Path | None = None
    """File with floors beside the shipped ones."""
    action: str = "twist"
    """`twist`: added to the commanded body twist; `wheel_speeds`: added to the wheel-speed targets;
    `currents`: the motors' currents, without the cascade."""
    decision_period: float = 0.02
    """Time for which an action is held [s], a multiple of the control period."""
    largest_error: float = 1.0
    """Distance from the planned position beyond which the episode is terminated [m]."""
    energy_weight: float = 0.001
    """Weight of the energy in the reward [1/J]."""


OPTION_NAMES = tuple(field.name for field in dataclasses.fields(Options))
"""Names of the options."""


@dataclass(frozen=True)
class Task:
    """Constants common to all episodes of an environment, from `read_task`."""

    robot: Robot
    plant: str
    floor: str
    floors: Mapping[str, Floor]
    faults: tuple[Fault, ...]
    patches: tuple[Patch, ...]
    duration: float
    """Length of an episode [s]."""
    plan: Plan | None
    """Planned motion; None: drawn anew for each episode."""
    start: tuple[float, float, float]
    """Initial x, y [m] and heading [rad]."""
    loops: Mapping[str, Any]
    """Loops of the cascade that are switched on, arguments of `Controller`."""
    creep_floor: Floor | None
    """Floor whose creep the cascade feeds forward; None: no feed-forward."""
    scene: Path | None
    action: int
    """Index in `ACTIONS`."""
    periods: int
    """Control periods per action."""
    largest_error: float
    energy_weight: float

    @property
    def period(self) -> float:
        """Control period [s]."""
        return 1.0 / self.robot.sensors.sample_rate

    @property
    def action_size(self) -> int:
        """Length of an action."""
        return 3 if ACTIONS[self.action] == "twist" else self.robot.wheel_count

    def make_plant(self) -> Any:
        """Make the robot with its floor and faults."""
        scene = {} if self.plant == "planar" else {"scene": self.scene}
        same = {"faults": self.faults, "patches": self.patches, "start": self.start}
        return make_simulated(self.plant, self.robot, self.floor, self.floors, **same, **scene)

    def draw_plan(self, draws: np.random.Generator) -> Plan:
        """Plan of an episode; draws from the generator only where motions are random."""
        return draw_plan(draws, self.duration, self.period) if self.plan is None else self.plan


def read_task(**options: Any) -> Task:
    """Check `Options` and read the files that they name.

    Raises:
      InputError: A value breaks its rule, or options do not go together.
      UnknownNameError: No such option, plant, scenario, floor, fault or action; the message lists them.
    """
    for name in options:
        if name not in OPTION_NAMES:
            raise UnknownNameError(ENVIRONMENT, "option", name, OPTION_NAMES)
    given = Options(**options)
    common = {
        "plant": _choice("plant", given.plant, PLANT_NAMES),
        "action": ACTIONS.index(_choice("action", given.action, ACTIONS)),
        "largest_error": _number("largest_error", given.largest_error, _LARGEST_ERROR),
        "energy_weight": _number("energy_weight", given.energy_weight, _WEIGHT),
    }
    task = _missions(given, common) if given.scenario == MISSIONS else _of_scenario(given, common)
    if task.plant == "planar" and task.scene is not None:
        raise InputError(_place("plant"), "found 'planar'", "this scenario's scene is for the twin only")
    return task


def _missions(given: Options, common: Mapping[str, Any]) -> Task:
    robot, floors = read_robot(given.model), all_floors(given.floors)
    rule = _MISSION_DURATION if given.drive is None else _DURATION
    duration = _number("duration", _or(given.duration, lambda: _MISSION_TIME), rule)
    task = Task(
        robot=robot,
        floor=_MISSION_FLOOR,
        floors=floors,
        faults=(),
        patches=(),
        duration=duration,
        plan=None,
        start=(0.0, 0.0, 0.0),
        loops={"heading_hold": True},
        creep_floor=None,
        scene=None,
        periods=_periods(given.decision_period, robot),
        **common,
    )
    return _with_own(task, given)


def _of_scenario(given: Options, common: Mapping[str, Any]) -> Task:
    scenario = _scenario(given)
    if scenario.is_rig or scenario.level != "physics":
        found = f"{scenario.name} is driven without forces or on the rig"
        raise InputError(_place("scenario"), found, "a scenario of a robot with forces is needed")
    if scenario.equations != "corrected":
        rule = "an environment has the corrected equations"
        raise InputError(_place("scenario"), f"{scenario.name} has printed ones", rule)
    drive, reference = scenario.robot_drive, scenario.robot_drive.reference
    task = Task(
        robot=scenario.robot,
        floor=scenario.floor,
        floors=scenario.floors,
        faults=scenario.faults,
        patches=scenario.patches,
        duration=_number("duration", _or(given.duration, lambda: scenario.duration), _DURATION),
        plan=_plan(reference),
        start=drive.start,
        loops=_loops(drive),
        creep_floor=None if drive.creep_floor is None else scenario.floors[drive.creep_floor],
        scene=scenario.scene,
        periods=_periods(given.decision_period, scenario.robot),
        **common,
    )
    return _with_own(task, given)


def _scenario(given: Options) -> Scenario:
    """Scenario by name or path, or one that has been read, with everything that is its own."""
    if isinstance(given.scenario, Scenario):
        for name in ("model", "floors", *(("duration",) if given.drive is None else ())):
            if getattr(given, name) is not None:
                rule = f"{given.scenario.name} has been read with its own: give its name instead"
                raise InputError(_place(name), f"found {getattr(given, name)!r}", rule)
        return given.scenario
    if not isinstance(given.scenario, str | Path):
        rule = f"{MISSIONS!r}, a name or a path is needed"
        raise InputError(_place("scenario"), f"found {given.scenario!r}", rule)
    name, overrides = str(given.scenario), ()
    if Path(name).name == name and not name.endswith(".toml") and name not in scenario_names():
        raise UnknownNameError(_place("scenario"), "scenario", name, (MISSIONS, *scenario_names()))
    if given.duration is not None and given.drive is None:
        overrides = (f"duration={_number('duration', given.duration, _DURATION)!r}",)
    return read_scenario(given.scenario, overrides, _path(given.model), _path(given.floors))


def _with_own(task: Task, given: Options) -> Task:
    """Put the given floor, faults and drive in the place of the scenario's."""
    if given.floor is not None:
        task = dataclasses.replace(task, floor=find_floor(given.floor, _place("floor"), task.floors).name)
    if given.faults is not None:
        if not isinstance(given.faults, Sequence) or isinstance(given.faults, str):
            raise InputError(_place("faults"), f"found {given.faults!r}", "a list of tables is needed")
        wheels, length = task.robot.wheel_count, task.duration
        faults = tuple(
            read_fault(table, _place(f"faults.{i}"), wheels, task.floors, length)
            for i, table in enumerate(given.faults)
        )
        task = dataclasses.replace(task, faults=faults)
    if given.drive is None:
        return task
    drive = read_drive(given.drive, _place("drive"), task.duration, task.period)
    creep = None
    if drive.creep_floor is not None:
        creep = find_floor(drive.creep_floor, _place("drive.creep_floor"), task.floors)
    return dataclasses.replace(
        task, plan=_plan(drive.reference), start=drive.start, loops=_loops(drive), creep_floor=creep
    )


def _plan(reference: Any) -> Plan:
    columns = np.column_stack([reference.position, reference.heading, reference.velocity])
    return Plan(columns, np.ascontiguousarray(reference.yaw_rate, float))


def _loops(drive: Any) -> dict[str, bool]:
    return {name: getattr(drive, name) for name in ("yaw_loop", "heading_hold", "heading_feedback")}


def _periods(decision: float, robot: Robot) -> int:
    period = 1.0 / robot.sensors.sample_rate
    seconds = _number("decision_period", decision, _DECISION)
    periods = round(seconds / period)
    if periods < 1 or abs(periods * period - seconds) > 1e-9:
        rule = f"must be a multiple of the control period, {period:g} s"
        raise InputError(_place("decision_period"), f"found {seconds:g}", rule)
    return periods


def _place(option: str) -> str:
    return f"{ENVIRONMENT}: {option}"


def _number(option: str, value: Any, rule: Rule) -> float:
    return float(check_number(_place(option), value, rule))


def _choice(option: str, value: Any, choices: Sequence[str]) -> str:
    if value not in choices:
        raise UnknownNameError(_place(option), option, value, choices)
    return str(value)


def _or(value: float | None, otherwise: Callable[[], float]) -> float:
    return otherwise() if value is None else value


def _path(given: str | Path | None) -> Path | None:
    return None if given is None else Path(given)


def draw_plan(draws: np.random.Generator, duration: float, period: float) -> Plan:
    """Draw a mission: straight segments at 0.2-1.0 m/s with turns, stops and reversals, from rest to rest.

    Within a segment the velocity goes from where it is to the demand at constant acceleration, so that no
    loop over the control periods is needed. Duration and period are in s.
    """
    rows = round(duration / period) + 1
    twist, now, row = np.zeros((rows, 3)), np.zeros(3), 0
    for begin, end, demand in demanded_twists(draws, rows, period):
        twist[row:begin] = _approach(now, np.zeros(3), begin - row, period)
        now = twist[begin - 1]
        twist[begin:end] = _approach(now, np.array(demand), end - begin, period)
        now, row = twist[end - 1], end
    twist[row:] = _approach(now, np.zeros(3), rows - row, period)
    before = np.vstack((np.zeros(3), np.cumsum(twist[:-1], axis=0) * period))
    return Plan(np.column_stack([before, twist[:, :2]]), twist[:, 2].copy())


def _approach(now: Array, demand: Array, rows: int, period: float) -> Array:
    """Twists that approach a demand at the largest accelerations, shape (rows, 3)."""
    time, away = period * np.arange(1, rows + 1), demand - now
    far = math.hypot(away[0], away[1])
    along = np.minimum(ACCELERATION * time / far, 1.0) if far > 0.0 else np.ones(rows)
    turned = np.clip(away[2], -YAW_ACCELERATION * time, YAW_ACCELERATION * time)
    return np.column_stack([now[0] + along * away[0], now[1] + along * away[1], now[2] + turned])
