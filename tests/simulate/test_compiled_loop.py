"""The compiled loop gives the trace of the stepwise loop bit for bit, whatever happens in the run."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from nightly import three_wheels_nightly
from same_traces import assert_same

from omnimj import read_scenario
from omnimj.control.cascade.controller import Controller
from omnimj.control.compiled import CompiledController
from omnimj.control.detection.robust import RobustDetector
from omnimj.control.recovery import Recovery
from omnimj.effects import with_effects
from omnimj.parameters import read_floors, read_robot
from omnimj.plant.faults import Fault
from omnimj.plant.mujoco.twin import RobotTwin
from omnimj.plant.planar import PlanarRobot
from omnimj.signals import Measurement, Reference
from omnimj.simulate import loop
from omnimj.simulate.compiled.run import compiled_loop
from omnimj.simulate.detectors import make_detector
from omnimj.simulate.driving import drive, drive_stepwise
from omnimj.simulate.loop import Callbacks
from omnimj.simulate.plants import make_plant, plant_name
from omnimj.simulate.run import make_diagnosing_controller
from omnimj.simulate.scenario.listing import scenario_names
from omnimj.simulate.suites.missions import mission

ROBOT = read_robot()
SECONDS = 0.7
"""Duration of a comparison [s]: longer than the sensors' noise is drawn ahead."""


def cut(plan: Reference, rows: int) -> Reference:
    """First rows of a reference."""
    arrays = {f.name: getattr(plan, f.name) for f in dataclasses.fields(plan) if f.name != "is_path"}
    return Reference(**{name: array[:rows] for name, array in arrays.items()}, is_path=plan.is_path)


def both(make_plant_of_run, controller, plan, callbacks=(loop.NO_CALLBACKS, loop.NO_CALLBACKS)):
    """Traces of the compiled and of the stepwise loop."""
    plants = make_plant_of_run(), make_plant_of_run()
    assert compiled_loop(plants[0], controller) is not None
    return drive(plants[0], controller, plan, callbacks[0]), drive_stepwise(
        plants[1], controller, plan, callbacks[1]
    )


def robot_scenarios():
    """Names of the scenarios in which a robot with motors is driven."""
    found = (read_scenario(name) for name in scenario_names())
    return [s.name for s in found if not s.is_rig and s.level != "kinematic"]


ALIKE = (
    "circle_8m_wheel_lost",
    "oil_everywhere",
    "slip_then_motor",
    "square_path",
    "square_path_open_loop",
    "three_motors_lost",
    "two_motors_lost",
)
"""Scenarios that are left to nightly runs: on the plants of others, they begin like them."""


@pytest.mark.parametrize(
    "name",
    [
        *three_wheels_nightly(name for name in robot_scenarios() if name not in ALIKE),
        *(pytest.param(name, marks=pytest.mark.slow) for name in ALIKE),
    ],
)
def test_every_scenario_runs_alike_in_the_compiled_and_in_the_stepwise_loop(name):
    scenario = read_scenario(name)
    method = "robust"
    controller = make_diagnosing_controller(scenario, make_detector(method, scenario))
    plan = cut(scenario.robot_drive.reference, round(SECONDS / scenario.period))
    compiled, stepwise = both(lambda: make_plant(scenario, plant_name(scenario, None), 3), controller, plan)
    assert_same(compiled, stepwise)


@pytest.mark.slow
def test_faults_on_a_stated_soft_floor_are_found_alike():
    slip = "faults=[{ kind = 'slip', wheel = 1, onset = 1.5, grip = 0.05 }]"
    scenario = read_scenario("soft_floor_circle", (slip,))
    controller = make_diagnosing_controller(scenario, make_detector("robust", scenario))
    plan = cut(scenario.robot_drive.reference, round(2.5 / scenario.period))
    compiled, stepwise = both(lambda: make_plant(scenario, "planar", 3), controller, plan)
    assert_same(compiled, stepwise)
    assert compiled.about["diagnoses"]


FAULTS = (
    Fault("slip", 1.0, 2.0, 1, {"grip": 0.1}),
    Fault("free", 2.0, None, 2, {}),
    Fault("free", 3.0, None, 3, {}),
    Fault("sensor", 3.3, None, None, {"channel": "current_4", "mode": "drift", "size": 0.2}),
)


def planar():
    return PlanarRobot(ROBOT, "natural_stone", faults=FAULTS, seed=4)


def twin():
    return RobotTwin(ROBOT, read_floors()["natural_stone"], faults=FAULTS, seed=4)


@pytest.mark.parametrize("make", [planar, twin])
def test_decisions_braked_motors_and_changing_conditions_leave_no_difference(make):
    controller = CompiledController(Controller(ROBOT), RobustDetector(ROBOT), Recovery(ROBOT))
    plan = mission(np.random.default_rng(8), 4.5, 1e-3)
    compiled, stepwise = both(make, controller, plan)
    assert_same(compiled, stepwise)
    assert len(compiled.about["diagnoses"]) >= 2


def test_delayed_and_scaled_sensors_read_alike():
    robot = with_effects(ROBOT, {"sensor_delay": {"channel": "yaw", "delay": 0.0035}})
    controller = CompiledController(Controller(ROBOT))
    plan = mission(np.random.default_rng(2), 1.0, 1e-3)
    assert_same(*both(lambda: PlanarRobot(robot, "natural_stone", seed=4), controller, plan))


def test_the_cascade_alone_in_the_compiled_loop_drives_as_the_controller_does():
    plan = mission(np.random.default_rng(2), 1.5, 1e-3)
    compiled = drive(PlanarRobot(ROBOT, "natural_stone", seed=1), CompiledController(Controller(ROBOT)), plan)
    alone = drive(PlanarRobot(ROBOT, "natural_stone", seed=1), Controller(ROBOT), plan)
    assert_same(compiled, alone)


def test_a_truth_beyond_all_bounds_ends_both_loops_at_the_same_row_with_the_same_words(monkeypatch):
    monkeypatch.setattr(loop, "LARGEST_TRUTH", 30.0)  # normal forces grow beyond it in the first turn
    plan = mission(np.random.default_rng(2), 3.0, 1e-3)
    controller = CompiledController(Controller(ROBOT))
    compiled, stepwise = both(lambda: PlanarRobot(ROBOT, "natural_stone", seed=1), controller, plan)
    assert compiled.about["failure"] and 0 <= len(compiled["time"]) < len(plan.time)
    assert_same(compiled, stepwise)


def test_ctrl_c_keeps_the_rows_that_are_finished():
    def stop(done, total):
        if done >= 300:
            raise KeyboardInterrupt

    plan = mission(np.random.default_rng(2), 1.0, 1e-3)
    callbacks = Callbacks(progress=stop), Callbacks(progress=stop)
    controller = CompiledController(Controller(ROBOT))
    compiled, stepwise = both(lambda: PlanarRobot(ROBOT, "natural_stone"), controller, plan, callbacks)
    assert compiled.about["interrupted"] and len(compiled["time"]) == 300
    assert_same(compiled, stepwise)


def test_progress_rows_and_poses_come_as_from_the_stepwise_loop():
    seen = ([], []), ([], [])

    def callbacks(into):
        return Callbacks(
            progress=lambda done, total: into[0].append((done, total)),
            snapshot=lambda now, pose: into[1].append((now, pose.copy())),
        )

    scenario = read_scenario("nylon_patch")
    plan = cut(scenario.robot_drive.reference, 250)
    controller = CompiledController(Controller(scenario.robot))
    both(lambda: make_plant(scenario, "twin", 0), controller, plan, tuple(map(callbacks, seen)))
    assert seen[0][0] == seen[1][0] == [(100, 250), (200, 250), (250, 250)]
    times, poses = zip(*seen[0][1], strict=True)
    other_times, other_poses = zip(*seen[1][1], strict=True)
    assert times == other_times and np.array_equal(poses, other_poses) and len(times) == 13


def test_a_plant_or_controller_with_a_step_of_its_own_is_driven_step_by_step():
    class Counting(PlanarRobot):
        steps = 0

        def step(self, command):
            Counting.steps += 1
            return super().step(command)

    class Quiet(CompiledController):
        def step(self, state, measurement, target):
            command, state = super().step(state, measurement, target)
            return dataclasses.replace(command, current=0.0 * command.current), state

    plan = mission(np.random.default_rng(2), 3.0, 1e-3)
    controller, plant = CompiledController(Controller(ROBOT)), Counting(ROBOT, "natural_stone")
    assert compiled_loop(plant, controller) is None
    trace = drive(plant, controller, plan)
    assert Counting.steps == len(trace["time"]) - 1
    quiet = Quiet(Controller(ROBOT))
    assert compiled_loop(planar(), quiet) is None and compiled_loop(planar(), controller) is not None
    assert not drive(planar(), quiet, plan).wheels("current_target").any()


class Recorded:
    """A plant without physics: returns recorded readings whatever is commanded, and a random truth."""

    def __init__(self, plant, trace, seed):
        self.period, self._random = plant.period, np.random.default_rng(seed)
        self.truth_names, self._row = plant.truth_names, 0
        n = len(ROBOT.wheels)
        stack = [[trace[f"{kind}_{i + 1}"] for i in range(n)] for kind in ("current", "wheel_speed")]
        self._rows = np.array([*stack[0], *stack[1], trace["acceleration_x"], trace["acceleration_y"]]).T
        self._time, self._yaw_rate, self._yaw = trace["time"], trace["yaw_rate"], trace["yaw"]

    def _measurement(self) -> Measurement:
        k, n = self._row, (self._rows.shape[1] - 2) // 2
        row = self._rows[k]
        single = float(self._yaw_rate[k]), float(self._yaw[k])
        return Measurement(float(self._time[k]), row[:n], row[n : 2 * n], row[2 * n :], *single)

    def reset(self, seed=None) -> Measurement:
        self._row = 0
        return self._measurement()

    def step(self, command) -> Measurement:
        self._row += 1
        return self._measurement()

    def truth(self) -> np.ndarray:
        return self._random.uniform(-9.0, 9.0, len(self.truth_names))

    def close(self) -> None:
        pass


@pytest.mark.parametrize("make", [planar, twin])
def test_commands_follow_from_the_readings_alone_whatever_the_truth_and_the_faults_are(make):
    controller = CompiledController(Controller(ROBOT), RobustDetector(ROBOT), Recovery(ROBOT))
    plan = mission(np.random.default_rng(8), 4.5, 1e-3)
    driven = drive(make(), controller, plan)
    assert len(driven.about["diagnoses"]) >= 2
    for seed in (1, 2):
        played: Any = Recorded(make(), driven, seed)
        assert compiled_loop(played, controller) is None
        again = drive(played, controller, plan)
        assert not np.array_equal(again[played.truth_names[0]], driven[played.truth_names[0]])
        for name in set(driven.columns) - set(played.truth_names):
            assert np.array_equal(again[name], driven[name]), name
        assert again.about["diagnoses"] == driven.about["diagnoses"]
