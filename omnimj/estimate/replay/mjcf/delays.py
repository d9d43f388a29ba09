"""Late signals: values between the rows of a log, and commands as their actuators receive them."""

from __future__ import annotations

import math
from typing import NamedTuple

from omnimj.estimate.replay.stretches import value_at
from omnimj.physics.native import kernel


@kernel
def _between(values, place, first, last):
    """Cubic through four rows about a place, constant beyond the ends.

    A straight line between two rows would take away what changes fast, noise included: a search would take
    that for a delay or for the compliance of a spring.
    """
    place = min(max(place, float(first)), float(last - 1))
    at = min(max(int(place) - 1, first), last - 4)
    t = place - at - 1.0
    before, after = (t - 1.0) * (t - 2.0), (t + 1.0) * t
    found = before * (3.0 * (t + 1.0) * values[at + 1] - t * values[at])
    return (found + after * ((t - 1.0) * values[at + 3] - 3.0 * (t - 2.0) * values[at + 2])) / 6.0


@kernel
def _at(values, place, first, last, is_smooth):
    """Value between rows."""
    return _between(values, place, first, last) if is_smooth else value_at(values, place, first, last)


class CommandPath(NamedTuple):
    """Delay, lag and limits between a command and its actuator."""

    delay: float
    """[s]"""
    lag: float
    """Time constant [s]."""
    low: float
    """Least command."""
    high: float
    """Largest command."""


@kernel
def effective_commands(raw, stretches, period, path, is_smooth, commands):
    """Commands as the actuator receives them: delayed, limited, filtered with a first-order lag.

    The lag is exact for commands that change in straight lines between the rows, with the share
    a = (1 − exp(−P/τ)) τ/P of a change that is still missing after a row's period P:
      y_k = u_k − (u_(k−1) − y_(k−1)) exp(−P/τ) − a (u_k − u_(k−1)),
    so that a lag far below the period delays by τ as well.

    Args:
      raw: Measured commands of one joint, shape (n,).
      stretches: Table of stretches.
      period: Time between rows [s].
      path: `CommandPath`.
      is_smooth: True for values between rows by cubics, False for those by straight lines.
      commands: Filled, shape (n,).
    """
    keep, missing = 0.0, 0.0
    if path.lag > 1e-6:
        keep = math.exp(-period / path.lag)
        missing = (1.0 - keep) * path.lag / period
    for s in range(len(stretches)):
        first, last = stretches[s, 0], stretches[s, 1]
        state = before = min(max(raw[first], path.low), path.high)
        for k in range(first, last):
            wanted = _at(raw, k - path.delay / period, first, last, is_smooth)
            wanted = min(max(wanted, path.low), path.high)
            state = wanted - (before - state) * keep - missing * (wanted - before)
            before = wanted
            commands[k] = state


@kernel
def shifted(values, stretches, rows, is_smooth, shifted_values):
    """Values of one column some rows later, interpolated inside its stretch.

    Args:
      values: Shape (n,).
      stretches: Table of stretches.
      rows: Number of rows, not whole.
      is_smooth: True for cubics, False for straight lines between rows.
      shifted_values: Filled, shape (n,).
    """
    for s in range(len(stretches)):
        first, last = stretches[s, 0], stretches[s, 1]
        for k in range(first, last):
            shifted_values[k] = _at(values, k + rows, first, last, is_smooth)
