"""Uncertainty of a floor's fit: jackknife over conditions, uncertain constants, profiles, open parameters.

The covariance of the unknowns is the jackknife over whole conditions (repeats together), so that coloured
noise inside a run is accounted for. The uncertainty of constants that the fit takes as known (mass, rail
friction, timing) adds to it. The friction levels, and any parameter with a wide interval, have a profile
interval instead: the parameter is fixed at successive values and all others are refitted.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats
from scipy.optimize import root_scalar

from omnimj.estimate.identification.curve import slope, stribeck
from omnimj.estimate.identification.floor_fit import (
    PRIOR_JACOBIAN,
    V_S,
    FloorFit,
    FloorProblem,
    RunJacobian,
    solve_with_fixed,
    solve_without_stribeck,
)
from omnimj.estimate.identification.records import CONFIDENCE, UNITS, Estimate
from omnimj.estimate.intervals import at_least
from omnimj.parameters import Rig
from omnimj.signals import Array

TIMING = 5e-4
"""Standard deviation of the time between the samples of the two speeds [s]: half a sample period."""

_FEWEST_CLUSTERS = 5
_STRETCHES = 4  # number of stretches of one run, if there are too few conditions
_WIDE = 0.25  # half-width in a logarithm beyond which a straight line is no approximation
_NARROW = 0.02  # the same limit for parameters that are hard to separate: μ_c, μ_s, V_s
_WALK = (0.2, 0.5, 1.0, 2.0, 4.0)
"""Steps in a logarithm away from the estimate; a parameter without an end within e⁴ ≈ 55 is open."""
_END = 0.01  # accuracy of the end of a profile interval relative to the step beyond it
_ROUGH = 2.0  # high over low of an interval above which a number is rough
_FRICTION = ("mu_c", "mu_s", "V_s")
_WHY = {
    "sigma_0": "the bristle's stiffness shows while the wheel begins to slide",
    "sigma_1": "the bristle's damping shows in the first hundredths of a second only",
    "sigma_2": "the runs do not slide over a wide enough range of slip",
}


def known_uncertainty(rig: Rig) -> dict[str, float]:
    """Standard deviations of the constants that the fit takes as known, as arguments of `with_known`.

    Rail friction [N], mass and with it the normal force [kg], and timing [s]. A box of half-width a, the
    uncertainty of the model, gives a/√3; 0 for exact ones.
    """

    def stated(name: str) -> float:
        origin = rig.provenance.get(name)
        return 0.0 if origin is None else origin.uncertainty / math.sqrt(3.0)

    friction, mass = stated("rig.rail_friction"), stated("rig.masses")
    return {"rail_friction_added": friction, "mass_added": mass, "wheel_late": TIMING}


@dataclass(frozen=True)
class FitCovariance:
    """Covariance of the shared unknowns."""

    total: Array
    """Covariance with coloured noise and uncertain constants, shape (SHARED, SHARED)."""
    naive: Array
    """Covariance for white noise alone, shape (SHARED, SHARED)."""
    clusters: int
    effective_samples: float

    @property
    def quantile(self) -> float:
        """Two-sided Student quantile for the clusters."""
        return float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, max(self.clusters - 1, 1)))

    def half_width(self, direction: Array) -> Array:
        """Half-width of the interval of linear combinations: coefficients (n, SHARED) → (n,)."""
        return self.quantile * np.sqrt(np.einsum("ij,jk,ik->i", direction, self.total, direction))


def fit_covariance(fit: FloorFit, known: Mapping[str, float]) -> FitCovariance:
    """Covariance from the jackknife over conditions plus the uncertainty of known constants."""
    jacobians = fit.problem.jacobians(fit.shared, fit.own)
    scores, normals = _per_cluster(fit, jacobians)
    total = PRIOR_JACOBIAN.T @ PRIOR_JACOBIAN + np.sum(normals, axis=0)
    naive = np.linalg.inv(total)
    shifts = np.array([np.linalg.solve(total - n, s) for n, s in zip(normals, scores, strict=True)])
    count = len(shifts)
    jackknife = at_least((count - 1) / count * shifts.T @ shifts, naive)
    shifts_by_known = _shifts_by_known(fit, jacobians, naive, known)
    samples = sum(run.blocks for run in fit.problem.runs)
    worth = np.clip(np.trace(naive @ total) / max(np.trace(jackknife @ total), 1e-12), 0.0, 1.0)
    return FitCovariance(
        jackknife + shifts_by_known.T @ shifts_by_known, naive, count, float(samples * worth)
    )


def _per_cluster(fit: FloorFit, jacobians: Sequence[RunJacobian]) -> tuple[list[Array], list[Array]]:
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


def _shifts_by_known(
    fit: FloorFit, jacobians: Sequence[RunJacobian], naive: Array, known: Mapping[str, float]
) -> Array:
    """Shift of the unknowns by one standard deviation of each known constant, one row for each."""
    shifts = []
    for name, size in known.items():
        runs = tuple(run.with_known(**{name: size}) for run in fit.problem.runs)
        other: FloorProblem = replace(fit.problem, runs=runs)
        moved = other.residuals(fit.shared, fit.own)
        pull = [
            jacobian.without_own().T @ (after - before)
            for jacobian, after, before in zip(jacobians, moved, fit.residuals, strict=True)
        ]
        shifts.append(naive @ np.sum(pull, axis=0))
    return np.array(shifts)


def confidence_interval(
    fit: FloorFit, spread_: FitCovariance, index: int
) -> tuple[float | None, float | None]:
    """Compute the confidence interval of exp(unknown); an end is None if the runs do not bound it."""
    half = float(spread_.half_width(np.eye(len(fit.shared))[index : index + 1])[0])
    value = fit.shared[index]
    if half < (_WIDE if index > V_S else _NARROW):
        return float(np.exp(value - half)), float(np.exp(value + half))
    inflated = max(1.0, spread_.total[index, index] / spread_.naive[index, index])
    threshold = spread_.quantile**2 * inflated
    low, high = (_profile_bound(fit, index, sign, threshold) for sign in (-1.0, 1.0))
    return low, high


def _profile_bound(fit: FloorFit, index: int, sign: float, threshold: float) -> float | None:
    """Value at which the cost has risen by the threshold, the others refitted; None if it never does."""
    at = fit

    @functools.cache
    def excess(step: float) -> float:
        """√rise − √threshold at a distance in the logarithm: nearly a straight line."""
        nonlocal at
        at = solve_with_fixed(fit, index, fit.shared[index] + sign * step, at) if step else fit
        return math.sqrt(max(at.data_cost - fit.data_cost, 0.0)) - math.sqrt(threshold)

    for inside, outside in itertools.pairwise((0.0, *_WALK)):
        if excess(outside) >= 0.0:
            step = root_scalar(excess, bracket=(inside, outside), xtol=_END * outside).root
            return float(np.exp(fit.shared[index] + sign * step))
    return None


def describe_undetermined(
    floor: str,
    fit: FloorFit,
    spread: FitCovariance,
    estimates: Sequence[Estimate],
    covered: tuple[float, float] | None,
    shows_stribeck: bool,
) -> tuple[str, ...]:
    """Describe what the runs leave open, one sentence each.

    Args:
      covered: Slip covered by the runs [m/s]; None where they never slide.
      shows_stribeck: True if the runs show that g depends on slip.
    """
    by_name = {estimate.name: estimate for estimate in estimates}
    sentences = []
    if covered is None:
        sentences.append(
            f"on {floor} the wheel never slides with a settled bristle: "
            "the steady curve is not determined, only the stiffness sigma_0 is"
        )
    if shows_stribeck:
        sentences += _about_friction(floor, fit, spread, by_name, covered or (1e-3, 1e-2))
    else:
        sentences += _constant(floor, fit, spread, covered or (1e-3, 1e-2))
    sentences += [
        _open(floor, by_name[name], why) for name, why in _WHY.items() if not by_name[name].is_determined
    ]
    return tuple(sentences)


def has_stribeck(fit: FloorFit, spread: FitCovariance) -> bool:
    """True if the runs show that g changes with slip: μ_s = μ_c fits them significantly worse."""
    constant = solve_without_stribeck(fit)
    inflated = max(1.0, float(np.max(np.diag(spread.total)[:3] / np.diag(spread.naive)[:3])))
    rise = constant.data_cost - fit.data_cost
    return rise > float(stats.chi2.ppf(CONFIDENCE, 2)) * inflated


def _constant(floor: str, fit: FloorFit, spread: FitCovariance, covered: tuple[float, float]) -> list[str]:
    level = _level(fit, spread, float(np.sqrt(covered[0] * covered[1])))
    return [
        f"mu_s and mu_c cannot be told apart on {floor}: only their common level is determined, "
        f"{level} at the slip of these runs",
        f"V_s is not determined on {floor}: no fall of friction with slip shows",
    ]


def _about_friction(
    floor: str,
    fit: FloorFit,
    spread: FitCovariance,
    estimates: dict[str, Estimate],
    covered: tuple[float, float],
) -> list[str]:
    low, high = covered
    loose = [name for name in _FRICTION if not _is_firm(estimates[name])]
    if not loose:
        return []
    names = f"{', '.join(loose[:-1])} and {loose[-1]}" if len(loose) > 1 else loose[0]
    verb = "are not determined individually" if len(loose) > 1 else "is determined only roughly at best"
    return [
        f"{names} {verb} on {floor}: only the friction level g is well determined, "
        f"{_level(fit, spread, low)} at {1000 * low:.3g} mm/s and {_level(fit, spread, high)} at "
        f"{1000 * high:.3g} mm/s of slip"
    ]


def _is_firm(estimate: Estimate) -> bool:
    if estimate.low is None or estimate.high is None:
        return False
    return estimate.high < _ROUGH * estimate.low


def _level(fit: FloorFit, spread: FitCovariance, slip: float) -> str:
    """Format g at a slip with its interval: `0.1203 ± 0.0010`."""
    at = np.array([slip])
    half = float(spread.half_width(slope(stribeck, fit.shared, at))[0])
    return f"{float(stribeck(fit.shared, at)[0]):.4f} ± {half:.4f}"


def _open(floor: str, estimate: Estimate, why: str) -> str:
    unit = UNITS[estimate.name]
    if estimate.low is None and estimate.high is None:
        return f"{estimate.name} is not determined on {floor}: {why}"
    bound = (
        f"is at least {estimate.low:.3g} {unit}"
        if estimate.low is not None
        else f"is at most {estimate.high:.3g} {unit}"
    )
    return f"{estimate.name} {bound} on {floor}, the other end is open: {why}"
