"""The test rig's model as a plant that needs no MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.effects import AppliedEffects, apply_effects
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Floor, Rig, Robot, read_floors
from omnimj.parameters.floor import ROW
from omnimj.physics import planar, rig
from omnimj.physics.motor import SHORTED
from omnimj.physics.native import kernel
from omnimj.physics.planar import POSITION_X, POSITION_Y, PlanarConstants, planar_constants
from omnimj.plant.effects import conditions_with_effects
from omnimj.plant.faults import Fault, conditions_at, event_times
from omnimj.plant.ground import Ground, Patch, floor_at
from omnimj.plant.interface import RIG_TRUTH_NAMES, robot_truth_names
from omnimj.plant.sensors import RigSensors, RobotSensors
from omnimj.signals import Array, CurrentCommand, Measurement, RigMeasurement

SUBSTEPS = 4
"""Steps of the model per control period: 0.25 ms, a twelfth of a wheel's time constant on the floor."""

RIG_FAULTS = ("motor", "free", "locked", "hard_over", "slip", "all_wheel_slip", "wheel_radius", "sensor")
"""Kinds of faults that the rig can have: it has one wheel on a straight rail."""

_TIME_TOLERANCE = 1e-9  # [s] a time summed up from steps may lie this much below the event it stands for


@dataclass(frozen=True)
class _Stage:
    """What holds from one time on."""

    begin: float
    row: Array
    motor: Array
    floor: Array


class PlanarRig:
    """The rig model as a `Plant`; its rail has no ends, its gantry moves at the commanded speed at once."""

    truth_names = RIG_TRUTH_NAMES

    def __init__(
        self,
        constants: Rig,
        floor: str,
        *,
        mass: float | None = None,
        lateral_speed: float = 0.0,
        faults: Sequence[Fault] = (),
        seed: int = 0,
        published: bool = False,
        ideal_sensors: bool = False,
        floors: Mapping[str, Floor] | None = None,
        measured_current: bool = False,
    ):
        """The rig at rest.

        Args:
          constants: Of the rig, with its effects.
          floor: Name of the floor.
          mass: m_T [kg]; the first of the rig's masses when None.
          lateral_speed: Of the gantry [m/s].
          faults: The truth about what goes wrong.
          seed: Of the sensors' noise.
          published: The equations as printed instead of the corrected ones.
          ideal_sensors: True values without noise, filters and quantisation.
          floors: Floors by name; the shipped ones when None.
          measured_current: Commands are currents that were measured: neither limits nor the current loop act.

        Raises:
          UnknownNameError: A floor that does not exist, or a fault that the rig cannot have.
          InputError: A mass that is not positive, a lateral speed that is not finite, or an effect that is
            not as it must be.
        """
        effects = apply_effects(constants)
        constants = effects.machine
        mass = (constants.rig.masses[0] if mass is None else mass) + effects.added_mass
        if not (math.isfinite(mass) and mass > 0.0):
            raise InputError("mass", f"found {mass!r}", "must be above 0")
        if not math.isfinite(lateral_speed):
            raise InputError("lateral_speed", f"found {lateral_speed!r}", "must be a finite number")
        for k, fault in enumerate(faults):
            if fault.kind not in RIG_FAULTS:
                raise UnknownNameError(f"faults.{k}.kind", "fault of the rig", fault.kind, RIG_FAULTS)
        self.period = 1.0 / constants.sensors.sample_rate
        self._lateral_speed, self._published = float(lateral_speed), published
        ground = Ground(floor, (), effects.floors(read_floors() if floors is None else floors))
        times = (0.0, *event_times(faults))
        self._terms = effects.terms[0]
        self._stages = [
            _stage(constants, mass, ground, faults, begin, effects, measured_current) for begin in times
        ]
        self._sensors = RigSensors(
            constants.sensors, constants.motor, self.period, seed, faults, ideal_sensors, effects.channels
        )
        self._state, self._output = np.zeros(rig.STATE), np.zeros(rig.OUTPUT)
        self._steps, self._at = 0, 0

    def reset(self) -> RigMeasurement:
        """Puts the rig at rest at the rail's start, the gantry moving; the same noise comes again."""
        self._steps, self._at = 0, 0
        self._state[:] = 0.0
        self._enter_stage()
        self._sensors.reset()
        self._run(self._state.copy(), 0.0, 1)
        return self._measure()

    def set_speeds(self, carriage_speed: float, wheel_speed: float) -> None:
        """Sets the speeds of carriage [m/s] and wheel [rad/s], for a run that begins in motion."""
        self._state[rig.SPEED] = carriage_speed
        self._state[rig.WHEEL_SPEED] = wheel_speed

    def step(self, command: CurrentCommand) -> RigMeasurement:
        """Holds the command for one period and returns the measurement at its end.

        Raises:
          InputError: A command of more or less than one current.
        """
        if len(command.current) != 1:
            raise InputError("command", f"found {len(command.current)} currents", "one is needed")
        self._enter_stage()
        self._run(self._state, float(command.current[0]), SUBSTEPS)
        self._steps += 1
        return self._measure()

    def truth(self) -> Array:
        """Aligned with `truth_names`: positions count from the start, the body does not tilt.

        The lateral force is the one on the wheel, along the gantry's direction: −G of Eq. 4.18.
        """
        position, speed, wheel_speed = self._state[[rig.POSITION, rig.SPEED, rig.WHEEL_SPEED]]
        lateral_position = self._lateral_speed * self._steps * self.period
        slip, normal, traction, lateral = self._output[:4]
        return np.array(
            (position, speed, wheel_speed, lateral_position, 0.0, slip, normal, traction, -lateral)
        )

    def close(self) -> None:
        """Nothing to let go of."""

    def _enter_stage(self) -> None:
        now = self._steps * self.period + _TIME_TOLERANCE
        while self._at + 1 < len(self._stages) and self._stages[self._at + 1].begin <= now:
            self._at += 1

    def _run(self, state: Array, command: float, steps: int) -> None:
        stage, h = self._stages[self._at], self.period / SUBSTEPS
        numbers = (self._lateral_speed, stage.row, stage.motor, stage.floor, self._terms)
        rig.step(state, command, *numbers, h, steps, self._published, self._output)

    def _measure(self) -> RigMeasurement:
        speed, current = self._state[rig.SPEED], self._state[rig.CURRENT]
        wheel_speed, acceleration = self._output[rig.ENCODER], self._output[rig.ACCELERATION]
        time = self._steps * self.period
        return self._sensors.measure(time, current, wheel_speed, speed, acceleration, self._lateral_speed)


def _stage(
    constants: Rig,
    mass: float,
    ground: Ground,
    faults: Sequence[Fault],
    begin: float,
    effects: AppliedEffects,
    measured_current: bool,
) -> _Stage:
    now = conditions_with_effects(conditions_at(faults, begin, constants.motor, 1), effects, measured_current)
    row = rig.rig_row(constants, mass, float(now.radius_scale[0]), float(now.grip[0]), now.slope[0])
    has_own, own = ground.replaced(now.floors)
    return _Stage(begin, row, now.motor_rows[0], own[0] if has_own[0] else ground.rows[0])


# Plants that need no MuJoCo: the planar model of the robot behind its sensors, and the rig's.

__all__ = ["PlanarRig", "PlanarRobot"]

_TIME_TOLERANCE = 1e-9  # [s] a time summed up from steps may lie this much below the event it stands for


@dataclass(frozen=True)
class _planar_Stage:
    """What holds from one time on."""

    begin: float
    constants: PlanarConstants
    motors: Array
    own_floors: tuple[Array, Array]
    """Which wheels have a floor by fault (n,), and its row (n, ROW)."""


@kernel
def _find_floors(state, wheels, has_own, own_floors, patches, rows, floors):
    """Fills `floors` with the row of the floor under each wheel's centre, shape (n, ROW)."""
    n = wheels.shape[0]
    pose = planar.pose_offset(n)
    x, y, yaw = state[pose], state[pose + 1], state[pose + 2]
    c, s = math.cos(yaw), math.sin(yaw)
    for i in range(n):
        p_x, p_y = wheels[i, POSITION_X], wheels[i, POSITION_Y]
        if has_own[i] > 0.0:
            floors[i, :] = own_floors[i]
        else:
            floors[i, :] = rows[floor_at(patches, x + c * p_x - s * p_y, y + s * p_x + c * p_y)]


@kernel
def _run_period(
    state, command, body, wheels, motors, own, patches, rows, floors, terms, h, steps, published, output
):
    """One control period of the model; `own` says which wheels have a floor by fault, and that floor."""
    _find_floors(state, wheels, own[0], own[1], patches, rows, floors)
    planar.step(state, command, body, wheels, motors, floors, terms, h, steps, published, output)


class PlanarRobot:
    """The planar robot model as a `Plant`."""

    def __init__(
        self,
        robot: Robot,
        floor: str,
        *,
        faults: Sequence[Fault] = (),
        patches: Sequence[Patch] = (),
        start: tuple[float, float, float] = (0.0, 0.0, 0.0),
        seed: int = 0,
        published: bool = False,
        ideal_sensors: bool = False,
        floors: Mapping[str, Floor] | None = None,
        measured_current: bool = False,
    ):
        """The robot at rest.

        Args:
          robot: Its constants, with its effects.
          floor: Name of the hall's floor.
          faults: The truth about what goes wrong.
          patches: Stretches of other floor; a wheel is where its centre is.
          start: x, y [m] and heading [rad] in the world.
          seed: Of the sensors' noise.
          published: The equations as printed instead of the corrected ones.
          ideal_sensors: True values without noise, filters and quantisation.
          floors: Floors by name; the shipped ones when None.
          measured_current: Commands are currents that were measured: neither limits nor the current loop act.

        Raises:
          UnknownNameError: A floor that does not exist.
          InputError: A payload that the robot cannot carry, a start that is not finite, or an effect that is
            not as it must be.
        """
        if len(start) != 3 or not all(map(math.isfinite, start)):
            raise InputError("start", f"found {start!r}", "three finite numbers are needed: x, y, heading")
        effects = apply_effects(robot)
        robot = effects.machine
        n = self._wheels = len(robot.wheels)
        self.period = 1.0 / robot.sensors.sample_rate
        self.truth_names = robot_truth_names(n)
        self._start, self._published = start, published
        self._ground = Ground(floor, patches, effects.floors(read_floors() if floors is None else floors))
        self._terms = effects.terms
        self._stages = [
            self._stage(robot, faults, begin, effects, measured_current)
            for begin in (0.0, *event_times(faults))
        ]
        self._sensors = RobotSensors(
            robot.sensors, robot.motor, n, self.period, seed, faults, ideal_sensors, effects.channels
        )
        self._state = np.zeros(planar.state_size(n))
        self._command, self._floors = np.zeros(n), np.zeros((n, ROW))
        self._output = np.zeros(planar.output_size(n))
        self._steps, self._at = 0, 0
        self._brake(())

    def _stage(
        self, robot: Robot, faults: Sequence[Fault], begin: float, effects: AppliedEffects, measured: bool
    ) -> _planar_Stage:
        now = conditions_with_effects(
            conditions_at(faults, begin, robot.motor, self._wheels), effects, measured
        )
        constants = planar_constants(
            robot, now.misalignment, now.radius_scale, now.grip, now.payload, now.slope
        )
        return _planar_Stage(begin, constants, now.motor_rows, self._ground.replaced(now.floors))

    def reset(self) -> Measurement:
        """Puts the robot at rest at its start; the same noise comes again."""
        self._steps, self._at = 0, 0
        self._command[:] = 0.0
        self._state[:] = 0.0
        self._state[-3:] = self._start
        self._brake(())
        self._enter_stage()
        self._sensors.reset()
        self._run(self._state.copy(), 1)  # forces at rest, for truth and accelerometer
        return self._measure()

    def step(self, command: CurrentCommand) -> Measurement:
        """Holds the command for one period and returns the measurement at its end.

        Raises:
          InputError: A command of the wrong length.
        """
        if len(command.current) != self._wheels:
            found = f"found {len(command.current)} currents"
            raise InputError("command", found, f"{self._wheels} are needed, one per wheel")
        self._command[:] = command.current
        self._enter_stage()
        if command.brake != self._braked:
            self._brake(command.brake)
        self._run(self._state, SUBSTEPS)
        self._steps += 1
        return self._measure()

    def truth(self) -> Array:
        """Pose, twist, slip velocity, normal and traction force, aligned with `truth_names`."""
        n = self._wheels
        twist = self._state[2 * n : 2 * n + 3]
        return np.concatenate((self._state[-3:], twist, self._output[: 3 * n]))

    def close(self) -> None:
        """Nothing to let go of."""

    def _enter_stage(self) -> None:
        now = self._steps * self.period + _TIME_TOLERANCE
        while self._at + 1 < len(self._stages) and self._stages[self._at + 1].begin <= now:
            self._at += 1
            self._brake(self._braked)

    def _brake(self, wheels: tuple[int, ...]) -> None:
        self._motors, self._braked = self._stages[self._at].motors.copy(), wheels
        self._motors[[wheel - 1 for wheel in wheels], SHORTED] = 1.0

    def _run(self, state: Array, steps: int) -> None:
        stage, ground = self._stages[self._at], self._ground
        _run_period(
            state,
            self._command,
            stage.constants.body,
            stage.constants.wheels,
            self._motors,
            stage.own_floors,
            ground.patches,
            ground.rows,
            self._floors,
            self._terms,
            self.period / SUBSTEPS,
            steps,
            self._published,
            self._output,
        )

    def _measure(self) -> Measurement:
        n, state = self._wheels, self._state
        return self._sensors.measure(
            self._steps * self.period,
            state[2 * n + 3 : 3 * n + 3],
            self._output[4 * n + 2 :],
            self._output[4 * n : 4 * n + 2],
            state[2 * n + 2],
            state[-1],
        )
