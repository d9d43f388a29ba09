"""Motor, amplifier and gear of one wheel, Eqs. 3.79-3.85 with their signs corrected.

Kernels take a `motor` as `MotorParameters`. Where there are several motors, or in the memory of a compiled
MuJoCo model, each is a packed row of the same numbers, read with `motor_at`. Their `current` is that of the
motor before the step [A], `command` the commanded one [A], `wheel_speed` φ̇ after the gear [rad/s], h the
step [s].
"""

from __future__ import annotations

import math
from typing import NamedTuple

from omnimj.parameters.parts import Motor
from omnimj.physics.native import first_numbers, kernel

_NEGLIGIBLE_LAG = 1e-12  # [s] a current loop that has settled long before any step ends

OBEYS, FREE, HARD_OVER = 0.0, 1.0, 2.0
"""States of the amplifier: it follows the command, its circuit is open, or it drives `override_current`."""


class MotorParameters(NamedTuple):
    """One motor, in the form used by the kernels: its constants and its faults."""

    torque_constant: float
    """K_t [N.m/A]."""
    resistance: float
    """R [ohm]."""
    no_load_torque: float
    """T_nl at the shaft [N.m]."""
    viscous: float
    """Viscous friction at the shaft [N.m.s/rad]."""
    supply: float
    """Supply voltage [V]."""
    current_limit: float
    """Largest current of the amplifier [A]."""
    gear_ratio: float
    """G_r."""
    gear_efficiency: float
    """E."""
    driven_gain: float
    """Wheel torque over G_r T while the wheel drives the motor, 1/E_b."""
    current_loop: float
    """Time constant of the amplifier's current loop [s]."""
    torque_scale: float = 1.0
    """Remaining share of K_t."""
    parallel_torque: float = 0.0
    """Dry torque on the shaft of a second motor in parallel; 0: there is none [N.m]."""
    override: float = OBEYS
    """`OBEYS`, `FREE` or `HARD_OVER`."""
    override_current: float = 0.0
    """Current of the hard-over [A]."""
    brake: float = 0.0
    """Dry torque of a brake at the wheel; large: locked [N.m]."""
    measured: float = 0.0
    """1: the command is a measured current, which no limit cuts and no loop delays."""
    shorted: float = 0.0
    """1: a relay takes the motor from its amplifier and shorts its windings, which brakes the wheel."""


MOTOR_SIZE = len(MotorParameters._fields)
"""Numbers of a packed motor."""
TORQUE_SCALE = MotorParameters._fields.index("torque_scale")
SHORTED = MotorParameters._fields.index("shorted")
"""Places in a packed motor of what changes within a run."""


def motor_parameters(motor: Motor) -> MotorParameters:
    """Parameters of a healthy motor."""
    return MotorParameters(
        motor.torque_constant,
        motor.resistance,
        motor.no_load_torque,
        motor.viscous,
        motor.supply,
        motor.current_limit,
        motor.gear_ratio,
        motor.gear_efficiency,
        motor.driven_gain,
        motor.current_loop,
    )


def driven_by_measured_current(motor: MotorParameters) -> MotorParameters:
    """Copy of a motor whose command is taken as the true current."""
    return motor._replace(measured=1.0, current_loop=_NEGLIGIBLE_LAG)


@kernel
def motor_at(row):
    """`MotorParameters` of a packed row, shape (MOTOR_SIZE,)."""
    return MotorParameters(*first_numbers(row, MOTOR_SIZE))


@kernel
def achievable_current(motor, command, wheel_speed):
    """Current at which the amplifier settles: |i| ≤ limit and |R i₁ + K_t ω| ≤ supply [A].

    i₁ is the current of the wheel's own motor and ω = G_r φ̇ its speed; at the full supply voltage a second
    motor in parallel draws its current on top of it. A shorted motor drives i = −K_t ω/R through itself,
    whatever its amplifier does.
    """
    if motor.measured == 1.0:
        return command
    if motor.shorted == 1.0:
        return -motor.torque_scale * motor.torque_constant * motor.gear_ratio * wheel_speed / motor.resistance
    if motor.override == FREE:
        return 0.0
    if motor.override == HARD_OVER:
        command = motor.override_current
    back_emf = motor.torque_constant * motor.gear_ratio * wheel_speed
    bypassed = min(motor.supply / motor.resistance, motor.parallel_torque / motor.torque_constant)
    high = (motor.supply - back_emf) / motor.resistance + bypassed
    low = (-motor.supply - back_emf) / motor.resistance - bypassed
    limited = min(max(command, -motor.current_limit), motor.current_limit)
    return min(max(limited, low), high)


@kernel
def next_current(motor, current, command, wheel_speed, h):
    """Current after h seconds of a first-order current loop, exact for a constant command [A]."""
    target = achievable_current(motor, command, wheel_speed)
    return target + (current - target) * math.exp(-h / motor.current_loop)


@kernel
def mean_current(motor, current, next_current, command, wheel_speed, h):
    """Mean current over a step of `next_current`, i∞ + (i − i⁺) τ/h [A].

    Args:
      current: Motor current before the step, i [A].
      next_current: Motor current after the step, i⁺ [A].
    """
    target = achievable_current(motor, command, wheel_speed)
    return target + (current - next_current) * motor.current_loop / h


@kernel
def winding_current(motor, current, wheel_speed):
    """Part of the amplifier's current that flows through the wheel's own motor [A].

    With a second motor in parallel (voltage R i₁ + K_t ω common to both) the other one draws V/R while its
    shaft is held and T/K_t once it turns against its dry torque T.
    """
    if motor.parallel_torque <= 0.0:
        return current
    speed = motor.torque_constant * motor.gear_ratio * wheel_speed / motor.resistance
    bypassed = 0.5 * (current + speed)
    most = motor.parallel_torque / motor.torque_constant
    return current - min(max(bypassed, -most), most)


@kernel
def _through_gear(motor, shaft_torque, direction):
    """Torque at the wheel for a shaft torque: times E when the motor drives, over E_b when it is driven."""
    driven = shaft_torque * direction < 0.0
    return shaft_torque * motor.gear_ratio * (motor.driven_gain if driven else motor.gear_efficiency)


@kernel
def drive_torque_bounds(motor, current, wheel_speed):
    """Torque at a wheel that turns forward and at one that turns backward [N.m].

    T = (K_t i − T_nl sign(ω) − b ω) G_r E, or G_r/E_b in place of G_r E where the wheel drives the motor;
    friction of the brake included. At rest any torque between the two is possible (stiction). The first is
    never above the second: a gear that brakes less than it drives, E E_b > 1, has the torque of its motion
    alone where the two would cross.
    """
    electric = motor.torque_scale * motor.torque_constant * winding_current(motor, current, wheel_speed)
    electric -= motor.viscous * motor.gear_ratio * wheel_speed
    forward = _through_gear(motor, electric - motor.no_load_torque, 1.0) - motor.brake
    backward = _through_gear(motor, electric + motor.no_load_torque, -1.0) + motor.brake
    if forward > backward:
        return (
            forward if wheel_speed > 0.0 else backward,
            backward if wheel_speed < 0.0 else forward,
        )
    return forward, backward


@kernel
def motor_torque_bounds(motor, current, wheel_speed, published):
    """`drive_torque_bounds`, or as published (K_t i − T_nl) E G_r for both, Eqs. 3.80-3.85 [N.m]."""
    if not published:
        return drive_torque_bounds(motor, current, wheel_speed)
    electric = motor.torque_scale * motor.torque_constant * winding_current(motor, current, wheel_speed)
    torque = (electric - motor.no_load_torque) * motor.gear_efficiency * motor.gear_ratio
    return torque - motor.brake, torque + motor.brake


@kernel
def stick_or_slip(low, high, wheel_speed, inertia, other_torque, h):
    """Set-valued friction: the torque in [low, high] that brings the wheel nearest to rest within h seconds.

    It is `low` for a wheel that turns forward, `high` for one that turns backward, and exactly the stopping
    torque for one that friction can hold, which therefore neither creeps nor chatters [N.m].

    Args:
      low: Lower bound, the torque on a wheel that turns forward [N.m].
      high: Upper bound, the torque on a wheel that turns backward [N.m].
      wheel_speed: Speed before the step [rad/s].
      inertia: Moment of inertia [kg.m²].
      other_torque: Sum of all other torques [N.m].
    """
    needed = -inertia * wheel_speed / h - other_torque
    return min(max(needed, low), high)
