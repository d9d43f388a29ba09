"""Drives of the foreign robot: a mission, faults, a log as a logger would have written it, and the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from .mission_plan import TICK, Plan, random_mission
from .sensors_and_cascade import (
    ACCELERATIONS,
    CAMERA,
    CURRENTS,
    DRAWS,
    MEASURED,
    TARGETS,
    WHEEL_SPEEDS,
    YAW,
    YAW_RATE,
    Cascade,
    SensorNumbers,
    sample,
    sensor_numbers,
    set_values,
)
from .true_robot import Fault, ForeignRobot, Machine, fault_table
from .wheels_and_body import (
    BODY,
    CURRENT,
    DRAG,
    LOAD,
    POSE,
    SEEN,
    SHAFT,
    SLIP,
    SPEED,
    STATES,
    TRACTION,
    VELOCITY,
    WHEEL_ACCELERATION,
    WHEEL_TORQUE,
    body,
    loads,
    step,
    wheels,
)


@dataclass(frozen=True)
class Log:
    """One drive."""

    columns: dict[str, np.ndarray]
    """Logged channels, under the names of the data format."""
    truth: dict[str, np.ndarray]
    """True values at every tick of 1 ms: `time`, pose and velocity of the centre, one column per wheel, …"""
    plan: Plan
    faults: tuple[Fault, ...] = ()
    pose_measured: bool = False


@njit(error_model="numpy")
def _strengths(time, faults, strength, grip) -> None:
    """Remaining share of each motor's torque and of each wheel's grip at a time."""
    strength[:] = 1.0
    grip[:] = 1.0
    for row in faults:
        if row[2] <= time < row[3]:
            if row[0] > 0.5:
                strength[int(row[1])] *= row[4]
            else:
                grip[int(row[1])] *= row[4]


@njit(error_model="numpy")
def _integrate(
    machine: Machine, sensors: SensorNumbers, cascade: Cascade, camera, twists, faults, draws, substeps
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """States, what the equations pass out, strengths of motors, and measurements, a row per tick."""
    n = len(twists)
    states, outputs, strengths = np.empty((n, STATES)), np.empty((n, SEEN)), np.empty((n, 4))
    measured = np.zeros((n, MEASURED))
    state, middle, rate, seen = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(SEEN)
    held, integrals, targets, strength, grip = np.zeros(7), np.zeros(4), np.zeros(4), np.ones(4), np.ones(4)
    loads(0.0, 0.0, machine, state[LOAD : LOAD + 4])
    wanted_heading = 0.0
    for k in range(n):
        _strengths(k * TICK, faults, strength, grip)
        wheels(state, targets, strength, grip, machine, rate, seen)
        body(state, machine, rate, seen)
        states[k], outputs[k], strengths[k] = state, seen, strength
        sample(k, state, seen, states, draws[k], sensors, machine, held, measured)
        heading = measured[k, CAMERA + 2] if camera else measured[k, YAW]
        set_values(k, twists[k], heading, wanted_heading, cascade, integrals, measured, targets)
        wanted_heading += twists[k, 2] * TICK
        for _ in range(substeps):
            step(state, targets, strength, grip, machine, TICK / substeps, rate, seen, middle)
    return states, outputs, strengths, measured


def drive(
    robot: ForeignRobot,
    mission: int | Plan,
    duration: float,
    faults: Sequence[Fault] = (),
    *,
    rate: float = 1000.0,
    pose_measured: bool = False,
    jitter: float = 0.0,
    lost: float = 0.0,
    substeps: int = 4,
) -> Log:
    """Drives one mission.

    Args:
      robot: The robot; its sensors' noise and the logger's lapses are drawn from the mission's seed.
      mission: Seed of a random mission, or a plan of one's own.
      duration: Of the log [s].
      faults: What breaks, and when.
      rate: Samples of the log per second; the controller always runs at 1 kHz.
      pose_measured: A camera's pose in the log in place of accelerations, yaw rate and yaw; the controller
        then has no gyro and holds the heading by the camera.
      jitter: Deviation of the time stamps from an even spacing, as a share of the spacing.
      lost: Share of the samples that are missing.
      substeps: Steps of the integration per tick.
    """
    seed = mission if isinstance(mission, int) else 0
    plan = random_mission(mission, duration) if isinstance(mission, int) else mission
    rng = np.random.default_rng([seed, 37])
    n = min(round(duration / TICK), len(plan.twists))
    cascade = Cascade(
        robot.speed_proportional,
        robot.speed_integral,
        0.0 if pose_measured else robot.yaw_rate_gain,
        robot.heading_gain if plan.hold_heading or pose_measured else 0.0,
        robot.current_limit,
        plan.in_world,
    )
    states, outputs, strengths, measured = _integrate(
        robot.machine(),
        sensor_numbers(robot.sensors, robot.gear_ratio),
        cascade,
        pose_measured,
        plan.twists[:n],
        fault_table(tuple(faults)),
        rng.standard_normal((n, DRAWS)),
        substeps,
    )
    columns = _logged(measured, _instants(rng, n, rate, jitter, lost), pose_measured)
    return Log(columns, _truth(states, outputs, strengths), plan, tuple(faults), pose_measured)


def _instants(rng: np.random.Generator, n: int, rate: float, jitter: float, lost: float) -> np.ndarray:
    """Times at which the logger looks [s]: even, or uneven and with gaps, always increasing."""
    count = int(n * TICK * rate)
    times = (np.arange(count) + jitter * rng.uniform(-0.5, 0.5, count)) / rate
    times = times[rng.uniform(size=count) >= lost]
    return times - times[0]


def _logged(measured: np.ndarray, times: np.ndarray, pose_measured: bool) -> dict[str, np.ndarray]:
    """The log's columns: at each of its times what was measured last."""
    rows = measured[np.clip(np.floor(times / TICK + 1e-6).astype(int), 0, len(measured) - 1)]
    columns = {"time": times}
    for name, first in (("current", CURRENTS), ("current_target", TARGETS), ("wheel_speed", WHEEL_SPEEDS)):
        columns |= {f"{name}_{i + 1}": rows[:, first + i] for i in range(4)}
    if pose_measured:
        names, first = ("x", "y", "heading"), CAMERA
        return columns | {name: rows[:, first + j] for j, name in enumerate(names)}
    columns |= {f"acceleration_{axis}": rows[:, ACCELERATIONS + j] for j, axis in enumerate("xy")}
    return columns | {"yaw_rate": rows[:, YAW_RATE], "yaw": rows[:, YAW]}


def _truth(states: np.ndarray, outputs: np.ndarray, strengths: np.ndarray) -> dict[str, np.ndarray]:
    """The true motion by name."""
    truth = {"time": TICK * np.arange(len(states))}
    alone = {"x": POSE, "y": POSE + 1, "heading": POSE + 2, "v_x": VELOCITY, "v_y": VELOCITY + 1}
    alone["yaw_rate"] = VELOCITY + 2
    truth |= {name: states[:, at] for name, at in alone.items()}
    per_wheel = {"wheel_speed": SPEED, "current": CURRENT, "traction": TRACTION, "normal": LOAD}
    truth |= {f"{name}_{i + 1}": states[:, at + i] for name, at in per_wheel.items() for i in range(4)}
    passed = {"slip": SLIP, "drag": DRAG, "shaft_torque": SHAFT, "wheel_torque": WHEEL_TORQUE}
    passed["wheel_acceleration"] = WHEEL_ACCELERATION
    truth |= {f"{name}_{i + 1}": outputs[:, at + i] for name, at in passed.items() for i in range(4)}
    truth |= {f"strength_{i + 1}": strengths[:, i] for i in range(4)}
    of_body = ("com_acceleration_x", "com_acceleration_y", "acceleration_x", "acceleration_y")
    return truth | {n: outputs[:, BODY + j] for j, n in enumerate((*of_body, "yaw_acceleration"))}
