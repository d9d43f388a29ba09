"""Motor, amplifier and gear of one wheel, Eqs. 3.79-3.85 with the corrections of their signs.

A motor comes as its row of numbers (`motor_row`), so that every wheel can have its own and a fault can
change one number.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.parameters.parts import Motor
from omnimj.physics.native import kernel

TORQUE_CONSTANT, RESISTANCE, NO_LOAD, VISCOUS, SUPPLY, LIMIT, RATIO, EFFICIENCY, LOOP = range(9)
# faults: share of K_t that is left; dry torque on the shaft of a second motor in parallel (0: none);
# override: 0 obeys, 1 free (open circuit), 2 hard-over; current of the hard-over
KT_SCALE, PARALLEL_TORQUE, OVERRIDE, OVERRIDE_CURRENT = range(9, 13)
BRAKE = 13  # dry torque of a brake at the wheel; large: locked
MEASURED = 14  # 1: the command is a current that was measured; no limit cuts it and no loop delays it
SHORTED = 15  # 1: a relay takes the motor from its amplifier and shorts its windings: a brake
MOTOR_ROW = 16

_NEGLIGIBLE_LAG = 1e-12  # [s] a current loop that has settled long before any step ends


def motor_row(motor: Motor) -> np.ndarray:
    """A healthy motor's numbers for the kernels, shape (MOTOR_ROW,)."""
    row = np.zeros(MOTOR_ROW)
    row[:9] = (
        motor.torque_constant,
        motor.resistance,
        motor.no_load_torque,
        motor.viscous,
        motor.supply,
        motor.current_limit,
        motor.gear_ratio,
        motor.gear_efficiency,
        motor.current_loop,
    )
    row[KT_SCALE] = 1.0
    return row


def driven_by_measured_current(rows: np.ndarray) -> np.ndarray:
    """The same motors (shape (MOTOR_ROW,) or (n, MOTOR_ROW)) with the command taken as the true current."""
    changed = rows.copy()
    changed[..., MEASURED] = 1.0
    changed[..., LOOP] = _NEGLIGIBLE_LAG
    return changed


@kernel
def achievable_current(row, command, wheel_speed):
    """What the amplifier can and will drive: |i| ≤ limit and |R i₁ + K_t ω| ≤ supply [A].

    i₁ is the wheel's own motor, ω = G_r φ̇ its speed; at the supply's voltage a second motor in parallel
    takes what it needs on top of it. A shorted motor drives i = −K_t ω/R through itself, whatever its
    amplifier does.
    """
    if row[MEASURED] == 1.0:
        return command
    if row[SHORTED] == 1.0:
        return -row[KT_SCALE] * row[TORQUE_CONSTANT] * row[RATIO] * wheel_speed / row[RESISTANCE]
    if row[OVERRIDE] == 1.0:
        return 0.0
    if row[OVERRIDE] == 2.0:
        command = row[OVERRIDE_CURRENT]
    back_emf = row[TORQUE_CONSTANT] * row[RATIO] * wheel_speed
    eaten = min(row[SUPPLY] / row[RESISTANCE], row[PARALLEL_TORQUE] / row[TORQUE_CONSTANT])
    high = (row[SUPPLY] - back_emf) / row[RESISTANCE] + eaten
    low = (-row[SUPPLY] - back_emf) / row[RESISTANCE] - eaten
    limited = min(max(command, -row[LIMIT]), row[LIMIT])
    return min(max(limited, low), high)


@kernel
def next_current(row, current, command, wheel_speed, h):
    """Current after h seconds: first-order lag of the current loop, exact for a constant set value [A]."""
    target = achievable_current(row, command, wheel_speed)
    return target + (current - target) * math.exp(-h / row[LOOP])


@kernel
def winding_current(row, current, wheel_speed):
    """Share of the amplifier's current that flows through this wheel's motor [A].

    With a second motor in parallel (voltage R i₁ + K_t ω common to both) the other one takes
    V/R while its shaft is held and T/K_t once it turns against its dry torque T.
    """
    if row[PARALLEL_TORQUE] <= 0.0:
        return current
    eaten = 0.5 * (current + row[TORQUE_CONSTANT] * row[RATIO] * wheel_speed / row[RESISTANCE])
    most = row[PARALLEL_TORQUE] / row[TORQUE_CONSTANT]
    return current - min(max(eaten, -most), most)


@kernel
def _through_gear(row, shaft_torque, direction):
    """Torque at the wheel for a shaft torque: times E when the motor drives, over E when it is driven."""
    efficiency = row[EFFICIENCY]
    if shaft_torque * direction < 0.0:
        efficiency = 1.0 / efficiency
    return shaft_torque * row[RATIO] * efficiency


@kernel
def drive_torque_bounds(row, current, wheel_speed):
    """Torque at the wheel when it turns forward and when it turns backward [N.m].

    T = (K_t i − T_nl sign(ω) − b ω) G_r E^(±1), friction of brake included. At rest any torque between the
    two is possible: that is stiction. The first is never above the second.
    """
    electric = row[KT_SCALE] * row[TORQUE_CONSTANT] * winding_current(row, current, wheel_speed)
    electric -= row[VISCOUS] * row[RATIO] * wheel_speed
    forward = _through_gear(row, electric - row[NO_LOAD], 1.0) - row[BRAKE]
    backward = _through_gear(row, electric + row[NO_LOAD], -1.0) + row[BRAKE]
    return forward, backward


@kernel
def stick_or_slip(low, high, wheel_speed, inertia, other_torque, h):
    """Set-valued friction: the torque in [low, high] that brings the wheel nearest to rest in h seconds.

    A turning wheel gets `low` (forward) or `high` (backward); one that friction can hold gets exactly what
    stops it, so that it neither creeps nor chatters [N.m].
    """
    needed = -inertia * wheel_speed / h - other_torque
    return min(max(needed, low), high)
