"""The rig's carriage pulled by a wheel whose speed is given: the part of the rig that knows the floor only.

m V̇ = F_N f(z, V_r) − F_rail − F_roll with V_r = r φ̇ − V (Eqs. 4.26, 4.32-4.35). Neither motor nor gear is in
it, so that what they lack cannot end up in the floor's numbers.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.physics.motor import stick_or_slip
from omnimj.physics.native import kernel
from omnimj.physics.planar import GRAVITY
from omnimj.physics.traction import exact_step, force_ratio, relaxation_rate
from omnimj.physics.wheel import mean_deflection

SUBSTEPS = 2
"""Steps of the model per sample."""

SPEED, ACCELERATION, SLIP, RATIO = range(4)
BLOCK = 4
"""Columns of a block: carriage speed [m/s], its acceleration [m/s²], slip [m/s], F/F_N [1]."""

MASS, RADIUS, DRY, VISCOUS, START, DELAY = range(6)
PULL_ROW = 6
"""Numbers of a run: m_T [kg], r [m], dry resistance [N], viscous one [N.s/m], carriage's speed at the start
[m/s], time by which the measured wheel speed is late against the carriage's [s]."""


@kernel
def interpolate_samples(values, place):
    """Samples joined by straight lines, at a place counted in samples; the ends go on."""
    place = min(max(place, 0.0), values.size - 1.0)
    k = min(int(place), values.size - 2)
    return values[k] + (values[k + 1] - values[k]) * (place - k)


@kernel
def simulate_carriage(run, floor, wheel_speed, h, decay, per_block, use, blocks):
    """Block means of what a carriage does that starts at a given speed, its bristle unloaded.

    Args:
      run: Shape (PULL_ROW,).
      floor: `Floor.row`, shape (ROW,).
      wheel_speed: φ̇ at every sample, shape (k,) [rad/s].
      h: Time between two samples [s].
      decay: Of the accelerometer's first-order bandwidth over one sample, 0 … 1.
      per_block: Samples of a block.
      use: Samples that count for speed and acceleration, 0 or 1, shape (k, 2).
      blocks: Filled with the means, shape (k // per_block, BLOCK); NaN where no sample counts.
    """
    normal, step = run[MASS] * GRAVITY, h / SUBSTEPS
    speed, z, felt, gain = run[START], 0.0, 0.0, 0.0
    slip, acceleration, ratio = run[RADIUS] * wheel_speed[0] - speed, 0.0, 0.0
    sums, counts = np.zeros(BLOCK), np.zeros(2)
    for j in range(blocks.shape[0] * per_block):
        if j > 0:
            start, ratio, slip = speed, 0.0, 0.0
            for s in range(SUBSTEPS):
                # both in the middle of the step: a slip of two instants would be late by half of it
                rim = run[RADIUS] * interpolate_samples(
                    wheel_speed, j - 1 + (s + 0.5) / SUBSTEPS + run[DELAY] / h
                )
                now = rim - speed - 0.5 * step * gain
                rate = relaxation_rate(floor, now, max(abs(rim), abs(speed)))
                after = exact_step(z, now, rate, step)
                share = force_ratio(floor, mean_deflection(z, after, now, rate, step), now, rate)
                resisting = run[VISCOUS] * speed
                pull = normal * share
                held = stick_or_slip(
                    -run[DRY] - resisting, run[DRY] - resisting, speed, run[MASS], pull, step
                )
                gain = (pull + held) / run[MASS]
                speed += step * gain
                z = after
                ratio += share / SUBSTEPS
                slip += now / SUBSTEPS
            acceleration = (speed - start) / h
        felt = decay * felt + (1.0 - decay) * acceleration
        counts[0] += use[j, 0]
        counts[1] += use[j, 1]
        sums[SPEED] += use[j, 0] * speed
        sums[ACCELERATION] += use[j, 1] * felt
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
