"""Use of faulty parts, slip and excursions of a run, from the truth columns of its trace."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from omnimj.plant.faults import Fault
from omnimj.signals import Array, Trace

IN_USE = 2.0
"""Traction above which a wheel counts as in use [N]."""
SMOOTHING_TIME = 0.02
"""Length of the moving average of traction, since rollers take turns [s]."""
LONG_USE = 5.0
"""Time of use after which the estimate of a torque constant should be settled [s]."""
HOLD_TIME = 0.02
"""Time for which a slip velocity must be held to count, the passage of a few rollers [s]."""


def demanded_traction(healthy: Trace) -> Array:
    """Return |mean of F_i over the last `SMOOTHING_TIME`|, the traction that a motion demands of each wheel.

    Args:
      healthy: Trace of the same case without fault: in a faulty run the fault changes the traction itself.

    Returns:
      Shape (k, n) [N].
    """
    force, time = healthy.wheels("traction_force"), healthy["time"]
    rows = max(1, round(SMOOTHING_TIME / (time[1] - time[0]))) if len(time) > 1 else 1
    total = np.vstack([np.zeros(force.shape[1]), np.cumsum(force, axis=0)])
    first = np.maximum(np.arange(len(force)) - rows + 1, 0)
    last = np.arange(1, len(force) + 1)
    return np.abs((total[last] - total[first]) / (last - first)[:, None])


def in_use(fault: Fault, time: Array, traction: Array) -> NDArray[np.bool_]:
    """Return a mask of samples at which a fault is present and its part in use.

    A wheel is in use while more than `IN_USE` of traction is demanded of it; sensors of the body and motors
    that run away always are.

    Args:
      fault: The fault.
      time: Shape (k,) [s].
      traction: From `demanded_traction`, shape (k, n) [N].

    Returns:
      Mask, shape (k,).
    """
    holds = (time >= fault.onset - 1e-9) & (time < (math.inf if fault.end is None else fault.end))
    works = traction > IN_USE
    channel = str(fault.numbers.get("channel", ""))
    if fault.kind == "sensor" and channel.startswith("wheel_speed_"):
        return holds & works[:, int(channel.rpartition("_")[2]) - 1]
    if fault.kind in ("sensor", "hard_over"):
        return holds
    if fault.wheel is None:
        return holds & works.any(axis=1)
    return holds & works[:, fault.wheel - 1]


def first_time(time: Array, holds: NDArray[np.bool_]) -> float | None:
    """Return the first time at which a mask holds [s]; None: never.

    Args:
      time: Times, shape (k,) [s].
      holds: Mask, shape (k,).
    """
    return float(time[int(np.argmax(holds))]) if holds.any() else None


def time_after_use(time: Array, used: NDArray[np.bool_], seconds: float = LONG_USE) -> float | None:
    """Return the time at which the total time of use reaches a duration [s]; None: never.

    Args:
      time: Shape (k,) [s].
      used: Mask of use, shape (k,).
      seconds: Total duration of use [s].
    """
    period = float(time[1] - time[0]) if len(time) > 1 else 0.0
    return first_time(time, np.cumsum(used) * period >= seconds)


def held_slip(trace: Trace, wheel: int, begin: float, end: float) -> float:
    """Return the largest |V_r| that a wheel holds for `HOLD_TIME` between two times.

    max_t min_{t ≤ τ < t + T} |V_r(τ)|, with T = `HOLD_TIME`.

    Args:
      trace: Trace with the columns of truth.
      wheel: Wheel 1…n.
      begin: First time [s].
      end: Time that follows the last one; ∞: that of the whole run [s].

    Returns:
      Slip velocity [m/s]; 0 for a run that is shorter than T.
    """
    time = trace["time"]
    present = (time >= begin - 1e-9) & (time < end)
    slip = np.where(present, np.abs(trace[f"slip_velocity_{wheel}"]), 0.0)
    rows = max(1, round(HOLD_TIME / (time[1] - time[0]))) if len(time) > 1 else 1
    if len(slip) < rows:
        return 0.0
    return float(np.lib.stride_tricks.sliding_window_view(slip, rows).min(axis=1).max())


def departures(trace: Trace, other: Trace, onset: float) -> tuple[float, float]:
    """Return the largest difference between two runs of heading [rad] and position [m] since an onset.

    Args:
      trace: Trace of a run with a fault.
      other: Trace of the same run without it, of the same length.
      onset: Onset of the fault, until which the runs agree [s].
    """
    first = min(int(np.searchsorted(trace["time"], onset - 1e-9)), len(trace["time"]) - 1)
    turned = np.unwrap(trace["heading"] - other["heading"])[first:]
    away = np.hypot(trace["x"] - other["x"], trace["y"] - other["y"])[first:]
    return float(np.max(np.abs(turned))), float(np.max(away))


def excursions(trace: Trace, onset: float) -> tuple[float, float]:
    """Return max_t |e(t) − e(t_0)| of heading error [rad] and position error [m].

    The error at the onset is subtracted, since it is not caused by the fault.

    Args:
      trace: Trace with the columns of truth and target.
      onset: t_0 [s].
    """
    first = int(np.searchsorted(trace["time"], onset - 1e-9))
    first = min(first, len(trace["time"]) - 1)
    heading = np.unwrap(trace["heading"] - trace["target_heading"])[first:]
    x, y = ((trace[k] - trace[f"target_{k}"])[first:] for k in ("x", "y"))
    away = np.hypot(x - x[0], y - y[0])
    return float(np.max(np.abs(heading - heading[0]))), float(np.max(away))
