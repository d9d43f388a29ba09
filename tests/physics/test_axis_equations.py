"""Laws of the carriage on a guide: closed forms, an ODE solver, stiction, play."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from omnimj.effects import with_effects
from omnimj.parameters import read_axis
from omnimj.physics.axis import (
    AXIS_ROW,
    AXIS_STATE,
    DRIVE_SPEED,
    FORCE_SCALE,
    GAP,
    MASS,
    POSITION,
    SPEED,
    damping,
    dry_friction,
    frozen,
    steady_force,
    step,
)
from omnimj.plant.axis import axis_row

AXIS = read_axis()
REST = (0.0,) * AXIS_STATE


def with_extras(**effects):
    return with_effects(AXIS, effects)


def with_body(axis=AXIS, **entries):
    return dataclasses.replace(axis, axis=dataclasses.replace(axis.axis, **entries))


def run(axis, force, duration, h=1e-3, start=REST):
    row = frozen(axis_row(axis))
    states = [start]
    for k in range(round(duration / h)):
        push = force((k + 0.5) * h) if callable(force) else force
        states.append(step(row, states[-1], push, h))
    return np.array(states)


def test_the_row_holds_body_and_extras():
    row = axis_row(AXIS, 5.0)
    assert row.shape == (AXIS_ROW,)
    assert np.isfinite(row).all()
    assert row[MASS] == AXIS.axis.mass + 5.0


def test_an_axis_without_friction_obeys_newtons_law():
    states = run(with_body(coulomb=0.0, viscous=0.0), 50.0, 1.0)
    a = 50.0 / AXIS.axis.mass
    assert states[-1, SPEED] == pytest.approx(a, rel=1e-12)
    assert states[-1, POSITION] == pytest.approx(0.5 * a, rel=1e-9)


def test_speed_goes_to_its_limit_exponentially():
    states = run(AXIS, 60.0, 2.0)
    t = np.arange(len(states)) * 1e-3
    b, m, c = AXIS.axis.viscous, AXIS.axis.mass, AXIS.axis.coulomb
    expected = (60.0 - c) / b * -np.expm1(-b / m * t)
    assert np.allclose(states[:, SPEED], expected, atol=1e-6)


def test_a_force_below_dry_friction_moves_nothing():
    assert not run(AXIS, 19.99, 1.0)[:, :2].any()
    assert run(AXIS, 20.01, 1.0)[-1, POSITION] > 0.0


def test_a_coasting_carriage_stops_where_its_energy_is_spent_and_stays():
    start = (0.0, 0.3, 0.0, 0.3, 0.0)
    states = run(with_body(viscous=0.0), 0.0, 3.0, start=start)
    way = AXIS.axis.mass * 0.3**2 / (2.0 * AXIS.axis.coulomb)
    assert states[-1, POSITION] == pytest.approx(way, rel=1e-5)
    assert states[-1, SPEED] == 0.0


EXTRAS = {
    "asymmetric_viscous": {"difference": 80.0},
    "asymmetric_coulomb": {"difference": 8.0},
    "stribeck": {"force": 8.0, "velocity": 0.03},
    "position_friction": {"force": 10.0, "position": 0.03, "width": 0.01},
    "force_offset": {"force": -4.0},
    "grade": {"slope": 0.01},
    "cable_drag": {"stiffness": 60.0, "rest_position": 0.05},
    "air_drag": {"coefficient": 150.0},
    "force_scale": {"scale": 0.9},
}


def derivative(row, position, speed, force, smoothing):
    """Acceleration without play, sign(v) as tanh(v/smoothing)."""
    forward, backward = dry_friction(row, position, speed)
    direction = math.tanh(speed / smoothing)
    dry = 0.5 * ((1.0 + direction) * forward - (1.0 - direction) * backward)
    push = row[FORCE_SCALE] * force + steady_force(row, position)
    return (push - dry - damping(row, speed) * speed) / row[MASS]


def smooth_position(axis, force, t, smoothing):
    """Of an implicit solver with friction as tanh(v/smoothing)."""
    row = axis_row(axis)

    def rates(time, y):
        return [y[1], derivative(row, y[0], y[1], force(time), smoothing)]

    solved = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0], "LSODA", t, rtol=1e-9, atol=1e-11, max_step=2e-3)
    return solved.y[0]


@pytest.mark.parametrize("name", ["plain", *EXTRAS])
def test_each_term_agrees_with_an_ode_solver(name, measured):
    axis = with_extras(**{name: EXTRAS[name]}) if name in EXTRAS else AXIS

    def force(time):
        return 90.0 * math.sin(2.0 * math.pi * 0.9 * time)

    states = run(axis, force, 1.5)
    t = np.arange(len(states)) * 1e-3
    rough, fine = (smooth_position(axis, force, t, smoothing) for smoothing in (1e-4, 2e-5))
    reference = fine + 0.25 * (fine - rough)  # smoothing → 0, to first order
    error = float(np.abs(states[:, POSITION] - reference).max())
    measured("axis against solve_ivp [m]", error, 1e-5)
    assert error < 1e-5
    if name != "plain":
        plain = run(AXIS, force, 1.5)
        assert np.abs(plain[:, POSITION] - reference).max() > 50.0 * error


def test_half_the_step_changes_little():
    def force(time):
        return 80.0 * math.sin(6.0 * time)

    coarse, fine = run(AXIS, force, 2.0), run(AXIS, force, 2.0, h=2.5e-4)
    assert np.abs(coarse[:, POSITION] - fine[::4, POSITION]).max() < 1e-6


pushes, speeds, places = st.floats(-200.0, 200.0), st.floats(-0.5, 0.5), st.floats(-0.2, 0.2)


@given(pushes, speeds, places)
def test_mirrored_motion_is_the_mirror_of_the_motion(push, speed, place):
    extras = {
        "stribeck": {"force": 5.0},
        "air_drag": {"coefficient": 50.0},
        "cable_drag": {"stiffness": 20.0},
    }
    row = frozen(axis_row(with_extras(**extras)))
    one = step(row, (place, speed, 0.0, speed, 0.0), push, 1e-3)
    other = step(row, (-place, -speed, 0.0, -speed, 0.0), -push, 1e-3)
    assert np.allclose(one, -np.array(other), rtol=0.0, atol=1e-15)


@given(speeds, places)
def test_friction_takes_energy(speed, place):
    row = frozen(axis_row(with_extras(stribeck={"force": 5.0}, position_friction={"force": 5.0})))
    after = step(row, (place, speed, 0.0, speed, 0.0), 0.0, 1e-3)
    assert abs(after[SPEED]) <= abs(speed)
    assert after[SPEED] * speed >= 0.0


@given(pushes, speeds, st.floats(1.0, 200.0))
def test_more_mass_accelerates_less(push, speed, added):
    state = (0.0, speed, 0.0, speed, 0.0)
    rows = frozen(axis_row(AXIS)), frozen(axis_row(AXIS, added))
    a, b = (step(row, state, push, 1e-3)[SPEED] - speed for row in rows)
    assert abs(b) <= abs(a) + 1e-15


def test_dry_friction_of_either_direction_never_drives():
    axis = with_extras(asymmetric_coulomb={"difference": 100.0})
    assert not run(axis, 0.0, 0.5)[:, :2].any()


def test_an_offset_is_what_unequal_dry_friction_is():
    # [−C − d/2, C − d/2] either way: no data can split the two
    def force(time):
        return 70.0 * math.sin(5.0 * time)

    one = run(with_extras(asymmetric_coulomb={"difference": 6.0}), force, 2.0)
    other = run(with_extras(force_offset={"force": -3.0}), force, 2.0)
    assert np.allclose(one[:, POSITION], other[:, POSITION], atol=1e-9)


def test_with_play_the_drive_runs_ahead_alone_and_lands_with_the_common_momentum():
    axis = with_extras(backlash={"angle": 1e-3})
    m, c = AXIS.axis.drive_mass, AXIS.axis.coulomb
    start = (0.0, 0.0, -0.5e-3, 0.0, 0.0)
    states = run(axis, c, 0.3, h=1e-4, start=start)
    landing = int(np.flatnonzero(states[:, GAP] >= 0.5e-3)[0])
    assert landing * 1e-4 == pytest.approx(math.sqrt(2.0 * 1e-3 * m / c), rel=2e-3)
    assert not states[: landing - 1, POSITION].any()
    before = states[landing - 1, DRIVE_SPEED]
    assert states[landing, SPEED] == pytest.approx(m * before / AXIS.axis.mass, rel=0.01)
    assert np.abs(states[:, GAP]).max() <= 0.5e-3


def test_without_reversal_play_changes_nothing():
    start = (0.0, 0.0, 1e-3, 0.0, 0.0)
    one = run(with_extras(backlash={"angle": 2e-3}), 60.0, 1.0, start=start)
    assert np.allclose(one[:, :2], run(AXIS, 60.0, 1.0)[:, :2], atol=1e-12)
