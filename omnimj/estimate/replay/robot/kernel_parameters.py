"""Robot with its effects in the form of the kernels, for every stretch of a log; geometry of the rollers."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from omnimj.effects import AppliedEffects, apply_effects
from omnimj.effects import ChannelEffect as Reading
from omnimj.estimate.replay.base_parameters import (
    AdjustedMachine,
    FreeCurve,
    standing_constants,
    with_free_curve,
)
from omnimj.estimate.replay.robot import kernels as native
from omnimj.estimate.replay.robot.runs import NAMES, STEP, RobotRuns
from omnimj.parameters import Robot
from omnimj.parameters.parts import GRAVITY
from omnimj.physics.motor import driven_by_measured_current, motor_parameters
from omnimj.signals import Array

_LEAST_SCALE = 1e-3
POINTS = 96
"""Points of the roller tables over one pitch."""


def kernel_parameters(
    based: AdjustedMachine[Robot], runs: RobotRuns, mass_scale: float, curve: FreeCurve | None
) -> native.KernelParameters:
    """Kernel parameters of a robot.

    Args:
      mass_scale: True over declared mass.
      curve: Free force at every wheel.
    """
    changed = apply_effects(based.machine)
    terms = with_free_curve(changed.terms, curve)
    motors = changed.motors([motor_parameters(changed.machine.motor)] * native.WHEELS)
    through = [m.torque_constant * m.torque_scale * m.gear_ratio * m.gear_efficiency for m in motors]
    bodies, wheels = _constants(runs, changed, mass_scale)
    by_name = {name: changed.floor(based.floors[name]).row for name in set(runs.floor)}
    return native.KernelParameters(
        bodies,
        wheels,
        np.array([driven_by_measured_current(motor) for motor in motors]),
        np.stack([by_name[name] for name in runs.floor]),
        terms,
        _sensors(changed, based.lags),
        1.0 / np.array(through),
    )


def _constants(runs: RobotRuns, changed: AppliedEffects, mass_scale: float) -> tuple[Array, Array]:
    """Packed bodies and wheels of all stretches; the declared mass may differ from run to run."""
    made = {mass: standing_constants(changed, mass * mass_scale) for mass in set(runs.mass.tolist())}
    rows = [made[mass] for mass in runs.mass.tolist()]
    return np.stack([r.body for r in rows]), np.stack([r.wheels for r in rows])


def sensor_readings(changed: AppliedEffects) -> tuple[Array, Array, Array]:
    """Delay [s], scale and offset of every channel by its sensor effects, shape (12,) each."""
    table = [changed.channels.get(name, Reading()) for name in NAMES]
    scale = [math.copysign(max(abs(change.scale), _LEAST_SCALE), change.scale) for change in table]
    return np.array([c.delay for c in table]), np.array(scale), np.array([c.offset for c in table])


def _sensors(changed: AppliedEffects, lags: Mapping[str, float]) -> Array:
    """Delay [steps], scale and offset of every channel, shape (3, 12)."""
    late, scale, offset = sensor_readings(changed)
    late[native.SPEED : native.ACCELERATION] += lags["wheel_speed"]
    late[native.ACCELERATION : native.YAW_RATE] += lags["acceleration"]
    late[native.YAW_RATE] += lags["yaw_rate"]
    late[native.YAW] += lags["yaw"]
    return np.stack([late / STEP, scale, offset])


def roller_tables(robot: Robot) -> Array:
    """Roller tables of a robot's wheels under their static load over one pitch, shape (3, POINTS).

    They start with a roller of the first row at the lowest point.

    Returns:
      Place of the contact along the axle z × u [m], torque on the wheel over normal force [m], and the pitch,
      the angle between two rollers of a row [rad].
    """
    wheel = robot.wheel
    pitch = 2.0 * np.pi / wheel.rollers_per_row
    angle = np.arange(POINTS) / POINTS * pitch
    depth = robot.body.mass * GRAVITY / (len(robot.wheels) * robot.contact.stiffness)
    rows = np.arange(wheel.rows)
    # from the lowest point to the nearest roller of each row, shape (rows, POINTS)
    off = np.mod(angle[None, :] - rows[:, None] * pitch / wheel.rows + 0.5 * pitch, pitch) - 0.5 * pitch
    long = wheel.radius * wheel.roller_radius
    root = np.sqrt(wheel.roller_radius**2 * np.cos(off) ** 2 + long * np.sin(off) ** 2)
    reach = (wheel.radius - wheel.roller_radius) * np.cos(off) + root
    slope = -(wheel.radius - wheel.roller_radius) * np.sin(off)
    slope += (long - wheel.roller_radius**2) * np.sin(off) * np.cos(off) / root
    depths = np.maximum(depth + reach - reach.max(axis=0), 0.0)
    share = depths / depths.sum(axis=0)
    side = wheel.row_offset * np.linspace(1.0, -1.0, wheel.rows) if wheel.rows > 1 else np.zeros(1)
    place = (share * side[:, None]).sum(axis=0)
    # virtual work: F_N lifts the axle by d(reach) per turn, so the wheel is pushed the other way
    torque = -(share * slope).sum(axis=0)
    return np.stack([place, torque, np.full(POINTS, pitch)])


def lean_shares(robot: Robot) -> tuple[float, float]:
    """Relative error of an accelerometer on the springs along x and y: m g h/(k Σ p²).

    An accelerating body leans back and its accelerometer sees some of gravity.
    """
    body = robot.body
    sprung = body.mass - len(robot.wheels) * body.unsprung_mass
    stiffness = body.suspension_stiffness * (robot.wheel_positions**2).sum(axis=0)
    x, y = (sprung * GRAVITY * body.com_height / stiffness).tolist()
    return x, y
