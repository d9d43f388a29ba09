"""Random missions of an episode, as those of `simulate.suites.missions`, computed segment by segment."""

from __future__ import annotations

import math

import numpy as np

from omnimj.signals import Array
from omnimj.simulate.compiled.row import Plan
from omnimj.simulate.suites.missions import ACCELERATION, YAW_ACCELERATION, demanded_twists


def draw_plan(draws: np.random.Generator, duration: float, period: float) -> Plan:
    """Draw a mission: straight segments at 0.2-1.0 m/s with turns, stops and reversals, from rest to rest.

    Within a segment the velocity goes from where it is to the demand at constant acceleration, so that no
    loop over the control periods is needed.

    Args:
      draws: Random number generator.
      duration: Duration [s].
      period: Control period [s].
    """
    rows = round(duration / period) + 1
    twist, now, row = np.zeros((rows, 3)), np.zeros(3), 0
    for begin, end, demand in demanded_twists(draws, rows, period):
        twist[row:begin] = _approach(now, np.zeros(3), begin - row, period)
        now = twist[begin - 1]
        twist[begin:end] = _approach(now, np.array(demand), end - begin, period)
        now, row = twist[end - 1], end
    twist[row:] = _approach(now, np.zeros(3), rows - row, period)
    before = np.vstack((np.zeros(3), np.cumsum(twist[:-1], axis=0) * period))
    return Plan(np.column_stack([before, twist[:, :2]]), twist[:, 2].copy())


def _approach(now: Array, demand: Array, rows: int, period: float) -> Array:
    """Twists that approach a demand at the largest accelerations, shape (rows, 3)."""
    time, away = period * np.arange(1, rows + 1), demand - now
    far = math.hypot(away[0], away[1])
    along = np.minimum(ACCELERATION * time / far, 1.0) if far > 0.0 else np.ones(rows)
    turned = np.clip(away[2], -YAW_ACCELERATION * time, YAW_ACCELERATION * time)
    return np.column_stack([now[0] + along * away[0], now[1] + along * away[1], now[2] + turned])
