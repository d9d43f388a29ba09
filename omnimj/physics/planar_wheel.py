"""One wheel of the planar robot in one step: bristles, current, speed, angle and the play of its gear.

The state is that of `physics.planar`.
"""

from __future__ import annotations

import math

from omnimj.physics.effect_terms import (
    ACTIVE,
    HALVINGS,
    LASH,
    SAG,
    axle_dry,
    axle_torque,
    draw,
    hub_force,
    through_lash,
    traction_scale,
)
from omnimj.physics.motor import SUPPLY, next_current, stick_or_slip
from omnimj.physics.native import kernel
from omnimj.physics.planar_constants import (
    DRIVE_X,
    DRIVE_Y,
    GRIP,
    POSITION_X,
    POSITION_Y,
    ROLLER_COS,
    ROLLER_SIN,
)
from omnimj.physics.traction import exact_step, force_ratio, relaxation_rate
from omnimj.physics.wheel import (
    INERTIA,
    RADIUS,
    ROLLING,
    bearing_friction,
    mean_current,
    mean_deflection,
    motor_torque_bounds,
    roller_friction,
)


@kernel
def pose_at(wheels):
    """Where x, y and yaw begin in the state of `step` for n wheels."""
    return 7 * wheels + 4


@kernel
def wheel_velocity(wheel, v_x, v_y, yaw_rate):
    """Velocity of the wheel's centre along u (V_i, Eqs. 3.50-3.53) and along its axle z × u [m/s]."""
    x = v_x - yaw_rate * wheel[POSITION_Y]
    y = v_y + yaw_rate * wheel[POSITION_X]
    return x * wheel[DRIVE_X] + y * wheel[DRIVE_Y], y * wheel[DRIVE_X] - x * wheel[DRIVE_Y]


@kernel
def contact_velocity(wheel, rim, along, across):
    """Slip V_r along the roller's axis a and what turns the roller, along z × a [m/s].

    V_r = a·(r φ̇ u − V), the other (z × a)·(V − r φ̇ u), with a = sin γ u + cos γ (z × u). An omni wheel,
    γ = 90°: r φ̇ − V_i, and the velocity along the axle.
    """
    s, c = wheel[ROLLER_SIN], wheel[ROLLER_COS]
    return s * (rim - along) - c * across, s * across + c * (rim - along)


@kernel
def contact_force(wheel, traction, drag):
    """Force F a − G (z × a) of the floor on the wheel along u, and against z × u [N].

    Args:
      wheel: Its row.
      traction: F [N].
      drag: G, what the roller's bearing takes [N].
    """
    s, c = wheel[ROLLER_SIN], wheel[ROLLER_COS]
    return s * traction + c * drag, s * drag - c * traction


@kernel
def wheel_torque_bounds(wheel, motor, current, wheel_speed, normal_force, lateral_force, published):
    """Torque on the wheel but for traction, turning forward and turning backward [N.m]."""
    low, high = motor_torque_bounds(motor, current, wheel_speed, published)
    if published:
        return low, high
    dry, viscous = bearing_friction(wheel, normal_force, lateral_force)
    dry += wheel[ROLLING] * normal_force * wheel[RADIUS]
    return low - dry - viscous * wheel_speed, high + dry - viscous * wheel_speed


@kernel
def _place(wheel, state, pose):
    """World x of the wheel's centre [m]."""
    c, s = math.cos(state[pose + 2]), math.sin(state[pose + 2])
    return state[pose] + c * wheel[POSITION_X] - s * wheel[POSITION_Y]


@kernel
def _turn_wheel(i, n, state, terms, wheel, motor, driving, normal, aside, ahead, h, published):
    """Advances speed, angle and play of wheel i under its torques and the floor's force."""
    wheel_speed, play, rate = state[n + i], state[5 * n + 3 + i], state[6 * n + 3 + i]
    inertia, angle = wheel[INERTIA], state[4 * n + 3 + i]
    other = -wheel[RADIUS] * ahead
    if terms[ACTIVE] == 0.0:
        low, high = wheel_torque_bounds(wheel, motor, driving, wheel_speed, normal, aside, published)
        change = (stick_or_slip(low, high, wheel_speed, inertia, other, h) + other) / inertia
    else:
        low, high = motor_torque_bounds(motor, driving, wheel_speed + rate, published)
        dry = axle_dry(terms, low, high)
        other += axle_torque(terms, angle + play, wheel_speed + rate, h)
        if not published:
            bearing, viscous = bearing_friction(wheel, normal, aside)
            dry += bearing + wheel[ROLLING] * normal * wheel[RADIUS]
            other -= viscous * wheel_speed
        dry = max(dry, 0.0)
        if terms[LASH] != 0.0:
            change, play, rate, _ = through_lash(
                terms, play, rate, low, high, dry, wheel_speed, inertia, other, h
            )
            state[5 * n + 3 + i], state[6 * n + 3 + i] = play, rate
        else:
            torque = stick_or_slip(low - dry, high + dry, wheel_speed, inertia, other, h)
            change = (torque + other) / inertia
    state[n + i] = wheel_speed + h * change
    state[4 * n + 3 + i] = angle + 0.5 * h * (wheel_speed + state[n + i])


@kernel
def step_wheel(i, state, command, wheel, motor, floor, terms, normal, h, published, output):
    """Advances all of wheel i; returns its force along u, and against z × u [N]."""
    n = command.size
    wheel_speed = state[n + i]
    along, across = wheel_velocity(wheel, state[2 * n], state[2 * n + 1], state[2 * n + 2])
    rim = wheel[RADIUS] * wheel_speed
    slip, sideways = contact_velocity(wheel, rim, along, across)
    rate = relaxation_rate(floor, slip, max(abs(rim), abs(along)))
    z = exact_step(state[i], slip, rate, h)
    mean = mean_deflection(state[i], z, slip, rate, h)
    traction = normal * wheel[GRIP] * force_ratio(floor, mean, slip, rate)
    more = 0.0
    if terms[ACTIVE] != 0.0:
        place = _place(wheel, state, pose_at(n))
        traction *= traction_scale(terms, place)
        angle, time = state[4 * n + 3 + i], state[pose_at(n) - 1]
        more = hub_force(terms, along, place, time, across, angle, wheel_speed, h)
    roller, drag = roller_friction(wheel, state[3 * n + 3 + i], sideways, normal, h)
    ahead, aside = contact_force(wheel, traction, drag)
    before = state[2 * n + 3 + i]
    current = next_current(motor, before, command[i], wheel_speed, h)
    driving = mean_current(motor, before, current, command[i], wheel_speed, h)
    _turn_wheel(i, n, state, terms, wheel, motor, driving, normal, aside, ahead, h, published)
    state[i], state[3 * n + 3 + i], state[2 * n + 3 + i] = z, roller, current
    output[i], output[n + i], output[2 * n + i], output[3 * n + i] = slip, normal, traction, drag
    output[4 * n + 2 + i] = state[n + i] + state[6 * n + 3 + i]
    return ahead + more, aside


@kernel
def supply_load(state, command, motors, terms, room, draws):
    """Fills `draws` with what the motors take at the voltage that they leave of a sagging supply [A].

    V = V_0 − R_s Σ i_j(V) has one solution, since no current falls with the voltage.
    """
    n = command.size
    time = state[pose_at(n) - 1]
    low, high = 0.0, motors[0, SUPPLY]
    for _ in range(HALVINGS):
        voltage, total = 0.5 * (low + high), 0.0
        for i in range(n):
            draws[i] = draw(motors[i], terms[i], time, voltage, command[i], state[n + i], room)
            total += draws[i]
        if voltage > motors[0, SUPPLY] - terms[0, SAG] * total:
            high = voltage
        else:
            low = voltage
    return total
