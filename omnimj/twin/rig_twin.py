"""The MuJoCo twin of the test rig as a plant."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from omnimj.effects import applied
from omnimj.parameters import Floor, Rig, read_floors
from omnimj.plant.conditions import Fault
from omnimj.plant.interface import RIG_TRUTH_NAMES
from omnimj.plant.patches import Patch
from omnimj.plant.sensors import RigSensors
from omnimj.signals import Array, CurrentCommand, RigMeasurement
from omnimj.twin import slots
from omnimj.twin.assembly import rig_model
from omnimj.twin.binding import bind_effects
from omnimj.twin.callback import install
from omnimj.twin.conditions_in_model import Healthy
from omnimj.twin.schedule import Schedule, floors_of

_SETTLING = 0.3  # [s] that the gantry moves sideways before a rig run begins


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
        measured_current: bool = False,
        floors: Mapping[str, Floor] | None = None,
    ):
        """Builds the twin.

        Args:
          rig: The constants, with effects.
          floor: What lies everywhere.
          mass: m_T [kg]; the rig's first mass when None.
          lateral_speed: Commanded speed of the gantry [m/s].
          faults: The truth that a diagnosis does not see.
          patches: Stretches of other floor.
          seed: Of the sensors' noise.
          ideal_sensors: Neither noise nor quantisation nor filters.
          timestep: Of the simulation [s]; one sample period when None.
          measured_current: Commands are currents that were measured: neither limits nor the current loop act.
          floors: Where patches and faults look up names; the shipped floors when None.
        """
        install()
        effects = applied(rig)
        rig = effects.machine
        mass = (rig.rig.masses[0] if mass is None else mass) + effects.added_mass
        self.period = 1.0 / rig.sensors.sample_rate
        floors = effects.floors(read_floors() if floors is None else floors)
        self.mj_model = rig_model(
            rig, effects.floor(floor), mass, floors_of(faults), patches, lean=True, floors=floors
        )
        bind_effects(self.mj_model, effects.terms, measured_current)
        self.mj_model.opt.timestep = self.period if timestep is None else timestep
        self._substeps = max(1, round(self.period / self.mj_model.opt.timestep))
        self.mj_data = mujoco.MjData(self.mj_model)
        self._lateral_speed = lateral_speed
        self._sensors = RigSensors(
            rig.sensors, rig.motor, self.period, seed, faults, ideal_sensors, effects.channels
        )
        # the payload is in the mass already
        without_load = dataclasses.replace(effects, payload=(0.0, 0.0, 0.0))
        healthy = Healthy(self.mj_model, "carriage")
        self._schedule = Schedule(faults, without_load, measured_current, healthy)
        m = self.mj_model
        self._rail, self._lift, self._tilt, self._gantry, self._axle = (
            int(m.joint(name).qposadr[0]) for name in ("rail", "lift", "tilt", "gantry", "wheel_1_axle")
        )
        self._felt = self.mj_data.sensor("wheel_1_contact").data
        self._steps = 0
        weight = -m.opt.gravity[2] * float(m.body_subtreemass[m.body("carriage").id])
        self._rest = rig.wheel.radius * (effects.radius_scale[0] - 1.0) - weight / rig.contact.stiffness

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
            float(speed[self._axle] + self.mj_data.act[slots.PLAY_RATE]),  # the encoder sits on the motor
            float(speed[self._rail]),
            float(self.mj_data.qacc[self._rail] - self.mj_model.opt.gravity[0]),
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
