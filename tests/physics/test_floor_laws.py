"""Laws of traction by creep ratio, of the ceiling and of the power of the load; standstill on every floor."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from steady_driving import settled_ratio

from omnimj.parameters import read_floors, read_rig
from omnimj.parameters.floor import CREEP_RATIO, LUGRE, MAGIC_FORMULA
from omnimj.parameters.parts import GRAVITY
from omnimj.physics import carriage
from omnimj.physics.effect_terms import terms_at, zero_terms
from omnimj.physics.motor import motor_parameters
from omnimj.physics.native import kernel
from omnimj.physics.rig import (
    RigModel,
    RigState,
    carriage_friction_bounds,
    lateral_force,
    rig_parameters,
    step,
)
from omnimj.physics.traction import exact_step, force_ratio, load_factor, mean_deflection, relaxation_rate
from omnimj.physics.wheel import roller_friction, wheel_on_floor, wheel_parameters

FLOORS, RIG = read_floors(), read_rig()
CREEP = [name for name, floor in FLOORS.items() if floor.law == "creep_ratio"]
LAWS = ("natural_stone", "dry_asphalt", "linoleum")
"""A floor of every law."""
REST = RigState(*[0.0] * len(RigState._fields))
speeds = st.floats(-3.0, 3.0)
creep_floors, every_floor = st.sampled_from(CREEP), st.sampled_from(sorted(FLOORS))


def changed(floor, **numbers):
    """The floor with other or further parameters."""
    return replace(floor, numbers={**floor.numbers, **numbers})


def brush(floor, creep):
    """F/F_N at the reference load by the definition of the brush model."""
    n = floor.numbers
    full = 3.0 * n["mu"] / n["creep_stiffness"]
    ratio = n["mu"] * (1.0 - (1.0 - min(abs(creep) / full, 1.0)) ** 3)
    return math.copysign(min(ratio, n.get("mu_cap", math.inf)), creep)


@kernel
def after(floor, z, rim, ground, h, sideways=0.0):
    """Deflection after a step, and the mean F/F_N over it."""
    slip, rolling = rim - ground, max(abs(rim), abs(ground))
    rate = relaxation_rate(floor, slip, math.hypot(rolling, sideways * (floor.law == CREEP_RATIO)))
    z_next = exact_step(z, slip, rate, h)
    return z_next, force_ratio(floor, mean_deflection(z, z_next, slip, rate, h), slip, rate)


@given(creep_floors, speeds, speeds, speeds)
def test_settled_traction_is_the_brush_model_of_the_creep_ratio(name, rim, ground, sideways):
    floor, rolling = FLOORS[name], math.hypot(max(abs(rim), abs(ground)), sideways)
    if rolling < 1e-3:
        return
    z = 0.0
    for _ in range(50):
        h = floor.numbers["relaxation_length"] / rolling
        z, ratio = after(floor.traction, z, rim, ground, h, sideways)
    closed = brush(floor, (rim - ground) / rolling)
    assert ratio == pytest.approx(closed, rel=1e-9, abs=1e-12)
    assert settled_ratio(floor.traction, rim - ground, rolling) == pytest.approx(closed, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("name", CREEP)
@pytest.mark.parametrize("rolling", [1e-3, 0.1, 2.0])
def test_at_small_creep_traction_grows_with_the_creep_stiffness_at_any_speed(name, rolling):
    floor = FLOORS[name]
    for creep in (1e-6, -1e-5):
        slope = settled_ratio(floor.traction, creep * rolling, rolling) / creep
        assert slope == pytest.approx(floor.numbers["creep_stiffness"], rel=1e-3)


@pytest.mark.parametrize("name", CREEP)
def test_deflection_follows_its_differential_equation(name):
    floor = FLOORS[name].traction
    for rim, ground, start in ((0.5, 0.49, 0.0), (0.3, 0.2, -0.001), (-0.4, 0.1, 0.002)):
        slip = rim - ground
        full = 3.0 * floor.mu / floor.creep_stiffness
        rate = max(abs(rim), abs(ground), abs(slip) / full) / floor.relaxation_length
        exact = solve_ivp(
            lambda _, z, v=slip, k=rate: v - k * z, (0.0, 0.05), [start], rtol=1e-11, atol=1e-14
        )
        assert after(floor, start, rim, ground, 0.05)[0] == pytest.approx(exact.y[0, -1], abs=1e-10)


@given(every_floor, st.floats(1e-3, 1.0), st.lists(st.tuples(speeds, speeds, st.floats(1e-5, 0.2))))
def test_traction_never_exceeds_its_ceiling_on_a_floor_of_any_law(name, ceiling, history):
    floor, z = changed(FLOORS[name], mu_cap=ceiling).traction, 0.0
    for rim, ground, h in history:
        z, ratio = after(floor, z, rim, ground, h)
        assert abs(ratio) <= ceiling


@given(creep_floors, st.lists(st.tuples(speeds, speeds, st.floats(1e-5, 0.2)), max_size=60))
def test_by_creep_ratio_traction_saturates_at_mu_and_the_contact_at_full_sliding(name, history):
    floor, z = FLOORS[name].traction, 0.0
    deepest = floor.relaxation_length * 3.0 * floor.mu / floor.creep_stiffness
    for rim, ground, h in history:
        z, ratio = after(floor, z, rim, ground, h)
        assert abs(z) <= deepest * (1.0 + 1e-9)
        assert abs(ratio) <= floor.mu * (1.0 + 1e-12)


@given(creep_floors, st.lists(st.tuples(speeds, speeds, st.floats(1e-5, 0.2)), min_size=1, max_size=60))
def test_by_creep_ratio_traction_only_takes_energy_out(name, history):
    floor, z, work = FLOORS[name].traction._replace(mu_cap=math.inf), 0.0, 0.0
    deepest = floor.relaxation_length * 3.0 * floor.mu / floor.creep_stiffness
    for rim, ground, h in history:
        z, ratio = after(floor, z, rim, ground, h)
        work += h * (rim - ground) * ratio
        sliding = min(abs(z) / deepest, 1.0)
        stored = floor.mu * deepest * (sliding - 0.25 * (1.0 - (1.0 - sliding) ** 4))  # ∫ F dz over F_N
        assert work >= stored - 1e-9


@given(creep_floors, st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(1e-6, 10.0))
def test_a_step_is_stable_at_any_slip_speed_and_any_length(name, rim, ground, h):
    floor, z = FLOORS[name].traction, 0.0
    settled = None
    for _ in range(20):
        z_next, ratio = after(floor, z, rim, ground, h)
        away = math.inf if settled is None else settled
        settled = abs(z_next - z)
        assert settled <= away * (1.0 + 1e-9) + 1e-12  # each step is smaller than the one before
        assert ratio * (rim - ground) >= 0.0
        z = z_next


@pytest.mark.parametrize("name", LAWS)
def test_doubling_the_load_multiplies_traction_by_a_power_of_two(name):
    for exponent in (0.6667, 0.9, 1.0, 1.3):
        floor = changed(FLOORS[name], load_exponent=exponent, reference_load=30.0).traction
        for load in (1.0, 30.0, 77.0):
            force = [n * load_factor(floor, n) for n in (load, 2.0 * load)]
            assert force[1] / force[0] == pytest.approx(2.0**exponent, rel=1e-12)
        assert 30.0 * load_factor(floor, 30.0) == 30.0  # the parameters are stated at the reference load
        assert load_factor(floor, 0.0) * 0.0 == 0.0


@given(st.floats(0.0, 1e4), st.floats(1e-3, 1e4))
def test_an_exponent_of_one_changes_no_bit(load, reference):
    floor = changed(FLOORS["pvc"], load_exponent=1.0, reference_load=reference).traction
    assert load_factor(floor, load) == 1.0


def rig_model(floor, mass=None):
    motor, terms = motor_parameters(RIG.motor), terms_at(zero_terms()[0])
    return RigModel(rig_parameters(RIG, mass), motor, floor.traction, terms, False)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("exponent", [0.6667, 1.0, 1.2])
def test_the_rig_with_twice_the_mass_has_the_traction_of_twice_the_load(name, exponent):
    floor = changed(FLOORS[name], load_exponent=exponent, reference_load=20.0)
    slipping = REST._replace(speed=0.5, wheel_speed=11.0, bristle=1e-4)
    forces = [step(slipping, 0.0, 0.0, rig_model(floor, m), 1e-3, 1)[1].traction for m in (1.5, 3.0)]
    assert forces[1] / forces[0] == pytest.approx(2.0**exponent, rel=1e-12)


@pytest.mark.parametrize("name", CREEP)
def test_at_its_top_speed_the_rig_creeps_by_the_inverse_of_the_brush_model(name):
    floor = changed(FLOORS[name], creep_stiffness=2.0)  # softer, so that the creep is not small
    model, state = rig_model(floor, 1.9593), REST
    for _ in range(60):
        state, out = step(state, 1.0, 0.0, model, 2.5e-4, 4000)
    weight = 1.9593 * GRAVITY
    resisting = -carriage_friction_bounds(model.rig, 0.0, state.speed, False)[0]
    share = resisting / (weight * load_factor(floor.traction, weight) * floor.numbers["mu"])
    full = 3.0 * floor.numbers["mu"] / 2.0
    creep = full * (1.0 - (1.0 - share) ** (1.0 / 3.0))
    rim = RIG.wheel.radius * state.wheel_speed
    assert rim > 0.5 and abs(out.acceleration) < 1e-9
    assert (rim - state.speed) / rim == pytest.approx(creep, rel=1e-6)


@kernel
def pull(floor, force, load, rising, h, sideways, rows):
    """Fill speed and position of a mass on a locked wheel, whose pull rises to a force and stays."""
    mass, speed, position, z = load / GRAVITY, 0.0, 0.0, 0.0
    for k in range(len(rows)):
        z, ratio = after(floor, z, 0.0, speed, h, sideways)
        risen = 0.5 * force * (1.0 - math.cos(math.pi * min(k * h / max(rising, h), 1.0)))
        speed += h * (risen + load * load_factor(floor, load) * ratio) / mass
        position += h * speed
        rows[k, 0], rows[k, 1] = speed, position


def pulled(floor, force, load=40.0, rising=4.0, at=(6.0,), h=1e-3, sideways=0.0):
    """Speed and position at some times of a mass on a locked wheel, whose pull rises to a force and stays.

    Its rollers turn at a given speed.
    """
    rows = np.empty((round(max(at) / h), 2))
    pull(floor, force, load, rising, h, sideways, rows)
    return rows[[round(seconds / h) - 1 for seconds in at]]


@pytest.mark.parametrize("name", sorted(FLOORS))
def test_at_rest_a_force_below_the_limit_is_held_without_creeping(name):
    floor = FLOORS[name].traction
    peak = {LUGRE: floor.mu_c, MAGIC_FORMULA: floor.D, CREEP_RATIO: floor.mu}[int(floor.law)]
    limit = 40.0 * load_factor(floor, 40.0) * min(peak, floor.mu_cap)
    for share in (0.1, 0.5, 0.8):
        early, late = pulled(floor, share * limit, at=(8.0, 12.0))
        assert abs(late[0]) < 1e-4 and abs(late[1] - early[1]) < 1e-4, share


@pytest.mark.parametrize("name", CREEP)
def test_a_held_mass_gives_way_by_the_closed_form_of_its_spring(name):
    floor = FLOORS[name].traction._replace(mu_cap=math.inf)
    limit = 40.0 * load_factor(floor, 40.0) * floor.mu
    deepest = floor.relaxation_length * 3.0 * floor.mu / floor.creep_stiffness
    for share in (0.05, 0.3, 0.7):
        ((speed, position),) = pulled(floor, share * limit)
        held = 1.0 - (1.0 - share) ** (1.0 / 3.0)
        # dz/dx = 1 - z/deepest: a part of the contact slides on the way
        assert abs(speed) < 1e-6
        assert position == pytest.approx(-deepest * math.log(1.0 - held), rel=0.01)


@pytest.mark.parametrize("name", CREEP)
def test_a_force_above_the_limit_accelerates_the_mass_by_the_difference(name):
    floor = FLOORS[name].traction
    limit = 40.0 * load_factor(floor, 40.0) * min(floor.mu, floor.mu_cap)
    ((speed, _),) = pulled(floor, 1.5 * limit, rising=0.0, at=(2.0,))
    assert speed == pytest.approx(2.0 * 0.5 * limit / (40.0 / GRAVITY), rel=0.02)


@pytest.mark.parametrize("name", CREEP)
@pytest.mark.parametrize("sideways", [0.05, -0.4])
def test_a_held_mass_that_rolls_across_its_wheel_creeps_by_the_inverse_of_the_brush_model(name, sideways):
    """The bristles that hold it leave the contact with the rolling of the rollers."""
    floor = FLOORS[name].traction._replace(mu_cap=math.inf)
    limit = 40.0 * load_factor(floor, 40.0) * floor.mu
    for share in (0.05, 0.3, 0.7):
        creep = full_creep(floor) * (1.0 - (1.0 - share) ** (1.0 / 3.0))
        ((speed, _),) = pulled(floor, share * limit, sideways=sideways)
        assert speed == pytest.approx(creep * math.hypot(speed, sideways), rel=1e-3)


def full_creep(floor):
    """Creep ratio of full sliding."""
    return 3.0 * floor.mu / floor.creep_stiffness


def soft(name, resistance):
    return changed(FLOORS[name], rolling_resistance=resistance)


rolling = st.lists(st.tuples(speeds, speeds, st.floats(1e-5, 0.05)), min_size=1, max_size=60)


@given(every_floor, st.floats(1e-3, 0.3), st.sampled_from([0.0, 1e-3, 0.02]), rolling)
def test_rollers_on_a_soft_floor_only_take_energy_out_however_its_direction_changes(
    name, resistance, dry, history
):
    floor, own = soft(name, resistance).traction, replace(RIG.wheel, roller_dry=dry, roller_viscous=0.0)
    wheel = wheel_parameters(own, RIG.bearing, RIG.motor)
    z = work = 0.0
    for ahead, sideways, h in history:
        now = wheel_on_floor(wheel, floor, ahead, 0.0, sideways)
        z, force = roller_friction(now, z, sideways, 1.0, h)
        work += force * sideways * h
        assert work >= 0.5 * wheel.roller_stiffness * z * z - 1e-12 * max(1.0, work)


@given(every_floor, st.floats(1e-3, 0.3), st.floats(0.02, 1.0), st.floats(-1.0, 1.0))
def test_rollers_that_go_on_rolling_are_resisted_by_their_part_of_the_rolling_resistance(
    name, resistance, sideways, ahead
):
    floor, z, force = soft(name, resistance).traction, 0.0, 0.0
    wheel = wheel_parameters(RIG.wheel, RIG.bearing, RIG.motor)
    for _ in range(40):
        now = wheel_on_floor(wheel, floor, ahead, 0.3 * ahead, sideways)
        z, force = roller_friction(now, z, sideways, 40.0, 0.1 / sideways)
    viscous = RIG.wheel.roller_viscous * sideways
    part = resistance * math.hypot(sideways, 1e-3) / math.hypot(sideways, ahead, 1e-3)
    assert force == pytest.approx(40.0 * (RIG.wheel.roller_dry + part + viscous), rel=1e-9)


def rig_run(floor, current, lateral, wheel=RIG.wheel, h=2.5e-4, periods=1500):
    rig = replace(RIG, wheel=wheel)
    motor, terms = motor_parameters(rig.motor), terms_at(zero_terms()[0])
    model, state, rows = RigModel(rig_parameters(rig), motor, floor.traction, terms, False), REST, []
    for _ in range(periods):
        state, out = step(state, current, lateral, model, h, round(1e-3 / h))
        rows.append((*state, *out))
    return np.array(rows)


@pytest.mark.slow
@pytest.mark.parametrize("name", LAWS)
def test_on_the_rig_a_floor_resists_rolling_as_the_wheel_does_while_the_gantry_stands(name):
    of_wheel = rig_run(FLOORS[name], 0.9, 0.0, replace(RIG.wheel, rolling_resistance=0.03))
    of_floor = rig_run(soft(name, 0.03), 0.9, 0.0)
    assert of_floor == pytest.approx(of_wheel, rel=1e-9, abs=1e-11)
    assert of_floor[-1, 0] < rig_run(FLOORS[name], 0.9, 0.0)[-1, 0] - 0.02


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("lateral", [0.3, -0.6])
def test_on_the_rig_a_floor_resists_carriage_and_rollers_in_the_direction_of_rolling(name, lateral):
    rows = rig_run(soft(name, 0.05), 0.9, lateral)
    weight, (speed, turning) = RIG.rig.masses[0] * GRAVITY, rows[-1, :2]
    ahead = max(abs(speed), RIG.wheel.radius * turning)
    aside = 0.05 * abs(lateral) / math.hypot(ahead, lateral)
    stiff = lateral_force(rig_parameters(RIG), lateral)
    added = (rows[-1, 12] - stiff) / weight
    assert added == pytest.approx(math.copysign(aside, lateral), rel=2e-3)
    bounds = carriage_friction_bounds(rig_parameters(RIG), rows[-1, 12], speed, False)
    along = -bounds[0] + 0.05 * weight * ahead / math.hypot(ahead, lateral)
    needed = RIG.rig.masses[0] * (rows[-1, 0] - rows[-2, 0]) / 1e-3 + along
    assert rows[-1, 11] == pytest.approx(needed, rel=2e-3)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("lateral", [0.0, 0.4])
def test_on_the_rig_halving_the_step_halves_its_error_on_a_soft_floor(name, lateral):
    coarse, fine, finest = (
        rig_run(soft(name, 0.05), 0.9, lateral, h=h, periods=600)[:, 0] for h in (5e-4, 2.5e-4, 1.25e-4)
    )
    assert np.abs(coarse - fine).max() < 2e-3
    assert np.abs(fine - finest).max() < 0.6 * np.abs(coarse - fine).max() + 1e-7


def test_a_carriage_of_given_wheel_speed_is_resisted_as_on_the_rig():
    own = carriage.CarriageParameters(3.0, 0.05, 2.0, 0.5, 0.0, 0.0, 0.0)
    heavier = own._replace(dry=2.0 + 0.04 * 3.0 * GRAVITY)
    wheel_speed, use = np.linspace(0.0, 20.0, 1000), np.ones((1000, 2))
    found = []
    for run, floor in ((own, soft("pvc", 0.04)), (heavier, FLOORS["pvc"])):
        blocks = np.empty((100, carriage.BLOCK))
        carriage.simulate_carriage(run, floor.traction, wheel_speed, 1e-3, 0.5, 10, use, blocks)
        found.append(blocks)
    assert found[0] == pytest.approx(found[1], rel=1e-9, abs=1e-12)
    across = np.empty((100, carriage.BLOCK))
    sideways = own._replace(lateral_speed=0.5)
    carriage.simulate_carriage(sideways, soft("pvc", 0.04).traction, wheel_speed, 1e-3, 0.5, 10, use, across)
    assert across[-1, carriage.SPEED] > found[0][-1, carriage.SPEED]
