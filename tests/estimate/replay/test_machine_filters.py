"""The filter of a balance of forces: one for acceleration, speed and force."""

import numpy as np
import pytest
from scipy.ndimage import correlate1d
from scipy.signal import savgol_filter

from omnimj.estimate.replay.mjcf.filters import (
    add_filtered,
    filtered,
    filtered_speed,
    limited_speed,
    local_cubic,
    same_filter,
)
from omnimj.signals import Array

PERIOD = 0.002
TIME: Array = np.arange(600, dtype=float) * PERIOD


@pytest.mark.parametrize("width", [5, 9, 17, 35])
def test_its_weights_have_the_sum_one_and_no_shift(width):
    weights = same_filter(width)
    assert len(weights) == width and weights.min() > 0.0
    assert weights.sum() == pytest.approx(1.0, abs=1e-12)
    assert weights == pytest.approx(weights[::-1], abs=1e-12)


@pytest.mark.parametrize("width", [5, 9, 17, 35])
@pytest.mark.parametrize("frequency", [1.0, 5.0, 12.0])
def test_a_filtered_force_is_that_of_the_filtered_motion_at_every_frequency(width, frequency):
    rate, inside = 2.0 * np.pi * frequency, slice(width, -width)
    place = np.sin(rate * TIME + 0.3)
    speed, bend = rate * np.cos(rate * TIME + 0.3), -(rate**2) * place
    estimate = np.asarray(savgol_filter(place, width, 3, deriv=2, delta=PERIOD))
    step = rate * PERIOD
    assert np.abs(filtered(bend, width) - estimate)[inside].max() < rate**2 * step**4
    difference = filtered(speed, width) - filtered_speed(place, width, PERIOD)
    assert np.abs(difference)[inside].max() < rate * step**2


def test_a_local_cubic_of_the_force_is_not():
    rate, width = 2.0 * np.pi * 5.0, 17
    place, reach = np.sin(rate * TIME), 8.5 * PERIOD
    estimate = np.asarray(savgol_filter(place, width, 3, deriv=2, delta=PERIOD))
    lacks = (np.asarray(savgol_filter(-(rate**2) * place, width, 3)) - estimate)[width:-width]
    expected = (-(rate**4) * reach**2 / 14.0 * place)[width:-width]
    assert lacks == pytest.approx(expected, abs=0.1 * np.abs(expected).max())


def test_the_ends_are_local_cubics():
    values = TIME**3 - TIME
    assert filtered(values, 9)[:4] == pytest.approx(values[:4], abs=1e-9)
    assert filtered_speed(values, 9, PERIOD)[-4:] == pytest.approx((3.0 * TIME**2 - 1.0)[-4:], abs=1e-6)


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("width", [5, 17, 151])
def test_a_local_cubic_is_that_of_scipy(width, order):
    values = np.random.default_rng(width).standard_normal(151)
    expected = np.asarray(savgol_filter(values, width, 3, deriv=order, delta=PERIOD))
    found = local_cubic(values, width, order, PERIOD)
    assert found == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("width", [1, 5, 17])
def test_a_column_is_filtered_within_its_stretches_as_by_scipy(width):
    rng = np.random.default_rng(width)
    values, weights, found = rng.normal(size=(60, 2)), rng.normal(size=width), np.ones((60, 2))
    stretches = np.array([[0, 7, 0, 0], [7, 8, 0, 0], [8, 60, 0, 0]])
    add_filtered(values, 1, stretches, weights, found)
    parts = [correlate1d(values[a:b, 1], weights, mode="nearest") for a, b, *_ in stretches.tolist()]
    assert found[:, 1] == pytest.approx(1.0 + np.concatenate(parts), abs=1e-12)
    assert (found[:, 0] == 1.0).all()


@pytest.mark.parametrize("width", [5, 9, 17, 35])
def test_a_joint_that_stops_never_seems_to_move_backwards(width):
    left = np.maximum(0.6 - TIME, 0.0)
    place = -(left**2)  # friction brakes it at 2 m/s² until it rests
    cubic = np.asarray(savgol_filter(place, width, 3, deriv=1, delta=PERIOD))
    assert cubic.min() < -0.01 * 2.0 * (width // 2) * PERIOD
    found = limited_speed(place, cubic, width, PERIOD)
    assert found.min() >= -1e-12
    assert np.abs(found[left == 0.0]).max() < 1e-12


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_limited_speed_is_that_of_a_steady_motion(sign):
    steady = np.full(TIME.shape, 0.3 * sign)
    found = limited_speed(steady * TIME, steady, 17, PERIOD)[17:-17]
    assert found == pytest.approx(steady[17:-17], abs=1e-12)


def test_a_limited_speed_under_a_constant_acceleration_is_that_nearest_to_rest_within_a_quarter_width():
    speed, quarter = 4.0 * (TIME - 0.6), 0.25 * 16 * PERIOD
    found = limited_speed(2.0 * (TIME - 0.6) ** 2, speed, 17, PERIOD)[17:-17]
    expected = np.sign(speed) * np.maximum(np.abs(speed) - 4.0 * quarter, 0.0)
    assert found == pytest.approx(expected[17:-17], abs=1e-9)
