"""The verdict over a search: what may be said, and why.

`named` and `ambiguous` need effects that explain most of what can be explained at all; else the gap is
`unexplained`, and a free curve says how much is there to be found. `no_gap`: the mismatch is the noise's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnimj.gap.curves import curve_gains, sensitivities
from omnimj.gap.fit import fit
from omnimj.gap.heldout import by_group, heldout_losses
from omnimj.gap.name import Data
from omnimj.gap.search import Searched

AT_THE_NOISE = 1.5
"""Held-out mismatch in units of noise up to which there is no gap."""
LEAST_EXPLAINED = 0.7
"""Share of the explainable mismatch (squared, beyond the noise) that named effects must take away."""
LEAST_OF_ALL = 0.5
"""Share of everything above the noise (squared, held out) that they must take away, explainable or not."""
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


@dataclass(frozen=True)
class _Weighed:
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


def judge_search(found: Searched, data: Data) -> Verdict:
    """Weighs the named effects against what a free curve and the noise say."""
    if not found.named:
        return _nothing_named(found)
    weighed, flexible = _weigh(found, data)
    refusal = _refusal(weighed)
    if refusal is not None:
        return Verdict(*refusal, weighed.explained, flexible)
    words = f"{_took(weighed)}; what is left is {weighed.rest:.2g} × the noise"
    kind = "ambiguous" if any(n.rivals for n in found.named) else "named"
    return Verdict(kind, words, weighed.explained, flexible)


def _nothing_named(found: Searched) -> Verdict:
    size, flexible = _level(found, found.base.residual), found.curves.flexible if found.curves else {}
    if size <= AT_THE_NOISE:
        reason = f"after refitting what is uncertain the mismatch is {size:.2g} × its noise"
        return Verdict("no_gap", reason, None, flexible)
    best = max([0.0, *flexible.values()])
    reason = f"the mismatch is {size:.2g} × its noise, and no effect of the library gains clearly on held-out"
    return Verdict("unexplained", f"{reason} runs; a free curve gains {100.0 * best:.0f} %", None, flexible)


def _weigh(found: Searched, data: Data) -> tuple[_Weighed, dict[str, float]]:
    problem, final = found.problem, found.final
    base = fit(problem, (), found.base.x, found.used)
    before = by_group(heldout_losses(problem, base, data.used, data.folds), data.groups).sum()
    after = by_group(heldout_losses(problem, final, data.used, data.folds), data.groups).sum()
    columns = sensitivities(problem, final, data.used)
    flexible = curve_gains(problem, columns, data.groups, data.folds, data.seed).flexible
    best = max([0.0, *flexible.values()])
    floor = min(after * (1.0 - best) ** 2, before)
    rest, was = _level(found, final.residual), _level(found, base.residual)
    above = 1.0 - max(rest**2 - 1.0, 0.0) / max(was**2 - 1.0, 1e-30)
    explained = float((before - after) / max(before - floor, 1e-30))
    return _Weighed(explained, above, was, rest, _stretched(found)), flexible


def _took(weighed: _Weighed) -> str:
    share = 100.0 * weighed.explained
    return f"the named take away {share:.0f} % of the squared mismatch that can be explained"


def _refusal(weighed: _Weighed) -> tuple[str, str] | None:
    """Why the effects may not be named: another verdict and its reason; None when they may."""
    rest, was = weighed.rest, weighed.was
    if weighed.explained < LEAST_EXPLAINED:
        return (
            "unexplained",
            f"{_took(weighed)}, a free curve takes away more: what is missing is not in the library",
        )
    if rest >= (1.0 - LEAST_HELD_OUT) * was:
        if was <= AT_THE_NOISE:
            return "no_gap", f"the mismatch is {was:.2g} × its noise"
        return "unexplained", "what gains on the runs in use gains nothing on the others"
    if rest > AT_THE_NOISE and weighed.above < LEAST_OF_ALL:
        share = f"the best of the library takes away {100.0 * weighed.above:.0f} % of what is above the noise"
        return "unexplained", f"{share}, {rest:.2g} × the noise is left"
    if rest > FAR_OFF and weighed.stretched > MOST_STRETCHED:
        left = f"{_took(weighed)}, but {rest:.2g} × the noise is left and most uncertain parameters ran to"
        return "unexplained", f"{left} the ends of their boxes: it stands in for something else"
    return None


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
