"""Random missions of the robot, driven by the controller."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from omnimj.control.cascade.controller import Controller
from omnimj.control.compiled import CompiledController
from omnimj.parameters import Robot
from omnimj.plant.interface import robot_channels
from omnimj.signals import Array, Reference
from omnimj.simulate.driving import drive
from omnimj.simulate.loop import Callbacks, require_complete
from omnimj.simulate.plants import make_simulated
from omnimj.simulate.suites.suite import Condition, RunConfig

MISSIONS = 6
DURATION = 20.0
"""Duration of a mission [s]."""

_FLOORS = ("natural_stone", "pvc", "paperboard")
ACCELERATION, YAW_ACCELERATION = 1.0, 2.0
"""Largest planned accelerations [m/s²], [rad/s²]."""
_STAND = 0.5  # [s] at the beginning and at the end
_GROUND_TRUTH = ("x", "y", "heading")  # as a motion-capture system measures it


def plan_missions(robot: Robot, seed: int) -> list[Condition]:
    """Six random missions of 20 s, two on each floor; the seed determines them."""
    period = 1.0 / robot.sensors.sample_rate
    found = []
    for k in range(MISSIONS):
        # a key of two numbers, distinct from the seeds of the sensors
        draws = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(k, 1)))
        reference = mission(draws, DURATION, period)
        found.append(Condition(f"mission_{k + 1}", {"floor": _FLOORS[k % len(_FLOORS)]}, reference))
    return found


def mission(draws: np.random.Generator, duration: float, period: float) -> Reference:
    """Draw a random mission: segments at 0.2-1.0 m/s in the world frame with turns, stops and reversals.

    Args:
      draws: Random number generator.
      duration: Duration of the mission [s].
      period: Control period [s].

    Returns:
      A reference with bounded accelerations that starts and ends at rest.
    """
    rows = round(duration / period) + 1
    demand = np.zeros((rows, 3))
    for begin, end, twist in demanded_twists(draws, rows, period):
        demand[begin:end] = twist
    twist = _rate_limited(demand, period)
    heading = np.concatenate(([0.0], np.cumsum(twist[:-1, 2]) * period))
    position = np.vstack((np.zeros(2), np.cumsum(twist[:-1, :2], axis=0) * period))
    return Reference(
        np.arange(rows, dtype=float) * period, twist[:, :2].copy(), twist[:, 2].copy(), heading, position
    )


def demanded_twists(
    draws: np.random.Generator, rows: int, period: float
) -> Iterator[tuple[int, int, tuple[float, float, float]]]:
    """Draw the demand of a mission: first row, row after the last, and twist in the world of each segment.

    Args:
      draws: Random number generator.
      rows: Number of control periods.
      period: Control period [s].
    """
    row = round(_STAND / period)
    last = rows - round(2.0 / period)  # time to come to rest
    for seconds, twist in _segments(draws):
        if row >= last:
            return
        until = min(row + round(seconds / period), last)
        yield row, until, twist
        row = until


def _segments(draws: np.random.Generator) -> Iterator[tuple[float, tuple[float, float, float]]]:
    """Endless segments: duration [s], and velocity x, y [m/s] and yaw rate [rad/s] in the world frame."""
    direction = draws.uniform(-math.pi, math.pi)
    while True:
        kind = draws.choice(("stop", "reverse", "turn_on", "anew"), p=(0.15, 0.30, 0.15, 0.40))
        rate = draws.uniform(0.2, 1.0) * draws.choice((-1.0, 1.0)) * (draws.random() < 0.5)
        if kind == "stop":
            yield draws.uniform(0.8, 1.5), (0.0, 0.0, 0.0)
            continue
        if kind == "turn_on":
            rate = rate or 0.6
            yield draws.uniform(1.0, 2.0), (0.0, 0.0, rate)
            continue
        direction = direction + math.pi if kind == "reverse" else draws.uniform(-math.pi, math.pi)
        speed = draws.uniform(0.2, 1.0)
        yield draws.uniform(1.5, 3.0), (speed * math.cos(direction), speed * math.sin(direction), rate)


def _rate_limited(demand: Array, period: float) -> Array:
    """Demand with bounded accelerations, shape (k, 3)."""
    most, most_turn = ACCELERATION * period, YAW_ACCELERATION * period
    x = y = yaw = 0.0
    followed = [(x, y, yaw)]
    for wanted_x, wanted_y, wanted_yaw in demand[1:].tolist():
        step_x, step_y = wanted_x - x, wanted_y - y
        far = math.hypot(step_x, step_y)
        share = most / far if far > most else 1.0
        turn = min(max(wanted_yaw - yaw, -most_turn), most_turn)
        x, y, yaw = x + share * step_x, y + share * step_y, yaw + turn
        followed.append((x, y, yaw))
    return np.array(followed)


def record_robot(
    robot: Robot, nominal: Robot, condition: Condition, config: RunConfig
) -> Mapping[str, Array]:
    """Record a mission, given as `Reference`: measurements, set currents and true pose (a `RecordRun`)."""
    floor = str(condition.conditions["floor"])
    plant = make_simulated(config.plant, robot, floor, config.floors, seed=config.seed)
    try:
        controller = CompiledController(Controller(nominal, period=plant.period))
        trace = drive(plant, controller, condition.drive, Callbacks(config.progress))
    finally:
        plant.close()
    require_complete(trace, f"run {condition.name}")
    wheels = len(robot.wheels)
    targets = [f"current_target_{i}" for i in range(1, wheels + 1)]
    return {name: trace[name] for name in ("time", *robot_channels(wheels), *targets, *_GROUND_TRUTH)}
