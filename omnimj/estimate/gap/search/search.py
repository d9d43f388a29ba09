"""Search: refit the base, add effects one by one, eliminate, and evaluate on held-out runs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnimj.effects import Interval
from omnimj.estimate.gap.search.cross_validation import (
    choose_heldout,
    heldout_losses,
    make_folds,
    make_groups,
    sum_by_group,
)
from omnimj.estimate.gap.search.screening import (
    CurveGains,
    ScreenedCandidate,
    curve_gains,
    screen_candidates,
    sensitivities,
)
from omnimj.estimate.gap.search.selection import (
    MARGIN,
    MAX_FALSE_RATE,
    FittedCandidate,
    Progress,
    SelectionRound,
    TrainingSplit,
    ambiguity_set,
    decoy_p_value,
    exceeds_margin,
    fit_candidate,
    has_amplitude_at_bound,
    information_score,
    refine_leaders,
    select_round,
)
from omnimj.estimate.intervals import block_noise, effective_samples
from omnimj.estimate.replay.interface import CandidateEffect, Replay
from omnimj.estimate.replay.problem import Fit, ModelEffects, Problem, fit, reevaluate
from omnimj.signals import Array

MOST_EFFECTS = 3
_SWAPS = 6  # rivals that may replace an effect, given the others
_CLOSE = 0.5  # share of the best screened share that a rival must reach


@dataclass(frozen=True)
class SelectedEffect:
    """Effect in the model, with the alternatives at its selection."""

    candidate: CandidateEffect
    found: SelectionRound
    rivals: tuple[FittedCandidate, ...]
    """Rivals that it does not beat, the other effects being in the model."""
    gain: Interval
    """Held-out gain, given the other effects."""
    p_false: float | None = None


@dataclass(frozen=True)
class SearchResult:
    """Outcome of a search."""

    problem: Problem
    """Problem with the noise and the twin correction of the last model."""
    first: Problem
    """Problem with the noise and the twin correction of the base."""
    split: TrainingSplit
    base: Fit
    final: Fit
    named: tuple[SelectedEffect, ...]
    rounds: tuple[SelectionRound, ...]
    """One more than the selected effects: the last round selected nothing."""
    interrupted: bool = False

    @property
    def used(self) -> NDArray[np.bool_]:
        """Blocks fitted to, shape (blocks,)."""
        return self.split.used

    @property
    def curves(self) -> CurveGains | None:
        """Gains of curves beyond the model of the last round."""
        return self.rounds[-1].curves if self.rounds else None


def with_twin_correction(problem: Problem, x: Array, effects: ModelEffects) -> Problem:
    """The problem with the twin simulated at a model: offset = twin − equations there.

    Args:
      problem: The data and the scale.
      x: Parameters of the model, shape (n,).
      effects: Effects in the model.
    """
    setting, _ = problem.split(x, effects)
    twin = problem.replay.simulate_twin(setting)
    if twin is None:
        return problem
    (plain,) = problem.replay.simulate([setting])
    return replace(problem, offset=twin - plain)


def robust_scale(problem: Problem, fitted: Fit, used: NDArray[np.bool_]) -> Problem:
    """The problem with a Huber scale of three times the scatter, at least five times the noise.

    Args:
      problem: The data and the scale.
      fitted: Model whose residual gives the scatter.
      used: Blocks that count, shape (blocks,).
    """
    middle = float(np.median(np.abs(fitted.residual[used])))
    return replace(problem, huber_scale=max(5.0, 3.0 * 1.4826 * middle))


def fit_base(replay: Replay, used: NDArray[np.bool_], report: Progress) -> tuple[Problem, Fit]:
    """Fit the base inside its boxes; estimate the noise of the data and the Huber scale.

    Three fits, since the noise is estimated from the residual of a fitted model.

    Args:
      replay: The plant with the measured runs.
      used: Blocks to fit to, shape (blocks,).
      report: Called with a phrase and the completed share.
    """
    channels = len(replay.channels)
    problem = Problem(replay, np.ones(channels))
    nominal = np.array([b.nominal for b in replay.base])
    report("simulating the twin", 0.0)
    problem = with_twin_correction(problem, nominal, ())
    (mismatch,) = problem.mismatches([problem.start()], ())
    problem = replace(problem, noise=block_noise(replay, mismatch))
    (residual,) = problem.residuals([problem.start()], ())
    fitted = Fit((), problem.start(), residual, np.zeros((0, 0)), 0.0)
    for k in range(2):
        report("refitting the base", k / 3)
        problem = robust_scale(problem, fitted, used)
        fitted = fit(problem, (), fitted.x, used)
        # the difference between twin and equations depends on the base
        problem = with_twin_correction(problem, fitted.x, ())
        (mismatch,) = problem.mismatches([fitted.x], ())
        problem = replace(problem, noise=block_noise(replay, mismatch))
        fitted = reevaluate(fitted, problem)
    return problem, fit(problem, (), fitted.x, used)


def refit(problem: Problem, fitted: Fit, used: NDArray[np.bool_]) -> tuple[Problem, Fit]:
    """Refit after simulating the twin at the new model and estimating the noise anew (it can only shrink).

    Args:
      problem: The data and the scale.
      fitted: The new model.
      used: Blocks to fit to, shape (blocks,).
    """
    problem = with_twin_correction(problem, fitted.x, fitted.effects)
    (mismatch,) = problem.mismatches([fitted.x], fitted.effects)
    noise = np.minimum(problem.noise, block_noise(problem.replay, mismatch))
    problem = replace(problem, noise=noise)
    problem = robust_scale(problem, reevaluate(fitted, problem), used)
    return problem, fit(problem, fitted.effects, fitted.x, used)


def judge_given_others(
    problem: Problem, final: Fit, named: list[SelectedEffect], k: int, split: TrainingSplit
) -> tuple[Fit, SelectedEffect]:
    """Judge one effect given the others: against its rivals and against decoys.

    Returns:
      The model with the best candidate in its place, and that candidate with its gain and decoys.
    """
    one = named[k]
    others = tuple(n.candidate for n in named if n is not one)
    place = parameter_slice(problem, final, one.candidate)
    without = fit(problem, others, np.delete(final.x, place), split.used)
    before = sum_by_group(heldout_losses(problem, without, split.used, split.folds), split.groups)
    taken = {n.candidate.label for n in named if n is not one}
    free = [c for c in problem.replay.candidates if c.label not in taken]
    screened = screen_candidates(problem, without, free, split.used)
    close = [s for s in screened if s.share >= _CLOSE * screened[0].share][:_SWAPS]
    start = np.concatenate([without.x, final.x[place]])
    mine = ScreenedCandidate(one.candidate, screened[0].share, start)
    options = [mine, *(s for s in close if s.candidate.label != one.candidate.label)]
    tried = [fit_candidate(problem, s, without, before, split) for s in options]
    tried = refine_leaders(problem, tried, options, without, before, split)
    count = float(np.isfinite(problem.replay.measured[split.used]).sum())
    share = min(effective_samples(problem.replay, tried[0].fit.residual * split.used[:, None]) / count, 1.0)
    tried.sort(key=lambda t: information_score(t, share))
    columns = sensitivities(problem, without, split.used)
    decoys = curve_gains(problem, columns, split.groups, split.folds, split.seed).decoys
    best = tried[0]
    p_false = decoy_p_value(decoys, best.gain)
    return best.fit, SelectedEffect(
        best.candidate, one.found, ambiguity_set(tried, share), best.gain, p_false
    )


def backward_eliminate(
    problem: Problem, base: Fit, final: Fit, named: list[SelectedEffect], split: TrainingSplit
) -> tuple[Problem, Fit, list[SelectedEffect]]:
    """Judge every effect given the others and remove the worst until all exceed margin and decoys."""
    while named:
        for k in range(len(named)):
            final, named[k] = judge_given_others(problem, final, named, k, split)
        pinned = [
            n
            for n in named
            if has_amplitude_at_bound(n.candidate, final.x[parameter_slice(problem, final, n.candidate)])
        ]
        kept = [
            n for n in named if exceeds_margin(n.gain) and (n.p_false is None or n.p_false <= MAX_FALSE_RATE)
        ]
        if len(kept) == len(named) and not pinned:
            break
        worst = min(pinned or named, key=lambda n: (-(n.p_false or 0.0), n.gain.value))
        x = np.delete(final.x, parameter_slice(problem, final, worst.candidate))
        named = [n for n in named if n is not worst]
        final = fit(problem, tuple(n.candidate for n in named), x, split.used)
    return problem, final, named


def parameter_slice(problem: Problem, fitted: Fit, candidate: CandidateEffect) -> slice:
    """Slice of one effect's parameters in the parameter vector of a fit."""
    at = len(problem.replay.base) + problem.has_twin_share
    for one in fitted.effects:
        if one.label == candidate.label:
            return slice(at, at + len(one.parameters))
        at += len(one.parameters)
    raise ValueError(f"{candidate.label} is not in the model")


def search(replay: Replay, holdout: tuple[str, ...], seed: int, report: Progress) -> SearchResult:
    """Find the effects that a model lacks.

    Args:
      replay: The plant with the measured runs.
      holdout: Conditions or runs excluded from every fit; drawn by the seed when empty.
      seed: Seed of the held-out draw, the folds and the decoys.
      report: Called with a phrase and the completed share; may raise KeyboardInterrupt.
    """
    groups = make_groups(replay)
    heldout = choose_heldout(groups, seed, holdout)
    used = ~heldout[groups.of_block]
    split = TrainingSplit(used, groups, make_folds(groups, ~heldout, seed), seed)
    problem, current = fit_base(replay, used, report)
    first, base = problem, current
    named: list[SelectedEffect] = []
    rounds: list[SelectionRound] = []
    interrupted = False
    try:
        while len(named) < MOST_EFFECTS:
            taken = {n.candidate.label for n in named}
            left = [c for c in replay.candidates if c.label not in taken]
            found = select_round(problem, current, left, split, report)
            rounds.append(found)
            # effects that mask each other gain little alone: any gain admits one, all are judged at the end
            if found.best is None or found.best.gain.value <= MARGIN:
                break
            named.append(SelectedEffect(found.best.candidate, found, found.rivals, found.best.gain))
            problem, current = refit(problem, found.best.fit, used)
        report("judging each effect given the others", 0.9)
        problem, current, named = backward_eliminate(problem, base, current, named, split)
    except KeyboardInterrupt:
        interrupted = True
        named = [n for n in named if any(c.label == n.candidate.label for c in current.effects)]
    return SearchResult(problem, first, split, base, current, tuple(named), tuple(rounds), interrupted)
