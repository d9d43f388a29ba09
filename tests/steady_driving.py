"""Settled traction, and the wheel speeds of steady driving, found from rolling without a better guess."""

from __future__ import annotations

import numpy as np

from omnimj.physics.equilibrium import SMOOTHING
from omnimj.physics.inverse_equilibrium import approach_rims, rolling_rim
from omnimj.physics.native import kernel
from omnimj.physics.planar import driven_wheel
from omnimj.physics.traction import force_ratio, relaxation_rate

_FASTEST = 20.0  # [m/s] of a rim: a wheel that would turn faster slides without end


@kernel
def settled_ratio(floor, slip, rolling_speed):
    """F/F_N with a settled bristle: g sign(V_r) + σ2 V_r, or the curve of the slip ratio V_r/V_roll [1]."""
    rate = relaxation_rate(floor, slip, rolling_speed)
    if rate < 1e-12:
        return 0.0
    return force_ratio(floor, slip / rate, slip, rate)


@kernel
def steady_wheel_speeds(model, twist, wheel_speed):
    """Fill the wheel speeds [rad/s] at which a body twist is steady, by friction that becomes sharper.

    Returns:
      Whether there is a solution; without one, where traction cannot balance the drag, they are rolling.
    """
    n, found = wheel_speed.size, False
    rims, radii = np.empty(n), np.empty(n)
    for i in range(n):
        wheel = driven_wheel(model, i).wheel
        rims[i], radii[i] = rolling_rim(wheel, twist), wheel.wheel.radius
    rolling = rims.copy()
    for blunter in (256.0, 64.0, 16.0, 4.0, 1.0):
        found, _ = approach_rims(model, twist, blunter * SMOOTHING, 80, rims)
    if not found or np.abs(rims).max() > _FASTEST:
        found = False
        rims[:] = rolling
    for i in range(n):
        wheel_speed[i] = rims[i] / radii[i]
    return found
