"""Which run would split what the data cannot: from a menu, by how far the rivals' predictions part."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from omnimj.gap.fit import Fit
from omnimj.gap.problem import Problem

_PARTED = 1.0  # RMS distance in units of noise above which one run tells two models apart


def next_experiment(problem: Problem, best: Fit, rivals: Sequence[tuple[str, Fit]]) -> dict[str, Any] | None:
    """The run of the menu in which the leader and its rivals part most.

    Every model is fitted already; each predicts every run of the menu. A run is as good as the rival that it
    splits least, then as the sum over rivals.

    Args:
      problem: Gives the menu and the noise.
      best: The leader.
      rivals: Names and fits of those it does not beat.

    Returns:
      `why`, `run`, `separates`, `parting` (name → RMS distance in units of noise); None when there is no
      rival or no menu.
    """
    menu = problem.replay.menu()
    if not rivals or not menu:
        return None
    settings = [problem.split(f.x, f.form)[0] for f in (best, *(fitted for _, fitted in rivals))]
    found = []
    for experiment in menu:
        first, *others = problem.replay.predict(settings, experiment)
        distances = [float(np.sqrt(np.nanmean(((other - first) / problem.noise) ** 2))) for other in others]
        found.append((experiment, distances))
    experiment, distances = max(found, key=lambda one: (min(min(one[1]), 10.0), sum(one[1])))
    names = [name for name, _ in rivals]
    split = [name for name, d in zip(names, distances, strict=True) if d >= _PARTED]
    if split:
        why = f"the predictions part by {max(distances):.2g} × the noise in this run: {experiment.words}"
    else:
        why = (
            f"no run of the menu splits them; {experiment.words} parts them most, "
            f"by {max(distances):.2g} × the noise"
        )
    parting = {name: round(d, 3) for name, d in zip(names, distances, strict=True)}
    return {"why": why, "run": dict(experiment.run), "separates": split, "parting": parting}
