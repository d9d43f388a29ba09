"""What every plant must do, whether simulated or behind a wire."""

from __future__ import annotations

import contextlib
import os

import numpy as np
import pytest
from wired_devices import PERIOD, ROBOT, WIRING, planar, served

from omnimj.link.host.link import open_link
from omnimj.link.host.plant import HardwarePlant
from omnimj.parameters import read_floors
from omnimj.plant.mujoco.twin import RobotTwin
from omnimj.signals import CurrentCommand, Measurement

posix = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are of POSIX")


@pytest.fixture(params=["twin", "planar", pytest.param("serial", marks=posix), "udp"])
def plant(request):
    with contextlib.ExitStack() as kept:
        if request.param == "twin":
            made = RobotTwin(ROBOT, floor=read_floors()["natural_stone"])
        elif request.param == "planar":
            made = planar()
        else:
            behind = planar()
            kept.callback(behind.close)
            address = kept.enter_context(served(behind, request.param))
            made = HardwarePlant(open_link(address, ROBOT, lock_step=True), WIRING)
        kept.callback(made.close)
        yield made


def driven(plant, current, steps=60):
    return [plant.step(CurrentCommand(np.array(current))) for _ in range(steps)]


def numbers(m: Measurement):
    return [m.time, *m.current, *m.wheel_speed, *m.acceleration, m.yaw_rate, m.yaw]


def test_a_run_begins_at_time_0_and_goes_on_by_the_period(plant):
    first = plant.reset()
    assert plant.period == PERIOD and first.time == 0.0
    assert [m.time for m in driven(plant, [0.0] * 4, 5)] == pytest.approx([PERIOD * k for k in range(1, 6)])


def test_a_measurement_has_four_wheels_finite_numbers_and_a_heading_within_one_turn(plant):
    for m in (plant.reset(), *driven(plant, [0.3, -0.3, 0.3, -0.3], 20)):
        assert m.current.shape == m.wheel_speed.shape == (4,) and m.acceleration.shape == (2,)
        assert np.isfinite(numbers(m)).all() and 0.0 <= m.yaw < 2.0 * np.pi


def test_wheels_turn_the_way_their_current_goes_and_rest_without(plant):
    plant.reset()
    assert np.abs(driven(plant, [0.0] * 4, 20)[-1].wheel_speed).max() < 0.1
    last = driven(plant, [0.6, -0.6, -0.6, 0.6])[-1]
    assert (last.wheel_speed * [1.0, -1.0, -1.0, 1.0] > 0.2).all()
    assert last.current == pytest.approx([0.6, -0.6, -0.6, 0.6], abs=0.1)


def test_the_same_commands_after_reset_are_the_same_run(plant):
    runs = []
    for _ in range(2):
        first = plant.reset()
        runs.append([numbers(m) for m in (first, *driven(plant, [0.5, 0.2, -0.1, 0.4], 30))])
    assert np.array_equal(runs[0], runs[1])


def test_truth_has_a_number_for_each_of_its_names(plant):
    plant.reset()
    driven(plant, [0.2] * 4, 2)
    assert len(plant.truth()) == len(plant.truth_names) and np.isfinite(plant.truth()).all()


def test_a_braked_motor_carries_no_current_of_its_amplifier(plant):
    plant.reset()
    for _ in range(40):
        m = plant.step(CurrentCommand(np.array([0.5, 0.0, 0.5, 0.0]), (2,)))
    assert np.isfinite(numbers(m)).all()


def test_closing_twice_is_closing(plant):
    plant.reset()
    plant.close()
    plant.close()
