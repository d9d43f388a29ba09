"""Motion of the body from a measured pose, for robots without an inertial unit.

Position and heading pass the Gaussian of all other channels, twice differentiated: G''∗p is the acceleration
behind that filter, turned into the body frame by the heading. Noise σ of pictures a time T apart makes noise
of the acceleration of σ √(3 T/(8 √π w⁵)), which sets the least width w. Cameras are late by more than a
filter can expand in a series: the delay is first found by comparing the body with its wheels, then, since
wheels slip before they drive, its acceleration with the motors' torques.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from omnimj.control.robot_constants import RobotConstants
from omnimj.estimate.robot.smoothing import Smoother, sample_noise
from omnimj.physics.kinematics import turned
from omnimj.recording.dataset import Run
from omnimj.signals import Array

POSE = ("x", "y", "heading")
"""Channels of a measured pose."""
ACCELERATION_NOISE, YAW_ACCELERATION_NOISE = 0.05, 0.2
"""Noise of the accelerations that the width of the filter aims at [m/s²], [rad/s²]."""
MOST_DELAY = 0.4
"""Longest delay of a camera [s]."""
_PICTURES = 2.0  # least width, in times between pictures
_WIDEST = 0.2  # [s]
_HELD = 3.0  # times between pictures after which a pose that repeats is one at rest
_LEAST_DELAY, _DELAYS = -0.05, 91  # [s] least delay of a camera, and tries up to the longest
_NOISE_GAIN = 3.0 / (8.0 * math.sqrt(math.pi))


class PoseSamples(NamedTuple):
    """New poses of a stretch, without those that a faster log repeats."""

    time: Array
    """Shape (k,) [s]."""
    pose: Array
    """x, y [m] and heading [rad], unwrapped, shape (k, 3)."""
    noise: Array
    """Noise of a sample: x, y [m], heading [rad], shape (3,)."""

    @property
    def period(self) -> float:
        """Time between pictures [s]."""
        return float(np.median(np.diff(self.time)))


def pose_samples(run: Run, part: slice) -> PoseSamples | None:
    """New poses of a stretch of a run; None if there are too few."""
    keep = np.ones(len(run.time[part]), bool)
    for name in POSE:
        if (bad := run.masked.get(name)) is not None:
            keep &= ~bad[part]
    time = run.time[part][keep]
    table = np.column_stack([run.columns[name][part][keep] for name in POSE])
    if len(time) < 10:
        return None
    fresh = np.concatenate(([True], (np.diff(table, axis=0) != 0.0).any(axis=1)))
    usual = float(np.median(np.diff(time[fresh]))) if fresh.sum() > 10 else float(np.median(np.diff(time)))
    kept, last = [], -math.inf
    for k, (now, new) in enumerate(zip(time.tolist(), fresh.tolist(), strict=True)):
        if new or now - last >= _HELD * usual:
            kept.append(k)
            last = now
    if len(kept) < 10:
        return None
    even = _even_times(time[kept], float(np.median(np.diff(time))))
    table = table[kept]
    table[:, 2] = np.unwrap(table[:, 2])
    return PoseSamples(even, table, np.array([sample_noise(values, 4) for values in table.T]))


def _even_times(time: Array, step: float) -> Array:
    """Times of pictures that come evenly but are read by a log with a step of its own, shape (k,) [s].

    Each picture seems late by up to a step, which at speed v makes noise of v times that. The times are
    returned as they are where they are not even within a step.
    """
    gaps = np.diff(time)
    period = float(gaps[gaps < 1.5 * np.median(gaps)].mean())
    number = np.concatenate(([0.0], np.cumsum(np.round(gaps / period))))
    if period < 1.5 * step or number[-1] < 10.0:
        return time
    even = np.asarray(np.polyval(np.polyfit(number, time, 1), number), float)
    return even if np.abs(time - even).max() <= step else time


def least_width(samples: PoseSamples) -> float:
    """Width of the Gaussian from which on the accelerations are quiet enough to be of use [s]."""
    aims = (ACCELERATION_NOISE, ACCELERATION_NOISE, YAW_ACCELERATION_NOISE)
    needed = [
        ((noise / aim) ** 2 * _NOISE_GAIN * samples.period) ** 0.2
        for noise, aim in zip(samples.noise, aims, strict=True)
    ]
    return min(max(*needed, _PICTURES * samples.period), _WIDEST)


class BodyMotion(NamedTuple):
    """Motion of the body's origin at m rows, in the body frame."""

    acceleration: Array
    """Readings of an ideal accelerometer at the origin on level ground, shape (m, 2) [m/s²]."""
    yaw_rate: Array
    """Shape (m,) [rad/s]."""
    yaw_acceleration: Array
    """Shape (m,) [rad/s²]."""
    velocity: Array
    """Over ground, shape (m, 2) [m/s]; without columns where it was not measured."""


def motion_of_pose(samples: PoseSamples, smoother: Smoother, late: float) -> BodyMotion:
    """Motion of the body from its measured pose, whose delay [s] is taken back."""
    # straight lines between pictures are a low pass themselves, of variance T²/6
    line = (samples.period**2 - smoother.period**2) / 6.0
    width = math.sqrt(max(smoother.width**2 - line, 0.25 * smoother.width**2))
    # from the first pose on: digits are not lost far from the camera's origin
    even = [smoother.even(samples.time, values - values[0]) for values in samples.pose.T]

    def derivative(order: int) -> list[Array]:
        return [smoother.filtered(values, late, order, width) for values in even]

    heading = derivative(0)[2] + samples.pose[0, 2]
    vx, vy, yaw_rate = derivative(1)
    ax, ay, yaw_acceleration = derivative(2)
    acceleration, velocity = (turned(np.column_stack(xy), -heading) for xy in ((ax, ay), (vx, vy)))
    return BodyMotion(acceleration, yaw_rate, yaw_acceleration, velocity)


def delay_behind_wheels(samples: PoseSamples, speeds: Array, smoother: Smoother, c: RobotConstants) -> float:
    """Delay of the pose behind the wheels [s]: with it, wheels and body move alike.

    Minimises the mean square of r φ̇ − A·twist(t + delay) over the rows.

    Args:
      speeds: Wheel speeds at the rows, their own delay taken back, shape (m, n) [rad/s].
    """
    rolling = c.radius * speeds

    def misfit(late: float) -> float:
        motion = motion_of_pose(samples, smoother, late)
        twist = np.column_stack([motion.velocity, motion.yaw_rate])
        return float(np.mean((rolling - twist @ c.forces) ** 2))

    tries = np.linspace(_LEAST_DELAY, MOST_DELAY, _DELAYS)
    best = float(tries[np.argmin([misfit(late) for late in tries])])
    step = float(tries[1] - tries[0])
    found = minimize_scalar(misfit, bounds=(best - step, best + step), method="bounded")
    return float(found.x)


def delay_behind_torques(time: Array, predicted: Array, measured: Array) -> float:
    """Delay [s] of measured accelerations behind those that the torques predict, shape (m, 3) each.

    Maximises Σ ρ² of the three channels: the constants of the prediction may be wrong.
    """
    spline, shift = CubicSpline(time, measured), MOST_DELAY / 2.0
    inner = (time > time[0] + shift) & (time < time[-1] - shift)
    if inner.sum() < 30:
        return 0.0

    def unlike(late: float) -> float:
        found = spline(time[inner] + late)
        pairs = zip(predicted[inner].T, found.T, strict=True)
        return -sum(float(np.corrcoef(u, y)[0, 1]) ** 2 for u, y in pairs if u.std() > 0.0 < y.std())

    tries = np.arange(-shift, shift, 0.01)
    best = float(tries[np.argmin([unlike(late) for late in tries])])
    return float(minimize_scalar(unlike, bounds=(best - 0.01, best + 0.01), method="bounded").x)
