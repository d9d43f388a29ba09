"""A simulated sensor has the lag, delay, scale and offset of its model."""

from __future__ import annotations

import numpy as np
import pytest

from omnimj.estimate.replay.rig.kernels import BlockLayout, SensorModel, observe

SIZE, BLOCKS = 10, 30
LAYOUT = BlockLayout(np.array([0, SIZE * BLOCKS]), np.array([0, BLOCKS]), SIZE)


def observed(series, lag=0.0, delay=0.0, scale=1.0, offset=0.0):
    result = np.empty(BLOCKS)
    observe(series, LAYOUT, SensorModel(lag, delay, scale, offset), result)
    return result


def test_an_ideal_sensor_gives_block_means():
    series = np.random.default_rng(0).normal(size=SIZE * BLOCKS)
    assert observed(series) == pytest.approx(series.reshape(BLOCKS, SIZE).mean(axis=1), abs=1e-12)


def test_scale_and_offset_act_on_the_mean():
    series = np.random.default_rng(1).normal(size=SIZE * BLOCKS)
    assert observed(series, scale=-2.0, offset=0.3) == pytest.approx(-2.0 * observed(series) + 0.3, abs=1e-12)


@pytest.mark.parametrize("delay", [SIZE, 3 * SIZE])
def test_a_delay_of_whole_blocks_shifts_them(delay):
    series = np.random.default_rng(2).normal(size=SIZE * BLOCKS)
    shifted = observed(series, delay=float(delay))
    assert shifted[delay // SIZE :] == pytest.approx(observed(series)[: -delay // SIZE], abs=1e-12)
    assert shifted[: delay // SIZE] == pytest.approx(series[0], abs=1e-12)


@pytest.mark.parametrize("delay", [0.4, 2.5, -1.3])
def test_a_ramp_is_late_by_a_delay_between_samples(delay):
    series = np.arange(SIZE * BLOCKS, dtype=float)
    away = observed(series) - observed(series, delay=delay)
    assert away[3:-3] == pytest.approx(delay, abs=1e-9)


def test_a_lag_makes_the_step_response_exponential():
    series = np.ones(SIZE * BLOCKS)
    series[0], lag = 0.0, 25.0
    n = np.arange(SIZE * BLOCKS)
    response = 1.0 - np.exp(-n / lag)
    assert observed(series, lag=lag) == pytest.approx(response.reshape(BLOCKS, SIZE).mean(axis=1), abs=1e-12)
