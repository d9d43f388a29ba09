"""The kinematic level of section 6.1: wheels follow their speeds at once, the body follows by a matrix.

Inverse kinematics, the response of the wheels and the forward map are all linear, so the whole robot is one
3×3 matrix from demanded to actual body twist; only its heading makes the path curved.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from omnimj.control.cascade.allocation import checked_weights, published_map
from omnimj.parameters import Robot
from omnimj.physics.kinematics import rolling_matrix, weighted_inverse
from omnimj.signals import Array, Reference, Trace
from omnimj.simulate.driving import TARGET_NAMES
from omnimj.simulate.loop import NO_CALLBACKS, Callbacks, record


@dataclass(frozen=True)
class KinematicCase:
    """Kinematics of the robot, allocation weights, and faults at the kinematic level."""

    plant: str = "corrected"
    """`published`: twist = J V with J of Eq. 3.5 as printed; `corrected`: least squares of V = A·twist."""
    weights: tuple[float, ...] = ()
    """W_i of Eq. 3.11 from `weights_from` on, shape (n,); all are 1 before, and always if empty."""
    weights_from: float = 0.0
    """Time from which the weights apply [s]."""
    lost_wheel: int | None = None
    """Wheel 1…n whose demand is lost; None: no wheel."""
    lost_from: float = 0.0
    """Time from which the demand is lost [s]."""
    lost_wheel_turns_freely: bool = False
    """True if the lost wheel rolls without resistance; otherwise it stands still (V_i = 0) and drags."""
    misalignment: tuple[float, ...] = ()
    """Angle of each wheel about the vertical, counter-clockwise, shape (n,) [rad]; empty: 0."""


class KinematicCommand(NamedTuple):
    """Demanded motion, held for one period."""

    velocity_x: float
    """Velocity along the world's x axis [m/s]."""
    velocity_y: float
    """Velocity along the world's y axis [m/s]."""
    yaw_rate: float
    """Yaw rate [rad/s]."""
    frame: float | None
    """Heading by which the velocity is rotated into the body frame [rad]; None: that of the robot."""


class KinematicState(NamedTuple):
    """Measurement of the kinematic plant."""

    time: float
    """Time of the measurement [s]."""
    heading: float
    """Heading in the world frame [rad]."""


@dataclass(frozen=True)
class _Phase:
    """Matrices of an interval with constant weights and faults."""

    wheels: Array
    """Demanded body twist → rolling speeds of the wheels, shape (n, 3)."""
    body: Array
    """Demanded body twist → body twist, shape (3, 3)."""


class KinematicPlant:
    """A robot without forces and lags, on the interface of a plant; commands are twists, not currents.

    The heading is integrated with RK4, the demand being rotated continuously.
    """

    truth_names: tuple[str, ...] = ("x", "y", "heading")

    def __init__(
        self,
        robot: Robot,
        case: KinematicCase,
        period: float,
        start: tuple[float, float, float] = (0.0, 0.0, 0.0),
        yaw_gain: float = 0.0,
    ):
        """Put a robot at its start.

        Args:
          robot: Geometry.
          case: Kinematics, weights, faults; `read_kinematics` checks that they fit the robot.
          period: Control period [s].
          start: x, y [m] and heading [rad].
          yaw_gain: Gain K of the yaw-rate loop ω_c = ω_d + K (ω_d − ω) [1]; the loop is at its fixed point,
            since nothing here has a lag. 0 is open loop.
        """
        self.period, self.wheels, self._radius = period, len(robot.wheels), robot.wheel.radius
        self._case, self._start = case, start
        self._phases = _phases(robot, case, yaw_gain)
        self._bodies = {key: phase.body.tolist() for key, phase in self._phases.items()}
        self._pose, self._k = start, 0

    def reset(self) -> Any:
        """Put the robot at its start and return the first measurement."""
        self._pose, self._k = self._start, 0
        return KinematicState(0.0, self._pose[2])

    def step(self, command: Any) -> Any:
        """Hold a `KinematicCommand` for one period and return the measurement at its end."""
        body, h, (x, y, heading) = self._bodies[self._key()], self.period, self._pose
        a = _rate(heading, command, body)
        b = _rate(heading + 0.5 * h * a[2], command, body)
        c = _rate(heading + 0.5 * h * b[2], command, body)
        d = _rate(heading + h * c[2], command, body)
        dx, dy, turned = (
            h / 6.0 * (p + 2.0 * q + 2.0 * r + s) for p, q, r, s in zip(a, b, c, d, strict=True)
        )
        self._pose, self._k = (x + dx, y + dy, heading + turned), self._k + 1
        return KinematicState(self._k * h, self._pose[2])

    def truth(self) -> Array:
        """True x, y [m] and heading [rad], shape (3,)."""
        return np.array(self._pose)

    def response(self, command: KinematicCommand) -> Array:
        """Immediate response: body twist [m/s, rad/s] and wheel speeds [rad/s], shape (3 + n,)."""
        frame = self._pose[2] if command.frame is None else command.frame
        c, s = math.cos(frame), math.sin(frame)
        vx, vy = command.velocity_x, command.velocity_y
        demand = np.array([c * vx + s * vy, c * vy - s * vx, command.yaw_rate])
        phase = self._phases[self._key()]
        return np.concatenate([phase.body @ demand, phase.wheels @ demand / self._radius])

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def _key(self) -> tuple[bool, bool]:
        now = self._k * self.period + 1e-9
        return now >= self._case.weights_from, now >= self._case.lost_from


class _FollowTwists:
    """Policy that commands the samples of a reference in turn."""

    names = ("time",)

    def __init__(self, plant: KinematicPlant, reference: Reference, heading_feedback: bool):
        wheels = (f"wheel_speed_{i}" for i in range(1, plant.wheels + 1))
        self.target_names = ("twist_x", "twist_y", "twist_yaw", *wheels, *TARGET_NAMES)
        self._plant, self._feedback = plant, heading_feedback
        self._plan = np.column_stack([reference.position, reference.heading, reference.velocity])
        self._samples = np.column_stack([reference.velocity, reference.yaw_rate, reference.heading]).tolist()
        self._k = 0

    def command(self, measurement: KinematicState, row: Array) -> Any:
        vx, vy, yaw_rate, heading = self._samples[self._k]
        command = KinematicCommand(vx, vy, yaw_rate, None if self._feedback else heading)
        row[0] = measurement.time
        row[-len(self.target_names) : -5] = self._plant.response(command)
        row[-5:] = self._plan[self._k]
        self._k += 1
        return command


def drive_kinematic(
    plant: KinematicPlant,
    reference: Reference,
    heading_feedback: bool = True,
    callbacks: Callbacks = NO_CALLBACKS,
    about: Mapping[str, Any] | None = None,
) -> Trace:
    """Drive a robot along a reference at the kinematic level.

    Args:
      plant: Reset by this call, to the first sample of the reference.
      reference: Planned motion, sampled at the plant's period.
      heading_feedback: Whether demands are rotated by the robot's heading instead of the planned one.
      callbacks: Callbacks for progress and live view.
      about: Description of the run.

    Returns:
      Columns time, x, y, heading, twist_x, twist_y, twist_yaw, wheel_speed_i and `TARGET_NAMES`; described as
      in `loop.record`.
    """
    policy = _FollowTwists(plant, reference, heading_feedback)
    return record(plant, policy, plant.reset(), len(reference.time), callbacks, about)


def _phases(robot: Robot, case: KinematicCase, yaw_gain: float) -> dict[tuple[bool, bool], _Phase]:
    """Matrices by (weights apply, wheel is lost)."""
    n = len(robot.wheels)
    angles = np.array(case.misalignment or [0.0] * n)
    weights = {False: np.ones(n), True: checked_weights(case.weights or None, n)}
    return {
        (weighted, lost): _phase(robot, case, weights[weighted], lost, angles, yaw_gain)
        for weighted in (False, True)
        for lost in (False, True)
    }


def _phase(
    robot: Robot, case: KinematicCase, weights: Array, lost: bool, angles: Array, yaw_gain: float
) -> _Phase:
    """Matrices of one combination of weights (n,), lost wheel and misalignment angles (n,) [rad]."""
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


def _rate(heading: float, command: KinematicCommand, body: list[list[float]]) -> tuple[float, float, float]:
    """World velocity R(θ) M R(θ_f)ᵀ v and yaw rate; plain floats, since small arrays are slower."""
    vx, vy, w, frame = command
    c, s = math.cos(heading), math.sin(heading)
    cf, sf = (c, s) if frame is None else (math.cos(frame), math.sin(frame))
    bx, by = cf * vx + sf * vy, cf * vy - sf * vx
    tx, ty, tw = (row[0] * bx + row[1] * by + row[2] * w for row in body)
    return c * tx - s * ty, s * tx + c * ty, tw
