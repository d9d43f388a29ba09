"""The gyro's bias in a log, from rests that the wheels show: no log says when nothing was asked for."""

from __future__ import annotations

import numpy as np

from omnimj.control.gyro_bias import (
    AVERAGED,
    BIAS,
    LARGEST_BIAS,
    SETTLING_TIME,
    no_rest_yet,
)
from omnimj.control.standstill import REST_WHEEL_SPEED, REST_YAW_RATE
from omnimj.signals import Array

SHORTEST_REST = 0.3
"""Rests that count [s]."""


def is_still(wheel_speed: Array, yaw_rate: float, bias: float) -> bool:
    """Whether no wheel turns and the gyro says nothing but bias and noise."""
    return bool(np.abs(wheel_speed).max() < REST_WHEEL_SPEED and abs(yaw_rate - bias) < REST_YAW_RATE)


def first_bias(wheel_speed: Array, yaw_rate: Array, period: float) -> Array:
    """What the first rest of a run says of its bias, as a state of `gyro_bias`; 0 without any rest.

    Args:
      wheel_speed: Shape (k, n) [rad/s].
      yaw_rate: Shape (k,) [rad/s].
      period: Of the samples [s].
    """
    rest = no_rest_yet()
    still = np.abs(wheel_speed).max(axis=1) < REST_WHEEL_SPEED
    edges = np.flatnonzero(np.diff(np.concatenate(([False], still, [False])).astype(int)))
    for first, last in edges.reshape(-1, 2):
        if (last - first) * period <= SHORTEST_REST:
            continue
        settled = yaw_rate[first + round(SETTLING_TIME / period) : last]
        if abs(settled.mean()) <= LARGEST_BIAS:
            rest[BIAS], rest[AVERAGED] = settled.mean(), len(settled) * period
            break
    return rest
