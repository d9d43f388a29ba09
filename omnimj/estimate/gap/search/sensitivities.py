"""Sensitivities of the predictions to effects that are switched on a little and to free forces."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.estimate.replay.interface import KNOTS, CandidateEffect
from omnimj.estimate.replay.problem import Fit, ModelEffects, Problem
from omnimj.signals import Array

TRIAL_STEP = 0.25
"""Trial step as a share of the typical size: beyond dead zones, small enough for a derivative."""
_THRESHOLDS = (1.0, 2.0, 2.75)
"""Trial steps of an effect with a threshold: a limit that is seldom reached tells nothing of a lower one."""
_CURVE_STEP = 0.1
"""Trial force of a free curve as a share of its typical size."""


def trial_shapes(candidate: CandidateEffect) -> list[dict[int, float]]:
    """All combinations of the trial values of the shape parameters, as index → value."""
    places = [k for k, s in enumerate(candidate.parameters) if s.null_value is None]
    values = [candidate.parameters[k].trials or (candidate.parameters[k].typical,) for k in places]
    shapes = [dict(zip(places, combination, strict=True)) for combination in itertools.product(*values)]
    names = [s.name for s in candidate.parameters]
    if "start" in names and "end" in names:
        begin, end = names.index("start"), names.index("end")
        shapes = [s for s in shapes if s[begin] < s[end]]
    return shapes


def trial_steps(candidate: CandidateEffect) -> list[float]:
    """Trial steps of an effect as shares of its typical size, the first of them in any case."""
    if not candidate.has_threshold:
        return [TRIAL_STEP]

    def is_inside(share: float) -> bool:
        for s in candidate.parameters:
            null = s.null_value
            if null is not None and not s.low <= null + share * (s.typical - null) <= s.high:
                return False
        return True

    return [share for share in _THRESHOLDS if share == _THRESHOLDS[0] or is_inside(share)]


def vanished_point(
    candidate: CandidateEffect, shape: dict[int, float], share: float
) -> tuple[Array, list[tuple[int, float]]]:
    """Parameters of an effect with zero amplitudes in one shape, and trial steps (index, change) of these."""
    at = np.array([shape.get(k, s.null_value or 0.0) for k, s in enumerate(candidate.parameters)])
    steps = []
    for k, s in enumerate(candidate.parameters):
        if s.null_value is None:
            continue
        step = share * (s.typical - s.null_value)
        if not s.low <= s.null_value + step <= s.high:
            step = -step
        steps.append((k, step))
    return at, steps


@dataclass(frozen=True)
class TrialColumns:
    """Effect in one shape, switched on a little."""

    candidate: CandidateEffect
    at: Array
    """Its parameters with vanishing amplitudes, shape (own,)."""
    steps: list[tuple[int, float]]
    """Trial steps (index, change) from there."""
    columns: Array
    """Change of the whitened mismatch with each step, shape (rows, steps)."""


class Sensitivities:
    """Sensitivities, simulated at the first model that needs them and then kept for models near it.

    To first order the sensitivities of a round also serve the judgement of what the round adds.
    """

    def __init__(self) -> None:
        self._changes: dict[tuple[str, bytes, bytes], list[Array]] = {}
        self._curves: list[Array] | None = None
        self._here: tuple[Fit, Array] | None = None

    def trial(
        self,
        problem: Problem,
        current: Fit,
        candidate: CandidateEffect,
        shape: dict[int, float],
        share: float,
    ) -> TrialColumns:
        """Sensitivities to one more effect in one shape, by a simulation for each trial step."""
        at, steps = vanished_point(candidate, shape, share)
        key = candidate.label, at.tobytes(), np.array(steps).tobytes()
        if key not in self._changes:
            points = []
            for k, step in steps:
                own = at.copy()
                own[k] += step
                points.append(np.concatenate([current.x, own]))
            self._changes[key] = self._simulated(problem, current, points, (candidate,))
        return TrialColumns(candidate, at, steps, _columns(problem, self._changes[key]))

    def curves(self, problem: Problem, current: Fit) -> Array:
        """Change by a force of typical size at each knot of every free curve, (rows, variables × `KNOTS`)."""
        if self._curves is None:
            curves = [
                (name, _CURVE_STEP * force * row)
                for name, force in problem.replay.curves.items()
                for row in np.eye(KNOTS)
            ]
            self._curves = self._simulated(problem, current, [current.x] * len(curves), (), curves)
        return _columns(problem, self._curves) / _CURVE_STEP

    def _simulated(
        self,
        problem: Problem,
        current: Fit,
        points: Sequence[Array],
        more: ModelEffects,
        curves: Sequence[tuple[str, Array]] | None = None,
    ) -> list[Array]:
        """Change of the mismatch from a model to each point, shape (blocks, channels) each."""
        if not points:
            return []
        known = self._here  # read once: other threads may simulate as well
        if known is None or known[0] is not current:
            (here,) = problem.mismatches([current.x], current.effects)
            known = self._here = current, here
        return [moved - known[1] for moved in problem.mismatches(points, (*current.effects, *more), curves)]


def _columns(problem: Problem, changes: Sequence[Array]) -> Array:
    """Whitened changes of the mismatch as columns, shape (blocks × channels, changes)."""
    if not changes:
        return np.empty((problem.replay.measured.size, 0))
    return np.stack([problem.whitened(change).ravel() for change in changes], axis=1)
