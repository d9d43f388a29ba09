"""Laws of the traction between wheel and floor."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp
from steady_driving import settled_ratio

from omnimj.parameters import read_floors
from omnimj.parameters.floor import LUGRE as LUGRE_LAW
from omnimj.parameters.floor import TractionParameters
from omnimj.physics.traction import (
    exact_step,
    force_ratio,
    mean_deflection,
    passive_damping,
    relaxation_rate,
    rolling_resistance,
    rolling_speed,
)

FLOORS = read_floors()
LUGRE = [name for name, floor in FLOORS.items() if floor.law == "lugre" and "mu_cap" not in floor.numbers]
CAPPED = [name for name, floor in FLOORS.items() if "mu_cap" in floor.numbers]
MAGIC = [name for name, floor in FLOORS.items() if floor.law == "magic_formula"]

slips = st.floats(-3.0, 3.0)
steps = st.floats(1e-6, 1.0)


def _stribeck(floor, slip):
    q = floor.numbers
    return q["mu_c"] + (q["mu_s"] - q["mu_c"]) * math.exp(-(abs(slip / q["V_s"]) ** 0.5))


def _settled(floor, slip, reference_speed, h=1e-3, time=None):
    rate = relaxation_rate(floor.traction, slip, reference_speed)
    z = 0.0
    for _ in range(round((time or 40.0 / rate) / h) + 1):
        z = exact_step(z, slip, rate, h)
    return force_ratio(floor.traction, z, slip, rate)


@pytest.mark.parametrize("name", LUGRE)
@pytest.mark.parametrize("slip", [-1.2, -0.3, -0.01, 0.02, 0.4, 1.2])
def test_steady_traction_is_the_closed_form(name, slip):
    floor = FLOORS[name]
    closed = _stribeck(floor, slip) * math.copysign(1.0, slip) + floor.numbers["sigma_2"] * slip
    assert _settled(floor, slip, 1.0) == pytest.approx(closed, rel=1e-12)
    assert settled_ratio(floor.traction, slip, 1.0) == pytest.approx(closed, rel=1e-12)


@pytest.mark.parametrize("name", LUGRE)
@pytest.mark.parametrize("slip", [-0.8, 0.003, 0.25])
def test_exact_step_agrees_with_an_adaptive_integrator(name, slip):
    q, g = FLOORS[name].numbers, _stribeck(FLOORS[name], slip)
    solution = solve_ivp(
        lambda _, z: slip - q["sigma_0"] * abs(slip) / g * z, (0.0, 0.05), [0.002], rtol=1e-11, atol=1e-13
    )
    rate = relaxation_rate(FLOORS[name].traction, slip, 1.0)
    assert exact_step(0.002, slip, rate, 0.05) == pytest.approx(solution.y[0, -1], abs=1e-10)


@given(st.floats(-0.05, 0.05), slips, st.floats(0.0, 1e5), steps)
def test_two_half_steps_are_one_step(z, slip, rate, h):
    half = exact_step(exact_step(z, slip, rate, 0.5 * h), slip, rate, 0.5 * h)
    # below a rate of 1e-9 per step the decay is left out, which is its relative error
    assert half == pytest.approx(exact_step(z, slip, rate, h), rel=1e-8, abs=1e-12)


@given(st.sampled_from(LUGRE), st.lists(st.tuples(slips, steps), min_size=1, max_size=50))
def test_bristle_never_passes_its_largest_deflection(name, history):
    floor, z = FLOORS[name], 0.0
    for slip, h in history:
        z = exact_step(z, slip, relaxation_rate(floor.traction, slip, 3.0), h)
        assert abs(z) <= floor.numbers["mu_s"] / floor.numbers["sigma_0"] * (1.0 + 1e-9)


@given(st.sampled_from(sorted(FLOORS)), st.floats(-0.02, 0.02), slips, st.floats(0.01, 3.0))
def test_traction_is_odd(name, z, slip, reference_speed):
    floor_law = FLOORS[name].traction
    rate = relaxation_rate(floor_law, slip, reference_speed)
    assert relaxation_rate(floor_law, -slip, reference_speed) == rate
    assert force_ratio(floor_law, -z, -slip, rate) == -force_ratio(floor_law, z, slip, rate)


@given(st.floats(-0.02, 0.02), slips, st.floats(1e-3, 1e4), st.floats(1e-5, 0.1))
def test_mean_deflection_is_the_integral_over_the_step(z, slip, rate, h):
    stiff = [min(h, k / rate) for k in (1.0, 3.0, 10.0, 30.0)]
    total, _ = quad(
        lambda t: exact_step(z, slip, rate, t), 0.0, h, points=stiff, limit=200, epsabs=1e-15, epsrel=1e-10
    )
    mean = mean_deflection(z, exact_step(z, slip, rate, h), slip, rate, h)
    assert mean == pytest.approx(total / h, rel=1e-6, abs=1e-8)


def lugre_floors():
    """LuGre floors of any friction, from one that is nearly dry friction to one that is mostly damping."""
    return st.builds(
        lambda mu_c, more, speed, stiffness, damping, viscous: TractionParameters(
            law=float(LUGRE_LAW), mu_c=mu_c, mu_s=mu_c * (1.0 + more), V_s=speed,
            sigma_0=stiffness, sigma_1=damping, sigma_2=viscous,
        ),
        st.floats(0.01, 1.0), st.floats(0.0, 4.0), st.floats(1e-3, 1.0),
        st.floats(10.0, 1e4), st.floats(0.0, 50.0), st.floats(0.0, 3.0),
    )  # fmt: skip


histories = st.lists(st.tuples(slips, st.floats(1e-5, 0.2)), min_size=1, max_size=60)


@given(st.one_of(st.sampled_from([FLOORS[name].traction for name in LUGRE]), lugre_floors()), histories)
@example(FLOORS["nylon_sheet"].traction, [(-0.015625, 0.125), (-3.0, 1e-5)])
def test_traction_only_takes_energy_out(floor, history):
    z = work = 0.0
    for slip, h in history:
        rate = relaxation_rate(floor, slip, 3.0)
        z_next = exact_step(z, slip, rate, h)
        work += h * slip * force_ratio(floor, mean_deflection(z, z_next, slip, rate, h), slip, rate)
        z = z_next
        stored = 0.5 * floor.sigma_0 * z * z  # per newton of normal force
        assert work >= stored - 1e-9 * max(1.0, work)


@pytest.mark.parametrize("name", LUGRE)
def test_the_damping_is_the_largest_that_keeps_traction_passive(name):
    """Second route: the smallest eigenvalue of the quadratic form of the power in ż and λ z."""
    floor = FLOORS[name].traction

    def least_power(damping, rate):
        viscous = floor.sigma_2
        cross = 0.5 * damping + viscous
        form = [[damping + viscous, cross], [cross, floor.sigma_0 / rate + viscous]]
        return np.linalg.eigvalsh(form)[0]

    for slip in np.geomspace(1e-3, 5.0, 30):
        rate = relaxation_rate(floor, slip, 3.0)
        damping = passive_damping(floor, rate)
        assert least_power(damping, rate) >= -1e-12
        assert damping == floor.sigma_1 or least_power(1.001 * damping, rate) < 0.0


@given(st.sampled_from(sorted(FLOORS)), slips, slips, slips)
def test_a_contact_rolls_along_its_drive_and_by_creep_ratio_in_any_direction(name, rim, along, sideways):
    floor, ahead = FLOORS[name], max(abs(rim), abs(along))
    across = sideways if floor.law == "creep_ratio" else 0.0
    found = rolling_speed(floor.traction, rim, along, sideways)
    assert found == pytest.approx(math.hypot(ahead, across), rel=1e-12, abs=1e-150)
    assert rolling_speed(floor.traction, rim, along, 0.0) == ahead


@given(st.sampled_from(sorted(FLOORS)), st.floats(1e-6, 1.0), st.floats(0.1, 3.0), st.floats(0.0, math.tau))
def test_rolling_resistance_is_one_force_against_the_direction_of_rolling(name, resistance, speed, angle):
    floor = FLOORS[name].traction._replace(rolling_resistance=resistance)
    ahead, aside = abs(speed * math.cos(angle)), speed * math.sin(angle)
    on_wheel, on_rollers = rolling_resistance(floor, ahead, aside)
    # 1 mm/s, below which it is smooth, is at most a hundredth of the speed
    assert math.hypot(on_wheel, on_rollers) == pytest.approx(resistance, rel=1e-4)
    assert on_wheel == pytest.approx(resistance * ahead / speed, abs=0.01 * resistance)
    assert on_rollers == pytest.approx(resistance * abs(aside) / speed, abs=0.01 * resistance)


@given(st.sampled_from(sorted(FLOORS)), st.floats(0.0, 1.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_rollers_resist_more_than_the_wheel_by_a_share_with_the_direction_and_one_without(
    name, more, ahead, aside
):
    plain = FLOORS[name].traction._replace(rolling_resistance=0.1)
    on_wheel, on_rollers = rolling_resistance(plain, abs(ahead), aside)
    found = rolling_resistance(plain._replace(roller_resistance=more, roller_dry=0.02), abs(ahead), aside)
    # resistance over 0.1 is the share of the rollers in the direction
    assert found == pytest.approx((on_wheel, on_rollers * (1.0 + more / 0.1) + 0.02), rel=1e-12)
    alone = FLOORS[name].traction._replace(roller_resistance=more, roller_dry=0.02)
    on_wheel, on_rollers_alone = rolling_resistance(alone, abs(ahead), aside)
    assert on_wheel == 0.0
    assert on_rollers_alone == pytest.approx(on_rollers * more / 0.1 + 0.02, rel=1e-12)


@pytest.mark.parametrize("name", sorted(FLOORS))
def test_rolling_resistance_holds_in_full_at_rest_and_vanishes_across_a_wheel_that_rolls_along(name):
    floor = FLOORS[name].traction._replace(rolling_resistance=0.03)
    assert rolling_resistance(floor, 0.0, 0.0) == pytest.approx((0.03, 0.03), rel=1e-12)
    for speed in (0.02, 0.5, 3.0):
        along, across = rolling_resistance(floor, speed, 0.0), rolling_resistance(floor, 0.0, speed)
        assert along == across[::-1]
        assert along[0] == pytest.approx(0.03, rel=1e-12)
        assert along[1] <= 0.03 * 1e-3 / speed
    assert rolling_resistance(FLOORS[name].traction, 0.7, -0.2) == (0.0, 0.0)


@given(st.sampled_from(CAPPED), st.floats(-0.02, 0.02), slips)
def test_a_capped_floor_follows_its_law_up_to_its_ceiling(name, z, slip):
    floor_law = FLOORS[name].traction
    without_cap = floor_law._replace(mu_cap=math.inf)
    rate, cap = relaxation_rate(floor_law, slip, 1.0), FLOORS[name].numbers["mu_cap"]
    free = force_ratio(without_cap, z, slip, rate)
    assert force_ratio(floor_law, z, slip, rate) == (free if abs(free) <= cap else math.copysign(cap, free))


@pytest.mark.parametrize(
    ("name", "slip_ratio", "force"),
    # Table 3.1 and Eq. 3.18 at B s = ±1: D sin(C atan(1 − E (1 − π/4)))
    [("dry_asphalt", 0.1, 0.9558), ("ice", -0.25, -0.09715), ("snow", 0.2, 0.29146)],
)
def test_magic_formula_at_known_slip_ratios(name, slip_ratio, force):
    assert settled_ratio(FLOORS[name].traction, slip_ratio, 1.0) == pytest.approx(force, abs=1e-4)


@pytest.mark.parametrize("name", MAGIC)
@pytest.mark.parametrize(("rim", "ground"), [(1.0, 0.9), (1.0, 0.2), (0.3, 0.9), (-1.0, -0.6), (-0.2, -0.8)])
def test_magic_formula_settles_at_the_slip_ratio_of_the_text(name, rim, ground):
    q = FLOORS[name].numbers
    ratio = 1.0 - ground / rim if abs(rim) > abs(ground) else rim / ground - 1.0
    x = q["B"] * ratio * math.copysign(1.0, rim)
    closed = q["D"] * math.sin(q["C"] * math.atan(x - q["E"] * (x - math.atan(x))))
    assert _settled(FLOORS[name], rim - ground, max(abs(rim), abs(ground))) == pytest.approx(closed, rel=1e-9)
