"""The verdict over a search: what may be said, and why.

`named` and `ambiguous` need effects that explain most of what can be explained at all; else the gap is
`unexplained`, and a free curve says how much is there to be found. `no_gap`: the mismatch is the noise's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnimj.estimate.gap.search.cross_validation import heldout_losses, sum_by_group
from omnimj.estimate.gap.search.screening import curve_gains, sensitivities
from omnimj.estimate.gap.search.search import SearchResult
from omnimj.estimate.gap.search.selection import TrainingSplit
from omnimj.estimate.replay.problem import Fit, Problem, fit

NOISE_LEVEL = 1.5
"""Held-out mismatch in units of noise up to which there is no gap."""
MIN_EXPLAINED = 0.7
"""Share of the explainable mismatch (squared, beyond the noise) that named effects must take away."""
MIN_REDUCTION = 0.5
"""Share of everything above the noise (squared, held out) that they must take away, explainable or not."""
MIN_HELD_OUT_GAIN = 0.01
"""Share by which the mismatch of the runs that nothing was fitted to must shrink."""
MAX_RESIDUAL, MAX_SHARE_AT_BOUNDS = 5.0, 0.5
"""Mismatch left in units of noise, and share of the base at its boxes' ends, beyond which no name holds."""


@dataclass(frozen=True)
class Verdict:
    """What may be said."""

    kind: str
    reason: str
    explained: float | None
    """Share of the explainable mismatch that the effects take away; None without effects."""
    flexible: dict[str, float]
    """Variable → gain of a free curve of it beyond the last model."""


@dataclass(frozen=True)
class _Achieved:
    """What the named effects achieve; squares of mismatch throughout."""

    explained: float
    """Share of what can be explained (by them and a free curve) that they take away."""
    above: float
    """Share of what is above the noise that they take away on runs never used."""
    was: float
    rest: float
    """Mismatch before and after on runs never used, in units of noise."""
    stretched: float
    """Share of the base parameters that are needed at the ends of their boxes."""


def judge_search(found: SearchResult, split: TrainingSplit) -> Verdict:
    """Weighs the named effects against what a free curve and the noise say."""
    if not found.named:
        return _nothing_named(found)
    weighed, flexible = _measure_achieved(found, split)
    refusal = _refusal(weighed)
    if refusal is not None:
        return Verdict(*refusal, weighed.explained, flexible)
    words = f"{_format_explained(weighed)}; what is left is {weighed.rest:.2g} × the noise"
    kind = "ambiguous" if any(n.rivals for n in found.named) else "named"
    return Verdict(kind, words, weighed.explained, flexible)


def _nothing_named(found: SearchResult) -> Verdict:
    size, flexible = _heldout_rms(found, found.base.residual), found.curves.flexible if found.curves else {}
    if size <= NOISE_LEVEL:
        reason = f"after refitting what is uncertain the mismatch is {size:.2g} × its noise"
        return Verdict("no_gap", reason, None, flexible)
    best = max([0.0, *flexible.values()])
    reason = f"the mismatch is {size:.2g} × its noise, and no effect of the library gains clearly on held-out"
    return Verdict("unexplained", f"{reason} runs; a free curve gains {100.0 * best:.0f} %", None, flexible)


def _measure_achieved(found: SearchResult, split: TrainingSplit) -> tuple[_Achieved, dict[str, float]]:
    problem, final = found.problem, found.final
    base = fit(problem, (), found.base.x, found.used)
    before = sum_by_group(heldout_losses(problem, base, split.used, split.folds), split.groups).sum()
    after = sum_by_group(heldout_losses(problem, final, split.used, split.folds), split.groups).sum()
    columns = sensitivities(problem, final, split.used)
    flexible = curve_gains(problem, columns, split.groups, split.folds, split.seed).flexible
    best = max([0.0, *flexible.values()])
    floor = min(after * (1.0 - best) ** 2, before)
    rest, was = _heldout_rms(found, final.residual), _heldout_rms(found, base.residual)
    above = 1.0 - max(rest**2 - 1.0, 0.0) / max(was**2 - 1.0, 1e-30)
    explained = float((before - after) / max(before - floor, 1e-30))
    return _Achieved(explained, above, was, rest, _share_at_bounds(found)), flexible


def _format_explained(weighed: _Achieved) -> str:
    share = 100.0 * weighed.explained
    return f"the named take away {share:.0f} % of the squared mismatch that can be explained"


def _refusal(weighed: _Achieved) -> tuple[str, str] | None:
    """Why the effects may not be named: another verdict and its reason; None when they may."""
    rest, was = weighed.rest, weighed.was
    if weighed.explained < MIN_EXPLAINED:
        return (
            "unexplained",
            f"{_format_explained(weighed)}, a free curve takes away more: what is missing is not in "
            f"the library",
        )
    if rest >= (1.0 - MIN_HELD_OUT_GAIN) * was:
        if was <= NOISE_LEVEL:
            return "no_gap", f"the mismatch is {was:.2g} × its noise"
        return "unexplained", "what gains on the runs in use gains nothing on the others"
    if rest > NOISE_LEVEL and weighed.above < MIN_REDUCTION:
        share = f"the best of the library takes away {100.0 * weighed.above:.0f} % of what is above the noise"
        return "unexplained", f"{share}, {rest:.2g} × the noise is left"
    if rest > MAX_RESIDUAL and weighed.stretched > MAX_SHARE_AT_BOUNDS:
        left = (
            f"{_format_explained(weighed)}, but {rest:.2g} × the noise is left and most "
            f"uncertain parameters ran to"
        )
        return "unexplained", f"{left} the ends of their boxes: it stands in for something else"
    return None


def _share_at_bounds(found: SearchResult) -> float:
    """Share of the base parameters that the last model needs at the ends of their boxes."""
    base = found.problem.replay.base
    ends = [
        min(value - b.low, b.high - value) <= 1e-3 * (b.high - b.low)
        for b, value in zip(base, found.final.x, strict=False)
    ]
    return float(np.mean(ends)) if ends else 0.0


def _heldout_rms(found: SearchResult, residual: np.ndarray) -> float:
    """RMS over held-out blocks that are not masked, in units of noise."""
    out = residual[~found.used]
    valid = np.isfinite(found.problem.replay.measured[~found.used])
    return float(np.sqrt((out[valid] ** 2).mean())) if valid.any() else 0.0


# Which run would split what the data cannot: from a menu, by how far the rivals' predictions part.

_MIN_SEPARATION = 1.0  # RMS distance in units of noise above which one run tells two models apart


def next_experiment(problem: Problem, best: Fit, rivals: Sequence[tuple[str, Fit]]) -> dict[str, Any] | None:
    """The run of the menu in which the leader and its rivals part most.

    Every model is fitted already; each predicts every run of the menu. A run is as good as the rival that it
    splits least, then as the sum over rivals.

    Args:
      problem: Gives the menu and the noise.
      best: The leader.
      rivals: Names and fits of those it does not beat.

    Returns:
      `why`, `run`, `separates`, `parting` (name → RMS distance in units of noise); None when there is no
      rival or no menu.
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
        why = f"the predictions part by {max(distances):.2g} × the noise in this run: {experiment.words}"
    else:
        why = (
            f"no run of the menu splits them; {experiment.words} parts them most, "
            f"by {max(distances):.2g} × the noise"
        )
    parting = {name: round(d, 3) for name, d in zip(names, distances, strict=True)}
    return {"why": why, "run": dict(experiment.run), "separates": split, "parting": parting}
