"""Laws of the rig model and the published figures that its constants were chosen for."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from nightly import in_turn
from rig_reference import integrate

from omnimj.parameters import read_floors, read_rig
from omnimj.physics.effect_terms import terms_at, zero_terms
from omnimj.physics.motor import motor_parameters
from omnimj.physics.rig import OUTPUT, RigModel, RigState, rail_friction, rig_parameters, step

RIG, FLOORS = read_rig(), read_floors()
# with more resistance to its rollers, one row of them lifts off in the reference
FLOORS["soft"] = dataclasses.replace(
    FLOORS["pvc"], numbers={**FLOORS["pvc"].numbers, "rolling_resistance": 0.008}
)
NONE, REST = terms_at(zero_terms()[0]), RigState(*[0.0] * len(RigState._fields))
WEIGHT = 3.9593 * 9.81
WITHOUT_BEARING = dataclasses.replace(RIG, bearing=dataclasses.replace(RIG.bearing, dry=0.0))
# every term that is zero in the shipped rig has a value here
EVERYTHING = dataclasses.replace(
    RIG,
    wheel=dataclasses.replace(RIG.wheel, rolling_resistance=0.01),
    bearing=dataclasses.replace(RIG.bearing, viscous=0.002),
    rig=dataclasses.replace(RIG.rig, contact_offset=0.01, com_offset=-0.004, rail_viscous=0.05),
)


def _model(rig=RIG, floor="natural_stone", mass=None, published=False):
    motor, traction = motor_parameters(rig.motor), FLOORS[floor].traction
    return RigModel(rig_parameters(rig, mass), motor, traction, NONE, published)


def _run(current, floor="natural_stone", mass=3.9593, duration=2.0, lateral=0.0, published=False, rig=RIG):
    state, model = REST, _model(rig, floor, mass, published)
    states, outputs = [state], [[0.0] * OUTPUT]
    for _ in range(round(duration * 1000)):
        state, output = step(state, current, lateral, model, 2.5e-4, 4)
        states.append(state)
        outputs.append(output)
    return np.array(states), np.array(outputs)


@pytest.mark.parametrize(
    ("floor", "mass"),
    in_turn(["natural_stone", "pvc", "paperboard", "natural_stone_capped", "oil"], RIG.rig.masses),
)
def test_fixed_step_agrees_with_the_independent_reference(floor, mass):
    for current in (0.15, 0.2, 0.45, 0.75, 1.05, 1.5):
        _, speed, wheel_speed = integrate(RIG, FLOORS[floor], mass, current, 1.5)
        states, _ = _run(current, floor, mass, 1.5)
        assert np.sqrt(np.mean((states[:, 0] - speed) ** 2)) < 5e-4
        assert np.sqrt(np.mean((states[:, 1] - wheel_speed) ** 2)) * RIG.wheel.radius < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(("lateral", "floor"), in_turn([0.65, -0.2, -0.65, 0.2], ["natural_stone", "soft"]))
def test_fixed_step_agrees_with_the_reference_while_moving_sideways(lateral, floor):
    for current in (0.6, 1.5):
        _, speed, _ = integrate(RIG, FLOORS[floor], 3.9593, current, 1.5, lateral)
        states, _ = _run(current, floor, lateral=lateral, duration=1.5)
        assert np.sqrt(np.mean((states[:, 0] - speed) ** 2)) < 5e-4


@pytest.mark.parametrize(("lateral", "floor"), [(0.5, "pvc"), (-0.5, "soft"), (0.0, "soft")])
def test_every_term_of_the_equations_is_the_references(lateral, floor):
    for current in (1.0, -1.3):
        _, speed, wheel_speed = integrate(EVERYTHING, FLOORS[floor], 3.9593, current, 1.0, lateral)
        states, _ = _run(current, floor, duration=1.0, lateral=lateral, rig=EVERYTHING)
        assert np.sqrt(np.mean((states[:, 0] - speed) ** 2)) < 5e-4
        assert np.sqrt(np.mean((states[:, 1] - wheel_speed) ** 2)) * RIG.wheel.radius < 1e-3


def test_published_cruise_current_and_top_speed():
    states, _ = _run(1.35, duration=3.0)
    assert states[-1, 3] == pytest.approx(0.19, abs=0.01)
    assert states[-1, 0] == pytest.approx(1.43, abs=0.015)


def test_published_rise_time():
    states, _ = _run(1.35, duration=3.0)
    rise = np.argmax(states[:, 0] > 0.95 * states[-1, 0]) * 1e-3
    assert rise == pytest.approx(0.48, abs=0.01)


def test_published_peak_traction():
    _, outputs = _run(1.5)
    assert outputs[:, 2].max() == pytest.approx(16.6, abs=0.1)


def test_a_current_of_015_just_moves_but_for_the_wheel_bearing():
    """True of the equations without Eq. 4.38; its torque moves the limit from 0.148 to 0.157 A."""
    motor = RIG.motor
    gear = motor.gear_ratio * motor.gear_efficiency * motor.torque_constant
    limit = motor.no_load_torque / motor.torque_constant + RIG.wheel.radius * RIG.rig.rail_friction / gear
    assert limit == pytest.approx(0.148, abs=5e-4)
    assert _run(0.15, rig=WITHOUT_BEARING)[0][-1, 0] > 0.01
    assert _run(0.147, rig=WITHOUT_BEARING)[0][-1, 0] < 1e-6
    assert _run(0.155)[0][-1, 0] < 1e-6
    assert _run(0.158)[0][-1, 0] > 0.005


def test_rail_load_without_offsets_is_the_roller_friction_times_its_leverage():
    dry, _ = rail_friction(rig_parameters(RIG), 1.0)
    c_over_h = RIG.rig.rail_height / RIG.rig.rail_half_width
    assert dry == pytest.approx(0.304 + 0.10 * c_over_h)
    assert rail_friction(rig_parameters(RIG), 0.0)[0] == pytest.approx(0.304)


@pytest.mark.parametrize("lateral", [0.2, 0.5, -0.2, -0.5])
def test_sideways_motion_slows_the_carriage(lateral):
    straight, sideways = _run(0.6, duration=1.0)[0], _run(0.6, duration=1.0, lateral=lateral)[0]
    gap = np.sqrt(np.mean((straight[:, 0] - sideways[:, 0]) ** 2))
    assert 0.02 < gap < 0.10  # the range of Table 4.3
    assert sideways[-1, 0] < straight[-1, 0]


def test_sideways_motion_loads_the_bearings_asymmetrically():
    outward, inward = _run(0.45, lateral=0.65)[0][-1, 0], _run(0.45, lateral=-0.65)[0][-1, 0]
    assert outward > inward + 1e-4


def test_printed_no_load_torque_drives_the_rig_without_current():
    for published in (False, True):
        states, _ = _run(0.0, published=published)
        assert bool(states[-1, 0] < -0.1) is published


def test_resting_rig_is_still_to_the_last_bit():
    states, _ = _run(0.1, duration=5.0)
    assert np.all(states[:, :3] == 0.0)


def test_carriage_stops_and_stays():
    state, model = REST._replace(speed=0.5, wheel_speed=10.0), _model()
    for _ in range(6):
        state, _ = step(state, 0.0, 0.0, model, 2.5e-4, 4000)
    assert abs(state.speed) < 1e-9
    assert abs(state.wheel_speed) < 1e-9
