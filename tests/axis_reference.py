"""An axis that shares no code with the package: smooth friction, small steps, a drive that holds its command.

Written in plain Python on purpose; logs are those of an ordinary servo drive: the command and the encoder.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

SMOOTH = 1e-4  # [m/s] over which dry friction turns round
FINE = 10  # steps per sample


def log_of(
    resistance: Callable[[float, float, float], float],
    mass: float = 95.0,
    duration: float = 10.0,
    period: float = 1e-3,
    seed: int = 0,
    count: float = 1e-6,
    noise: float = 0.5,
) -> dict[str, np.ndarray]:
    """Columns time, force, position of a run that follows three sines in a closed loop.

    Args:
      resistance: Of position, speed, time: the force against positive direction [N].
      mass: That moves [kg].
      duration: [s]
      period: Of controller and log [s].
      seed: Of the noise.
      count: Of the encoder [m].
      noise: Of the force monitor, RMS [N].
    """
    random = np.random.default_rng(seed)
    n, h = round(duration / period), period / FINE
    t = np.arange(n) * period
    shape = [(0.10, 0.37, 0.0), (0.05, 0.83, 0.4), (0.006, 2.1, 1.1)]
    target = sum(a * np.sin(2 * math.pi * f * t + p) - a * math.sin(p) for a, f, p in shape)
    target *= np.minimum(t / 0.8, 1.0) ** 3
    speed = np.gradient(target, period)
    x = v = seen = filtered = 0.0
    force, position = np.empty(n), np.empty(n)
    for k in range(n):
        position[k] = round((x + 0.3 * count * random.standard_normal()) / count) * count
        if k:
            filtered += 0.2 * ((position[k] - seen) / period - filtered)
        seen = position[k]
        command = 1.5e5 * (target[k] - seen) + 7e3 * (speed[k] - filtered)
        force[k] = command + noise * random.standard_normal()
        for s in range(FINE):
            v += h * (command - resistance(x, v, t[k] + s * h)) / mass
            x += h * v
    return {"time": t, "force": force, "position": position}


def sign(speed: float) -> float:
    """Direction, smooth."""
    return math.tanh(speed / SMOOTH)
