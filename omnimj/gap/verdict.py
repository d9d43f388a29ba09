"""The verdict over a search: what may be said, and why.

`named` and `ambiguous` need effects that explain most of what can be explained at all; else the gap is
`unexplained`, and a free curve says how much is there to be found. `no_gap`: the mismatch is the noise's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnimj.gap.curves import curve_gains, sensitivities
from omnimj.gap.fit import Fit, fit
from omnimj.gap.heldout import by_group, heldout_losses
from omnimj.gap.name import Data
from omnimj.gap.search import Searched

AT_THE_NOISE = 1.5
"""Held-out mismatch in units of noise up to which there is no gap."""
LEAST_EXPLAINED = 0.7
"""Share of the explainable mismatch (squared, beyond the noise) that named effects must take away."""
LEAST_HELD_OUT = 0.01
"""Share by which the mismatch of the runs that nothing was fitted to must shrink."""
FAR_OFF, MOST_STRETCHED = 5.0, 0.5
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


def judge_search(found: Searched, data: Data) -> Verdict:
    """Weighs the named effects against what a free curve and the noise say."""
    problem = found.problem
    size = _level(found, found.base.residual)
    if not found.named:
        flexible = found.curves.flexible if found.curves else {}
        best = max(flexible.values(), default=0.0)
        if size <= AT_THE_NOISE:
            reason = f"after refitting what is uncertain the mismatch is {size:.2g} × its noise"
            return Verdict("no_gap", reason, None, flexible)
        reason = f"the mismatch is {size:.2g} × its noise, and no effect of the library gains clearly"
        words = f"{reason} on held-out runs; a free curve gains {100.0 * max(best, 0.0):.0f} %"
        return Verdict("unexplained", words, None, flexible)
    base = _base(found)
    before = by_group(heldout_losses(problem, base, data.used, data.folds), data.groups)
    after = by_group(heldout_losses(problem, found.final, data.used, data.folds), data.groups)
    flexible = curve_gains(
        problem, sensitivities(problem, found.final, data.used), data.groups, data.folds, data.seed
    ).flexible
    best = max([0.0, *flexible.values()])
    floor = min(float(after.sum()) * (1.0 - best) ** 2, float(before.sum()))
    explained = float((before.sum() - after.sum()) / max(before.sum() - floor, 1e-30))
    rest, was = _level(found, found.final.residual), _level(found, base.residual)
    words = f"the named take away {100.0 * explained:.0f} % of the squared mismatch that can be explained"
    if explained < LEAST_EXPLAINED:
        reason = f"{words}, a free curve takes away more: what is missing is not in the library"
        return Verdict("unexplained", reason, explained, flexible)
    if rest >= (1.0 - LEAST_HELD_OUT) * was:
        # what helped while fitting does not help where nothing was fitted
        if was <= AT_THE_NOISE:
            return Verdict("no_gap", f"the mismatch is {was:.2g} × its noise", None, flexible)
        return Verdict(
            "unexplained", "what gains on the runs in use gains nothing on the others", 0.0, flexible
        )
    if rest > FAR_OFF and _stretched(found) > MOST_STRETCHED:
        reason = f"{words}, but {rest:.2g} × the noise is left and most uncertain parameters ran to the ends"
        return Verdict(
            "unexplained", f"{reason} of their boxes: it stands in for something else", explained, flexible
        )
    open_to = any(n.rivals for n in found.named)
    left = f"{words}; what is left is {rest:.2g} × the noise"
    return Verdict("ambiguous" if open_to else "named", left, explained, flexible)


def _base(found: Searched) -> Fit:
    """The refitted base seen by the last model's problem."""
    return fit(found.problem, (), found.base.x, found.used)


def _stretched(found: Searched) -> float:
    """Share of the base parameters that the last model needs at the ends of their boxes."""
    base = found.problem.replay.base
    ends = [
        min(value - b.low, b.high - value) <= 1e-3 * (b.high - b.low)
        for b, value in zip(base, found.final.x, strict=False)
    ]
    return float(np.mean(ends)) if ends else 0.0


def _level(found: Searched, residual: np.ndarray) -> float:
    """RMS over held-out blocks that are not masked, in units of noise."""
    out = residual[~found.used]
    valid = np.isfinite(found.problem.replay.measured[~found.used])
    return float(np.sqrt((out[valid] ** 2).mean())) if valid.any() else 0.0
