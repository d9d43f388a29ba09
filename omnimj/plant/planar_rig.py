"""The model of the test rig behind its sensors, a plant without MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from omnimj.effects import apply_effects
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Floor, Rig, read_floors
from omnimj.physics import rig
from omnimj.physics.native import kernel
from omnimj.physics.wheel import packed, store
from omnimj.plant.faults import Conditions, Fault
from omnimj.plant.ground import Ground
from omnimj.plant.interface import RIG_TRUTH_NAMES, commanded_currents, given_floor
from omnimj.plant.planar import SUBSTEPS
from omnimj.plant.sensor_chain import SensorChain, read_sensors
from omnimj.plant.sensors import RigSensors
from omnimj.plant.stages import StagedPlant, timeline
from omnimj.signals import Array, CurrentCommand, RigMeasurement, compiled_in

RIG_FAULTS = ("motor", "free", "locked", "hard_over", "slip", "all_wheel_slip", "wheel_radius", "sensor")
"""Kinds of faults that apply to the rig, which has one wheel on a straight rail."""


@dataclass(frozen=True)
class _RigStage:
    """Packed rig and floor while the conditions stay constant."""

    begin: float
    """Time of the beginning [s]."""
    machine: tuple[Array, Array, Array, Array]
    """Packed rig, motor, floor and effect terms."""


class PlanarRigArrays(NamedTuple):
    """Arrays of a rig, its sensors and the periods so far."""

    state: Array
    """Packed `rig.RigState`, shape (STATE,)."""
    output: Array
    """Packed `rig.RigOutput`, shape (OUTPUT,)."""
    machine: tuple[Array, Array, Array, Array]
    """Packed rig, motor, floor and effect terms."""
    lateral_speed: float
    """Lateral speed of the gantry [m/s]."""
    published: bool
    """True for the equations as printed."""
    period: float
    """Control period [s]."""
    steps: Array
    """Control periods since the start, shape (1,), integer."""
    values: Array
    """Physical quantities for the sensors, shape (5,)."""
    sensors: SensorChain


@kernel
def advance_planar_rig(plant, state, current, steps):
    """Advance a state, in place, under a set current; fills `output`.

    Args:
      plant: `PlanarRigArrays`.
      state: Packed `rig.RigState`; usually the plant's own.
      current: Set current [A].
      steps: Number of integration steps.
    """
    model, h = rig.rig_model_at(plant.machine, plant.published), plant.period / SUBSTEPS
    after, found = rig.step(rig.rig_state_at(state), current, plant.lateral_speed, model, h, steps)
    store(after, state)
    store(found, plant.output)


@kernel
def measure_planar_rig(plant):
    """Readings of all sensors now, a new array in the order of `RIG_CHANNELS`."""
    state, output, values = rig.rig_state_at(plant.state), rig.rig_output_at(plant.output), plant.values
    values[0], values[1], values[2] = state.current, output.encoder_speed, state.speed
    values[3], values[4] = output.acceleration, plant.lateral_speed
    return read_sensors(plant.sensors, plant.steps[0] * plant.period, values)


@kernel
def step_planar_rig(plant, current):
    """Hold a set current [A] for one control period and return the readings at its end."""
    advance_planar_rig(plant, plant.state, current, SUBSTEPS)
    plant.steps[0] += 1
    return measure_planar_rig(plant)


@kernel
def write_planar_rig_truth(plant, truth):
    """Write the true values in the order of `RIG_TRUTH_NAMES`.

    Positions count from the start, and the body does not tilt. The lateral force is that on the wheel, along
    the direction of the gantry: −G of Eq. 4.18.
    """
    state, output = rig.rig_state_at(plant.state), rig.rig_output_at(plant.output)
    truth[0], truth[1], truth[2] = state.position, state.speed, state.wheel_speed
    truth[3], truth[4] = plant.lateral_speed * plant.steps[0] * plant.period, 0.0
    truth[5], truth[6], truth[7], truth[8] = output.slip, output.normal, output.traction, -output.lateral


class PlanarRig(StagedPlant):
    """Model of the rig as a `Plant`; the rail has no ends, the gantry has its commanded speed at once."""

    truth_names = RIG_TRUTH_NAMES

    def __init__(
        self,
        constants: Rig,
        floor: Floor | str,
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
        """Place the rig at rest at the start of the rail.

        Args:
          constants: Constants of the rig, with its effects.
          floor: The floor, or its name.
          mass: Mass m_T of the quarter body [kg]; the first of the rig's masses when None.
          lateral_speed: Lateral speed of the gantry [m/s].
          faults: Faults of the run.
          seed: Seed of the sensor noise.
          published: Whether to use the equations as printed instead of the corrected ones.
          ideal_sensors: Whether sensors return true values, without noise, filters and quantisation.
          floors: Floors by name; the shipped ones when None.
          measured_current: Whether commands are measured currents, exempt from limits and current loop.

        Raises:
          UnknownNameError: A floor that does not exist, or a fault that does not apply to the rig.
          InputError: A mass that is not positive, a lateral speed that is not finite, or an invalid effect.
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
        floors = read_floors() if floors is None else floors
        hall = given_floor(floor, floors)
        self._ground = Ground(hall.name, (), effects.floors({**floors, hall.name: hall}))
        self.effect_terms: Array = effects.terms[0]
        """Packed effect terms of the wheel, which every step reads, shape (TERMS,)."""
        self._stages = [
            self._stage(constants, mass, self.effect_terms, begin, now)
            for begin, now in timeline(constants, faults, effects, measured_current)
        ]
        self._sensors = RigSensors(
            constants.sensors, constants.motor, self.period, seed, faults, ideal_sensors, effects.channels
        )
        self._state, self._output = np.zeros(rig.STATE), np.zeros(rig.OUTPUT)
        self._steps, self._at = np.array([-1]), 0
        self._enter(0)

    def _stage(self, constants: Rig, mass: float, terms: Array, begin: float, now: Conditions) -> _RigStage:
        scale, grip = float(now.radius_scale[0]), float(now.grip[0])
        own = packed(rig.rig_parameters(constants, mass, scale, grip, now.slope[0]))
        replaced, replacements = self._ground.replacements(now.floors)
        floor = replacements[0] if replaced[0] else self._ground.rows[0]
        return _RigStage(begin, (own, now.motor_rows[0], floor, terms))

    def reset(self, seed: int | None = None) -> RigMeasurement:
        """Put the rig at rest at the start of the rail, with the gantry moving.

        Args:
          seed: Seed of the sensor noise from now on; when None, the noise of the last run is repeated.
        """
        self._steps[0] = 0
        self._state[:] = 0.0
        self._sensors.reset(seed)
        self._enter(0)
        self.prepare_step()
        # forces at rest, for truth and accelerometer
        advance_planar_rig(self._arrays, self._state.copy(), 0.0, 1)
        return self._measured(measure_planar_rig(self._arrays))

    def set_speeds(self, carriage_speed: float, wheel_speed: float) -> None:
        """Set the speeds of carriage [m/s] and wheel [rad/s], for a run that begins in motion."""
        state = rig.RigState(*self._state.tolist())
        self._state[:] = state._replace(speed=carriage_speed, wheel_speed=wheel_speed)

    @compiled_in("planar_rig")
    def step(self, command: CurrentCommand) -> RigMeasurement:
        """Hold the command for one period and return the measurement at its end.

        Raises:
          InputError: A command that is not exactly one current, or a step before the first `reset`.
        """
        current = commanded_currents(command, 1, int(self._steps[0]))
        self.prepare_step()
        return self._measured(step_planar_rig(self._arrays, float(current[0])))

    @compiled_in("planar_rig")
    def truth(self) -> Array:
        """True values by `truth_names`, shape (len(truth_names),).

        Positions count from the start, and the body does not tilt.
        """
        row = np.empty(len(self.truth_names))
        write_planar_rig_truth(self._arrays, row)
        return row

    def _enter(self, stage: int) -> None:
        self._at = stage
        self._arrays = PlanarRigArrays(
            self._state,
            self._output,
            self._stages[stage].machine,
            self._lateral_speed,
            self._published,
            self.period,
            self._steps,
            self._sensors.values,
            self._sensors.chain,
        )
