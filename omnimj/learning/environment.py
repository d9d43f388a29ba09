"""`omnimj/OmniDrive-v0`: one robot that follows planned motions, as a Gymnasium environment."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from omnimj.errors import UnknownNameError
from omnimj.learning.options import Task, read_task
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
    observation_limits,
)
from omnimj.signals import Array

METADATA: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}


def spaces(task: Task) -> tuple[Box, Box]:
    """Spaces of observation and action."""
    limits, ones = observation_limits(task), np.ones(task.action_size, np.float32)
    return Box(-limits, limits, dtype=np.float32), Box(-ones, ones, dtype=np.float32)


def checked_render_mode(render_mode: str | None) -> str | None:
    """Mode of rendering, None for none.

    Raises:
      UnknownNameError: No such mode.
    """
    if render_mode is not None and render_mode not in METADATA["render_modes"]:
        place = f"{ENVIRONMENT}: render_mode"
        raise UnknownNameError(place, "mode", render_mode, METADATA["render_modes"])
    return render_mode


class OmniDrive(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """A robot with n wheels that follows a planned motion by cascade and policy.

    Observation, shape (2n+12,): `observation.entries`, from measurement and target only, each divided by its
    scale and clipped to ±10. Action, shape (3,) or (n,), within ±1 and held for a decision of 20 ms:

    - `twist`: added to the commanded twist of the cascade, body frame; 1 is 0.25 m/s or 0.5 rad/s
    - `wheel_speeds`: added to the wheel-speed targets; 1 is a rim speed of 0.25 m/s
    - `currents`: set currents of the motors behind the rate limit; 1 is the largest current

    Reward of a decision: −∫ (e / 0.1 m + |Δθ| / 0.1 rad) dt − w E, with the distance e from the planned
    position, the heading error Δθ and the energy E that the motors draw, w = `energy_weight`. Terminated: e
    above `largest_error`, or a state of the simulation that is not finite; the reward then counts that
    distance for the rest of the plan. Truncated: the end of the plan.

    The seed of `reset` determines sensor noise and random motions, bit for bit. `info` holds what the policy
    must not see: `tracking_error` [m] and `heading_error` [rad], means over the decision, `energy` [J], true
    `pose` and `planned` pose x, y [m], heading [rad], and `fault_active`.

    Args:
      render_mode: `rgb_array` for a map from above; None for no pictures.
      **options: Those of `omnimj.learning.options.Options`.

    Raises:
      InputError: A value breaks its rule, or options do not go together.
      UnknownNameError: No such option, plant, scenario, floor, fault or action; the message lists them.
    """

    metadata: ClassVar[dict[str, Any]] = METADATA  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, render_mode: str | None = None, **options: Any):
        self.render_mode = checked_render_mode(render_mode)
        self.task = read_task(**options)
        self.observation_space, self.action_space = spaces(self.task)
        self._episodes = blank_episodes(self.task, 1)
        self._robot = Simulation(self.task, self._episodes, 0)
        self._scene = Scene(self.task)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode; without a seed its motion and noise go on from the last. Options are not used."""
        super().reset(seed=seed)
        self._robot.reset(self.np_random)
        self._scene.begin(self._robot)
        return self._observation(), self._info()

    def step(
        self, action: NDArray[np.float32] | Array
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Hold an action for one decision.

        Returns:
          Observation, reward, terminated, truncated, info.

        Raises:
          InputError: An action of another shape, or that is not finite.
        """
        action = checked_action(action, (self.task.action_size,))
        begin_decision(self.task, self._episodes, action)
        self._robot.drive()
        found = judge_decision(self.task, self._episodes)
        if self.render_mode is not None:
            self._scene.follow(self._robot)
        ends = bool(found.terminated[0]), bool(found.truncated[0])
        return self._observation(), float(found.reward[0]), *ends, self._info(found)

    def render(self) -> NDArray[np.uint8] | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Draw the map from above, shape (height, width, 3); None without `render_mode`."""
        return None if self.render_mode is None else draw(self._scene, self._robot)

    def close(self) -> None:
        """Release the plant."""
        self._robot.close()

    def _observation(self) -> NDArray[np.float32]:
        return self._episodes["observation"][0].copy()

    def _info(self, outcome: Outcome | None = None) -> dict[str, Any]:
        found = describe(self.task, self._episodes, outcome)
        return {name: rows[0].copy() if rows.ndim > 1 else rows[0].item() for name, rows in found.items()}
