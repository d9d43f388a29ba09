"""Between two blocks: one sample into what is gathered, everything in one kernel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnimj.control.robust.blocks import (
    add_sample,
    align,
    count_repeats,
    is_frozen,
    is_full,
    is_rough,
    no_line,
    no_repeats,
    no_sums,
)
from omnimj.physics.motor import set_current
from omnimj.physics.native import kernel
from omnimj.signals import Array


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


def no_samples(wheels: int) -> Samples:
    """Before the first one."""
    return Samples(no_sums(wheels), no_line(wheels), no_repeats(wheels), np.zeros(wheels))


@kernel
def take_sample(
    waits, ranges, amplifier, samples, sums, line, repeats, wanted, first,
    current, speed, acceleration, turning, bias, commanded, command,
):  # fmt: skip
    """One sample into copies of the first four arrays of `Samples`.

    Args:
      waits: From `blocks.delays`.
      ranges: From `blocks.ranges`: a reading beyond it is cut.
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
            asked, can = command[i] - current[i], set_current(amplifier, command[i], speed[i]) - current[i]
            wanted[i] += asked if abs(asked) < abs(can) else can
    return sums, line, repeats, wanted, now, is_full(sums, samples)


@kernel
def broken_channels(repeats, speed):
    """Which channels say the same for too long, or are too rough, shape (2n+3,)."""
    broken = np.empty(repeats.shape[1], np.bool_)
    for k in range(broken.size):
        broken[k] = is_frozen(repeats, k, speed.size, speed) or is_rough(repeats, k, speed.size)
    return broken
