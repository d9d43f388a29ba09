"""The kernels' numbers of a robot with its effects, for every stretch of a log."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from omnimj.effects import Applied, applied
from omnimj.effects import Channel as Reading
from omnimj.errors import InputError
from omnimj.gap import robot_kernels as native
from omnimj.gap.robot_runs import NAMES, STEP, RobotRuns
from omnimj.gap.uncertain import Based
from omnimj.parameters import Robot
from omnimj.physics.effect_terms import mark_active, write_curve
from omnimj.physics.motor import (
    EFFICIENCY,
    KT_SCALE,
    RATIO,
    TORQUE_CONSTANT,
    driven_by_measured_current,
    motor_row,
)
from omnimj.physics.planar_constants import PlanarConstants, planar_constants
from omnimj.signals import Array

_LAST_CURVE = 1  # the model file's own tabulated force has the first place
_LEAST_SCALE = 1e-3
_SHARES = (1.0, 0.7, 0.4, 0.0)  # of a payload's distance from the centre, until the robot can carry it


@dataclass(frozen=True)
class Numbers:
    """What `robot_kernels.replay` needs beside the log."""

    bodies: Array
    wheels: Array
    motors: Array
    floors: Array
    terms: Array
    sensors: Array
    per_torque: Array
    """Current per torque at each wheel, shape (4,) [A/(N.m)]."""


@dataclass(frozen=True)
class Curve:
    """A free force over one variable."""

    over: str
    force: Array
    low: float
    high: float


def numbers(based: Based[Robot], runs: RobotRuns, mass_scale: float, curve: Curve | None) -> Numbers:
    """All numbers of a robot.

    Args:
      based: The robot with its effects, its floors, its channels' lags.
      runs: Gives the declared mass and the floor of each stretch.
      mass_scale: True over declared mass.
      curve: A free force at every wheel.
    """
    changed = applied(based.machine)
    terms = changed.terms.copy()
    if curve is not None:
        write_curve(terms, _LAST_CURVE, curve.over, curve.force.tolist(), curve.low, curve.high)
        mark_active(terms)
    motors = changed.motor_rows(np.tile(motor_row(changed.machine.motor), (native.WHEELS, 1)))
    through = motors[:, TORQUE_CONSTANT] * motors[:, KT_SCALE] * motors[:, RATIO] * motors[:, EFFICIENCY]
    bodies, wheels = _constants(runs, changed, mass_scale)
    by_name = {name: changed.floor(based.floors[name]).row for name in set(runs.floor)}
    return Numbers(
        bodies,
        wheels,
        driven_by_measured_current(motors),
        np.stack([by_name[name] for name in runs.floor]),
        terms,
        _sensors(changed, based.lags),
        1.0 / through,
    )


def _constants(runs: RobotRuns, changed: Applied, mass_scale: float) -> tuple[Array, Array]:
    """Body and wheel rows of all stretches; the declared mass may differ from run to run."""
    made = {mass: _carrying(changed, mass * mass_scale) for mass in set(runs.mass.tolist())}
    rows = [made[mass] for mass in runs.mass.tolist()]
    return np.stack([r.body for r in rows]), np.stack([r.wheels for r in rows])


def _carrying(changed: Applied, mass: float) -> PlanarConstants:
    """The robot with its payload; one so far out that a wheel would lift is moved inward."""
    robot = dataclasses.replace(changed.machine, body=dataclasses.replace(changed.machine.body, mass=mass))
    extra, x, y = changed.payload
    for share in _SHARES:
        place = (extra, share * x, share * y)
        try:
            return planar_constants(
                robot, changed.misalignment, changed.radius_scale, 1.0, place, changed.slope
            )
        except InputError:
            if share == _SHARES[-1]:
                raise
    raise AssertionError  # the last share returns or raises


def readings(changed: Applied) -> tuple[Array, Array, Array]:
    """What sensor effects make of every channel: delay [s], scale and offset, shape (12,) each."""
    table = [changed.channels.get(name, Reading()) for name in NAMES]
    scale = [math.copysign(max(abs(change.scale), _LEAST_SCALE), change.scale) for change in table]
    return np.array([c.delay for c in table]), np.array(scale), np.array([c.offset for c in table])


def _sensors(changed: Applied, lags: Mapping[str, float]) -> Array:
    """Lateness in steps, scale and offset of every channel, shape (3, 12)."""
    late, scale, offset = readings(changed)
    late[native.SPEED : native.ACCELERATION] += lags["wheel_speed"]
    late[native.ACCELERATION : native.YAW_RATE] += lags["acceleration"]
    late[native.YAW_RATE] += lags["yaw_rate"]
    late[native.YAW] += lags["yaw"]
    return np.stack([late / STEP, scale, offset])
