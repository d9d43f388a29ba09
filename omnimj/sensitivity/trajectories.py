"""Trajectories through the ranges of all parameters, one parameter at a time (Morris 1991)."""

from __future__ import annotations

import numpy as np

from omnimj.signals import Array

LEVELS = 4
"""p: places of a range that are visited, 0, 1/3, 2/3 and 1."""
_JUMP = LEVELS // 2
STEP = _JUMP / (LEVELS - 1)
"""Δ = p/(2(p − 1)): with it every place of a range is visited equally often."""


def trajectory(seed: int, index: int, parameters: int) -> Array:
    """Trajectory number `index`: k + 1 points, from each to the next one parameter moves by ±Δ.

    Which one, which way and from where is drawn; each parameter moves once.

    Args:
      seed: Of the study.
      index: From 0; a trajectory does not depend on how many there are.
      parameters: k.

    Returns:
      Places in the ranges, shape (k + 1, k).
    """
    random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
    rising = random.random(parameters) < 0.5
    levels = random.integers(0, LEVELS - _JUMP, parameters) + np.where(rising, 0, _JUMP)
    points = np.tile(levels, (parameters + 1, 1))
    for k, moved in enumerate(random.permutation(parameters), start=1):
        points[k:, moved] += _JUMP if rising[moved] else -_JUMP
    return points / (LEVELS - 1)
