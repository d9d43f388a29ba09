"""Kernels of the linear axis as a plant: amplifier, sensors, a run under position control."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omnimj.effects import apply_effects
from omnimj.errors import InputError
from omnimj.parameters.axis import Axis
from omnimj.physics.axis import (
    ENCODER,
    FORCE_DELAY,
    LIMIT,
    LOOP,
    MONITOR_BIAS,
    MONITOR_SCALE,
    PLAY,
    POSITION,
    POSITION_DELAY,
    POSITION_SCALE,
    SPEED,
    VELOCITY_DELAY,
    VELOCITY_SCALE,
    axis_row,
    encoder_position,
    encoder_speed,
    frozen,
    no_curve,
    step,
)
from omnimj.physics.native import kernel
from omnimj.signals import Array

POSITION_NOISE, POSITION_STEP, VELOCITY_NOISE, FORCE_NOISE, FORCE_STEP = range(5)
SENSOR_ROW = 5
"""Numbers of the sensors."""

STIFFNESS, GAIN, FEED_MASS, FEED_VISCOUS, FEED_COULOMB, FEED_SPEED, SPEED_FILTER = range(7)
"""Numbers of the controller."""

READ_FORCE, READ_POSITION, READ_VELOCITY, TRUE_FORCE, TRUE_POSITION, TRUE_SPEED = range(6)
COLUMNS = 6
"""Columns of a run."""

TRUE_COLUMNS = 3
"""Declared force of the drive, position and speed of what the encoder sits on."""


@kernel
def _stepped(value, size):
    return np.rint(value / size) * size if size > 0.0 else value


@kernel
def _late(truth, column, k, delay, period):
    """A true value as it was `delay` before sample k; before the run it was as at its start."""
    place = min(max(k - delay / period, 0.0), float(k))
    below = min(int(place), max(k - 1, 0))
    share = place - below
    if share == 0.0:
        return truth[below, column]
    return (1.0 - share) * truth[below, column] + share * truth[below + 1, column]


@kernel
def read_sensors(row, sensors, truth, k, noise, column, period, reading):
    """Read force monitor, encoder and tachometer at sample k.

    Args:
      row: `axis_row`, with effects.
      sensors: `sensor_row`.
      truth: Declared force, encoder's position and speed so far, shape (more than k, TRUE_COLUMNS).
      k: Sample.
      noise: Standard normal numbers, shape (3, any).
      column: The column of `noise` to use.
      period: [s]
      reading: Filled: force, position, velocity, shape (3,).
    """
    force = row[MONITOR_SCALE] * _late(truth, 0, k, row[FORCE_DELAY], period) + row[MONITOR_BIAS]
    position = row[POSITION_SCALE] * _late(truth, 1, k, row[POSITION_DELAY], period)
    velocity = row[VELOCITY_SCALE] * _late(truth, 2, k, row[VELOCITY_DELAY], period)
    reading[0] = _stepped(force + sensors[FORCE_NOISE] * noise[0, column], sensors[FORCE_STEP])
    reading[1] = _stepped(position + sensors[POSITION_NOISE] * noise[1, column], sensors[POSITION_STEP])
    reading[2] = velocity + sensors[VELOCITY_NOISE] * noise[2, column]


@kernel
def one_period(row, curve, state, force, command, time, period, substeps):
    """State and the drive's declared force [N] a period later; the amplifier lags behind the command."""
    h = period / substeps
    target = min(max(command, -row[LIMIT]), row[LIMIT])
    keep = math.exp(-h / row[LOOP]) if row[LOOP] > 0.0 else 0.0
    for s in range(substeps):
        after = target + (force - target) * keep
        mean = target + (force - after) * row[LOOP] / h
        state = step(row, curve, state, mean, 0.0, time + s * h, h)
        force = after
    return state, force


@kernel
def at_rest(row, position):
    """State at rest with the encoder at this position, drive pressing forward."""
    gap = 0.5 * row[PLAY]
    return position - (gap if row[ENCODER] == 1.0 else 0.0), 0.0, gap, 0.0, 0.0


@kernel
def follow_target(row, curve, target, gains, sensors, noise, period, substeps, columns):
    """One run under position control.

    Args:
      row: `axis_row`, with effects.
      curve: A free curve.
      target: Position, speed, acceleration at every sample, shape (n, 3).
      gains: `AxisController.row`.
      sensors: `sensor_row`.
      noise: Standard normal numbers, shape (3, n).
      period: Of controller and log [s].
      substeps: Steps of the equations per period.
      columns: Filled: force, position, velocity as read; the same as they are, shape (n, 6).
    """
    reading = np.zeros(3)
    numbers, table = frozen(row, curve)
    state = at_rest(numbers, target[0, 0] / row[POSITION_SCALE])
    truth = columns[:, READ_VELOCITY + 1 :]
    share = 1.0 - math.exp(-period / gains[SPEED_FILTER]) if gains[SPEED_FILTER] > 0.0 else 1.0
    force, speed, last = 0.0, 0.0, target[0, 0]
    for k in range(len(target)):
        truth[k, 0], truth[k, 1] = force, encoder_position(numbers, state)
        truth[k, 2] = encoder_speed(numbers, state)
        read_sensors(numbers, sensors, truth, k, noise, k, period, reading)
        columns[k, :3] = reading
        if k > 0:
            speed += share * ((reading[1] - last) / period - speed)
        last = reading[1]
        v = target[k, 1]
        command = gains[FEED_MASS] * target[k, 2] + gains[FEED_VISCOUS] * v
        command += gains[FEED_COULOMB] * math.tanh(v / gains[FEED_SPEED])
        command += gains[STIFFNESS] * (target[k, 0] - last) + gains[GAIN] * (v - speed)
        state, force = one_period(numbers, table, state, force, command, k * period, period, substeps)


# The linear axis as a plant: equations, amplifier, encoder, tachometer and force monitor.

SUBSTEPS = 2
"""Steps of the equations per period of 1 ms; a longer period gets more."""


_FAR = 1e3  # travels: nothing that is held gets there


@dataclass(frozen=True)
class AxisMeasurement:
    """Readings of the axis' sensors at one instant."""

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
    row = axis_row(apply_effects(axis).machine, payload)
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
        self._row, self._curve = frozen(axis_row(apply_effects(axis).machine, payload), no_curve())
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
