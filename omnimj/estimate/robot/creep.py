"""Creep law of each floor: its form by held-out runs, its numbers with intervals over whole runs.

With x the traction over load, s the slip and v₀ a small slip,
  slip speed                 x = σ s
  slip speed, saturating     x = c tanh(s/v₀) + σ s
  creep ratio, and saturating: the same with s/|r φ̇| in place of s.
Traction is known far better than slip, so that slip is fitted as a function of traction. The rolling radius
of each wheel is fitted along, within the model file's uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from omnimj.estimate.robot.blocks import RunRows
from omnimj.estimate.robot.fit import RobotFit
from omnimj.estimate.robot.records import CreepForm, FloorCreep
from omnimj.estimate.robot.slip import SlipSamples, slip_samples
from omnimj.estimate.robot.uncertainty import LEVEL
from omnimj.signals import Array

FORMS = ("slip speed", "slip speed, saturating", "creep ratio", "creep ratio, saturating")
"""Names of the forms."""
LEAST_TRACTION = 0.02
"""Traction over load that the drive must exceed for a creep law, at its 95 % quantile."""
_FOLDS = 5
_FEWEST_RUNS, _FEWEST_SAMPLES = 2, 300
_BETTER = 0.98  # of the error: a form with more numbers must be better by this factor
_HUBER = 0.01  # [m/s] error of a slip from which it counts linearly
_RADIUS = 2e-3  # relative spread of a rolling radius where the model file states none
_SCALE = {"slip speed": 2.5, "creep ratio": 1.25}  # usual slopes, where the fit begins


@dataclass(frozen=True)
class _Problem:
    """Least squares of one form on some samples."""

    form: str
    samples: SlipSamples
    radius_spread: float

    @property
    def saturates(self) -> bool:
        return self.form.endswith("saturating")

    @property
    def start(self) -> Array:
        """ln σ, then ln c and ln v₀ of a form that saturates, then the radii's deviations, shape (k,)."""
        slope = _SCALE[self.form.removesuffix(", saturating")]
        shape = [np.log(slope)] + ([np.log(0.03), np.log(0.03 / slope)] if self.saturates else [])
        return np.array([*shape, *([0.0] * (int(self.samples.wheel.max()) + 1))])

    def slip(self, x: Array) -> Array:
        """Slip that the law and the radii predict, shape (samples,) [m/s]."""
        s = self.samples
        size = np.abs(s.traction)
        if self.saturates:
            law = _inverse(np.exp(x[:3]), size)
            radii = x[3:]
        else:
            law, radii = size / np.exp(x[0]), x[1:]
        speed = np.abs(s.rolling) if self.form.startswith("creep ratio") else 1.0
        # a larger wheel rolls faster than its nominal radius says: it seems to slip less
        return np.sign(s.traction) * law * speed - radii[s.wheel] * s.rolling

    def residuals(self, x: Array, rows: NDArray[np.bool_]) -> Array:
        """Errors of the slip and the priors in units of their size."""
        error = (self.slip(x) - self.samples.slip)[rows] / _HUBER
        radii = x[3:] if self.saturates else x[1:]
        # the radii's prior, one for each run's worth of samples that belong together
        weight = np.sqrt(rows.sum() / max(len(np.unique(self.samples.run)), 1)) / 3.0
        prior = [weight * radii / self.radius_spread * 0.3]
        if self.saturates:
            prior.append((x[1:3] - self.start[1:3]) * 0.3 * weight)
        return np.concatenate([error, *prior])

    def fitted(self, rows: NDArray[np.bool_]) -> Array:
        """Solution on some of the samples, shape (k,)."""
        found = least_squares(self.residuals, self.start, loss="huber", args=(rows,), max_nfev=40)
        return found.x

    def numbers(self, x: Array) -> dict[str, float]:
        """The law's numbers by name."""
        named = {"slope": float(np.exp(x[0]))}
        if self.saturates:
            named |= {"ceiling": float(np.exp(x[1])), "onset": float(np.exp(x[2]))}
        return named


def _inverse(numbers: Array, traction: Array) -> Array:
    """Slip at which c tanh(s/v₀) + σ s has a value, by interpolation."""
    slope, ceiling, onset = numbers
    slip = np.concatenate(
        [np.linspace(0.0, 4.0 * onset, 60), np.geomspace(4.1 * onset, 4.0 * onset + 1.0, 40)]
    )
    return np.interp(traction, ceiling * np.tanh(slip / onset) + slope * slip, slip)


def identify_creep(fit: RobotFit, rows: Sequence[RunRows]) -> tuple[tuple[FloorCreep, ...], tuple[str, ...]]:
    """Creep law of every floor, and sentences on floors without."""
    by_floor: dict[str, list[RunRows]] = {}
    for run in rows:
        by_floor.setdefault(run.floor, []).append(run)
    found, without = [], []
    for floor, runs in by_floor.items():
        samples = slip_samples(fit, runs) if len(runs) >= _FEWEST_RUNS else None
        reason = _missing(samples, len(runs))
        if samples is None or reason:
            without.append(f"{floor}: no creep law, {reason}")
        else:
            found.append(_floor_creep(fit, floor, runs, samples))
    return tuple(found), tuple(without)


def _missing(samples: SlipSamples | None, runs: int) -> str:
    """Why a floor's creep cannot be identified; empty if it can."""
    if runs < _FEWEST_RUNS:
        return f"{runs} run where {_FEWEST_RUNS} are needed, one of them to hold out"
    driven = 0 if samples is None else len(np.unique(samples.run))
    if samples is None or len(samples.slip) < _FEWEST_SAMPLES or driven < _FEWEST_RUNS:
        return "too few drives whose velocity is known: from rest to rest in 12 s, or with a measured pose"
    pull = float(np.quantile(np.abs(samples.traction), 0.95))
    if pull < LEAST_TRACTION:
        return (
            f"traction reaches {pull:.2g} of the load where {LEAST_TRACTION:g} are needed: accelerate harder"
        )
    return ""


def _floor_creep(fit: RobotFit, floor: str, runs: Sequence[RunRows], samples: SlipSamples) -> FloorCreep:
    radius = fit.unknowns.robot
    given = radius.provenance["wheel.radius"].uncertainty / radius.wheel.radius / np.sqrt(3.0)
    problems = [_Problem(form, samples, given or _RADIUS) for form in FORMS]
    everything = np.ones(len(samples.slip), bool)
    solved = [problem.fitted(everything) for problem in problems]
    forms = [
        CreepForm(p.form, p.numbers(x), _held_out(p, len(runs)))
        for p, x in zip(problems, solved, strict=True)
    ]
    order = np.argsort(
        [form.held_out / (_BETTER if p.saturates else 1.0) for form, p in zip(forms, problems, strict=True)]
    )
    best = int(order[0])
    return FloorCreep(
        floor,
        forms[best],
        tuple(forms[k] for k in order),
        _intervals(problems[best], solved[best], len(runs)),
        float(np.quantile(np.abs(samples.slip), 0.98)),
        samples.moves,
        tuple(run.name for run in runs),
    )


def _held_out(problem: _Problem, runs: int) -> float:
    """RMS error of the slip in runs that were not fitted [m/s]; errors beyond 5 cm/s count as that."""
    folds, squares = min(_FOLDS, runs), []
    for fold in range(folds):
        held = problem.samples.run % folds == fold
        if held.any() and (~held).any():
            x = problem.fitted(~held)
            squares.append(np.minimum(np.abs(problem.slip(x) - problem.samples.slip)[held], 0.05) ** 2)
    return float(np.sqrt(np.concatenate(squares).mean()))


def _intervals(problem: _Problem, whole: Array, runs: int) -> dict[str, tuple[float, float]]:
    """Ends of 90 % intervals by leaving out whole runs (jackknife), in logarithms."""
    k = len(problem.numbers(whole))
    left = np.array([problem.fitted(problem.samples.run != run)[:k] for run in range(runs)])
    spread = np.sqrt((runs - 1) / runs * np.sum((left - left.mean(axis=0)) ** 2, axis=0))
    half = spread * float(student.ppf(0.5 * (1.0 + LEVEL), max(runs - 1, 1)))
    ends = zip(np.exp(whole[:k] - half).tolist(), np.exp(whole[:k] + half).tolist(), strict=True)
    return dict(zip(problem.numbers(whole), ends, strict=True))
