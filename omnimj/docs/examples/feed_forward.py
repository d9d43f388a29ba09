"""Learn a feed-forward on top of the cascade in a minute, and judge it on motions that it has not seen.

The policy adds a twist to the commanded one, by six numbers: the same three along x and y of the
body, since the robot is alike in all directions, and three in yaw. They weigh the planned velocity, its
change within the next tenth of a second, and the distance behind by dead reckoning (in yaw: the heading
error). CMA-ES searches them: each robot of a vector environment drives with one candidate, all along the same
random missions on the planar equations. The mean of the search is then judged on other missions, there and on
the twin.

    python feed_forward.py --generations 30 --seed 1 --out policy.json
"""

from __future__ import annotations

import argparse
import json
import math
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import omnimj
from omnimj.learning import ENVIRONMENT
from omnimj.learning.observation import entries
from omnimj.parameters import read_robot
from omnimj.recording.folder import atomic_file
from omnimj.simulate.metrics import distance_to_path

Array = NDArray[np.float64]
WEIGHTS = ("velocity", "velocity_change", "behind", "yaw_rate", "yaw_rate_change", "heading_error")
CANDIDATES, FIRST_STEP = 16, 1.0
FIRST_UNSEEN = 1_000_000  # training draws its seeds below
_NAMES = [entry.name for entry in entries(read_robot())]


def _columns(prefix: str) -> list[int]:
    """Entries of the observation whose names begin with a word."""
    return [k for k, name in enumerate(_NAMES) if name.startswith(f"{prefix}_")]


@dataclass(frozen=True)
class Errors:
    """Errors of one drive per seed, arrays of shape (seeds,)."""

    tracking: Array
    """RMS distance from the planned position at each instant [m]."""
    path: Array
    """RMS distance from the planned path [m]."""
    heading: Array
    """RMS heading error [rad]."""
    energy: Array
    """Electrical energy [J]."""


def act(weights: Array, observations: NDArray[np.float32]) -> Array:
    """Actions of the policy, clipped to ±1, shape (robots, 3).

    Args:
      weights: Weights of each robot in the order of `WEIGHTS`, shape (robots, 6).
      observations: Shape (robots, 20).
    """
    planned, ahead, behind = (observations[:, _columns(name)] for name in ("target", "ahead", "behind"))
    heading_error = observations[:, [_NAMES.index("heading_error")]]
    change, away = 5.0 * (ahead - planned), np.hstack([behind, heading_error])
    along, around = weights[:, None, :3], weights[:, None, 3:]
    seen = np.stack([planned, change, away], axis=2).astype(float)
    actions = np.einsum("raf,raf->ra", seen, np.concatenate([along, along, around], axis=1))
    return np.clip(actions, -1.0, 1.0)


def rewards(environment: Any, weights: Array, seed: int) -> Array:
    """Sum of the rewards of one episode, the same mission for all robots, shape (robots,)."""
    observations, _ = environment.reset(seed=[seed] * len(weights))
    total, running = np.zeros(len(weights)), np.ones(len(weights), bool)
    while running.any():
        observations, reward, terminated, truncated, _ = environment.step(act(weights, observations))
        total += np.where(running, reward, 0.0)
        running &= ~(terminated | truncated)
    return total


def train(seed: int, generations: int, duration: float = 10.0, floor: str = "natural_stone") -> Array:
    """Search the weights; the seed determines the result.

    Args:
      seed: Of the search and of its missions.
      generations: Number of missions, each driven by all candidates.
      duration: Length of a mission [s].
      floor: Floor of the missions.

    Returns:
      Mean of the search, shape (6,).
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about its own plots, which need another library
        import cma

    options = {"plant": "planar", "duration": duration, "floor": floor}
    environment = gymnasium.make_vec(ENVIRONMENT, num_envs=CANDIDATES, **options)
    draws = np.random.default_rng(seed)
    settings = {"popsize": CANDIDATES, "seed": math.nan, "verbose": -9}
    settings["randn"] = lambda *shape: draws.standard_normal(shape)
    search: Any = cma.CMAEvolutionStrategy(np.zeros(len(WEIGHTS)), FIRST_STEP, settings)
    for _ in range(generations):
        candidates = search.ask()
        gained = rewards(environment, np.array(candidates), int(draws.integers(FIRST_UNSEEN)))
        search.tell(candidates, (-gained).tolist())
    environment.close()
    return np.array(search.mean)


def judge(
    weights: Array, plant: str, seeds: int, duration: float = 10.0, floor: str = "natural_stone"
) -> Errors:
    """Drive missions that no training has seen; weights of zero are the cascade alone.

    Args:
      weights: Shape (27,).
      plant: `planar` or `twin`.
      seeds: Number of missions.
      duration: Length of a mission [s].
      floor: Floor of the missions.
    """
    options = {"plant": plant, "duration": duration, "floor": floor, "largest_error": 10.0}
    environment = gymnasium.make_vec(ENVIRONMENT, num_envs=seeds, autoreset_mode="Disabled", **options)
    observations, info = environment.reset(seed=FIRST_UNSEEN)
    poses, planned, energy = [info["pose"]], [info["planned"]], np.zeros(seeds)
    ended = np.zeros(seeds, bool)
    while not ended.any():  # all missions are of one length
        actions = act(np.tile(weights, (seeds, 1)), observations)
        observations, _, terminated, truncated, info = environment.step(actions)
        poses.append(info["pose"])
        planned.append(info["planned"])
        energy += info["energy"]
        ended = terminated | truncated
    environment.close()
    driven, plan = np.stack(poses, axis=1), np.stack(planned, axis=1)
    away = driven - plan
    tracking = np.sqrt(np.mean(np.sum(away[:, :, :2] ** 2, axis=2), axis=1))
    beside = [distance_to_path(d, p) for d, p in zip(driven[:, :, :2], plan[:, :, :2], strict=True)]
    heading = np.sqrt(np.mean(away[:, :, 2] ** 2, axis=1))
    return Errors(tracking, np.sqrt(np.mean(np.square(beside), axis=1)), heading, energy)


def describe(name: str, alone: Array, learned: Array, unit: str, scale: float) -> str:
    """One line that compares a figure of the cascade alone and of the policy, mission by mission."""
    ratios = learned / alone
    draws = np.random.default_rng(0).integers(len(ratios), size=(2000, len(ratios)))
    low, high = np.quantile(learned[draws].mean(axis=1) / alone[draws].mean(axis=1), (0.05, 0.95))
    return (
        f"{name:<15} {scale * alone.mean():8.2f} {scale * learned.mean():8.2f} {unit:<4}"
        f" {learned.mean() / alone.mean():6.2f} ({low:.2f}-{high:.2f})"
        f"  smaller in {np.sum(ratios < 1.0)} of {len(ratios)}"
    )


def main(arguments: list[str] | None = None) -> None:
    """Train, judge, print, and write the policy."""
    parser = argparse.ArgumentParser(description="Learn a feed-forward on top of the cascade.")
    parser.add_argument("--generations", type=int, default=30, help="generations of the search")
    parser.add_argument("--seed", type=int, default=1, help="seed of the search")
    parser.add_argument("--missions", type=int, default=32, help="missions of the judgement")
    parser.add_argument("--duration", type=float, default=10.0, help="length of a mission")
    parser.add_argument("--floor", default="natural_stone", help="floor of the missions")
    parser.add_argument("--out", type=Path, help="JSON file of the policy")
    given = parser.parse_args(arguments)
    begin = time.perf_counter()
    weights = train(given.seed, given.generations, given.duration, given.floor)
    took = time.perf_counter() - begin
    search = f"{given.generations} generations of {CANDIDATES} drives on {given.floor} in {took:.0f} s"
    print(f"omnimj {omnimj.__version__}, seed {given.seed}: {search}")
    print(", ".join(f"{name} {value:.2f}" for name, value in zip(WEIGHTS, weights, strict=True)))
    for plant in ("planar", "twin"):
        alone, learned = (
            judge(one, plant, given.missions, given.duration, given.floor)
            for one in (np.zeros(len(WEIGHTS)), weights)
        )
        print(f"\n{plant}: {given.missions} other missions, cascade alone and with the policy")
        print(describe("tracking error", alone.tracking, learned.tracking, "mm", 1e3))
        print(describe("path error", alone.path, learned.path, "mm", 1e3))
        print(describe("heading error", alone.heading, learned.heading, "mrad", 1e3))
        print(describe("energy", alone.energy, learned.energy, "J", 1.0))
    if given.out is not None:
        policy = dict(zip(WEIGHTS, weights.tolist(), strict=True))
        with atomic_file(given.out) as temporary:
            temporary.write_text(json.dumps(policy, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
