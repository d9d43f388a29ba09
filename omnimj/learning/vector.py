"""Many robots side by side in threads, as a vector environment of Gymnasium.

`gymnasium.make_vec("omnimj/OmniDrive-v0", num_envs=16)` makes one. Each robot does bit for bit what it does
alone: `reset(seed=s)` gives robot k the seed s + k, as Gymnasium's own vector environments do.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.threads import map_in_threads
from omnimj.learning.environment import METADATA, checked_render_mode, spaces
from omnimj.learning.options import read_task
from omnimj.learning.picture import Scene, draw
from omnimj.learning.registration import ENVIRONMENT
from omnimj.learning.simulation import (
    Outcome,
    Simulation,
    begin_decision,
    blank_episodes,
    checked_action,
    describe,
    judge_decision,
)
from omnimj.parameters.reading import Rule, check_number
from omnimj.signals import Array

_COUNT = Rule(1, 100_000, False)


class OmniDriveVector(VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """Robots as those of `OmniDrive`, each under its own action.

    Args:
      num_envs: Number of robots.
      render_mode: `rgb_array` for maps from above; None for no pictures.
      autoreset_mode: Gymnasium's `AutoresetMode`, or its value: `NextStep` (the step after the end of an
        episode begins the next one), `SameStep` (the step that ends it does; `info` has `final_obs` and
        `final_info`) or `Disabled` (by `reset` with `options={"reset_mask": …}`).
      threads: Number of threads at most; the machine's cores when None.
      **options: Those of `omnimj.learning.options.Options`, the same for all.

    Raises:
      InputError: A value breaks its rule, or options do not go together.
      UnknownNameError: No such option, plant, scenario, floor, fault or action; the message lists them.
    """

    metadata: ClassVar[dict[str, Any]] = METADATA  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        **options: Any,
    ):
        self.num_envs = int(check_number(f"{ENVIRONMENT}: num_envs", num_envs, _COUNT, whole=True))
        if threads is not None:
            threads = int(check_number(f"{ENVIRONMENT}: threads", threads, _COUNT, whole=True))
        self.render_mode, self._threads = checked_render_mode(render_mode), threads
        self._mode = _autoreset_mode(autoreset_mode)
        self.metadata = {**METADATA, "autoreset_mode": self._mode}  # pyright: ignore
        self.task = read_task(**options)
        self.single_observation_space, self.single_action_space = spaces(self.task)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._episodes = blank_episodes(self.task, self.num_envs)
        self._robots = [Simulation(self.task, self._episodes, k) for k in range(self.num_envs)]
        self._scenes = [Scene(self.task) for _ in self._robots]
        self._draws: list[np.random.Generator] = []
        self._seeds: list[int] = []
        self._ended, self._has_begun = np.zeros(self.num_envs, bool), False

    @property
    def np_random(self) -> tuple[np.random.Generator, ...]:  # pyright: ignore
        """Random number generator of each robot."""
        self._have_generators()
        return tuple(self._draws)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # pyright: ignore
        """Seed of each robot's generator."""
        self._have_generators()
        return tuple(self._seeds)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode of every robot, or of those of a mask.

        Args:
          seed: Seed s of the first robot, s + k of robot k; or a seed for each; when None, the generators go
            on.
          options: `reset_mask`, truth values of shape (num_envs,), for those that begin again.

        Raises:
          InputError: Not one seed per robot, or a mask of another kind.
          ResetNeeded: A mask that leaves robots out before the first reset.
        """
        mask = _reset_mask(options, self.num_envs)
        if not (self._has_begun or mask.all()):
            raise ResetNeeded("no episode has begun: call reset without a mask first")
        self._have_generators()
        for k, one in enumerate(_seeds(seed, self.num_envs)):
            if mask[k] and one is not None:
                self._draws[k], self._seeds[k] = seeding.np_random(one)
        begun = np.flatnonzero(mask).tolist()
        map_in_threads(self._begin, begun, self._threads)
        self._ended[mask], self._has_begun = False, True
        infos: dict[str, Any] = {}
        for name, rows in describe(self.task, self._episodes).items():
            infos[name] = np.where(_like(mask, rows), rows, np.zeros_like(rows))
            infos[f"_{name}"] = mask.copy()
        return self._observations(), infos

    def step(
        self, actions: NDArray[np.float32] | Array
    ) -> tuple[NDArray[np.float32], Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Hold actions, shape (num_envs, m), within ±1, for one decision; robots run in threads.

        Returns:
          Observations, rewards, terminated, truncated, all with a row per robot, and infos.

        Raises:
          InputError: Actions of another shape, or that are not finite.
          ResetNeeded: Before the first reset, or after the end of an episode with `Disabled`.
        """
        actions = checked_action(actions, (self.num_envs, self.task.action_size))
        if not self._has_begun or (self._mode is AutoresetMode.DISABLED and self._ended.any()):
            raise ResetNeeded("an episode has ended or none has begun: call reset first")
        begun = self._ended.copy()  # in the mode NEXT_STEP
        begin_decision(self.task, self._episodes, actions)
        map_in_threads(self._act, range(self.num_envs), self._threads)
        found = judge_decision(self.task, self._episodes)
        found = Outcome(*(np.where(begun, np.zeros_like(values), values) for values in found))
        infos = describe(self.task, self._episodes, found)
        infos |= {f"_{name}": np.ones(self.num_envs, bool) for name in infos}
        self._ended = found.terminated | found.truncated
        if self._mode is AutoresetMode.SAME_STEP and self._ended.any():
            infos = self._begin_ended(infos)
        return self._observations(), found.reward, found.terminated, found.truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:  # pyright: ignore
        """Draw a map from above of each robot; None without `render_mode`."""
        if self.render_mode is None:
            return None
        return tuple(draw(scene, robot) for scene, robot in zip(self._scenes, self._robots, strict=True))

    def close_extras(self, **_: Any) -> None:
        """Release the plants."""
        for robot in self._robots:
            robot.close()

    def _have_generators(self) -> None:
        if not self._draws:
            found = [seeding.np_random(None) for _ in self._robots]
            self._draws, self._seeds = [draws for draws, _ in found], [seed for _, seed in found]

    def _begin(self, k: int) -> None:
        self._robots[k].reset(self._draws[k])
        self._scenes[k].begin(self._robots[k])

    def _act(self, k: int) -> None:
        if self._ended[k]:
            self._begin(k)
            return
        self._robots[k].drive()
        if self.render_mode is not None:
            self._scenes[k].follow(self._robots[k])

    def _begin_ended(self, infos: dict[str, Any]) -> dict[str, Any]:
        """Begin the episodes of the robots whose episodes have ended; infos with the last of those."""
        ended, last = np.flatnonzero(self._ended).tolist(), self._observations()
        final = {
            name: np.where(_like(self._ended, rows), rows, np.zeros_like(rows))
            for name, rows in infos.items()
        }
        observations = np.full(self.num_envs, None, dtype=object)
        for k in ended:
            observations[k] = last[k]
        map_in_threads(self._begin, ended, self._threads)
        begun = describe(self.task, self._episodes)
        for name, rows in begun.items():
            infos[name] = np.where(_like(self._ended, rows), rows, infos[name])
        added = {"final_obs": observations, "final_info": final}
        masks = {f"_{name}": self._ended.copy() for name in added}
        self._ended = np.zeros(self.num_envs, bool)
        return {**infos, **added, **masks}

    def _observations(self) -> NDArray[np.float32]:
        return self._episodes["observation"].copy()


def _like(mask: NDArray[np.bool_], rows: NDArray[Any]) -> NDArray[np.bool_]:
    """Mask of robots as one of their rows."""
    return mask.reshape(-1, *[1] * (rows.ndim - 1))


def _autoreset_mode(given: AutoresetMode | str) -> AutoresetMode:
    by_value = {mode.value: mode for mode in AutoresetMode}
    found = given if isinstance(given, AutoresetMode) else by_value.get(given)
    if found is None:
        raise UnknownNameError(f"{ENVIRONMENT}: autoreset_mode", "mode", given, by_value)
    return found


def _seeds(seed: int | Sequence[int | None] | None, count: int) -> list[int | None]:
    if seed is None:
        return [None] * count
    if isinstance(seed, int | np.integer):
        return [int(seed) + k for k in range(count)]
    if len(seed) != count:
        raise InputError("seed", f"found {len(seed)} seeds", f"{count} are needed, one per robot")
    return list(seed)


def _reset_mask(options: dict[str, Any] | None, count: int) -> NDArray[np.bool_]:
    if options is None or "reset_mask" not in options:
        return np.ones(count, bool)
    mask = options["reset_mask"]
    if not isinstance(mask, np.ndarray) or mask.dtype != bool or mask.shape != (count,) or not mask.any():
        rule = f"an array of {count} truth values is needed, one of them true at least"
        raise InputError("options: reset_mask", f"found {mask!r}", rule)
    return mask
