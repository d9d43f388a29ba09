"""The MuJoCo twins of robot and rig as plants."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from omnimj.parameters import Floor, Rig, Robot
from omnimj.plant.conditions import Conditions, Fault, conditions, event_times
from omnimj.plant.interface import RIG_TRUTH_NAMES, robot_truth_names
from omnimj.plant.patches import Patch
from omnimj.plant.sensors import RigSensors, RobotSensors
from omnimj.signals import Array, CurrentCommand, Measurement, RigMeasurement
from omnimj.twin import slots
from omnimj.twin.assembly import rest_depth, rig_model, robot_model
from omnimj.twin.callback import install
from omnimj.twin.conditions_in_model import Healthy

_SETTLING = 0.3  # [s] that the gantry moves sideways before a rig run begins


def _floors_of(faults: Sequence[Fault]) -> tuple[str, ...]:
    return tuple(str(f.numbers["floor"]) for f in faults if "floor" in f.numbers)


class _Schedule:
    """Conditions by time: the next change is one comparison away from every step."""

    def __init__(self, faults: Sequence[Fault], machine: Robot | Rig, wheels: int, healthy: Healthy):
        self._faults, self._motor, self._wheels = faults, machine.motor, wheels
        self._healthy, self._times = healthy, event_times(faults)
        self.next_change = math.inf

    def start(self) -> None:
        """Applies what holds at time 0."""
        self.apply(0.0)

    def apply(self, time: float) -> Conditions:
        """Applies what holds at a time and notes when that changes."""
        now = conditions(self._faults, time, self._motor, self._wheels)
        self._healthy.apply(now)
        later = [t for t in self._times if t > time + 1e-9]
        self.next_change = min(later, default=math.inf)
        return now


class RobotTwin:
    """The robot with rollers, suspension, motors and sensors in MuJoCo; a `Plant`.

    Accelerations, slip and forces are those at the start of the last simulation step (one step before the
    positions and speeds beside them), as MuJoCo computes them.
    """

    def __init__(
        self,
        robot: Robot,
        floor: Floor,
        faults: Sequence[Fault] = (),
        patches: Sequence[Patch] = (),
        seed: int = 0,
        start: tuple[float, float, float] = (0.0, 0.0, 0.0),
        ideal_sensors: bool = False,
        timestep: float | None = None,
        scene: Path | None = None,
    ):
        """Builds the twin.

        Args:
          robot: The constants.
          floor: What lies everywhere but on patches.
          faults: The truth that the controller does not see.
          patches: Stretches of other floor.
          seed: Of the sensors' noise.
          start: x, y [m], heading [rad].
          ideal_sensors: Neither noise nor quantisation nor filters.
          timestep: Of the simulation [s]; one control period when None.
          scene: Another MJCF scene that includes the robot.
        """
        install()
        self.period = 1.0 / robot.sensors.sample_rate
        self._wheels = len(robot.wheels)
        self.truth_names = robot_truth_names(self._wheels)
        self.mj_model = robot_model(robot, floor, patches, _floors_of(faults), scene=scene, lean=True)
        self.mj_model.opt.timestep = self.period if timestep is None else timestep
        self._substeps = max(1, round(self.period / self.mj_model.opt.timestep))
        self.mj_data = mujoco.MjData(self.mj_model)
        self._start = start
        self._rest_height = robot.wheel.radius - rest_depth(robot)
        self._sensors = RobotSensors(
            robot.sensors, robot.motor, self._wheels, self.period, seed, faults, ideal=ideal_sensors
        )
        self._schedule = _Schedule(faults, robot, self._wheels, Healthy(self.mj_model, "chassis"))
        users = self.mj_model.actuator_user
        self._axles = users[: self._wheels, slots.WHEEL_DOF].astype(int)
        self._currents = self.mj_data.act[slots.CURRENT :: slots.ACTIVATIONS]
        first = int(users[0, slots.SENSOR])
        block = self.mj_data.sensordata[first : first + 5 * self._wheels]
        self._felt = block.reshape(self._wheels, 5)[:, :3].T  # slip, normal force, traction
        self._felt_size = 3 * self._wheels
        self._gravity = self.mj_model.opt.gravity
        self._axes = self.mj_data.xmat[self.mj_model.body("chassis").id].reshape(3, 3)
        self._gyro = self.mj_data.sensor("gyro").data
        self._steps, self._turns, self._last_heading = 0, 0.0, start[2]

    def reset(self) -> Measurement:
        """Robot at rest at its start, time 0."""
        mujoco.mj_resetData(self.mj_model, self.mj_data)
        self._schedule.start()
        x, y, heading = self._start
        half = 0.5 * heading
        self.mj_data.qpos[:7] = (x, y, self._rest_height, math.cos(half), 0.0, 0.0, math.sin(half))
        mujoco.mj_forward(self.mj_model, self.mj_data)
        self._steps, self._turns, self._last_heading = 0, 0.0, heading
        self._sensors.reset()
        return self._measure()

    def step(self, command: CurrentCommand) -> Measurement:
        """One control period."""
        if self.mj_data.time + 0.5 * self.mj_model.opt.timestep >= self._schedule.next_change:
            self._schedule.apply(self._steps * self.period)
        self.mj_data.ctrl[:] = command.current
        mujoco.mj_step(self.mj_model, self.mj_data, self._substeps)
        self._steps += 1
        return self._measure()

    def _heading(self) -> float:
        """Heading, unwrapped [rad]."""
        w, x, y, z = self.mj_data.qpos[3:7].tolist()
        heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        turn = heading + self._turns - self._last_heading
        if math.isfinite(turn):  # a diverged state is the loop's to report
            self._turns -= 2.0 * math.pi * round(turn / (2.0 * math.pi))
        self._last_heading = heading + self._turns
        return self._last_heading

    def _acceleration(self) -> Array:
        """What an accelerometer at the centre reads along the body's x and y: Rᵀ(a − g) [m/s²].

        The chassis is a free joint at the centre, its first accelerations are those of the centre.
        """
        felt = self.mj_data.qacc[:3] - self._gravity
        return felt @ self._axes[:, :2]

    def _measure(self) -> Measurement:
        return self._sensors.measure(
            self._steps * self.period,
            self._currents,
            self.mj_data.qvel[self._axles],
            self._acceleration(),
            float(self._gyro[2]),
            self._heading(),
        )

    def truth(self) -> Array:
        """Pose, body twist, and per wheel slip, normal force, traction; aligned with `truth_names`."""
        row = np.empty(6 + self._felt_size)
        x, y = self.mj_data.qpos[:2].tolist()
        vx, vy = self.mj_data.qvel[:2].tolist()
        heading = self._last_heading
        c, s = math.cos(heading), math.sin(heading)
        row[:6] = (x, y, heading, c * vx + s * vy, c * vy - s * vx, self.mj_data.qvel[5])
        row[6:] = self._felt.ravel()
        return row

    def pose(self) -> Array:
        """MuJoCo's generalized positions, for a picture or a recording."""
        return self.mj_data.qpos.copy()

    def close(self) -> None:
        """Nothing to let go of."""


class RigTwin:
    """The quarter test rig in MuJoCo; a `Plant` with one wheel.

    The gantry moves sideways at its commanded speed from the start.
    """

    truth_names = RIG_TRUTH_NAMES

    def __init__(
        self,
        rig: Rig,
        floor: Floor,
        mass: float | None = None,
        lateral_speed: float = 0.0,
        faults: Sequence[Fault] = (),
        patches: Sequence[Patch] = (),
        seed: int = 0,
        ideal_sensors: bool = False,
        timestep: float | None = None,
    ):
        """Builds the twin.

        Args:
          rig: The constants.
          floor: What lies everywhere.
          mass: m_T [kg]; the rig's first mass when None.
          lateral_speed: Commanded speed of the gantry [m/s].
          faults: The truth that a diagnosis does not see.
          patches: Stretches of other floor.
          seed: Of the sensors' noise.
          ideal_sensors: Neither noise nor quantisation nor filters.
          timestep: Of the simulation [s]; one sample period when None.
        """
        install()
        self.period = 1.0 / rig.sensors.sample_rate
        self.mj_model = rig_model(rig, floor, mass, _floors_of(faults), patches, lean=True)
        self.mj_model.opt.timestep = self.period if timestep is None else timestep
        self._substeps = max(1, round(self.period / self.mj_model.opt.timestep))
        self.mj_data = mujoco.MjData(self.mj_model)
        self._lateral_speed = lateral_speed
        self._sensors = RigSensors(rig.sensors, rig.motor, self.period, seed, faults, ideal=ideal_sensors)
        self._schedule = _Schedule(faults, rig, 1, Healthy(self.mj_model, "carriage"))
        m = self.mj_model
        self._rail, self._lift, self._tilt, self._gantry, self._axle = (
            int(m.joint(name).qposadr[0]) for name in ("rail", "lift", "tilt", "gantry", "wheel_1_axle")
        )
        self._felt = self.mj_data.sensor("wheel_1_contact").data
        self._steps = 0
        weight = -m.opt.gravity[2] * float(m.body_subtreemass[m.body("carriage").id])
        self._rest = -weight / rig.contact.stiffness

    def reset(self) -> RigMeasurement:
        """Carriage at its start, gantry already at its speed, time 0."""
        d = self.mj_data
        mujoco.mj_resetData(self.mj_model, d)
        self._schedule.start()
        d.qpos[self._lift] = self._rest
        if self._lateral_speed:
            # as on the rig: first the gantry comes to its speed, then the wheel is driven
            d.qvel[self._gantry] = d.ctrl[1] = self._lateral_speed
            d.qpos[self._gantry] = -_SETTLING * self._lateral_speed
            steps = round(0.5 * _SETTLING / self.mj_model.opt.timestep)
            mujoco.mj_step(self.mj_model, d, steps)
            side = 0.0
            for _ in range(steps):
                mujoco.mj_step(self.mj_model, d)
                side += self._felt[slots.SENSED.index("lateral_force")] / steps
            d.act[slots.SIDE_LOAD] = side
            d.qpos[self._gantry], d.time = 0.0, 0.0
        mujoco.mj_forward(self.mj_model, d)
        self._steps = 0
        self._sensors.reset()
        return self._measure()

    def step(self, command: CurrentCommand) -> RigMeasurement:
        """One sample period."""
        if self.mj_data.time + 0.5 * self.mj_model.opt.timestep >= self._schedule.next_change:
            self._schedule.apply(self._steps * self.period)
        self.mj_data.ctrl[0] = command.current[0]
        self.mj_data.ctrl[1] = self._lateral_speed
        mujoco.mj_step(self.mj_model, self.mj_data, self._substeps)
        self._steps += 1
        return self._measure()

    def _measure(self) -> RigMeasurement:
        speed = self.mj_data.qvel
        return self._sensors.measure(
            self._steps * self.period,
            float(self.mj_data.act[slots.CURRENT]),
            float(speed[self._axle]),
            float(speed[self._rail]),
            float(self.mj_data.qacc[self._rail]),
            float(speed[self._gantry]),
        )

    def truth(self) -> Array:
        """Aligned with `RIG_TRUTH_NAMES`."""
        place, speed = self.mj_data.qpos, self.mj_data.qvel
        return np.array(
            [
                place[self._rail],
                speed[self._rail],
                speed[self._axle],
                place[self._gantry],
                place[self._tilt],
                *self._felt[:4],
            ]
        )

    def pose(self) -> Array:
        """MuJoCo's generalized positions, for a picture or a recording."""
        return self.mj_data.qpos.copy()

    def close(self) -> None:
        """Nothing to let go of."""
