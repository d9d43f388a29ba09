"""Verdict on a search with its reason, and the experiment that would separate rivals.

`named` and `ambiguous` need effects that explain most of what can be explained at all, and one of them that
exceeds the tolerance of the equations; otherwise the gap is `unexplained`. What can be explained is shown by
free curves, and by effects whose strength varies with speed, load and other variables. `no_gap`: the mismatch
is at noise level and no effect explains most of it, or it is within the noise and no effect gains
`CLEAR_WITHIN_NOISE` of it or removes half of what single channels show above it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from omnimj.estimate.gap.records import GivenUp, Outside
from omnimj.estimate.gap.search.candidates import NOISE_LEVEL, parameter_slice
from omnimj.estimate.gap.search.cross_validation import group_losses
from omnimj.estimate.gap.search.screening import curve_gains
from omnimj.estimate.gap.search.search import SearchResult
from omnimj.estimate.gap.search.strength import strength_gains
from omnimj.estimate.gap.sentences import join_words, variable_words
from omnimj.estimate.intervals import finite_rms
from omnimj.estimate.replay.interface import CandidateEffect, Structure
from omnimj.estimate.replay.problem import Fit, Problem, fit

MIN_EXPLAINED = 0.88
"""Smallest share of the explainable mismatch (squared, beyond the noise) that named effects must remove."""
TOLERANCE = 0.1
"""Share of its typical size below which an effect lies within the model error of the equations:
every real machine deviates by so little from any law of friction, gear or motor."""
MIN_REDUCTION = 0.5
"""Smallest share of all mismatch above the noise (squared, held out) that they must remove."""
MIN_HELD_OUT_GAIN = 0.01
"""Smallest reduction of the mismatch of the held-out runs."""
MAX_RESIDUAL, MAX_SHARE_AT_BOUNDS = 5.0, 0.5
"""Remaining mismatch in units of noise, and share of base parameters at bounds, beyond which nothing is
named."""
WITHIN_NOISE = 1.1
"""Mismatch in units of noise up to which a channel is within it: the noise is an estimate itself."""
CLEAR_WITHIN_NOISE = 0.2
"""Gain from which an effect counts although no channel exceeds its noise: the noise is an upper bound, since
it contains the largest expected error of the equations. On machines without such an effect gains within the
noise reach 0.09, springs between motor and link 0.1 to 0.43."""
COMPLETE = 2.0
"""Held-out mismatch in units of noise above which something is missing, beside named effects or in a
channel."""
_MIN_SEPARATION = 1.0  # RMS distance in units of noise above which a run separates two models


@dataclass(frozen=True)
class Verdict:
    """Verdict with its reason."""

    kind: str
    reason: str
    flexible: dict[str, float]
    """Variable → gain of a free curve of it beyond the last model."""
    remains: float
    """Held-out mismatch of the last model that a model file can state, RMS over all channels in units of
    noise."""
    tolerated: tuple[str, ...] = ()
    """Labels of effects that explain the mismatch, but within the tolerance of the equations."""
    undetermined: GivenUp | None = None
    """Where nothing is named, the effect that gains most of those whose size the data do not determine."""
    outside: Outside | None = None
    """Structure outside the library."""

    @property
    def incomplete(self) -> bool:
        """True if effects are named and something else is missing as well."""
        return self.kind in ("named", "ambiguous") and self.remains > COMPLETE


@dataclass(frozen=True)
class _Achieved:
    """Reduction achieved by the named effects; squares of mismatch throughout."""

    explained: float
    """Share of what can be explained (by them and a free curve) that they remove."""
    above: float
    """Share of the held-out mismatch above the noise that they remove."""
    was: float
    rest: float
    """Held-out mismatch before and after, in units of noise."""
    stretched: float
    """Share of the base parameters that end at their bounds."""
    varies: str
    """Effect and variable of the strength that explains more than any free curve; empty without one."""
    by: str
    """Named effects that remove it, with structure outside the library where there is some."""


def judge_search(found: SearchResult) -> Verdict:
    """Weigh the named effects against a free curve and the noise."""
    verdict = _judge_effects(found)
    if found.outside is None or verdict.kind == "no_gap":
        return verdict
    return replace(verdict, outside=_describe_outside(found, found.outside))


def _describe_outside(found: SearchResult, structure: Structure) -> Outside:
    words, values = structure.describe(found.final.x[parameter_slice(found.problem, found.final, structure)])
    return Outside(words, structure.causes, values, _heldout_rms(found, found.final.residual))


def _judge_effects(found: SearchResult) -> Verdict:
    if not found.named or _is_faint(found):
        return _nothing_named(found)
    achieved, flexible = _measure_achieved(found)
    refusal, tolerated = _refusal(achieved), ()
    if refusal is None:
        refusal, tolerated = _within_tolerance(found)
    largest = channel_sizes(found, found.base).max(initial=0.0)
    if refusal is not None and achieved.was <= NOISE_LEVEL and largest <= COMPLETE:
        return Verdict("no_gap", _format_noise(achieved.was), flexible, achieved.was)
    if refusal is not None:
        return Verdict("unexplained", refusal, flexible, achieved.was, tolerated)
    rest = _heldout_rms(found, found.described.residual)
    without = "" if found.outside is None else " without it"
    words = f"{_format_explained(achieved)}; {rest:.2g} × the noise remains{without}"
    kind = "ambiguous" if any(n.rivals for n in found.named) else "named"
    return Verdict(kind, words, flexible, rest)


def _is_faint(found: SearchResult) -> bool:
    """True if effects gain little, and no channel shows a mismatch of which they remove half.

    Where the whole mismatch is within the noise, a channel may exceed its own by chance. An effect that gains
    a little elsewhere says nothing about it.
    """
    if any(one.gain.value >= CLEAR_WITHIN_NOISE for one in found.named):
        return False
    before, after = channel_sizes(found, found.base), channel_sizes(found, found.final)
    above = before > WITHIN_NOISE
    if not above.any():
        return True
    if _heldout_rms(found, found.base.residual) > WITHIN_NOISE:
        return False
    left = np.maximum(after[above] ** 2 - 1.0, 0.0).sum()
    return bool(left > (1.0 - MIN_REDUCTION) * (before[above] ** 2 - 1.0).sum())


def _nothing_named(found: SearchResult) -> Verdict:
    size, flexible = _heldout_rms(found, found.base.residual), found.curves.flexible if found.curves else {}
    if size <= NOISE_LEVEL:
        reason = _format_noise(size)
        if found.named:
            gains = (f"{one.candidate.label} gains {100.0 * one.gain.value:.2g} %" for one in found.named)
            reason = f"{reason}; {', '.join(gains)}, too little to be named within it"
        return Verdict("no_gap", reason, flexible, size)
    best = max([0.0, *flexible.values()])
    left = next((one for one in found.given_up if one.is_undetermined), None)
    if left is None:
        gained = "and no effect of the library gains clearly on held-out runs"
    else:
        gained = f"{left.label} gains {100.0 * left.gain.value:.0f} % on held-out runs, but {left.reason}"
    reason = f"the mismatch is {size:.2g} × its noise, {gained}; a free curve gains {100.0 * best:.0f} %"
    return Verdict("unexplained", reason, flexible, size, undetermined=left)


def _measure_achieved(found: SearchResult) -> tuple[_Achieved, dict[str, float]]:
    problem, final, split = found.problem, found.final, found.split
    base = fit(problem, (), found.base.x, found.used)
    before, after = (group_losses(problem, model, split).sum() for model in (base, final))
    flexible = curve_gains(problem, final, split).flexible
    best, varies = max([0.0, *flexible.values()]), ""
    (first,) = found.first.mismatches([found.base.x], ())
    rest, was = _heldout_rms(found, final.residual), _heldout_rms(found, base.residual)
    was = min(was, _heldout_rms(found, problem.whitened(first)))  # the twin is simulated anew for every model
    if rest > NOISE_LEVEL:  # no law can be judged by noise
        strengths = strength_gains(problem, final, split)
        (label, variable), gain = max(strengths.items(), key=lambda one: one[1], default=(("", ""), 0.0))
        if gain > best:
            best, varies = gain, f"{label} of a strength that varies with {variable_words(variable)}"
    floor = min(after * (1.0 - best) ** 2, before)
    above = 1.0 - max(rest**2 - 1.0, 0.0) / max(was**2 - 1.0, 1e-30)
    explained = float((before - after) / max(before - floor, 1e-30))
    beside = "" if found.outside is None else ", with a structure outside the library,"
    by = f"the named effects{beside}"
    return _Achieved(explained, above, was, rest, share_at_bounds(found), varies, by), flexible


def _format_explained(achieved: _Achieved) -> str:
    share = 100.0 * achieved.explained
    return f"{achieved.by} remove {share:.0f} % of the explainable squared mismatch"


def _format_noise(size: float) -> str:
    return f"after refitting the uncertain parameters the mismatch is {size:.2g} × its noise"


def _refusal(achieved: _Achieved) -> str | None:
    """Reason if the effects must not be named; None if they may be."""
    rest, was = achieved.rest, achieved.was
    if achieved.explained < MIN_EXPLAINED:
        more = achieved.varies or "a free curve"
        return f"{_format_explained(achieved)}, {more} removes more: the effect is not in the library"
    if rest >= (1.0 - MIN_HELD_OUT_GAIN) * was:
        return "the gain on the training runs does not carry over to the held-out runs"
    if rest > NOISE_LEVEL and achieved.above < MIN_REDUCTION:
        share = f"the best effects remove {100.0 * achieved.above:.0f} % of the mismatch above the noise"
        return f"{share}, {rest:.2g} × the noise remains"
    if rest > MAX_RESIDUAL and achieved.stretched > MAX_SHARE_AT_BOUNDS:
        left = (
            f"{_format_explained(achieved)}, but {rest:.2g} × the noise remains and most "
            f"uncertain parameters end"
        )
        return f"{left} at their bounds: the effects substitute for another one"
    return None


def _within_tolerance(found: SearchResult) -> tuple[str | None, tuple[str, ...]]:
    """Reason not to name effects that are all within the tolerance of the equations, and their labels.

    A set is within it if its smallest member is. Sensors and what turns with the wheel are exempt: no error
    of a law of motion looks like them.
    """
    smallest, labels = [], []
    for named in found.named:
        options = [(named.candidate, found.final), *((r.candidate, r.fit) for r in named.rivals)]
        sizes = [_relative_size(found, *option) for option in options]
        if min(sizes) >= TOLERANCE:
            return None, ()
        labels += [candidate.label for candidate, _ in options]
        smallest.append(options[int(np.argmin(sizes))][0].label)
    small = join_words(tuple(dict.fromkeys(smallest)))
    reason = (
        f"less than a tenth of the typical size of {small} would explain it: the equations may err by as much"
    )
    return reason, tuple(dict.fromkeys(labels))


def _relative_size(found: SearchResult, candidate: CandidateEffect, fitted: Fit) -> float:
    if candidate.is_sensor or candidate.turns_with_wheel:
        return math.inf
    return candidate.relative_size(fitted.x[parameter_slice(found.problem, fitted, candidate)])


def share_at_bounds(found: SearchResult) -> float:
    """Share of the base parameters that the last model leaves at bounds other than 0, which means absent."""
    base = found.problem.replay.base
    ends = []
    for b, value in zip(base, found.final.x, strict=False):
        edge = 1e-3 * (b.high - b.low)
        is_absent = b.low == 0.0 and value <= edge
        ends.append(min(value - b.low, b.high - value) <= edge and not is_absent)
    return float(np.mean(ends)) if ends else 0.0


def _heldout_rms(found: SearchResult, residual: np.ndarray) -> float:
    """RMS over held-out blocks that are not masked, in units of noise."""
    valid = np.isfinite(found.problem.replay.measured) & ~found.used[:, None]
    return finite_rms(residual[valid], without=0.0)


def channel_sizes(found: SearchResult, model: Fit) -> np.ndarray:
    """Held-out RMS mismatch in units of noise of each channel that has such samples, shape (channels,)."""
    valid = np.isfinite(found.problem.replay.measured) & ~found.used[:, None]
    channels = zip(model.residual.T, valid.T, strict=True)
    return np.array([finite_rms(one[rows]) for one, rows in channels if rows.any()])


def next_experiment(problem: Problem, best: Fit, rivals: Sequence[tuple[str, Fit]]) -> dict[str, Any] | None:
    """Candidate run in which the leader and its rivals differ most.

    Every fitted model predicts every candidate run. A run is ranked by the rival that it separates least,
    then by the sum over rivals.

    Returns:
      `why`, `run`, `separates`, `parting` (name → RMS distance in units of noise); None without rivals or
      candidate runs.
    """
    candidate_experiments = problem.replay.candidate_experiments()
    if not rivals or not candidate_experiments:
        return None
    settings = [problem.split(f.x, f.effects)[0] for f in (best, *(fitted for _, fitted in rivals))]
    found = []
    for experiment in candidate_experiments:
        first, *others = problem.replay.predict(settings, experiment)
        distances = [float(np.sqrt(np.nanmean(((other - first) / problem.noise) ** 2))) for other in others]
        found.append((experiment, distances))
    experiment, distances = max(found, key=lambda one: (min(min(one[1]), 10.0), sum(one[1])))
    names = [name for name, _ in rivals]
    split = [name for name, d in zip(names, distances, strict=True) if d >= _MIN_SEPARATION]
    if split:
        why = f"the predictions differ by {max(distances):.2g} × the noise in this run: {experiment.words}"
    else:
        why = (
            f"no candidate run separates them; {experiment.words} separates them most, "
            f"by {max(distances):.2g} × the noise"
        )
    parting = {name: round(d, 3) for name, d in zip(names, distances, strict=True)}
    return {"why": why, "run": dict(experiment.run), "separates": split, "parting": parting}
