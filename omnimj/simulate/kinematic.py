"""The kinematic level of section 6.1: wheel speeds are obeyed at once, the body follows by a matrix.

Inverse kinematics, what the wheels do with their demands, and the forward map are all linear, so that the
whole robot is one 3×3 matrix from demanded to driven body twist; only its heading makes the path curved.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnimj.control.cascade.allocation import SCALES, checked_weights, published_map
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Robot
from omnimj.physics.kinematics import rolling_matrix, weighted_inverse
from omnimj.signals import Array, Reference, Trace


@dataclass(frozen=True)
class KinematicCase:
    """A robot without forces, and what is wrong with it."""

    plant: str = "corrected"
    """`published`: twist = J V with J of Eq. 3.5 as printed; `corrected`: least squares of V = A·twist."""
    weights: tuple[float, ...] = ()
    """W_i of Eq. 3.11 from `weights_from` on, all 1 before; none given: 1."""
    weights_from: float = 0.0
    """[s]."""
    lost_wheel: int | None = None
    """The wheel 1…n whose demand is lost."""
    lost_from: float = 0.0
    """[s]."""
    lost_wheel_turns_freely: bool = False
    """Whether the lost wheel rolls along without resistance; else it stands still (V_i = 0) and drags."""
    misalignment: tuple[float, ...] = ()
    """Angle by which each wheel is turned about its vertical, counter-clockwise [rad]; none given: 0."""


@dataclass(frozen=True)
class _Phase:
    """The matrices of a stretch of time in which nothing changes."""

    wheels: Array
    """Demanded body twist → rolling speeds that the wheels turn at, shape (n, 3)."""
    body: Array
    """Demanded body twist → body twist, shape (3, 3)."""


def drive_kinematic(
    robot: Robot,
    reference: Reference,
    case: KinematicCase,
    yaw_gain: float = 0.0,
    heading_feedback: bool = True,
    about: Mapping[str, Any] | None = None,
) -> Trace:
    """Drives a reference at the kinematic level.

    World demands are held for one sample and rotated continuously by the robot's heading (or by the planned
    one); the heading is integrated with RK4. The yaw-rate loop ω_c = ω_d + K (ω_d − ω) is at its fixed
    point, since nothing here has a lag.

    Args:
      robot: Geometry.
      reference: Planned motion; the robot starts on its first sample.
      case: Plant, weights, faults.
      yaw_gain: K of the yaw-rate loop [1]; 0 is open loop.
      heading_feedback: Whether demands are rotated by the robot's own heading.
      about: What the run is.

    Returns:
      Columns time, x, y, heading, twist_x, twist_y, twist_yaw, wheel_speed_i, and the plan: target_x,
      target_y, target_heading, target_velocity_x, target_velocity_y.

    Raises:
      UnknownNameError: No such plant.
      InputError: Weights, wheel or angles that do not fit the robot.
    """
    phases = _phases(robot, case, yaw_gain)
    time = reference.time
    now = [(t >= case.weights_from - 1e-9, t >= case.lost_from - 1e-9) for t in time.tolist()]
    pose = _integrated(reference, [phases[key].body.tolist() for key in now], heading_feedback)
    frame = pose[:, 2] if heading_feedback else reference.heading
    demand = np.column_stack([_to_body(reference.velocity, frame), reference.yaw_rate])
    twist, wheel_speed = np.empty_like(demand), np.empty((len(time), len(robot.wheels)))
    chosen = np.array(now)
    for key, phase in phases.items():
        rows = np.all(chosen == key, axis=1)
        twist[rows] = demand[rows] @ phase.body.T
        wheel_speed[rows] = demand[rows] @ phase.wheels.T / robot.wheel.radius
    columns = {"time": time, "x": pose[:, 0], "y": pose[:, 1], "heading": pose[:, 2]}
    columns |= {"twist_x": twist[:, 0], "twist_y": twist[:, 1], "twist_yaw": twist[:, 2]}
    columns |= {f"wheel_speed_{i}": speed for i, speed in enumerate(wheel_speed.T, start=1)}
    return Trace(columns | _plan(reference), about or {})


def largest_deviation(trace: Trace) -> float:
    """Largest distance between the robot and where it should be at that instant [m]."""
    away = np.hypot(trace["x"] - trace["target_x"], trace["y"] - trace["target_y"])
    return float(away.max())


def _phases(robot: Robot, case: KinematicCase, yaw_gain: float) -> dict[tuple[bool, bool], _Phase]:
    """By (weights hold, wheel is lost)."""
    n = len(robot.wheels)
    if case.plant not in SCALES:
        raise UnknownNameError("kinematic plant", "plant", case.plant, SCALES)
    if case.lost_wheel is not None and not 1 <= case.lost_wheel <= n:
        raise InputError("lost_wheel", f"found {case.lost_wheel}", f"must be 1 to {n}")
    angles = np.array(case.misalignment or [0.0] * n)
    if angles.shape != (n,) or not np.all(np.isfinite(angles)):
        raise InputError(
            "misalignment", f"found {list(case.misalignment)}", f"must be {n} angles, one per wheel"
        )
    weights = {False: np.ones(n), True: checked_weights(case.weights or None, n)}
    return {
        (weighted, lost): _phase(robot, case, weights[weighted], lost, angles, yaw_gain)
        for weighted in (False, True)
        for lost in (False, True)
    }


def _phase(
    robot: Robot, case: KinematicCase, weights: Array, lost: bool, angles: Array, yaw_gain: float
) -> _Phase:
    p, u = robot.wheel_positions, robot.rolling_directions
    turned = np.column_stack(
        [
            u[:, 0] * np.cos(angles) - u[:, 1] * np.sin(angles),
            u[:, 0] * np.sin(angles) + u[:, 1] * np.cos(angles),
        ]
    )
    works = np.ones(len(u))
    if lost and case.lost_wheel is not None:
        works[case.lost_wheel - 1] = 0.0
    if case.plant == "published":
        wheels = weighted_inverse(published_map(p, u), weights)
        forward = published_map(p, turned)
    else:
        wheels = weighted_inverse(np.linalg.pinv(rolling_matrix(p, u)), weights)
        grips = works if case.lost_wheel_turns_freely else np.ones(len(u))
        forward = np.linalg.pinv(rolling_matrix(p, turned) * grips[:, None])
    wheels = wheels * works[:, None]
    loop = _yaw_loop(forward @ wheels, yaw_gain)
    return _Phase(wheels @ loop, forward @ wheels @ loop)


def _yaw_loop(body: Array, gain: float) -> Array:
    """Body demand (v_x, v_y, ω_d) → (v_x, v_y, ω_c) with ω_c = ω_d + K (ω_d − ω) and ω = row 3 of `body`.

    Solved for ω_c: (1 + K m_33) ω_c = (1 + K) ω_d − K (m_31 v_x + m_32 v_y).
    """
    m31, m32, m33 = body[2]
    loop = np.eye(3)
    loop[2] = np.array([-gain * m31, -gain * m32, 1.0 + gain]) / (1.0 + gain * m33)
    return loop


def _to_body(velocity: Array, heading: Array) -> Array:
    c, s = np.cos(heading), np.sin(heading)
    return np.column_stack([c * velocity[:, 0] + s * velocity[:, 1], c * velocity[:, 1] - s * velocity[:, 0]])


def _integrated(reference: Reference, bodies: list[list[list[float]]], heading_feedback: bool) -> Array:
    """x, y [m], heading [rad] at every sample, shape (k, 3)."""
    time, velocity = reference.time.tolist(), reference.velocity.tolist()
    planned, yaw_rate = reference.heading.tolist(), reference.yaw_rate.tolist()
    x, y, heading = (*reference.position[0].tolist(), planned[0])
    poses = [(x, y, heading)]
    for k in range(len(time) - 1):
        h, (vx, vy), w, body = time[k + 1] - time[k], velocity[k], yaw_rate[k], bodies[k]
        frame = None if heading_feedback else planned[k]
        a = _rate(heading, frame, vx, vy, w, body)
        b = _rate(heading + 0.5 * h * a[2], frame, vx, vy, w, body)
        c = _rate(heading + 0.5 * h * b[2], frame, vx, vy, w, body)
        d = _rate(heading + h * c[2], frame, vx, vy, w, body)
        x += h / 6.0 * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0])
        y += h / 6.0 * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1])
        heading += h / 6.0 * (a[2] + 2.0 * b[2] + 2.0 * c[2] + d[2])
        poses.append((x, y, heading))
    return np.array(poses)


def _rate(
    heading: float, frame: float | None, vx: float, vy: float, w: float, body: list[list[float]]
) -> tuple[float, float, float]:
    """World velocity R(θ) M R(θ_f)ᵀ v and yaw rate; plain floats, since small arrays are slower."""
    c, s = math.cos(heading), math.sin(heading)
    cf, sf = (c, s) if frame is None else (math.cos(frame), math.sin(frame))
    bx, by = cf * vx + sf * vy, cf * vy - sf * vx
    tx, ty, tw = (row[0] * bx + row[1] * by + row[2] * w for row in body)
    return c * tx - s * ty, s * tx + c * ty, tw


def _plan(reference: Reference) -> dict[str, Array]:
    return {
        "target_x": reference.position[:, 0],
        "target_y": reference.position[:, 1],
        "target_heading": reference.heading,
        "target_velocity_x": reference.velocity[:, 0],
        "target_velocity_y": reference.velocity[:, 1],
    }
