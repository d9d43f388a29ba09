"""Backward elimination: all effects are fitted together, and those that the data do not need are dropped.

Where several effects act on the same few channels, no single effect and no pair gains before the others are
there. The full model has all of them. Effects leave it one at a time, the one whose removal costs least to
first order first, while its gain on held-out runs is not above the margin. One that gains in the end
returns, and the elimination goes on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from omnimj.estimate.gap.search.candidates import exceeds_margin, fit_without, parameter_slice
from omnimj.estimate.gap.search.cross_validation import TrainingSplit, group_losses, heldout_gain
from omnimj.estimate.gap.search.sensitivities import trial_shapes, trial_steps, vanished_point
from omnimj.estimate.least_squares import normal_equations
from omnimj.estimate.replay.interface import CandidateEffect
from omnimj.estimate.replay.problem import Fit, ModelEffects, Problem, fit, huber_weights
from omnimj.signals import Array

_ROUNDS, _REFIT = 30, 8  # Jacobians of the full fit, and of the fit after a removal or a return
_MOST_RETURNS = 4  # effects whose return is cross-validated
_RIDGE = 1e-6
_FREE = 10.0  # loss in squares of noise, of thousands
_SQUARES = 1e3  # Huber scale beyond any mismatch


def eliminate(problem: Problem, base: Fit, split: TrainingSplit, most: int) -> Fit:
    """Drop effects from the model of all candidates until the data need each that is left.

    Errors count by their squares here: a loss that forgives large ones would forgive the lack of an effect.
    """
    problem = replace(problem, huber_scale=_SQUARES)
    model = _full_model(problem, base, split)
    model, losses = _reduced(problem, model, group_losses(problem, model, split), split, most)
    seen = {model.labels}
    while len(model.effects) < most:
        larger = _with_best_addition(problem, model, losses, split)
        if larger is None:
            break
        model, losses = _reduced(problem, *larger, split, most)
        if model.labels in seen:
            break
        seen.add(model.labels)
    return model


def _reduced(
    problem: Problem, model: Fit, losses: Array, split: TrainingSplit, most: int
) -> tuple[Fit, Array]:
    """Drop one effect after another while the data do not need it; the model and its held-out losses."""
    while model.effects:
        options = []
        for candidate in _cheapest_first(problem, model, split):
            reduced = fit_without(problem, model, candidate, split, _REFIT)
            left = group_losses(problem, reduced, split)
            options.append((float(left.sum()), reduced, left))
            if not exceeds_margin(heldout_gain(left, losses)):
                _, model, losses = options[-1]
                break
        else:
            if len(model.effects) <= most:
                break
            _, model, losses = min(options, key=lambda option: option[0])
    return model, losses


def _with_best_addition(
    problem: Problem, model: Fit, losses: Array, split: TrainingSplit
) -> tuple[Fit, Array] | None:
    """The model with the effect whose return gains most on held-out runs, and its losses; None if none gains.

    An effect may have been dropped because others stood in for it that were dropped in their turn.
    """
    dropped = [c for c in problem.replay.candidates if c.label not in model.labels]
    fits = [
        fit(problem, (*model.effects, c), np.concatenate([model.x, _trial_point(c)]), split.used, _REFIT)
        for c in dropped
    ]
    fits = sorted(fits, key=lambda fitted: fitted.loss)[:_MOST_RETURNS]
    tried = [(fitted, group_losses(problem, fitted, split)) for fitted in fits]
    tried = [(fitted, left) for fitted, left in tried if exceeds_margin(heldout_gain(losses, left))]
    return min(tried, key=lambda one: float(one[1].sum()), default=None)


def _full_model(problem: Problem, base: Fit, split: TrainingSplit) -> Fit:
    """Fit all candidates together, each from a trial step beyond where it vanishes."""
    candidates = problem.replay.candidates
    start = [base.x, *map(_trial_point, candidates)]
    return fit(problem, tuple(candidates), np.concatenate(start), split.used, _ROUNDS)


def _trial_point(candidate: CandidateEffect) -> Array:
    """Parameters of a candidate, a trial step beyond where it vanishes."""
    at, steps = vanished_point(candidate, trial_shapes(candidate)[0], trial_steps(candidate)[0])
    for k, step in steps:
        at[k] += step
    return at


def _cheapest_first(problem: Problem, model: Fit, split: TrainingSplit) -> ModelEffects:
    """Effects by the loss that their removal costs to first order: dᵀ (H⁻¹)_own⁻¹ d for the way d back.

    Of those that cost next to nothing, effects of a single wheel or floor go first: the radii of all wheels
    together are a scale, which is the simpler explanation.
    """
    weight = huber_weights(problem, model.residual, split.used)
    sums = normal_equations(model.jacobian, model.residual, weight)[:-1, :-1]
    precision, _ = problem.prior(model.x, model.effects)
    ridge = _RIDGE * float(sums.diagonal().max()) * np.eye(len(sums))
    covariance = np.linalg.inv(sums + np.diag(precision) + ridge)
    costs = []
    for candidate in model.effects:
        own = parameter_slice(problem, model, candidate)
        way = _way_back(problem, model, candidate, own)
        cost = float(way @ np.linalg.solve(covariance[own, own], way))
        costs.append((cost > _FREE, bool(cost > _FREE or not candidate.selectors), cost))
    return tuple(model.effects[k] for k in sorted(range(len(costs)), key=costs.__getitem__))


def _way_back(problem: Problem, model: Fit, candidate: CandidateEffect, own: slice) -> Array:
    """Distance of an effect's amplitudes from where they vanish, in their scales; 0 for shapes."""
    null = np.array(
        [
            x if shape.null_value is None else shape.null_value
            for shape, x in zip(candidate.parameters, model.x[own], strict=True)
        ]
    )
    return (model.x[own] - null) / problem.scales(model.effects)[own]
