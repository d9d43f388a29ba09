"""The test rig's model as a plant that needs no MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.effects import Applied, applied
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Floor, Rig, read_floors
from omnimj.physics import rig
from omnimj.plant.conditions import Fault, conditions, event_times
from omnimj.plant.effects import lay_over
from omnimj.plant.ground import Ground
from omnimj.plant.interface import RIG_TRUTH_NAMES
from omnimj.plant.sensors import RigSensors
from omnimj.signals import Array, CurrentCommand, RigMeasurement

SUBSTEPS = 4
"""Steps of the model per control period: 0.25 ms, a twelfth of a wheel's time constant on the floor."""

RIG_FAULTS = ("motor", "free", "locked", "hard_over", "slip", "all_wheel_slip", "wheel_radius", "sensor")
"""Kinds of faults that the rig can have: it has one wheel on a straight rail."""

_LATE = 1e-9  # [s] a time summed up from steps may lie this much below the event it stands for


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
        effects = applied(constants)
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
        now = self._steps * self.period + _LATE
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
    effects: Applied,
    measured_current: bool,
) -> _Stage:
    now = lay_over(conditions(faults, begin, constants.motor, 1), effects, measured_current)
    row = rig.rig_row(constants, mass, float(now.radius_scale[0]), float(now.grip[0]), now.slope[0])
    has_own, own = ground.replaced(now.floors)
    return _Stage(begin, row, now.motor_rows[0], own[0] if has_own[0] else ground.rows[0])
