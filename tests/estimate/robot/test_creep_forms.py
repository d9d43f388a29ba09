"""The form of a creep law is the one that made the slip."""

from __future__ import annotations

import numpy as np
import pytest

from omnimj.estimate.robot.creep import FORMS, _held_out, _Problem
from omnimj.estimate.robot.files import as_floor
from omnimj.estimate.robot.records import CreepForm, FloorCreep
from omnimj.estimate.robot.slip import SlipSamples
from omnimj.parameters import read_floors
from omnimj.parameters.floor import format_floor
from omnimj.physics.traction import creep_traction


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


@pytest.mark.parametrize(
    "numbers", [{"slope": 1.3}, {"slope": 0.2, "ceiling": 0.12, "onset": 0.02}, {"slope": 6.0}]
)
def test_a_law_by_creep_ratio_is_written_as_one(numbers, tmp_path):
    name = "creep ratio, saturating" if "ceiling" in numbers else "creep ratio"
    form = CreepForm(name, numbers, 0.004)
    around = {key: (0.95 * value, 1.05 * value) for key, value in numbers.items()}
    floor, _ = as_floor(FloorCreep("felt", form, (form,), around, 0.03, 12, ("run",)))
    (tmp_path / "floors.toml").write_text(format_floor(floor, ()), encoding="utf-8")
    read = read_floors(tmp_path / "floors.toml")["felt"]
    assert read.law == "creep_ratio"
    for creep in (0.01, 0.03, 0.06):
        law = (
            numbers.get("ceiling", 0.0) * np.tanh(creep / numbers.get("onset", 1.0))
            + numbers["slope"] * creep
        )
        assert creep_traction(read.traction, creep) == pytest.approx(law, rel=0.12)
