"""The form of a creep law is the one that made the slip."""

from __future__ import annotations

import numpy as np
import pytest

from omnimj.estimate.robot.creep import FORMS, _held_out, _Problem
from omnimj.estimate.robot.slip import SlipSamples


def samples(law, seed=3):
    rng = np.random.default_rng(seed)
    k = 6000
    traction, rolling = rng.uniform(-0.15, 0.15, k), rng.uniform(0.1, 0.9, k) * rng.choice([-1.0, 1.0], k)
    slip = law(traction, np.abs(rolling)) + rng.normal(0.0, 0.004, k)
    return SlipSamples(slip, traction, rolling, rng.integers(0, 4, k), np.arange(k) // 1000, 6)


@pytest.mark.parametrize(
    "form, law",
    [
        ("slip speed", lambda x, speed: x / 2.5),
        ("creep ratio", lambda x, speed: speed * x / 1.3),
    ],
)
def test_held_out_runs_tell_slip_speed_from_creep_ratio(form, law):
    made = samples(law)
    errors = {name: _held_out(_Problem(name, made, 2e-3), 6) for name in FORMS[::2]}
    assert min(errors, key=errors.__getitem__) == form
    assert min(errors.values()) == pytest.approx(0.004, rel=0.1)


def test_the_slope_and_the_radii_come_back():
    made = samples(lambda x, speed: x / 2.5)
    larger = made.slip - 0.003 * made.rolling * (made.wheel == 2)
    changed = SlipSamples(larger, made.traction, made.rolling, made.wheel, made.run, 6)
    problem = _Problem("slip speed", changed, 2e-3)
    found = problem.fitted(np.ones(len(larger), bool))
    assert np.exp(found[0]) == pytest.approx(2.5, rel=0.01)
    assert found[1:] == pytest.approx([0.0, 0.0, 0.003, 0.0], abs=5e-4)
