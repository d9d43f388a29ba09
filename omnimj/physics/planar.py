"""Planar model of a robot with n omni wheels, Eqs. 3.54-3.85, by a fixed step.

The state is one row, `PlanarState` names its parts: [z (n) | φ̇ (n) | v_x, v_y, yaw rate | i (n) | roller
deflection (n) | wheel angle (n) | backlash (n) and its rate (n) | time | x, y, yaw]; twist in the body frame
at the robot's centre. The first 2n + 3 are the states of Eq. 3.54.

Corrections to the text: Coriolis terms m(ẍ − θ̇ẏ), m(ÿ + θ̇ẋ); sign of T_nl and of the gear's power flow;
viscous motor friction, bearing friction (Eqs. 4.37-4.38) and rolling resistance of the wheel (as a torque
r μ_rol F_N on it) and of the floor. `published` leaves all of these out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnimj.errors import InputError
from omnimj.parameters.floor import TRACTION_SIZE, TractionParameters
from omnimj.parameters.parts import GRAVITY
from omnimj.parameters.robot import Robot, roller_sin_cos
from omnimj.physics.effect_terms import ACTIVE, TERM, apply_motor_effects, has_motor_effects, terms_of_wheel
from omnimj.physics.motor import MOTOR_SIZE, MotorParameters
from omnimj.physics.native import first_numbers, inlined, kernel, row_numbers
from omnimj.physics.planar_wheel import (
    PLANAR_WHEEL_SIZE,
    DrivenWheel,
    PlanarOutput,
    PlanarState,
    PlanarWheel,
    step_wheel,
    supply_currents,
)
from omnimj.physics.wheel import WHEEL_SIZE, WheelParameters, packed, wheel_parameters


class PlanarBody(NamedTuple):
    """Body of the robot with its payload, on a slope."""

    mass: float
    """[kg]"""
    com_x: float
    """Centre of mass in the body frame [m]."""
    com_y: float
    """[m]"""
    yaw_inertia: float
    """About the centre of mass [kg.m²]."""
    slope_x: float
    """Gravity along the floor in the world [m/s²]."""
    slope_y: float
    """[m/s²]"""
    accelerometer_x: float
    """Place of the accelerometer in the body frame [m]."""
    accelerometer_y: float
    """[m]"""


BODY_SIZE = len(PlanarBody._fields)
"""Numbers of a packed body."""
_AIR, _SAG = TERM["air"], TERM["sag"]


class PlanarModel(NamedTuple):
    """Robot with n wheels, in packed rows as used by the kernels."""

    body: NDArray[np.float64]
    """`PlanarBody`, shape (BODY_SIZE,)."""
    wheels: NDArray[np.float64]
    """`PlanarWheel` per wheel, shape (n, PLANAR_WHEEL_SIZE)."""
    motors: NDArray[np.float64]
    """`MotorParameters` per wheel, shape (n, MOTOR_SIZE)."""
    floors: NDArray[np.float64]
    """`TractionParameters` of the floor under each wheel, shape (n, TRACTION_SIZE)."""
    terms: NDArray[np.float64]
    """`EffectTerms` per wheel, shape (n, TERMS)."""
    published: bool
    """The equations as printed."""


@dataclass(frozen=True)
class PlanarConstants:
    """Packed body and wheels of a robot, for `PlanarModel`."""

    body: NDArray[np.float64]
    """Shape (BODY_SIZE,)."""
    wheels: NDArray[np.float64]
    """Shape (n, PLANAR_WHEEL_SIZE)."""


def planar_constants(
    robot: Robot,
    misalignment: ArrayLike = 0.0,
    radius_scale: ArrayLike = 1.0,
    grip: ArrayLike = 1.0,
    payload: tuple[float, float, float] = (0.0, 0.0, 0.0),
    slope: tuple[float, float] = (0.0, 0.0),
) -> PlanarConstants:
    """Parameters of body and wheels, including misaligned axles, wrong radii, payload and slope.

    Args:
      robot: The robot.
      misalignment: Angle of each axle, counter-clockwise, scalar or shape (n,) [rad].
      radius_scale: True over nominal wheel radius, scalar or shape (n,).
      grip: Factor on the traction, scalar or shape (n,).
      payload: Mass [kg] and its position x, y in the body frame [m].
      slope: Inclination of the floor and the world direction that points downhill [rad].

    Raises:
      InputError: The payload leaves no mass, or lifts a wheel off the floor.
    """
    body, n = _body(robot, payload, slope), len(robot.wheels)
    scale, grips = np.broadcast_to(radius_scale, n), np.broadcast_to(grip, n)
    p, u = robot.wheel_positions, robot.drive_directions
    angle = np.asarray(misalignment, float)
    c, s = np.cos(angle), np.sin(angle)
    drive = np.column_stack([c * u[:, 0] - s * u[:, 1], s * u[:, 0] + c * u[:, 1]])
    # static balance Σ F_N = W, Σ p F_N = W r_c in least norm: m g/4 each on four wheels
    balance = np.vstack([np.ones(n), p.T])
    share = np.linalg.pinv(balance)
    normal = body.mass * GRAVITY * math.cos(slope[0]) * (share @ [1.0, body.com_x, body.com_y])
    # a larger wheel compresses its spring, as far as the robot cannot give way by rising and tilting
    larger = robot.wheel.radius * (scale - 1.0)
    springs = robot.body.suspension_stiffness * (larger - share @ (balance @ larger))
    normal = np.maximum(normal + springs, np.minimum(normal, 0.0))
    lightest = int(np.argmin(normal))
    if normal[lightest] < 0.0:
        found = f"found (mass, x, y) = {payload}"
        raise InputError("payload", found, f"lifts wheel {lightest + 1} off the floor")
    tilting = body.mass * robot.body.com_height * share[:, 1:]
    wheels = [
        PlanarWheel(
            wheel_parameters(robot.wheel, robot.bearing, robot.motor, float(scale[i])),
            float(p[i, 0]),
            float(p[i, 1]),
            float(drive[i, 0]),
            float(drive[i, 1]),
            float(grips[i]),
            float(normal[i]),
            float(tilting[i, 0]),
            float(tilting[i, 1]),
            *roller_sin_cos(mount.roller_angle),
        )
        for i, mount in enumerate(robot.wheels)
    ]
    return PlanarConstants(packed(body), np.array([packed(wheel) for wheel in wheels]))


def _body(robot: Robot, payload: tuple[float, float, float], slope: tuple[float, float]) -> PlanarBody:
    """Body with the payload as a point mass."""
    extra, x, y = payload
    mass = robot.body.mass + extra
    if mass <= 0.0:
        rule = f"must leave mass on the robot's {robot.body.mass:g} kg"
        raise InputError("payload.mass", f"found {extra:g}", rule)
    com_x, com_y = extra * x / mass, extra * y / mass
    moved = mass * (com_x * com_x + com_y * com_y)
    inertia = robot.body.yaw_inertia + extra * (x * x + y * y) - moved
    if inertia <= 0.0:
        raise InputError("payload", f"found (mass, x, y) = {payload}", "leaves no yaw inertia")
    downhill = GRAVITY * math.sin(slope[0])
    along_x, along_y = downhill * math.cos(slope[1]), downhill * math.sin(slope[1])
    place = robot.body.accelerometer_x, robot.body.accelerometer_y
    return PlanarBody(mass, com_x, com_y, inertia, along_x, along_y, *place)


def state_size(wheels: int) -> int:
    """Length of the state of `step` for n wheels."""
    return 7 * wheels + 7


def output_size(wheels: int) -> int:
    """Length of the output of `step` for n wheels."""
    return 5 * wheels + 2


@kernel
def body_at(row):
    """`PlanarBody` of a packed row, shape (BODY_SIZE,)."""
    return PlanarBody(*first_numbers(row, BODY_SIZE))


@inlined
def planar_state(row):
    """Views into a state, shape (state_size(n),), as `PlanarState`."""
    n = (row.size - 7) // 7
    late = 2 * n + 3  # behind the states of Eq. 3.54
    return PlanarState(
        row[:n],
        row[n : 2 * n],
        row[2 * n : late],
        row[late : late + n],
        row[late + n : late + 2 * n],
        row[late + 2 * n : late + 3 * n],
        row[late + 3 * n : late + 4 * n],
        row[late + 4 * n : late + 5 * n],
        row[late + 5 * n : late + 5 * n + 1],
        row[late + 5 * n + 1 :],
    )


@inlined
def planar_output(row):
    """Views into an output, shape (output_size(n),), as `PlanarOutput`."""
    n = (row.size - 2) // 5
    return PlanarOutput(
        row[:n],
        row[n : 2 * n],
        row[2 * n : 3 * n],
        row[3 * n : 4 * n],
        row[4 * n : 4 * n + 2],
        row[4 * n + 2 :],
    )


@inlined
def driven_wheel(model, i):
    """`DrivenWheel` i of a `PlanarModel`."""
    wheel = row_numbers(model.wheels, i, PLANAR_WHEEL_SIZE)
    return DrivenWheel(
        PlanarWheel(WheelParameters(*wheel[:WHEEL_SIZE]), *wheel[WHEEL_SIZE:]),
        MotorParameters(*row_numbers(model.motors, i, MOTOR_SIZE)),
        TractionParameters(*row_numbers(model.floors, i, TRACTION_SIZE)),
        model.published,
    )


@kernel
def _gravity(body, yaw):
    """Gravity along the floor in the body frame [m/s²]."""
    c, s = math.cos(yaw), math.sin(yaw)
    return c * body.slope_x + s * body.slope_y, c * body.slope_y - s * body.slope_x


@kernel
def _normal_force(wheel, gravity_x, gravity_y):
    """F_N on the (sloping) floor; a wheel cannot pull [N]."""
    return max(wheel.normal + wheel.normal_x * gravity_x + wheel.normal_y * gravity_y, 0.0)


@kernel
def body_force(wheel, body, ahead, aside):
    """Force of one wheel on the body and its moment about the centre of mass [N, N, N.m]."""
    x = ahead * wheel.drive_x + aside * wheel.drive_y
    y = ahead * wheel.drive_y - aside * wheel.drive_x
    return x, y, (wheel.position_x - body.com_x) * y - (wheel.position_y - body.com_y) * x


@inlined
def _step_body(state, body, force, h, published):
    """Advance twist and pose: momentum in the body frame turns back by the yaw of the step.

    Returns:
      Mean rates of v_x and v_y [m/s²].
    """
    f_x, f_y, moment = force
    old_x, old_y, old_rate = state.twist[0], state.twist[1], state.twist[2]
    yaw_rate = old_rate + h * moment / body.yaw_inertia
    turn = 0.5 * h * (old_rate + yaw_rate)
    com_x = old_x - old_rate * body.com_y + h * f_x / body.mass
    com_y = old_y + old_rate * body.com_x + h * f_y / body.mass
    if not published:
        c, s = math.cos(turn), math.sin(turn)
        com_x, com_y = c * com_x + s * com_y, c * com_y - s * com_x
    v_x, v_y = com_x + yaw_rate * body.com_y, com_y - yaw_rate * body.com_x
    state.twist[0], state.twist[1], state.twist[2] = v_x, v_y, yaw_rate
    middle = state.pose[2] + 0.5 * turn
    state.clock[0] += h
    c, s = math.cos(middle), math.sin(middle)
    mean_x, mean_y = 0.5 * (old_x + v_x), 0.5 * (old_y + v_y)
    state.pose[0] += h * (c * mean_x - s * mean_y)
    state.pose[1] += h * (s * mean_x + c * mean_y)
    state.pose[2] += turn
    return (v_x - old_x) / h, (v_y - old_y) / h


@inlined
def _motor_now(motor, packed_terms, i, time, other_current):
    """Motor of a wheel with effects, at a given time and load of the supply."""
    terms = terms_of_wheel(packed_terms, i)
    if not has_motor_effects(terms):
        return motor
    return apply_motor_effects(motor, terms, time, other_current)


@kernel
def _air_drag(body, coefficient, v_x, v_y):
    """Air drag −c |v| v at the robot's centre and its moment about the centre of mass [N, N, N.m]."""
    pull = -coefficient * math.sqrt(v_x * v_x + v_y * v_y)
    x, y = pull * v_x, pull * v_y
    return x, y, body.com_y * x - body.com_x * y


@kernel
def step(state, command, model, h, steps, output):
    """Advance the state by `steps` steps of h seconds, in place; stable at any slip velocity.

    Exact for frozen speeds: bristles and currents; set-valued: friction of motor, gear, bearings and brake.

    Args:
      state: Shape (state_size(n),), changed in place; its parts are those of `PlanarState`.
      command: Commanded currents, shape (n,) [A].
      model: `PlanarModel`.
      h: Step [s].
      steps: Number of steps.
      output: Filled with the result of the last step, shape (output_size(n),); see `PlanarOutput`.
    """
    now, found, body = planar_state(state), planar_output(output), body_at(model.body)
    n, published = command.size, model.published
    draws = np.zeros(n)
    sagging = model.terms[0, _SAG] != 0.0
    # drag acts on the body as a whole: it stands, shared, in the terms of all wheels
    drag = 0.0
    for i in range(n):
        drag += model.terms[i, _AIR] / n
    for _ in range(steps):
        g_x, g_y = _gravity(body, now.pose[2])
        v_x, v_y, yaw_rate = now.twist[0], now.twist[1], now.twist[2]
        f_x, f_y, moment = body.mass * g_x, body.mass * g_y, 0.0
        if drag != 0.0:
            x, y, z = _air_drag(body, drag, v_x, v_y)
            f_x, f_y, moment = f_x + x, f_y + y, moment + z
        load = supply_currents(now, command, model.motors, model.terms, draws) if sagging else 0.0
        for i in range(n):
            driven = driven_wheel(model, i)
            wheel, floor = driven.wheel, driven.floor
            if model.terms[i, ACTIVE] != 0.0:
                motor = _motor_now(driven.motor, model.terms, i, now.clock[0], load - draws[i])
                driven = DrivenWheel(wheel, motor, floor, published)
            normal = _normal_force(wheel, g_x, g_y)
            ahead, aside = step_wheel(i, now, command[i], driven, model.terms, normal, h, found)
            x, y, z = body_force(wheel, body, ahead, aside)
            f_x, f_y, moment = f_x + x, f_y + y, moment + z
        a_x, a_y = _step_body(now, body, (f_x, f_y, moment), h, published)
        if not published:
            a_x, a_y = a_x - yaw_rate * v_y, a_y + yaw_rate * v_x
        spin, square = (now.twist[2] - yaw_rate) / h, yaw_rate * yaw_rate
        found.acceleration[0] = a_x - g_x - spin * body.accelerometer_y - square * body.accelerometer_x
        found.acceleration[1] = a_y - g_y + spin * body.accelerometer_x - square * body.accelerometer_y
