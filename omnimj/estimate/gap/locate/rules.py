"""Rules: ranges of one variable that hold most of a squared mismatch, tested against chance and confounding.

A rule is a range of a variable (above, below, between, an arc of a turn, some of its values) with the excess
J = (share of the mismatch it holds) − (share of the blocks it takes), 0 where the mismatch is uniform.
Variables that move together select the same blocks; a rule that another variable explains is dropped:
J(v | w) = share held by v's rule − share it would hold if the mismatch depended on w alone.

`energy` is the squared mismatch in units of noise, `among` the mask of the blocks to use, both of shape
(blocks,); `segments` are the blocks that belong together, in order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.signals import Array

BINS = 24
"""Largest number of bins of a variable."""
MIN_EXCESS = 0.12
"""Smallest J of a reported rule: 62 % of the mismatch in half of the blocks."""
_SHUFFLES = 99  # a rule must exceed all of them: 1 % by chance, for any number of variables
_TWO_SIDED = 0.08  # smallest gain in J from a second bound
_EXPLAINED = 0.35  # smallest share of J that another variable leaves unexplained
_TIE = 0.03  # difference in J up to which two rules are equally good
_TURN = 2.0 * math.pi

BlockMask = NDArray[np.bool_]
_PAIRS = 4  # fewest pairs for a significant sign
_SURE = 3.0  # standard errors of a significant sign
_HARMONICS = 4
_LEAST_TURNING = 0.3  # share of the mismatch that must follow the angle


@dataclass(frozen=True)
class Variable:
    """Regime variable with its values sorted into bins."""

    name: str
    unit: str
    words: str
    values: Array
    """Values, or codes of `labels`, shape (blocks,); NaN in blocks without a value."""
    code: NDArray[np.int64]
    """Bin of every block, shape (blocks,); −1 without a value."""
    edges: Array
    """Edges between the bins, shape (bins − 1,)."""
    labels: tuple[str, ...] = ()
    """Names of the values, for a variable without an order."""
    is_angle: bool = False
    """True for a periodic variable, whose first bin follows its last."""
    is_size: bool = False
    """True for the magnitude of a signed quantity."""
    is_condition: bool = False
    """True for a condition of the run, such as floor or load, as opposed to a state reached during it."""

    @property
    def bins(self) -> int:
        """Number of bins."""
        return len(self.labels) if self.labels else len(self.edges) + 1


@dataclass(frozen=True)
class Rule:
    """Range of one variable."""

    variable: Variable
    members: tuple[int, ...]
    """Bins of the range; those of an arc in their order along it."""
    excess: float
    """J."""

    @property
    def inside(self) -> BlockMask:
        """Mask of blocks in the range, shape (blocks,)."""
        return np.isin(self.variable.code, self.members)


def bin_edges(values: Array) -> Array:
    """Edges of bins of about equal counts, each moved into the widest gap near it.

    Args:
      values: Shape (n,), NaN left out.

    Returns:
      Increasing, shape (at most `BINS` − 1,); empty where all values are equal.
    """
    ordered = np.sort(values[np.isfinite(values)])
    if len(ordered) < 2 or ordered[-1] <= ordered[0]:
        return np.empty(0)
    gaps = np.diff(ordered)
    spread = 1e-9 * (ordered[-1] - ordered[0])
    found = []
    for k in range(1, BINS):
        middle = k * len(ordered) / BINS
        half = max(1.0, 0.5 * len(ordered) / BINS)
        low = max(0, int(middle - half) - 1)
        high = min(len(gaps), int(middle + half))
        at = low + int(np.argmax(gaps[low:high]))
        if gaps[at] > spread:
            found.append(round_between(float(ordered[at]), float(ordered[at + 1])))
    return np.unique(found)


def round_between(low: float, high: float) -> float:
    """Number in (low, high] with the fewest digits; of several, the one nearest to the middle."""
    middle, width = 0.5 * (low + high), high - low
    if low < 0.0 < high:
        return 0.0
    top = math.ceil(math.log10(max(abs(low), abs(high)))) + 1
    for digits in range(-top, 16):
        rounded = round(middle, digits)
        if low < rounded <= high and abs(rounded - middle) <= 0.45 * width:
            return rounded
    return middle


def bin_shares(energy: Array, variable: Variable, among: BlockMask) -> tuple[Array, Array]:
    """Share of the mismatch and share of the blocks in every bin, shape (bins,) each."""
    used = among & (variable.code >= 0)
    code = variable.code[used]
    held = np.bincount(code, energy[used], variable.bins)
    count = np.bincount(code, minlength=variable.bins).astype(float)
    return held / max(float(energy[among].sum()), 1e-300), count / max(int(among.sum()), 1)


def best_bins(density: Array, variable: Variable) -> tuple[tuple[int, ...], float]:
    """Bins whose summed `density` (share held − share of blocks, shape (bins,)) is largest, and that J."""
    n = len(density)
    if variable.labels:
        members = tuple(int(k) for k in np.flatnonzero(density > 0.0))
        return members, float(density[density > 0.0].sum())
    sums = np.concatenate([[0.0], np.cumsum(density)])
    if variable.is_angle:
        around = np.concatenate([sums, sums[-1] + sums[1:]])
        spans = around[None, :] - around[:n, None]
        length = np.arange(len(around))[None, :] - np.arange(n)[:, None]
        spans[(length < 1) | (length >= n)] = -np.inf
        first, last = np.unravel_index(int(np.argmax(spans)), spans.shape)
        return tuple(int(k % n) for k in range(int(first), int(last))), float(spans[first, last])
    below, above = int(np.argmax(sums[:-1])), int(np.argmin(sums[1:])) + 1
    down, up = float(sums[below]), float(sums[-1] - sums[above])
    first, last, best = (0, below, down) if down >= up else (above, n, up)
    spans = sums[None, :] - sums[:, None]
    spans[np.tril_indices(n + 1)] = -np.inf
    i, j = np.unravel_index(int(np.argmax(spans)), spans.shape)
    if float(spans[i, j]) > best + _TWO_SIDED:
        first, last, best = int(i), int(j), float(spans[i, j])
    return tuple(range(first, last)), best


def best_rule(energy: Array, variable: Variable, among: BlockMask) -> Rule:
    """Rule of one variable that holds most of the mismatch in few of the blocks."""
    held, taken = bin_shares(energy, variable, among)
    return Rule(variable, *best_bins(held - taken, variable))


def excess_given(rule: Rule, other: Variable, energy: Array, among: BlockMask) -> float:
    """J(v | w): excess of a rule over v beyond that explained by the values of another variable w."""
    used = among & (other.code >= 0)
    inside = rule.inside[used]
    code, here = other.code[used], energy[used]
    held = np.bincount(code, here, other.bins)
    count = np.bincount(code, minlength=other.bins)
    taken = np.bincount(code, inside, other.bins)
    expected = held * taken / np.maximum(count, 1)
    return float((here[inside].sum() - expected.sum()) / max(float(here.sum()), 1e-300))


def leading_rules(
    energy: Array, variables: Sequence[Variable], among: BlockMask, segments: Sequence[slice]
) -> list[Rule]:
    """Rules beyond chance that no other variable explains, best first.

    Args:
      variables: Ordered by preference where the data cannot distinguish them.
      segments: They cover all of `among`. Chance is simulated by giving each segment the mismatch of another
        one, shifted in time.
    """
    used = [v for v in variables if np.unique(v.code[among & (v.code >= 0)]).size > 1]
    if not used or float(energy[among].sum()) <= 0.0:
        return []
    rules = [best_rule(energy, v, among) for v in used]
    if max(r.excess for r in rules) < MIN_EXCESS:
        return []
    # against all variables, since chance may strike in any
    certain = _beat_chance(energy, rules, among, segments)
    rules = [r for r, sure in zip(rules, certain, strict=True) if sure and r.excess >= MIN_EXCESS]
    kept = [r for k, r in enumerate(rules) if not _explained_away(k, rules, energy, among)]
    return sorted(kept, key=lambda r: (not r.variable.is_condition, -r.excess))


def _explained_away(k: int, rules: Sequence[Rule], energy: Array, among: BlockMask) -> bool:
    own = rules[k]
    for j, other in enumerate(rules):
        if j == k:
            continue
        left = excess_given(own, other.variable, energy, among)
        if left >= max(0.5 * MIN_EXCESS, _EXPLAINED * own.excess):
            continue
        lead = excess_given(other, own.variable, energy, among) - left
        if lead > _TIE or (lead >= -_TIE and (other.excess > own.excess + _TIE or j < k)):
            return True
    return False


def _beat_chance(
    energy: Array, rules: Sequence[Rule], among: BlockMask, segments: Sequence[slice]
) -> NDArray[np.bool_]:
    """Mask of rules whose J exceeds that of all shuffled mismatches, in units of their spread."""
    at = np.flatnonzero(among)
    edges = np.searchsorted(at, [(p.start, p.stop) for p in segments])
    first = edges[edges[:, 1] > edges[:, 0], 0]
    length = (edges[:, 1] - edges[:, 0])[edges[:, 1] > edges[:, 0]]
    own = np.repeat(np.arange(len(length)), length)
    within = np.arange(len(own)) - np.repeat(first - first[0], length)
    here = energy[at]
    known = [r.variable.code[at] for r in rules]
    taken = [bin_shares(energy, r.variable, among)[1] for r in rules]
    random = np.random.default_rng(0)
    found = np.empty((_SHUFFLES, len(rules)))
    for row in found:
        giver = random.permutation(len(length))
        turned = (random.random(len(length)) * length[giver]).astype(np.int64)
        stretched = within * length[giver][own] // length[own]
        source = first[giver][own] + (stretched + turned[own]) % length[giver][own]
        shuffled = here[source]
        for k, (rule, code) in enumerate(zip(rules, known, strict=True)):
            held = np.bincount(code + 1, shuffled, rule.variable.bins + 1)[1:]
            held = held / max(float(shuffled.sum()), 1e-300)
            row[k] = best_bins(held - taken[k], rule.variable)[1]
    middle, spread = found.mean(axis=0), np.maximum(found.std(axis=0), 1e-3)
    highest = float(((found - middle) / spread).max())
    return (np.array([r.excess for r in rules]) - middle) / spread > highest


@dataclass(frozen=True)
class SignAsymmetry:
    """Mismatch at one sign of a variable against the other, from otherwise similar segments."""

    sign: str
    """Sign with the larger mismatch: `negative` or `positive`."""
    ratio: float
    """RMS mismatch at that sign over that at the other sign."""
    is_sure: bool
    """True if the difference exceeds three standard errors over the pairs."""


def sign_asymmetry(
    signed: Variable, others: Sequence[Variable], energy: Array, among: BlockMask, segments: Sequence[slice]
) -> SignAsymmetry | None:
    """Pair every segment of one sign with the most similar one of the other sign.

    Similarity is measured in the magnitude of the signed variable and in the other variables' means.

    Args:
      signed: Variable whose signs are compared.
      others: Variables in which paired segments should agree.

    Returns:
      None where a sign is missing.
    """
    rows, strength, sign = [], [], []
    for segment in segments:
        used = among[segment] & np.isfinite(signed.values[segment])
        if not used.any():
            continue
        value = float(np.median(signed.values[segment][used]))
        if abs(value) <= 0.02 * float(np.nanmax(np.abs(signed.values))):
            continue
        rows.append([abs(value), *(_mean(v.values[segment][used]) for v in others)])
        strength.append(np.log(max(float(energy[segment][used].mean()), 1e-12)))
        sign.append(np.sign(value))
    signs, logs, features = np.array(sign), np.array(strength), np.array(rows)
    up, down = np.flatnonzero(signs > 0), np.flatnonzero(signs < 0)
    if min(up.size, down.size) == 0:
        return None
    features = features / np.maximum(features.std(axis=0), 1e-9)
    apart = np.abs(features[up][:, None, :] - features[down][None, :, :]).sum(axis=2)
    change = logs[up] - logs[down[apart.argmin(axis=1)]]
    middle = float(change.mean())
    error = float(change.std(ddof=1)) / np.sqrt(change.size) if change.size > 1 else np.inf
    sure = change.size >= _PAIRS and abs(middle) > _SURE * max(error, 1e-9)
    return SignAsymmetry(
        "positive" if middle > 0.0 else "negative", float(np.exp(0.5 * abs(middle))), bool(sure)
    )


def _mean(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else 0.0


def turn_harmonic(
    angle: Array, signed: Array, among: BlockMask, segments: Sequence[slice]
) -> tuple[int, float] | None:
    """Number of times per turn that a mismatch repeats, and the share of it that follows the angle.

    The mismatch is fitted with cos kθ and sin kθ, k = 1 … 4, the mean of each segment removed; the share must
    exceed that of mismatches shifted in time.

    Args:
      angle: θ, shape (blocks,) [rad].
      signed: Mismatch in units of noise, shape (blocks,).

    Returns:
      None if the mismatch does not follow the angle.
    """
    groups = [np.flatnonzero((among & np.isfinite(angle))[p]) + p.start for p in segments]
    groups = [g for g in groups if g.size > 4 * _HARMONICS]
    if not groups:
        return None
    at = np.concatenate(groups)
    total = float((signed[at] ** 2).sum())
    if total <= 0.0:
        return None
    bases = [
        _centred(np.stack([np.cos(k * angle), np.sin(k * angle)], axis=1), groups)[at]
        for k in range(1, _HARMONICS + 1)
    ]
    bases = [np.linalg.qr(b)[0] for b in bases]

    def explained(values: Array) -> Array:
        return np.array([float(((b.T @ values[at]) ** 2).sum()) for b in bases]) / total

    own = explained(_centred(signed[:, None], groups)[:, 0])
    k = int(own.argmax())
    if own[k] < _LEAST_TURNING:
        return None
    random, moved = np.random.default_rng(0), np.zeros_like(signed)
    for _ in range(_SHUFFLES):
        for g in groups:
            moved[g] = np.roll(signed[g], random.integers(g.size))
        if explained(_centred(moved[:, None], groups)[:, 0]).max() >= 0.7 * own[k]:
            return None
    return k + 1, float(own[k])


def _centred(values: Array, groups: Sequence[NDArray[np.intp]]) -> Array:
    found = np.zeros_like(values)
    for g in groups:
        found[g] = values[g] - values[g].mean(axis=0)
    return found
