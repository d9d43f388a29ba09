"""Made-up traces with the columns of each method, for the tests of what is shown of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from omnimj.signals import Trace

LONG = "a_name_without_any_space_that_is_far_longer_than_the_screen_of_a_phone_is_wide/report.html"


def with_robust(trace: Trace) -> Trace:
    """Wheel 2 slips from 3 to 5 s and is named at 3.1 s; motor 3 is weak from 6.5 s on and named at 6.9 s."""
    time, columns = trace["time"], dict(trace.columns)
    rng = np.random.default_rng(7)
    for axis in ("force_x", "force_y", "moment"):
        columns[f"residual_{axis}"] = rng.standard_normal(len(time))
    for i in range(1, 5):
        columns[f"residual_motor_{i}"] = np.where((i == 3) & (time > 6.5), 90.0 * (time - 6.5), 0.5)
        columns[f"threshold_motor_{i}"] = np.full_like(time, 22.0)
        columns[f"residual_slip_{i}"] = np.where((i == 2) & (time > 3.0) & (time < 5.0), 0.08, 0.0)
        columns[f"threshold_slip_{i}"] = np.full_like(time, 0.001)
        columns[f"effectiveness_{i}"] = np.where((i == 3) & (time > 6.9), 0.43, 1.0)
    mode = np.where(time < 0.5, 3.0, 0.0)
    mode[(time >= 3.1) & (time < 5.05) | (time >= 6.9)] = 2.0
    mode[(time >= 6.8) & (time < 6.9)] = 1.0
    return Trace({**columns, "mode": mode}, {**trace.about, "method": "robust"})


def with_published(trace: Trace) -> Trace:
    """Residuals of both signs; wheel 2 crosses below zero."""
    time, columns = trace["time"], dict(trace.columns)
    for i in range(1, 5):
        columns[f"residual_wheel_speed_{i}"] = np.where((i == 2) & (time > 3.0), -4.0, 0.3)
        columns[f"threshold_wheel_speed_{i}"] = np.full_like(time, 1.85)
        columns[f"effectiveness_{i}"] = np.ones_like(time)
        columns[f"weight_{i}"] = np.ones_like(time)
    for axis in "xy":
        columns[f"residual_force_{axis}"] = np.full_like(time, 0.4)
        columns[f"threshold_force_{axis}"] = np.full_like(time, 1.16)
    columns["mode"] = np.where(time > 3.1, 1.0, 0.0)
    return Trace(columns, {**trace.about, "method": "published"})


def with_published_rig(trace: Trace) -> Trace:
    """R1 and R2 of the rig; a motor fault from 0.5 s on."""
    time = trace["time"]
    own = {
        "residual_wheel_speed": 6.0 * time,
        "residual_force": 1.9 * np.ones_like(time),
        "threshold_wheel_speed": np.full_like(time, 1.45),
        "threshold_force": np.full_like(time, 0.45),
        "mode": np.where(time > 0.5, 2.0, 0.0),
    }
    return Trace({**trace.columns, **own}, {**trace.about, "method": "published"})


def diagnosis_record(time: float, kind: str, *wheels: int, **own: Any) -> Mapping[str, Any]:
    """A diagnosis of `metrics.json`."""
    empty = {"confidence": 0.98, "ambiguous_with": [], "effectiveness": None, "cleared": None, "channel": ""}
    return {"time": time, "kind": kind, "wheels": list(wheels), **empty, **own}
