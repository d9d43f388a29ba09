"""A robot's numbers for the planar kernels: masses, wheels and their static normal forces."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnimj.errors import InputError
from omnimj.parameters.robot import Robot, roller_sin_cos
from omnimj.physics.effect_terms import (
    ACTIVE,
    AIR,
    BACKLASH,
    BISECTIONS,
    SAG,
    apply_motor_effects,
    axle_dry_friction,
    axle_torque,
    has_motor_effects,
    hub_force,
    step_backlash,
    supply_current,
    traction_scale,
)
from omnimj.physics.motor import LOOP, MOTOR_ROW, SUPPLY, achievable_current, next_current, stick_or_slip
from omnimj.physics.native import kernel
from omnimj.physics.traction import exact_step, force_ratio, relaxation_rate
from omnimj.physics.wheel import (
    INERTIA,
    RADIUS,
    ROLLER_DRY,
    ROLLER_VISCOUS,
    ROLLING,
    WHEEL_ROW,
    bearing_friction,
    blend_friction,
    mean_current,
    mean_deflection,
    motor_torque_bounds,
    roller_friction,
    wheel_row,
)

GRAVITY = 9.81

MASS, COM_X, COM_Y, YAW_INERTIA, SLOPE_X, SLOPE_Y = range(6)
BODY_ROW = 6
# columns that the robot appends to a wheel's row; NORMAL_X, _Y: normal force per m/s² of gravity along x, y
POSITION_X, POSITION_Y, DRIVE_X, DRIVE_Y, GRIP, NORMAL, NORMAL_X, NORMAL_Y = range(WHEEL_ROW, WHEEL_ROW + 8)
ROLLER_SIN, ROLLER_COS = WHEEL_ROW + 8, WHEEL_ROW + 9  # of the angle from the axle to the roller's axis
ROBOT_WHEEL_ROW = WHEEL_ROW + 10


@dataclass(frozen=True)
class PlanarConstants:
    """A robot's numbers for the kernels of `physics.planar`."""

    body: NDArray[np.float64]
    """Mass, centre of mass, yaw inertia about it, gravity along the floor in the world, shape (BODY_ROW,)."""
    wheels: NDArray[np.float64]
    """A row per wheel, shape (n, ROBOT_WHEEL_ROW)."""


def planar_constants(
    robot: Robot,
    misalignment: ArrayLike = 0.0,
    radius_scale: ArrayLike = 1.0,
    grip: ArrayLike = 1.0,
    payload: tuple[float, float, float] = (0.0, 0.0, 0.0),
    slope: tuple[float, float] = (0.0, 0.0),
) -> PlanarConstants:
    """A robot's numbers, with what is wrong with it.

    Args:
      robot: The robot.
      misalignment: Angle of each axle, counter-clockwise, scalar or (n,) [rad].
      radius_scale: True over nominal wheel radius, scalar or (n,).
      grip: Factor on the traction, scalar or (n,).
      payload: Mass [kg] and its place x, y in the body frame [m].
      slope: Inclination of the floor and the world direction that points downhill [rad].

    Raises:
      InputError: The payload leaves no mass, or lifts a wheel off the floor.
    """
    body = _body_row(robot, payload, slope)
    wheels = np.empty((len(robot.wheels), ROBOT_WHEEL_ROW))
    wheels[:, :WHEEL_ROW] = wheel_row(robot.wheel, robot.bearing, robot.motor)
    wheels[:, RADIUS] *= np.asarray(radius_scale, float)
    wheels[:, GRIP] = grip
    p, u = robot.wheel_positions, robot.drive_directions
    angle = np.asarray(misalignment, float)
    c, s = np.cos(angle), np.sin(angle)
    wheels[:, [POSITION_X, POSITION_Y]] = p
    wheels[:, [ROLLER_SIN, ROLLER_COS]] = [roller_sin_cos(mount.roller_angle) for mount in robot.wheels]
    wheels[:, DRIVE_X], wheels[:, DRIVE_Y] = c * u[:, 0] - s * u[:, 1], s * u[:, 0] + c * u[:, 1]
    # static balance Σ F_N = W, Σ p F_N = W r_c in least norm: m g/4 each on four wheels
    balance = np.vstack([np.ones(len(p)), p.T])
    share = np.linalg.pinv(balance)
    weight = body[MASS] * GRAVITY * math.cos(slope[0])
    wheels[:, NORMAL] = weight * (share @ [1.0, body[COM_X], body[COM_Y]])
    # a larger wheel compresses its spring, as far as the robot cannot give way by rising and tilting
    larger = robot.wheel.radius * (np.broadcast_to(radius_scale, len(p)) - 1.0)
    springs = robot.body.suspension_stiffness * (larger - share @ (balance @ larger))
    wheels[:, NORMAL] = np.maximum(wheels[:, NORMAL] + springs, np.minimum(wheels[:, NORMAL], 0.0))
    wheels[:, [NORMAL_X, NORMAL_Y]] = body[MASS] * robot.body.com_height * share[:, 1:]
    lightest = int(np.argmin(wheels[:, NORMAL]))
    if wheels[lightest, NORMAL] < 0.0:
        raise InputError(
            "payload", f"found (mass, x, y) = {payload}", f"lifts wheel {lightest + 1} off the floor"
        )
    return PlanarConstants(body, wheels)


def _body_row(
    robot: Robot, payload: tuple[float, float, float], slope: tuple[float, float]
) -> NDArray[np.float64]:
    """Mass, centre of mass and yaw inertia with the payload as a point, and gravity along the floor."""
    extra, x, y = payload
    mass = robot.body.mass + extra
    if mass <= 0.0:
        rule = f"must leave mass on the robot's {robot.body.mass:g} kg"
        raise InputError("payload.mass", f"found {extra:g}", rule)
    com = extra * np.array([x, y]) / mass
    inertia = robot.body.yaw_inertia + extra * (x * x + y * y) - mass * float(com @ com)
    if inertia <= 0.0:
        raise InputError("payload", f"found (mass, x, y) = {payload}", "leaves no yaw inertia")
    downhill = GRAVITY * math.sin(slope[0])
    return np.array([mass, *com, inertia, downhill * math.cos(slope[1]), downhill * math.sin(slope[1])])


# One wheel of the planar robot in one step: bristles, current, speed, angle and the play of its gear.


@kernel
def pose_offset(wheels):
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
def _wheel_x(wheel, state, pose):
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
        dry = axle_dry_friction(terms, low, high)
        other += axle_torque(terms, angle + play, wheel_speed + rate, h)
        if not published:
            bearing, viscous = bearing_friction(wheel, normal, aside)
            dry += bearing + wheel[ROLLING] * normal * wheel[RADIUS]
            other -= viscous * wheel_speed
        dry = max(dry, 0.0)
        if terms[BACKLASH] != 0.0:
            change, play, rate, _ = step_backlash(
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
        place = _wheel_x(wheel, state, pose_offset(n))
        traction *= traction_scale(terms, place)
        angle, time = state[4 * n + 3 + i], state[pose_offset(n) - 1]
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
def supply_currents(state, command, motors, terms, room, draws):
    """Fills `draws` with what the motors take at the voltage that they leave of a sagging supply [A].

    V = V_0 − R_s Σ i_j(V) has one solution, since no current falls with the voltage.
    """
    n = command.size
    time = state[pose_offset(n) - 1]
    low, high = 0.0, motors[0, SUPPLY]
    for _ in range(BISECTIONS):
        voltage, total = 0.5 * (low + high), 0.0
        for i in range(n):
            draws[i] = supply_current(motors[i], terms[i], time, voltage, command[i], state[n + i], room)
            total += draws[i]
        if voltage > motors[0, SUPPLY] - terms[0, SAG] * total:
            high = voltage
        else:
            low = voltage
    return total


# Planar model of a robot with n omni wheels, Eqs. 3.54-3.85: smooth right-hand side and fixed step.

__all__ = [
    "PlanarConstants",
    "derivative",
    "output_size",
    "planar_constants",
    "pose_offset",
    "state_size",
    "step",
]


def state_size(wheels: int) -> int:
    """Length of the state of `step` for n wheels."""
    return 7 * wheels + 7


def output_size(wheels: int) -> int:
    """Length of the output of `step`: slip, F_N, F, G (n each), acceleration (2), encoders' speeds (n)."""
    return 5 * wheels + 2


@kernel
def _gravity(body, yaw):
    """Gravity along the floor in the body frame [m/s²]."""
    c, s = math.cos(yaw), math.sin(yaw)
    return c * body[SLOPE_X] + s * body[SLOPE_Y], c * body[SLOPE_Y] - s * body[SLOPE_X]


@kernel
def _normal_force(wheel, gravity_x, gravity_y):
    """F_N on the (sloping) floor; a wheel cannot pull [N]."""
    return max(wheel[NORMAL] + wheel[NORMAL_X] * gravity_x + wheel[NORMAL_Y] * gravity_y, 0.0)


@kernel
def _body_force(wheel, body, ahead, aside):
    """Force of one wheel on the body and its moment about the centre of mass [N, N, N.m]."""
    x = ahead * wheel[DRIVE_X] + aside * wheel[DRIVE_Y]
    y = ahead * wheel[DRIVE_Y] - aside * wheel[DRIVE_X]
    return x, y, (wheel[POSITION_X] - body[COM_X]) * y - (wheel[POSITION_Y] - body[COM_Y]) * x


@kernel
def _twist_rate(body, f_x, f_y, moment, v_x, v_y, yaw_rate, published):
    """d(v_x, v_y, yaw rate)/dt of the robot's centre; the force accelerates the centre of mass."""
    spin = moment / body[YAW_INERTIA]
    rate_x = f_x / body[MASS] + spin * body[COM_Y]
    rate_y = f_y / body[MASS] - spin * body[COM_X]
    if not published:
        rate_x += yaw_rate * (v_y + yaw_rate * body[COM_X])
        rate_y -= yaw_rate * (v_x - yaw_rate * body[COM_Y])
    return rate_x, rate_y, spin


@kernel
def derivative(state, command, yaw, body, wheels, motors, floors, smoothing, published):
    """Right-hand side of Eqs. 3.63-3.85 for `scipy.integrate.solve_ivp`, sign(v) as tanh(v/smoothing).

    Args:
      state: [z | φ̇ | v_x, v_y, yaw rate], shape (2n+3,); or with the motor currents behind, shape (3n+3,).
      command: Current set values, shape (n,) [A]; without currents in the state the amplifiers have no lag.
      yaw: Heading, matters on a slope only [rad].
      body: `PlanarConstants.body`.
      wheels: `PlanarConstants.wheels`.
      motors: `motor.motor_row` per wheel, shape (n, MOTOR_ROW).
      floors: `Floor.row` per wheel, shape (n, ROW).
      smoothing: Speed over which friction changes its sign, at the rim for wheels [m/s].
      published: The equations as printed.

    Returns:
      d(state)/dt.
    """
    n = wheels.shape[0]
    v_x, v_y, yaw_rate = state[2 * n], state[2 * n + 1], state[2 * n + 2]
    g_x, g_y = _gravity(body, yaw)
    change = np.empty_like(state)
    f_x, f_y, moment = body[MASS] * g_x, body[MASS] * g_y, 0.0
    for i in range(n):
        wheel, motor, floor, wheel_speed = wheels[i], motors[i], floors[i], state[n + i]
        normal = _normal_force(wheel, g_x, g_y)
        along, across = wheel_velocity(wheel, v_x, v_y, yaw_rate)
        rim = wheel[RADIUS] * wheel_speed
        slip, sideways = contact_velocity(wheel, rim, along, across)
        rate = relaxation_rate(floor, slip, max(abs(rim), abs(along)))
        change[i] = slip - rate * state[i]
        traction = normal * wheel[GRIP] * force_ratio(floor, state[i], slip, rate)
        dry = wheel[ROLLER_DRY] * math.tanh(sideways / smoothing)
        drag = normal * (dry + wheel[ROLLER_VISCOUS] * sideways)
        ahead, aside = contact_force(wheel, traction, drag)
        current = achievable_current(motor, command[i], wheel_speed)
        if state.size > 2 * n + 3:
            change[2 * n + 3 + i] = (current - state[2 * n + 3 + i]) / motor[LOOP]
            current = state[2 * n + 3 + i]
        low, high = wheel_torque_bounds(wheel, motor, current, wheel_speed, normal, aside, published)
        torque = blend_friction(low, high, math.tanh(rim / smoothing))
        change[n + i] = (torque - wheel[RADIUS] * ahead) / wheel[INERTIA]
        x, y, z = _body_force(wheel, body, ahead, aside)
        f_x, f_y, moment = f_x + x, f_y + y, moment + z
    change[2 * n], change[2 * n + 1], change[2 * n + 2] = _twist_rate(
        body, f_x, f_y, moment, v_x, v_y, yaw_rate, published
    )
    return change


@kernel
def _step_body(n, state, body, f_x, f_y, moment, h, published):
    """Advances twist and pose: momentum in the body frame turns back by the yaw of the step."""
    old_x, old_y, old_rate = state[2 * n], state[2 * n + 1], state[2 * n + 2]
    yaw_rate = old_rate + h * moment / body[YAW_INERTIA]
    turn = 0.5 * h * (old_rate + yaw_rate)
    com_x = old_x - old_rate * body[COM_Y] + h * f_x / body[MASS]
    com_y = old_y + old_rate * body[COM_X] + h * f_y / body[MASS]
    if not published:
        c, s = math.cos(turn), math.sin(turn)
        com_x, com_y = c * com_x + s * com_y, c * com_y - s * com_x
    v_x, v_y = com_x + yaw_rate * body[COM_Y], com_y - yaw_rate * body[COM_X]
    state[2 * n], state[2 * n + 1], state[2 * n + 2] = v_x, v_y, yaw_rate
    pose = pose_offset(n)
    middle = state[pose + 2] + 0.5 * turn
    state[pose - 1] += h
    c, s = math.cos(middle), math.sin(middle)
    mean_x, mean_y = 0.5 * (old_x + v_x), 0.5 * (old_y + v_y)
    state[pose] += h * (c * mean_x - s * mean_y)
    state[pose + 1] += h * (s * mean_x + c * mean_y)
    state[pose + 2] += turn
    return (v_x - old_x) / h, (v_y - old_y) / h


@kernel
def _air_drag(body, coefficient, v_x, v_y):
    """Air drag −c |v| v at the robot's centre and its moment about the centre of mass [N, N, N.m]."""
    pull = -coefficient * math.sqrt(v_x * v_x + v_y * v_y)
    x, y = pull * v_x, pull * v_y
    return x, y, body[COM_Y] * x - body[COM_X] * y


@kernel
def step(state, command, body, wheels, motors, floors, terms, h, steps, published, output):
    """Advances the whole state by `steps` steps of h seconds, in place; stable at any slip speed.

    Exact for frozen speeds: bristles and currents; set-valued: friction of motor, gear, bearings and brake.

    Args:
      state: All of it, shape (7n+7,); changed in place.
      command: Current set values, shape (n,) [A].
      body: `PlanarConstants.body`.
      wheels: `PlanarConstants.wheels`.
      motors: `motor.motor_row` per wheel, shape (n, MOTOR_ROW).
      floors: `Floor.row` per wheel, shape (n, ROW).
      terms: Effects, a row of `effect_terms` per wheel, shape (n, TERMS); without effects zeros.
      h: Step [s].
      steps: How many.
      published: The equations as printed.
      output: Filled with slip, F_N, F, G (n each) and what an accelerometer at the centre reads along x and y
        (acceleration less gravity), of the last step, then the wheel speeds that the motors' encoders see,
        shape (5n+2,).
    """
    n = wheels.shape[0]
    changed, draws = np.empty(MOTOR_ROW), np.zeros(n)
    sagging = terms[0, SAG] != 0.0
    # drag acts on the body as a whole: it stands, shared, in the rows of all wheels
    drag = 0.0
    for i in range(n):
        drag += terms[i, AIR] / n
    for _ in range(steps):
        g_x, g_y = _gravity(body, state[pose_offset(n) + 2])
        v_x, v_y, yaw_rate = state[2 * n], state[2 * n + 1], state[2 * n + 2]
        f_x, f_y, moment = body[MASS] * g_x, body[MASS] * g_y, 0.0
        if drag != 0.0:
            x, y, z = _air_drag(body, drag, v_x, v_y)
            f_x, f_y, moment = f_x + x, f_y + y, moment + z
        load = supply_currents(state, command, motors, terms, changed, draws) if sagging else 0.0
        for i in range(n):
            wheel, motor = wheels[i], motors[i]
            normal = _normal_force(wheel, g_x, g_y)
            if has_motor_effects(terms[i]):
                apply_motor_effects(motor, terms[i], state[pose_offset(n) - 1], load - draws[i], changed)
                motor = changed
            ahead, aside = step_wheel(
                i, state, command, wheel, motor, floors[i], terms[i], normal, h, published, output
            )
            x, y, z = _body_force(wheel, body, ahead, aside)
            f_x, f_y, moment = f_x + x, f_y + y, moment + z
        a_x, a_y = _step_body(n, state, body, f_x, f_y, moment, h, published)
        if not published:
            a_x, a_y = a_x - yaw_rate * v_y, a_y + yaw_rate * v_x
        output[4 * n], output[4 * n + 1] = a_x - g_x, a_y - g_y
