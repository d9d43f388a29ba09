"""Equations of motion of the robot: floor, gear, motor and body, compiled.

State, by index (`POSE` … `LOAD`): pose of the centre in the world; velocity of the centre in the body frame
and yaw rate; angles and speeds of the wheels; currents; tractions; loads. Midpoint rule with a fixed step.

Body: with centre of mass c and floor force F in the body frame, and M its moment about the centre,
    m a_c = F + m g_slope,   I_c ω̇ = M − c × F,   a_centre = a_c − ω̇ × c + ω² c,
    d(v)/dt = a_centre − ω × v.
Wheel i at p_i, along u_i: slip v_i = r φ̇_i − (v + ω × p_i)·u_i, traction X_i relaxes to μ(v_i) N_i.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .true_robot import ARM, DIRECTIONS, GRAVITY, PLACES, Machine

POSE, VELOCITY, ANGLE, SPEED, CURRENT, TRACTION, LOAD, STATES = 0, 3, 6, 10, 14, 18, 22, 26
"""Where the parts of the state begin, and its length."""
SLIP, DRAG, SHAFT, WHEEL_TORQUE, WHEEL_ACCELERATION, BODY, SEEN = 0, 4, 8, 12, 16, 20, 25
"""Where the parts of what the equations pass out begin.

BODY: acceleration of the centre of mass (world frame turned into the body's axes), that of the centre, and ω̇;
length `SEEN`.
"""
TURNING = 2.0
"""Motor speed over which dry friction in motor and bearing changes its sign [rad/s]."""
CREEP = 0.03
"""Slip velocity over which the dry part of traction sets in [m/s]."""
ROLLER_CREEP = 0.005
"""Lateral speed over which the rollers' dry drag changes its sign [m/s]."""
IDLE_POWER = 0.02
"""Power through the gear over which its efficiency changes from one direction to the other [W]."""
SUSPENSION = 0.010
"""Time in which the loads follow the accelerations [s]."""


@njit(error_model="numpy")
def traction_over_load(slip: float, grip: float, machine: Machine) -> float:
    """μ(v): linear at small slip, a ceiling `grip`, less at high slip.

    raw = dry tanh(v/CREEP) + slope v;  μ = raw / (1 + (raw/ceiling)⁴)^¼;
    ceiling = grip (1 − drop (1 − e^(−v²))), v in m/s.
    """
    ceiling = grip * (1.0 - machine.drop * (1.0 - np.exp(-slip * slip)))
    raw = machine.dry * np.tanh(slip / CREEP) + machine.slope * slip
    share = raw / ceiling
    return raw / (1.0 + (share * share) * (share * share)) ** 0.25


@njit(error_model="numpy")
def gear_factor(power: float, machine: Machine) -> float:
    """Factor of the gear on G T_shaft: E where the motor drives the floor, else `back_factor`."""
    forward = 0.5 * (1.0 + np.tanh(power / IDLE_POWER))
    return forward * machine.efficiency + (1.0 - forward) * machine.back_factor


@njit(error_model="numpy")
def wheel_and_motor(
    wheel: int, speed: float, current: float, strength: float, load: float, traction: float, machine: Machine
) -> tuple[float, float, float]:
    """Acceleration of a wheel [rad/s²], torque on the motor's shaft and on the wheel [N.m].

    T_shaft = K_t i − T_nl sign ω − d ω − J_r ω̇,  T_wheel = η G T_shaft,  I φ̈ = T_wheel − T_bearing − r X,
    with ω = G φ̇. The sign of T_shaft does not depend on η > 0: with Q = T_shaft + J_r ω̇, R = T_bearing + r X,
    T_shaft = (Q I + J_r G R)/(I + η J_r G²).
    """
    ratio, inertia, rotor = machine.gear_ratio, machine.wheel_inertia[wheel], machine.rotor_inertia[wheel]
    turning = ratio * speed
    sign = np.tanh(turning / TURNING)
    q = machine.torque_constant[wheel] * strength * current
    q -= machine.no_load_torque[wheel] * sign + machine.viscous[wheel] * turning
    r = machine.bearing[wheel] * load * sign + machine.radius[wheel] * traction
    lumped = q * inertia + rotor * ratio * r
    # the power that decides is taken with the torque that an ideal gear would pass
    factor = gear_factor(lumped / (inertia + rotor * ratio * ratio) * turning, machine)
    shaft = lumped / (inertia + factor * rotor * ratio * ratio)
    torque = factor * ratio * shaft
    return (torque - r) / inertia, shaft, torque


@njit(error_model="numpy")
def amplifier(target, current, speed, strength, wheel: int, machine: Machine) -> float:
    """Rate of a current [A/s]: a lag to the set value, as far as limit, supply and back-EMF let it."""
    emf = machine.torque_constant[wheel] * strength * machine.gear_ratio * speed
    most = (machine.supply - emf) / machine.resistance
    least = (-machine.supply - emf) / machine.resistance
    wanted = min(max(target, -machine.current_limit), machine.current_limit)
    return (min(max(wanted, least), most) - current) / machine.current_lag


@njit(error_model="numpy")
def loads(force_x: float, force_y: float, machine: Machine, out: np.ndarray) -> None:
    """Normal forces of the four wheels for a floor force, in equilibrium about the centre of mass [N].

    N1 − N3 = (m g c_x − h F_x)/l,  N4 − N2 = (m g c_y − h F_y)/l,  N1 + N3 and N2 + N4 share the weight.
    """
    weight = machine.mass * GRAVITY
    pitch = (weight * machine.com[0] - machine.com_height * force_x) / ARM
    roll = (weight * machine.com[1] - machine.com_height * force_y) / ARM
    along, across = 0.25 * weight * (1.0 + machine.twist_load), 0.25 * weight * (1.0 - machine.twist_load)
    out[0], out[2] = along + 0.5 * pitch, along - 0.5 * pitch
    out[3], out[1] = across + 0.5 * roll, across - 0.5 * roll
    for i in range(4):
        out[i] = max(out[i], 0.0)


@njit(error_model="numpy")
def wheels(state, targets, strength, grip, machine: Machine, rate, seen) -> None:
    """Rates of wheels, currents and tractions."""
    vx, vy, turn = state[VELOCITY], state[VELOCITY + 1], state[VELOCITY + 2]
    for i in range(4):
        speed, load = state[SPEED + i], state[LOAD + i]
        rim_x, rim_y = vx - turn * PLACES[i, 1], vy + turn * PLACES[i, 0]
        slip = machine.radius[i] * speed - (rim_x * DIRECTIONS[i, 0] + rim_y * DIRECTIONS[i, 1])
        wanted = load * traction_over_load(slip, machine.grip * grip[i], machine)
        lateral = (rim_x * PLACES[i, 0] + rim_y * PLACES[i, 1]) / ARM
        drag = machine.roller_dry * np.tanh(lateral / ROLLER_CREEP) + machine.roller_viscous * lateral
        acceleration, shaft, torque = wheel_and_motor(
            i, speed, state[CURRENT + i], strength[i], load, state[TRACTION + i], machine
        )
        rate[ANGLE + i] = speed
        rate[SPEED + i] = acceleration
        rate[CURRENT + i] = amplifier(targets[i], state[CURRENT + i], speed, strength[i], i, machine)
        rate[TRACTION + i] = (wanted - state[TRACTION + i]) / machine.relaxation
        seen[SLIP + i], seen[DRAG + i], seen[SHAFT + i] = slip, load * drag, shaft
        seen[WHEEL_TORQUE + i], seen[WHEEL_ACCELERATION + i] = torque, acceleration


@njit(error_model="numpy")
def body(state, machine: Machine, rate, seen) -> None:
    """Rates of pose, velocity and loads; needs what `wheels` has put out."""
    heading, vx, vy, turn = state[POSE + 2], state[VELOCITY], state[VELOCITY + 1], state[VELOCITY + 2]
    force_x = force_y = moment = 0.0
    for i in range(4):
        traction, drag = state[TRACTION + i], seen[DRAG + i]
        fx = traction * DIRECTIONS[i, 0] - drag * PLACES[i, 0] / ARM
        fy = traction * DIRECTIONS[i, 1] - drag * PLACES[i, 1] / ARM
        force_x, force_y = force_x + fx, force_y + fy
        moment += PLACES[i, 0] * fy - PLACES[i, 1] * fx
    cos, sin = np.cos(heading), np.sin(heading)
    cx, cy = machine.com[0], machine.com[1]
    com_x = force_x / machine.mass + cos * machine.gravity[0] + sin * machine.gravity[1]
    com_y = force_y / machine.mass - sin * machine.gravity[0] + cos * machine.gravity[1]
    spin = (moment - (cx * force_y - cy * force_x)) / machine.yaw_inertia
    centre_x = com_x + spin * cy + turn * turn * cx
    centre_y = com_y - spin * cx + turn * turn * cy
    rate[POSE], rate[POSE + 1], rate[POSE + 2] = cos * vx - sin * vy, sin * vx + cos * vy, turn
    rate[VELOCITY], rate[VELOCITY + 1], rate[VELOCITY + 2] = centre_x + turn * vy, centre_y - turn * vx, spin
    loads(force_x, force_y, machine, rate[LOAD : LOAD + 4])
    for i in range(4):
        rate[LOAD + i] = (rate[LOAD + i] - state[LOAD + i]) / SUSPENSION
    seen[BODY], seen[BODY + 1] = com_x, com_y
    seen[BODY + 2], seen[BODY + 3], seen[BODY + 4] = centre_x, centre_y, spin


@njit(error_model="numpy")
def step(state, targets, strength, grip, machine: Machine, h: float, rate, seen, middle) -> None:
    """One midpoint step of `h` seconds; `rate` and `seen` are those of the middle afterwards."""
    wheels(state, targets, strength, grip, machine, rate, seen)
    body(state, machine, rate, seen)
    for j in range(STATES):
        middle[j] = state[j] + 0.5 * h * rate[j]
    wheels(middle, targets, strength, grip, machine, rate, seen)
    body(middle, machine, rate, seen)
    for j in range(STATES):
        state[j] += h * rate[j]
