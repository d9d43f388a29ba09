"""A controller that runs for hours needs no more memory than one that runs for minutes."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from omnimj.bench import control as control_speed
from omnimj.bench.control import (
    PASSING_SLIP,
    SLIP_AND_WEAK_MOTOR,
    full_controller,
    memory_growth,
    record_mission,
    replay_mission,
)
from omnimj.control.compiled import CompiledController
from omnimj.control.detection.robust import verdict
from omnimj.parameters import read_robot

ROBOT = read_robot()


@pytest.fixture(scope="module")
def slipping():
    """Ten seconds in which a wheel slips and grips again."""
    return record_mission(ROBOT, 10.0, PASSING_SLIP)


@pytest.mark.slow
def test_memory_after_forty_thousand_steps_is_memory_after_twenty_thousand(slipping, monkeypatch):
    monkeypatch.setattr(verdict, "HISTORY_LENGTH", 1)  # an hour's diagnoses in a minute
    monkeypatch.setattr(control_speed, "WARM_UP_MISSIONS", 2)
    growth = memory_growth(slipping, 2, memory=sys.getallocatedblocks)
    assert growth.seconds == pytest.approx(20.0) and growth.diagnoses > 0
    assert abs(growth.grown) < 400  # blocks of Python's memory, one for 50 steps


@pytest.mark.slow
def test_what_is_kept_from_step_to_step_is_seen(monkeypatch):
    kept, step = [], CompiledController.step

    def hoarding(controller, state, measurement, target):
        kept.append(state.log)
        return step(controller, state, measurement, target)

    monkeypatch.setattr(control_speed, "WARM_UP_MISSIONS", 0)
    monkeypatch.setattr(CompiledController, "step", hoarding)
    mission = record_mission(ROBOT, 4.0)
    assert memory_growth(mission, 1).grown > 1000.0
    assert memory_growth(mission, 1, memory=sys.getallocatedblocks).grown > 4000


@pytest.mark.slow
def test_a_replay_ends_with_what_the_drive_ended_with():
    driven = record_mission(ROBOT, 12.0, SLIP_AND_WEAK_MOTOR)
    controller = full_controller(ROBOT)
    again = replay_mission(controller, controller.start(driven.measurements[0]), driven, 0)
    assert again.diagnoses == driven.last.diagnoses and np.array_equal(again.log, driven.last.log)
    assert again.diagnoses  # something was found
