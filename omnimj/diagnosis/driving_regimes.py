"""Driving regimes of a recorded run: in which a statistic was largest, in which the model does not fit.

The detector learns the parameters of its force balance during the run. What is left is measured against the
noise of the sensors; where much more is left before any diagnosis, the model lacks physics, and a diagnosis
that follows from it would blame hardware for it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.control.robot_constants import robot_constants
from omnimj.parameters import Robot
from omnimj.signals import Array, Diagnosis, Trace

PHASES = ("at rest", "turning", "accelerating", "braking", "steady")
DIRECTIONS = ("", "forward", "backward", "sideways", "diagonal")
"""Direction of the motion in the body frame; empty for a robot that stands or turns."""
_AT_REST = 0.03  # [m/s] speed of the fastest wheel's contact below which a robot stands
_TURNS = 1.0  # × speed of the centre: rim speed of a turn from which a motion is one
_CHANGES = 0.2  # [m/s²] change of speed from which a motion is accelerated or braked
_SMOOTHED = 0.1  # [s] over which speeds are averaged and differentiated
_ALONG = 0.4  # tan of the angle to an axis up to which a motion is along it
_MOST = 0.5  # share of the largest maxima from which a direction is named


@dataclass(frozen=True)
class Regime:
    """Regime in which most of the largest values of a statistic lie."""

    words: str
    """Such as `braking` or `accelerating sideways`."""
    largest: int
    """Number of the largest values that lie in it."""
    of: int
    """Number of largest values."""
    share: float
    """Share of the motion in the regime."""


@dataclass(frozen=True)
class DrivenRegimes:
    """Regime of every sample of a run."""

    time: Array
    """Shape (k,) [s]."""
    phase: NDArray[np.intp]
    """Index into `PHASES`, shape (k,)."""
    direction: NDArray[np.intp]
    """Index into `DIRECTIONS`, shape (k,)."""

    def between(self, start: float, end: float) -> tuple[int, int]:
        """Most frequent phase and direction of a time interval [s]."""
        rows = slice(*np.searchsorted(self.time, (start, end)))
        phase, direction = self.phase[rows], self.direction[rows]
        if not len(phase):
            return 0, 0
        most = int(np.bincount(phase).argmax())
        return most, int(np.bincount(direction[phase == most]).argmax())


def driven_regimes(time: Array, wheel_speed: Array, robot: Robot) -> DrivenRegimes:
    """Classify the motion of a robot by its wheel speeds φ̇, shape (k, n) [rad/s], at times of shape (k,) [s].

    The body's twist follows from the wheel speeds by least squares, r φ̇ = Bᵀ twist.
    """
    constants = robot_constants(robot)
    rim = constants.radius * wheel_speed
    rows = max(1, round(_SMOOTHED / max(float(np.median(np.diff(time))), 1e-6))) if len(time) > 1 else 1
    twist = _averaged(rim @ np.linalg.pinv(constants.forces), rows)
    v_x, v_y, around = twist.T
    speed, turning = np.hypot(v_x, v_y), np.abs(constants.forces[2]).mean() * np.abs(around)
    change = np.gradient(speed, time) if len(time) > 1 else np.zeros(len(time))
    phase = np.full(len(time), PHASES.index("steady"))
    phase[change > _CHANGES] = PHASES.index("accelerating")
    phase[change < -_CHANGES] = PHASES.index("braking")
    phase[turning > _TURNS * speed] = PHASES.index("turning")
    phase[np.abs(rim).max(axis=1) < _AT_REST] = PHASES.index("at rest")
    direction = np.full(len(time), DIRECTIONS.index("diagonal"))
    direction[np.abs(v_y) < _ALONG * np.abs(v_x)] = DIRECTIONS.index("forward")
    direction[(np.abs(v_y) < _ALONG * np.abs(v_x)) & (v_x < 0.0)] = DIRECTIONS.index("backward")
    direction[np.abs(v_x) < _ALONG * np.abs(v_y)] = DIRECTIONS.index("sideways")
    direction[phase <= PHASES.index("turning")] = 0
    return DrivenRegimes(time, phase, direction)


def _averaged(values: Array, rows: int) -> Array:
    """Average over a number of rows around each row, shape (k, 3)."""
    sums = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), values]), axis=0)
    first = np.maximum(np.arange(len(values)) - rows // 2, 0)
    last = np.minimum(np.arange(len(values)) + (rows + 1) // 2, len(values))
    last = np.maximum(last, first + 1)
    return (sums[last] - sums[first]) / (last - first)[:, None]


def regime_of(places: Sequence[tuple[int, int]], driven: Iterable[DrivenRegimes]) -> Regime:
    """Regime that most of the places, phases and directions of the largest values, share."""
    phase, _ = Counter(one for one, _ in places).most_common(1)[0]
    own = Counter(direction for one, direction in places if one == phase)
    direction, many = own.most_common(1)[0]
    inside = moved = 0
    named = many >= _MOST * len(places) and DIRECTIONS[direction] != ""
    for run in driven:
        moved += int((run.phase != 0).sum())
        holds = run.phase == phase
        inside += int((holds & (run.direction == direction) if named else holds).sum())
    words = f"{PHASES[phase]} {DIRECTIONS[direction]}" if named else PHASES[phase]
    return Regime(words, many if named else sum(own.values()), len(places), inside / max(moved, 1))


MOST_LEFT = 2.0
"""Residual, in units of the expected noise, from which a model does not fit: the yardstick by which the gap
workflow calls a model incomplete."""
SHORTEST = 2.0
"""Duration in a regime from which it is judged [s]."""
MISFIT = "misfit"
"""Column of the detector's log: RMS of the whitened residuals of the last 50 ms."""


@dataclass(frozen=True)
class DoesNotFit:
    """Driving regime in which the model fits a run worst."""

    regime: str
    """One of `PHASES`."""
    size: float
    """Median residual of the force balance, in units of the expected noise."""
    seconds: float
    """Duration in this regime that was judged [s]."""


def judge_fit(trace: Trace, robot: Robot, diagnoses: Sequence[Diagnosis]) -> DoesNotFit | None:
    """Judge how well the model of a robot fits a run until its first diagnosis.

    A run that is diagnosed before any regime has lasted long enough is judged as a whole.

    Returns:
      The regime with the largest residual, or None if the model fits in all of them.
    """
    time = np.asarray(trace["time"], float)
    if MISFIT not in trace or len(time) < 2:
        return None
    speeds = np.column_stack([trace[f"wheel_speed_{i}"] for i in range(1, len(robot.wheels) + 1)])
    phase = driven_regimes(time, speeds, robot).phase
    period, left = float(np.median(np.diff(time))), np.asarray(trace[MISFIT], float)
    judged = [(left > 0.0) & (phase == k) for k in range(1, len(PHASES))]
    healthy = time < min((d.time for d in diagnoses), default=np.inf)
    before = [rows & healthy for rows in judged]
    if max(float(rows.sum()) * period for rows in before) >= SHORTEST:
        judged = before
    found = [
        DoesNotFit(words, float(np.median(left[rows])), float(rows.sum()) * period)
        for words, rows in zip(PHASES[1:], judged, strict=True)
        if float(rows.sum()) * period >= SHORTEST
    ]
    worst = max(found, key=lambda one: one.size, default=None)
    return worst if worst is not None and worst.size > MOST_LEFT else None


def describe_misfit(found: DoesNotFit, withheld: Sequence[Diagnosis]) -> str:
    """Describe in one sentence that a model does not fit, and what it would have blamed."""
    many = f"; {len(withheld)} diagnos{'es' if len(withheld) > 1 else 'is'} withheld" if withheld else ""
    return f"the model does not fit: {found.size:.2g} × the noise is left ({found.regime}){many}"
