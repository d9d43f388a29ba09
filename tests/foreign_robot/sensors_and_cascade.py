"""Sensors and controller of the robot, compiled.

Every tick of 1 ms samples the sensors and sets the demanded speed of each wheel and current of each motor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from .mission_plan import TICK
from .true_robot import ARM, DIRECTIONS, GRAVITY, NOMINAL_RADIUS, Machine, Sensors
from .wheels_and_body import ANGLE, BODY, CURRENT, POSE, VELOCITY

WHEEL_SPEEDS, CURRENTS, TARGETS, ACCELERATIONS, YAW_RATE, YAW, CAMERA, MEASURED = 0, 4, 8, 12, 14, 15, 16, 19
"""Where the parts of a measured row begin, and its length."""
DRAWS = 11
"""Normal deviates that a tick uses: currents 4, accelerations 2, gyro, heading, camera 3."""


class SensorNumbers(NamedTuple):
    """`Sensors` as the compiled code takes it: lags as the share of a change that one tick takes over."""

    count: float
    """Angle of the wheel per count of the encoder [rad]."""
    speed_share: float
    current_noise: float
    current_offset: np.ndarray
    acceleration_noise: float
    acceleration_offset: np.ndarray
    acceleration_share: float
    acceleration_place: np.ndarray
    gyro_noise: float
    gyro_bias: float
    gyro_share: float
    heading_noise: float
    heading_ticks: int
    camera_ticks: float
    camera_delay: int
    camera_noise: np.ndarray


def sensor_numbers(sensors: Sensors, gear_ratio: float) -> SensorNumbers:
    """The constants of the sampling."""

    def share_of(corner: float) -> float:
        return 1.0 - float(np.exp(-2 * np.pi * corner * TICK))

    return SensorNumbers(
        2 * np.pi / (sensors.encoder_counts * gear_ratio),
        1.0 - float(np.exp(-TICK / sensors.speed_filter)),
        sensors.current_noise,
        np.array(sensors.current_offset),
        sensors.acceleration_noise,
        np.array(sensors.acceleration_bias) + GRAVITY * np.array(sensors.acceleration_tilt),
        share_of(sensors.acceleration_bandwidth),
        np.array(sensors.acceleration_place),
        sensors.gyro_noise,
        sensors.gyro_bias,
        share_of(sensors.gyro_bandwidth),
        sensors.heading_noise,
        max(round(1.0 / (sensors.heading_rate * TICK)), 1),
        1.0 / (sensors.camera_rate * TICK),
        round(sensors.camera_delay / TICK),
        np.array(sensors.camera_noise),
    )


class Cascade(NamedTuple):
    """Gains of the controller, and what it regulates."""

    speed_proportional: float
    speed_integral: float
    yaw_rate_gain: float
    heading_gain: float
    """0: the heading is left to itself."""
    current_limit: float
    in_world: bool


@njit(error_model="numpy")
def sample(tick, state, seen, poses, draws, sensors: SensorNumbers, machine: Machine, held, measured) -> None:
    """Fills measured[tick] from the true state.

    `held` keeps the encoder angles, the filtered accelerations and the filtered yaw rate from tick to tick.
    The accelerometer at p reads a_centre + ω̇ × p − ω² p without gravity: its pull along a sloping floor moves
    the robot but not the reading.
    """
    row = measured[tick]
    before = measured[max(tick - 1, 0)]
    for i in range(4):
        angle = np.floor(state[ANGLE + i] / sensors.count) * sensors.count
        raw = (angle - held[i]) / TICK
        held[i] = angle
        old = before[WHEEL_SPEEDS + i]
        row[WHEEL_SPEEDS + i] = old + sensors.speed_share * (raw - old) if tick > 0 else 0.0
        row[CURRENTS + i] = state[CURRENT + i] + sensors.current_offset[i] + sensors.current_noise * draws[i]
    cos, sin = np.cos(state[POSE + 2]), np.sin(state[POSE + 2])
    pull_x = cos * machine.gravity[0] + sin * machine.gravity[1]
    pull_y = -sin * machine.gravity[0] + cos * machine.gravity[1]
    for j in range(2):
        spin, turn = seen[BODY + 4], state[VELOCITY + 2]
        true = seen[BODY + 2 + j] - (pull_x if j == 0 else pull_y)
        across = -sensors.acceleration_place[1] if j == 0 else sensors.acceleration_place[0]
        true += spin * across - turn * turn * sensors.acceleration_place[j]
        held[4 + j] += sensors.acceleration_share * (true - held[4 + j])
        noise = sensors.acceleration_noise * draws[4 + j]
        row[ACCELERATIONS + j] = held[4 + j] + sensors.acceleration_offset[j] + noise
    held[6] += sensors.gyro_share * (state[VELOCITY + 2] - held[6])
    row[YAW_RATE] = held[6] + sensors.gyro_bias + sensors.gyro_noise * draws[6]
    fresh = tick % sensors.heading_ticks == 0
    row[YAW] = state[POSE + 2] + sensors.heading_noise * draws[7] if fresh else before[YAW]
    _film(tick, poses, draws, sensors, before, row)


@njit(error_model="numpy")
def _film(tick, poses, draws, sensors: SensorNumbers, before, row) -> None:
    """The pose that the camera last reported: taken `camera_delay` ago, held until the next picture."""
    fresh = tick == 0 or int(tick / sensors.camera_ticks) != int((tick - 1) / sensors.camera_ticks)
    for j in range(3):
        noise = sensors.camera_noise[1 if j == 2 else 0] * draws[8 + j]
        taken = poses[max(tick - sensors.camera_delay, 0), j]
        row[CAMERA + j] = taken + noise if fresh else before[CAMERA + j]


@njit(error_model="numpy")
def set_values(tick, twist, heading, wanted_heading, cascade: Cascade, integrals, measured, targets) -> None:
    """Demanded currents [A]: proportional control of the yaw rate, PI control of the wheel speeds.

    ω_c = ω + k_θ(θ_plan − θ), ω* = ω_c + k_ω(ω_c − gyro);  φ̇*_i = (v·u_i − l ω*)/r;  i = k_p e + ∫ k_i e dt.
    """
    row = measured[tick]
    vx, vy = twist[0], twist[1]
    if cascade.in_world:
        cos, sin = np.cos(heading), np.sin(heading)
        vx, vy = cos * vx + sin * vy, cos * vy - sin * vx
    turn = twist[2] + cascade.heading_gain * (wanted_heading - heading)
    turn += cascade.yaw_rate_gain * (turn - row[YAW_RATE])
    for i in range(4):
        wanted = (vx * DIRECTIONS[i, 0] + vy * DIRECTIONS[i, 1] - ARM * turn) / NOMINAL_RADIUS
        error = wanted - row[WHEEL_SPEEDS + i]
        demanded = cascade.speed_proportional * error + integrals[i]
        limit = cascade.current_limit
        # at its limit a motor takes no more: the integral waits
        if abs(demanded) < limit or demanded * error < 0.0:
            integrals[i] += cascade.speed_integral * error * TICK
        targets[i] = min(max(demanded, -limit), limit)
        row[TARGETS + i] = targets[i]
