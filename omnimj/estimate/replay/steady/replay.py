"""Replay of steady driving: the floor's forces on wheels that turn as measured must balance.

Channels are the body's velocity and yaw rate, and the current of each wheel. Ratios of traction to drag
follow from the velocities, their size from the currents and the torque constant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnimj.effects import ROBOT, AppliedEffects, ChannelEffect, apply_effects
from omnimj.errors import InputError
from omnimj.estimate.replay.base_parameters import (
    AdjustedMachine,
    add_effects,
    adjusted_machine,
    base_parameters,
    standing_constants,
)
from omnimj.estimate.replay.interface import (
    BaseParameter,
    CandidateEffect,
    Channel,
    Experiment,
    Setting,
    Structure,
    candidate_effects,
)
from omnimj.estimate.replay.steady.runs import SteadyRuns, steady_runs
from omnimj.estimate.threads import map_in_threads
from omnimj.parameters import Floor, Robot
from omnimj.physics.equilibrium import steady_rows
from omnimj.physics.kinematics import rolling_matrix, turned
from omnimj.physics.motor import driven_by_measured_current, motor_parameters
from omnimj.physics.planar import PlanarModel
from omnimj.physics.wheel import packed
from omnimj.recording.dataset import Dataset
from omnimj.signals import Array

EFFECTS = (
    "creep_ratio",
    "soft_floor",
    "load_sensitivity",
    "load_offset",
    "floor_traction",
    "roller_friction",
    "rolling_resistance",
    "bearing_friction",
    "wheel_radius",
    "torque_constant",
    "current_scale",
    "grade",
    "heading_offset",
    "pose_scale",
)
"""Effects that can show in the velocity or the currents of steady driving."""
_VARIABLES = ("rolling_speed", "roller_speed")
"""Variables of the free curves: r φ̇, with a force along the drive; the rollers' speed, along the axle."""
_CURVE = 2.0  # [N] typical force of a free curve
_EQUATION_ERROR = 0.001, 0.002, 0.05  # of velocities [m/s], of the yaw rate [rad/s], of currents [A]
_MOST_OF_ROBOT, _MOST_OF_FLOOR = 4, 4  # effects in a model
_MARKER = 0.03  # [rad] by which a marker may sit turned on the robot
_MOVES = {"ahead": 0.0, "diagonal": 45.0, "left": 90.0, "back": 180.0}
_SPEEDS = {"slow": 0.1, "fast": 0.3}  # [m/s]


class SteadyReplay:
    """Replay of a dataset of steady driving with a measured pose."""

    plant, backward_elimination, notes = ROBOT, True, ()
    structures: tuple[Structure, ...] = ()

    def __init__(self, dataset: Dataset, robot: Robot, floors: Mapping[str, Floor]):
        """Prepare the runs.

        Raises:
          InputError: A run without floor, or too little steady driving.
          UnknownNameError: Unknown floor.
        """
        self._robot, self._floors = robot, dict(floors)
        self._runs = steady_runs(dataset, robot, self._floors)
        self.channels = _channels(self._runs.noise)
        self.segments, self.measured = self._runs.segments, self._runs.measured
        constants = base_parameters(robot, self._floors, self._runs.floor, ())
        self._sessions = _sessions(self._runs.floor)
        self.base: tuple[BaseParameter, ...] = (*constants, *map(_marker_angle, self._sessions))
        self.curves: Mapping[str, float] = dict.fromkeys(_VARIABLES, _CURVE)
        speeds = robot.wheel.radius * self._runs.wheel_speed
        self.most_effects = _MOST_OF_ROBOT + _MOST_OF_FLOOR * len(set(self._runs.floor))
        self._span = float(np.abs(speeds).max())
        spans = {"speed": (-self._span, self._span), "position": (-1.0, 1.0)}
        used = tuple(dict.fromkeys(self._runs.floor))
        found = candidate_effects(ROBOT, spans, (), robot.wheel_count, used)
        self.candidates: tuple[CandidateEffect, ...] = tuple(
            _within(c, robot) for c in found if self._fits(c)
        )
        self._by_label = {c.label: c for c in self.candidates}
        inverse = np.linalg.pinv(rolling_matrix(robot.wheel_positions, robot.rolling_directions))
        self._guess = 0.85 * speeds @ inverse.T

    def _fits(self, candidate: CandidateEffect) -> bool:
        """True if this effect can show, and can be added to those of the model and to its floors."""
        if candidate.effect not in EFFECTS or (candidate.effect == "heading_offset" and self._sessions):
            return False
        typical = np.array([s.typical for s in candidate.parameters])
        try:
            applied = apply_effects(add_effects(self._robot, [(candidate, typical)]))
            for name in set(self._runs.floor):
                applied.floor(self._floors[name])
        except InputError:
            return False
        return True

    def based(self, setting: Setting) -> AdjustedMachine[Robot]:
        """Robot with the base parameters and effects of a setting."""
        constants = len(self.base) - len(self._sessions)
        own = replace(setting, base=setting.base[:constants])
        return adjusted_machine(self._robot, self._floors, self.base[:constants], self._by_label, own)

    def _marker(self, setting: Setting, floor: str) -> float:
        """Angle of the marker in the runs on a floor [rad]; 0 where all runs are of one session."""
        first = len(self.base) - len(self._sessions)
        return float(setting.base[first + self._sessions.index(floor)]) if self._sessions else 0.0

    def simulate(self, settings: Sequence[Setting]) -> list[Array]:
        """Block means of the channels by the equations, shape (blocks, channels) per setting."""
        return map_in_threads(lambda s: self._replay(s, self._runs, self._guess), settings)

    def simulate_twin(self, setting: Setting) -> None:
        """None: the equations share their floors with the twin, whose rollers only add a ripple."""

    def _replay(self, setting: Setting, runs: SteadyRuns, guess: Array) -> Array:
        based = self.based(setting)
        changed = apply_effects(based.machine)
        extra = _free_curve(setting, self._span)
        rows = np.full((len(runs.wheel_speed), 3 + runs.wheel_speed.shape[1]), np.nan)
        rows[:, :3] = guess
        for name in dict.fromkeys(runs.floor):
            model = steady_model(changed, changed.floor(based.floors[name]))
            own = _blocks_on(runs, name)
            found = rows[own]
            steady_rows(model, runs.wheel_speed[own], extra, found)
            rows[own] = found
            rows[own, :2] = turned(found[:, :2], -self._marker(setting, name))
        return _readings(rows, changed.channels)

    def true_rows(self, setting: Setting) -> Array:
        """Measured twist and currents without what a setting's sensors do to them, shape (blocks, 3 + n)."""
        channels = apply_effects(self.based(setting).machine).channels
        rows, none = self.measured.copy(), ChannelEffect()
        angle, scale = channels.get("heading", none).offset, channels.get("x", none).scale
        for name in dict.fromkeys(self._runs.floor):
            own = _blocks_on(self._runs, name)
            rows[own, :2] = turned(rows[own, :2], angle + self._marker(setting, name)) / scale
        for i in range(rows.shape[1] - 3):
            reading = channels.get(f"current_{i + 1}", none)
            rows[:, 3 + i] = (rows[:, 3 + i] - reading.offset) / reading.scale
        return rows

    def blocks(self) -> Mapping[str, tuple[NDArray[np.int_], Array]]:
        """Floor → indices of its blocks and their wheel speeds, shape (blocks, n) [rad/s]."""
        names = dict.fromkeys(self._runs.floor)
        own = {name: _blocks_on(self._runs, name) for name in names}
        return {name: (rows, self._runs.wheel_speed[rows]) for name, rows in own.items()}

    def model_on(self, setting: Setting, floor: str) -> tuple[PlanarModel, Floor]:
        """Planar model of a setting on a floor, and this floor with its effects."""
        based = self.based(setting)
        changed = apply_effects(based.machine)
        own = changed.floor(based.floors[floor])
        return steady_model(changed, own), own

    def regimes(self) -> Mapping[str, tuple[str, Array]]:
        """Variable → unit and its measured value in every block, shape (blocks,)."""
        ahead, left, rate = self.measured[:, :3].T
        return {
            "speed": ("m/s", np.hypot(ahead, left)),
            "direction": ("rad", np.arctan2(left, ahead)),
            "yaw_rate": ("rad/s", rate),
            "time": ("s", np.concatenate([segment.time for segment in self.segments])),
        }

    def candidate_experiments(self) -> tuple[Experiment, ...]:
        """Straight runs at constant wheel speeds that a user could make."""
        return tuple(
            Experiment(
                f"{move} {pace} on {floor}",
                f"drive {move} at a wheel speed of {speed:g} m/s for 5 s on {floor}",
                {"floor": floor, "direction": direction, "speed": speed},
            )
            for floor in dict.fromkeys(self._runs.floor)
            for move, direction in _MOVES.items()
            for pace, speed in _SPEEDS.items()
        )

    def predict(self, settings: Sequence[Setting], experiment: Experiment) -> list[Array]:
        """Predict block means of a run at constant wheel speeds, shape (blocks, channels) each."""
        robot, angle = self._robot, np.deg2rad(float(experiment.run["direction"]))
        twist = float(experiment.run["speed"]) * np.array([np.cos(angle), np.sin(angle), 0.0])
        rims = rolling_matrix(robot.wheel_positions, robot.rolling_directions) @ twist
        speeds = np.tile(rims / robot.wheel.radius, (5, 1))
        runs = SteadyRuns((), (str(experiment.run["floor"]),), speeds, speeds, speeds)
        guess = np.tile(0.85 * twist, (5, 1))
        return map_in_threads(lambda s: self._replay(s, runs, guess), settings)


def _within(candidate: CandidateEffect, robot: Robot) -> CandidateEffect:
    """The candidate with bounds that keep the friction of the rollers from falling below zero."""
    if candidate.effect != "roller_friction":
        return candidate
    shapes = (replace(s, low=max(s.low, -getattr(robot.wheel, s.name))) for s in candidate.parameters)
    return replace(candidate, parameters=tuple(shapes))


def _channels(noise: Array) -> tuple[Channel, ...]:
    """Channels, whose error is that of the equations and of a run's mean."""
    wheels = range(1, len(noise) - 2)
    velocity, rate, current = _EQUATION_ERROR
    errors = np.hypot(noise, [velocity, velocity, rate, *(current for _ in wheels)]).tolist()
    return (
        Channel("velocity_ahead", "m/s", "velocity ahead", 0.0, errors[0]),
        Channel("velocity_left", "m/s", "velocity to the left", 0.0, errors[1]),
        Channel("yaw_rate", "rad/s", "yaw rate", 0.0, errors[2]),
        *(Channel(f"current_{i}", "A", f"current that wheel {i} needs", 0.0, errors[2 + i]) for i in wheels),
    )


def _blocks_on(runs: SteadyRuns, floor: str) -> NDArray[np.int_]:
    """Indices of the blocks on a floor; all, of a run that has no segments."""
    if not runs.segments:
        return np.arange(len(runs.wheel_speed))
    parts = [
        np.arange(segment.first, segment.last)
        for segment, name in zip(runs.segments, runs.floor, strict=True)
        if name == floor
    ]
    return np.concatenate(parts)


def steady_model(changed: AppliedEffects, floor: Floor) -> PlanarModel:
    """Planar model of a robot with its effects on one floor."""
    n = changed.machine.wheel_count
    made = standing_constants(changed, changed.machine.body.mass)
    motors = changed.motors([motor_parameters(changed.machine.motor)] * n)
    return PlanarModel(
        made.body,
        made.wheels,
        np.array([packed(driven_by_measured_current(motor)) for motor in motors]),
        np.tile(floor.row, (n, 1)),
        changed.terms,
        False,
    )


def _free_curve(setting: Setting, span: float) -> Array:
    """Free curve of a setting as `physics.equilibrium.steady_twist` takes it."""
    if setting.curve is None:
        return np.zeros(0)
    over, force = setting.curve
    return np.concatenate([[float(_VARIABLES.index(over)), -span, span], force])


def _sessions(floors: Sequence[str]) -> tuple[str, ...]:
    """Floors whose runs have a marker angle of their own: none where there is one floor.

    Runs on another floor are another session, before which the marker was put on anew.
    """
    used = tuple(dict.fromkeys(floors))
    return used if len(used) > 1 else ()


def _marker_angle(floor: str) -> BaseParameter:
    words = f"angle of the marker in the runs on {floor}"
    return BaseParameter(f"{floor}.heading", "rad", 0.0, -_MARKER, _MARKER, words)


def _readings(rows: Array, channels: Mapping[str, ChannelEffect]) -> Array:
    """Rows as the sensors show them: turned by the marker's angle, scaled, currents by their monitors."""
    found = rows.copy()
    none = ChannelEffect()
    angle, scale = channels.get("heading", none).offset, channels.get("x", none).scale
    found[:, :2] = scale * turned(rows[:, :2], -angle)
    for i in range(rows.shape[1] - 3):
        reading = channels.get(f"current_{i + 1}", none)
        found[:, 3 + i] = reading.scale * rows[:, 3 + i] + reading.offset
    return found
