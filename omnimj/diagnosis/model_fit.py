"""Whether the model fits a recorded run: residuals of the force balance in health, by driving regime.

The detector learns the parameters of its force balance during the run. What is left is measured against the
noise of the sensors; where much more is left before any diagnosis, the model lacks physics, and a diagnosis
that follows from it would blame hardware for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.diagnosis.driving_regimes import PHASES, driven_regimes
from omnimj.parameters import Robot
from omnimj.signals import Diagnosis, Trace

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
