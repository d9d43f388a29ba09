"""Active diagnosis: wheels are excited so that a loss of torque, or returned grip, shows.

Wheel speeds along n with B n = 0 push the body nowhere: all wheels slip a little, their tractions cancel,
and a weak motor leaves a net force. A square wave of `DITHER_SPEED` along n is added, in bursts, while a
robot that drives slowly and steadily excites its motors too little; once, larger, before the first drive,
where the self-test is enabled. The steps of the wave provide the excitation: of 16 motors that lacked 15 %, a
sine of the same amplitude revealed none, the square wave seven.

A slipping wheel that rolls along unloaded shows nothing of its grip; a square wave on it alone does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnimj.physics.native import kernel
from omnimj.signals import Array

DITHER_SPEED = 0.04
"""Speed of the square wave [m/s]."""
DITHER_FREQUENCY = 0.7
"""[Hz]"""
PERIODS = 2
"""Periods of a burst."""
PAUSE = 20.0
"""Time between two bursts [s]."""
QUIET = 2.0
"""Time without load on the motors after which a burst begins [s]."""
PROBE_SPEED, PROBE_FREQUENCY = 0.04, 2.5
"""Square wave on a slipping wheel of a robot that drives steadily [m/s], [Hz]."""
_UNLOADED = 1.0  # [N] of traction up to which a wheel shows nothing of its grip
_LOADED = 4.0  # [N] of traction beyond which the motors are excited enough
_DRIVES, _FAST = 0.1, 0.5  # [m/s] between which a robot drives slowly
_STEADY = 0.3  # [m/s²] of demanded acceleration: more loads the motors by itself and needs the grip

SELF_TEST_SPEED = 0.12
"""Speed of the wheels in the self-test at power-on: beyond what stiction hides, 8 cm of way [m/s]."""
SELF_TEST = 1.0 / DITHER_FREQUENCY
"""Duration of the self-test, one period [s]."""


class Dither(NamedTuple):
    """State of the excitation."""

    since_load: float = 0.0
    """Time since the motors were loaded [s]."""
    burst: float = 0.0
    """Time in the burst or, below 0, until the next may begin [s]."""


def null_space_speeds(forces: Array) -> Array:
    """Wheel speeds n with B n = 0 and max |n_i| = 1, shape (n,); zeros where no such direction exists.

    Args:
      forces: B, shape (3, n).
    """
    _, sizes, directions = np.linalg.svd(forces)
    if directions.shape[0] <= len(sizes):
        return np.zeros(forces.shape[1])
    found = directions[-1]
    return found / found[np.argmax(np.abs(found))]


@kernel
def next_self_test(left, h):
    """Sign of the self-test's square wave, 0 when the test is over, and its remaining time [s].

    Args:
      left: Remaining time, `SELF_TEST` at the beginning [s].
      h: Control period [s].
    """
    if left <= 0.0:
        return 0.0, left
    left -= h
    return (1.0 if left > 0.5 * SELF_TEST else -1.0), left


@kernel
def probe_speed(time, speed, acceleration, traction):
    """Speed that is added to a slipping wheel so that its traction shows whether it grips again [m/s].

    The wheel alone is excited: without grip that moves nothing, with grip the other wheels hold the robot. At
    rest, while the drive itself loads the wheels, and against a load on the wheel nothing is added.

    Args:
      time: [s].
      speed: Demand [m/s].
      acceleration: Demand [m/s²].
      traction: Of the wheel [N].
    """
    if speed < _DRIVES or acceleration > _STEADY:
        return 0.0
    wave = PROBE_SPEED if (time * PROBE_FREQUENCY) % 1.0 < 0.5 else -PROBE_SPEED
    return 0.0 if wave * traction < -PROBE_SPEED * _UNLOADED else wave


@kernel
def update_dither(d, h, may, speed, acceleration, traction):
    """Sign of the square wave, −1, 0 or 1; the state is updated in place.

    Args:
      d: `Dither`, a field of a record, changed in place.
      h: Control period [s].
      may: Whether dither is enabled and no fault stands.
      speed: Demand [m/s].
      acceleration: Demand [m/s²].
      traction: Traction of the wheels, shape (n,) [N].
    """
    inside = d.burst > 0.0
    if not may or not _DRIVES < speed < _FAST or acceleration > _STEADY:
        d.since_load, d.burst = 0.0, -PAUSE if inside else min(d.burst, 0.0)
        return 0.0
    if not inside:
        d.burst = min(d.burst + h, 0.0)
        d.since_load = 0.0 if np.abs(traction).max() > _LOADED else d.since_load + h
        if d.burst < 0.0 or d.since_load < QUIET:
            return 0.0
    d.burst += h
    if d.burst > PERIODS / DITHER_FREQUENCY:
        d.since_load, d.burst = 0.0, -PAUSE
        return 0.0
    return 1.0 if (d.burst * DITHER_FREQUENCY) % 1.0 < 0.5 else -1.0
