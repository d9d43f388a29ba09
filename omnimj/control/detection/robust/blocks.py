"""Samples into blocks: means, and the changes of speeds from one block's end to the next."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omnimj.parameters import Robot
from omnimj.physics.motor import achievable_current, motor_at
from omnimj.physics.native import kernel
from omnimj.signals import Array

ROUGH = (1.0, 0.45, 0.45, 0.04)
"""Steps of currents [A], wheel speeds [rad/s], acceleration [m/s²] and yaw rate [rad/s] at 1 kHz that are
noise: five times those of working sensors at least."""
SMOOTHED, MOST_STEP = 100.0, 5.0
"""Samples over which squares of steps are averaged, and how much one counts, in units of the limit: a single
jump is no noise."""
REPEATED = 60
"""Samples of one and the same value that no working sensor gives while the robot drives."""
COUNT = 0
"""First of the sums; behind it currents (n), wheel speeds (n), acceleration (2), yaw rate, then where the
block began: wheel speeds (n), yaw rate."""


LINE = 12
"""Samples that are kept for the alignment of the channels."""


def alignment_delays(robot: Robot, period: float) -> Array:
    """Samples by which each channel waits for the slowest one, in the order of `initial_repeats`, shape
    (2n+3,).

    Wheel speeds come through a filter (and half a sample of counting), accelerometer and gyro through their
    bandwidths, currents at once: unaligned, a torque that the yaw loop makes of the gyro's noise looks like
    inertia.
    """
    n, sensors = len(robot.wheels), robot.sensors
    slow = sensors.speed_filter + period
    late = [0.0] * n + [slow] * n
    late += [1.0 / (2.0 * math.pi * sensors.accelerometer_bandwidth)] * 2
    late += [1.0 / (2.0 * math.pi * sensors.gyro_bandwidth)]
    waits = np.rint((max(late) - np.array(late)) / period)
    return np.clip(waits, 0.0, LINE - 1.0)


def channel_ranges(robot: Robot) -> Array:
    """Largest reading of each channel, shape (2n+3,): beyond it a sensor says nothing."""
    n, sensors = len(robot.wheels), robot.sensors
    speed = sensors.speed_monitor_range / robot.motor.gear_ratio
    each = [sensors.current_monitor_range] * n + [speed] * n
    return np.array([*each, *([sensors.accelerometer_range] * 2), sensors.gyro_range])


def initial_line(wheels: int) -> Array:
    """The last samples of all channels, newest first, shape (LINE, 2n+3)."""
    return np.zeros((LINE, 2 * wheels + 3))


@kernel
def align(line, waits, current, speed, acceleration, turning, first, out):
    """One sample into the line, in place; `out` is what all said of the same instant, shape (2n+3,)."""
    n = current.size
    line[1:] = line[:-1].copy()
    line[0, :n], line[0, n : 2 * n] = current, speed
    line[0, 2 * n : 2 * n + 2], line[0, 2 * n + 2] = acceleration, turning
    if first:
        line[1:] = line[0]
    for k in range(waits.size):
        out[k] = line[int(waits[k]), k]


def initial_repeats(wheels: int) -> Array:
    """Last sample, how often it came, and the mean square of its steps: currents, wheel speeds, acceleration,
    yaw rate, shape (3, 2n+3)."""
    return np.zeros((3, 2 * wheels + 3))


@kernel
def count_repeats(repeats, current, speed, acceleration, turning):
    """One sample into the counts of equal values and the squares of steps, in place."""
    n = current.size
    for k in range(2 * n + 3):
        if k < n:
            value = current[k]
        elif k < 2 * n:
            value = speed[k - n]
        elif k < 2 * n + 2:
            value = acceleration[k - 2 * n]
        else:
            value = turning
        step = value - repeats[0, k]
        repeats[1, k] = repeats[1, k] + 1.0 if step == 0.0 else 0.0
        repeats[2, k] += (min(step * step, MOST_STEP * equation_error(k, n) ** 2) - repeats[2, k]) / SMOOTHED
        repeats[0, k] = value


@kernel
def equation_error(k, wheels):
    """Root mean square of channel k's steps from sample to sample that no working sensor has."""
    if k < wheels:
        return ROUGH[0]
    if k < 2 * wheels:
        return ROUGH[1]
    return ROUGH[2] if k < 2 * wheels + 2 else ROUGH[3]


@kernel
def is_rough(repeats, k, wheels):
    """Whether channel k has become noisier than any working sensor."""
    return repeats[2, k] > equation_error(k, wheels) ** 2


@kernel
def is_frozen(repeats, k, wheels, speed):
    """Whether channel k says the same for too long while the robot drives; a wheel at rest may."""
    if repeats[1, k] < REPEATED or np.abs(speed).max() < 1.0:
        return False
    return not wheels <= k < 2 * wheels or abs(speed[k - wheels]) > 0.5


def initial_sums(wheels: int) -> Array:
    """Sums before the first sample, shape (3n+5,)."""
    return np.zeros(3 * wheels + 5)


@kernel
def add_sample(sums, current, speed, acceleration, turning):
    """One sample into the sums; the first one only says where the first block begins."""
    n = current.size
    begin = 2 * n + 4
    if sums[COUNT] == 0.0 and sums[begin + n] == 0.0 and not sums[begin : begin + n].any():
        sums[begin : begin + n], sums[begin + n] = speed, turning
    sums[COUNT] += 1.0
    sums[1 : n + 1] += current
    sums[n + 1 : 2 * n + 1] += speed
    sums[2 * n + 1 : 2 * n + 3] += acceleration
    sums[2 * n + 3] += turning


@kernel
def is_full(sums, samples):
    """Whether the block has as many samples as it takes."""
    return sums[COUNT] >= samples


@kernel
def take_block(sums, period, speed, turning, out):
    """Fills `out` with the block and empties the sums.

    Args:
      sums: Changed: the next block begins here.
      period: Of a block [s].
      speed: Of the last sample, shape (n,) [rad/s].
      turning: Of the last sample [rad/s].
      out: [currents (n) | wheel speeds (n) | acceleration (2) | yaw rate | wheel accelerations (n) | yaw
        acceleration], shape (3n+4,).
    """
    n = speed.size
    begin = 2 * n + 4
    out[: 2 * n + 3] = sums[1:begin] / sums[COUNT]
    for i in range(n):
        out[2 * n + 3 + i] = (speed[i] - sums[begin + i]) / period
    out[3 * n + 3] = (turning - sums[begin + n]) / period
    sums[:begin] = 0.0
    sums[begin : begin + n], sums[begin + n] = speed, turning


# Between two blocks: one sample into what is gathered, everything in one kernel.


@dataclass(frozen=True, slots=True)
class Samples:
    """What is gathered of the block that is not full yet, n wheels."""

    sums: Array
    """Of `blocks`."""
    line: Array
    """Of `blocks`: the last samples."""
    repeats: Array
    """Of `blocks`: equal values in a row and squares of steps."""
    wanted: Array
    """Sum of what the amplifiers should have given in this block beyond what they gave, shape (n,) [A]."""


def initial_samples(wheels: int) -> Samples:
    """Before the first one."""
    return Samples(initial_sums(wheels), initial_line(wheels), initial_repeats(wheels), np.zeros(wheels))


@kernel
def take_sample(
    waits, ranges, amplifier, samples, sums, line, repeats, wanted, first,
    current, speed, acceleration, turning, bias, commanded, command,
):  # fmt: skip
    """One sample into copies of the first four arrays of `Samples`.

    Args:
      waits: From `blocks.alignment_delays`.
      ranges: From `blocks.channel_ranges`: a reading beyond it is cut.
      amplifier: From `wheel_speed.amplifier_row`.
      samples: Of a block.
      sums: And the next three: of `Samples`, left as they are.
      line: Shape (LINE, 2n+3).
      repeats: Shape (3, 2n+3).
      wanted: Shape (n,) [A].
      first: Whether nothing was judged before.
      current: Shape (n,) [A].
      speed: Shape (n,) [rad/s].
      acceleration: Shape (2,) [m/s²].
      turning: Gyro [rad/s].
      bias: Of the gyro [rad/s].
      commanded: Whether set currents are known.
      command: Set currents of the period that the sample ends, shape (n,) [A]; anything where not known.

    Returns:
      The four arrays after it, what all channels said of the same instant, shape (2n+3,), and whether the
      block is full.
    """
    n = current.size
    said, now = np.empty(2 * n + 3), np.empty(2 * n + 3)
    said[:n], said[n : 2 * n] = current, speed
    said[2 * n : 2 * n + 2], said[2 * n + 2] = acceleration, turning
    for k in range(said.size):
        said[k] = min(max(said[k], -ranges[k]), ranges[k])
    current, speed, acceleration = said[:n], said[n : 2 * n], said[2 * n : 2 * n + 2]
    sums, line, repeats, wanted = sums.copy(), line.copy(), repeats.copy(), wanted.copy()
    count_repeats(repeats, current, speed, acceleration, said[2 * n + 2])
    align(line, waits, current, speed, acceleration, said[2 * n + 2] - bias, first, now)
    add_sample(sums, now[:n], now[n : 2 * n], now[2 * n : 2 * n + 2], now[2 * n + 2])
    if commanded:
        for i in range(n):
            # near the supply's voltage a healthy motor gets less than is asked for, one with another motor
            # in parallel does not: neither disobeys
            asked, can = (
                command[i] - current[i],
                achievable_current(motor_at(amplifier), command[i], speed[i]) - current[i],
            )
            wanted[i] += asked if abs(asked) < abs(can) else can
    return sums, line, repeats, wanted, now, is_full(sums, samples)


@kernel
def broken_channels(repeats, speed):
    """Which channels say the same for too long, or are too rough, shape (2n+3,)."""
    broken = np.empty(repeats.shape[1], np.bool_)
    for k in range(broken.size):
        broken[k] = is_frozen(repeats, k, speed.size, speed) or is_rough(repeats, k, speed.size)
    return broken
