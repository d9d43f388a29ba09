"""What is gathered between two blocks."""

from __future__ import annotations

import numpy as np
import pytest

from omnimj.control.cascade.wheel_speed import amplifier_row
from omnimj.control.detection.robust import RobustDetector
from omnimj.control.detection.robust.blocks import (
    alignment_delays,
    channel_ranges,
    initial_samples,
    take_sample,
)
from omnimj.control.robot_constants import samples_per_block
from omnimj.parameters import read_robot
from omnimj.signals import Measurement

ROBOT = read_robot()
BLOCK = samples_per_block(1e-3)
WAITS, RANGES, AMPLIFIER = alignment_delays(ROBOT, 1e-3), channel_ranges(ROBOT), amplifier_row(ROBOT)


def gathered(current, speed, acceleration, turning, command, bias=0.0):
    """Rows of samples into an empty block."""
    held = initial_samples(4)
    arrays, now, full = (held.sums, held.line, held.repeats, held.wanted), None, False
    for k in range(len(current)):
        *arrays, now, full = take_sample(
            WAITS, RANGES, AMPLIFIER, BLOCK, *arrays, k == 0,
            current[k], speed[k], acceleration[k], turning[k], bias, True, command,
        )  # fmt: skip
    return arrays, now, full


def test_a_block_lasts_10_ms_whatever_the_rate_and_one_sample_where_they_come_slower():
    assert [samples_per_block(1.0 / rate) for rate in (2000, 1000, 500, 250, 100, 50)] == [20, 10, 5, 2, 1, 1]


def test_a_block_holds_the_sums_of_aligned_samples_and_what_the_amplifiers_still_owe():
    rng = np.random.default_rng(3)
    current, speed = rng.normal(size=(BLOCK, 4)), rng.normal(size=(BLOCK, 4))
    acceleration, turning = rng.normal(size=(BLOCK, 2)), 0.1 * rng.normal(size=BLOCK)
    command = np.array([0.3, -0.2, 0.1, 0.5])
    (sums, _, _, wanted), now, full = gathered(current, speed, acceleration, turning, command, bias=0.02)
    said = np.column_stack((current, speed, acceleration, turning - 0.02))
    late = np.array([[said[max(k - int(w), 0), c] for c, w in enumerate(WAITS)] for k in range(BLOCK)])
    assert full and sums[0] == BLOCK
    assert sums[1:12] == pytest.approx(late.sum(axis=0)) and now == pytest.approx(late[-1])
    assert wanted == pytest.approx((command - current).sum(axis=0))


def test_a_reading_beyond_the_range_of_its_sensor_is_cut():
    wild = np.full((1, 4), 1e6)
    (sums, _, _, _), _, full = gathered(wild, -wild, 1e6 * np.ones((1, 2)), [-1e6], np.zeros(4))
    signs = np.array([1.0] * 4 + [-1.0] * 4 + [1.0, 1.0, -1.0])
    assert not full and sums[1:12] == pytest.approx(signs * RANGES)


def test_a_step_leaves_the_state_before_it_as_it_was():
    method = RobustDetector(ROBOT)
    rng = np.random.default_rng(4)
    rows = [said(1e-3 * k, rng.normal(size=11)) for k in range(3 * BLOCK)]
    state = method.start(rows[0])
    for measured in rows:
        before = [array.tobytes() for array in arrays_of(state)]
        after = method.step(state, measured, 0.1 * measured.current)
        assert [array.tobytes() for array in arrays_of(state)] == before
        state = after


def said(time, noise):
    return Measurement(time, noise[:4], 5.0 + noise[4:8], noise[8:10], 0.1 * noise[10], 0.0)


def arrays_of(state):
    held, evidence = state.samples, state.evidence
    own = (held.sums, held.line, held.repeats, held.wanted, state.accepted, state.log)
    return (*own, *(getattr(evidence, name) for name in evidence.__slots__))
