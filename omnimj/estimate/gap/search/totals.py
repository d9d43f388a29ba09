"""Effects of the same quantity as a base parameter, stated as the whole deviation from the model file.

Joint damping b that the file states as b₀ ± w and an effect that adds c to it act as b + c alone: the data
determine the sum, the prior of b splits it. What a user needs is c + (b − b₀), with b at b₀.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnimj.estimate.gap.search.candidates import parameter_slice
from omnimj.estimate.replay.interface import CandidateEffect
from omnimj.estimate.replay.problem import Fit, ModelEffects, Problem


def with_totals(problem: Problem, fitted: Fit) -> Fit:
    """The same model with every shared quantity of the base at its nominal value.

    A factor s of an effect becomes s b/b₀, an amount c becomes c + b − b₀, −b₀ at least where nothing of the
    quantity is left. Nothing changes where that lies outside the bounds of the effect.
    """
    x, jacobian = fitted.x.copy(), fitted.jacobian.copy()
    for candidate, k in _shared(problem, fitted.effects):
        at = parameter_slice(problem, fitted, candidate).start
        own, base = candidate.parameters[0], problem.replay.base[k]
        factor = x[k] / base.nominal if own.null_value == 1.0 else 1.0
        total = x[at] * factor if own.null_value == 1.0 else x[at] + x[k] - base.nominal
        if own.low == -base.nominal:
            total = max(total, own.low)
        if own.low <= total <= own.high:
            x[at], x[k] = total, base.nominal
            jacobian[:, at] /= factor
    return replace(fitted, x=x, jacobian=jacobian)


def is_held(problem: Problem, fitted: Fit) -> NDArray[np.bool_]:
    """True for base parameters at their nominal value for which an effect stands, shape (parameters,)."""
    held = np.zeros(len(fitted.x), bool)
    for _, k in _shared(problem, fitted.effects):
        held[k] = fitted.x[k] == problem.replay.base[k].nominal
    return held


def _shared(problem: Problem, effects: ModelEffects) -> list[tuple[CandidateEffect, int]]:
    """Effects with the index of the base parameter that is the same quantity."""
    place = {base.name: k for k, base in enumerate(problem.replay.base)}
    return [(c, place[c.quantity]) for c in effects if c.quantity in place]
