"""Commands that an actuator receives with a first-order lag, against scipy's integration of the lag."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lsim

from omnimj.estimate.replay.mjcf.delays import CommandPath, effective_commands

PERIOD, ROWS = 0.005, 400
lags = st.floats(-4.0, -0.5).map(lambda power: 10.0**power)


def received(commands, lag):
    found = np.empty(len(commands))
    stretches = np.array([[0, len(commands), 0, 0]])
    path = CommandPath(0.0, lag, -np.inf, np.inf)
    effective_commands(commands, stretches, PERIOD, path, False, found)
    return found


@pytest.mark.slow
@given(lags, st.integers(0, 2**32 - 1))
def test_a_lag_of_any_length_is_that_of_the_differential_equation(lag, seed):
    commands = np.cumsum(np.random.default_rng(seed).standard_normal(ROWS))
    times = np.arange(ROWS) * PERIOD
    _, exact, _ = lsim(([1.0], [lag, 1.0]), commands, times, X0=[lag * commands[0]])
    assert received(commands, lag) == pytest.approx(exact, abs=1e-6 * np.abs(commands).max())


@given(lags)
def test_a_ramp_arrives_late_by_the_lag(lag):
    ramp = np.arange(ROWS) * PERIOD
    late = ramp - received(ramp, lag)
    assert late[-1] == pytest.approx(lag * (1.0 - np.exp(-ramp[-1] / lag)), rel=1e-9)
