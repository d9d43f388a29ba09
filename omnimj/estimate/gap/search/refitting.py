"""Fits of the base and of a grown model, with the twin simulated and the noise estimated anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnimj.estimate.gap.search.selection import Progress
from omnimj.estimate.intervals import block_noise
from omnimj.estimate.replay.interface import Replay
from omnimj.estimate.replay.problem import Fit, ModelEffects, Problem, fit, reevaluate
from omnimj.signals import Array

_MOST_REFITS = 3
_STILL, _CONVERGED = 0.2, 0.1  # change by a new twin that ends the refits: in noise, and of the mismatch


def with_twin_correction(problem: Problem, x: Array, effects: ModelEffects) -> Problem:
    """The problem with the twin simulated at parameters x, shape (n,): offset = twin − equations there.

    Both are simulated without what turns with the wheel, since out of phase its difference would not cancel,
    and without structure outside the library, which the twin does not have.
    """
    setting, _ = problem.split(x, effects)
    locked = {c.label for c in effects if c.turns_with_wheel or c.is_outside}
    setting = replace(setting, effects={k: v for k, v in setting.effects.items() if k not in locked})
    twin = problem.replay.simulate_twin(setting)
    if twin is None:
        return problem
    (plain,) = problem.replay.simulate([setting])
    return replace(problem, offset=twin - plain)


def robust_scale(problem: Problem, fitted: Fit, used: NDArray[np.bool_]) -> Problem:
    """The problem with a Huber scale of three times the scatter in the blocks `used`, at least five times the
    noise.
    """
    middle = float(np.median(np.abs(fitted.residual[used])))
    return replace(problem, huber_scale=max(5.0, 3.0 * 1.4826 * middle))


def fit_base(replay: Replay, used: NDArray[np.bool_], report: Progress) -> tuple[Problem, Fit]:
    """Fit the base inside its boxes; estimate the noise of the data and the Huber scale.

    Three fits, since the noise is estimated from the residual of a fitted model.
    """
    channels = len(replay.channels)
    problem = Problem(replay, np.ones(channels))
    nominal = np.array([b.nominal for b in replay.base])
    report("simulating the twin", 0.0)
    problem = with_twin_correction(problem, nominal, ())
    (mismatch,) = problem.mismatches([problem.start()], ())
    problem = replace(problem, noise=block_noise(replay, mismatch))
    (residual,) = problem.residuals([problem.start()], ())
    fitted = Fit((), problem.start(), residual, np.zeros((0, 0)), 0.0)
    for k in range(2):
        report("refitting the base", k / 3)
        problem = robust_scale(problem, fitted, used)
        fitted = fit(problem, (), fitted.x, used)
        # the difference between twin and equations depends on the base
        problem = with_twin_correction(problem, fitted.x, ())
        (mismatch,) = problem.mismatches([fitted.x], ())
        problem = replace(problem, noise=block_noise(replay, mismatch))
        fitted = reevaluate(fitted, problem)
    return problem, fit(problem, (), fitted.x, used)


def refit(problem: Problem, fitted: Fit, used: NDArray[np.bool_]) -> tuple[Problem, Fit]:
    """Refit with the twin simulated at the new model and the noise estimated anew, until neither changes it.

    The noise can only shrink.
    """
    for _ in range(_MOST_REFITS):
        problem = with_twin_correction(problem, fitted.x, fitted.effects)
        (mismatch,) = problem.mismatches([fitted.x], fitted.effects)
        noise = np.minimum(problem.noise, block_noise(problem.replay, mismatch))
        problem = replace(problem, noise=noise)
        before = reevaluate(fitted, problem)
        problem = robust_scale(problem, before, used)
        moved = float(np.sqrt(((before.residual - fitted.residual)[used] ** 2).mean()))
        fitted = fit(problem, fitted.effects, fitted.x, used)
        if moved < max(_STILL, _CONVERGED * float(np.sqrt((fitted.residual[used] ** 2).mean()))):
            break
    return problem, fitted
