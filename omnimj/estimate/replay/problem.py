"""A replay as a least-squares problem: whitened mismatch as a function of the parameters, and its fit.

Parameters: the base, the share α of the roller-level dynamics, then those of the effects in the model.
  prediction = equations(θ) + α [twin(θ₀) − equations(θ₀)]
θ₀ is the model at which the twin was simulated last. α = 1 reproduces data of the twin exactly at θ₀, α = 0
data of the textbook's equations; α is a nuisance parameter, refitted like the base.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnimj.estimate.least_squares import minimise, normal_equations
from omnimj.estimate.replay.interface import CandidateEffect, Replay, Setting
from omnimj.signals import Array

_STEP, _CENTRAL_STEP = 0.02, 0.005  # of finite differences, over a parameter's scale
_IMPACT_STEP = 0.1  # the same for effects that act by impacts
_POLISHED, _MOST_POLISHED = 1e-5, 10  # relative fall of the loss that ends a polished fit; its Jacobians

ModelEffects = tuple[CandidateEffect, ...]
"""Effects in a model."""


@dataclass(frozen=True)
class Problem:
    """Least-squares problem of a replay: data, noise and robust scale.

    Parameters x have the shape (n,), mismatches and residuals (blocks, channels), masks of the blocks that
    count (blocks,), Jacobians (blocks × channels, parameters).
    """

    replay: Replay
    noise: Array
    """Standard deviation of a block mean, shape (channels,)."""
    offset: Array | None = None
    """twin(θ₀) − equations(θ₀), shape (blocks, channels)."""
    huber_scale: float = 10.0
    """Mismatch in units of noise beyond which it counts linearly (pseudo-Huber)."""

    @property
    def has_twin_share(self) -> bool:
        """True if the share α of the roller-level dynamics is a parameter."""
        return self.offset is not None

    def split(
        self, x: Array, effects: ModelEffects, curve: tuple[str, Array] | None = None
    ) -> tuple[Setting, float]:
        """Split a parameter vector into the setting of the replay and α.

        Args:
          curve: Variable and force at the knots of a free curve, shape (KNOTS,); none when None.
        """
        n = len(self.replay.base)
        share = float(x[n]) if self.has_twin_share else 0.0
        at = n + self.has_twin_share
        values = {}
        for candidate in effects:
            values[candidate.label] = np.asarray(x[at : at + len(candidate.parameters)])
            at += len(candidate.parameters)
        return Setting(np.asarray(x[:n]), values, curve), share

    def bounds(self, effects: ModelEffects) -> tuple[Array, Array]:
        """Return the lowest and the highest value of every parameter, shape (n,) each."""
        low = [b.low for b in self.replay.base] + [0.0] * self.has_twin_share
        high = [b.high for b in self.replay.base] + [1.0] * self.has_twin_share
        for candidate in effects:
            low += [s.low for s in candidate.parameters]
            high += [s.high for s in candidate.parameters]
        return np.array(low), np.array(high)

    def scales(self, effects: ModelEffects) -> Array:
        """Return the natural size of a change of every parameter, shape (n,)."""
        sizes = [max(0.5 * (b.high - b.low), 1e-12) for b in self.replay.base] + [1.0] * self.has_twin_share
        for candidate in effects:
            for s in candidate.parameters:
                size = abs(s.typical - (s.null_value or 0.0))
                sizes.append(size or 0.1 * (s.high - s.low) or 1.0)  # 1: a fixed one
        return np.array(sizes)

    def difference_steps(self, effects: ModelEffects, fine: float) -> Array:
        """Return the steps of finite differences, shape (n,), where that of a smooth parameter is given.

        Args:
          fine: Step of a parameter that acts smoothly, over its scale.
        """
        steps = np.full(len(self.replay.base) + self.has_twin_share, fine)
        for candidate in effects:
            own = _IMPACT_STEP if candidate.has_impacts else fine
            steps = np.append(steps, np.full(len(candidate.parameters), own))
        return steps * self.scales(effects)

    def steps(self, x: Array, effects: ModelEffects) -> tuple[Array, Array]:
        """Return the lowest and the highest change of every parameter in its scale, shape (n,) each."""
        (low, high), scales = self.bounds(effects), self.scales(effects)
        return (low - x) / scales, (high - x) / scales

    def start(self) -> Array:
        """Return the parameters of the nominal model, shape (base and α,)."""
        return np.array([b.nominal for b in self.replay.base] + [1.0] * self.has_twin_share)

    def prior(self, x: Array, effects: ModelEffects) -> tuple[Array, Array]:
        """Compute the precision of every parameter and its distance from nominal.

        A box of half-width a has the variance a²/3, a shape that is roughly known beforehand its
        `spread`. The prior decides only what the data leave open: the share of an effect that the
        base's own uncertainty explains, and the place of a mass of which the data show the moment alone.

        Returns:
          Precision and distance, both in the parameter's scale and of shape (n,); zero for α and for other
          parameters of effects.
        """
        n, scales = len(self.replay.base), self.scales(effects)
        precision, distance = np.zeros(len(x)), np.zeros(len(x))
        precision[:n] = 3.0
        nominal = np.array([b.nominal for b in self.replay.base])
        distance[:n] = (x[:n] - nominal) / scales[:n]
        at = n + self.has_twin_share
        for shape in (shape for candidate in effects for shape in candidate.parameters):
            if math.isfinite(shape.spread):
                precision[at] = (scales[at] / shape.spread) ** 2
                distance[at] = (x[at] - shape.typical) / scales[at]
            at += 1
        return precision, distance

    def mismatches(
        self,
        xs: Sequence[Array],
        effects: ModelEffects,
        curves: Sequence[tuple[str, Array] | None] | None = None,
    ) -> list[Array]:
        """Compute measured − predicted for each parameter vector, with its own free curve where given."""
        curves = [None] * len(xs) if curves is None else curves
        parts = [self.split(x, effects, curve) for x, curve in zip(xs, curves, strict=True)]
        simulated = self.replay.simulate([setting for setting, _ in parts])
        found = []
        for values, (_, share) in zip(simulated, parts, strict=True):
            predicted = values if self.offset is None else values + share * self.offset
            found.append(self.replay.measured - predicted)
        return found

    def whitened(self, mismatch: Array) -> Array:
        """Express a mismatch in units of noise, 0 where masked; each run's offset is removed by its prior.

        A run's offset with standard deviation w leaves √(σ²/(σ² + n w²)) of the mean of n blocks.
        """
        r = mismatch / self.noise
        odd = ~np.isfinite(r)
        r[odd] = np.nan_to_num(r[odd])
        for c, channel in enumerate(self.replay.channels):
            if channel.run_offset_spread > 0.0:
                for segment in self.replay.segments:
                    part = r[segment.first : segment.last, c]
                    used = np.isfinite(mismatch[segment.first : segment.last, c])
                    n = int(used.sum())
                    if n:
                        ratio = n * (channel.run_offset_spread / self.noise[c]) ** 2
                        part[used] -= part[used].mean() * (1.0 - 1.0 / np.sqrt(1.0 + ratio))
        return r

    def residuals(
        self,
        xs: Sequence[Array],
        effects: ModelEffects,
        curves: Sequence[tuple[str, Array] | None] | None = None,
    ) -> list[Array]:
        """Compute the whitened mismatches, shape (blocks, channels) each, 0 where masked."""
        return [self.whitened(m) for m in self.mismatches(xs, effects, curves)]

    def losses(self, residual: Array) -> Array:
        """Compute the pseudo-Huber loss of every block, Σ over channels of 2 δ² (√(1 + (r/δ)²) − 1)."""
        d = self.huber_scale
        return (2.0 * d * d * (np.sqrt(1.0 + (residual / d) ** 2) - 1.0)).sum(axis=1)

    def jacobian(self, x: Array, effects: ModelEffects, columns: Sequence[int] | None = None) -> Array:
        """Compute d(residual)/d(parameter/scale) by finite differences.

        The column of a parameter whose bounds are equal is 0.

        Args:
          columns: Indices of the parameters to differentiate by; all when None.
        """
        low, high = self.bounds(effects)
        scales = self.scales(effects)
        columns = range(len(x)) if columns is None else columns
        free = [place for place, k in enumerate(columns) if high[k] > low[k]]
        found = np.zeros((self.replay.measured.size, len(columns)))
        if not free:
            return found
        moved, steps, sizes = [x], [], self.difference_steps(effects, _STEP)
        for k in (columns[place] for place in free):
            step = sizes[k]
            if x[k] + step > high[k]:
                step = -step
            if x[k] + step < low[k]:
                step = max(high[k] - x[k], 1e-9 * scales[k])
            other = x.copy()
            other[k] += step
            moved.append(other)
            steps.append(step / scales[k])
        here, *there = self.residuals(moved, effects)
        for place, r, step in zip(free, there, steps, strict=True):
            found[:, place] = (r - here).ravel() / step
        return found

    def central_jacobian(self, x: Array, effects: ModelEffects) -> Array:
        """Compute d(residual)/d(parameter/scale) by central differences, one-sided at a bound.

        Parameters that can only be told apart by the base's own bounds (a motor's constant, its resistance
        and the damping of its joint) seem determined by the errors of one-sided differences.
        """
        low, high = self.bounds(effects)
        step = self.difference_steps(effects, _CENTRAL_STEP)
        ends = np.minimum(x + step, high), np.maximum(x - step, low)
        free = np.flatnonzero(ends[0] > ends[1])
        moved = [np.where(np.arange(len(x)) == k, end, x) for end in ends for k in free]
        residuals = self.residuals(moved, effects)
        found = np.zeros((self.replay.measured.size, len(x)))
        for place, k in enumerate(free):
            change = residuals[place] - residuals[place + len(free)]
            found[:, k] = change.ravel() / (ends[0][k] - ends[1][k])
        return found * self.scales(effects)


def huber_weights(problem: Problem, residual: Array, used: NDArray[np.bool_]) -> Array:
    """Square roots of the weights of iteratively reweighted least squares, shape (blocks × channels,)."""
    w = (1.0 + (residual / problem.huber_scale) ** 2) ** -0.25
    return (w * used[:, None]).ravel()


@dataclass(frozen=True)
class Fit:
    """Fitted model."""

    effects: ModelEffects
    x: Array
    """Parameters, shape (n,)."""
    residual: Array
    """Whitened mismatch, shape (blocks, channels)."""
    jacobian: Array
    """d(residual)/d(x/scale) at (or one small step from) x, shape (blocks × channels, n)."""
    loss: float
    """Loss over the blocks that the model was fitted to, prior included."""

    @property
    def labels(self) -> frozenset[str]:
        """Labels of the effects."""
        return frozenset(candidate.label for candidate in self.effects)


def fit(
    problem: Problem,
    effects: ModelEffects,
    start: Array,
    used: NDArray[np.bool_],
    rounds: int = 3,
    known: Array | None = None,
) -> Fit:
    """Fit base, α and effects from a start of shape (n,) to the blocks in use, shape (blocks,).

    Args:
      known: Jacobian of the leading parameters near the start, shape (blocks × channels, some), if already
        computed.
    """
    found = minimise(_FitProblem(problem, effects, used), start, rounds=rounds, known=known)
    return Fit(effects, found.x, found.residual, found.jacobian, found.loss)


def polish(problem: Problem, fitted: Fit, used: NDArray[np.bool_]) -> Fit:
    """Fit a model until its loss no longer falls, so that the prior decides what the data leave open.

    Along a valley in which parameters trade against each other, a mass against its distance, the loss falls
    too slowly for the fits of the search, which end earlier. Impacts leave no fine derivative along which a
    model with them could be polished.
    """
    if any(candidate.has_impacts for candidate in fitted.effects):
        return fitted
    own = _FitProblem(problem, fitted.effects, used)
    found = minimise(own, fitted.x, rounds=_MOST_POLISHED, tolerance=_POLISHED)
    return Fit(fitted.effects, found.x, found.residual, found.jacobian, found.loss)


def reevaluate(fitted: Fit, problem: Problem) -> Fit:
    """Evaluate residual and Jacobian of a fit anew, for a problem with another noise or offset."""
    (residual,) = problem.residuals([fitted.x], fitted.effects)
    return replace(fitted, residual=residual, jacobian=problem.jacobian(fitted.x, fitted.effects))


@dataclass(frozen=True)
class _FitProblem:
    """Fit of one model to the blocks in use, a problem for `least_squares.minimise`."""

    problem: Problem
    effects: ModelEffects
    used: NDArray[np.bool_]

    def bounds(self) -> tuple[Array, Array]:
        return self.problem.bounds(self.effects)

    def scales(self) -> Array:
        return self.problem.scales(self.effects)

    def prior(self, x: Array) -> tuple[Array, Array]:
        return self.problem.prior(x, self.effects)

    def residuals(self, points: Sequence[Array]) -> list[Array]:
        return self.problem.residuals(points, self.effects)

    def loss(self, x: Array, residual: Array) -> float:
        precision, distance = self.prior(x)
        return float(self.problem.losses(residual)[self.used].sum() + (precision * distance**2).sum())

    def jacobian(self, x: Array, known: Array | None) -> Array:
        first = 0 if known is None else known.shape[1]
        new = self.problem.jacobian(x, self.effects, range(first, len(x)))
        return new if known is None else np.hstack([known, new])

    def update(self, jacobian: Array, residual: Array, moved: Array, step: Array) -> Array:
        """Broyden's update J + (Δr − J Δd) Δdᵀ/|Δd|²."""
        length = float(step @ step)
        if length == 0.0:
            return jacobian
        return jacobian + np.outer((moved - residual).ravel() - jacobian @ step, step / length)

    def normal_equations(self, jacobian: Array, residual: Array) -> Array:
        return normal_equations(jacobian, residual, huber_weights(self.problem, residual, self.used))
