"""One robot under a policy: its plant, its cascade, the plan of the episode, and the reward.

Both kinds of environment drive by this class, so that a robot does the same alone and among others. `advance`
runs without the interpreter's lock but for a few microseconds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnimj.control.cascade.controller import CascadeState, Controller
from omnimj.control.cascade.heading import GyroBias
from omnimj.control.records import Record, packed
from omnimj.errors import InputError
from omnimj.learning.observation import AHEAD, LIMIT, entries, wheel_speed_scale
from omnimj.learning.options import Task
from omnimj.learning.period import CURRENTS, TWIST, Episode, Setup
from omnimj.signals import Array
from omnimj.simulate.compiled.row import CHUNK_IS_DONE, PLANT_CHANGES, Plan
from omnimj.simulate.loop import LARGEST_TRUTH

RESIDUAL_VELOCITY, RESIDUAL_YAW_RATE = 0.25, 0.5
"""Twist that an action of 1 adds [m/s], [rad/s]; wheel speeds get the rim speed of the first."""
ERROR_SCALE = 0.1
"""Distance from the planned position that costs 1 per second [m]."""


def _setup(task: Task, controller: Controller) -> Setup:
    robot, n = task.robot, task.robot.wheel_count
    if task.action == TWIST:
        scale = np.array([RESIDUAL_VELOCITY, RESIDUAL_VELOCITY, RESIDUAL_YAW_RATE] + [0.0] * (n - 3))
    elif task.action == CURRENTS:
        scale = np.full(n, robot.control.current_limit)
    else:
        scale = np.full(n, RESIDUAL_VELOCITY * wheel_speed_scale(robot))
    return Setup(
        controller.constants,
        np.linalg.pinv(controller.nominal.speed_per_twist),
        task.action,
        scale,
        robot.motor.resistance,
        robot.motor.torque_constant * robot.motor.gear_ratio,
        wheel_speed_scale(robot),
        round(AHEAD / task.period),
        LARGEST_TRUTH,
    )


class Outcome(NamedTuple):
    """What one action led to."""

    reward: float
    terminated: bool
    """True if the robot is too far from its plan, or its simulation broke."""
    truncated: bool
    """True if the plan has ended."""
    tracking_error: float
    """Mean distance from the planned position during the action [m]."""
    energy: float
    """Electrical energy drawn during the action [J]."""


class Simulation:
    """One robot under a policy.

    Args:
      task: What all episodes have in common.
      episodes: Records of `blank_episodes`.
      k: Its own record among them.
    """

    def __init__(self, task: Task, episodes: Record, k: int):
        self.task, self._record = task, episodes[k : k + 1]
        self._plant = task.make_plant()
        self._controller = _controller(task)
        self._setup = packed(_setup(task, self._controller))
        self._act = _loop(task.plant)
        self._plan = Plan(np.zeros((1, 5)), np.zeros(1))

    def reset(self, draws: np.random.Generator) -> None:
        """Begin an episode; its motion and its sensor noise are drawn from a generator."""
        self._plan = self.task.draw_plan(draws)
        measured = self._plant.reset(int(draws.integers(2**31)))
        blank = _blank(self.task, self._controller)._replace(
            cascade=self._controller.initial_fields(measured),
            readings=np.concatenate(
                (
                    measured.current,
                    measured.wheel_speed,
                    measured.acceleration,
                    (measured.yaw_rate, measured.yaw),
                )
            ),
            truth=self._plant.truth(),
            reckoned=self._plan.columns[0, :2],
        )
        self._record[:] = packed(blank)
        self._drive_until(0)

    def advance(self, action: Array) -> Outcome:
        """Hold an action for one decision.

        Args:
          action: Shape (m,), within ±1; clipped.
        """
        e, task = self._record, self.task
        e["action"][0, : len(action)] = np.clip(action, -1.0, 1.0)
        e["error"], e["energy"] = 0.0, 0.0
        begin = int(e["period"][0])
        last = len(self._plan.yaw_rate) - 1
        whole = self._drive_until(min(begin + task.periods, last))
        seconds = max(int(e["period"][0]) - begin, 1) * task.period
        error, energy = float(e["error"][0]), float(e["energy"][0])
        reward = -error / ERROR_SCALE - task.energy_weight * energy
        terminated = not whole or self.distance > task.largest_error
        if terminated:
            # as far away for the rest of the plan: no reward for leaving it
            left = (last - int(e["period"][0])) * task.period
            reward -= left * task.largest_error / ERROR_SCALE
        ended = whole and int(e["period"][0]) == last
        return Outcome(reward, terminated, ended and not terminated, error / seconds, energy)

    @property
    def distance(self) -> float:
        """Present distance from the planned position [m]."""
        planned, (x, y) = self._plan.columns[self.period], self.pose[:2]
        return float(np.hypot(x - planned[0], y - planned[1]))

    @property
    def period(self) -> int:
        """Control periods since the start."""
        return int(self._record["period"][0])

    @property
    def pose(self) -> Array:
        """True x, y [m] and heading [rad], shape (3,), a copy."""
        return self._record["truth"][0, :3].copy()

    @property
    def planned(self) -> Array:
        """Planned positions, shape (k, 2) [m]."""
        return self._plan.columns[:, :2]

    @property
    def fault_active(self) -> bool:
        """True if one of the true faults is present."""
        now = self.period * self.task.period
        return any(f.onset <= now and (f.end is None or now < f.end) for f in self.task.faults)

    @property
    def observation(self) -> NDArray[np.float32]:
        """Observation, a copy, shape (2n+12,)."""
        return self._record["observation"][0].copy()

    def info(self, outcome: Outcome | None = None) -> dict[str, Any]:
        """Truth for judging, which a policy must not see.

        Args:
          outcome: Of the last action; None after a reset.
        """
        return {
            "tracking_error": self.distance if outcome is None else outcome.tracking_error,
            "energy": 0.0 if outcome is None else outcome.energy,
            "pose": self.pose,
            "fault_active": self.fault_active,
        }

    def close(self) -> None:
        """Release the plant."""
        self._plant.close()

    def _drive_until(self, end: int) -> bool:
        """Drive until a number of control periods is finished; False if the truth is not sound."""
        plant = self._plant
        while True:
            reason = self._act(plant.arrays(), self._setup, self._record, self._plan, plant.next_change, end)
            if reason != PLANT_CHANGES:
                return reason == CHUNK_IS_DONE
            plant.prepare_step()


def blank_episodes(task: Task, count: int) -> Record:
    """Records of `Episode` for a number of simulations."""
    one = packed(_blank(task, _controller(task)))
    return np.repeat(one, count)


def observation_limits(task: Task) -> NDArray[np.float32]:
    """Upper bounds of the observation, shape (2n+12,); the lower ones are their negatives."""
    return np.full(len(entries(task.robot)), LIMIT, np.float32)


def checked_action(action: Any, shape: tuple[int, ...]) -> Array:
    """Action as an array of numbers.

    Raises:
      InputError: Another shape, or numbers that are not finite.
    """
    try:
        found = np.asarray(action, float)
    except (TypeError, ValueError):
        raise InputError("action", f"found {action!r}", f"numbers of shape {shape} are needed") from None
    if found.shape != shape:
        raise InputError("action", f"found shape {found.shape}", f"shape {shape} is needed")
    if not np.isfinite(found).all():
        raise InputError("action", "holds numbers that are not finite", "each must be finite")
    return found


def _controller(task: Task) -> Controller:
    return Controller(task.robot, period=task.period, creep_floor=task.creep_floor, **task.loops)


def _blank(task: Task, controller: Controller) -> Episode:
    n = task.robot.wheel_count
    log = np.zeros(len(controller.log_names))
    return Episode(
        CascadeState(0.0, GyroBias(), np.zeros(n), np.zeros(n), np.zeros(n), log),
        controller.nominal,
        np.zeros(2 * n + 4),
        np.zeros(6 + 3 * n),
        np.zeros(n),
        np.zeros(2),
        0,
        0.0,
        0.0,
        np.zeros(len(entries(task.robot)), np.float32),
    )


def _loop(plant: str) -> Callable[..., int]:
    """Compiled loop of a kind of plant; a planar robot needs no MuJoCo."""
    if plant == "planar":
        from omnimj.learning.planar import act_on_planar

        return act_on_planar
    from omnimj.learning.twin import act_on_twin

    return act_on_twin
