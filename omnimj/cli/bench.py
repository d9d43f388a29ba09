"""`omnimj bench`: how fast the parts are, each as a ratio or a time within one run on this machine."""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.cli.compiling import note_compiled, say_compiling
from omnimj.cli.tables import table

HELP = "measure speed: twin, callback, batch, control, recording"
EXAMPLE = """examples:
  omnimj bench
  omnimj bench --json"""

_CURRENTS = (0.3, -0.8, 0.1, 0.7)
_STEPS = 2000
_ROUNDS = 7
_RUN_SECONDS = 10.0
_SAMPLES = 20_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the sub-command."""
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")


def _seconds(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def _interleaved(*works: Callable[[], object]) -> np.ndarray:
    """Least time of each piece of work over rounds taken in turn, so that all meet the same noise [s]."""
    return np.array([[_seconds(work) for work in works] for _ in range(_ROUNDS)]).min(axis=0)


def _moving(mj_model: Any) -> Any:
    import mujoco

    mj_data = mujoco.MjData(mj_model)
    mj_data.ctrl[:] = _CURRENTS
    mujoco.mj_step(mj_model, mj_data, 300)
    return mj_data


def _with_solver_contact(mj_model: Any, friction: bool) -> Any:
    """The same robot in the same state of motion with MuJoCo's own contact and none of ours."""
    import mujoco

    from omnimj.twin import slots

    other = mj_model.__copy__()
    other.actuator_user[0, slots.MAGIC] = 0.0
    other.pair_margin[:] = other.pair_gap[:] = 0.0
    other.pair_dim[:] = 3 if friction else 1
    mj_data, rolling = mujoco.MjData(other), _moving(mj_model)
    mj_data.qpos[:], mj_data.qvel[:] = rolling.qpos, rolling.qvel
    mujoco.mj_step(other, mj_data, 100)
    return other, mj_data


def measure_twin() -> dict[str, float]:
    """Steps per second, ratio to solver contact, share of the callback, scaling of a batch."""
    import mujoco
    import mujoco.batch

    from omnimj.parameters import read_floors, read_robot
    from omnimj.twin.assembly import robot_model
    from omnimj.twin.callback import install, repeat_callbacks

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

    def glide_rough() -> None:  # its rollers and motors do not drive: push it again and again
        rough_data.qvel[0] = 0.5
        mujoco.mj_step(rough, rough_data, _STEPS // 10)

    own, bare, rubbing, called, one, two = _interleaved(
        lambda: mujoco.mj_step(mj_model, mj_data, _STEPS),
        lambda: mujoco.mj_step(plain, plain_data, _STEPS),
        glide_rough,
        lambda: repeat_callbacks(mj_model._address, frozen._address, _STEPS),
        lambda: batches[0].step(nstep=200),
        lambda: batches[1].step(nstep=200),
    )
    return {
        "twin_steps_per_second": _STEPS / own,
        "solver_contact_ratio": own / bare,
        "solver_friction_ratio": own / (10.0 * rubbing),
        "callback_share": called / own,
        "batch_speedup": one / two,
    }


def measure_run() -> dict[str, float]:
    """Real-time factor of a scenario with control, sensors and recording; share and size of the recording."""
    from omnimj.cli.outputs import write_recording_of
    from omnimj.recording.traces import write_trace
    from omnimj.scenario.running import run_scenario
    from omnimj.scenario.scenario import read_scenario

    scenario = read_scenario("circle_8m", (f"duration={_RUN_SECONDS}", "drive.speed=0.3"))
    run_scenario(scenario)
    walls, shares, size = [], [], 0
    for _ in range(3):
        begin = time.perf_counter()
        run = run_scenario(scenario)
        driven = time.perf_counter() - begin
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder)
            stored = _seconds(lambda to=path, what=run: write_trace(to / "trace.parquet", what.trace))
            shown = _seconds(lambda to=path, what=run: write_recording_of(to / "run.rrd", what))
            size = (path / "run.rrd").stat().st_size
        walls.append(driven + stored)
        shares.append(shown / (driven + stored))
    return {
        "scenario_realtime_factor": scenario.duration / min(walls),
        "rerun_share": min(shares),
        "rerun_megabytes_10_s": size / 1e6,
    }


def measure_control() -> dict[str, float]:
    """One control step, measurement to command [µs]."""
    from omnimj.control.controller import Controller
    from omnimj.control.target import Target
    from omnimj.parameters import read_robot
    from omnimj.signals import Measurement

    robot = read_robot()
    controller = Controller(robot)
    rng = np.random.default_rng(0)
    target = Target(np.array([0.4, 0.3]), 0.1, 0.0)
    n = len(robot.wheels)
    state, times = None, np.empty(_SAMPLES)
    for k in range(len(times)):
        noise = rng.normal(size=2 * n + 3)
        measured = Measurement(
            k * 1e-3, 0.1 * noise[:n], 8.0 + 0.05 * noise[n : 2 * n], noise[-3:-1], 0.01 * noise[-1], 0.1
        )
        if state is None:
            state = controller.start(measured)
            controller.step(state, measured, target)
        begin = time.perf_counter()
        _, state = controller.step(state, measured, target)
        times[k] = time.perf_counter() - begin
    return {
        "control_step_median_us": 1e6 * float(np.median(times)),
        "control_step_p999_us": 1e6 * float(np.quantile(times, 0.999)),
    }


_MEANING = {
    "twin_steps_per_second": "steps of 1 ms per second on one core",
    "solver_contact_ratio": "twin step / same robot, MuJoCo's contact without traction (goal ≤ 0.75)",
    "solver_friction_ratio": "twin step / the same with MuJoCo's default contact, friction included",
    "callback_share": "native callbacks / step (goal ≤ 0.35)",
    "batch_speedup": "two threads / one (goal ≥ 1.8 on an idle machine)",
    "scenario_realtime_factor": "× real time, with control, sensors and trace (goal ≥ 8)",
    "rerun_share": "writing the Rerun recording / the run (goal ≤ 0.15)",
    "rerun_megabytes_10_s": "size of the recording of 10 s (goal ≤ 5)",
    "control_step_median_us": "control step, median [µs]",
    "control_step_p999_us": "control step, 99.9 % [µs]",
}


def run(arguments: Any) -> int:
    """Measures and prints.

    Returns:
      0; speed is reported, not judged.
    """
    say_compiling("twin", "uto_robot")
    found = {**measure_twin(), **measure_run(), **measure_control()}
    note_compiled("twin", "uto_robot")
    if arguments.json:
        print(json.dumps({name: float(found[name]) for name in _MEANING}, indent=2))
    else:
        rows = [(name, f"{found[name]:.4g}", meaning) for name, meaning in _MEANING.items()]
        print(table(("measure", "value", "meaning"), rows))
    return 0
