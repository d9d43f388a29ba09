"""Active diagnosis: wheels are driven against each other so that their motors show what they can do.

Wheel speeds along n with B n = 0 push the body nowhere: all wheels slip a little, their tractions cancel, and
a motor that gives less than it should leaves a rest. A square wave of `DITHER_SPEED` along n is added, in
bursts,
while a robot that drives slowly and steadily tells nothing about its motors; once, larger, before a robot is
driven, where that is asked for. It is the steps that tell: a sine of the same size found no motor of 16 that
lacks 15 %, the square wave found 7.
"""

from __future__ import annotations

import numpy as np

from omnimj.physics.native import kernel
from omnimj.signals import Array

DITHER_SPEED = 0.04
"""Speed of the square wave [m/s]."""
DITHER_FREQUENCY = 0.7
"""[Hz]"""
PERIODS = 2
"""Of a burst."""
PAUSE = 20.0
"""Between two bursts [s]."""
QUIET = 2.0
"""Time without a load on the motors after which they are asked [s]."""
_LOADED = 4.0  # [N] of traction beyond which motors tell enough by themselves
_DRIVES, _FAST = 0.1, 0.5  # [m/s] between which a robot drives slowly
_STEADY = 0.3  # [m/s²] of demanded acceleration: more loads the motors by itself and needs the grip

SELF_TEST_SPEED = 0.12
"""Speed of the wheels in the self-test at power-on: beyond what stiction hides, 8 cm of way [m/s]."""
SELF_TEST = 1.0 / DITHER_FREQUENCY
"""Its length, one period [s]."""

SINCE_LOAD, IN_BURST, TEST_LEFT = range(3)
"""Numbers of a dither: time since the motors were loaded, time in the burst or, below 0, until the next, and
what is left of the self-test [s]."""


def initial_dither(self_test: bool) -> Array:
    """Before the first step, shape (3,)."""
    return np.array((0.0, 0.0, SELF_TEST if self_test else 0.0))


def null_space_speeds(forces: Array) -> Array:
    """n with B n = 0 and max |n_i| = 1, shape (wheels,); zeros where no such direction exists.

    Args:
      forces: B, shape (3, wheels).
    """
    _, sizes, directions = np.linalg.svd(forces)
    if directions.shape[0] <= len(sizes):
        return np.zeros(forces.shape[1])
    found = directions[-1]
    return found / found[np.argmax(np.abs(found))]


@kernel
def next_self_test(d, h):
    """Sign of the square wave of the self-test, `d` in place; 0 when it is over."""
    if d[TEST_LEFT] <= 0.0:
        return 0.0
    d[TEST_LEFT] -= h
    return 1.0 if d[TEST_LEFT] > 0.5 * SELF_TEST else -1.0


@kernel
def next_dither(d, h, may, speed, acceleration, load):
    """Sign of the square wave now, −1, 0 or 1; `d` in place.

    Args:
      d: The numbers above.
      h: Control period [s].
      may: Whether nothing is wrong.
      speed: Demanded [m/s].
      acceleration: Demanded [m/s²].
      load: Largest traction [N].
    """
    burst = PERIODS / DITHER_FREQUENCY
    inside = d[IN_BURST] > 0.0
    if not may or not _DRIVES < speed < _FAST or acceleration > _STEADY:
        d[SINCE_LOAD], d[IN_BURST] = 0.0, min(d[IN_BURST], 0.0) if not inside else -PAUSE
        return 0.0
    if not inside:
        d[IN_BURST] = min(d[IN_BURST] + h, 0.0)
        d[SINCE_LOAD] = 0.0 if load > _LOADED else d[SINCE_LOAD] + h
        if d[IN_BURST] < 0.0 or d[SINCE_LOAD] < QUIET:
            return 0.0
    d[IN_BURST] += h
    if d[IN_BURST] > burst:
        d[SINCE_LOAD], d[IN_BURST] = 0.0, -PAUSE
        return 0.0
    return 1.0 if (d[IN_BURST] * DITHER_FREQUENCY) % 1.0 < 0.5 else -1.0
