"""The linear axis as a plant: equations, amplifier, encoder, tachometer and force monitor.

`AxisPlant` goes one period at a time under any controller; `drive_axis` makes a whole run under the
controller of an ordinary servo drive in one native call. Both share the same kernels and the same noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omnimj.effects import applied
from omnimj.errors import InputError
from omnimj.parameters.axis import Axis
from omnimj.physics.axis import (
    POSITION,
    SPEED,
    axis_row,
    encoder_position,
    encoder_speed,
    frozen,
    no_curve,
)
from omnimj.plant.axis_kernels import (
    COLUMNS,
    READ_FORCE,
    READ_POSITION,
    READ_VELOCITY,
    SENSOR_ROW,
    TRUE_COLUMNS,
    TRUE_POSITION,
    TRUE_SPEED,
    at_rest,
    follow_target,
    one_period,
    read_sensors,
)
from omnimj.signals import Array

SUBSTEPS = 2
"""Steps of the equations per period of 1 ms; a longer period gets more."""


_FAR = 1e3  # travels: nothing that is held gets there


@dataclass(frozen=True)
class AxisMeasurement:
    """What the axis' sensors say at one instant."""

    time: float
    """[s]"""
    force: float
    """Force monitor [N]."""
    position: float
    """Encoder [m]."""
    velocity: float
    """Tachometer [m/s]."""


@dataclass(frozen=True)
class AxisController:
    """Position control of a servo drive: F = m̂ a_d + b̂ v_d + Ĉ tanh(v_d/v_0) + k e + d ė, ė low-passed."""

    stiffness: float
    """k [N/m]."""
    damping: float
    """d [N.s/m]."""
    mass: float
    """m̂ [kg]."""
    viscous: float = 0.0
    """b̂ [N.s/m]."""
    coulomb: float = 0.0
    """Ĉ [N]."""
    smoothing: float = 0.01
    """v_0 [m/s]."""
    speed_filter: float = 0.005
    """Time constant of the measured speed [s]."""

    @property
    def row(self) -> Array:
        """Its numbers for the kernel."""
        numbers = (self.stiffness, self.damping, self.mass, self.viscous, self.coulomb)
        return np.array((*numbers, self.smoothing, self.speed_filter))


def servo(axis: Axis, bandwidth: float = 40.0, feed_friction: bool = True) -> AxisController:
    """A well-damped controller for the axis as declared.

    Args:
      axis: Its own constants, without effects, are what the controller knows.
      bandwidth: ω of m ω² and 2 m ω [rad/s].
      feed_friction: Whether declared friction is fed forward.
    """
    body, share = axis.axis, 1.0 if feed_friction else 0.0
    gains = (body.mass * bandwidth**2, 2.0 * body.mass * bandwidth, body.mass)
    return AxisController(*gains, share * body.viscous, share * body.coulomb)


def sensor_row(axis: Axis, ideal: bool = False) -> Array:
    """Noise and steps of the sensors for the kernel."""
    s = axis.sensors
    steps = (s.position_noise, s.position_resolution, s.velocity_noise, s.force_noise, s.force_resolution)
    return np.zeros(SENSOR_ROW) if ideal else np.array(steps)


def axis_noise(seed: int, samples: int) -> Array:
    """Standard normal numbers of the channels force, position, velocity, shape (3, samples)."""
    return np.stack([np.random.default_rng([seed, c]).standard_normal(samples) for c in range(3)])


def substeps_of(period: float) -> int:
    """Steps of the equations in one period."""
    return SUBSTEPS * max(1, math.ceil(period / 1e-3 - 1e-9))


def drive_axis(
    axis: Axis,
    target: Array,
    controller: AxisController,
    *,
    payload: float = 0.0,
    seed: int = 0,
    ideal_sensors: bool = False,
) -> dict[str, Array]:
    """A run along a target under position control.

    Args:
      axis: With its effects.
      target: Position, speed, acceleration at every sample, shape (n, 3) [m, m/s, m/s²].
      controller: Of the drive.
      payload: Mass that the run adds [kg].
      seed: Of the sensors' noise.
      ideal_sensors: Without noise and steps; scales and delays that effects bring still act.

    Returns:
      Columns `time`, `force`, `position`, `velocity` as read, and `true_position`, `true_velocity` of what
      the encoder sits on, shape (n,).

    Raises:
      InputError: The axis left the numbers it can stand for (a controller that is not stable).
    """
    period = 1.0 / axis.sensors.sample_rate
    row = axis_row(applied(axis).machine, payload)
    columns = np.empty((len(target), COLUMNS))
    numbers = (controller.row, sensor_row(axis, ideal_sensors), axis_noise(seed, len(target)))
    follow_target(row, no_curve(), np.asarray(target, float), *numbers, period, substeps_of(period), columns)
    if not (np.abs(columns[:, TRUE_POSITION]) < _FAR * axis.axis.travel).all():
        raise InputError("controller", "does not hold this axis", "softer gains are needed")
    found: dict[str, Array] = {"time": np.arange(float(len(target))) * period}
    names = {"force": READ_FORCE, "position": READ_POSITION, "velocity": READ_VELOCITY}
    names |= {"true_position": TRUE_POSITION, "true_velocity": TRUE_SPEED}
    return found | {name: columns[:, c].copy() for name, c in names.items()}


class AxisPlant:
    """The axis one period at a time."""

    def __init__(
        self,
        axis: Axis,
        *,
        payload: float = 0.0,
        start: float = 0.0,
        seed: int = 0,
        ideal_sensors: bool = False,
    ):
        """The axis at rest.

        Args:
          axis: With its effects.
          payload: Mass that the run adds [kg].
          start: Position [m].
          seed: Of the sensors' noise.
          ideal_sensors: Without noise and steps.
        """
        self.period = 1.0 / axis.sensors.sample_rate
        self._row, self._curve = frozen(axis_row(applied(axis).machine, payload), no_curve())
        self._sensors = sensor_row(axis, ideal_sensors)
        self._start, self._seed = float(start), seed
        self._state, self._force = at_rest(self._row, self._start), 0.0
        self._generators: list[np.random.Generator] = []
        self._truth = np.zeros((1024, TRUE_COLUMNS))
        self._steps = 0

    def reset(self) -> AxisMeasurement:
        """At rest at the start; the same noise comes again."""
        self._steps, self._force = 0, 0.0
        self._generators = [np.random.default_rng([self._seed, c]) for c in range(3)]
        self._state = at_rest(self._row, self._start)
        return self._measure()

    def step(self, force: float) -> AxisMeasurement:
        """Holds the commanded force [N] for one period and returns the measurement at its end.

        Raises:
          InputError: A force that is not finite.
        """
        if not math.isfinite(force):
            raise InputError("command", f"found {force!r}", "must be a finite number")
        time = self._steps * self.period
        numbers = (self._row, self._curve, self._state, self._force, float(force), time)
        self._state, self._force = one_period(*numbers, self.period, substeps_of(self.period))
        self._steps += 1
        return self._measure()

    def truth(self) -> Array:
        """Declared force of the drive, position and speed of the carriage [N, m, m/s]."""
        return np.array((self._force, self._state[POSITION], self._state[SPEED]))

    def close(self) -> None:
        """Nothing to let go of."""

    def _measure(self) -> AxisMeasurement:
        k = self._steps
        if k >= len(self._truth):
            self._truth = np.concatenate([self._truth, np.zeros_like(self._truth)])
        truth = (self._force, encoder_position(self._row, self._state), encoder_speed(self._row, self._state))
        self._truth[k] = truth
        noise, reading = np.array([[g.standard_normal()] for g in self._generators]), np.empty(3)
        read_sensors(self._row, self._sensors, self._truth, k, noise, 0, self.period, reading)
        return AxisMeasurement(k * self.period, *reading.tolist())
