"""Errors of free windows beside those of the model: of the start where a motion is unstable, of the step.

A window starts from a measured state. Along a stable motion its error grows no faster than that of a free
body, σ(t)² = σ_q² + (σ_v t)²; a pendulum near the top, or links that swing freely, make more of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnimj.estimate.replay.mjcf.along import Dynamics, Motion
from omnimj.estimate.replay.mjcf.kernels import no_curve
from omnimj.estimate.replay.mjcf.laws import Laws
from omnimj.estimate.replay.mjcf.log import MachineLog
from omnimj.signals import Array

_GROWN = 3.0  # error of a start over that of a free body, from which a window tells nothing more
_FIRST = 3  # blocks of a window that always count
_FINER = 4  # steps that tell an unstable machine from steps that are too long
_FINE = 0.5  # error of the step over the known error of a channel
_MOST_SUBSTEPS = 16


@dataclass(frozen=True)
class NominalWindows:
    """Free windows of the declared machine."""

    dynamics: Dynamics
    laws: Laws
    motion: Motion
    commands: Array
    """Effective inputs, shape (n, j)."""
    chosen: NDArray[np.int64]
    """Windows to simulate, shape (w, WINDOW)."""

    def positions(self, motion: Motion, substeps: int) -> Array:
        """Mean positions in the windows, NaN elsewhere, shape (blocks, j)."""
        numbers = self.laws, motion, no_curve(), self.commands, self.chosen
        return self.dynamics.windows(*numbers, substeps)[:, : len(self.laws.joints)]


def predictable_blocks(nominal: NominalWindows, log: MachineLog) -> NDArray[np.bool_]:
    """Mask of the blocks in which the error of the start has not outgrown that of a free body, (blocks, j).

    σ_j(t)² = Σ_i (∂q_j/∂q_i σ_q,i)² + (∂q_j/∂v_i σ_v,i)², by one simulation per joint and kind of error.
    """
    found = _predictable(nominal, log, nominal.dynamics.substeps)
    return found if found.all() else _predictable(nominal, log, _FINER * nominal.dynamics.substeps)


def _predictable(nominal: NominalWindows, log: MachineLog, substeps: int) -> NDArray[np.bool_]:
    motion = nominal.motion
    before = nominal.positions(motion, substeps)
    variance = np.zeros(before.shape)
    for i, (place, rate) in enumerate(zip(log.position_noise, log.speed_noise, strict=True)):
        one = np.arange(before.shape[1]) == i
        for changed in (
            replace(motion, position=motion.position + place * one),
            replace(motion, speed=motion.speed + rate * one),
        ):
            variance += (nominal.positions(changed, substeps) - before) ** 2
    found = np.ones(before.shape, bool)
    for first, last, at in nominal.chosen:
        blocks = slice(int(at), int(at) + int(last - first) // log.size)
        after = (np.arange(blocks.stop - blocks.start) + 0.5)[:, None] * log.size * log.period
        free = log.position_noise**2 + (log.speed_noise * after) ** 2
        found[blocks] = np.logical_and.accumulate(variance[blocks] <= _GROWN**2 * free, axis=0)
        found[blocks][:_FIRST] = True
    return found


def sufficient_substeps(nominal: NominalWindows, used: NDArray[np.bool_], error: Array) -> int:
    """Fewest steps per row, by doubling, whose own error is small against the known errors of the windows.

    Args:
      used: Blocks that are compared, shape (blocks, j).
      error: Known error of the mean positions, shape (j,).
    """
    substeps = nominal.dynamics.substeps
    rough = nominal.positions(nominal.motion, substeps)
    compared = used & np.isfinite(rough)
    while substeps < _MOST_SUBSTEPS:
        fine = nominal.positions(nominal.motion, 2 * substeps)
        squares = np.where(compared, (fine - rough) ** 2, 0.0).sum(axis=0)
        if np.all(squares <= (_FINE * error) ** 2 * compared.sum(axis=0)):
            break
        substeps, rough = 2 * substeps, fine
    return substeps
