"""Motion of a machine by dead reckoning from its speeds: measured, and simulated before and after.

Each window of a long run is simulated from the measured state, so both simulations start every window at
the measured position.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.integrate import cumulative_trapezoid

from omnimj.estimate.gap.records import Overlay
from omnimj.parameters import Rig, Robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.signals import Array

KINDS = ("measured", "before", "after")
Rates = Callable[[Overlay, Array, Array], Array]
"""Function (window, channel values, initial coordinates) → rates of the coordinates, shape (k, n)."""


@dataclass(frozen=True)
class Motion:
    """Coordinates of the machine over one run."""

    time: Array
    """Times, shape (k,) [s]."""
    coordinates: Mapping[str, Array]
    """Coordinates, shape (k, n), by `measured`, `before`, `after`; their meaning depends on the machine."""
    begins: tuple[int, ...]
    """Index of the first row of each window."""


def rig_motion(rig: Rig, windows: Sequence[Overlay], channels: Sequence[str]) -> Motion:
    """Integrate carriage and gantry position [m] and wheel angle [rad], shape (k, 3), over one run.

    The drive of the gantry controls its speed, so its motion is the same in all three.
    """
    start = np.array([rig.rig.start_position, 0.0, 0.0])

    def rates(window: Overlay, values: Array, place: Array) -> Array:
        lateral = window.regimes.get("lateral_speed", np.zeros(len(window.time)))
        wheel = _channel(values, channels, "wheel_speed")
        carriage = _channel(values, channels, "carriage_speed")
        return np.column_stack([carriage, filled(np.asarray(lateral, float)), wheel])

    return _driven(windows, start, rates)


def robot_motion(robot: Robot, windows: Sequence[Overlay], channels: Sequence[str]) -> Motion:
    """Integrate x, y [m], heading and n wheel angles [rad], shape (k, 3 + n), from wheels and gyro."""
    wheels = len(robot.wheel_positions)
    backwards = np.linalg.pinv(rolling_matrix(robot.wheel_positions, robot.rolling_directions))
    names = [f"wheel_speed_{i + 1}" for i in range(wheels)]

    def rates(window: Overlay, values: Array, place: Array) -> Array:
        speeds = np.column_stack([_channel(values, channels, name) for name in names])
        twist = robot.wheel.radius * speeds @ backwards.T
        turn = _channel(values, channels, "yaw_rate") if "yaw_rate" in channels else twist[:, 2]
        heading = place[2] + cumulative_trapezoid(turn, window.time, initial=0.0)
        c, s = np.cos(heading), np.sin(heading)
        x, y = twist[:, 0], twist[:, 1]
        return np.column_stack([c * x - s * y, s * x + c * y, turn, speeds])

    return _driven(windows, np.zeros(3 + wheels), rates)


def axis_motion(windows: Sequence[Overlay], channels: Sequence[str]) -> Motion:
    """Return the position along the guide [m], shape (k, 1), measured or integrated."""
    if "position" in channels:
        time = np.concatenate([window.time for window in windows])
        columns = {
            kind: np.concatenate([_channel(getattr(w, kind), channels, "position") for w in windows])[:, None]
            for kind in KINDS
        }
        return Motion(time, columns, _begins(windows))

    def rates(window: Overlay, values: Array, place: Array) -> Array:
        return _channel(values, channels, "velocity")[:, None]

    return _driven(windows, np.zeros(1), rates)


def rig_poses(mj_model: mujoco.MjModel, coordinates: Array) -> Array:
    """Convert the coordinates of `rig_motion` to generalised positions of the rig, shape (k, nq)."""
    qpos = np.tile(mj_model.qpos0, (len(coordinates), 1))
    for column, joint in enumerate(("rail", "gantry", "wheel_1_axle")):
        qpos[:, mj_model.joint(joint).qposadr[0]] = coordinates[:, column]
    return qpos


def filled(values: Array) -> Array:
    """Interpolate masked samples (NaN), shape (k,), linearly; zero if all are masked."""
    known = np.isfinite(values)
    if known.all():
        return values
    if not known.any():
        return np.zeros_like(values)
    rows = np.arange(len(values))
    return np.interp(rows, rows[known], values[known])


def _channel(values: Array, channels: Sequence[str], name: str) -> Array:
    """Return the values of a channel with gaps filled, shape (k,); zero for a missing channel."""
    return filled(values[:, list(channels).index(name)]) if name in channels else np.zeros(len(values))


def _driven(windows: Sequence[Overlay], start: Array, rates: Rates) -> Motion:
    """Integrate all windows, each from the measured position at its start."""
    place, end = start, None
    parts: dict[str, list[Array]] = {kind: [] for kind in KINDS}
    for window in windows:
        if end is not None:
            time, rate = end
            place = place + rate * max(float(window.time[0]) - time, 0.0)
        for kind in KINDS:
            speeds = rates(window, getattr(window, kind), place)
            parts[kind].append(place + cumulative_trapezoid(speeds, window.time, axis=0, initial=0.0))
        last = rates(window, window.measured, place)[-1]
        place, end = parts["measured"][-1][-1], (float(window.time[-1]), last)
    time = np.concatenate([window.time for window in windows])
    columns = {kind: np.concatenate(values) for kind, values in parts.items()}
    return Motion(time, columns, _begins(windows))


def _begins(windows: Sequence[Overlay]) -> tuple[int, ...]:
    lengths = [len(window.time) for window in windows]
    return tuple(np.cumsum([0, *lengths[:-1]]).tolist())
