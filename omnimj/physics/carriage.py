"""Carriage of the rig, pulled by a wheel of given speed: the part of the rig that depends on the floor only.

m V̇ = F_N f(z, V_r) − F_rail − F_roll with V_r = r φ̇ − V (Eqs. 4.26, 4.32-4.35). It contains neither motor nor
gear, so that their modelling errors cannot end up in the floor's parameters. The floor's rolling resistance
acts on the carriage, without the load that its part on the rollers adds to the rail.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omnimj.parameters.parts import GRAVITY
from omnimj.physics.motor import stick_or_slip
from omnimj.physics.native import kernel
from omnimj.physics.traction import (
    exact_step,
    force_ratio,
    load_factor,
    mean_deflection,
    relaxation_rate,
    rolling_resistance,
    rolling_speed,
)

SUBSTEPS = 2
"""Steps of the model per sample."""

SPEED, ACCELERATION, SLIP, RATIO = range(4)
BLOCK = 4
"""Columns of a block: carriage speed [m/s], its acceleration [m/s²], slip [m/s], F/F_N [1]."""


class CarriageParameters(NamedTuple):
    """Parameters of one run of the carriage."""

    mass: float
    """m_T [kg]."""
    radius: float
    """Wheel radius r [m]."""
    dry: float
    """Dry resistance [N]."""
    viscous: float
    """Viscous resistance [N.s/m]."""
    start_speed: float
    """Initial speed of the carriage [m/s]."""
    delay: float
    """Delay of the measured wheel speed relative to the carriage speed [s]."""
    lateral_speed: float
    """Speed of the gantry [m/s]."""


@kernel
def interpolate_samples(values, place):
    """Linear interpolation at a fractional sample index; constant beyond the ends."""
    place = min(max(place, 0.0), values.size - 1.0)
    k = min(int(place), values.size - 2)
    return values[k] + (values[k + 1] - values[k]) * (place - k)


@kernel
def simulate_carriage(run, floor, wheel_speed, h, decay, per_block, use, blocks):
    """Block means of a carriage's motion from a given speed and an unloaded bristle.

    Args:
      run: `CarriageParameters`.
      floor: `TractionParameters`.
      wheel_speed: φ̇ at every sample, shape (k,) [rad/s].
      h: Sample period [s].
      decay: Decay of the accelerometer's first-order filter over one sample, 0 … 1.
      per_block: Samples per block.
      use: 1 for samples that count for speed and acceleration, otherwise 0, shape (k, 2).
      blocks: Filled with the means, shape (k // per_block, BLOCK); NaN where no sample counts.
    """
    weight, step = run.mass * GRAVITY, h / SUBSTEPS
    normal = weight * load_factor(floor, weight)
    speed, z, filtered, gain = run.start_speed, 0.0, 0.0, 0.0
    slip, acceleration, ratio = run.radius * wheel_speed[0] - speed, 0.0, 0.0
    sums, counts = np.zeros(BLOCK), np.zeros(2)
    for j in range(blocks.shape[0] * per_block):
        if j > 0:
            start, ratio, slip = speed, 0.0, 0.0
            for s in range(SUBSTEPS):
                # both in the middle of the step: a slip of two instants would be late by half of it
                rim = run.radius * interpolate_samples(
                    wheel_speed, j - 1 + (s + 0.5) / SUBSTEPS + run.delay / h
                )
                now = rim - speed - 0.5 * step * gain
                rate = relaxation_rate(floor, now, rolling_speed(floor, rim, speed, run.lateral_speed))
                after = exact_step(z, now, rate, step)
                share = force_ratio(floor, mean_deflection(z, after, now, rate, step), now, rate)
                resisting = run.viscous * speed
                pull = normal * share
                rolling = max(abs(rim), abs(speed))
                dry = run.dry + weight * rolling_resistance(floor, rolling, run.lateral_speed)[0]
                held = stick_or_slip(-dry - resisting, dry - resisting, speed, run.mass, pull, step)
                gain = (pull + held) / run.mass
                speed += step * gain
                z = after
                ratio += share / SUBSTEPS
                slip += now / SUBSTEPS
            acceleration = (speed - start) / h
        filtered = decay * filtered + (1.0 - decay) * acceleration
        counts[0] += use[j, 0]
        counts[1] += use[j, 1]
        sums[SPEED] += use[j, 0] * speed
        sums[ACCELERATION] += use[j, 1] * filtered
        sums[SLIP] += slip
        sums[RATIO] += ratio
        if (j + 1) % per_block == 0:
            block = blocks[j // per_block]
            block[SPEED] = sums[SPEED] / counts[0] if counts[0] > 0.0 else math.nan
            block[ACCELERATION] = sums[ACCELERATION] / counts[1] if counts[1] > 0.0 else math.nan
            block[SLIP] = sums[SLIP] / per_block
            block[RATIO] = sums[RATIO] / per_block
            sums[:] = 0.0
            counts[:] = 0.0
