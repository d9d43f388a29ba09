import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from published_map import rotation

from omnimj.control.cascade.heading import (
    YawRateGain,
    to_body,
    update_heading,
    wrapped,
    yaw_rate_demand,
    yaw_rate_gain,
)
from omnimj.parameters import read_robot

H, GYRO_RANGE = 1e-3, 6.981
ROBOT, LAGGING = read_robot(), YawRateGain(6.0, 0.25, 0.99)


def estimated(true_heading, yaw, yaw_rate):
    heading, found = true_heading[0], []
    for measured, rate in zip(yaw, yaw_rate, strict=True):
        heading = update_heading(heading, measured, rate, GYRO_RANGE, H)
        found.append(heading)
    return np.array(found)


def converter(heading):
    """12 bits within one turn, held for five samples."""
    step = 2.0 * np.pi / 4096
    return np.repeat((np.floor(heading[::5] / step) + 0.5) * step % (2.0 * np.pi), 5)[: len(heading)]


@given(st.floats(-100.0, 100.0))
def test_wrapped_is_the_same_direction_within_half_a_turn(angle):
    assert abs(wrapped(angle)) <= math.pi + 1e-12
    assert math.remainder(wrapped(angle) - angle, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("rate", [-3.0, -0.5, 0.0, 0.5, 3.0])
def test_estimate_is_unwrapped_through_many_turns_and_close_to_the_truth(rate):
    true = rate * np.arange(1, 20001) * H
    found = estimated(true, converter(true), np.full(len(true), rate))
    # the converter's word is 2 ms old on average: half of that hold is inherent
    assert np.abs(found[1000:] - true[1000:]).max() < 1.6e-3 + 3e-3 * abs(rate)


def test_estimate_is_smoother_than_the_converter_by_ten():
    true = 0.4 * np.arange(1, 5001) * H
    yaw = converter(true)
    found = estimated(true, yaw, np.full(len(true), 0.4))
    assert np.abs(np.diff(found) - 0.4 * H).max() < 0.1 * np.abs(np.diff(yaw)).max()


def test_gyro_bias_leaves_bias_times_filter_time():
    found = estimated(np.zeros(3000), np.zeros(3000), np.full(3000, 0.01))
    assert found[-1] == pytest.approx(0.01 * 0.1, rel=0.02)


def test_gyro_beyond_its_range_is_cut():
    beyond = update_heading(0.0, 0.0, 1e300, GYRO_RANGE, H)
    assert beyond == update_heading(0.0, 0.0, GYRO_RANGE, GYRO_RANGE, H)


@given(st.floats(-10.0, 10.0), st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_body_velocity_is_the_transposed_rotation(heading, x, y):
    assert to_body(x, y, heading) == pytest.approx(rotation(heading).T[:2, :2] @ [x, y], abs=1e-12)


def test_yaw_demand_is_the_target_when_it_is_met_and_open_loop_without_gains():
    assert yaw_rate_demand(0.7, 0.7, 0.0, LAGGING) == (pytest.approx(0.7), 0.0)
    assert yaw_rate_demand(0.7, -2.0, 0.0, LAGGING._replace(slow=0.0))[0] == 0.7


def test_without_a_lag_the_yaw_demand_answers_every_error_alike():
    same = LAGGING._replace(fast_share=1.0)
    for slow in (-1.0, 0.0, 1.0):
        assert yaw_rate_demand(0.0, 0.1, slow, same)[0] == pytest.approx(-0.6)


@pytest.mark.parametrize("frequency", [0.01, 0.8, 2.0, 8.0, 30.0, 100.0])
def test_yaw_gain_is_that_of_the_lag_at_every_frequency(frequency):
    """Amplitude and phase of the answer to a sine, against K (1 + s/ω)/(1 + ρ s/ω) in closed form."""
    gain = yaw_rate_gain(dataclasses.replace(ROBOT.control, yaw_rate_lag=4.0, yaw_rate_corner=8.0), H)
    period = round(1.0 / (frequency * H))
    settled = period * math.ceil(3000 / period)
    turned = np.exp(-2j * np.pi * np.arange(settled + period) / period)
    slow, answer = 0.0, np.empty(settled + period)
    for k, rate in enumerate(turned.real):
        answer[k], slow = yaw_rate_demand(0.0, -rate, slow, gain)
    found = 2.0 * np.mean((answer * turned.conj())[settled:])
    s = 1j / (period * H * 8.0)
    wanted = ROBOT.control.yaw_rate_proportional * (1.0 + s) / (1.0 + 4.0 * s)
    # a one-pole filter that is sampled leads the continuous one by half a period
    assert abs(found.conjugate() - wanted) < 0.02 * abs(wanted)
