"""Cost landscape around the result: grids over two gains at a time, driven at every point."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.signals import Array
from omnimj.studies.tuning.cost import Score
from omnimj.studies.tuning.search import Candidate, GainAxis

REACH = 1.5
"""Factor by which a grid extends above and below the result."""
_PAIRS = 2


@dataclass(frozen=True)
class Landscape:
    """Scores on a grid over two gains."""

    across: GainAxis
    up: GainAxis
    x: tuple[float, ...]
    """Values of the gain `across`."""
    y: tuple[float, ...]
    """Values of the gain `up`."""
    scores: tuple[tuple[Score, ...], ...]
    """Scores, one row per value of `up`."""
    found: tuple[float, float]
    """Values of both gains in the result."""


def survey_landscape(
    axes: Sequence[GainAxis],
    values: Candidate,
    tried: Sequence,
    points: int,
    scores_of: Callable[[Sequence[Candidate]], list[Score]],
) -> tuple[Landscape, ...]:
    """Survey the cost around the result over the pairs of the most important gains."""
    slices = [
        (a, b, _around(axes[a], values[a], points), _around(axes[b], values[b], points))
        for a, b in most_important_pairs(importance(axes, tried))
    ]
    grids = [[tuple(_replaced(values, a, x, b, y) for x in xs) for y in ys] for a, b, xs, ys in slices]
    flat = [one for grid in grids for row in grid for one in row]
    scores = dict(zip(flat, scores_of(flat), strict=True)) if flat else {}
    return tuple(
        Landscape(
            axes[a],
            axes[b],
            xs,
            ys,
            tuple(tuple(scores[one] for one in row) for row in grid),
            (values[a], values[b]),
        )
        for (a, b, xs, ys), grid in zip(slices, grids, strict=True)
    )


def importance(axes: Sequence[GainAxis], tried: Sequence) -> Array:
    """Return |Spearman's ρ| of each gain with the fitness over all candidates, shape (axes,)."""
    if len(tried) < 3:
        return np.zeros(len(axes))
    ranks = _ranks(np.array([one.score.fitness for one in tried]))
    places = np.array([[axis.place(v) for axis, v in zip(axes, one.values, strict=True)] for one in tried])
    found = np.zeros(len(axes))
    for k, column in enumerate(places.T):
        own = _ranks(column)
        if own.std() > 0.0 and ranks.std() > 0.0:
            found[k] = abs(float(np.corrcoef(own, ranks)[0, 1]))
    return found


def most_important_pairs(weights: Array) -> list[tuple[int, int]]:
    """Return the pairs of the most important gains.

    Args:
      weights: Importance, shape (axes,).

    Returns:
      The first with the second and the third with the fourth; of three gains, the first with both others.
    """
    order = [int(k) for k in np.argsort(-weights, kind="stable")]
    if len(order) == 3:
        return [(order[0], order[1]), (order[0], order[2])]
    return [(order[k], order[k + 1]) for k in range(0, min(2 * _PAIRS, len(order)) - 1, 2)]


def _ranks(values: Array) -> Array:
    return np.argsort(np.argsort(values, kind="stable"), kind="stable").astype(float)


def _around(axis: GainAxis, value: float, points: int) -> tuple[float, ...]:
    low, high = max(value / REACH, axis.low), min(value * REACH, axis.high)
    return tuple(float(f"{v:.5g}") for v in np.geomspace(low, high, points))


def _replaced(values: Candidate, a: int, x: float, b: int, y: float) -> Candidate:
    found = list(values)
    found[a], found[b] = x, y
    return tuple(found)
