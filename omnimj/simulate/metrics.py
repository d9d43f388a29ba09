"""Metrics of a run: heading and path errors, speeds, slip, currents."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from omnimj.signals import Array, Trace


def distance_to_path(points: Array, path: Array) -> Array:
    """Distance of points to a polyline: min over segments ab of |p − a − t (b − a)|, t in [0, 1].

    Only the two segments beside the nearest corner are evaluated, which is exact for a path sampled finely
    compared with its curvature, such as a `Reference`.

    Args:
      points: Points, shape (k, 2) [m].
      path: Corners of the polyline in order, shape (m, 2), m ≥ 1 [m]; repeated corners are allowed.

    Returns:
      Distances, shape (k,) [m].
    """
    moved = np.any(np.diff(path, axis=0) != 0.0, axis=1)
    corners = path[np.concatenate([[True], moved])]
    nearest = cKDTree(corners).query(points)[1]
    last = len(corners) - 1
    before = _to_segment(points, corners[np.maximum(nearest - 1, 0)], corners[nearest])
    after = _to_segment(points, corners[nearest], corners[np.minimum(nearest + 1, last)])
    return np.minimum(before, after)


def _to_segment(p: Array, a: Array, b: Array) -> Array:
    """Distance of each p to its own segment ab, shape (k,) [m]; a segment may have length 0."""
    ab, ap = b - a, p - a
    length2 = np.sum(ab * ab, axis=1)
    t = np.clip(np.sum(ap * ab, axis=1) / np.where(length2 > 0.0, length2, 1.0), 0.0, 1.0)
    return np.linalg.norm(ap - t[:, None] * ab, axis=1)


DIAGNOSIS_UNITS = {"detection_delay": "s", "isolated": "", "false_alarms": ""}
"""Metrics of the diagnoses; `isolated` is 1 if exactly the true faults were named."""
_EXTENSION = 1.0  # [m] of straight path beyond a plan that is still moving
_SPEED_UNITS = {"final_speed": "m/s", "mean_speed": "m/s", "peak_speed": "m/s"}


def metric_units(plant: str, wheels: int, has_path: bool, kinematic: bool) -> dict[str, str]:
    """Names and units of the metrics of a scenario, which its `[checks]` may bound.

    Args:
      plant: `uto_robot` or `quarter_rig`.
      wheels: Number of wheels n.
      has_path: Whether the drive is a path to follow.
      kinematic: Whether the run is at the kinematic level, which has neither currents nor slip.
    """
    if plant == "quarter_rig":
        own = {"peak_slip_1": "m/s", "rms_current": "A", "final_current": "A", "travel": "m"}
        return {**_SPEED_UNITS, **own, **DIAGNOSIS_UNITS}
    units = {"max_yaw_excursion": "rad", "tracking_error_max": "m", **_SPEED_UNITS}
    if has_path:
        units |= {"path_error_max": "m", "path_error_rms": "m"}
    if not kinematic:
        units |= {f"peak_slip_{i}": "m/s" for i in range(1, wheels + 1)} | DIAGNOSIS_UNITS
        units |= {"rms_current": "A", **{f"rms_current_{i}": "A" for i in range(1, wheels + 1)}}
    return units


def compute_metrics(trace: Trace, names: Mapping[str, str]) -> dict[str, float | None]:
    """Compute the metrics of a run; a metric is None if the trace lacks its columns.

    Args:
      trace: Trace of a robot or rig with at least one row.
      names: Metrics to return, from `metric_units`.

    Returns:
      Metric by name: `max_yaw_excursion` largest |heading − planned heading| [rad]; `path_error_max`, `_rms`
      distance of the centre to the planned path [m]; `tracking_error_max` largest distance to where the
      centre should be at that instant [m]; `final_`, `mean_` and `peak_speed` [m/s]; `peak_slip_i` largest
      |V_r,i| [m/s]; `rms_current` over time and wheels, `rms_current_i` of one wheel [A]; `final_current` and
      `travel` of the rig's motor [A] and carriage [m].
    """
    found: dict[str, float | None] = {}
    found |= (
        _heading_metrics(trace)
        | _position_metrics(trace, "path_error_max" in names)
        | _speed_metrics(trace)
        | _slip_metrics(trace)
    )
    found |= _current_metrics(trace)
    if "carriage_position" in trace:
        position = trace["carriage_position"]
        found["travel"] = float(position.max() - position.min())
    return {name: found.get(name) for name in names}


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values)))


def rms(values: Array) -> float:
    """√(mean of squares) over values of any shape, in their unit."""
    return float(np.sqrt(np.mean(np.square(values))))


def _heading_metrics(trace: Trace) -> dict[str, float | None]:
    """Metrics of the true heading where there is one, otherwise of the measured one; either may wrap."""
    column = "heading" if "heading" in trace else "yaw"
    if column not in trace or "target_heading" not in trace:
        return {}
    away = np.unwrap(trace[column] - trace["target_heading"])
    # a measured heading wraps to [0, 2π): the run starts within half a turn of the plan
    away -= 2.0 * np.pi * np.round(away[0] / (2.0 * np.pi))
    return {"max_yaw_excursion": _largest(away)}


def _position_metrics(trace: Trace, has_path: bool) -> dict[str, float | None]:
    if "x" not in trace or "target_x" not in trace:
        return {}
    centre = np.column_stack([trace["x"], trace["y"]])
    planned = np.column_stack([trace["target_x"], trace["target_y"]])
    found: dict[str, float | None] = {
        "tracking_error_max": _largest(np.linalg.norm(centre - planned, axis=1))
    }
    if has_path:
        error = distance_to_path(centre, _extended(planned))
        found |= {"path_error_max": _largest(error), "path_error_rms": rms(error)}
    return found


def _extended(planned: Array) -> Array:
    """Planned path, extended straight on if it still moves at its last sample: a robot may be ahead of it."""
    step = planned[-1] - planned[-2] if len(planned) > 1 else np.zeros(2)
    length = float(np.linalg.norm(step))
    if length == 0.0:
        return planned
    return np.vstack([planned, planned[-1] + _EXTENSION / length * step])


def _speed_metrics(trace: Trace) -> dict[str, float | None]:
    """Metrics of the speed of centre or carriage: the true speed, or that of the rig's encoder."""
    if "twist_x" in trace:
        speed = np.hypot(trace["twist_x"], trace["twist_y"])
    elif "true_carriage_speed" in trace:
        speed = np.abs(trace["true_carriage_speed"])
    elif "carriage_speed" in trace:
        speed = np.abs(trace["carriage_speed"])
    else:
        return {}
    return {
        "final_speed": float(speed[-1]),
        "mean_speed": float(speed.mean()),
        "peak_speed": float(speed.max()),
    }


def _slip_metrics(trace: Trace) -> dict[str, float | None]:
    if "slip_velocity_1" not in trace:
        return {}
    slips = np.abs(trace.wheels("slip_velocity")).max(axis=0)
    return {f"peak_slip_{i}": float(slip) for i, slip in enumerate(slips, start=1)}


def _current_metrics(trace: Trace) -> dict[str, float | None]:
    if "current" in trace:
        # the current monitor is noisy: averaged over the last tenth of a second, or a tenth of a short run
        tail = max(1, min(len(trace["current"]) // 10, int(np.searchsorted(trace["time"], 0.1))))
        return {
            "rms_current": rms(trace["current"]),
            "final_current": float(trace["current"][-tail:].mean()),
        }
    if "current_1" in trace:
        currents = trace.wheels("current")
        each = {f"rms_current_{i}": rms(current) for i, current in enumerate(currents.T, start=1)}
        return {"rms_current": rms(currents), **each}
    return {}
