"""A platform of three wheels diagnoses as the four-wheel robot does, and does what three wheels can."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from nightly import in_turn, representative

from omnimj.control.cascade.controller import Controller
from omnimj.control.compiled import CompiledController
from omnimj.control.detection.robust.detector import RobustDetector
from omnimj.control.recovery import Recovery
from omnimj.control.recovery.modes import PIVOTING
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import read_robot
from omnimj.plant.faults import Fault
from omnimj.plant.planar import PlanarRobot
from omnimj.resources import scenarios_folder
from omnimj.simulate.driving import drive
from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.simulate.suites.missions import mission

WHEELS = (1, 2, 3)
ROBOT = read_robot(Path("three_wheel"))


def third_turns(wheel):
    """Direction in which wheel 2 of `three_wheel_weak_motor` is driven, beside another wheel [rad]."""
    return (wheel - 2) * 2.0 * math.pi / 3.0


def metrics(wheel, fault, plant="planar"):
    overrides = (f"drive.direction={third_turns(wheel)}", f"faults=[{{ wheel = {wheel}, {fault} }}]")
    return run_scenario(read_scenario("three_wheel_weak_motor", overrides), plant, "robust").metrics


@pytest.mark.parametrize(("wheel", "loss"), in_turn(WHEELS, [0.57, 0.8]))
def test_a_weak_motor_of_three_is_isolated_and_nothing_else_is_named(wheel, loss):
    result = metrics(wheel, f"kind = 'motor', onset = 0.8, loss = {loss}")
    assert result["isolated"] and result["false_alarms"] == 0 and len(result["diagnoses"]) == 1
    assert result["detection_delay"] <= 0.12


@pytest.mark.parametrize("wheel", WHEELS)
def test_a_slipping_wheel_of_three_is_isolated_and_let_go_and_nothing_else_is_named(wheel):
    result = metrics(wheel, "kind = 'slip', onset = 0.5, end = 1.3, grip = 0.2")
    assert result["isolated"] and result["false_alarms"] == 0 and len(result["diagnoses"]) == 1
    assert result["detection_delay"] <= 0.2
    assert 1.3 < result["diagnoses"][0]["cleared"] < 1.9


@pytest.mark.parametrize(("way", "wheel"), in_turn([1.0, -1.0], WHEELS))
@pytest.mark.parametrize("plant", representative("planar", "twin"))
def test_a_motor_of_three_that_dies_while_it_alone_carries_the_drive_is_all_that_is_named(plant, way, wheel):
    overrides = (
        f"drive.direction={way * math.pi / 2 + (wheel - 1) * 2.0 * math.pi / 3.0}",
        f"faults=[{{ wheel = {wheel}, kind = 'motor', onset = 0.8, loss = 1.0 }}]",
    )
    run = run_scenario(read_scenario("three_wheel_weak_motor", overrides), plant, "robust")
    result = run.metrics
    assert result["isolated"] and result["false_alarms"] == 0 and result["detection_delay"] <= 0.12
    assert run.trace[f"effectiveness_{wheel}"][-1] <= 0.1  # although its wheel stands and friction hides much
    assert PIVOTING in run.trace["recovery"] and result["tracking_error_max"] <= 0.3


def driven(fault, seed, duration):
    plant = PlanarRobot(ROBOT, "pvc", faults=[fault] if fault else [], seed=seed)
    controller = CompiledController(Controller(ROBOT), RobustDetector(ROBOT), Recovery(ROBOT))
    return drive(plant, controller, mission(np.random.default_rng(seed), duration, plant.period))


def test_a_healthy_mission_on_three_wheels_names_nothing():
    assert driven(None, 100, 30.0).about["diagnoses"] == []


def test_a_dead_motor_of_three_is_turned_about_and_its_shorted_current_is_no_new_fault():
    trace = driven(Fault("motor", 5.0, wheel=2, numbers={"loss": 1.0}), 103, 15.0)
    assert {(d["kind"], d["wheels"]) for d in trace.about["diagnoses"]} <= {("motor", (2,)), ("free", (2,))}
    assert PIVOTING in trace["recovery"]
    assert np.abs(trace["current_2"][trace["recovery"] == PIVOTING]).max() > 0.1


def test_a_model_is_found_by_name_or_beside_its_scenario_or_refused_in_one_line(tmp_path):
    assert len(read_scenario("circle_8m", model_file=Path("three_wheel")).constants.wheels) == 3
    own = tmp_path / "own.toml"
    own.write_text(ROBOT.file.read_text(encoding="utf-8"), encoding="utf-8")
    scenario = tmp_path / "s.toml"
    text = read_scenario_text("three_wheel_circle")
    scenario.write_text(text.replace('"three_wheel"', '"own.toml"'), encoding="utf-8")
    assert read_scenario(scenario).constants.file == own
    for name, error, words in (
        ('"nowhere.toml"', InputError, r"s\.toml: model: found 'nowhere\.toml'"),
        ('"two_wheel"', UnknownNameError, r"two_wheel.*three_wheel.*uto_robot"),
        ("3", InputError, r"s\.toml: model: found 3"),
    ):
        scenario.write_text(text.replace('"three_wheel"', name), encoding="utf-8")
        with pytest.raises(error, match=words):
            read_scenario(scenario)
    with pytest.raises(InputError, match="use --model"):
        read_scenario("three_wheel_circle", ["model=uto_robot"])


def read_scenario_text(name):
    return (scenarios_folder() / f"{name}.toml").read_text(encoding="utf-8")
