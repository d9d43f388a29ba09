"""Biases that show while the machine rests."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from omnimj.gap.check_columns import filled
from omnimj.gap.check_records import Suspicion
from omnimj.recording.dataset import Run

_REST = 0.05  # [s] that a rest lasts at least
_STILL = 0.02  # of the largest speed
_RUN_BIAS = 0.02  # [m/s²] of a healthy accelerometer, drawn anew in every run
_ACCELERATION_BIAS = 0.05  # [m/s²]
_CURRENT_BIAS = 0.015  # [A]
SLOPE = 1.9
"""Strength at most of a bias that a slope would give as well: it is never sure."""


def resting(run: Run, speeds: Sequence[str]) -> NDArray[np.bool_]:
    """Where every speed is next to nothing for a while, shape (n,)."""
    still = np.ones(len(run.time), bool)
    for name in speeds:
        size = np.abs(filled(run, name))
        still &= size < _STILL * max(float(size.max()), 1e-9)
    least = max(3, round(_REST / max(float(np.median(np.diff(run.time))), 1e-6)))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        # the machine comes to rest and leaves it at the ends
        still[first : first + (least // 4 if first > 0 else 0)] = False
        still[last - (least // 4 if last < len(still) else 0) : last] = False
        if last - first < least:
            still[first:last] = False
    return still


def acceleration_bias(runs: Sequence[Run], name: str, speeds: Sequence[str]) -> Iterator[Suspicion]:
    """An accelerometer that reads something at rest, in all runs alike."""
    means = [float(filled(run, name)[still].mean()) for run in runs if (still := resting(run, speeds)).any()]
    if not means:
        return
    bias = float(np.mean(means))
    spread = float(np.std(means)) / np.sqrt(len(means))
    allowed = max(_ACCELERATION_BIAS, 5.0 * _RUN_BIAS / np.sqrt(len(means)), 5.0 * spread)
    if abs(bias) > allowed:
        words = f"{name} reads {bias:+.3f} m/s² at rest; a floor that is not level explains it as well"
        yield Suspicion(name, "bias", bias, min(abs(bias) / allowed, SLOPE), words)


def current_bias(runs: Sequence[Run], name: str, target: str, speeds: Sequence[str]) -> Iterator[Suspicion]:
    """A current that differs from its set value at rest, while that is held."""
    off = []
    for run in runs:
        if not {name, target} <= set(run.columns):
            continue
        asked = np.asarray(run.columns[target], float)
        steady = np.concatenate([np.zeros(20, bool), np.abs(asked[20:] - asked[:-20]) < 1e-3])
        still = resting(run, speeds) & steady
        if still.sum() >= 20:
            off.append(float(np.mean(filled(run, name)[still] - asked[still])))
    if not off:
        return
    bias, spread = float(np.mean(off)), float(np.std(off)) / np.sqrt(len(off))
    allowed = max(_CURRENT_BIAS, 4.0 * spread)
    if abs(bias) > allowed:
        words = f"{name} is off by {bias:+.3f} A against its set value at rest"
        yield Suspicion(name, "bias", bias, abs(bias) / allowed, words)
