"""Samples into blocks: alignment of the channels, means, accelerations, and channels that have failed.

The time of a measurement decides what it counts, not its turn. A reading that comes a second time, or late,
says nothing new. Readings that are missing are interpolated while they are few; a longer gap ends the block,
and the next one only settles the memory of the alignment: nothing can be judged meanwhile.

Channels are ordered currents (n) | wheel speeds (n) | acceleration (2) | yaw rate; all arrays over channels
have the shape (2n+3,).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omnimj.control.cascade.wheel_speed import amplifier_parameters
from omnimj.parameters import Robot
from omnimj.physics.motor import MotorParameters, achievable_current
from omnimj.physics.native import kernel
from omnimj.signals import Array

BLOCK = 0.01
"""Time over which samples are averaged [s]."""
ROUGH = (1.0, 0.45, 0.45, 0.04)
"""RMS steps from sample to sample at 1 kHz above which a sensor counts as failed: currents [A], wheel speeds
[rad/s], acceleration [m/s²] and yaw rate [rad/s]; at least five times those of working sensors."""
SMOOTHED, MOST_STEP = 100.0, 5.0
"""Samples over which squares of steps are averaged, and the largest square, in units of the limit's: a single
jump is no noise."""
_CURVED = 3.0  # variance of white noise's second differences, 6 σ², over that of its steps, 2 σ²
REPEATED = 60
"""Equal samples in a row that no working sensor gives while the robot drives."""
BRIDGED = 0.5
"""Gap over which readings are interpolated, as a share of a block."""
LONGEST_GAP = 0.1
"""Longest gap over which windows and the history of blocks continue [s]; diagnoses persist over any."""
LINE = 12
"""Samples that are kept for the alignment of the channels."""

_CLOCK = 0.1  # weight of a block's last time stamp in the time at which the next one begins


class SamplingParameters(NamedTuple):
    """Constants of the sampling of a robot with n wheels."""

    period: float
    """From sample to sample [s]."""
    per_block: int
    """From `samples_per_block`."""
    bridged: float
    """Periods up to which the readings between two samples are interpolated."""
    waits: Array
    """Delay of each channel, from `alignment_delays`."""
    ranges: Array
    """Largest readings, from `channel_ranges`; a reading beyond them is clipped."""
    amplifier: MotorParameters
    """From `amplifier_parameters`."""


class Sample(NamedTuple):
    """One measurement and the command before it."""

    time: float
    """[s]"""
    current: Array
    """Shape (n,) [A]."""
    wheel_speed: Array
    """Shape (n,) [rad/s]."""
    acceleration: Array
    """Shape (2,) [m/s²]."""
    yaw_rate: float
    """Gyro [rad/s]."""
    bias: float
    """Reading of the gyro at rest [rad/s]."""
    commanded: bool
    """True if set currents are known."""
    command: Array
    """Set currents of the period that the sample ends, shape (n,) [A]; anything where unknown."""


class Samples(NamedTuple):
    """Sums over the block that is not full yet, and the memory of the alignment."""

    fresh: bool
    """True until the first block is full."""
    since: float
    """Time of the block's beginning, a period before its first sample; NaN before the first block [s]."""
    gap: float
    """Duration of gaps since the last full block [s]; 0 for none."""
    number: float
    """Periods from the block's beginning to the newest sample."""
    total: Array
    """Sums of the aligned channels over all periods."""
    begin: Array
    """Wheel speeds [rad/s] and yaw rate [rad/s] at the block's beginning, shape (n+1,)."""
    aligned: Array
    """Newest values of all channels at the same instant."""
    line: Array
    """Last samples of all channels, newest first, shape (LINE, 2n+3)."""
    steps: Array
    """Last value, how often it came in a row, mean square of the steps that white noise would make, and last
    step (NaN after a gap), shape (4, 2n+3)."""
    missing: Array
    """Sum over the block of the current that the amplifiers owe, shape (n,) [A]."""


class Block(NamedTuple):
    """Means over one block and changes from its beginning to its end."""

    current: Array
    """Shape (n,) [A]."""
    wheel_speed: Array
    """Shape (n,) [rad/s]."""
    acceleration: Array
    """Shape (2,) [m/s²]."""
    yaw_rate: float
    """Gyro less its bias [rad/s]."""
    wheel_acceleration: Array
    """Shape (n,) [rad/s²]."""
    yaw_acceleration: float
    """[rad/s²]"""
    commanded: Array
    """Current that the amplifiers should have given, shape (n,) [A]."""
    duration: float
    """[s]"""


def samples_per_block(period: float) -> int:
    """Number of samples nearest to `BLOCK`; one where they come more slowly.

    Args:
      period: From sample to sample [s].
    """
    return max(1, round(BLOCK / period))


def alignment_delays(robot: Robot, period: float) -> Array:
    """Samples by which each channel waits for the slowest one, shape (2n+3,).

    Wheel speeds come through a filter (and half a sample of counting), accelerometer and gyro through their
    bandwidths, currents at once: unaligned, a torque that the yaw loop makes of the gyro's noise looks like
    inertia.
    """
    n, sensors = len(robot.wheels), robot.sensors
    late = [0.0] * n + [sensors.speed_filter + period] * n
    late += [1.0 / (2.0 * math.pi * sensors.accelerometer_bandwidth)] * 2
    late += [1.0 / (2.0 * math.pi * sensors.gyro_bandwidth)]
    waits = np.rint((max(late) - np.array(late)) / period)
    return np.clip(waits, 0.0, LINE - 1.0)


def channel_ranges(robot: Robot) -> Array:
    """Largest reading of each channel, shape (2n+3,)."""
    n, sensors = len(robot.wheels), robot.sensors
    speed = sensors.speed_monitor_range / robot.motor.gear_ratio
    each = [sensors.current_monitor_range] * n + [speed] * n
    return np.array([*each, *([sensors.accelerometer_range] * 2), sensors.gyro_range])


def sampling_parameters(robot: Robot, period: float) -> SamplingParameters:
    """Constants of the sampling at a control period [s]."""
    per_block = samples_per_block(period)
    return SamplingParameters(
        float(period),
        per_block,
        max(1.0, float(int(BRIDGED * per_block))),
        alignment_delays(robot, period),
        channel_ranges(robot),
        amplifier_parameters(robot),
    )


def initial_samples(wheels: int) -> Samples:
    """State before the first sample."""
    channels = 2 * wheels + 3
    return Samples(
        fresh=True,
        since=math.nan,
        gap=0.0,
        number=0.0,
        total=np.zeros(channels),
        begin=np.zeros(wheels + 1),
        aligned=np.zeros(channels),
        line=np.zeros((LINE, channels)),
        steps=np.zeros((4, channels)),
        missing=np.zeros(wheels),
    )


@kernel
def align(line, waits, values, first, aligned):
    """Take one sample into the line, in place, and fill `aligned` with all channels at the same instant.

    Args:
      line: Last samples, newest first, shape (LINE, 2n+3).
      waits: From `alignment_delays`.
      values: Newest sample, shape (2n+3,).
      first: Whether the line holds no sample yet.
      aligned: Output, shape (2n+3,).
    """
    line[1:] = line[:-1].copy()
    line[0] = values
    if first:
        line[1:] = line[0]
    for k in range(waits.size):
        aligned[k] = line[int(waits[k]), k]


@kernel
def roughness(k, wheels):
    """Root mean square of channel k's steps from sample to sample that no working sensor exceeds."""
    if k < wheels:
        return ROUGH[0]
    if k < 2 * wheels:
        return ROUGH[1]
    return ROUGH[2] if k < 2 * wheels + 2 else ROUGH[3]


@kernel
def count_repeats(steps, values, follows):
    """Take one sample into the counts of equal values and the squares of steps, in place.

    Noise is measured by second differences Δ², whose variance is three times that of the steps where samples
    are independent. A body that shakes makes steps, too, but smooth ones: the sine of a loop that oscillates
    at 40 Hz counts for a seventh of its steps at 1 kHz.

    Args:
      steps: Of `Samples`, shape (4, 2n+3).
      values: Newest sample, shape (2n+3,).
      follows: Whether the sample comes one period after the last one: a longer step is no noise.
    """
    n = (values.size - 3) // 2
    for k in range(values.size):
        step = values[k] - steps[0, k]
        steps[1, k] = steps[1, k] + 1.0 if step == 0.0 else 0.0
        curve = step - steps[3, k]
        if follows and not math.isnan(curve):
            square = min(curve * curve / _CURVED, MOST_STEP * roughness(k, n) ** 2)
            steps[2, k] += (square - steps[2, k]) / SMOOTHED
        steps[3, k] = step if follows else math.nan
        steps[0, k] = values[k]


@kernel
def failed_channels(steps, wheel_speed, failed):
    """Mark the channels that are frozen while the robot drives, or too noisy.

    A wheel at rest may repeat its speed. Where most wheels are rough at the same time, the robot shakes.

    Args:
      steps: Of `Samples`, shape (4, 2n+3).
      wheel_speed: Shape (n,) [rad/s].
      failed: Output, mask of the channels, shape (2n+3,).
    """
    n, fastest, shaking = wheel_speed.size, np.abs(wheel_speed).max(), 0
    for k in range(n, 2 * n):
        shaking += 1 if steps[2, k] > 0.25 * roughness(k, n) ** 2 else 0
    for k in range(failed.size):
        rests = n <= k < 2 * n and abs(wheel_speed[k - n]) <= 0.5
        frozen = steps[1, k] >= REPEATED and fastest >= 1.0 and not rests
        shakes = n <= k < 2 * n and 2 * shaking > n
        failed[k] = frozen or (steps[2, k] > roughness(k, n) ** 2 and not shakes)


@kernel
def _missing_current(amplifier, command, current, wheel_speed):
    """Current that an amplifier owes [A].

    Near the supply's voltage a healthy motor gets less than its set current, one with another motor in
    parallel does not: neither disobeys.
    """
    commanded = command - current
    possible = achievable_current(amplifier, command, wheel_speed) - current
    return commanded if abs(commanded) < abs(possible) else possible


@kernel
def take_sample(p, block, sample):
    """Add one sample to the block by its time, in place.

    Args:
      p: `SamplingParameters`.
      block: `Samples`, changed in place.
      sample: `Sample`.

    Returns:
      Whether the block is full.
    """
    n = sample.current.size
    if math.isnan(block.since):
        block.since = sample.time - p.period
    passed = np.rint((sample.time - block.since) / p.period) - block.number
    if passed < 1.0:  # the same reading again, or an older one
        return False
    values = np.empty(2 * n + 3)
    values[:n], values[n : 2 * n] = sample.current, sample.wheel_speed
    values[2 * n : 2 * n + 2], values[2 * n + 2] = sample.acceleration, sample.yaw_rate
    for k in range(values.size):
        values[k] = min(max(values[k], -p.ranges[k]), p.ranges[k])
    count_repeats(block.steps, values, passed == 1.0)
    values[2 * n + 2] -= sample.bias
    if passed > p.bridged:
        begin_after_gap(p, block, values, sample.time, passed)
        return False
    if passed > 1.0:
        _interpolate(p, block, values, passed)
    _add(p, block, values)
    if sample.commanded and passed == 1.0:  # what was commanded during a gap is not known
        for i in range(n):
            block.missing[i] += _missing_current(p.amplifier, sample.command[i], values[i], values[n + i])
    if block.number < p.per_block:
        return False
    # the phase follows the clock of the measurements slowly, so that jitter moves no sample to another period
    end = block.since + block.number * p.period
    block.since += _CLOCK * (sample.time - end)
    return True


@kernel
def _add(p, block, values):
    """Add the values of one period to the block, in place."""
    n, aligned, begin, total = block.missing.size, block.aligned, block.begin, block.total
    align(block.line, p.waits, values, block.fresh, aligned)
    if block.number == 0.0 and not begin.any():
        begin[:n], begin[n] = aligned[n : 2 * n], aligned[2 * n + 2]
    block.number += 1.0
    for k in range(values.size):
        total[k] += aligned[k]


@kernel
def _interpolate(p, block, values, passed):
    """Add the periods without a sample, linearly between the last sample and the newest one, in place."""
    last = block.line[0].copy()
    for j in range(1, int(passed)):
        _add(p, block, last + (values - last) * (j / passed))


@kernel
def begin_after_gap(p, block, values, time, passed):
    """Begin a block at the first sample after a gap, in place.

    Args:
      p: `SamplingParameters`.
      block: `Samples`, changed in place.
      values: The sample, shape (2n+3,).
      time: Of the sample [s].
      passed: Periods since the last sample.
    """
    n = block.missing.size
    align(block.line, p.waits, values, True, block.aligned)
    block.begin[:n], block.begin[n] = values[n : 2 * n], values[2 * n + 2]
    block.gap += passed * p.period
    block.since, block.number, block.fresh = time, 0.0, False
    block.total[:] = 0.0
    block.missing[:] = 0.0


@kernel
def take_block(s, period):
    """Take the means of a full block and begin an empty one, in place.

    Args:
      s: `Samples`, changed in place.
      period: From sample to sample [s].

    Returns:
      `Block`.
    """
    n, end, duration = s.missing.size, s.aligned, s.number * period
    mean, change, begin = s.total / s.number, np.empty(n), s.begin
    for i in range(n):
        change[i] = (end[n + i] - begin[i]) / duration
    block = Block(
        mean[:n].copy(),
        mean[n : 2 * n].copy(),
        mean[2 * n : 2 * n + 2].copy(),
        mean[2 * n + 2],
        change,
        (end[2 * n + 2] - begin[n]) / duration,
        mean[:n] + s.missing / s.number,
        duration,
    )
    begin[:n], begin[n] = end[n : 2 * n], end[2 * n + 2]
    s.since += duration
    s.fresh, s.number, s.gap = False, 0.0, 0.0
    s.total[:] = 0.0
    s.missing[:] = 0.0
    return block


@kernel
def move_to_centre(accelerometer, block):
    """Turn the acceleration a at the sensor's place r into that of the centre, a − ω̇ × r + ω² r, in place.

    Args:
      accelerometer: r in the body frame, shape (2,) [m].
      block: `Block`.
    """
    x, y, square = accelerometer[0], accelerometer[1], block.yaw_rate * block.yaw_rate
    block.acceleration[0] += block.yaw_acceleration * y + square * x
    block.acceleration[1] += square * y - block.yaw_acceleration * x
