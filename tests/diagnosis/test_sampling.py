"""A log as the controller would have sampled it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from omnimj.diagnosis.logs import require_rates, resample, rows_at
from omnimj.errors import InputError
from omnimj.recording.dataset import Dataset, Run

PERIOD = 1e-3


def run_of(time, masked=None, **columns) -> Run:
    return Run("one", {"time": time, **columns}, masked or {}, {"floor": "natural_stone"})


def at_rate(rate: float, seconds: float = 1.0, start: float = 0.0):
    return start + np.arange(round(rate * seconds) + 1) / rate


def test_rows_at_the_controllers_own_rate_are_taken_as_they_are():
    time = at_rate(1000.0) + 1e-4 * np.random.default_rng(1).uniform(-1.0, 1.0, 1001)
    noise = np.random.default_rng(2).normal(size=1001)
    (piece,) = resample(run_of(time, a=noise), ("a",), (), PERIOD).segments
    assert np.array_equal(piece.columns[:, 0], noise) and np.array_equal(piece.time, time)


@pytest.mark.parametrize("rate", [100.0, 400.0, 2000.0])
@pytest.mark.parametrize("start", [0.0, 1.7e9])
def test_other_rates_are_interpolated_and_lines_stay_lines(rate, start):
    time = at_rate(rate, start=start)
    found = resample(run_of(time, a=3.0 * (time - start) - 1.0), ("a",), (), PERIOD)
    (piece,) = found.segments
    assert len(piece.time) == pytest.approx(1001, abs=1)
    assert np.allclose(piece.columns[:, 0], 3.0 * (piece.time - start) - 1.0, atol=1e-5)
    assert "interpolated linearly" in found.notes[0]


def test_a_set_current_ends_the_period_after_its_row():
    time, values = at_rate(1000.0), np.arange(1001.0)
    (piece,) = resample(run_of(time, a=values, u=values), ("a",), ("u",), PERIOD).segments
    assert piece.command is not None and np.array_equal(piece.command[1:, 0], values[:-1])
    (piece,) = resample(
        run_of(at_rate(2000.0), a=np.arange(2001.0), u=np.arange(2001.0)), ("a",), ("u",), PERIOD
    ).segments
    assert piece.command is not None
    assert set(np.round(2000.0 * piece.time[1:] - piece.command[1:, 0])) <= {1.0, 2.0}


def test_set_currents_of_slow_logs_are_not_used_and_that_is_reported():
    time = at_rate(200.0)
    found = resample(run_of(time, a=time, u=time), ("a",), ("u",), PERIOD)
    assert found.segments[0].command is None and "commanded currents" in found.notes[0]


def test_an_angle_is_interpolated_through_its_wrap():
    time = at_rate(100.0)
    true = 6.0 + time
    (piece,) = resample(run_of(time, yaw=true % (2.0 * math.pi)), ("yaw",), (), PERIOD, ("yaw",)).segments
    apart = (piece.columns[:, 0] - 6.0 - piece.time + math.pi) % (2.0 * math.pi) - math.pi
    assert np.abs(apart).max() < 1e-9
    assert piece.columns.min() >= 0.0 and piece.columns.max() < 2.0 * math.pi


@pytest.mark.parametrize(("lost", "pieces"), [(1, 1), (4, 1), (5, 2), (21, 2), (300, 2)])
def test_masked_rows_are_left_out_and_long_gaps_split(lost, pieces):
    time = at_rate(1000.0)
    masked = np.zeros(1001, bool)
    masked[400 : 400 + lost] = True
    values = np.where(masked, 1e6, time)
    found = resample(run_of(time, {"a": masked}, a=values), ("a",), (), PERIOD)
    assert len(found.segments) == pieces
    assert max(piece.columns.max() for piece in found.segments) <= 1.0
    assert found.samples == 1001 - (lost if pieces == 2 else 0)
    assert f"{lost} of 1001 rows are masked" in found.notes[0]


def test_a_mask_on_a_column_that_the_method_does_not_get_takes_nothing_away():
    time = at_rate(1000.0)
    found = resample(run_of(time, {"x": np.ones(1001, bool)}, a=time, x=time), ("a",), (), PERIOD)
    assert found.samples == 1001 and not found.notes


def test_below_100_samples_per_second_is_refused():
    def data(rate):
        return Dataset(__file__, "uto_robot", (run_of(at_rate(rate, 2.0)),))  # pyright: ignore[reportArgumentType]

    require_rates(data(100.0))
    with pytest.raises(InputError, match=r"run 'one': has 99 per second; diagnosis needs at least 100"):
        require_rates(data(99.0))


def test_each_row_of_the_log_gets_the_newest_sample_until_then():
    assert rows_at(np.array([0.0, 1.0, 2.0]), np.array([-1.0, 0.0, 0.5, 1.0, 9.0])).tolist() == [
        0,
        0,
        0,
        1,
        2,
    ]
