"""The axis' test plan: it stays on the guide, excites what it should, and logs what a logger would."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from axis_logs import axis_moves

from omnimj.effects import with_effects
from omnimj.parameters import read_axis
from omnimj.simulate.suites.axis import MOVES, highest_speed, strokes, sweep, wander

AXIS = read_axis()
SMALL = dataclasses.replace(
    AXIS,
    axis=dataclasses.replace(
        AXIS.axis, mass=2.0, drive_mass=0.5, coulomb=0.8, viscous=5.0, force_limit=40.0, travel=0.06
    ),
)


@pytest.mark.parametrize("axis", [AXIS, SMALL], ids=["shipped", "small"])
def test_every_move_stays_on_the_guide_and_below_the_force(axis):
    for run in axis_moves(axis, 0, 1):
        assert np.abs(run.columns["position"]).max() < axis.axis.travel
        assert np.abs(run.columns["force"]).max() < 0.9 * axis.axis.force_limit
        assert np.ptp(run.columns["position"]) > 0.05 * axis.axis.travel


def test_every_move_goes_both_ways():
    for run in axis_moves(AXIS, 0, 1):
        speed = np.diff(run.columns["position"])
        assert (speed > 1e-5).sum() > 1000
        assert (speed < -1e-5).sum() > 1000


def test_repeats_share_a_condition_and_differ_in_noise():
    runs = axis_moves(AXIS, 4, 2, duration=2.0)
    assert len(runs) == 2 * len(MOVES)
    assert len({r.condition for r in runs}) == len(MOVES)
    assert not np.array_equal(runs[0].columns["force"], runs[1].columns["force"])


def test_a_seed_makes_the_same_dataset_again():
    one, other = (axis_moves(AXIS, 9, 1, duration=2.0) for _ in range(2))
    for a, b in zip(one, other, strict=True):
        assert all(np.array_equal(a.columns[c], b.columns[c]) for c in a.columns)


def test_a_payload_is_declared_by_the_mass():
    runs = axis_moves(AXIS, 0, 1, duration=2.0)
    loaded = [r for r in runs if "mass" in r.conditions]
    assert [r.condition for r in loaded] == ["with_payload"]
    assert loaded[0].conditions["mass"] == pytest.approx(1.1 * AXIS.axis.mass)


def test_what_the_model_lacks_is_not_declared():
    heavy = with_effects(AXIS, {"payload": {"mass": 20.0}})
    for run in axis_moves(heavy, 0, 1, duration=1.0, declared=AXIS):
        assert float(run.conditions.get("mass", AXIS.axis.mass)) <= 1.1 * AXIS.axis.mass


def test_a_log_of_current_is_force_over_its_constant():
    force = axis_moves(AXIS, 0, 1, duration=1.0)[0].columns["force"]
    current = axis_moves(AXIS, 0, 1, duration=1.0, current=True, velocity=True)[0].columns
    assert set(current) == {"time", "current", "position", "velocity"}
    assert np.allclose(current["current"] * AXIS.axis.force_constant, force)


@pytest.mark.parametrize(
    "path",
    [
        strokes(0.2, (0.3, 0.1), 0.5, 8.0, 1e-3),
        sweep(0.05, 0.3, 3.0, 0.1, 8.0, 1e-3),
        wander(0.2, 0.3, 8.0, 1e-3),
    ],
    ids=["strokes", "sweep", "wander"],
)
def test_a_path_is_its_speed_s_integral_and_starts_at_rest(path):
    x, v, a = path.T
    assert np.allclose(np.cumsum(0.5 * (v[1:] + v[:-1])) * 1e-3, x[1:] - x[0], atol=1e-9)
    assert v[0] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(a).max() < 3.0


def test_strokes_come_back_to_where_they_turned():
    path = strokes(0.2, (0.3,), 0.5, 20.0, 1e-3)
    assert path[:, 0].min() == pytest.approx(-0.2, abs=1e-6)
    assert path[:, 0].max() == pytest.approx(0.2, abs=1e-6)


def test_full_speed_suits_the_force():
    assert 0.0 < highest_speed(AXIS) * AXIS.axis.viscous + AXIS.axis.coulomb < 0.5 * AXIS.axis.force_limit
