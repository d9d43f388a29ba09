"""Diagnosis on soft floors that were identified before and are stated: quiet in health, and not blind."""

from __future__ import annotations

import pytest
from nightly import representative

from omnimj.errors import InputError, UnknownNameError
from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.scenario import read_scenario

ON_SOFT_FLOORS = ("floors=robotino/soft_floors.toml", "drive.creep_floor=")


def driven(floor, *overrides, stated=True, plant="planar"):
    known = f"diagnosis.floor={floor if stated else ''}"
    scenario = read_scenario("soft_floor_circle", (*ON_SOFT_FLOORS, f"floor={floor}", known, *overrides))
    return run_scenario(scenario, plant, "robust", seed=7).metrics


@pytest.mark.parametrize(
    ("floor", "plant"), representative(("gray", "planar"), ("table", "planar"), ("green", "twin"))
)
def test_a_healthy_robot_raises_no_alarm_on_the_floor_that_is_stated(floor, plant):
    assert driven(floor, plant=plant)["diagnoses"] == []


def test_a_floor_that_creeps_and_is_not_stated_is_taken_for_faults():
    assert driven("gray", "duration=6.0", stated=False)["false_alarms"] > 0


@pytest.mark.parametrize("wheel", representative(1, 2, 3))
def test_a_motor_with_half_its_torque_is_isolated_on_a_soft_floor(wheel):
    fault = f"faults=[{{ kind = 'motor', wheel = {wheel}, onset = 6.0, loss = 0.5 }}]"
    found = driven("gray", fault, "duration=11.0")
    assert found["isolated"] and found["false_alarms"] == 0


@pytest.mark.parametrize("wheel", representative(2, 1, 3))
def test_a_wheel_that_loses_its_grip_on_a_soft_floor_is_the_first_that_is_named(wheel):
    fault = f"faults=[{{ kind = 'slip', wheel = {wheel}, onset = 6.0, grip = 0.1 }}]"
    first = driven("gray", fault, "duration=11.0")["diagnoses"][0]
    assert (first["kind"], first["wheels"]) == ("slip", [wheel])


def test_a_stated_floor_must_exist():
    with pytest.raises(UnknownNameError, match=r"diagnosis.floor.*unknown floor 'sand'; choices"):
        read_scenario("circle_8m", ("diagnosis.floor=sand",))
    with pytest.raises(InputError, match=r"diagnosis.floor.*a string is needed"):
        read_scenario("circle_8m", ("diagnosis.floor=3",))
