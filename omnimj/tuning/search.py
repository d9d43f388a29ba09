"""CMA-ES by Hansen's own library `cma`: asks for candidates, is told what they cost.

All that is random comes from one seed, so that the same costs lead to the same candidates: a search that was
broken off is taken up by asking and telling again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from omnimj.tuning.space import Axis

STEP = 0.3
"""First standard deviation of ln(gain): a third up or down."""

Candidate = tuple[float, ...]
"""A value per axis."""


def generation_size(axes: int) -> int:
    """λ = 4 + ⌊3 ln n⌋, Hansen 2016; at least 6, so that there are enough to choose from."""
    return max(6, 4 + math.floor(3.0 * math.log(axes)))


class Search:
    """The search over the axes.

    Args:
      axes: At least one.
      seed: Of everything random in it.
    """

    def __init__(self, axes: Sequence[Axis], seed: int):
        import cma  # takes a while to load

        self._axes = tuple(axes)
        # one dimension more of no effect: CMA-ES is not made for a single one
        self._hidden = int(len(axes) == 1)
        random = np.random.default_rng(np.random.SeedSequence(seed))
        low = [axis.place(axis.low) for axis in axes] + [-1.0] * self._hidden
        high = [axis.place(axis.high) for axis in axes] + [1.0] * self._hidden
        self._strategy = cma.CMAEvolutionStrategy(
            np.zeros(len(axes) + self._hidden),
            STEP,
            {
                "bounds": [low, high],
                "popsize": generation_size(len(axes)),
                "randn": lambda *shape: random.standard_normal(shape),
                "seed": math.nan,
                "verbose": -9,
            },
        )
        self._asked: list[np.ndarray] = []

    def ask(self) -> list[Candidate]:
        """The next generation."""
        self._asked = self._strategy.ask()
        return [self._values(x) for x in self._asked]

    def tell(self, costs: Sequence[float]) -> None:
        """What the candidates that were asked for last cost, in that order."""
        self._strategy.tell(self._asked, list(costs))

    @property
    def middle(self) -> Candidate:
        """Where the search stands: the mean of its distribution."""
        return self._values(np.asarray(self._strategy.result.xfavorite))

    @property
    def is_over(self) -> bool:
        """Whether it has nothing left to find."""
        return bool(self._strategy.stop())

    def _values(self, x: np.ndarray) -> Candidate:
        return tuple(axis.value(float(place)) for axis, place in zip(self._axes, x, strict=False))
