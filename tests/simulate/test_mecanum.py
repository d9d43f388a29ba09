"""The mecanum platform of the guide diagnoses as the four omni wheels do."""

from __future__ import annotations

import pytest
from nightly import checkerboard
from other_robots import write_mecanum_of_the_guide

from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.scenario import read_scenario


def metrics(folder, scenario, plant, *overrides):
    model = write_mecanum_of_the_guide(folder / "mecanum.toml")
    return run_scenario(read_scenario(scenario, overrides, model), plant, "robust").metrics


@pytest.mark.parametrize(("wheel", "plant"), checkerboard([1, 2, 3, 4], ["planar", "twin"]))
def test_a_weak_motor_on_mecanum_wheels_is_isolated_and_nothing_else_is_named(tmp_path, wheel, plant):
    result = metrics(tmp_path, "degraded_motor", plant, f"faults.0.wheel={wheel}")
    assert result["isolated"] and result["false_alarms"] == 0 and len(result["diagnoses"]) == 1
    assert result["detection_delay"] <= 0.12 and result["tracking_error_max"] <= 0.14


@pytest.mark.parametrize("plant", ["planar", "twin"])
def test_mecanum_wheels_on_a_sheet_of_nylon_are_named_and_no_other(tmp_path, plant):
    result = metrics(tmp_path, "nylon_patch", plant)
    assert result["false_alarms"] == 0
    assert {(d["kind"], *d["wheels"]) for d in result["diagnoses"]} <= {("slip", 1), ("slip", 2)}
    assert result["diagnoses"][0]["wheels"] == [1]


def test_healthy_mecanum_wheels_drive_a_circle_and_nothing_is_named(tmp_path):
    result = metrics(tmp_path, "circle_8m", "twin", "duration=12", "checks={}")
    assert result["diagnoses"] == []


@pytest.mark.slow
def test_twisted_axles_on_mecanum_wheels_are_no_weak_motor(tmp_path):
    """No number of the robot is what they do; a loss that is learnt for it is not sure enough to be named."""
    result = metrics(tmp_path, "square_path", "twin", "checks={}")
    assert result["diagnoses"] == []
