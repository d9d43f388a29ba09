"""Force residuals of the published method from a trace's columns, written afresh in numpy.

Eqs. 4.26, 5.4-5.7 and 5.14-5.20 with the signs repaired; only the constants come from the package.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from omnimj.parameters import Rig, Robot
from omnimj.signals import Array, Trace

GRAVITY = 9.81
RESTING = 0.2  # [rad/s] below it friction may be anything
LAG = 0.015  # [s] of the residuals' filter


def late(values: Array, period: float, lag: float) -> Array:
    """First-order lag along the first axis, settled at the first value."""
    keep = np.exp(-period / lag)
    start = keep * values[:1]
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], values, axis=0, zi=start)[0])


def running_rms(values: Array, period: float) -> Array:
    """RMS since the start; the first sample lasts no time."""
    squares = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values[1:] ** 2, axis=0)])
    spans = np.maximum(np.arange(len(values)), 1)
    return np.sqrt(squares / spans.reshape(-1, *([1] * (values.ndim - 1))))


def filtered(raw: Array, period: float) -> Array:
    """Residuals behind their filter, which starts at zero with the second sample."""
    keep = np.exp(-period / LAG)
    raw = np.concatenate([np.zeros_like(raw[:1]), raw[1:]])
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], raw, axis=0))


def torque(machine: Robot | Rig, current: Array, wheel_speed: Array, load: Array, turning: float) -> Array:
    """Torque at the wheel with the friction of one direction of turning [N.m]."""
    motor, bearing = machine.motor, machine.bearing
    shaft = motor.torque_constant * current - motor.viscous * motor.gear_ratio * wheel_speed
    shaft = shaft - turning * motor.no_load_torque
    drives = shaft * turning >= 0.0
    efficiency = np.where(drives, motor.gear_efficiency, 1.0 / motor.gear_efficiency)
    friction = load * 0.5 * bearing.pitch_diameter
    return shaft * motor.gear_ratio * efficiency - friction * (
        turning * bearing.dry + bearing.viscous * wheel_speed
    )


def joint_forces(machine: Robot | Rig, current: Array, wheel_speed: Array, load: Array, period: float):
    """Lowest and highest traction that the joint side allows [N]: one number unless the wheel rests."""
    motor = machine.motor
    inertia = machine.wheel.inertia + motor.rotor_inertia * motor.gear_efficiency * motor.gear_ratio**2
    change = np.concatenate([np.zeros_like(wheel_speed[:1]), np.diff(wheel_speed, axis=0)]) / period
    forward, backward = (torque(machine, current, wheel_speed, load, s) for s in (1.0, -1.0))
    low = np.where(wheel_speed < -RESTING, backward, forward) - inertia * change
    high = np.where(wheel_speed > RESTING, forward, backward) - inertia * change
    return low / machine.wheel.radius, high / machine.wheel.radius


def bearing_load(machine: Robot | Rig, normal: float, lateral: Array) -> Array:
    """|F_A| + |F_B| of Eqs. 4.37-4.38 [N]."""
    a, b, r = machine.bearing.spacing, machine.bearing.overhang, machine.wheel.radius
    return np.abs(normal * (a + b) - lateral * r) / a + np.abs(normal * b - lateral * r) / a


def lags(machine: Robot | Rig) -> tuple[float, float]:
    """How late currents and accelerations must be to be as late as wheel speeds [s]."""
    speed, bandwidth = machine.sensors.speed_filter, machine.sensors.accelerometer_bandwidth
    return speed, speed - 1.0 / (2.0 * np.pi * bandwidth)


def robot_force_rms(robot: Robot, trace: Trace) -> Array:
    """R7 and R8 since the start, shape (k, 2) [N]."""
    period = float(trace["time"][1])
    lag_current, lag_acceleration = lags(robot)
    speed = trace.wheels("wheel_speed")
    current = late(trace.wheels("current"), period, lag_current)
    a = late(np.column_stack([trace["acceleration_x"], trace["acceleration_y"]]), period, lag_acceleration)
    p, u = robot.wheel_positions, robot.drive_directions
    rolling = np.column_stack([u, p[:, 0] * u[:, 1] - p[:, 1] * u[:, 0]])
    twist = speed * robot.wheel.radius @ np.linalg.pinv(rolling).T
    axle = np.column_stack([-u[:, 1], u[:, 0]])
    across = twist[:, :2] @ axle.T + twist[:, 2:] * np.sum(np.column_stack([-p[:, 1], p[:, 0]]) * axle, 1)
    normal = robot.body.mass * GRAVITY / len(p)
    # micro-slip of the rollers' bearings as in the text's sign(v), softened over what it takes to let go
    dry = robot.wheel.roller_dry * np.tanh(across / 0.01)
    rollers = normal * (dry + robot.wheel.roller_viscous * across)
    low, high = joint_forces(robot, current, speed, bearing_load(robot, normal, rollers), period)
    task = robot.body.mass * a + rollers @ axle
    least = np.minimum(low[:, :, None] * u, high[:, :, None] * u).sum(axis=1) - task
    most = np.maximum(low[:, :, None] * u, high[:, :, None] * u).sum(axis=1) - task
    residual = np.where(least > 0.0, least, np.where(most < 0.0, most, 0.0))
    return running_rms(filtered(residual, period), period)


def rig_force_rms(rig: Rig, mass: float, trace: Trace) -> Array:
    """R2 since the start without sideways motion, shape (k,) [N]."""
    period, normal = float(trace["time"][1]), mass * GRAVITY
    lag_current, lag_acceleration = lags(rig)
    speed = trace["wheel_speed"]
    current = late(np.concatenate([[0.0], trace["current"][1:]]), period, lag_current)
    a = late(np.concatenate([[0.0], trace["carriage_acceleration"][1:]]), period, lag_acceleration)
    load = bearing_load(rig, normal, np.zeros(1))
    low, high = joint_forces(rig, current, speed, load, period)
    body, carriage = rig.rig, trace["carriage_speed"] / rig.wheel.radius
    offset = normal * abs(body.contact_offset - body.com_offset) / body.rail_half_width
    resistance = body.rail_friction + body.rail_dry * offset + rig.wheel.rolling_resistance * normal
    least = mass * a + np.where(carriage > RESTING, 1.0, -1.0) * resistance - high
    most = mass * a + np.where(carriage < -RESTING, -1.0, 1.0) * resistance - low
    residual = np.where(least > 0.0, least, np.where(most < 0.0, most, 0.0))
    return running_rms(filtered(residual, period), period)
