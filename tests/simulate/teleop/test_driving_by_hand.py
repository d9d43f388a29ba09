"""The loop without an end, on the planar robot and in simulated time."""

from __future__ import annotations

import numpy as np
import pytest

from omnimj.errors import SimulationError
from omnimj.simulate.detectors import make_detector
from omnimj.simulate.plants import make_plant
from omnimj.simulate.run import make_diagnosing_controller
from omnimj.simulate.teleop.driving import (
    RealTimePacer,
    RowBuffer,
    TeleopCallbacks,
    drive_by_hand,
    free_drive,
)
from omnimj.simulate.teleop.steering import KEY_HOLD_TIME, Key, Steering, SteeringLimits

H = 0.001


class Hands:
    """Types by the number of the step, and ends."""

    def __init__(self, typed, steps):
        self.steering, self.typed, self.steps, self.k = Steering(SteeringLimits()), typed, steps, 0

    def target(self, heading, time_scaling):
        if self.k == self.steps:
            return None
        for key in self.typed.get(self.k, ()):
            self.steering.on_key(self.k * H, key)
        self.k += 1
        return self.steering.target((self.k - 1) * H, H, heading, time_scaling)


def by_hand(typed, steps, kept=100_000, floor="natural_stone", **callbacks):
    scenario = free_drive(floor)
    plant, recent = make_plant(scenario, "planar", 1), RowBuffer(kept)
    controller = make_diagnosing_controller(scenario, make_detector("robust", scenario))
    hands = Hands(typed, steps)
    driven = drive_by_hand(plant, controller, hands.target, TeleopCallbacks(rows=(recent.add,), **callbacks))
    plant.close()
    return driven, recent.trace({})


def test_a_held_key_drives_straight_and_the_robot_stands_soon_after_it_is_let_go():
    typed = dict.fromkeys(range(0, 1500, 30), (Key.FORWARD,))
    driven, trace = by_hand(typed, 3500)
    assert driven.steps == 3500 == len(trace["time"]) and not driven.interrupted and not driven.diagnoses
    np.testing.assert_allclose(trace["time"], np.arange(3500) * H, atol=1e-9)
    cruising = slice(1000, 1500)
    assert trace["twist_x"][cruising].mean() == pytest.approx(0.3, rel=0.02)
    assert np.abs(trace["heading"]).max() < 0.01 and np.abs(trace["y"]).max() < 0.01
    let_go = 1470 + round((KEY_HOLD_TIME + 0.3) / H)
    assert not trace["target_velocity_x"][let_go:].any()
    assert np.abs(trace["twist_x"][let_go + 600 :]).max() < 0.002
    assert "residual_force_x" in trace and trace["target_heading"].shape == (3500,)


def test_a_robot_without_commands_stands():
    _, trace = by_hand({}, 1500)
    assert np.abs(trace["current_target_1"]).max() == 0.0 and np.abs(trace["x"]).max() < 1e-6


def test_what_is_kept_is_the_newest_and_bounded():
    sizes = []

    def watched(names, block):
        sizes.append(len(block))

    scenario = free_drive()
    plant, recent = make_plant(scenario, "planar", 1), RowBuffer(250)
    watch = TeleopCallbacks(rows=(recent.add, watched))
    driven = drive_by_hand(plant, make_diagnosing_controller(scenario, None), Hands({}, 1030).target, watch)
    assert driven.steps == sum(sizes) == 1030
    assert 250 <= recent.rows < 350 and recent.trace({})["time"][-1] == pytest.approx(1.029)
    empty = RowBuffer(0)
    empty.add(("time",), np.zeros((5, 1)))
    assert empty.rows == 0


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SimulationError("it fell over")])
def test_whatever_ends_it_what_was_recorded_is_there(error):
    def fails(self=None, left=[300]):  # noqa: B006 counts down
        left[0] -= 1
        if not left[0]:
            raise error

    driven, trace = by_hand({}, 1000, before_step=fails)
    assert len(trace["time"]) == driven.steps == 300
    assert driven.interrupted is isinstance(error, KeyboardInterrupt)
    assert (driven.failure is None) is driven.interrupted and "after 0.300 s: it" in (
        driven.failure or "after 0.300 s: it"
    )


class WallClock:
    def __init__(self):
        self.now, self.slept = 5.0, 0.0

    def sleep(self, duration):
        self.now += duration
        self.slept += duration


@pytest.mark.parametrize(("work", "factor"), [(0.0002, 1.0), (0.002, 0.5)])
def test_a_simulation_is_held_to_the_wall_clock_and_reports_when_it_cannot_keep_up(work, factor):
    clock = WallClock()
    pace = RealTimePacer(H, lambda: clock.now, clock.sleep)
    for _ in range(5000):
        pace.wait()
        clock.now += work
    assert pace.factor == pytest.approx(factor, rel=1e-3)
    assert pace.lost == pytest.approx(5.0 * (1 / factor - 1), abs=0.11)


def test_lost_time_is_not_made_up_by_a_faster_simulation():
    clock = WallClock()
    pace = RealTimePacer(H, lambda: clock.now, clock.sleep)
    pace.wait()
    clock.now += 2.0
    begin = clock.now
    for _ in range(1000):
        pace.wait()
    assert clock.now - begin == pytest.approx(1.0, abs=0.01) and pace.lost == pytest.approx(2.0, abs=0.01)
