"""Plants that need no MuJoCo: the planar model of the robot behind its sensors, and the rig's."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.effects import Applied, applied
from omnimj.errors import InputError
from omnimj.parameters import Floor, Robot, read_floors
from omnimj.parameters.floor import ROW
from omnimj.physics import planar
from omnimj.physics.motor import SHORTED
from omnimj.physics.native import kernel
from omnimj.physics.planar_constants import POSITION_X, POSITION_Y, PlanarConstants, planar_constants
from omnimj.plant.conditions import Fault, conditions, event_times
from omnimj.plant.effects import lay_over
from omnimj.plant.ground import Ground, floor_at
from omnimj.plant.interface import robot_truth_names
from omnimj.plant.patches import Patch
from omnimj.plant.planar_rig import SUBSTEPS, PlanarRig
from omnimj.plant.sensors import RobotSensors
from omnimj.signals import Array, CurrentCommand, Measurement

__all__ = ["PlanarRig", "PlanarRobot"]

_LATE = 1e-9  # [s] a time summed up from steps may lie this much below the event it stands for


@dataclass(frozen=True)
class _Stage:
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
    pose = planar.pose_at(n)
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
        effects = applied(robot)
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
        self, robot: Robot, faults: Sequence[Fault], begin: float, effects: Applied, measured: bool
    ) -> _Stage:
        now = lay_over(conditions(faults, begin, robot.motor, self._wheels), effects, measured)
        constants = planar_constants(
            robot, now.misalignment, now.radius_scale, now.grip, now.payload, now.slope
        )
        return _Stage(begin, constants, now.motor_rows, self._ground.replaced(now.floors))

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
        now = self._steps * self.period + _LATE
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
