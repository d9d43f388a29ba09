"""Whether the strength of an effect is the same everywhere, as its law claims, to first order.

An effect of amplitudes a changes the prediction by c = Σ_k (a_k − null_k) ∂/∂a_k. Where the machine follows
another law, a strength 1 + s(v) that varies over some variable v of the runs (speed, load, floor …) explains
more. s has `_KNOTS` values, each with the prior variance 1.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from omnimj.estimate.gap.search.candidates import parameter_slice
from omnimj.estimate.gap.search.cross_validation import TrainingSplit
from omnimj.estimate.gap.search.screening import group_sums, heldout_squares, weighted_columns
from omnimj.estimate.replay.problem import Fit, Problem
from omnimj.signals import Array

_KNOTS = 5
_RANGE = (0.02, 0.98)  # quantiles of a variable at the first and the last knot


def strength_gains(problem: Problem, model: Fit, split: TrainingSplit) -> dict[tuple[str, str], float]:
    """Held-out gains 1 − √(after/before) of strengths that vary freely over one variable each.

    Returns:
      (label of the effect, variable) → gain; variables that do not vary are left out.
    """
    channels, n = len(problem.replay.channels), len(model.x)
    outs = [np.unique(split.groups.of_block[out]) for out in split.folds]
    curves = {name: np.repeat(curve, channels, axis=0) for name, curve in _curves_over_variables(problem)}
    gains = {}
    for label, change in _changes_by_effects(problem, model):
        for name, curve in curves.items():
            columns, prior = weighted_columns(problem, model, change[:, None] * curve, split.used)
            sums = group_sums(columns, split.groups, channels)
            plain = np.r_[:n, sums.shape[1] - 1]
            before = heldout_squares(sums[:, plain[:, None], plain], prior, outs).sum()
            after = heldout_squares(sums, np.append(prior, np.ones(_KNOTS)), outs).sum()
            gains[label, name] = float(1.0 - np.sqrt(after / before))
    return gains


def _changes_by_effects(problem: Problem, model: Fit) -> Iterator[tuple[str, Array]]:
    """Label of every effect with free amplitudes, and the change c of the mismatch, shape (rows,)."""
    scales = problem.scales(model.effects)
    for candidate in model.effects:
        first = parameter_slice(problem, model, candidate).start
        shapes = enumerate(candidate.parameters, first)
        free = [(k, p.null_value) for k, p in shapes if p.null_value is not None and p.high > p.low]
        if free:
            yield candidate.label, _change(model, scales, free)


def _change(model: Fit, scales: Array, free: list[tuple[int, float]]) -> Array:
    places, nulls = (np.array(part) for part in zip(*free, strict=True))
    return model.jacobian[:, places] @ ((model.x[places] - nulls) / scales[places])


def _curves_over_variables(problem: Problem) -> Iterator[tuple[str, Array]]:
    """Every variable that varies, with the values of its hat functions, shape (blocks, knots)."""
    for name, (_, values) in problem.replay.regimes().items():
        values = np.asarray(values)
        if values.dtype.kind not in "fiub":
            continue
        known = values[np.isfinite(values.astype(float))]
        low, high = np.quantile(known, _RANGE) if known.size else (0.0, 0.0)
        if high <= low:
            continue
        place = np.clip((values - low) / (high - low), 0.0, 1.0) * (_KNOTS - 1)
        hats = np.maximum(1.0 - np.abs(place[:, None] - np.arange(_KNOTS)), 0.0)
        yield name, np.nan_to_num(hats)
