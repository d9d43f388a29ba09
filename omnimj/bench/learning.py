"""Speed of the Gymnasium environments: decisions per second, alone and side by side in threads."""

from __future__ import annotations

import importlib.util
import time
from typing import Any

import numpy as np

ROBOTS = 16
"""Robots side by side."""
_STANDING = 30  # decisions after which a mission has begun to move


def measure_environments(decisions: int, rounds: int) -> dict[str, float]:
    """Measure decisions of 20 ms per second on twin and planar robot; nothing where Gymnasium is missing.

    One thread and two take turns, and the shortest time of each counts: a busy machine seldom has two idle
    cores.
    """
    if importlib.util.find_spec("gymnasium") is None:
        return {}
    return _measure("twin", "", decisions, rounds) | _measure("planar", "planar_", decisions, rounds)


def _measure(plant: str, prefix: str, decisions: int, rounds: int) -> dict[str, float]:
    import gymnasium

    from omnimj.learning import ENVIRONMENT

    made: list[Any] = [
        gymnasium.make_vec(ENVIRONMENT, num_envs=ROBOTS, plant=plant, threads=threads)
        for threads in (1, 2, None)
    ]
    made.append(gymnasium.make(ENVIRONMENT, plant=plant, disable_env_checker=True).unwrapped)
    shortest = np.full(len(made), np.inf)
    try:
        for environment in made:
            environment.reset(seed=0)
            _time(environment, _STANDING)
        for _ in range(rounds):
            for i, environment in enumerate(made):
                shortest[i] = min(shortest[i], _time(environment, decisions))
    finally:
        for environment in made:
            environment.close()
    one, two, every, single = shortest
    return {
        f"environment_{prefix}decisions_per_second": ROBOTS * decisions / every,
        f"environment_{prefix}threads_speedup": one / two,
        f"environment_{prefix}single_decisions_per_second": decisions / single,
    }


def _time(environment: Any, decisions: int) -> float:
    """Wall time of a number of decisions [s]."""
    action = np.zeros(environment.action_space.shape)
    begin = time.perf_counter()
    for _ in range(decisions):
        ended = environment.step(action)[3]
        if ended is True:  # one robot, which nobody resets
            environment.reset()
    return time.perf_counter() - begin
