"""Robots under a policy: plant, cascade and plan of each, and the reward of their decisions.

Both kinds of environment drive by these functions, so that a robot does the same alone and among others. A
`task` is what all episodes of an environment have in common. `episodes` are the states of all robots, records
of one array, changed in place: work in Python is done for all robots at once; `Simulation.drive` holds the
interpreter's lock for only a few microseconds.
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
from omnimj.simulate.compiled.row import PLANT_CHANGES, Plan
from omnimj.simulate.loop import LARGEST_TRUTH

RESIDUAL_VELOCITY, RESIDUAL_YAW_RATE = 0.25, 0.5
"""Twist that an action of 1 adds [m/s], [rad/s]; wheel speeds get the rim speed of the first."""
ERROR_SCALE, HEADING_SCALE = 0.1, 0.1
"""Distance from the planned position [m] and heading error [rad] that cost 1 per second."""


class Outcome(NamedTuple):
    """Outcome of one decision of each robot, arrays of shape (robots,)."""

    reward: Array
    terminated: NDArray[np.bool_]
    """True if the robot is too far from its plan, or its simulation broke."""
    truncated: NDArray[np.bool_]
    """True if the plan has ended."""
    tracking_error: Array
    """Mean distance from the planned position during the decision [m]."""
    heading_error: Array
    """Mean magnitude of the heading error during the decision [rad]."""
    energy: Array
    """Electrical energy drawn during the decision [J]."""


class Simulation:
    """One robot under a policy, the k-th of the records of `blank_episodes`."""

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
        m = self._plant.reset(int(draws.integers(2**31)))
        readings = np.concatenate((m.current, m.wheel_speed, m.acceleration, (m.yaw_rate, m.yaw)))
        first, truth = self._plan.columns[0, :3], self._plant.truth()
        begun = _blank(self.task, self._controller)._replace(
            cascade=self._controller.initial_fields(m),
            readings=readings,
            truth=truth,
            planned=first,
            reckoned=first[:2],
            last=len(self._plan.yaw_rate) - 1,
            distance=float(np.hypot(*(truth[:2] - first[:2]))),
        )
        self._record[:] = packed(begun)
        self.drive()

    def drive(self) -> None:
        """Drive to the end of the decision; stops early if a true value is not finite or too large."""
        plant = self._plant
        while (
            self._act(plant.arrays(), self._setup, self._record, self._plan, plant.next_change)
            == PLANT_CHANGES
        ):
            plant.prepare_step()

    @property
    def pose(self) -> Array:
        """True x, y [m] and heading [rad], shape (3,), a copy."""
        return self._record["truth"][0, :3].copy()

    @property
    def planned(self) -> Array:
        """Planned positions, shape (k, 2) [m]."""
        return self._plan.columns[:, :2]

    def close(self) -> None:
        """Release the plant."""
        self._plant.close()


def blank_episodes(task: Task, count: int) -> Record:
    """Records of `Episode` for a number of robots."""
    return np.repeat(packed(_blank(task, _controller(task))), count)


def begin_decision(task: Task, episodes: Record, actions: Array) -> None:
    """Give each robot its action, shape (robots, m), clipped to ±1, to be held for one decision."""
    episodes["action"][:, : task.action_size] = np.clip(actions, -1.0, 1.0)
    episodes["error"] = episodes["turned"] = episodes["energy"] = 0.0
    episodes["begin"] = episodes["period"]
    episodes["end"] = np.minimum(episodes["period"] + task.periods, episodes["last"])


def judge_decision(task: Task, episodes: Record) -> Outcome:
    """Judge the decision that has been driven."""
    error, turned, energy = (episodes[name].copy() for name in ("error", "turned", "energy"))
    period = episodes["period"]
    sound, left = episodes["sound"], episodes["last"] - period
    seconds = task.period * np.maximum(period - episodes["begin"], 1)
    reward = -error / ERROR_SCALE - turned / HEADING_SCALE - task.energy_weight * energy
    terminated = ~sound | (episodes["distance"] > task.largest_error)
    # as far away for the rest of the plan: leaving it is not rewarded
    reward -= np.where(terminated, left * (task.period * task.largest_error / ERROR_SCALE), 0.0)
    ended = (left == 0) & ~terminated
    return Outcome(reward, terminated, ended, error / seconds, turned / seconds, energy)


def describe(task: Task, episodes: Record, outcome: Outcome | None = None) -> dict[str, Any]:
    """Truth for judging, which a policy must not see, one row per robot; no outcome after a reset."""
    now = episodes["period"] * task.period
    active = np.zeros(len(episodes), bool)
    for fault in task.faults:
        active |= (now >= fault.onset) & (now < (np.inf if fault.end is None else fault.end))
    return {
        "tracking_error": episodes["distance"].copy() if outcome is None else outcome.tracking_error,
        "heading_error": np.zeros(len(episodes)) if outcome is None else outcome.heading_error,
        "energy": np.zeros(len(episodes)) if outcome is None else outcome.energy,
        "pose": episodes["truth"][:, :3].copy(),
        "planned": episodes["planned"].copy(),
        "fault_active": active,
    }


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


def _setup(task: Task, controller: Controller) -> Setup:
    robot, n = task.robot, task.robot.wheel_count
    if task.action == TWIST:
        scale = np.array([RESIDUAL_VELOCITY, RESIDUAL_VELOCITY, RESIDUAL_YAW_RATE] + [0.0] * (n - 3))
    elif task.action == CURRENTS:
        scale = np.full(n, robot.control.current_limit)
    else:
        scale = np.full(n, RESIDUAL_VELOCITY * wheel_speed_scale(robot))
    return Setup(
        cascade=controller.constants,
        forward=np.asarray(np.linalg.pinv(controller.nominal.speed_per_twist), float),
        action=task.action,
        scale=scale,
        resistance=robot.motor.resistance,
        back_emf=robot.motor.torque_constant * robot.motor.gear_ratio,
        wheel_speed=wheel_speed_scale(robot),
        ahead=round(AHEAD / task.period),
        largest=LARGEST_TRUTH,
    )


def _blank(task: Task, controller: Controller) -> Episode:
    n, log = task.robot.wheel_count, np.zeros(len(controller.log_names))
    return Episode(
        cascade=CascadeState(0.0, GyroBias(), 0.0, np.zeros(n), np.zeros(n), np.zeros(n), log),
        changed=controller.nominal,
        readings=np.zeros(2 * n + 4),
        truth=np.zeros(6 + 3 * n),
        action=np.zeros(n),
        planned=np.zeros(3),
        reckoned=np.zeros(2),
        period=0,
        begin=0,
        end=0,
        last=0,
        sound=True,
        distance=0.0,
        error=0.0,
        turned=0.0,
        energy=0.0,
        observation=np.zeros(len(entries(task.robot)), np.float32),
    )


def _loop(plant: str) -> Callable[..., int]:
    """Compiled loop of a kind of plant; a planar robot needs no MuJoCo."""
    if plant == "planar":
        from omnimj.learning.period import act_on_planar

        return act_on_planar
    from omnimj.learning.twin import act_on_twin

    return act_on_twin
