"""Logs of a robot as rows every 30 ms: every channel behind the same low pass, all at the same instant.

A product of two signals needs both behind the same filter, and a derivative needs the filter of what is
differentiated: all channels pass one Gaussian, and derivatives are taken by its own derivative, exact in
between. The filter looks both ways, so that it delays nothing; what the sensors delay is taken back. It is
slow enough that the yaw loop, which answers the gyro's noise with torque, does not bias what torque does to
the yaw rate. The body's motion comes from the inertial unit, or from a measured pose.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from omnimj.control.robot_constants import robot_constants
from omnimj.errors import InputError
from omnimj.estimate.replay.stretches import split_at_gaps
from omnimj.estimate.robot.measured_pose import (
    MOST_DELAY,
    POSE,
    BodyMotion,
    PoseSamples,
    delay_behind_wheels,
    least_width,
    motion_of_pose,
    pose_samples,
)
from omnimj.estimate.robot.smoothing import Shafts, Smoother, sample_noise, shafts_of, together
from omnimj.parameters import Robot
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array, robot_channels

PERIOD = 0.03
"""Time from row to row [s]."""
WIDTH = 0.03
"""Standard deviation of the Gaussian [s]; two samples of the log where these are further apart."""
LOWEST_RATE, LOWEST_POSE_RATE = 50.0, 20.0
"""Lowest sample rates at which a current still shows what it does to the speed [1/s]: with an inertial unit,
and with a measured pose, whose wider filter averages more of them."""
_GAP, _GAP_PERIODS = 0.02, 5.0  # [s] and samples: a longer time without samples ends a stretch
_SHORTEST = 0.5  # [s] of a stretch
_NEAR = 4.0  # widths to either side over which a wheel's slowest speed counts, and that a bad sample spoils
_STILL = 0.3  # [rad/s] below which a wheel stands
_REST = 0.3  # [s] shortest rest that counts


@dataclass(frozen=True)
class RunRows:
    """m rows of one run of a robot with n wheels."""

    name: str
    floor: str
    time: Array
    """Since the start of the log, shape (m,) [s]."""
    current: Array
    """Shape (m, n) [A]."""
    shafts: Shafts
    """Currents and speeds at more times than the rows'."""
    wheel_speed: Array
    """Shape (m, n) [rad/s]."""
    wheel_acceleration: Array
    """Shape (m, n) [rad/s²]."""
    acceleration: Array
    """Acceleration of the origin in the body frame, shape (m, 2) [m/s²]."""
    yaw_rate: Array
    """Less its mean at rest, shape (m,) [rad/s]."""
    yaw_acceleration: Array
    """Its derivative, shape (m,) [rad/s²]."""
    slowest: Array
    """Smallest |φ̇| within 4 widths of the filter, shape (m, n) [rad/s]."""
    stretch: NDArray[np.int_]
    """Number of the stretch without gaps that a row belongs to, shape (m,)."""
    good: NDArray[np.bool_]
    """Rows without a masked sample nearby, shape (m,)."""
    still: NDArray[np.bool_]
    """Rows at which all wheels stand for a while, shape (m,)."""
    yaw_rate_bias: float = 0.0
    """Mean of the gyro at rest [rad/s]; 0 without any rest."""
    noise: Array = field(default_factory=lambda: np.zeros(0))
    """Noise from sample to sample of the currents and speeds, then of accelerations and yaw rate, or of
    position and heading, shape (2n+3,)."""
    current_noise: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """Covariance of the currents' errors by the monitors' noise, shape (n, n) [A²]."""
    aliased: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """Covariance of the currents' errors by aliasing, shape (n, n) [A²]."""
    velocity: Array | None = None
    """Velocity of the origin in the body frame, from a measured pose, shape (m, 2) [m/s]."""
    pose_delay: float | None = None
    """Delay of a measured pose that has been taken back [s]."""

    @property
    def duration(self) -> float:
        """Time that the rows cover [s]."""
        return PERIOD * len(self.time)


def robot_rows(dataset: Dataset, robot: Robot, pose_delay: float | None = None) -> tuple[RunRows, ...]:
    """Rows of every run.

    Args:
      dataset: Runs of a robot with currents, wheel speeds, and accelerometer and gyro or a measured pose.
      robot: Gives the delays of its sensors.
      pose_delay: Delay of a measured pose [s]; that with which wheels and body move alike when None.

    Raises:
      InputError: A run lacks a channel, is sampled too slowly, or has no stretch that is long enough.
    """
    channels = _channels(len(robot.wheels), dataset.pose_measured)
    parts = {run.name: _stretches(run, robot, channels, str(dataset.path)) for run in dataset.runs}
    late = pose_delay
    if dataset.pose_measured and late is None:
        late = _delay_behind_wheels([one for own in parts.values() for one in own], robot)
    return tuple(_rows_of(run, parts[run.name], robot, channels, late) for run in dataset.runs)


def _channels(wheels: int, pose_measured: bool) -> tuple[str, ...]:
    if not pose_measured:
        return tuple(name for name in robot_channels(wheels) if name != "yaw")
    return (*robot_channels(wheels)[: 2 * wheels], *POSE)


def _has_pose(channels: Sequence[str]) -> bool:
    """Whether these are the channels of a dataset with a measured pose."""
    return channels[-1] == POSE[-1]


def _require_channels(run: Run, channels: Sequence[str], place: str) -> None:
    missing = [name for name in channels if name not in run.columns]
    if missing:
        rule = "a force balance needs currents, wheel speeds, and an inertial unit or a measured pose"
        raise InputError(place, f"has no {missing[0]}", rule)
    rate = 1.0 / float(np.median(np.diff(run.time)))
    least = LOWEST_POSE_RATE if _has_pose(channels) else LOWEST_RATE
    if rate < least * 0.995:
        raise InputError(place, f"has {rate:.4g} samples per second", f"at least {least:g} are needed")


def sensor_delays(robot: Robot, period: float) -> Array:
    """Nominal delay of each channel of a robot with inertial unit, without the yaw, shape (2n+3,) [s].

    A current is read at once; a wheel speed passes a filter and counts over one sample; accelerometer and
    gyro have bandwidths.
    """
    n, sensors = len(robot.wheels), robot.sensors
    counted = min(period, 1.0 / sensors.sample_rate)
    late = [0.0] * n + [sensors.speed_filter + 0.5 * counted] * n
    late += [0.5 / (math.pi * sensors.accelerometer_bandwidth)] * 2
    return np.array([*late, 0.5 / (math.pi * sensors.gyro_bandwidth)])


class _Stretch(NamedTuple):
    """Rows without a gap, and the filter that makes them."""

    run: Run
    part: slice
    smoother: Smoother
    delays: Array
    """Delay of each channel, shape (2n+3,) [s]."""
    samples: PoseSamples | None
    """Measured poses; None with an inertial unit."""

    def kept(self, name: str) -> NDArray[np.bool_]:
        """Samples of a channel that are not masked; all, if none is left."""
        bad = self.run.masked.get(name)
        keep = np.ones(len(self.run.time[self.part]), bool) if bad is None else ~bad[self.part]
        return keep if keep.any() else ~keep

    def even(self, name: str) -> Array:
        """A channel on the filter's grid."""
        keep = self.kept(name)
        return self.smoother.even(self.run.time[self.part][keep], self.run.columns[name][self.part][keep])


def _stretches(run: Run, robot: Robot, channels: Sequence[str], dataset: str) -> list[_Stretch]:
    place = f"{dataset}: run {run.name!r}"
    _require_channels(run, channels, place)
    longest = max(_GAP, _GAP_PERIODS * float(np.median(np.diff(run.time))))
    parts = [(part, run.time[part]) for part in split_at_gaps(run.time, longest)]
    long = [part for part, time in parts if len(time) > 10 and time[-1] - time[0] >= _SHORTEST]
    stretches = (_stretch(run, part, robot, channels) for part in long)
    found = [one for one in stretches if one is not None]
    if not found:
        raise InputError(place, "is too short", f"{_SHORTEST:g} s without a gap are needed")
    return found


def _stretch(run: Run, part: slice, robot: Robot, channels: Sequence[str]) -> _Stretch | None:
    """A stretch with its filter; None if too little of a pose was measured in it."""
    time = run.time[part]
    period = float(np.median(np.diff(time)))
    width, samples, late, edge = max(WIDTH, 2.0 * period), None, 0.0, 3.0
    delays = sensor_delays(robot, period)
    if _has_pose(channels):
        samples = pose_samples(run, part)
        if samples is None:
            return None
        width, late, edge = max(width, least_width(samples)), MOST_DELAY, 4.0
        delays[-3:] = 0.0
    grid = time[0] + period * np.arange(int((time[-1] - time[0]) / period * (1.0 + 1e-9)) + 1)
    rows = np.arange(grid[0] + edge * width, grid[-1] - edge * width - max(delays.max(), late), PERIOD)
    return _Stretch(run, part, Smoother(grid, rows, width), delays, samples) if len(rows) else None


def _delay_behind_wheels(parts: Sequence[_Stretch], robot: Robot) -> float:
    """Median over the stretches of the delay of the measured pose; 0 if the robot never moves."""
    c, found = robot_constants(robot), []
    for one in parts:
        speeds = _wheel_speeds(one, len(c.radius), 0)
        if one.samples is not None and np.abs(speeds).max() > _STILL:
            found.append(delay_behind_wheels(one.samples, speeds, one.smoother, c))
    return float(np.median(found)) if found else 0.0


def _wheel_speeds(one: _Stretch, n: int, order: int) -> Array:
    """Filtered wheel speeds or, with order 1, accelerations, shape (m, n)."""
    return np.column_stack(
        [one.smoother.filtered(one.even(f"wheel_speed_{i + 1}"), one.delays[n + i], order) for i in range(n)]
    )


def _body_motion(one: _Stretch, late: float | None) -> BodyMotion:
    if one.samples is not None:
        return motion_of_pose(one.samples, one.smoother, late or 0.0)
    names = ("acceleration_x", "acceleration_y", "yaw_rate", "yaw_rate")
    x, y, rate, change = (
        one.smoother.filtered(one.even(name), one.delays[k], order)
        for name, k, order in zip(names, (-3, -2, -1, -1), (0, 0, 0, 1), strict=True)
    )
    return BodyMotion(np.column_stack([x, y]), rate, change, np.empty((len(x), 0)))


def _shafts(one: _Stretch, currents: Sequence[str], noise: float) -> Shafts:
    speeds = [one.even(f"wheel_speed_{i + 1}") for i in range(len(currents))]
    late = float(one.delays[len(currents)])
    return shafts_of(one.smoother, [one.even(name) for name in currents], speeds, late, noise)


def _good(one: _Stretch, channels: Sequence[str]) -> NDArray[np.bool_]:
    """Rows without a masked sample nearby, or without a picture for long, shape (m,)."""
    rows, near = one.smoother.rows, _NEAR * one.smoother.width
    good, time = np.ones(len(rows), bool), one.run.time[one.part]
    if one.samples is not None:
        channels = channels[:-3]
        steps = np.diff(one.samples.time)
        for k in np.flatnonzero(steps > _GAP_PERIODS * one.samples.period):
            good &= (rows < one.samples.time[k] - near) | (rows > one.samples.time[k + 1] + near)
    for name in channels:
        bad = one.run.masked.get(name)
        spoilt = time[bad[one.part]] if bad is not None else ()
        if len(spoilt) == len(time):
            good[:] = False
        for moment in spoilt:
            good &= np.abs(rows - moment) > near
    return good


def _rows_of(
    run: Run, parts: Sequence[_Stretch], robot: Robot, channels: Sequence[str], late: float | None
) -> RunRows:
    n = len(robot.wheels)
    motion = BodyMotion(
        *(np.concatenate(column) for column in zip(*(_body_motion(p, late) for p in parts), strict=True))
    )
    currents = channels[:n]
    speed = np.concatenate([_wheel_speeds(p, n, 0) for p in parts])
    still = _rests(np.abs(speed).max(axis=1) < _STILL)
    measured = parts[0].samples is not None
    bias = float(motion.yaw_rate[still].mean()) if still.any() and not measured else 0.0
    noise = _noise(run, parts, channels)
    return RunRows(
        name=run.name,
        floor=str(run.conditions.get("floor", "")),
        time=np.concatenate([p.smoother.rows for p in parts]) - run.time[0],
        current=np.concatenate(
            [np.column_stack([p.smoother.filtered(p.even(name)) for name in currents]) for p in parts]
        ),
        shafts=together([_shafts(p, currents, robot.sensors.current_noise) for p in parts]),
        wheel_speed=speed,
        wheel_acceleration=np.concatenate([_wheel_speeds(p, n, 1) for p in parts]),
        acceleration=motion.acceleration,
        yaw_rate=motion.yaw_rate - bias,
        yaw_acceleration=motion.yaw_acceleration,
        slowest=_slowest(speed, parts),
        stretch=np.repeat(np.arange(len(parts)), [len(p.smoother.rows) for p in parts]),
        good=np.concatenate([_good(p, channels) for p in parts]),
        still=still,
        yaw_rate_bias=bias,
        noise=noise,
        current_noise=_current_noise(parts[0].smoother, noise[:n], robot),
        aliased=np.mean([_aliased(p, currents, robot.sensors.sample_rate) for p in parts], axis=0),
        velocity=motion.velocity if measured else None,
        pose_delay=late,
    )


def _slowest(speed: Array, parts: Sequence[_Stretch]) -> Array:
    """Smallest |φ̇| around each row, shape (m, n)."""
    ends = np.cumsum([len(p.smoother.rows) for p in parts])[:-1]
    return np.concatenate(
        [
            minimum_filter1d(np.abs(own), 2 * round(_NEAR * p.smoother.width / PERIOD) + 1, axis=0)
            for own, p in zip(np.split(speed, ends), parts, strict=True)
        ]
    )


def _noise(run: Run, parts: Sequence[_Stretch], channels: Sequence[str]) -> Array:
    noise = np.array([sample_noise(run.columns[name]) for name in channels])
    poses = [p.samples.noise for p in parts if p.samples is not None]
    if poses:
        noise[-3:] = np.median(poses, axis=0)
    return noise


def _current_noise(smoother: Smoother, noise: Array, robot: Robot) -> Array:
    """Covariance of the filtered currents' errors by noise of the monitors, shape (n, n) [A²].

    White noise σ every T leaves σ² T/(2 √π w) behind a Gaussian of width w. The loops' own answer to noise
    moves the robot; it is no error, and more than the monitors' nominal noise is taken for such.
    """
    own = np.minimum(noise, robot.sensors.current_noise)
    return np.diag(own**2 / (robot.sensors.sample_rate * 2.0 * math.sqrt(math.pi) * smoother.width))


def _aliased(one: _Stretch, currents: Sequence[str], sample_rate: float) -> Array:
    """Covariance of the filtered currents' errors by aliasing, shape (n, n) [A²].

    Loops answer to noise of the sensors faster than a slow log samples. What every second, and every fourth
    sample would have given shows how the error falls with the rate, E₂ and E₄ about the whole. From all
    samples up to those of the controller, k doublings of the rate, follows a geometric series,
    E₂ (ρ + ρ² + … + ρᵏ), ρ = E₂/(E₄ − E₂): ρ = 1/2 for white noise, and nearly 0 where the log follows the
    currents.
    """
    doublings = math.log2(max(one.smoother.period * sample_rate, 1.0))
    errors = []
    for step in (2, 4):
        parts = [_decimated(one, currents, slice(first, None, step)) for first in range(step)]
        mean = np.mean(parts, axis=0)
        errors.append(np.mean([(part - mean).T @ (part - mean) / len(mean) for part in parts], axis=0))
    second, more = float(np.trace(errors[0])), float(np.trace(errors[1] - errors[0]))
    share = min(second / more, 0.5) if more > 0.0 else 0.5
    return errors[0] * share * (1.0 - share**doublings) / (1.0 - share)


def _decimated(one: _Stretch, currents: Sequence[str], every: slice) -> Array:
    """Filtered currents from some of the samples, shape (m, n) [A]."""
    grid, smoother = one.smoother.grid, one.smoother
    return np.column_stack(
        [smoother.filtered(smoother.even(grid[every], one.even(name)[every])) for name in currents]
    )


def _rests(slow: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows of those slow stretches that last, without their edges."""
    rests, least, edge = np.zeros(len(slow), bool), round(_REST / PERIOD), round(0.1 / PERIOD)
    changes = np.flatnonzero(np.diff(np.concatenate(([0], slow.astype(int), [0]))))
    for first, last in changes.reshape(-1, 2):
        if last - first >= least:
            rests[first + edge : last - edge] = True
    return rests
