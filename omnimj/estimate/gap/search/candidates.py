"""Fits of candidate effects, judged by cross-validation, and their active bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from omnimj.effects import Interval
from omnimj.estimate.gap.search.cross_validation import TrainingSplit, group_losses, heldout_gain
from omnimj.estimate.gap.search.screening import ScreenedCandidate
from omnimj.estimate.intervals import finite_rms
from omnimj.estimate.replay.interface import CandidateEffect, CandidateParameter
from omnimj.estimate.replay.problem import Fit, ModelEffects, Problem, fit
from omnimj.estimate.threads import map_in_threads
from omnimj.signals import Array

MARGIN = 0.02
"""Held-out gain whose lower bound an effect must exceed to be named."""
NOISE_LEVEL = 1.5
"""Mismatch in units of noise up to which a model lacks nothing that would show."""
CLEAR = 3.0
"""Smallest deficit in log-likelihood (effective samples) of a candidate that is beaten."""
_LEADERS = 4  # candidates of a round whose fits are completed
_OUT_OF_REACH = 10.0  # multiple of the smallest held-out loss beyond which a fit is not worth completing
_MOST_JACOBIANS, _CONVERGED = 4, 0.02  # of a completed fit, which falls by less than this share in the end
_SCANNED = 24  # values of a shape parameter that are compared after its fit
_EDGE = 0.01  # share of a parameter's range that counts as its bound


@dataclass(frozen=True)
class FittedCandidate:
    """Candidate with its fit and its held-out losses."""

    candidate: CandidateEffect
    screened: float
    fit: Fit
    losses: Array
    """Held-out loss per group, shape (groups,)."""
    gain: Interval
    """Gain over the model without it."""


@dataclass(frozen=True)
class CurrentModel:
    """Fitted model to which candidates are added."""

    problem: Problem
    fit: Fit
    split: TrainingSplit

    @cached_property
    def losses(self) -> Array:
        """Held-out loss per group, shape (groups,)."""
        return group_losses(self.problem, self.fit, self.split)

    def compare(self, candidate: CandidateEffect, share: float, fitted: Fit) -> FittedCandidate:
        """Cross-validate the model with one more effect, which explains some share to first order."""
        losses = group_losses(self.problem, fitted, self.split)
        return FittedCandidate(candidate, share, fitted, losses, heldout_gain(self.losses, losses))


def training_rms(problem: Problem, fitted: Fit, split: TrainingSplit) -> float:
    """Training mismatch of a model, RMS over all channels in units of noise."""
    is_measured = np.isfinite(problem.replay.measured[split.used])
    return finite_rms(fitted.residual[split.used][is_measured])


def exceeds_margin(gained: Interval) -> bool:
    """True if the lower bound of a held-out gain is above the margin."""
    return gained.low is not None and gained.low > MARGIN


def fit_candidate(
    current: CurrentModel, screened: ScreenedCandidate, again: Fit | None = None
) -> FittedCandidate:
    """Fit the model with one more effect and cross-validate it.

    Args:
      again: First fit of the candidate, to be completed; None for the first fit.
    """
    start, known = (screened.start, current.fit.jacobian) if again is None else (again.x, None)
    effects = (*current.fit.effects, screened.candidate)
    fitted = fit(current.problem, effects, start, current.split.used, 1, known)
    return current.compare(screened.candidate, screened.share, fitted)


def refine_leaders(
    current: CurrentModel, tried: list[FittedCandidate], screened: Sequence[ScreenedCandidate]
) -> list[FittedCandidate]:
    """Complete the fits of the leaders; the others keep their first fit."""
    total = [float(t.losses.sum()) for t in tried]
    reach = _OUT_OF_REACH * min(total, default=0.0)
    leaders = sorted(range(len(tried)), key=total.__getitem__)[:_LEADERS]
    leaders = [k for k in leaders if total[k] <= reach]
    fits = map_in_threads(lambda k: _completed(current, screened[k], tried[k]), leaders)
    completed = dict(zip(leaders, fits, strict=True))
    return [completed.get(k, first) for k, first in enumerate(tried)]


def _completed(current: CurrentModel, screened: ScreenedCandidate, first: FittedCandidate) -> FittedCandidate:
    """Fit a candidate with new Jacobians until its loss no longer falls."""
    done = first
    for _ in range(_MOST_JACOBIANS):
        better = fit_candidate(current, screened, done.fit)
        has_converged = better.fit.loss > (1.0 - _CONVERGED) * done.fit.loss
        done = better
        if has_converged:
            break
    for start in (_better_start(current, done), _better_shape(current, done)):
        if start is not None:
            done = fit_candidate(current, screened, start)
    return done


def _better_shape(current: CurrentModel, done: FittedCandidate) -> Fit | None:
    """Better fit from other values of each shape parameter in turn, None if there is none.

    The loss over the edge of a stretch has steps and plateaus, on which a gradient leads nowhere.
    """
    problem, used = current.problem, current.split.used
    candidate, best = done.candidate, done.fit.x.copy()
    first = len(best) - len(candidate.parameters)
    shapes = [(first + k, s) for k, s in enumerate(candidate.parameters) if s.null_value is None]
    for place, shape in shapes:
        low, high = min([*shape.trials, best[place]]), max([*shape.trials, best[place]])
        values = np.append(np.linspace(low, high, _SCANNED), best[place])
        points = [np.r_[best[:place], value, best[place + 1 :]] for value in values]
        residuals = problem.residuals(points, done.fit.effects)
        losses = [float(problem.losses(residual)[used].sum()) for residual in residuals]
        best = points[int(np.argmin(losses))]
    if np.array_equal(best, done.fit.x):
        return None
    fitted = fit(problem, done.fit.effects, best, used, 1)
    return fitted if fitted.loss < (1.0 - _CONVERGED) * done.fit.loss else None


def _better_start(current: CurrentModel, done: FittedCandidate) -> Fit | None:
    """Better fit of an effect with several amplitudes from other starting points; None if there is none.

    Amplitudes that multiply each other, and dry friction below its null value, hold a fit in a minimum of its
    own. The other starts are without each amplitude, and half the typical size of all.
    """
    candidate, at, present = done.candidate, len(current.fit.x), current.fit.effects
    places = [k for k, s in enumerate(candidate.parameters) if s.null_value is not None and s.high > s.low]
    if len(places) < 2:
        return None
    half = done.fit.x.copy()
    for k in places:
        shape = candidate.parameters[k]
        half[at + k] = 0.5 * ((shape.null_value or 0.0) + shape.typical)
    starts = [(candidate, half)]
    for k in places:
        reduced, start = without_amplitudes(candidate, [k]), done.fit.x.copy()
        start[at + k] = reduced.parameters[k].low
        starts.append((reduced, start))
    used = current.split.used
    fits = [fit(current.problem, (*present, form), start, used, 1) for form, start in starts]
    best = min(fits, key=lambda fitted: fitted.loss)
    return best if best.loss < (1.0 - _CONVERGED) * done.fit.loss else None


def fitted_already(
    current: CurrentModel, model: Fit, candidate: CandidateEffect, share: float
) -> FittedCandidate:
    """Effect of a fitted model as a candidate beside the others; it becomes the last of them."""
    own = parameter_slice(current.problem, model, candidate)
    places = np.r_[np.delete(np.arange(len(model.x)), own), np.arange(own.start, own.stop)]
    effects = (*_others(model, candidate), candidate)
    fitted = replace(model, effects=effects, x=model.x[places], jacobian=model.jacobian[:, places])
    return current.compare(candidate, share, fitted)


def _others(model: Fit, candidate: CandidateEffect) -> ModelEffects:
    return tuple(c for c in model.effects if c.label != candidate.label)


def fit_without(
    problem: Problem, model: Fit, candidate: CandidateEffect, split: TrainingSplit, rounds: int
) -> Fit:
    """Fit a model without one of its effects; a single round begins with the model's Jacobian."""
    own = parameter_slice(problem, model, candidate)
    known = np.delete(model.jacobian, own, axis=1) if rounds == 1 else None
    return fit(problem, _others(model, candidate), np.delete(model.x, own), split.used, rounds, known)


def information_score(tried: FittedCandidate, effective_share: float) -> float:
    """Information criterion: half the held-out loss in effective samples plus one per free parameter."""
    free = sum(s.high > s.low for s in tried.candidate.parameters)
    return 0.5 * float(tried.losses.sum()) * effective_share + free


def parameter_slice(problem: Problem, fitted: Fit, candidate: CandidateEffect) -> slice:
    """Slice of one effect's parameters in the parameter vector of a fit."""
    at = len(problem.replay.base) + problem.has_twin_share
    for one in fitted.effects:
        if one.label == candidate.label:
            return slice(at, at + len(one.parameters))
        at += len(one.parameters)
    raise ValueError(f"{candidate.label} is not in the model")


def has_shape_at_bound(candidate: CandidateEffect, values: Array) -> bool:
    """True if a shape parameter is at a bound: a sticky place as wide as the guide is none.

    Args:
      values: Its parameters, shape (parameters,).
    """
    return any(
        shape.null_value is None and _is_at_bound(shape, value)
        for shape, value in zip(candidate.parameters, values, strict=True)
    )


def pinned_amplitudes(candidate: CandidateEffect, values: Array) -> list[int]:
    """Places of the amplitudes at an end of their range that has no meaning of its own.

    The null value has one, and so has a scale of 0: what it scales is absent.

    Args:
      values: Its parameters, shape (parameters,).
    """
    return [
        k
        for k, (shape, value) in enumerate(zip(candidate.parameters, values, strict=True))
        if shape.null_value is not None
        and abs(value - shape.null_value) > _EDGE * (shape.high - shape.low)
        and not (shape.low == 0.0 and value <= _EDGE * shape.high)
        and _is_at_bound(shape, value)
    ]


def _is_at_bound(shape: CandidateParameter, value: float) -> bool:
    edge = _EDGE * (shape.high - shape.low)
    return not shape.low + edge < value < shape.high - edge


def without_amplitudes(candidate: CandidateEffect, places: Sequence[int]) -> CandidateEffect:
    """Candidate with some of its amplitudes fixed at their null values."""
    parameters = list(candidate.parameters)
    for k in places:
        null = parameters[k].null_value
        assert null is not None
        parameters[k] = replace(parameters[k], low=null, high=null)
    return replace(candidate, parameters=tuple(parameters))
