"""How sure a fit is: conditions left out, what is taken as known in doubt, walks along one parameter.

The spread of the unknowns is the jackknife over whole conditions (repeats together), so that noise of any
colour inside a run counts as what it is. What the problem takes as known (mass, rail friction, timing) adds
to it. The friction levels, and any parameter with a wide interval, are walked along instead: held at value
after value, all others fitted again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from omnimj.identification.floor_problem import EXPECTED_JACOBIAN, V_S, FloorProblem, Jacobian
from omnimj.identification.least_squares import Fit, with_fixed
from omnimj.identification.records import CONFIDENCE
from omnimj.parameters import Rig
from omnimj.signals import Array

TIMING = 5e-4
"""Standard deviation of the time between the samples of the two speeds [s]: half a sample period."""

_FEWEST_CLUSTERS = 5
_STRETCHES = 4  # of one run, where there are too few conditions
_WIDE = 0.25  # half-width in a logarithm beyond which a straight line is no approximation
_NARROW = 0.02  # the same for what may be told apart badly from others: μ_c, μ_s, V_s
_WALK = (0.2, 0.5, 1.0, 2.0, 4.0)  # steps in a logarithm away from the estimate
FARTHEST = _WALK[-1]
"""A parameter that may be e⁴ ≈ 55 times larger or smaller is open."""


@dataclass(frozen=True)
class Known:
    """Standard deviations of what the fit takes as known; 0: it is known."""

    rail_friction: float
    """[N]"""
    mass: float
    """And with it of the normal force [kg]."""
    timing: float = TIMING


def known_of(rig: Rig) -> Known:
    """From the uncertainties that the model states: half-widths of boxes, hence over √3."""

    def stated(name: str) -> float:
        origin = rig.provenance.get(name)
        return 0.0 if origin is None else origin.uncertainty / math.sqrt(3.0)

    return Known(stated("rig.rail_friction"), stated("rig.masses"))


@dataclass(frozen=True)
class Spread:
    """Covariance of the shared unknowns; `total` says all, `naive` what white noise alone would make."""

    total: Array
    """Shape (SHARED, SHARED)."""
    naive: Array
    clusters: int
    effective_samples: float

    @property
    def quantile(self) -> float:
        """Two-sided Student quantile for the clusters."""
        return float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, max(self.clusters - 1, 1)))

    def half_width(self, direction: Array) -> Array:
        """Half of the interval of linear combinations, rows of `direction`."""
        return self.quantile * np.sqrt(np.einsum("ij,jk,ik->i", direction, self.total, direction))


def spread(fit: Fit, known: Known) -> Spread:
    """Jackknife over conditions, plus what is taken as known."""
    jacobians = fit.problem.jacobians(fit.shared, fit.own)
    scores, normals = _per_cluster(fit, jacobians)
    total = EXPECTED_JACOBIAN.T @ EXPECTED_JACOBIAN + np.sum(normals, axis=0)
    naive = np.linalg.inv(total)
    shifts = np.array([np.linalg.solve(total - n, s) for n, s in zip(normals, scores, strict=True)])
    count = len(shifts)
    jackknife = _at_least((count - 1) / count * shifts.T @ shifts, naive)
    shifts_by_known = _shifts_by_known(fit, jacobians, naive, known)
    samples = sum(run.blocks for run in fit.problem.runs)
    worth = np.clip(np.trace(naive @ total) / max(np.trace(jackknife @ total), 1e-12), 0.0, 1.0)
    return Spread(jackknife + shifts_by_known.T @ shifts_by_known, naive, count, float(samples * worth))


def _at_least(covariance: Array, least: Array) -> Array:
    """The covariance, made no smaller than another in any direction: few clusters may agree by chance."""
    root = np.linalg.cholesky(least)
    inverse = np.linalg.inv(root)
    ratios, vectors = np.linalg.eigh(inverse @ covariance @ inverse.T)
    turned = root @ vectors
    return turned * np.maximum(ratios, 1.0) @ turned.T


def _per_cluster(fit: Fit, jacobians: Sequence[Jacobian]) -> tuple[list[Array], list[Array]]:
    """Jᵀr and JᵀJ of every cluster."""
    clusters: dict[object, list[tuple[Array, Array]]] = {}
    few = len({run.run.condition for run in fit.problem.runs}) < _FEWEST_CLUSTERS
    for run, jacobian, residual in zip(fit.problem.runs, jacobians, fit.residuals, strict=True):
        table = jacobian.without_own()
        if not few:
            clusters.setdefault(run.run.condition, []).append((table, residual))
            continue
        speeds = int(np.isfinite(run.measured[:, 0]).sum())
        place = np.concatenate((np.linspace(0.0, 1.0, speeds), np.linspace(0.0, 1.0, len(residual) - speeds)))
        for k in range(_STRETCHES):
            within = np.minimum((place * _STRETCHES).astype(int), _STRETCHES - 1) == k
            clusters.setdefault((run.run.name, k), []).append((table[within], residual[within]))
    scores = [np.sum([t.T @ r for t, r in parts], axis=0) for parts in clusters.values()]
    normals = [np.sum([t.T @ t for t, _ in parts], axis=0) for parts in clusters.values()]
    return scores, normals


def _shifts_by_known(fit: Fit, jacobians: Sequence[Jacobian], naive: Array, known: Known) -> Array:
    """How far the unknowns move when a known number is off by one standard deviation, a row for each."""
    shifts = []
    for change in (
        {"rail_friction_added": known.rail_friction},
        {"mass_added": known.mass},
        {"wheel_late": known.timing},
    ):
        runs = tuple(run.with_known(**change) for run in fit.problem.runs)
        other: FloorProblem = replace(fit.problem, runs=runs)
        moved = other.residuals(fit.shared, fit.own)
        pull = [
            jacobian.without_own().T @ (after - before)
            for jacobian, after, before in zip(jacobians, moved, fit.residuals, strict=True)
        ]
        shifts.append(naive @ np.sum(pull, axis=0))
    return np.array(shifts)


def interval(fit: Fit, spread_: Spread, index: int) -> tuple[float | None, float | None]:
    """Ends of the interval of exp(unknown); an end is None where the runs do not bound it."""
    half = float(spread_.half_width(np.eye(len(fit.shared))[index : index + 1])[0])
    value = fit.shared[index]
    if half < (_WIDE if index > V_S else _NARROW):
        return float(np.exp(value - half)), float(np.exp(value + half))
    inflated = max(1.0, spread_.total[index, index] / spread_.naive[index, index])
    threshold = spread_.quantile**2 * inflated
    low, high = (_walk(fit, index, sign, threshold) for sign in (-1.0, 1.0))
    return low, high


def _walk(fit: Fit, index: int, sign: float, threshold: float) -> float | None:
    """Where the runs' cost has grown by the threshold, others fitted again; None when it never does."""
    at, before, last = fit, 0.0, 0.0
    for step in _WALK:
        at = with_fixed(fit, index, fit.shared[index] + sign * step, at)
        rise = max(at.data_cost - fit.data_cost, 0.0)
        if rise >= threshold:
            share = (threshold**0.5 - last**0.5) / max(rise**0.5 - last**0.5, 1e-12)
            return float(np.exp(fit.shared[index] + sign * (before + share * (step - before))))
        before, last = step, max(last, rise)
    return None
