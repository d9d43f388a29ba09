"""Commands by hand: none lasts, none jumps up, and all can be stopped at once."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnimj.errors import InputError
from omnimj.simulate.teleop.steering import (
    BRAKING_DECELERATION,
    DIRECTIONS,
    KEY_HOLD_TIME,
    LOCKOUT_AFTER_STOP,
    MAX_HEADING_LEAD,
    STICK_TIMEOUT,
    TURN_ARM,
    Key,
    Steering,
    SteeringLimits,
    StickState,
)

H = 0.001
LIMITS = SteeringLimits(speed=0.4, turn=0.8, acceleration=0.5)


def driven(events, duration, heading=0.0, limits=LIMITS):
    """Twists of all steps; `events` maps the number of a step to what happens then."""
    steering, twists = Steering(limits), []
    for k in range(round(duration / H)):
        for happens in events.get(k, ()):
            happens(steering, k * H)
        steering.target(k * H, H, heading)
        twists.append(steering.twist)
    return np.array(twists)


def key(which):
    return lambda steering, now: steering.on_key(now, which)


def held(which, begin, end, every=33):
    return {k: (key(which),) for k in range(begin, end, every)}


def test_a_held_key_drives_up_to_the_limit_and_no_further_and_a_key_let_go_ends_it():
    twists = driven(held(Key.FORWARD, 0, 1500), 3.0)
    assert twists[:, 0].max() == pytest.approx(0.4) and not twists[:, 1:].any()
    last = range(0, 1500, 33)[-1]
    zero = np.flatnonzero(twists[last:, 0] == 0.0)[0]
    assert zero == pytest.approx((KEY_HOLD_TIME + 0.4 / BRAKING_DECELERATION) / H, abs=3)
    assert not twists[last + zero :].any()


@pytest.mark.parametrize(
    ("which", "axis", "sign"),
    [
        (Key.FORWARD, 0, 1),
        (Key.BACK, 0, -1),
        (Key.LEFT, 1, 1),
        (Key.RIGHT, 1, -1),
        (Key.TURN_LEFT, 2, 1),
        (Key.TURN_RIGHT, 2, -1),
    ],
)
def test_every_key_drives_its_direction(which, axis, sign):
    twists = driven({0: (key(which),)}, 0.2)
    assert sign * twists[-1, axis] > 0.05 and not np.delete(twists, axis, axis=1).any()


def test_the_newest_of_two_opposite_keys_counts():
    twists = driven({0: (key(Key.FORWARD),), 50: (key(Key.BACK),)}, 0.35)
    assert twists[49, 0] > 0.0 > twists[-1, 0]


@pytest.mark.parametrize("stopper", [Key.STOP, Key.END])
def test_a_stop_takes_no_ramp_and_ignores_keys_for_a_moment(stopper):
    events: dict = held(Key.FORWARD, 0, 2000, 10)
    events[600] = (key(Key.FORWARD), key(stopper), key(Key.FORWARD))
    twists = driven(events, 2.0)
    assert twists[599, 0] > 0.25
    still = twists[600 : round(600 + LOCKOUT_AFTER_STOP / H)]
    assert not still.any() and twists[-1, 0] > 0.25, "a key that is held on drives on"


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 1500), st.sampled_from(sorted(Key, key=str))), max_size=60),
    st.floats(0.05, 1.0),
    st.floats(0.05, 2.0),
    st.floats(0.05, 1.0),
)
def test_whatever_is_typed_the_limits_hold_and_all_of_it_ends(typed, speed, turn, acceleration):
    limits, events = SteeringLimits(speed, turn, acceleration), {}
    for k, which in typed:
        events.setdefault(k, []).append(key(which))
    twists = driven(events, 4.0, limits=limits)
    assert np.hypot(twists[:, 0], twists[:, 1]).max() <= speed * (1 + 1e-9)
    assert np.abs(twists[:, 2]).max() <= turn
    stops = np.array([any(w not in DIRECTIONS for j, w in typed if j == k) for k in range(len(twists))])
    hardest = max(acceleration, BRAKING_DECELERATION)
    change = np.diff(twists, axis=0)[~stops[1:]]
    assert np.hypot(change[:, 0], change[:, 1]).max() <= hardest * H * (1 + 1e-9)
    assert np.abs(change[:, 2]).max() <= hardest / TURN_ARM * H * (1 + 1e-9)
    rises = np.diff(np.hypot(twists[:, 0], twists[:, 1]))
    assert rises.max() <= acceleration * H * (1 + 1e-9)
    newest = max((k for k, w in typed if w in DIRECTIONS), default=0)
    ends = newest * H + KEY_HOLD_TIME + max(speed / hardest, turn * TURN_ARM / hardest) + 0.002
    assert not twists[min(round(ends / H), len(twists) - 1) :].any()


@settings(deadline=None)
@given(st.floats(-4.0, 4.0))
def test_forward_is_along_the_robot_s_heading(heading):
    steering = Steering(LIMITS)
    steering.on_key(0.0, Key.FORWARD)
    for k in range(250):
        target = steering.target(k * H, H, heading)
    speed = steering.twist[0]
    assert target.velocity == pytest.approx((speed * math.cos(heading), speed * math.sin(heading)))
    assert target.yaw_rate == 0.0 and target.heading == pytest.approx(heading)


def test_a_robot_that_was_turned_by_hand_while_it_stood_is_not_turned_back():
    steering = Steering(LIMITS)
    assert steering.target(0.0, H, 0.3).heading == 0.3
    assert steering.target(H, H, 2.0).heading == 2.0
    steering.on_key(0.01, Key.FORWARD)
    steering.target(0.01, H, 2.0)
    for k in range(200):  # it is pushed about while it drives: the plan stays within reach
        target = steering.target(0.01 + k * H, H, 2.5)
    assert target.heading == pytest.approx(2.5 - MAX_HEADING_LEAD)


def test_recovery_may_slow_everything_down():
    steering = Steering(LIMITS)
    for which in (Key.LEFT, Key.TURN_LEFT):
        steering.on_key(0.0, which)
    for k in range(200):
        target = steering.target(k * H, H, 0.0, time_scaling=0.5)
    assert target.velocity == pytest.approx((0.0, 0.5 * steering.twist[1]))
    assert target.yaw_rate == pytest.approx(0.5 * steering.twist[2])


def stick(forward=1.0, held=True):
    return lambda steering, now: steering.on_stick(now, StickState(forward=forward, held=held))


def test_a_stick_drives_while_the_dead_man_s_button_is_held():
    twists = driven({0: (stick(0.5),), 900: (stick(0.5, held=False),)}, 1.5)
    assert twists[:, 0].max() == pytest.approx(0.2) and twists[899, 0] > 0.0 and not twists[-1].any()
    assert not driven({0: (stick(held=False),)}, 1.0).any()


def test_a_stick_that_sends_nothing_any_more_stops_the_robot():
    twists = driven({0: (stick(),)}, STICK_TIMEOUT + 1.0)
    assert twists[round(STICK_TIMEOUT / H) - 1, 0] == pytest.approx(0.4) and not twists[-1].any()


def test_after_a_stop_the_dead_man_s_button_must_be_let_go_first():
    events = {0: (stick(),), 500: (lambda s, now: s.stop(now),)}
    events |= {k: (stick(),) for k in range(510, 2000, 10)}
    assert not driven(events, 2.0)[500:].any()
    events[1500] = (stick(held=False),)
    assert driven(events, 2.0)[-1, 0] > 0.0


def test_keys_go_before_sticks():
    assert driven({0: (stick(), key(Key.BACK))}, 0.2)[-1, 0] < 0.0


@pytest.mark.parametrize("name", ["speed", "turn", "acceleration", "hold"])
@pytest.mark.parametrize("value", [0.0, -1.0, 2.5, math.nan, math.inf])
def test_limits_that_are_none_are_one_clear_line(name, value):
    with pytest.raises(InputError, match=f"--{name}: found .* must be above 0 and at most"):
        SteeringLimits(**{name: value})
