"""What is gathered between two blocks."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from omnimj.control.detection.robust import RobustDetector, RobustState
from omnimj.control.detection.robust.blocks import (
    Block,
    Sample,
    Samples,
    initial_samples,
    move_to_centre,
    samples_per_block,
    sampling_parameters,
    take_block,
    take_sample,
)
from omnimj.control.records import copied, packed
from omnimj.parameters import read_robot
from omnimj.physics.native import kernel
from omnimj.signals import Measurement

ROBOT = read_robot()
BLOCK = samples_per_block(1e-3)
PARAMETERS = sampling_parameters(ROBOT, 1e-3)
PACKED = packed(PARAMETERS)


def gathered(current, speed, acceleration, turning, command, bias=0.0):
    """Rows of samples into an empty block."""
    samples = packed(initial_samples(4))
    for k in range(len(current)):
        sample = Sample(
            1e-3 * k, current[k], speed[k], acceleration[k], float(turning[k]), bias, True, command
        )
        samples["fresh"] = k == 0
        full = _take_sample(PACKED, samples, sample)
        assert full == (k + 1 >= BLOCK)
    return samples, Samples._make(copied(samples)[0])


@kernel
def _take_sample(parameters, samples, sample):
    return take_sample(parameters[0], samples[0], sample)


@kernel
def _take_block(samples, period):
    return take_block(samples[0], period)


def test_a_block_lasts_10_ms_whatever_the_rate_and_one_sample_where_they_come_slower():
    assert [samples_per_block(1.0 / rate) for rate in (2000, 1000, 500, 250, 100, 50)] == [20, 10, 5, 2, 1, 1]


def test_a_block_holds_the_sums_of_aligned_samples_and_what_the_amplifiers_still_owe():
    rng = np.random.default_rng(3)
    current, speed = rng.normal(size=(BLOCK, 4)), rng.normal(size=(BLOCK, 4))
    acceleration, turning = rng.normal(size=(BLOCK, 2)), 0.1 * rng.normal(size=BLOCK)
    command = np.array([0.3, -0.2, 0.1, 0.5])
    record, samples = gathered(current, speed, acceleration, turning, command, bias=0.02)
    read = np.column_stack((current, speed, acceleration, turning - 0.02))
    late = np.array(
        [[read[max(k - int(w), 0), c] for c, w in enumerate(PARAMETERS.waits)] for k in range(BLOCK)]
    )
    assert samples.number == BLOCK
    assert samples.total == pytest.approx(late.sum(axis=0)) and samples.aligned == pytest.approx(late[-1])
    assert samples.missing == pytest.approx((command - current).sum(axis=0))
    block, empty = _take_block(record, 1e-3), Samples._make(record[0])
    assert block.current == pytest.approx(late[:, :4].mean(axis=0))
    assert block.commanded == pytest.approx(block.current + (command - current).mean(axis=0))
    assert block.wheel_acceleration == pytest.approx((late[-1, 4:8] - late[0, 4:8]) / (1e-3 * BLOCK))
    assert empty.number == 0 and not empty.total.any() and not empty.missing.any()


def test_a_body_that_spins_about_its_centre_has_no_acceleration_there_wherever_it_is_measured():
    """Angle φ(t) = 0.8 t + 0.3 t²: the sensor at r reads the second derivative of its track R(φ) r."""
    place, t, h = np.array([0.09, -0.05]), 0.7, 1e-4
    track = np.array([np.exp(1j * (0.8 * s + 0.3 * s * s)) * complex(*place) for s in (t - h, t, t + h)])
    felt = (track[0] - 2.0 * track[1] + track[2]) / h**2 / np.exp(1j * (0.8 * t + 0.3 * t * t))
    read, none = np.array([felt.real + 0.2, felt.imag - 0.1]), np.zeros(4)
    assert abs(felt) > 0.1
    move_to_centre(place, Block(none, none, read, 0.8 + 0.6 * t, none, 0.6, none, 0.01))
    assert read == pytest.approx([0.2, -0.1], abs=1e-5)  # that of the centre itself


@pytest.mark.parametrize("spread", [0.0, 0.2, 0.45])
def test_a_ramp_has_its_slope_and_mean_in_every_block_whatever_is_missing_or_late(spread):
    """Speeds 20 t, currents 0.5 t; up to three readings in a row are lost, times jitter, readings return."""
    rng, record, blocks = np.random.default_rng(6), packed(initial_samples(4)), []
    time = 1e-3 * np.arange(400)
    time += 1e-3 * spread * rng.uniform(-1.0, 1.0, len(time))
    for t in np.repeat(time[np.cumsum(rng.integers(1, 5, 150))], rng.integers(1, 3, 150)):
        read = np.full(4, 0.5 * t), np.full(4, 20.0 * t), np.zeros(2), 0.1 * t
        if _take_sample(PACKED, record, Sample(t, *read, 0.0, False, np.zeros(4))):
            blocks += [(t, _take_block(record, 1e-3))]
    assert len(blocks) > 25
    late = 1e-3 * PARAMETERS.waits[0]
    for (before, _), (end, block) in itertools.pairwise(blocks[2:]):
        assert block.duration == pytest.approx(end - before, abs=1.1e-3)
        assert block.wheel_acceleration == pytest.approx(20.0, rel=0.02 + 0.25 * spread)
        middle = end - 0.5 * (end - before) - late
        assert block.current == pytest.approx(0.5 * middle, abs=0.5 * (1e-3 + 2e-3 * spread))


def test_a_reading_beyond_the_range_of_its_sensor_is_clipped():
    wild = np.full((1, 4), 1e6)
    _, samples = gathered(wild, -wild, 1e6 * np.ones((1, 2)), [-1e6], np.zeros(4))
    signs = np.array([1.0] * 4 + [-1.0] * 4 + [1.0, 1.0, -1.0])
    assert samples.number == 1 and samples.total == pytest.approx(signs * PARAMETERS.ranges)


def test_a_step_leaves_the_state_before_it_as_it_was():
    method = RobustDetector(ROBOT)
    rng = np.random.default_rng(4)
    rows = [measurement(1e-3 * k, rng.normal(size=11)) for k in range(3 * BLOCK)]
    state = method.start(rows[0])
    for measured in rows:
        before = [array.tobytes() for array in arrays_of(state)]
        after = method.step(state, measured, 0.1 * measured.current)
        assert [array.tobytes() for array in arrays_of(state)] == before
        state = after


def measurement(time, noise):
    return Measurement(time, noise[:4], 5.0 + noise[4:8], noise[8:10], 0.1 * noise[10], 0.0)


def arrays_of(value):
    """Every array within nested tuples and a state."""
    if isinstance(value, np.ndarray):
        return [value]
    if isinstance(value, tuple):
        return [array for part in value for array in arrays_of(part)]
    if isinstance(value, RobustState):
        return arrays_of((value.samples, value.memory, value.judged))
    return []
