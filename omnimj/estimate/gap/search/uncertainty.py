"""Intervals of a finding: scatter between conditions, the prior of the base, and the choice of the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnimj.estimate.gap.search.candidates import parameter_slice
from omnimj.estimate.gap.search.screening import screen_candidates
from omnimj.estimate.gap.search.sensitivities import Sensitivities
from omnimj.estimate.gap.search.totals import is_held
from omnimj.estimate.intervals import effective_samples, jackknife_deviations
from omnimj.estimate.replay.problem import Fit, Problem
from omnimj.signals import Array


def parameter_reach(
    problem: Problem, fitted: Fit, used: NDArray[np.bool_], sensitivities: Sensitivities | None = None
) -> Array:
    """Half width of the 90 % interval of every parameter, shape (parameters,).

    t √(V + S): V is the variance by leaving out conditions, S that by the choice of the model, and t that of
    Student for as many conditions.
    """
    jacobian = problem.central_jacobian(fitted.x, fitted.effects)
    jacobian[:, is_held(problem, fitted)] = 0.0
    exact = replace(fitted, jacobian=jacobian)
    spread, factor = jackknife_deviations(problem, exact, used)
    return factor * np.hypot(spread, model_deviations(problem, exact, used, sensitivities))


def undetermined(problem: Problem, fitted: Fit, reach: Array) -> frozenset[str]:
    """Labels of effects with one amplitude that may vanish within its `parameter_reach`."""
    found = []
    for candidate in fitted.effects:
        own = parameter_slice(problem, fitted, candidate)
        distances = [
            abs(value - p.null_value) / max(half, 1e-300)
            for p, value, half in zip(candidate.parameters, fitted.x[own], reach[own], strict=True)
            if p.null_value is not None and p.high > p.low
        ]
        if len(distances) == 1 and distances[0] <= 1.0:
            found.append(candidate.label)
    return frozenset(found)


def model_deviations(
    problem: Problem, fitted: Fit, used: NDArray[np.bool_], sensitivities: Sensitivities | None = None
) -> Array:
    """Standard deviation of every parameter by effects that may be missing, shape (parameters,).

    S = Σ_k w_k δ_k², where δ_k is the change of the parameters to first order when effect k of the library
    joins the model, and w_k its Akaike weight, exp(−½ N_eff ln(1 − s_k) − m_k) over the sum with that of
    the model itself, 1; s_k is the share of the squared mismatch that it explains and m_k the number of its
    parameters. Effects too faint to be named thus count as far as the data speak for them, and friction or
    gears by another law than the library's count through the effects that stand in for them (model
    averaging, Burnham and Anderson 2002).

    Args:
      fitted: The fitted model; parameters whose column of the Jacobian is 0 stay as they are.
    """
    taken = fitted.labels
    left = [c for c in problem.replay.candidates if c.label not in taken]
    samples = effective_samples(problem.replay, fitted.residual * used[:, None])
    screened = screen_candidates(problem, fitted, left, used, sensitivities)
    if not screened:
        return np.zeros(len(fitted.x))
    free = np.array([sum(p.high > p.low for p in one.candidate.parameters) for one in screened])
    share = np.clip([one.share for one in screened], 0.0, 1.0 - 1e-12)
    score = np.append(-0.5 * samples * np.log1p(-share) - free, 0.0)
    weight = np.exp(score - score.max())
    changes = np.array([one.start[: len(fitted.x)] - fitted.x for one in screened])
    return np.sqrt(weight[:-1] @ changes**2 / weight.sum())
