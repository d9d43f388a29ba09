"""Search: refit the base, add effects alone or together, and judge them given each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from omnimj.effects import Interval
from omnimj.estimate.gap.records import UNDETERMINED, GivenUp
from omnimj.estimate.gap.search.candidates import (
    MARGIN,
    NOISE_LEVEL,
    CurrentModel,
    exceeds_margin,
    fit_candidate,
    fit_without,
    parameter_slice,
    refine_leaders,
    training_rms,
)
from omnimj.estimate.gap.search.cross_validation import (
    TrainingSplit,
    choose_heldout,
    group_losses,
    make_folds,
    make_groups,
)
from omnimj.estimate.gap.search.elimination import eliminate
from omnimj.estimate.gap.search.judgement import Judgement, SelectedEffect, judge_effects
from omnimj.estimate.gap.search.refitting import fit_base, refit
from omnimj.estimate.gap.search.screening import CurveGains, screen_candidates
from omnimj.estimate.gap.search.selection import Progress, SelectionRound, effective_share, select_round
from omnimj.estimate.gap.search.sensitivities import Sensitivities
from omnimj.estimate.gap.search.subsets import best_subset
from omnimj.estimate.gap.search.totals import with_totals
from omnimj.estimate.gap.search.uncertainty import parameter_reach, undetermined
from omnimj.estimate.replay.interface import Replay, Structure
from omnimj.estimate.replay.problem import Fit, Problem, fit, polish, reevaluate
from omnimj.signals import Array

_WEAK = 0.10  # held-out gain of the best effect alone up to which pairs and triples are tried as well
_MANY = 3  # effects from which fewer, or another start, are tried
_AS_LITTLE = 1.05  # multiple of a loss that is about as small
_MOST_TRIES = 2  # additions of one round that may fail
_LARGE = 0.3  # share of the squared mismatch that structure must explain to first order to be tried


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
    """Effects of the library in the last model."""
    rounds: tuple[SelectionRound, ...]
    """Rounds of the search; where a gap was left, nothing was added in the last one."""
    outcomes: tuple[str, ...] = ()
    """Per round: the effects that it added, or the reason for which it added none."""
    given_up: tuple[GivenUp, ...] = ()
    """Effects that were in the model for a while, with the reason for which they are not."""
    ended: str = ""
    """Reason for which nothing more was added; empty if the search was interrupted."""
    reach: Array | None = None
    """Half widths of the last model's 90 % intervals, shape (parameters,); None before they are judged."""

    @property
    def interrupted(self) -> bool:
        """True if the search did not reach its end."""
        return not self.ended

    @property
    def used(self) -> NDArray[np.bool_]:
        """Blocks fitted to, shape (blocks,)."""
        return self.split.used

    @property
    def outside(self) -> Structure | None:
        """Structure outside the library in the last model."""
        return next((c for c in self.final.effects if isinstance(c, Structure)), None)

    @cached_property
    def described(self) -> Fit:
        """The last model without structure outside the library: what a model file can say."""
        if self.outside is None:
            return self.final
        own = parameter_slice(self.problem, self.final, self.outside)
        effects = tuple(c for c in self.final.effects if not c.is_outside)
        x, jacobian = np.delete(self.final.x, own), np.delete(self.final.jacobian, own, axis=1)
        (residual,) = self.problem.residuals([x], effects)
        return Fit(effects, x, residual, jacobian, np.inf)

    @property
    def curves(self) -> CurveGains | None:
        """Gains of curves beyond the model of the last round."""
        return self.rounds[-1].curves if self.rounds else None


def search(replay: Replay, holdout: tuple[str, ...], seed: int, report: Progress) -> SearchResult:
    """Find the effects that a model lacks.

    Effects are added while one of them, a pair or a triple gains on held-out training runs. Whenever the
    model has grown, all its effects are judged given each other (`judge_effects`). A search that ends with
    many effects goes on without the one that it added first.

    Args:
      holdout: Conditions or runs excluded from every fit; drawn by the seed when empty.
      seed: Seed of the held-out draw, the folds and the decoys.
    """
    groups = make_groups(replay)
    heldout = choose_heldout(groups, seed, holdout)
    used = ~heldout[groups.of_block]
    split = TrainingSplit(used, groups, make_folds(groups, ~heldout, seed), seed)
    problem, base = fit_base(replay, used, report)
    growing = _Growing(problem, base, split, report)
    try:
        growing.run()
        growing = _other_start(growing, base, report)
    except KeyboardInterrupt:
        growing.ended = ""  # also where only another start, or the intervals, are missing
    state = growing.state
    return SearchResult(
        state.problem,
        problem,
        split,
        base,
        with_totals(state.problem, state.final),
        tuple(n for n in state.named if not n.candidate.is_outside),
        tuple(growing.rounds),
        tuple(growing.outcomes),
        growing.given_up(),
        growing.ended,
        growing.reach,
    )


def _other_start(first: _Growing, base: Fit, report: Progress) -> _Growing:
    """The search, or a repeat of it without the first added effect if that scores better.

    Only a search that ends with many effects and leaves more than noise is repeated: its first effect may
    stand in for several others, which are not found beside it.
    """
    if not first.hinges_on_first_effect or first.mismatch() <= NOISE_LEVEL:
        return first
    report("searching from another start", 0.0)
    whole = first.problem.replay
    part = _PartialReplay(whole, first.began_with)
    other = _Growing(replace(first.problem, replay=cast(Replay, part)), base, first.split, report)
    other.run()
    if not other.state.named or not _scores_better(other.state, first.state, first.split):
        return first
    names = " and ".join(sorted(first.began_with))
    without = f"begun without {names}, with which the search ended at {len(first.state.named)} effects"
    other.outcomes[0] = f"{without}: {other.outcomes[0]}"
    other.compare_with(whole)
    return other


def _scores_better(other: Judgement, first: Judgement, split: TrainingSplit) -> bool:
    """True if a model has the better information score on held-out training runs."""
    noise = np.minimum(first.problem.noise, other.problem.noise)
    share, scores = effective_share(first.problem, first.final, split), []
    for state in (other, first):
        common = replace(state.problem, noise=noise, huber_scale=first.problem.huber_scale)
        losses = group_losses(common, reevaluate(state.final, common), split)
        free = sum(p.high > p.low for c in state.final.effects for p in c.parameters)
        scores.append(0.5 * share * float(losses.sum()) + free)
    return scores[0] < scores[1]


class _PartialReplay:
    """Replay without some of its candidates."""

    def __init__(self, replay: Replay, left_out: frozenset[str]):
        self._replay = replay
        self.candidates = tuple(c for c in replay.candidates if c.label not in left_out)

    def __getattr__(self, name: str):
        return getattr(self._replay, name)


def _leaves_as_little(other: Judgement, first: Judgement, split: TrainingSplit) -> bool:
    """True if a model leaves nothing but noise, and on held-out runs about as little as another one."""
    common = replace(first.problem, noise=other.problem.noise, huber_scale=other.problem.huber_scale)
    losses = group_losses(common, reevaluate(first.final, common), split).sum()
    own = group_losses(other.problem, other.final, split).sum()
    return bool(own <= _AS_LITTLE * losses) and training_rms(other.problem, other.final, split) <= NOISE_LEVEL


class _Growing:
    """Model that grows by effects until nothing helps; its state survives an interruption."""

    def __init__(self, problem: Problem, base: Fit, split: TrainingSplit, report: Progress):
        self.state = Judgement(problem, base, (), ())
        self.rounds: list[SelectionRound] = []
        self.outcomes: list[str] = []
        self.ended = ""
        self.reach: Array | None = None
        self._near = Sensitivities()  # of the last round's model
        self._base, self.problem, self.split = base, problem, split
        self.began_with: frozenset[str] = frozenset()
        """Labels of the effects that were added first."""
        self._report, self._most = report, problem.replay.most_effects
        self._given_up: dict[str, GivenUp] = {}
        self._seen: set[frozenset[str]] = {frozenset()}

    @property
    def hinges_on_first_effect(self) -> bool:
        """True if the model has many effects, and still those that were added first."""
        is_there = bool(self.began_with) and self.began_with <= self.state.final.labels
        return is_there and len(self.state.named) >= _MANY

    def run(self) -> None:
        """Run rounds until one of them leaves the model as it was."""
        if self.state.problem.replay.backward_elimination and self.mismatch() > NOISE_LEVEL:
            self._eliminate_backward()
        self._add_while_it_helps()
        self._try_fewer()
        self._try_structure()
        self._give_up_undetermined()

    def _add_while_it_helps(self) -> None:
        while not self.ended:
            found = self._next_round()
            if len(self.state.named) >= self._most:
                self.ended = f"the model has {self._most} effects, the largest number"
                self.outcomes.append(self.ended)
                break
            self.ended = self._grow(found)

    def _try_structure(self) -> None:
        """Allow structure outside the library, and keep it if nothing but noise is left with it.

        Effects of the library that made up for a part of it are needless beside it, and others that it hid
        can be found.
        """
        structures, first, split = self.problem.replay.structures, self.state, self.split
        if self.mismatch() <= NOISE_LEVEL:
            return
        self._report("trying structure outside the library", 0.9)
        model = CurrentModel(first.problem, first.final, split)
        screened = screen_candidates(first.problem, first.final, structures, split.used)
        screened = [one for one in screened if one.share >= _LARGE]
        if not screened:
            return
        tried = refine_leaders(model, [fit_candidate(model, one) for one in screened], screened)
        best = min(tried, key=lambda one: float(one.losses.sum()))
        kept = self._near, self.ended, dict(self._given_up)
        count = len(self.rounds)
        self._judge(best.fit)
        self.ended = ""
        self._add_while_it_helps()
        if self.mismatch() <= NOISE_LEVEL and best.candidate.label in self.state.final.labels:
            self.outcomes[count - 1] += f"; {best.candidate.words} joined the model"
            return
        self.state, (self._near, self.ended, self._given_up) = first, kept
        del self.rounds[count:], self.outcomes[count:]

    def compare_with(self, replay: Replay) -> None:
        """Judge the effects given all candidates of a replay, and their intervals."""
        problem, self.reach = replace(self.state.problem, replay=replay), None
        self.state = judge_effects(problem, self.state.final, self.split, Sensitivities())
        self._give_up_undetermined()

    def _try_fewer(self) -> None:
        """Put a pair or triple in the place of many effects, if it leaves about as little, nothing but noise.

        An effect that stands in for several others can be the best one alone. The effects that are added then
        make up for what it lacks, and none of them can be left out or exchanged any more.
        """
        first, split, near = self.state, self.split, Sensitivities()
        if not self.hinges_on_first_effect:
            return
        self._report("trying fewer effects", 0.9)
        others = [c for c in first.problem.replay.candidates if c.label not in self.began_with]
        base = fit(first.problem, (), self._base.x, split.used)
        screened = screen_candidates(first.problem, base, others, split.used, near)
        found = best_subset(first.problem, base, screened, split, near, len(first.named) - 1)
        if found is None:
            return
        problem, model = refit(first.problem, found[1], split.used)
        if _leaves_as_little(Judgement(problem, model, (), ()), first, split):
            judged = judge_effects(problem, model, split, near)
            if 0 < len(judged.named) < len(first.named) and _leaves_as_little(judged, first, split):
                self.state, self._near = judged, near
                names = " and ".join(c.label for c in judged.final.effects)
                out = " and ".join(sorted(self.began_with))
                self.outcomes[-1] = f"{self.outcomes[-1]}; {names} leave as little without {out}"

    def _give_up_undetermined(self) -> None:
        """Give up effects without rivals whose intervals include nothing, the smallest gain first."""
        used = self.split.used
        while self.state.named:
            self._report("judging the intervals", 0.9)
            polished = polish(self.state.problem, self.state.final, used)
            start = self.state = replace(self.state, final=polished)
            final = with_totals(start.problem, start.final)
            self.reach = parameter_reach(start.problem, final, used, self._near)
            open_ones = undetermined(start.problem, final, self.reach)
            doubtful = [n for n in start.named if n.candidate.label in open_ones and not n.rivals]
            if not doubtful:
                return
            worst = min(doubtful, key=lambda n: n.gain.value)
            label = worst.candidate.label
            reduced = fit_without(start.problem, start.final, worst.candidate, self.split, 2)
            judged = judge_effects(start.problem, reduced, self.split, self._near, may_exchange=False)
            given_up = [GivenUp(label, worst.gain, UNDETERMINED), *judged.given_up]
            self._given_up |= {one.label: one for one in given_up}
            self.state, self.reach = judged, None
            self.ended = "every further effect that gains was tried and did not hold"

    def _eliminate_backward(self) -> None:
        """Eliminate effects backwards from the model of all, and judge those that are left."""
        self._next_round()
        self._report("dropping effects from the model of all", 0.5)
        start, used = self.state, self.split.used
        found = eliminate(start.problem, start.final, self.split, self._most)
        problem, current = refit(start.problem, found, used)
        self._report("judging each effect given the others", 0.9)
        judged = judge_effects(problem, current, self.split, Sensitivities(), may_exchange=False)
        self._given_up |= {one.label: one for one in judged.given_up}
        self.state = judged
        names = ", ".join(c.label for c in judged.final.effects)
        self.outcomes.append(f"backward elimination from all effects left {names or 'none'}")
        self.ended = "none of these effects can be left out without loss on held-out runs"

    def _grow(self, found: SelectionRound) -> str:
        """Try additions until one changes the model; the reason for which none did, empty otherwise."""
        before, failed = self.state.final.labels, []
        is_sure = any(exceeds_margin(t.gain) for t in found.tried)
        for gain, addition in self._additions(found):
            added = " and ".join(c.label for c in addition.effects[len(self.state.final.effects) :])
            if len(failed) == _MOST_TRIES:
                self.outcomes.append(f"{_list_tries(failed)} did not hold")
                return f"{added} and weaker candidates were not tried, after {_MOST_TRIES} that did not hold"
            kept, is_sure = self.state, is_sure or exceeds_margin(gain)
            self._judge(addition)
            if self.state.final.labels != before:
                text = f"{added} gained {100.0 * gain.value:.3g} % and joined the model"
                self.outcomes.append(f"{_list_tries(failed)} did not hold, {text}" if failed else text)
                self.began_with = self.began_with or addition.labels
                return ""
            failed.append(added)
            self.state = kept
        end = "no further effect in the library gains enough to be named"
        if self._leaves_noise():
            end = "what is left is noise, beside which only effects of the sensors were sought"
        elif is_sure:
            end = "every further effect that gains was tried and did not hold"
        self.outcomes.append(f"{_list_tries(failed)} did not hold" if failed else end)
        return end

    def _leaves_noise(self) -> bool:
        """True if the named effects leave a mismatch that the equations themselves may have.

        The machine's effects are not sought there: they would stand in for the equations' own errors.
        """
        return bool(self.state.named) and self.mismatch() <= NOISE_LEVEL

    def mismatch(self) -> float:
        """Training mismatch of the model so far, RMS in units of noise."""
        return training_rms(self.state.problem, self.state.final, self.split)

    def given_up(self) -> tuple[GivenUp, ...]:
        """Effects that were in a model and are in none of the result's sets, the largest gain first."""
        kept = {one.candidate.label for n in self.state.named for one in (n, *n.rivals)}
        left = [g for label, g in self._given_up.items() if label not in kept]
        return tuple(sorted(left, key=lambda g: -g.gain.value))

    def _next_round(self) -> SelectionRound:
        state, taken = self.state, {n.candidate.label for n in self.state.named}
        left = [c for c in state.problem.replay.candidates if c.label not in taken]
        if self._leaves_noise():
            left = [c for c in left if c.is_sensor]
        near = self._near = Sensitivities()
        self.rounds.append(select_round(state.problem, state.final, left, self.split, near, self._report))
        return self.rounds[-1]

    def _additions(self, found: SelectionRound) -> Iterator[tuple[Interval, Fit]]:
        """Gains and models of additions that lead to a model not seen yet, the most promising first.

        The leader needs no sure gain: effects that mask each other gain little alone, and all are judged
        together. Where it is weak or does not hold, pairs and triples are tried as well. The others need a
        gain whose lower bound is above the margin.
        """
        options = [(t.gain, t.fit) for t in found.tried[:1] if t.gain.value > MARGIN]
        is_weak = all(gain.value <= _WEAK for gain, _ in options)
        if not is_weak:
            yield from self._unseen(options)
        options = sorted([*options, *self._subsets(found)], key=lambda option: -option[0].value)
        yield from self._unseen(options)
        yield from self._unseen([(t.gain, t.fit) for t in found.tried if exceeds_margin(t.gain)])

    def _subsets(self, found: SelectionRound) -> list[tuple[Interval, Fit]]:
        """The best pair or triple, if it gains and anything but noise is left."""
        room = self._most - len(self.state.named)
        if room < 2 or self.mismatch() <= NOISE_LEVEL:
            return []
        self._report("trying pairs and triples of effects", 1.0)
        problem, final = self.state.problem, self.state.final
        best = best_subset(problem, final, found.screened, self.split, self._near, room)
        return [best] if best is not None and exceeds_margin(best[0]) else []

    def _unseen(self, options: Sequence[tuple[Interval, Fit]]) -> Iterator[tuple[Interval, Fit]]:
        """Options whose effects were not in one model before; they count as seen from now on."""
        for gain, fitted in options:
            if fitted.labels not in self._seen:
                self._seen.add(fitted.labels)
                yield gain, fitted

    def _judge(self, addition: Fit) -> None:
        """Refit the grown model and judge its effects; an interruption leaves it as it was added."""
        used = self.split.used
        problem, current = refit(self.state.problem, addition, used)
        self.state = self._provisional(problem, current)
        self._report("judging each effect given the others", 0.9)
        judged = judge_effects(problem, current, self.split, self._near)
        if judged.final.effects != current.effects:
            problem, final = refit(problem, judged.final, used)
            judged = replace(judged, problem=problem, final=final)
        self._given_up |= {one.label: one for one in judged.given_up}
        self._seen.add(judged.final.labels)
        self.state = judged

    def _provisional(self, problem: Problem, model: Fit) -> Judgement:
        """The grown model with the gains of the round that added to it."""
        known = {t.candidate.label: t.gain for t in self.rounds[-1].tried}
        known |= {n.candidate.label: n.gain for n in self.state.named}
        named = [SelectedEffect(c, (), known[c.label]) for c in model.effects if c.label in known]
        return Judgement(problem, model, tuple(named), ())


def _list_tries(tried: Sequence[str]) -> str:
    """List additions in the order in which they were tried: `a, then b and c`."""
    return ", then ".join(tried)
