"""What recovery could not hold is described, from the log and from the robot's layout."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from drawn import row_names, texts
from mentions import mentions
from other_robots import mecanum, star

from omnimj.cli.run_summary import format_recovery
from omnimj.control.recovery.modes import (
    COMPENSATING,
    MODE_CONSEQUENCES,
    MODE_NAMES,
    NORMAL,
    PIVOTING,
    SLOWING,
    STOPPING,
    indispensable,
)
from omnimj.control.robot_constants import robot_constants
from omnimj.parameters import read_rig, read_robot
from omnimj.signals import Trace
from omnimj.view.plots.diagnosis import state_lanes
from omnimj.view.wording import RECOVERY, describe_layout, recovery_periods, recovery_spans

TIME = np.arange(0.0, 10.0, 0.01)


def made(modes: np.ndarray) -> Trace:
    """Three wheels: the second stands still, the first creeps."""
    speeds = {f"wheel_speed_{i}": np.full(len(TIME), turns) for i, turns in ((1, 0.2), (2, 0.0), (3, 9.0))}
    return Trace({"time": TIME, "recovery": modes.astype(float), **speeds})


def named(*diagnoses: tuple[float, int]) -> dict:
    return {"diagnoses": [{"time": at, "kind": "free", "wheels": [wheel]} for at, wheel in diagnoses]}


def test_the_wheel_that_is_turned_about_is_named_with_what_is_given_up():
    (way,) = recovery_periods(made(np.where(TIME < 3.0, NORMAL, PIVOTING)), named((2.9, 2)))
    assert way.name == "turning about wheel 2" and "heading is lost" in way.consequence
    assert way.when == "3 – 9.99 s" and way.duration == pytest.approx(6.99)


def test_of_two_broken_wheels_it_is_the_one_that_stands_and_a_sound_one_never():
    modes = np.where(TIME < 3.0, NORMAL, PIVOTING)
    assert recovery_periods(made(modes), named((2.8, 1), (2.9, 2)))[0].name == "turning about wheel 2"
    assert recovery_periods(made(modes), named((2.8, 1)))[0].name == "turning about wheel 1"
    assert recovery_periods(made(modes), named())[0].name == MODE_NAMES[PIVOTING]


def test_stretches_of_one_mode_are_one_line_in_the_order_of_the_run():
    modes = np.select(
        [TIME < 2, TIME < 3, TIME < 5, TIME < 6, TIME < 8], [0, SLOWING, 0, SLOWING, 0], STOPPING
    )
    slow, stop = recovery_periods(made(modes), named())
    assert (slow.name, stop.name) == (MODE_NAMES[SLOWING], MODE_NAMES[STOPPING])
    assert slow.when == "2 – 6 s, 2 times, 2 s in all"
    assert "cannot be steered any more" in stop.consequence


def test_a_run_as_planned_has_no_recovery_line():
    assert recovery_periods(made(0.0 * TIME), named()) == []
    assert format_recovery(made(0.0 * TIME), named(), star(3)) == ""
    assert recovery_periods(Trace({"time": TIME}), named()) == []


def test_every_mode_but_driving_as_planned_states_what_it_gives_up():
    assert len(MODE_CONSEQUENCES) == len(MODE_NAMES)
    assert [not words for words in MODE_CONSEQUENCES] == [name == MODE_NAMES[NORMAL] for name in MODE_NAMES]


@pytest.mark.parametrize("count", [3, 4, 5, 6])
def test_three_wheels_need_each_and_more_of_them_need_none(count):
    forces = robot_constants(star(count)).forces
    ranks = [np.linalg.matrix_rank(np.delete(forces, i, axis=1)) for i in range(count)]
    assert indispensable(forces) == tuple(i + 1 for i in range(count) if ranks[i] < 3)
    assert bool(describe_layout(star(count))) == (count == 3)


def test_four_wheels_of_which_two_stand_in_line_need_the_others():
    robot = star(4)
    wheels = (robot.wheels[0], robot.wheels[1], robot.wheels[2], robot.wheels[2])
    doubled = dataclasses.replace(robot, wheels=wheels)
    assert mentions(describe_layout(doubled), "wheels 1, 2")


def test_the_shipped_robots_state_which_wheels_they_can_lose():
    assert describe_layout(read_robot()) == describe_layout(mecanum()) == describe_layout(read_rig()) == ""


def test_the_terminal_prints_it_with_the_layout():
    text = format_recovery(made(np.where(TIME < 3.0, 0, COMPENSATING)), named((2.9, 2)), star(3))
    first, second, last = text.splitlines()
    assert first.split() == ["recovery", "when", "consequence"]
    assert second.startswith(MODE_NAMES[COMPENSATING]) and MODE_CONSEQUENCES[COMPENSATING] in second
    assert last == describe_layout(star(3))


LANES = made(np.where(TIME < 3.0, NORMAL, np.where(TIME < 5.0, COMPENSATING, PIVOTING)))


def test_every_period_of_recovery_is_a_span_and_normal_driving_is_none():
    first, second = recovery_spans(LANES)
    assert (first.state, second.state) == (MODE_NAMES[COMPENSATING], MODE_NAMES[PIVOTING])
    assert np.allclose((first.start, first.end, second.start, second.end), (3.0, 5.0, 5.0, 9.99))
    assert first.lane == second.lane == RECOVERY
    assert recovery_spans(Trace({"time": TIME})) == []
    assert recovery_spans(made(0.0 * TIME)) == []


def test_the_report_has_a_strip_for_recovery():
    (panel,) = state_lanes(LANES, [], [], "robust", False).panels
    assert "active: recovery" in row_names(panel)
    assert MODE_NAMES[PIVOTING] in texts(panel)
