"""When a part is in use, and how far a run strays."""

from __future__ import annotations

import numpy as np
import pytest

from omnimj.plant.faults import Fault
from omnimj.signals import Trace
from omnimj.studies.part_use import (
    demanded_traction,
    departures,
    excursions,
    first_time,
    held_slip,
    in_use,
    time_after_use,
)

TIME = np.linspace(0.0, 0.999, 1000)


def traced(**columns) -> Trace:
    return Trace({"time": TIME, **columns})


def test_demanded_traction_is_the_mean_over_the_twenty_milliseconds_before():
    force = np.where(TIME < 0.5, 0.0, 4.0)
    zero = np.zeros_like(TIME)
    found = demanded_traction(
        traced(**{f"traction_force_{i}": -force if i == 2 else zero for i in (1, 2, 3, 4)})
    )
    naive = [abs(np.mean(-force[max(k - 19, 0) : k + 1])) for k in range(len(TIME))]
    assert np.allclose(found[:, 1], naive) and not found[:, [0, 2, 3]].any()


@pytest.mark.parametrize(
    ("fault", "first"),
    [
        (Fault("motor", 0.2, wheel=2), 0.5),
        (Fault("motor", 0.7, wheel=2), 0.7),
        (Fault("slip", 0.2, 0.4, wheel=2), None),
        (Fault("slip", 0.2, wheel=1), None),
        (Fault("all_wheel_slip", 0.1), 0.5),
        (Fault("hard_over", 0.1, wheel=1), 0.1),
        (Fault("sensor", 0.1, numbers={"channel": "yaw_rate"}), 0.1),
        (Fault("sensor", 0.1, numbers={"channel": "wheel_speed_2"}), 0.5),
        (Fault("sensor", 0.1, numbers={"channel": "wheel_speed_3"}), None),
    ],
)
def test_a_part_is_in_use_while_its_fault_holds_and_the_demand_on_its_wheel_exceeds_two_newtons(fault, first):
    traction = np.zeros((len(TIME), 4))
    traction[:, 0], traction[TIME >= 0.5, 1] = 2.0, 2.1
    found = first_time(TIME, in_use(fault, TIME, traction))
    assert found == (None if first is None else pytest.approx(first))


def test_time_in_use_adds_up_over_pauses():
    used = (TIME % 0.2 < 0.1) & (TIME >= 0.2)
    assert time_after_use(TIME, used, 0.15) == pytest.approx(0.449, abs=2e-3)
    assert time_after_use(TIME, used, 5.0) is None


def test_excursions_count_from_where_the_run_was_at_the_onset():
    drift, jump = 0.1 * TIME, np.where(TIME > 0.6, 0.3, 0.0)
    zero = np.zeros_like(TIME)
    trace = traced(
        heading=drift - jump,
        target_heading=zero,
        x=drift,
        y=jump + 5.0,
        target_x=zero,
        target_y=zero,
    )
    heading, path = excursions(trace, 0.5)
    assert heading == pytest.approx(0.3 - 0.1 * 0.1, abs=2e-3)
    assert path == pytest.approx(np.hypot(0.3, 0.0499), abs=1e-3)
    assert excursions(trace, 0.9)[0] == pytest.approx(0.01, abs=2e-3)


def test_a_slip_counts_as_far_as_it_is_held_for_twenty_milliseconds_in_either_direction():
    slip = np.zeros_like(TIME)
    slip[300:319], slip[500:520], slip[600:640] = 0.9, -0.3, 0.1
    slip[800:900] = 0.5
    trace = traced(slip_velocity_2=slip)
    assert held_slip(trace, 2, 0.2, 0.7) == 0.3
    assert held_slip(trace, 2, 0.2, np.inf) == 0.5
    assert held_slip(trace, 2, 0.505, 0.7) == 0.1
    assert held_slip(trace, 2, 0.95, np.inf) == 0.0


def test_departures_are_the_largest_differences_since_the_onset_whatever_the_target():
    zero = np.zeros_like(TIME)
    away = np.where(TIME < 0.2, 1.0, np.where(TIME > 0.6, 0.03, 0.0))
    one = traced(heading=3.1 + away, x=zero, y=4.0 * away)
    other = traced(heading=np.full_like(TIME, 3.1), x=-3.0 * away, y=zero)
    assert departures(one, other, 0.5) == pytest.approx((0.03, 0.15))
    assert departures(one, other, 0.1) == pytest.approx((1.0, 5.0))
