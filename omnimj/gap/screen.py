"""Screening: how much of the mismatch could each effect explain, to first order?

Every candidate is switched on a little; the change of the whitened prediction is its sensitivity. Beside the
base's own sensitivities, all inside their boxes, it explains some share of the squared mismatch. Cheap, and
only used to leave hopeless candidates behind.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.gap.fit import Fit, bounded_step, normal_equations, weights_of
from omnimj.gap.problem import Problem
from omnimj.gap.replay import CandidateForm
from omnimj.signals import Array

_PART = 0.25  # of the typical size: large enough for what has a dead zone, small enough to be a derivative


@dataclass(frozen=True)
class Screened:
    """A candidate, the share that it explains, and where a fit of it should start."""

    candidate: CandidateForm
    share: float
    start: Array
    """Of base, α, effects so far and this one, shape (parameters + own,)."""


def trial_shapes(candidate: CandidateForm) -> list[dict[int, float]]:
    """Every combination of the values at which shape parameters are tried: index → value."""
    places = [k for k, s in enumerate(candidate.parameters) if s.vanishes is None]
    values = [candidate.parameters[k].trials or (candidate.parameters[k].typical,) for k in places]
    shapes = [dict(zip(places, combination, strict=True)) for combination in itertools.product(*values)]
    names = [s.name for s in candidate.parameters]
    if "start" in names and "end" in names:
        begin, end = names.index("start"), names.index("end")
        shapes = [s for s in shapes if s[begin] < s[end]]
    return shapes


def _points(candidate: CandidateForm, shape: dict[int, float]) -> tuple[Array, list[tuple[int, float]]]:
    """The vanished effect in one shape, and the steps of its amplitudes: index, change."""
    at = np.array([shape.get(k, s.vanishes or 0.0) for k, s in enumerate(candidate.parameters)])
    steps = []
    for k, s in enumerate(candidate.parameters):
        if s.vanishes is None:
            continue
        step = _PART * (s.typical - s.vanishes)
        if not s.low <= s.vanishes + step <= s.high:
            step = -step
        steps.append((k, step))
    return at, steps


def screen(
    problem: Problem, current: Fit, candidates: list[CandidateForm], used: NDArray[np.bool_]
) -> list[Screened]:
    """Every candidate in each of its shapes, best shape only, sorted by share.

    Args:
      problem: The data.
      current: The model so far, fitted.
      candidates: What may be added.
      used: Blocks that count, shape (blocks,).
    """
    weight = weights_of(problem, current.residual, used)
    low, high = problem.bounds(current.form)
    box = (low - current.x) / problem.scales(current.form), (high - current.x) / problem.scales(current.form)
    known = np.column_stack([current.jacobian, current.residual.ravel()]) * weight[:, None]
    sums = normal_equations(current.jacobian, current.residual, weight)
    ground = Ground(current, weight, box, known, sums)
    found = []
    for candidate in candidates:
        options = [_try_shape(problem, ground, candidate, shape) for shape in trial_shapes(candidate)]
        found.append(max(options, key=lambda s: s.share))
    return sorted(found, key=lambda s: -s.share)


@dataclass(frozen=True)
class Ground:
    """What every candidate is screened against."""

    current: Fit
    weight: Array
    box: tuple[Array, Array]
    known: Array
    """W [J r], shape (rows, parameters + 1)."""
    sums: Array
    """Its normal equations."""


def _try_shape(
    problem: Problem, ground: Ground, candidate: CandidateForm, shape: dict[int, float]
) -> Screened:
    """One candidate in one shape: the share of the squared mismatch that it explains to first order."""
    current, n = ground.current, len(ground.current.x)
    at, steps = _points(candidate, shape)
    moved = []
    for k, step in steps:
        own = at.copy()
        own[k] += step
        moved.append(np.concatenate([current.x, own]))
    residuals = problem.residuals(moved, (*current.form, candidate))
    new = np.stack([(r - current.residual).ravel() for r in residuals], axis=1) * ground.weight[:, None]
    m = new.shape[1]
    sums = np.zeros((n + m + 1, n + m + 1))
    old = np.r_[0:n, n + m]
    sums[np.ix_(old, old)] = ground.sums
    sums[n : n + m, n : n + m] = new.T @ new
    sums[n : n + m, old] = new.T @ ground.known
    sums[old, n : n + m] = sums[n : n + m, old].T
    ends = np.array(
        [[(getattr(candidate.parameters[k], e) - at[k]) / s for k, s in steps] for e in ("low", "high")]
    )
    bounds = np.sort(ends, axis=0)
    precision, distance = problem.prior(current.x, current.form)
    none = np.zeros(m)
    both = (np.concatenate([precision, none]), np.concatenate([distance, none]))
    box = (np.concatenate([ground.box[0], bounds[0]]), np.concatenate([ground.box[1], bounds[1]]))
    d = bounded_step(sums, box, both, 1e-6)
    full = np.append(d, 1.0)
    own = at.copy()
    for (k, step), size in zip(steps, d[n:], strict=True):
        own[k] += step * size
    start = np.concatenate([current.x + problem.scales(current.form) * d[:n], own])
    whole = max(float(ground.sums[-1, -1]), 1e-30)
    return Screened(candidate, 1.0 - float(full @ sums @ full) / whole, start)
