"""The MuJoCo twins of robot and test rig as plants."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from omnimj.effects import apply_effects
from omnimj.parameters import Floor, Rig, Robot, read_floors
from omnimj.physics.motor import SHORTED
from omnimj.plant.faults import Fault
from omnimj.plant.ground import Patch
from omnimj.plant.interface import RIG_TRUTH_NAMES, commanded_currents, given_floor, robot_truth_names
from omnimj.plant.mujoco import slots
from omnimj.plant.mujoco.assembly import bind_effects, rest_depth, rig_model, robot_model
from omnimj.plant.mujoco.callback import install
from omnimj.plant.mujoco.conditions import ConditionSchedule, NominalModel, fault_floors
from omnimj.plant.mujoco.step import (
    GANTRY,
    JOINTS,
    RigTwinArrays,
    TwinArrays,
    measure_rig_twin,
    measure_twin,
    short_motors,
    step_address,
    write_rig_twin_truth,
    write_twin_truth,
)
from omnimj.plant.sensors import RigSensors, RobotSensors
from omnimj.plant.stages import KernelPlant
from omnimj.signals import Array, CurrentCommand, Measurement, RigMeasurement, compiled_in

_GUIDE_SHARE = 0.4  # share of the suspension travel to either side that a larger wheel may take
_SETTLING_TIME = 0.3  # [s] for which the gantry moves sideways before a rig run begins


class _Twin(KernelPlant):
    """Base of the twins of robot and rig."""

    mj_model: mujoco.MjModel
    mj_data: mujoco.MjData
    _substeps: int
    _schedule: ConditionSchedule

    def _start_mujoco(self, timestep: float | None) -> None:
        """Make the data of the model, for steps of a length [s]; one control period when None."""
        self.mj_model.opt.timestep = self.period if timestep is None else timestep
        self._substeps = max(1, round(self.period / self.mj_model.opt.timestep))
        self.mj_data = mujoco.MjData(self.mj_model)

    @property
    def next_change(self) -> float:
        """Time of the simulation from which `prepare_step` has conditions to change [s]."""
        return self._schedule.next_change - 0.5 * self.mj_model.opt.timestep

    def prepare_step(self) -> None:
        """Apply the conditions that begin with the coming period, and keep the sensors' noise coming."""
        if self.mj_data.time >= self.next_change:
            self._change_conditions()
        self._sensors.refill()

    def _change_conditions(self) -> None:
        self._schedule.apply(int(self._arrays.steps[0]) * self.period)

    def _simulate(self) -> None:
        """Simulate one control period."""
        mujoco.mj_step(self.mj_model, self.mj_data, self._substeps)
        self._arrays.steps[0] += 1

    def _restart(self, seed: int | None) -> None:
        """Compute what follows from the start, and begin the sensors anew."""
        mujoco.mj_forward(self.mj_model, self.mj_data)
        self._sensors.reset(seed)
        self._arrays = self._arrays._replace(sensors=self._sensors.chain)
        self._arrays.steps[0] = 0

    def pose(self) -> Array:
        """Generalised positions qpos of MuJoCo, for a picture or a recording, shape (nq,)."""
        return self.mj_data.qpos.copy()


class RigTwin(_Twin):
    """Quarter test rig in MuJoCo, a `Plant` with one wheel.

    The gantry has its commanded lateral speed from the start.

    ```
    twin = RigTwin(read_rig(), "pvc", seed=1)
    measurement = twin.reset()
    measurement = twin.step(CurrentCommand([0.9]))      # one sample period, 1 ms
    ```
    """

    truth_names = RIG_TRUTH_NAMES

    def __init__(
        self,
        rig: Rig,
        floor: Floor | str,
        mass: float | None = None,
        lateral_speed: float = 0.0,
        faults: Sequence[Fault] = (),
        patches: Sequence[Patch] = (),
        seed: int = 0,
        ideal_sensors: bool = False,
        timestep: float | None = None,
        measured_current: bool = False,
        floors: Mapping[str, Floor] | None = None,
    ):
        """Build the twin.

        Args:
          rig: Constants of the rig, with effects.
          floor: Floor outside the patches, or its name.
          mass: Mass m_T of the quarter body [kg]; the first of the rig's masses when None.
          lateral_speed: Commanded speed of the gantry [m/s].
          faults: Faults of the run, hidden from controllers.
          patches: Patches of other floors.
          seed: Seed of the sensor noise.
          ideal_sensors: Whether sensors return true values, without noise, filters and quantisation.
          timestep: Step of the simulation [s]; one sample period when None.
          measured_current: Whether commands are measured currents, exempt from limits and current loop.
          floors: Floors of patches and faults by name; the shipped ones when None.
        """
        install()
        effects = apply_effects(rig)
        rig = effects.machine
        mass = (rig.rig.masses[0] if mass is None else mass) + effects.added_mass
        self.period = 1.0 / rig.sensors.sample_rate
        floors = read_floors() if floors is None else floors
        floor, floors = given_floor(floor, floors), effects.floors(floors)
        self.mj_model = rig_model(
            rig, effects.floor(floor), mass, fault_floors(faults), patches, lean=True, floors=floors
        )
        bind_effects(self.mj_model, effects.terms, measured_current)
        own = slice(slots.EFFECT_TERMS, slots.EFFECT_TERMS + effects.terms.shape[1])
        self.effect_terms: Array = self.mj_model.actuator_user[0, own]
        """Packed effect terms of the wheel in the model, which every step reads, shape (TERMS,)."""
        self._start_mujoco(timestep)
        self._lateral_speed = lateral_speed
        self._sensors = RigSensors(
            rig.sensors, rig.motor, self.period, seed, faults, ideal_sensors, effects.channels
        )
        # the mass already includes the payload
        without_load = dataclasses.replace(effects, payload=(0.0, 0.0, 0.0))
        nominal = NominalModel(self.mj_model, "carriage")
        self._schedule = ConditionSchedule(faults, without_load, measured_current, nominal)
        m = self.mj_model
        weight = -m.opt.gravity[2] * float(m.body_subtreemass[m.body("carriage").id])
        self._rest = rig.wheel.radius * (effects.radius_scale[0] - 1.0) - weight / rig.contact.stiffness
        self._find_places()

    def _find_places(self) -> None:
        """Find the views into MuJoCo's arrays once, so that a step needs no search."""
        m, d = self.mj_model, self.mj_data
        self._lift = int(m.joint("lift").qposadr[0])
        self._arrays = RigTwinArrays(
            step=step_address(),
            model=m._address,
            data=d._address,
            substeps=self._substeps,
            period=self.period,
            lateral_speed=float(self._lateral_speed),
            ctrl=d.ctrl,
            act=d.act,
            joints=np.array([int(m.joint(name).qposadr[0]) for name in JOINTS]),
            qpos=d.qpos,
            qvel=d.qvel,
            qacc=d.qacc,
            gravity=m.opt.gravity,
            sensed=d.sensor("wheel_1_contact").data,
            steps=np.array([-1]),
            values=self._sensors.values,
            sensors=self._sensors.chain,
        )

    def reset(self, seed: int | None = None) -> RigMeasurement:
        """Put the carriage at its start, with the gantry moving, and return the measurement at time 0.

        Args:
          seed: Seed of the sensor noise from now on; when None, the noise of the last run is repeated.
        """
        d = self.mj_data
        mujoco.mj_resetData(self.mj_model, d)
        self._schedule.start()
        d.qpos[self._lift] = self._rest
        if self._lateral_speed:
            self._settle(int(self._arrays.joints[GANTRY]))
        self._restart(seed)
        return self._measure()

    def _settle(self, gantry: int) -> None:
        """Move the gantry before the run: as on the rig, it reaches its speed before the wheel is driven."""
        d, sensed = self.mj_data, self._arrays.sensed
        d.qvel[gantry] = d.ctrl[1] = self._lateral_speed
        d.qpos[gantry] = -_SETTLING_TIME * self._lateral_speed
        steps = round(0.5 * _SETTLING_TIME / self.mj_model.opt.timestep)
        mujoco.mj_step(self.mj_model, d, steps)
        side = 0.0
        for _ in range(steps):
            mujoco.mj_step(self.mj_model, d)
            side += sensed[slots.SENSOR_FIELDS.index("lateral_force")] / steps
        d.act[slots.LATERAL_LOAD] = side
        d.qpos[gantry], d.time = 0.0, 0.0

    def set_speeds(self, carriage_speed: float, wheel_speed: float) -> None:
        """Set the speeds of carriage [m/s] and wheel [rad/s], for a run that begins in motion."""
        for joint, speed in (("rail", carriage_speed), ("wheel_1_axle", wheel_speed)):
            self.mj_data.qvel[int(self.mj_model.joint(joint).dofadr[0])] = speed
        mujoco.mj_forward(self.mj_model, self.mj_data)

    @compiled_in("rig_twin")
    def step(self, command: CurrentCommand) -> RigMeasurement:
        """Hold the command for one sample period and return the measurement at its end.

        Raises:
          InputError: A command that is not exactly one current, or a step before the first `reset`.
        """
        current = commanded_currents(command, 1, int(self._arrays.steps[0]))
        self.prepare_step()
        self.mj_data.ctrl[0] = current[0]
        self.mj_data.ctrl[1] = self._lateral_speed
        self._simulate()
        return self._measure()

    def _measure(self) -> RigMeasurement:
        self._sensors.refill()
        return self._measured(measure_rig_twin(self._arrays))

    @compiled_in("rig_twin")
    def truth(self) -> Array:
        """True values aligned with `RIG_TRUTH_NAMES`, shape (9,)."""
        row = np.empty(len(self.truth_names))
        write_rig_twin_truth(self._arrays, row)
        return row


class RobotTwin(_Twin):
    """Robot with rollers, suspension, motors and sensors in MuJoCo, a `Plant`.

    ```
    twin = RobotTwin(read_robot(), "pvc", seed=1)
    measurement = twin.reset()
    measurement = twin.step(CurrentCommand([0.0, -0.8, 0.0, 0.8]))      # one control period, 1 ms
    dict(zip(twin.truth_names, twin.truth()))                           # what no controller may see
    ```

    Accelerations, slip and forces refer to the start of the last simulation step, as MuJoCo computes them;
    positions and speeds refer to its end.
    """

    def __init__(
        self,
        robot: Robot,
        floor: Floor | str,
        faults: Sequence[Fault] = (),
        patches: Sequence[Patch] = (),
        seed: int = 0,
        start: tuple[float, float, float] = (0.0, 0.0, 0.0),
        ideal_sensors: bool = False,
        timestep: float | None = None,
        scene: Path | None = None,
        measured_current: bool = False,
        floors: Mapping[str, Floor] | None = None,
    ):
        """Build the twin.

        Args:
          robot: Constants of the robot, with effects.
          floor: Floor outside the patches, or its name.
          faults: Faults of the run, hidden from controllers.
          patches: Patches of other floors.
          seed: Seed of the sensor noise.
          start: x, y [m] and heading [rad] in the world.
          ideal_sensors: Whether sensors return true values, without noise, filters and quantisation.
          timestep: Step of the simulation [s]; one control period when None.
          scene: Another MJCF scene that includes the robot.
          measured_current: Whether commands are measured currents, exempt from limits and current loop.
          floors: Floors of patches and faults by name; the shipped ones when None.
        """
        install()
        effects = apply_effects(robot)
        robot = effects.machine
        self.period = 1.0 / robot.sensors.sample_rate
        self._wheels = len(robot.wheels)
        self.truth_names = robot_truth_names(self._wheels)
        floors = read_floors() if floors is None else floors
        self.mj_model = robot_model(
            robot,
            effects.floor(given_floor(floor, floors)),
            patches,
            fault_floors(faults),
            floors=effects.floors(floors),
            scene=scene,
            lean=True,
        )
        bind_effects(self.mj_model, effects.terms, measured_current)
        self._start_mujoco(timestep)
        self._start = start
        self._rest_height = robot.wheel.radius - rest_depth(robot)
        self._accelerometer = robot.accelerometer
        self._sensors = RobotSensors(
            robot.sensors,
            robot.motor,
            self._wheels,
            self.period,
            seed,
            faults,
            ideal_sensors,
            effects.channels,
        )
        nominal = NominalModel(self.mj_model, "chassis")
        self._schedule = ConditionSchedule(faults, effects, measured_current, nominal)
        # a larger wheel lifts its corner; the part that the suspension does not absorb lifts the robot
        larger, travel = robot.wheel.radius * (effects.radius_scale - 1.0), robot.body.suspension_travel
        self._guides = np.clip(larger, -_GUIDE_SHARE * travel, _GUIDE_SHARE * travel)
        self._rest_height += float(np.max(larger - self._guides, initial=0.0))
        self._find_places()

    def _find_places(self) -> None:
        """Find the views into MuJoCo's arrays once, so that a step needs no search."""
        self._guides_at = [
            int(self.mj_model.joint(f"guide_{i}").qposadr[0]) for i in range(1, self._wheels + 1)
        ]
        users = self.mj_model.actuator_user
        act, first = self.mj_data.act, int(users[0, slots.SENSOR])
        fields = len(slots.SENSOR_FIELDS)
        block = self.mj_data.sensordata[first : first + fields * self._wheels]
        self._arrays = TwinArrays(
            step=step_address(),
            model=self.mj_model._address,
            data=self.mj_data._address,
            substeps=self._substeps,
            period=self.period,
            ctrl=self.mj_data.ctrl,
            shorted=users[: self._wheels, slots.MOTOR + SHORTED],
            braked=np.zeros(self._wheels, np.uint8),
            currents=act[slots.CURRENT :: slots.ACTIVATIONS],
            backlash_rates=act[slots.BACKLASH_RATE :: slots.ACTIVATIONS],
            axles=users[: self._wheels, slots.WHEEL_DOF].astype(int),
            qpos=self.mj_data.qpos,
            qvel=self.mj_data.qvel,
            qacc=self.mj_data.qacc,
            gravity=self.mj_model.opt.gravity,
            axes=self.mj_data.xmat[self.mj_model.body("chassis").id].reshape(3, 3),
            gyro=self.mj_data.sensor("gyro").data,
            accelerometer=self._accelerometer,
            sensed=block.reshape(self._wheels, fields)[:, :3].T,
            turns=np.array([self._start[2], 0.0]),
            steps=np.array([-1]),
            values=self._sensors.values,
            sensors=self._sensors.chain,
        )

    def _change_conditions(self) -> None:
        super()._change_conditions()
        self._arrays.braked[:] = 0  # the schedule overwrites whole motors

    def reset(self, seed: int | None = None) -> Measurement:
        """Put the robot at rest at its start and return the measurement at time 0.

        Args:
          seed: Seed of the sensor noise from now on; when None, the noise of the last run is repeated.
        """
        mujoco.mj_resetData(self.mj_model, self.mj_data)
        self._schedule.start()
        x, y, heading = self._start
        half = 0.5 * heading
        self.mj_data.qpos[:7] = (x, y, self._rest_height, math.cos(half), 0.0, 0.0, math.sin(half))
        self.mj_data.qpos[self._guides_at] = self._guides
        self._restart(seed)
        self._arrays.turns[:], self._arrays.braked[:] = (heading, 0.0), 0
        return self._measure()

    @compiled_in("twin")
    def step(self, command: CurrentCommand) -> Measurement:
        """Hold the command for one control period and return the measurement at its end.

        Raises:
          InputError: Another number of currents than wheels, or a step before the first `reset`.
        """
        current = commanded_currents(command, self._wheels, int(self._arrays.steps[0]))
        self.prepare_step()
        if command.brake or self._arrays.braked.any():
            self._brake(command.brake)
        self.mj_data.ctrl[:] = current
        self._simulate()
        return self._measure()

    def _brake(self, wheels: tuple[int, ...]) -> None:
        mask = np.zeros(self._wheels, np.uint8)
        mask[[wheel - 1 for wheel in wheels]] = 1
        short_motors(self._arrays, mask)

    def _measure(self) -> Measurement:
        self._sensors.refill()
        return self._measured(measure_twin(self._arrays))

    @compiled_in("twin")
    def truth(self) -> Array:
        """True pose, twist, slip velocity, normal and traction force by `truth_names`, shape (6 + 3 n,)."""
        row = np.empty(len(self.truth_names))
        write_twin_truth(self._arrays, row)
        return row
