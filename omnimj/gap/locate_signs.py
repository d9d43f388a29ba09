"""Signs and turns: is a mismatch larger at one sign of a motion, does it come once per turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.gap.locate_rules import Blocks, Variable
from omnimj.signals import Array

_PAIRS = 4  # at least, before a sign is said to matter
_SURE = 3.0  # standard errors
_HARMONICS = 4
_SHUFFLES = 99
_LEAST_TURNING = 0.3  # share of the mismatch that must follow the angle


@dataclass(frozen=True)
class Asymmetry:
    """Mismatch at one sign of a variable against the other, from pieces that are else alike."""

    sign: str
    """`negative` or `positive`: where it is larger."""
    ratio: float
    """RMS mismatch there over that at the other sign."""
    is_sure: bool
    """Whether it lies beyond three standard errors over the pairs."""


def asymmetry(
    signed: Variable, others: Sequence[Variable], energy: Array, among: Blocks, pieces: Sequence[slice]
) -> Asymmetry | None:
    """Pairs every piece of one sign with the one of the other sign that is most like it.

    Like: in the size of the signed variable and in the other variables' means over the piece.

    Returns:
      None where a sign is missing.
    """
    rows, strength, sign = [], [], []
    for piece in pieces:
        used = among[piece] & np.isfinite(signed.values[piece])
        if not used.any():
            continue
        value = float(np.median(signed.values[piece][used]))
        if abs(value) <= 0.02 * float(np.nanmax(np.abs(signed.values))):
            continue
        rows.append([abs(value), *(_mean(v.values[piece][used]) for v in others)])
        strength.append(np.log(max(float(energy[piece][used].mean()), 1e-12)))
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
    return Asymmetry("positive" if middle > 0.0 else "negative", float(np.exp(0.5 * abs(middle))), bool(sure))


def _mean(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else 0.0


def turns(angle: Array, signed: Array, among: Blocks, pieces: Sequence[slice]) -> tuple[int, float] | None:
    """How often per turn a mismatch comes, and the share of it that follows the angle.

    The mismatch is fitted with cos kθ and sin kθ, k = 1 … 4, each piece's mean out; the share must beat those
    of mismatches turned round in time.

    Returns:
      None where it does not.
    """
    groups = [np.flatnonzero((among & np.isfinite(angle))[p]) + p.start for p in pieces]
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
