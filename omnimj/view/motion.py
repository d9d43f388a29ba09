"""Planned motion in a trace and patches of the floor, for plots and 3-D scenes."""

from __future__ import annotations

from collections.abc import Container
from typing import Any

import numpy as np

from omnimj.signals import Array, Trace


def wheel_count(columns: Container[str], quantity: str = "wheel_speed") -> int:
    """Return the number of wheels of which a trace holds a quantity."""
    n = 0
    while f"{quantity}_{n + 1}" in columns:
        n += 1
    return n


def planned_position(trace: Trace) -> Array | None:
    """Return the planned path, shape (k, 2) [m]; None for a run without a plan."""
    if "target_x" in trace and "target_y" in trace:
        return np.stack([trace["target_x"], trace["target_y"]], axis=1)
    return None


def planned_heading(trace: Trace) -> Array | None:
    """Return the planned heading, shape (k,) [rad]; None for a run without a plan."""
    for name in ("target_heading", "target_yaw"):
        if name in trace:
            return trace[name]
    return None


def patch_corners(patch: Any) -> Array:
    """Return the corners of a floor patch in the world, shape (4, 2) [m]."""
    half = 0.5 * np.asarray(patch.size, float)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    c, s = np.cos(patch.yaw), np.sin(patch.yaw)
    return corners @ np.array([[c, s], [-s, c]]) + np.asarray(patch.center, float)
