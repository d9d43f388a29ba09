"""The planar model of the robot behind its sensors, a plant without MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from omnimj.effects import apply_effects
from omnimj.errors import InputError
from omnimj.parameters import Floor, Robot, read_floors
from omnimj.parameters.floor import TRACTION_SIZE
from omnimj.physics import planar
from omnimj.physics.motor import SHORTED
from omnimj.physics.native import kernel
from omnimj.physics.planar_wheel import POSITION_X, POSITION_Y
from omnimj.plant.faults import Conditions, Fault
from omnimj.plant.ground import Ground, Patch, floor_at
from omnimj.plant.interface import commanded_currents, given_floor, robot_truth_names
from omnimj.plant.sensor_chain import SensorChain, read_sensors
from omnimj.plant.sensors import RobotSensors
from omnimj.plant.stages import StagedPlant, timeline
from omnimj.signals import Array, CurrentCommand, Measurement, compiled_in

SUBSTEPS = 4
"""Number of integration steps per control period; 0.25 ms is a twelfth of a wheel's time constant."""


@dataclass(frozen=True)
class _RobotStage:
    """Packed robot and floors while the conditions stay constant."""

    begin: float
    """Time of the beginning [s]."""
    constants: planar.PlanarConstants
    motors: Array
    """Packed motors, shape (n, MOTOR_SIZE)."""
    replacements: tuple[Array, Array]
    """Floors due to faults, from `Ground.replacements`."""


@kernel
def _find_floors(pose, wheels, ground, floors):
    """Fill `floors` with the traction of the floor under each wheel's centre, shape (n, TRACTION_SIZE)."""
    replaced, replacements, patches, rows = ground
    x, y = pose[0], pose[1]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(wheels.shape[0]):
        p_x, p_y = wheels[i, POSITION_X], wheels[i, POSITION_Y]
        if replaced[i] > 0.0:
            floors[i, :] = replacements[i]
        else:
            floors[i, :] = rows[floor_at(patches, x + c * p_x - s * p_y, y + s * p_x + c * p_y)]


class PlanarArrays(NamedTuple):
    """Arrays of a planar robot with n wheels, its sensors and the periods so far."""

    state: Array
    """Packed `planar.PlanarState`, shape (state_size(n),)."""
    output: Array
    """Packed `planar.PlanarOutput`, shape (output_size(n),)."""
    machine: tuple[Array, Array, Array, Array, Array]
    """Packed body, wheels, motors, floors (filled by each step) and effect terms."""
    ground: tuple[Array, Array, Array, Array]
    """Mask of replaced floors, their traction laws, patches, traction laws of hall and patches."""
    nominal_shorts: Array
    """1 for motors that are shorted by the conditions, shape (n,)."""
    published: bool
    """True for the equations as printed."""
    period: float
    """Control period [s]."""
    steps: Array
    """Control periods since the start, shape (1,), integer."""
    values: Array
    """Physical quantities for the sensors, shape (2n+4,)."""
    sensors: SensorChain


@kernel
def advance_planar(plant, state, current, steps):
    """Advance a state, in place, under set currents; fills `output`.

    Args:
      plant: `PlanarArrays`.
      state: Packed `planar.PlanarState`; usually the plant's own.
      current: Set currents, shape (n,) [A].
      steps: Number of integration steps.
    """
    body, wheels, motors, floors, terms = plant.machine
    _find_floors(state[-3:], wheels, plant.ground, floors)
    model = planar.PlanarModel(body, wheels, motors, floors, terms, plant.published)
    planar.step(state, current, model, plant.period / SUBSTEPS, steps, plant.output)


@kernel
def measure_planar(plant):
    """Readings of all sensors now, a new array of shape (2n+4,)."""
    state, output, values = planar.planar_state(plant.state), planar.planar_output(plant.output), plant.values
    n = state.current.size
    values[:n], values[n : 2 * n] = state.current, output.encoder_speed
    values[2 * n : 2 * n + 2] = output.acceleration
    values[2 * n + 2], values[2 * n + 3] = state.twist[2], state.pose[2]
    return read_sensors(plant.sensors, plant.steps[0] * plant.period, values)


@kernel
def step_planar(plant, current):
    """Hold set currents, shape (n,) [A], for one control period and return the readings at its end."""
    advance_planar(plant, plant.state, current, SUBSTEPS)
    plant.steps[0] += 1
    return measure_planar(plant)


@kernel
def short_planar_motors(plant, brake):
    """Short the motors of a mask, shape (n,), and those that the conditions short."""
    motors = plant.machine[2]
    for i in range(brake.size):
        motors[i, SHORTED] = 1.0 if brake[i] else plant.nominal_shorts[i]


@kernel
def write_planar_truth(plant, truth):
    """Write pose, twist, slip, normal force and traction in the order of `robot_truth_names`."""
    state = planar.planar_state(plant.state)
    truth[:3], truth[3:6] = state.pose, state.twist
    truth[6:] = plant.output[: truth.size - 6]


class PlanarRobot(StagedPlant):
    """Planar model of the robot as a `Plant`."""

    def __init__(
        self,
        robot: Robot,
        floor: Floor | str,
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
        """Place the robot at rest at its start.

        Args:
          robot: Constants of the robot, with its effects.
          floor: Floor of the hall, or its name.
          faults: Faults of the run.
          patches: Patches of other floors; the centre of a wheel determines the floor under it.
          start: x, y [m] and heading [rad] in the world.
          seed: Seed of the sensor noise.
          published: Whether to use the equations as printed instead of the corrected ones.
          ideal_sensors: Whether sensors return true values, without noise, filters and quantisation.
          floors: Floors by name; the shipped ones when None.
          measured_current: Whether commands are measured currents, exempt from limits and current loop.

        Raises:
          UnknownNameError: A floor that does not exist.
          InputError: A payload that the robot cannot carry, a start that is not finite, or an invalid effect.
        """
        if len(start) != 3 or not all(map(math.isfinite, start)):
            raise InputError("start", f"found {start!r}", "three finite numbers are needed: x, y, heading")
        effects = apply_effects(robot)
        robot = effects.machine
        n = self._wheels = robot.wheel_count
        self.period = 1.0 / robot.sensors.sample_rate
        self.truth_names = robot_truth_names(n)
        self._start, self._published = start, published
        floors = read_floors() if floors is None else floors
        hall = given_floor(floor, floors)
        self._ground = Ground(hall.name, patches, effects.floors({**floors, hall.name: hall}))
        self._terms = effects.terms
        self._stages = [
            self._stage(robot, begin, now)
            for begin, now in timeline(robot, faults, effects, measured_current)
        ]
        self._sensors = RobotSensors(
            robot.sensors, robot.motor, n, self.period, seed, faults, ideal_sensors, effects.channels
        )
        self._row, self._output_row = np.zeros(planar.state_size(n)), np.zeros(planar.output_size(n))
        self._state, self._floors = planar.planar_state(self._row), np.zeros((n, TRACTION_SIZE))
        self._steps, self._at = np.array([-1]), 0
        self._braked: tuple[int, ...] = ()
        self._enter(0)

    def _stage(self, robot: Robot, begin: float, now: Conditions) -> _RobotStage:
        constants = planar.planar_constants(
            robot, now.misalignment, now.radius_scale, now.grip, now.payload, now.slope
        )
        return _RobotStage(begin, constants, now.motor_rows, self._ground.replacements(now.floors))

    def reset(self, seed: int | None = None) -> Measurement:
        """Put the robot at rest at its start and return the first measurement.

        Args:
          seed: Seed of the sensor noise from now on; when None, the noise of the last run is repeated.
        """
        self._steps[0], self._braked = 0, ()
        self._row[:] = 0.0
        self._state.pose[:] = self._start
        self._sensors.reset(seed)
        self._enter(0)
        self.prepare_step()
        # forces at rest, for truth and accelerometer
        advance_planar(self._arrays, self._row.copy(), np.zeros(self._wheels), 1)
        return self._measured(measure_planar(self._arrays))

    @compiled_in("planar")
    def step(self, command: CurrentCommand) -> Measurement:
        """Hold the command for one period and return the measurement at its end.

        Raises:
          InputError: Another number of currents than wheels, or a step before the first `reset`.
        """
        current = commanded_currents(command, self._wheels, int(self._steps[0]))
        self.prepare_step()
        if command.brake != self._braked:
            self._brake(command.brake)
        return self._measured(step_planar(self._arrays, current))

    @compiled_in("planar")
    def truth(self) -> Array:
        """True pose, twist, slip velocity, normal and traction force by `truth_names`, shape (6 + 3 n,)."""
        row = np.empty(len(self.truth_names))
        write_planar_truth(self._arrays, row)
        return row

    def _enter(self, stage: int) -> None:
        """Begin a stage; motors that are braked stay so."""
        self._at, now = stage, self._stages[stage]
        own, ground = now.constants, self._ground
        self._arrays = PlanarArrays(
            self._row,
            self._output_row,
            (own.body, own.wheels, now.motors.copy(), self._floors, self._terms),
            (*now.replacements, ground.patches, ground.rows),
            now.motors[:, SHORTED].copy(),
            self._published,
            self.period,
            self._steps,
            self._sensors.values,
            self._sensors.chain,
        )
        self._brake(self._braked)

    def _brake(self, wheels: tuple[int, ...]) -> None:
        mask = np.zeros(self._wheels, np.uint8)
        mask[[wheel - 1 for wheel in wheels]] = 1
        short_planar_motors(self._arrays, mask)
        self._braked = wheels
