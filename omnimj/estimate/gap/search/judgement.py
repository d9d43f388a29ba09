"""Each effect of a model judged given the others: swaps that help, rivals, eliminations, giving up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from omnimj.effects import Interval
from omnimj.estimate.gap.records import GivenUp
from omnimj.estimate.gap.search.candidates import (
    CLEAR,
    NOISE_LEVEL,
    CurrentModel,
    FittedCandidate,
    exceeds_margin,
    fit_candidate,
    fit_without,
    fitted_already,
    has_shape_at_bound,
    information_score,
    parameter_slice,
    pinned_amplitudes,
    refine_leaders,
    training_rms,
    without_amplitudes,
)
from omnimj.estimate.gap.search.cross_validation import TrainingSplit, paired_t
from omnimj.estimate.gap.search.screening import ScreenedCandidate, curve_gains, screen_candidates
from omnimj.estimate.gap.search.selection import MAX_FALSE_RATE, decoy_p_value, effective_share
from omnimj.estimate.gap.search.sensitivities import Sensitivities
from omnimj.estimate.replay.interface import CandidateEffect
from omnimj.estimate.replay.problem import Fit, Problem, huber_weights
from omnimj.estimate.threads import map_in_threads
from omnimj.signals import Array

_MOST_RIVALS = 6  # candidates fitted in the place of an effect
_CLOSE = 0.5  # share of the best screened share that they must reach
_NEAR = 10.0  # multiple of the effect's held-out loss beyond which an alternative is out of the question
_BETTER = 1.0  # smallest advantage in score for which an effect is exchanged
_MOST_PASSES = 8  # exchanges and eliminations of one judgement
_FAR = 2.0  # multiple of the noise level from which only a true effect leads down to the noise
_SURE = 0.95  # one-sided level of the paired test over groups
_LEVEL = 0.90  # share of the draws that the difference of two models must exceed
_DRAWS = 400


@dataclass(frozen=True)
class SelectedEffect:
    """Effect of a model with its alternatives, the other effects being in the model."""

    candidate: CandidateEffect
    rivals: tuple[FittedCandidate, ...]
    """Alternatives that the data cannot distinguish from it."""
    gain: Interval
    """Held-out gain."""
    p_false: float | None = None
    """Share of random curves that gain as much."""
    without: float = np.inf
    """Training mismatch of the model without it, in units of noise."""
    rest: float = np.inf
    """The same of the model with it."""

    @property
    def is_needless(self) -> bool:
        """True for a machine's effect without which nothing but noise is left.

        What remains of the difference between machine and equations looks like such an effect, but not like
        one of a sensor.
        """
        return not self.candidate.is_sensor and self.without <= NOISE_LEVEL

    @property
    def is_supported(self) -> bool:
        """True if its gain exceeds the margin and nearly all random curves, or leaves nothing but noise.

        A random curve that hardly bends is a constant force. It gains as much as an effect that is one, which
        speaks against the effect only where something else remains unexplained.
        """
        if self.rest <= NOISE_LEVEL and self.without >= _FAR * NOISE_LEVEL:
            return True
        return exceeds_margin(self.gain) and (self.p_false is None or self.p_false <= MAX_FALSE_RATE)


@dataclass(frozen=True)
class Judgement:
    """Model whose effects all hold given each other, and what was given up on the way."""

    problem: Problem
    final: Fit
    named: tuple[SelectedEffect, ...]
    given_up: tuple[GivenUp, ...]


@dataclass(frozen=True)
class _Place:
    """Place of one effect in a model: the model without it, and the candidates for it."""

    without: CurrentModel
    tried: list[FittedCandidate]
    """Candidates in this place, the best first."""
    own: FittedCandidate
    """The effect that the model has there."""
    share: float
    """Independent samples over all samples."""


def judge_effects(
    problem: Problem,
    model: Fit,
    split: TrainingSplit,
    sensitivities: Sensitivities,
    may_exchange: bool = True,
) -> Judgement:
    """Exchange and eliminate effects until each one holds given the others.

    An effect is exchanged for an alternative that improves the whole model's held-out loss, one at a
    meaningless bound is refitted without the amplitude concerned or exchanged, and the least supported one
    is eliminated. Every exchange improves the model, so that no exchange returns.

    Args:
      may_exchange: Whether an effect may be exchanged for an alternative; it is only judged otherwise.
    """
    given_up: list[GivenUp] = []
    named: list[SelectedEffect] = []
    for turn in range(_MOST_PASSES):
        may_still = may_exchange and turn < _MOST_PASSES // 2
        model, named, changed = _judge_all(problem, model, split, sensitivities, may_still)
        if changed:
            continue
        worst = _least_supported(problem, model, named)
        if worst is None:
            break
        given_up.append(worst)
        dropped = next(c for c in model.effects if c.label == worst.label)
        model = fit_without(problem, model, dropped, split, 2)
        named = []
        if not model.effects:
            break
    return Judgement(problem, model, tuple(named), tuple(given_up))


def _judge_all(
    problem: Problem, model: Fit, split: TrainingSplit, sensitivities: Sensitivities, may_exchange: bool
) -> tuple[Fit, list[SelectedEffect], bool]:
    """Judge every effect; the model, its effects, and True if one was exchanged, which ends the pass."""
    named = []
    for candidate in model.effects:
        place = _fill_place(problem, model, candidate, split, sensitivities)
        better = _better_choice(place, candidate) if may_exchange else None
        if better is not None:
            return better.fit, [], True
        named.append(_selected(place, sensitivities))
    return model, named, False


def _fill_place(
    problem: Problem,
    model: Fit,
    candidate: CandidateEffect,
    split: TrainingSplit,
    sensitivities: Sensitivities,
) -> _Place:
    """Fit the candidates that could stand in the place of one effect, itself included."""
    without = CurrentModel(problem, fit_without(problem, model, candidate, split, 1), split)
    taken = {c.label for c in without.fit.effects}
    free = [c for c in problem.replay.candidates if c.label not in taken]
    screened = screen_candidates(problem, without.fit, free, split.used, sensitivities)
    best = screened[0].share
    close = [s for s in screened if s.share >= _CLOSE * best and s.candidate.label != candidate.label]
    present = fitted_already(without, model, candidate, best)
    others_tried = map_in_threads(lambda s: fit_candidate(without, s), close[:_MOST_RIVALS])
    near = [t for t in others_tried if t.losses.sum() < _NEAR * present.losses.sum()]
    starts = [s for s in close if any(s.candidate is t.candidate for t in near)]
    tried = [present, *refine_leaders(without, near, starts)]
    share = effective_share(problem, tried[0].fit, split)
    own = _without_pinned(_Place(without, tried, tried[0], share))
    tried = sorted([own, *tried[1:]], key=lambda t: information_score(t, share))
    return _Place(without, tried, own, share)


def _own_values(fitted: FittedCandidate) -> Array:
    return fitted.fit.x[-len(fitted.candidate.parameters) :]


def _without_pinned(place: _Place) -> FittedCandidate:
    """The effect without amplitudes at meaningless bounds, if the data do not need them there."""
    own = place.own
    pinned = pinned_amplitudes(own.candidate, _own_values(own))
    amplitudes = [k for k, s in enumerate(own.candidate.parameters) if s.null_value is not None]
    if not pinned or len(pinned) == len(amplitudes):
        return own
    reduced = without_amplitudes(own.candidate, pinned)
    start = ScreenedCandidate(reduced, own.screened, own.fit.x)
    other = fit_candidate(place.without, start)
    other = fit_candidate(place.without, start, other.fit)
    behind = information_score(other, place.share) - information_score(own, place.share)
    return other if behind <= CLEAR else own


def _better_choice(place: _Place, present: CandidateEffect) -> FittedCandidate | None:
    """Alternative that improves the model, or one inside its bounds for an effect at a meaningless bound."""
    own = place.own
    if own.candidate != present:  # without an amplitude that it does not need
        return own
    sound = [t for t in place.tried if t is not own and not _is_degenerate(t)]
    if not sound:
        return None
    best = sound[0]
    if _is_degenerate(own):
        return best if exceeds_margin(best.gain) else None
    ahead = information_score(own, place.share) - information_score(best, place.share)
    return best if ahead > _BETTER else None


def _is_degenerate(fitted: FittedCandidate) -> bool:
    """True if a shape or an amplitude is at a bound without meaning: it stands in for something else."""
    values = _own_values(fitted)
    return has_shape_at_bound(fitted.candidate, values) or bool(pinned_amplitudes(fitted.candidate, values))


def _selected(place: _Place, sensitivities: Sensitivities) -> SelectedEffect:
    """The effect with its rivals, its gain, and how many random curves gain as much."""
    own, (problem, split) = place.own, (place.without.problem, place.without.split)
    ordered = [own, *(t for t in place.tried if t is not own)]
    decoys = curve_gains(problem, place.without.fit, split, sensitivities).decoys
    rivals = ambiguity_set(problem, ordered, place.share, split)
    sizes = (training_rms(problem, fitted, split) for fitted in (place.without.fit, own.fit))
    return SelectedEffect(own.candidate, rivals, own.gain, decoy_p_value(decoys, own.gain), *sizes)


def _least_supported(problem: Problem, model: Fit, named: Sequence[SelectedEffect]) -> GivenUp | None:
    """Effect to give up next with the reason; None if all hold."""
    for one in named:
        values = model.x[parameter_slice(problem, model, one.candidate)]
        pinned = pinned_amplitudes(one.candidate, values)
        if pinned:
            names = ", ".join(one.candidate.parameters[k].name for k in pinned)
            return GivenUp(one.candidate.label, one.gain, f"its {names} runs to the bound of its range")
    weak = [n for n in named if not n.is_supported]
    if not weak:
        needless = [n for n in named if n.is_needless] if len(named) > 1 else []
        worst = min(needless, key=lambda n: n.gain.value, default=None)
        reason = "the other effects leave nothing but noise"
        return None if worst is None else GivenUp(worst.candidate.label, worst.gain, reason)
    worst = min(weak, key=lambda n: (-(n.p_false or 0.0), n.gain.value))
    if exceeds_margin(worst.gain):
        reason = f"{100.0 * (worst.p_false or 0.0):.0f} % of random curves gain as much"
    else:
        reason = "its gain is not above the margin, given the other effects"
    return GivenUp(worst.candidate.label, worst.gain, reason)


def ambiguity_set(
    problem: Problem, tried: list[FittedCandidate], effective_share: float, split: TrainingSplit
) -> tuple[FittedCandidate, ...]:
    """Candidates that the first does not beat: in likelihood, over groups, and by `is_distinguishable`.

    Args:
      tried: Candidates in one place of the model, the best first.
      effective_share: Independent samples over all samples.
    """
    best = tried[0]
    sure = float(student.ppf(_SURE, max(len(best.losses) - 1, 1)))
    rivals = []
    for other in tried[1:]:
        behind = information_score(other, effective_share) - information_score(best, effective_share)
        if other.gain.value <= 0.0:
            continue
        own = other.fit.x[-len(other.candidate.parameters) :]
        if behind > 0.0 and has_shape_at_bound(other.candidate, own):
            continue
        is_beaten = behind > CLEAR and paired_t(other.losses, best.losses) > sure
        if not (is_beaten and is_distinguishable(problem, best.fit, other.fit, split)):
            rivals.append(other)
    return tuple(rivals)


def is_distinguishable(problem: Problem, best: Fit, other: Fit, split: TrainingSplit) -> bool:
    """True if two models' predictions differ by more than the misfit of whole runs would by chance.

    d is the whitened difference of the predictions, less what the better model's own parameters can follow,
    r its misfit. If the other model were true, the better one would lead by |d|² − 2 d·r. The misfit that
    remains is not white: other structure of the machine repeats in every run. So r is drawn anew, whole runs
    in place of others with random signs; the models are distinguishable if |d|² > 2 |d·r| in 90 % of draws.
    """
    weight = huber_weights(problem, best.residual, split.used)[:, None]
    jacobian = best.jacobian * weight
    misfit = best.residual.ravel() * weight[:, 0]
    difference = (other.residual - best.residual).ravel() * weight[:, 0]
    precision, _ = problem.prior(best.x, best.effects)
    gram = jacobian.T @ jacobian + np.diag(precision)
    followed = np.linalg.lstsq(gram, jacobian.T @ difference, rcond=1e-10)[0]
    difference = difference - jacobian @ followed
    chance = _resampled_products(difference, misfit, problem, split)
    return float(difference @ difference) > 2.0 * float(np.quantile(np.abs(chance), _LEVEL))


def _resampled_products(difference: Array, misfit: Array, problem: Problem, split: TrainingSplit) -> Array:
    """Products d·r with the misfits of whole groups in place of others, shape (draws,)."""
    channels = len(problem.replay.channels)
    of_row = np.repeat(np.where(split.used, split.groups.of_block, -1), channels)
    parts = [np.flatnonzero(of_row == g) for g in np.unique(of_row[of_row >= 0])]
    count = len(parts)
    products = np.zeros((count, count))
    for i, rows in enumerate(parts):
        for j, donor in enumerate(parts):
            repeated = np.resize(misfit[donor], len(rows))
            products[i, j] = difference[rows] @ repeated
    random = np.random.default_rng(split.seed + 3)
    donors = random.integers(count, size=(_DRAWS, count))
    signs = random.choice((-1.0, 1.0), size=(_DRAWS, count))
    return (signs * products[np.arange(count), donors]).sum(axis=1)
