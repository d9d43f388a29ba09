"""What the rig's sensors make of a replay, and what their effects hide from it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from omnimj.effects import Applied, Channel
from omnimj.gap import rig_kernels as native
from omnimj.gap.rig_runs import CHANNELS, RigRuns
from omnimj.physics.effect_terms import SAG
from omnimj.physics.motor import RESISTANCE, motor_row
from omnimj.signals import Array

_LEAST_SCALE = 1e-3


def true_current(runs: RigRuns, channels: Mapping[str, Channel], lags: Mapping[str, float]) -> Array:
    """The current that flowed: what the monitor says without its scale, offset and delay [A]."""
    change = channels.get("current", Channel())
    scale = math.copysign(max(abs(change.scale), _LEAST_SCALE), change.scale)
    current = (runs.current - change.offset) / scale
    return _later(runs, current, -change.delay - lags.get("current", 0.0))


def _later(runs: RigRuns, series: Array, late: float) -> Array:
    """A series of all runs, later by some time, straight between samples."""
    if late == 0.0:
        return series
    moved = np.empty_like(series)
    for begin, end in zip(runs.first[:-1], runs.first[1:], strict=True):
        places = np.arange(end - begin)
        moved[begin:end] = np.interp(places - late / runs.period, places, series[begin:end])
    return moved


def observed(out: Array, runs: RigRuns, changed: Applied, lags: Mapping[str, float]) -> Array:
    """Block means of what the sensors say of a replay, shape (blocks, channels).

    Args:
      out: Of `rig_kernels.replay_runs`, shape (samples, OUTPUTS).
      runs: What was replayed.
      changed: The machine with its effects.
      lags: Small lateness of each channel [s].
    """
    sensors, h = changed.machine.sensors, runs.period
    chain = {
        "wheel_speed": sensors.speed_filter,
        "carriage_speed": sensors.speed_filter,
        "carriage_acceleration": 1.0 / (2.0 * math.pi * sensors.accelerometer_bandwidth),
    }
    result = np.empty((runs.blocks_first[-1], runs.measured.shape[1]))

    def observe(column: int, series: Array, name: str, lag: float, late: float) -> None:
        change = changed.channels.get(name, Channel())
        delay = (change.delay + late) / h
        means = np.empty(len(result))
        place = (runs.first, runs.blocks_first, runs.size, lag / h, delay)
        native.observe(series, *place, float(change.scale), float(change.offset), means)
        result[:, column] = means

    for c, name in enumerate(CHANNELS):
        observe(c, np.ascontiguousarray(out[:, c]), name, chain[name], lags.get(name, 0.0))
    if runs.target is not None:
        motor = changed.motor_rows(motor_row(changed.machine.motor)[None, :])[0]
        motor[RESISTANCE] += changed.terms[0, SAG]
        wheel = np.ascontiguousarray(out[:, native.WHEEL])
        lag = changed.machine.motor.current_loop
        # the set value may be logged a sample before it acts; the wheel's speed limits it when it does
        asked = _later(runs, runs.target, lags.get("current_target", 0.0))
        observe(len(CHANNELS), native.drawn(asked, wheel, motor), "current", lag, 0.0)
    return result
