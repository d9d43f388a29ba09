"""Channels and regimes in which twin and measurement disagree, in words and numbers.

The mismatch counts squared, in units of noise, minus the noise's own part. Regimes of one channel do not
overlap: each is sought in the blocks that the earlier ones leave.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.estimate.gap.locate.rules import (
    BlockMask,
    Rule,
    SignAsymmetry,
    Variable,
    bin_shares,
    leading_rules,
    sign_asymmetry,
    turn_harmonic,
)
from omnimj.estimate.gap.locate.variables import (
    describe_rule,
    regime_variables,
    rule_bounds,
    run_variable,
    sign_ratio,
)
from omnimj.estimate.gap.records import MismatchRegime
from omnimj.estimate.intervals import finite_rms
from omnimj.estimate.replay.interface import Channel, Segment
from omnimj.signals import Array

EVERYWHERE = "all of it, everywhere alike"
"""Description of a clear mismatch that no regime holds."""
WEAK = "all of it, no regime stands out"
"""Description of a mismatch that is too small to be located."""
QUIET = "no more than the noise"
"""Description of a channel whose mismatch is explained by its noise."""

_QUIET = 1.3  # mean squared mismatch in units of noise at noise level
_CLEAR = 4.0  # mean squared mismatch in units of noise above which it is clear
_REGIMES = 3  # largest number of regimes of one channel
_LEAST_SHARE = 0.15  # smallest share of a channel's mismatch in a regime after the first
_DENSER = 1.3  # smallest mean squared mismatch of a regime relative to its channel
_KEPT = 0.6  # smallest share of a regime's mismatch that remains after restriction by a second variable
_ALONE = 0.15  # largest share of runs that are listed by name
_ALONE_SHARE = 0.7  # smallest share of the mismatch in these runs
_ALONE_DENSITY = 2.0  # smallest mismatch of each of these runs relative to the mean
_OTHER_SIGN = 1.25  # mismatch relative to the other sign, above which a direction is reported
_BARELY = 1.05  # mismatch relative to the other sign, below which a significant difference is small
_SIDEWAYS = 0.95  # smallest share of blocks in sideways motion
_CREEP = 0.02  # [m/s] lateral speed that does not count as sideways motion
_RISES = 0.7  # correlation of mismatch with time above which it grows
_MATCHED = frozenset({"load", "floor", "current"})  # segments of both signs must agree in these


@dataclass(frozen=True)
class _Regime:
    rules: tuple[Rule, ...]
    inside: BlockMask
    words: str = ""


@dataclass(frozen=True)
class _Scene:
    """Data common to all channels."""

    variables: tuple[Variable, ...]
    runs: Variable
    slices: tuple[slice, ...]
    sideways: Variable | None
    """Signed lateral speed, where both signs were driven."""
    is_all_sideways: bool


def locate(
    channels: Sequence[Channel],
    segments: Sequence[Segment],
    regimes: Mapping[str, tuple[str, Array]],
    before: Array,
    after: Array | None,
    noise: Array,
) -> tuple[MismatchRegime, ...]:
    """Find the regimes in which the mismatch concentrates.

    Args:
      channels: Meaning of the columns.
      segments: Stretches of runs; blocks of one are neighbours in time.
      regimes: Variable → unit and values, shape (blocks,); text for variables without an order; NaN where a
        variable has no value (no reversal yet).
      before: Measured − simulated, shape (blocks, channels), NaN where masked.
      after: The same with the named effects, or None.
      noise: Standard deviation of a block mean, shape (channels,).

    Returns:
      Largest share first; at least one regime per channel. Shares do not overlap and add up to at most 1.
    """
    scene = _scene(segments, regimes, len(before))
    relative = before / noise
    covered = np.zeros(len(before), bool)
    for part in scene.slices:
        covered[part] = True
    valid = np.isfinite(relative) & covered[:, None]
    energy = np.where(valid, relative, 0.0) ** 2
    found = []
    for c in range(len(channels)):
        e, used = energy[:, c], valid[:, c]
        signed = np.where(used, relative[:, c], 0.0)
        found.append(_regimes_of(scene, e, signed, used) if used.any() else [])
    own = np.array(
        [
            0.0 if _is_quiet(r) else max(0.0, float((energy[:, c] - valid[:, c]).sum()))
            for c, r in enumerate(found)
        ]
    )
    total = max(float(own.sum()), 1e-300)
    places: list[MismatchRegime] = []
    for c, channel in enumerate(channels):
        if not found[c]:
            places.append(MismatchRegime(channel.name, "nothing measured", {}, 0.0, 0.0, None))
            continue
        left = None if after is None else after[:, c]
        e, used, part = energy[:, c], valid[:, c], float(own[c]) / total
        places += _places(scene, channel, found[c], e, used, part, before[:, c], left)
    return tuple(sorted(places, key=lambda p: -p.share))


def _scene(segments: Sequence[Segment], regimes: Mapping[str, tuple[str, Array]], blocks: int) -> _Scene:
    variables = regime_variables(regimes)
    lateral = [v for v in variables if v.name == "lateral_speed"]
    has_both = any(v.is_size for v in lateral)
    moves = False
    if lateral:
        size = np.abs(lateral[-1].values)
        size = size[np.isfinite(size)]
        moves = size.size > 0 and bool(np.mean(size > max(0.05 * float(size.max()), _CREEP)) >= _SIDEWAYS)
    slices = tuple(slice(p.first, p.last) for p in sorted(segments, key=lambda p: p.first))
    return _Scene(variables, run_variable(segments, blocks), slices, lateral[-1] if has_both else None, moves)


def _is_quiet(regimes: Sequence[_Regime]) -> bool:
    return len(regimes) == 1 and regimes[0].words == QUIET


def _regimes_of(scene: _Scene, energy: Array, signed: Array, used: BlockMask) -> list[_Regime]:
    """Find the regimes of one channel; a single one over all blocks if none stands out."""
    around = _once_per_turn(scene, signed, used)
    if around is not None:
        return [around]
    found: list[_Regime] = []
    rest, excess = used.copy(), float((energy - 1.0)[used].sum())
    while len(found) < _REGIMES:
        named = frozenset(rule.variable.name for regime in found for rule in regime.rules)
        regime = _next(scene, energy, rest, named)
        if regime is None:
            break
        held = float((energy - 1.0)[regime.inside].sum())
        denser = float(energy[regime.inside].mean()) > _DENSER * float(energy[used].mean())
        if excess <= 0.0 or held < _LEAST_SHARE * excess or not denser:
            break
        found.append(regime)
        rest = rest & ~regime.inside
    if found:
        return found
    if float(energy[used].mean()) < _QUIET:
        return [_Regime((), used, QUIET)]
    alone = _few_runs(scene, energy, used)
    weak = WEAK if float(energy[used].mean()) < _CLEAR else ""
    return [alone or _Regime((), used, weak)]


def _next(scene: _Scene, energy: Array, among: BlockMask, named: frozenset[str]) -> _Regime | None:
    """Most prominent regime over variables that no earlier regime uses."""
    variables = [v for v in scene.variables if v.name not in named]
    leading = leading_rules(energy, variables, among, scene.slices)
    if not leading:
        return None
    first = leading[0]
    inside = among & first.inside
    others = [v for v in variables if v.name != first.variable.name]
    for second in leading_rules(energy, others, inside, scene.slices):
        both = inside & second.inside
        if (energy - 1.0)[both].sum() >= _KEPT * (energy - 1.0)[inside].sum():
            return _Regime((first, second), both)
    return _Regime((first,), inside)


def _few_runs(scene: _Scene, energy: Array, used: BlockMask) -> _Regime | None:
    """Regime of the few runs that hold nearly all of the mismatch; None if there is none."""
    held, taken = bin_shares(energy, scene.runs, used)
    members = tuple(int(k) for k in np.flatnonzero(held > _ALONE_DENSITY * taken))
    few = max(1, int(_ALONE * scene.runs.bins))
    if scene.runs.bins < 4 or not 0 < len(members) <= few or held[list(members)].sum() < _ALONE_SHARE:
        return None
    rule = Rule(scene.runs, members, float((held - taken)[list(members)].sum()))
    return _Regime((rule,), used & rule.inside)


def _once_per_turn(scene: _Scene, signed: Array, used: BlockMask) -> _Regime | None:
    for v in scene.variables:
        if v.is_angle:
            found = turn_harmonic(v.values, signed, used, scene.slices)
            if found is not None:
                per, share = found
                often = {1: "once", 2: "twice"}.get(per, f"{per} times")
                words = f"{often} per turn, {100.0 * share:.0f} % of it follows the {v.words}"
                return _Regime((), used, words)
    return None


def _places(
    scene: _Scene,
    channel: Channel,
    regimes: Sequence[_Regime],
    energy: Array,
    used: BlockMask,
    part: float,
    before: Array,
    after: Array | None,
) -> list[MismatchRegime]:
    """Describe the regimes of one channel, which holds the share `part` of the whole mismatch."""
    own = float((energy - 1.0)[used].sum())
    found = []
    for k, regime in enumerate(regimes):
        inside = regime.inside
        held = float((energy - 1.0)[inside].sum()) / own if own > 0.0 and part > 0.0 else 0.0
        held = min(max(held, 0.0), 1.0)
        words = regime.words or _words(scene, regime, energy, used)
        if k > 0:
            words = f"elsewhere, {words}"
        if regime.rules:
            taken = inside.sum() / used.sum()
            words += f"; {100 * held:.0f} % of this channel's mismatch in {100 * taken:.0f} % of its samples"
        bounds = {name: ends for rule in regime.rules for name, ends in rule_bounds(rule).items()}
        was = finite_rms(before[inside], without=0.0)
        left = None if after is None else finite_rms(after[inside], without=0.0)
        found.append(MismatchRegime(channel.name, words, bounds, held * part, was, left))
    return found


def _words(scene: _Scene, regime: _Regime, energy: Array, used: BlockMask) -> str:
    texts, rules = [], list(regime.rules)
    for rule in [r for r in rules if r.variable.name == "lateral_speed"]:
        rules.remove(rule)
        texts.append(_sideways_rule(scene, rule, energy, used))
    if not texts and scene.is_all_sideways:
        texts.append(_all_sideways(scene, energy, used))
    for rule in rules:
        words = describe_rule(rule)
        v = rule.variable
        if not (v.is_size or v.labels or v.is_angle):
            ratio = sign_ratio(rule, energy, used, v.values)
            if ratio >= _OTHER_SIGN:
                words = f"one direction, {words} ({_times(ratio)} the mismatch in the other)"
        if v.name == "time" and rule.members[-1] == v.bins - 1:
            words = f"{'grows with' if _grows(v, energy, used) else 'late,'} {words}"
        texts.append(words)
    return ", ".join(texts) or EVERYWHERE


def _grows(variable: Variable, energy: Array, used: BlockMask) -> bool:
    """Test whether the mean squared mismatch rises from bin to bin."""
    held, taken = bin_shares(energy, variable, used)
    density = held[taken > 0.0] / taken[taken > 0.0]
    return density.size > 2 and float(np.corrcoef(np.arange(density.size), density)[0, 1]) > _RISES


def _sideways_rule(scene: _Scene, rule: Rule, energy: Array, used: BlockMask) -> str:
    if scene.sideways is None:
        return f"sideways motion: {describe_rule(rule)}"
    if not rule.variable.is_size:
        ratio = sign_ratio(rule, energy, used, rule.variable.values)
        other = f" ({_times(ratio)} the mismatch at the other sign)" if ratio > 1.0 else ""
        return f"sideways motion, more in one sign: {describe_rule(rule)}{other}"
    signs = _signs(scene, energy, used & rule.inside)
    if signs is None or not signs.is_sure:
        return f"sideways motion, alike in both signs: {describe_rule(rule)}"
    where = f"{_times(signs.ratio)} the mismatch of the other sign where it is {signs.sign}"
    return f"sideways motion, more in one sign: {describe_rule(rule)} ({where})"


def _all_sideways(scene: _Scene, energy: Array, inside: BlockMask) -> str:
    signs = _signs(scene, energy, inside)
    if signs is None:
        return "sideways motion, as in every run"
    if not signs.is_sure:
        return "sideways motion, as in every run, alike in both signs"
    where = f"{_times(signs.ratio)} the mismatch of the other sign where lateral speed is {signs.sign}"
    barely = "barely " if signs.ratio < _BARELY else ""
    return f"sideways motion, {barely}more in one sign ({where}; every run moves sideways)"


def _signs(scene: _Scene, energy: Array, among: BlockMask) -> SignAsymmetry | None:
    if scene.sideways is None:
        return None
    others = [v for v in scene.variables if v.name in _MATCHED]
    return sign_asymmetry(scene.sideways, others, energy, among, scene.slices)


def _times(ratio: float) -> str:
    return "over 100 ×" if ratio > 100.0 else f"{ratio:.3g} ×"
