"""Speed of the twin and of whole scenario runs, as ratios measured in one session on one machine."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import mujoco
import mujoco.batch
import numpy as np

from omnimj.bench.control import full_controller
from omnimj.control.cascade.controller import Controller
from omnimj.control.compiled import CompiledController
from omnimj.parameters import Robot, read_floors, read_robot
from omnimj.plant.mujoco import slots
from omnimj.plant.mujoco.assembly import robot_model
from omnimj.plant.mujoco.callback import install, repeat_callbacks
from omnimj.plant.mujoco.twin import RobotTwin
from omnimj.plant.planar import PlanarRobot
from omnimj.recording.traces import write_trace
from omnimj.signals import Reference
from omnimj.simulate.driving import drive, drive_stepwise
from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.simulate.suites.missions import mission
from omnimj.view.rerun.recording import write_recording_of

_CURRENTS = (0.3, -0.8, 0.1, 0.7)
_CALCULATIONS = 20
"""Callbacks that take about as long as a diagnosed step."""


def wall_time(work: Callable[[], object]) -> float:
    """Return the wall time of one call [s]."""
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def _interleaved(rounds: int, *works: Callable[[], object]) -> np.ndarray:
    """Return the shortest time of each call over interleaved rounds, shape (len(works),) [s]."""
    return _times(rounds, *works).min(axis=0)


def _times(rounds: int, *works: Callable[[], object]) -> np.ndarray:
    """Return the times of calls in interleaved rounds, shape (rounds, len(works)) [s]."""
    return np.array([[wall_time(work) for work in works] for _ in range(rounds)])


def _moving(mj_model: Any) -> Any:
    mj_data = mujoco.MjData(mj_model)
    mj_data.ctrl[:] = _CURRENTS
    mujoco.mj_step(mj_model, mj_data, 300)
    return mj_data


def _with_solver_contact(mj_model: Any, friction: bool) -> Any:
    """Copy a model to use MuJoCo's own contact; return it with the robot in the same state of motion."""

    other = mj_model.__copy__()
    other.actuator_user[0, slots.MAGIC] = 0.0
    other.pair_margin[:] = other.pair_gap[:] = 0.0
    other.pair_dim[:] = 3 if friction else 1
    mj_data, rolling = mujoco.MjData(other), _moving(mj_model)
    mj_data.qpos[:], mj_data.qvel[:] = rolling.qpos, rolling.qvel
    mujoco.mj_step(other, mj_data, 100)
    return other, mj_data


def measure_twin(steps: int, rounds: int) -> dict[str, float]:
    """Measure steps per second, ratio to solver contact, share of the callback, and batch scaling.

    Steps are of 1 ms; the shortest time of several rounds is reported.
    """

    install()
    mj_model = robot_model(read_robot(), read_floors()["natural_stone"], lean=True)
    mj_data, frozen = _moving(mj_model), _moving(mj_model)
    mujoco.mj_forward(mj_model, frozen)
    plain, plain_data = _with_solver_contact(mj_model, friction=False)
    rough, rough_data = _with_solver_contact(mj_model, friction=True)
    batches = [mujoco.batch.Batch(mj_model, nsim=16, nthread=n) for n in (1, 2)]
    for batch in batches:
        batch.bind("ctrl")[:] = _CURRENTS
        batch.step(nstep=300)
    repeat_callbacks(mj_model._address, frozen._address, 1)

    def glide_rough() -> None:  # without traction the robot must be set in motion repeatedly
        rough_data.qvel[0] = 0.5
        mujoco.mj_step(rough, rough_data, steps // 10)

    own, bare, rubbing, called, one, two = _interleaved(
        rounds,
        lambda: mujoco.mj_step(mj_model, mj_data, steps),
        lambda: mujoco.mj_step(plain, plain_data, steps),
        glide_rough,
        lambda: repeat_callbacks(mj_model._address, frozen._address, steps),
        lambda: batches[0].step(nstep=200),
        lambda: batches[1].step(nstep=200),
    )
    return {
        "twin_steps_per_second": steps / own,
        "solver_contact_ratio": own / bare,
        "solver_friction_ratio": own / (10.0 * rubbing),
        "callback_share": called / own,
        "batch_speedup": one / two,
    }


def measure_driving(duration: float, rounds: int) -> dict[str, float]:
    """Measure a driven period, trace included, in units of a step with MuJoCo's contact and no traction.

    Args:
      duration: Duration of a run [s].
      rounds: Number of interleaved rounds; the medians over them are compared.
    """

    robot, floor = read_robot(), read_floors()["natural_stone"]
    twin, planar = RobotTwin(robot, floor, seed=1), PlanarRobot(robot, floor.name, seed=1)
    plain, full = CompiledController(Controller(robot)), full_controller(robot)
    plan = _mission(robot, duration)
    bare, bare_data = _with_solver_contact(robot_model(robot, floor, lean=True), False)
    works = (
        lambda: mujoco.mj_step(bare, bare_data, len(plan.time)),
        lambda: drive(twin, full, plan),
        lambda: drive(twin, plain, plan),
        lambda: drive_stepwise(twin, full, plan),
        lambda: drive(planar, full, plan),
    )
    works[1]()
    times = _times(rounds, *works)
    unit, diagnosed, undiagnosed, stepwise, flat = np.median(times, axis=0)
    low, high = np.quantile(times[:, 0], (0.1, 0.9))
    return {
        "unit_step_us": 1e6 * unit / len(plan.time),
        "unit_spread": (high - low) / unit,
        "diagnosed_step_ratio": diagnosed / unit,
        "undiagnosed_step_ratio": undiagnosed / unit,
        "stepwise_step_ratio": stepwise / unit,
        "diagnosed_twin_to_planar_ratio": diagnosed / flat,
    }


def measure_threads(duration: float, rounds: int) -> dict[str, float]:
    """Measure diagnosed runs on two threads over one, and arithmetic alone, which shows what two cores give.

    Args:
      duration: Duration of a run [s].
      rounds: Number of interleaved rounds; the shortest times are compared, as a busy machine seldom has two
        idle cores.
    """
    robot, floor = read_robot(), read_floors()["natural_stone"]
    full, plan = full_controller(robot), _mission(robot, duration)
    twins = [RobotTwin(robot, floor, seed=seed) for seed in (1, 2)]
    mj_model = robot_model(robot, floor, lean=True)
    frozen = [_moving(mj_model) for _ in twins]

    def run(twin: Any) -> None:
        drive(twin, full, plan)

    def calculate(mj_data: Any) -> None:
        repeat_callbacks(mj_model._address, mj_data._address, _CALCULATIONS * len(plan.time))

    def on_two_threads(work: Callable[[Any], None], items: Sequence[Any]) -> None:
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(work, items))

    on_two_threads(run, twins)
    one, two, one_core, two_cores = _interleaved(
        rounds,
        lambda: run(twins[0]),
        lambda: on_two_threads(run, twins),
        lambda: calculate(frozen[0]),
        lambda: on_two_threads(calculate, frozen),
    )
    return {"two_threads_speedup": 2.0 * one / two, "two_cores_speedup": 2.0 * one_core / two_cores}


def _mission(robot: Robot, duration: float) -> Reference:
    """A mission for a robot of some duration [s]."""
    return mission(np.random.default_rng(1), duration, 1.0 / robot.sensors.sample_rate)


def measure_run(duration: float) -> dict[str, float]:
    """Measure the real-time factor of a scenario [s], and the cost and size of its Rerun recording."""
    scenario = read_scenario("circle_8m", (f"duration={duration}", "drive.speed=0.3"))
    run_scenario(scenario)
    walls, shares, size = [], [], 0
    for _ in range(3):
        begin = time.perf_counter()
        run = run_scenario(scenario)
        driven = time.perf_counter() - begin
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder)
            stored = wall_time(lambda to=path, what=run: write_trace(to / "trace.parquet", what.trace))
            shown = wall_time(lambda to=path, what=run: write_recording_of(to / "run.rrd", what))
            size = (path / "run.rrd").stat().st_size
        walls.append(driven + stored)
        shares.append(shown / (driven + stored))
    return {
        "scenario_realtime_factor": scenario.duration / min(walls),
        "rerun_share": min(shares),
        "rerun_megabytes_10_s": size / 1e6,
    }
