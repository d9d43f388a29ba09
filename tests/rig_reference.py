"""Reference integration of the test rig, Eqs. 4.27-4.40, written afresh: it shares no code with the package.

Only the constants come from outside (anything with the fields of `omnimj.parameters.Rig` and `Floor`).
sign(v) of every dry friction is tanh(v/SMOOTHING), at the wheel with the speed of its rim; at rest it creeps
by less than SMOOTHING times a few. LSODA with rtol = atol = 1e-9.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp

SMOOTHING = 1e-4
"""Speed over which friction changes its sign [m/s]."""

GRAVITY = 9.81


def _resistance(rig, floor, ahead: float, aside: float) -> tuple[float, float]:
    """Rolling resistance over F_N, of wheel and floor along and of the floor across, by the way it rolls."""
    whole, rest = floor.numbers.get("rolling_resistance", 0.0), 1e-3
    along, across = (whole * math.hypot(v, rest) / math.hypot(ahead, aside, rest) for v in (ahead, aside))
    return rig.wheel.rolling_resistance + along, across


def _coupling(rig, mass: float, lateral_speed: float, resisting: float) -> tuple[float, float, float]:
    """G of Eqs. 4.17-4.18 by iteration, the load |F_H| + |F_G| of the rail, the load |F_A| + |F_B| [N]."""
    body, weight = rig.rig, mass * GRAVITY
    j, k = 2.0 * rig.wheel.row_offset, -rig.wheel.row_offset  # rows of rollers: their distance, the first one
    c, h = body.rail_height, body.rail_half_width
    dry = rig.wheel.roller_dry + resisting
    ratio = dry * np.sign(lateral_speed) + rig.wheel.roller_viscous * lateral_speed
    g = f_r1 = f_r2 = 0.0
    for _ in range(50):
        f_d = -g
        f_r1 = (-weight * k + f_d * c) / j
        f_r2 = (weight * (k + j) - f_d * c) / j
        before, g = g, ratio * (abs(f_r1) + abs(f_r2))
        if g == before:
            break
    normal = f_r1 + f_r2
    m_d = normal * body.contact_offset - weight * body.com_offset - g * c
    f_h, f_g = (-g * h - m_d) / (2 * h), (-g * h + m_d) / (2 * h)
    a, b, r = rig.bearing.spacing, rig.bearing.overhang, rig.wheel.radius
    f_a, f_b = (normal * (a + b) - g * r) / a, (normal * b - g * r) / a
    return normal, abs(f_h) + abs(f_g), abs(f_a) + abs(f_b)


def _lugre(floor, slip: float, p: float) -> tuple[float, float]:
    """Rate of the bristle and F_trac/F_N, Eqs. 4.32-4.33."""
    q = floor.numbers
    g = q["mu_c"] + (q["mu_s"] - q["mu_c"]) * math.exp(-math.sqrt(abs(slip / q["V_s"])))
    p_dot = slip - q["sigma_0"] * abs(slip) / g * p
    ratio = q["sigma_0"] * p + q["sigma_1"] * p_dot + q["sigma_2"] * slip
    cap = q.get("mu_cap", math.inf)
    ratio = max(-cap, min(cap, ratio))
    return p_dot, ratio


def rates(rig, floor, mass: float, command: float, lateral_speed: float, state) -> tuple[list[float], float]:
    """d/dt of [x12 carriage speed, x13 wheel speed, x14 bristle, current], Eqs. 4.32-4.40, and F_trac [N].

    With the sign of T_nl, the motor's viscous friction and the gear's power direction.
    """
    motor, bearing, r = rig.motor, rig.bearing, rig.wheel.radius
    speed, turning, p, current = state
    along, across = _resistance(rig, floor, max(abs(r * turning), abs(speed)), lateral_speed)
    normal, rail_load, bearing_load = _coupling(rig, mass, lateral_speed, across)
    p_dot, ratio = _lugre(floor, r * turning - speed, p)
    traction = normal * ratio
    rail_sign, wheel_sign = math.tanh(speed / SMOOTHING), math.tanh(r * turning / SMOOTHING)
    rail = (rig.rig.rail_friction + rig.rig.rail_dry * rail_load) * rail_sign
    rail += rig.rig.rail_viscous * speed * rail_load
    rail += along * mass * GRAVITY * rail_sign
    rotor_speed = motor.gear_ratio * turning
    shaft = motor.torque_constant * current - motor.viscous * rotor_speed
    gear = 0.0
    for sign in (1.0, -1.0):  # torque when turning forward and backward, blended by the smoothed sign
        through = shaft - sign * motor.no_load_torque
        driving = through * sign >= 0.0
        efficiency = motor.gear_efficiency if driving else 1.0 / motor.gear_efficiency
        gear += 0.5 * (1.0 + sign * wheel_sign) * through * motor.gear_ratio * efficiency
    friction = (
        (bearing.dry * wheel_sign + bearing.viscous * turning) * bearing_load * bearing.pitch_diameter / 2
    )
    inertia = rig.wheel.inertia + motor.rotor_inertia * motor.gear_efficiency * motor.gear_ratio**2
    most = (motor.supply - motor.torque_constant * rotor_speed) / motor.resistance
    least = (-motor.supply - motor.torque_constant * rotor_speed) / motor.resistance
    wanted = max(least, min(most, max(-motor.current_limit, min(motor.current_limit, command))))
    return [
        (traction - rail) / mass,
        (gear - friction - r * traction) / inertia,
        p_dot,
        (wanted - current) / motor.current_loop,
    ], traction


def integrate(
    rig_parameters, floor, mass: float, current: float, duration: float, lateral_speed: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Constant set current from rest.

    Args:
      rig_parameters: `omnimj.parameters.Rig`.
      floor: `omnimj.parameters.Floor` with law `lugre`.
      mass: m_T [kg].
      current: Set value [A].
      duration: [s].
      lateral_speed: Of the gantry [m/s].

    Returns:
      time [s], carriage_speed [m/s], wheel_speed [rad/s], every millisecond from 0 on.
    """
    if floor.law != "lugre":
        raise ValueError(f"the reference knows LuGre floors only, not {floor.law!r}")
    time = np.arange(round(duration * 1000) + 1) * 1e-3
    solution = solve_ivp(
        lambda _, state: rates(rig_parameters, floor, mass, current, lateral_speed, state)[0],
        (0.0, time[-1]),
        np.zeros(4),
        method="LSODA",
        t_eval=time,
        rtol=1e-9,
        atol=1e-9,
    )
    if not solution.success:
        raise RuntimeError(solution.message)
    return time, solution.y[0], solution.y[1]
