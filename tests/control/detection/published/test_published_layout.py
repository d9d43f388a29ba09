"""The published method is for one layout of wheels and refuses any other."""

from __future__ import annotations

import dataclasses

import pytest
from other_robots import mecanum, star

from omnimj.control.detection.published.decision import layout_mismatch
from omnimj.errors import InputError
from omnimj.parameters import Robot, read_robot
from omnimj.simulate.detectors import available_methods, make_detector
from omnimj.simulate.scenario.scenario import read_scenario


def swapped(robot: Robot) -> Robot:
    """The same wheels, numbered 1, 2, 4, 3."""
    a, b, c, d = robot.wheels
    return dataclasses.replace(robot, wheels=(a, c, b, d))


@pytest.mark.parametrize(
    ("robot", "found"),
    [
        (read_robot(), ""),
        (star(4), ""),
        (star(3), "found 3 wheels"),
        (star(5), "found 5 wheels"),
        (star(4, first=0.3), "a wheel drives askew"),
        (mecanum(), "wheels 1 and 3 do not drive across wheels 2 and 4"),
        (swapped(read_robot()), "wheels 1 and 3 do not drive across wheels 2 and 4"),
    ],
)
def test_the_published_method_is_for_four_wheels_at_right_angles(robot, found):
    assert layout_mismatch(robot) == found


def test_turned_rollers_are_a_layout_without_the_published_method():
    first, *others = read_robot().wheels
    robot = dataclasses.replace(read_robot(), wheels=(dataclasses.replace(first, roller_angle=1.0), *others))
    assert layout_mismatch(robot) == "a wheel has turned rollers"


def test_a_run_of_three_wheels_is_compared_with_what_is_for_it_and_the_other_is_refused():
    scenario = read_scenario("three_wheel_weak_motor")
    assert available_methods(scenario) == ("robust", "off")
    with pytest.raises(
        InputError, match=r"three_wheel/robot.toml: \[\[wheels\]\]: found 3 wheels; Table 5.2"
    ):
        make_detector("published", scenario)
