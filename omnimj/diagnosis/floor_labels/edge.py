"""Truth of an edge: where a camera sees the contact of each wheel, and the line between two floors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from omnimj.diagnosis.floor_labels.currents import Labels
from omnimj.errors import InputError
from omnimj.parameters import Robot
from omnimj.recording.dataset import Run
from omnimj.signals import Array

BAND = 0.010
"""Distance from the line within which the floor under a contact is not known [m]."""
_COARSE, _FINE = 0.015, 0.002  # steps of offsets [m]
_COARSE_ANGLE, _FINE_ANGLE = 5.0, 0.5  # [deg]
_SPAN = 0.05  # offsets of the fine search on both sides [m]
_MOST = 20.0  # misfit of a window that nothing explains
_DRAWS = 300


@dataclass(frozen=True)
class EdgeLine:
    """Line x cos a + y sin a = c in the camera's frame; the second floor lies beyond it."""

    offset: float
    """c [m]."""
    angle: float = 0.0
    """a [rad]."""
    offset_range: tuple[float, float] | None = None
    """90 % range of c over runs drawn with replacement, for a line placed by the data [m]."""

    def beyond(self, contact: Array) -> Array:
        """Distance of contacts beyond the line, shape (..., 2) to (...) [m]."""
        return contact[..., 0] * math.cos(self.angle) + contact[..., 1] * math.sin(self.angle) - self.offset


def contacts(run: Run, robot: Robot, time: Array) -> Array:
    """Contact points of all wheels in the camera's frame, shape (times, n, 2) [m]; NaN outside the poses.

    Args:
      run: Run with a measured pose.
      robot: Gives the wheels' positions.
      time: Times, shape (times,) [s].
    """
    pose = run.unmasked(["x", "y", "heading"])
    known = np.isfinite(pose).all(axis=1)
    if known.sum() < 2:
        return np.full((len(time), robot.wheel_count, 2), np.nan)
    pose[known, 2] = np.unwrap(pose[known, 2])
    x, y, heading = (np.interp(time, run.time[known], pose[known, k]) for k in range(3))
    p, cos, sin = robot.wheel_positions, np.cos(heading)[:, None], np.sin(heading)[:, None]
    return np.stack(
        [x[:, None] + cos * p[:, 0] - sin * p[:, 1], y[:, None] + sin * p[:, 0] + cos * p[:, 1]], axis=-1
    )


def true_labels(distance: Array) -> Labels:
    """Floors under the wheels by their distance beyond the line: 0 or 1, shape (w, n)."""
    return (distance > 0.0).astype(int)


class SeenRun(NamedTuple):
    """Evidence on the place of a line: contacts and currents of one run's windows with a pose."""

    contact: Array
    """Contact points, shape (w, n, 2) [m]."""
    misfit: Array
    """Half the squared distance of the currents from those of each assignment, shape (assignments, w)."""


def misfits(measured: Array, expected: Array, scatter: float) -> Array:
    """Half the sum of squared current residuals over their variance, bounded, shape (assignments, w).

    Args:
      measured: Mean currents, NaN where unknown, shape (w, n) [A].
      expected: Currents by assignment, shape (assignments, w, n) [A].
      scatter: Standard deviation of a residual [A].
    """
    squares = np.nan_to_num((measured - expected) / scatter) ** 2
    return np.minimum(0.5 * squares.sum(axis=-1), _MOST)


def place_line(runs: Sequence[SeenRun]) -> EdgeLine:
    """Line whose sides explain the currents best: search over angles and offsets, coarse, then fine.

    Args:
      runs: Contacts, and misfits of the assignments of two floors to n wheels in their order.

    Raises:
      InputError: No line explains the currents better than one floor under all wheels.
    """
    contact, misfit = np.concatenate([r.contact for r in runs]), np.hstack([r.misfit for r in runs])
    angles = np.radians(np.arange(0.0, 360.0, _COARSE_ANGLE))
    _, angle, offset = _search(contact, misfit, angles, _COARSE)
    angles = angle + np.radians(np.arange(-_COARSE_ANGLE, _COARSE_ANGLE + 0.1, _FINE_ANGLE))
    least, angle, offset = _search(contact, misfit, angles, _FINE, offset)
    if least >= misfit[[0, -1]].sum(axis=1).min():
        found = "found currents that one floor under all wheels explains as well"
        raise InputError("--edge-line", found, "runs in which wheels stand on both floors place a line")
    offsets = offset + np.arange(-_SPAN, _SPAN + 1e-9, _FINE)
    each = np.array([_profile(r.contact, r.misfit, angle, offsets) for r in runs])
    return EdgeLine(offset, math.remainder(angle, 2.0 * math.pi), _bootstrapped(each, offsets))


def _search(
    contact: Array, misfit: Array, angles: Array, step: float, about: float | None = None
) -> tuple[float, float, float]:
    """Least misfit of all lines, with its angle and offset; offsets about a value or over all contacts."""
    best = (math.inf, 0.0, 0.0)
    for angle in angles.tolist():
        if about is None:
            along = contact @ [math.cos(angle), math.sin(angle)]
            offsets = np.arange(along.min(), along.max() + step, step)
        else:
            offsets = about + np.arange(-_SPAN, _SPAN + 1e-9, step)
        total = _profile(contact, misfit, angle, offsets)
        k = int(np.argmin(total))
        best = min(best, (float(total[k]), angle, float(offsets[k])))
    return best


def _profile(contact: Array, misfit: Array, angle: float, offsets: Array) -> Array:
    """Sum of the misfits of lines at one angle, shape (offsets,)."""
    along = contact @ [math.cos(angle), math.sin(angle)]
    weight = 2 ** np.arange(along.shape[1])[::-1]
    columns = np.arange(len(along))
    return np.array([misfit[(along > offset) @ weight, columns].sum() for offset in offsets])


def _bootstrapped(each: Array, offsets: Array) -> tuple[float, float]:
    """90 % range of the best offset over runs drawn with replacement [m]."""
    random = np.random.default_rng(0)
    drawn = random.integers(0, len(each), (_DRAWS, len(each)))
    best = offsets[np.argmin(each[drawn].sum(axis=1), axis=1)]
    low, high = np.quantile(best, [0.05, 0.95])
    return float(low), float(high)
