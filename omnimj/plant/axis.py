"""Runs of the linear axis under position control: amplifier, sensors, controller."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omnimj.effects import ChannelEffect, collect_changes
from omnimj.effects.axis import CARRIAGE, CHANNELS, DRIVE, GUIDE
from omnimj.effects.parts import ACTUATOR, BODY, JOINT
from omnimj.errors import InputError
from omnimj.parameters.axis import Axis
from omnimj.physics import axis as row_of
from omnimj.physics.axis import (
    AXIS_ROW,
    COULOMB,
    DRIVE_MASS,
    ENCODER,
    FORCE_DELAY,
    FORCE_SCALE,
    LIMIT,
    LOOP,
    MASS,
    MONITOR_BIAS,
    MONITOR_SCALE,
    PLAY,
    POSITION_DELAY,
    POSITION_SCALE,
    VELOCITY_DELAY,
    VELOCITY_SCALE,
    VISCOUS,
    encoder_position,
    encoder_speed,
    frozen,
    step,
)
from omnimj.physics.native import kernel
from omnimj.physics.planar import GRAVITY
from omnimj.signals import Array

POSITION_NOISE, POSITION_STEP, VELOCITY_NOISE, FORCE_NOISE, FORCE_STEP = range(5)
SENSOR_ROW = 5
"""Length of the sensors' packed constants, indexed by the names above."""

STIFFNESS, GAIN, FEED_MASS, FEED_VISCOUS, FEED_COULOMB, FEED_SPEED, SPEED_FILTER = range(7)
"""Indices of the controller's packed constants (`AxisController.row`)."""

READ_FORCE, READ_POSITION, READ_VELOCITY, TRUE_FORCE, TRUE_POSITION, TRUE_SPEED = range(6)
COLUMNS = 6
"""Number of columns of a run, indexed by the names above."""

TRUE_COLUMNS = 3
"""Number of true columns: declared drive force, position and speed at the encoder."""


@kernel
def _stepped(value, size):
    return np.rint(value / size) * size if size > 0.0 else value


@kernel
def _late(truth, column, k, delay, period):
    """True value `delay` [s] before sample k, interpolated; the first value for times before the run."""
    place = min(max(k - delay / period, 0.0), float(k))
    below = min(int(place), max(k - 1, 0))
    share = place - below
    if share == 0.0:
        return truth[below, column]
    return (1.0 - share) * truth[below, column] + share * truth[below + 1, column]


@kernel
def read_sensors(row, sensors, truth, k, noise, period, reading):
    """Read force monitor, encoder and tachometer at sample k.

    Args:
      row: Packed constants of the axis with effects, from `axis_row`.
      sensors: Packed constants of the sensors, from `sensor_row`.
      truth: Declared force [N], position [m] and speed [m/s] at the encoder up to sample k at least, shape
        (any, TRUE_COLUMNS).
      k: Index of the sample.
      noise: Standard normal numbers, shape (3, n).
      period: Sample period [s].
      reading: Array to fill with force [N], position [m] and velocity [m/s], shape (3,).
    """
    force = row[MONITOR_SCALE] * _late(truth, 0, k, row[FORCE_DELAY], period) + row[MONITOR_BIAS]
    position = row[POSITION_SCALE] * _late(truth, 1, k, row[POSITION_DELAY], period)
    velocity = row[VELOCITY_SCALE] * _late(truth, 2, k, row[VELOCITY_DELAY], period)
    reading[0] = _stepped(force + sensors[FORCE_NOISE] * noise[0, k], sensors[FORCE_STEP])
    reading[1] = _stepped(position + sensors[POSITION_NOISE] * noise[1, k], sensors[POSITION_STEP])
    reading[2] = velocity + sensors[VELOCITY_NOISE] * noise[2, k]


@kernel
def one_period(row, state, force, command, period, substeps):
    """Advance the axis by one period under a commanded force, behind which the amplifier lags.

    Args:
      row: Packed constants of the axis, from `frozen`.
      state: State of the axis.
      force: Declared force of the drive at the beginning [N].
      command: Commanded force, held for the period [N].
      period: Duration [s].
      substeps: Number of integration steps.

    Returns:
      State, and declared force of the drive [N], at the end of the period.
    """
    h = period / substeps
    target = min(max(command, -row[LIMIT]), row[LIMIT])
    keep = math.exp(-h / row[LOOP]) if row[LOOP] > 0.0 else 0.0
    for _ in range(substeps):
        after = target + (force - target) * keep
        mean = target + (force - after) * row[LOOP] / h
        state = step(row, state, mean, h)
        force = after
    return state, force


@kernel
def at_rest(row, position):
    """State at rest with the encoder at a position [m] and the drive in contact on its forward side."""
    gap = 0.5 * row[PLAY]
    return position - (gap if row[ENCODER] == 1.0 else 0.0), 0.0, gap, 0.0, 0.0


@kernel
def follow_target(row, target, gains, sensors, noise, period, substeps, columns):
    """Simulate one run under position control.

    Args:
      row: Packed constants of the axis with effects, from `axis_row`.
      target: Position [m], speed [m/s], acceleration [m/s²] at every sample, shape (n, 3).
      gains: Packed constants of the controller, `AxisController.row`.
      sensors: Packed constants of the sensors, from `sensor_row`.
      noise: Standard normal numbers, shape (3, n).
      period: Period of controller and log [s].
      substeps: Number of integration steps per period.
      columns: Array to fill with measured force [N], position [m] and velocity [m/s], then the true ones,
        shape (n, COLUMNS).
    """
    reading = np.zeros(3)
    numbers = frozen(row)
    state = at_rest(numbers, target[0, 0] / row[POSITION_SCALE])
    truth = columns[:, READ_VELOCITY + 1 :]
    share = 1.0 - math.exp(-period / gains[SPEED_FILTER]) if gains[SPEED_FILTER] > 0.0 else 1.0
    force, speed, last = 0.0, 0.0, target[0, 0]
    for k in range(len(target)):
        truth[k, 0], truth[k, 1] = force, encoder_position(numbers, state)
        truth[k, 2] = encoder_speed(numbers, state)
        read_sensors(numbers, sensors, truth, k, noise, period, reading)
        columns[k, :3] = reading
        if k > 0:
            speed += share * ((reading[1] - last) / period - speed)
        last = reading[1]
        v = target[k, 1]
        command = gains[FEED_MASS] * target[k, 2] + gains[FEED_VISCOUS] * v
        command += gains[FEED_COULOMB] * math.tanh(v / gains[FEED_SPEED])
        command += gains[STIFFNESS] * (target[k, 0] - last) + gains[GAIN] * (v - speed)
        state, force = one_period(numbers, state, force, command, period, substeps)


# Plant and controller around the kernels above.

SUBSTEPS = 2
"""Number of integration steps per 1 ms of a period."""


_TERMS = {
    "asymmetric_coulomb": row_of.ASYMMETRIC_COULOMB,
    "asymmetric_viscous": row_of.ASYMMETRIC_VISCOUS,
    "stribeck_force": row_of.STRIBECK_FORCE,
    "stribeck_velocity": row_of.STRIBECK_VELOCITY,
    "place_force": row_of.PLACE_FORCE,
    "place_position": row_of.PLACE,
    "place_width": row_of.PLACE_WIDTH,
    "offset": row_of.OFFSET,
    "spring": row_of.CABLE_STIFFNESS,
    "spring_rest": row_of.CABLE_REST,
    "drag": row_of.AIR,
    "play": PLAY,
}
_LEAST_MASS = 0.1  # of the declared one, whatever an effect takes off


def axis_row(axis: Axis, payload: float = 0.0) -> Array:
    """Constants of an axis with its effects in the order of the kernels, shape (AXIS_ROW,).

    Args:
      axis: The axis.
      payload: Additional mass during a run [kg].
    """
    row, body, changes = np.zeros(AXIS_ROW), axis.axis, collect_changes(axis)
    added = changes.added.get
    row[MASS] = max(body.mass + added((BODY, CARRIAGE, "mass"), 0.0), _LEAST_MASS * body.mass) + payload
    row[DRIVE_MASS] = min(body.drive_mass, 0.9 * row[MASS])
    row[COULOMB] = max(body.coulomb + added((JOINT, GUIDE, "frictionloss"), 0.0), 0.0)
    row[VISCOUS] = max(body.viscous + added((JOINT, GUIDE, "damping"), 0.0), 0.0)
    row[LIMIT], row[LOOP], row[ENCODER] = body.force_limit, body.force_loop, axis.sensors.encoder_at_drive
    for name, column in _TERMS.items():
        row[column] = changes.terms.get((JOINT, GUIDE, name), 0.0)
    row[row_of.OFFSET] -= (row[MASS] - body.drive_mass) * GRAVITY * math.sin(changes.tilt.get("y", 0.0))
    row[FORCE_SCALE] = changes.scales.get((ACTUATOR, DRIVE, "gain"), 1.0)
    force, position, velocity = (
        changes.channels.get(CHANNELS[name], ChannelEffect()) for name in ("force", "position", "velocity")
    )
    row[[MONITOR_SCALE, MONITOR_BIAS, FORCE_DELAY]] = force
    row[[POSITION_SCALE, POSITION_DELAY]] = position.scale, position.delay
    row[[VELOCITY_SCALE, VELOCITY_DELAY]] = velocity.scale, velocity.delay
    return row


_FAR = 1e3  # travels: nothing that is held gets there


@dataclass(frozen=True)
class AxisController:
    """Position control of a servo drive: F = m̂ a_d + b̂ v_d + Ĉ tanh(v_d/v_0) + k e + d ė, ė low-passed."""

    stiffness: float
    """Position gain k [N/m]."""
    damping: float
    """Speed gain d [N.s/m]."""
    mass: float
    """Mass m̂ for the acceleration feedforward [kg]."""
    viscous: float = 0.0
    """Coefficient b̂ of the viscous feedforward [N.s/m]."""
    coulomb: float = 0.0
    """Force Ĉ of the Coulomb feedforward [N]."""
    smoothing: float = 0.01
    """Speed v_0 over which the Coulomb feedforward changes sign [m/s]."""
    speed_filter: float = 0.005
    """Time constant of the low-pass filter on the measured speed [s]."""

    @property
    def row(self) -> Array:
        """Packed constants for the kernels, shape (7,)."""
        numbers = (self.stiffness, self.damping, self.mass, self.viscous, self.coulomb)
        return np.array((*numbers, self.smoothing, self.speed_filter))


def servo(axis: Axis, bandwidth: float = 40.0, feed_friction: bool = True) -> AxisController:
    """Critically damped controller for the nominal axis: k = m ω², d = 2 m ω.

    Args:
      axis: Axis whose constants are used, without its effects.
      bandwidth: ω [rad/s].
      feed_friction: Whether the nominal friction is fed forward.
    """
    body, share = axis.axis, 1.0 if feed_friction else 0.0
    gains = (body.mass * bandwidth**2, 2.0 * body.mass * bandwidth, body.mass)
    return AxisController(*gains, share * body.viscous, share * body.coulomb)


def sensor_row(axis: Axis, ideal: bool = False) -> Array:
    """Packed noise and resolution of the sensors, shape (SENSOR_ROW,); all zero for ideal sensors."""
    s = axis.sensors
    steps = (s.position_noise, s.position_resolution, s.velocity_noise, s.force_noise, s.force_resolution)
    return np.zeros(SENSOR_ROW) if ideal else np.array(steps)


def axis_noise(seed: int, samples: int) -> Array:
    """Standard normal numbers for force, position and velocity, shape (3, samples)."""
    return np.stack([np.random.default_rng([seed, c]).standard_normal(samples) for c in range(3)])


def substeps_of(period: float) -> int:
    """Number of integration steps in one period [s]."""
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
    """Simulate a run along a target under position control.

    Args:
      axis: Axis, with its effects.
      target: Position, speed, acceleration at every sample, shape (n, 3) [m, m/s, m/s²].
      controller: Position control of the drive.
      payload: Mass added in this run [kg].
      seed: Seed of the sensor noise.
      ideal_sensors: Whether to omit noise and resolution; scales and delays due to effects still act.

    Returns:
      Columns of shape (n,): `time` [s], the measured `force` [N], `position` [m] and `velocity` [m/s], and
      `true_position`, `true_velocity` at the encoder.

    Raises:
      InputError: The motion diverges, since the controller does not stabilize the axis.
    """
    period = 1.0 / axis.sensors.sample_rate
    row = axis_row(axis, payload)
    columns = np.empty((len(target), COLUMNS))
    numbers = (controller.row, sensor_row(axis, ideal_sensors), axis_noise(seed, len(target)))
    follow_target(row, np.asarray(target, float), *numbers, period, substeps_of(period), columns)
    if not (np.abs(columns[:, TRUE_POSITION]) < _FAR * axis.axis.travel).all():
        raise InputError("controller", "does not hold this axis", "softer gains are needed")
    found: dict[str, Array] = {"time": np.arange(float(len(target))) * period}
    names = {"force": READ_FORCE, "position": READ_POSITION, "velocity": READ_VELOCITY}
    names |= {"true_position": TRUE_POSITION, "true_velocity": TRUE_SPEED}
    return found | {name: columns[:, c].copy() for name, c in names.items()}
