"""What a drawn structure is, and that it reaches the true robot."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from omnimj.effects import apply_effects
from omnimj.parameters import read_robot
from omnimj.signals import CurrentCommand
from omnimj.studies.evaluation.cases import PLANTS, CasePopulation, draw_cases, nominal_scenario
from omnimj.studies.evaluation.trial import make_true_plant
from omnimj.studies.random_structure import (
    COGGING,
    DELAYS,
    DRAWN,
    FACTORS,
    LEAST_BACK_DRIVING,
    PLACE,
    POLES,
    RADIUS,
    RIPPLE,
    STRUCTURES,
    draw_structure,
    structure_sentence,
    with_structure,
)
from omnimj.studies.random_truth import PAYLOAD, true_robot

NOMINAL_ROBOT = read_robot()
MANY = [draw_structure(np.random.default_rng(k), NOMINAL_ROBOT) for k in range(300)]


def fills(values, low: float, high: float) -> bool:
    """True if values stay within their bounds and come near both."""
    margin = 0.1 * (high - low)
    return low - 1e-12 <= min(values) <= low + margin and high - margin <= max(values) <= high + 1e-12


def test_every_part_of_a_structure_stays_within_its_bounds_and_fills_them():
    for name, bounds in FACTORS.items():
        assert fills([one.factors[name] for one in MANY], *bounds), name
    assert fills([one.ripple for one in MANY], -RIPPLE, RIPPLE)
    assert fills([one.cogging for one in MANY], -COGGING, COGGING)
    assert fills([radius for one in MANY for radius in one.radii], 1.0 - RADIUS, 1.0 + RADIUS)
    assert fills([math.hypot(*one.payload_place) for one in MANY], 0.0, PLACE)
    assert {one.cogging_poles for one in MANY} == set(POLES)
    for kind, (most, _) in DELAYS.items():
        assert fills([one.delays[kind] for one in MANY], 0.0, most)


def test_a_gear_driven_backwards_loses_up_to_the_least_efficiency_or_gains_at_most_what_it_lost():
    efficiency = NOMINAL_ROBOT.motor.gear_efficiency
    products = []
    for one in MANY:
        robot = with_structure(NOMINAL_ROBOT, one, 0.0)
        motor = robot.motor
        assert motor.gear_efficiency == efficiency * one.factors["motor.gear_efficiency"] <= 1.0
        assert motor.back_driving_efficiency >= LEAST_BACK_DRIVING
        products.append(motor.gear_efficiency / motor.driven_gain)
    assert fills(products, LEAST_BACK_DRIVING * 0.9 * efficiency, 1.0)


def test_the_structure_reaches_the_true_robot_and_leaves_the_nominal_one_alone():
    case = draw_cases(CasePopulation("missions", 100, structure=DRAWN), [1])[0]
    structure = case.structure
    assert structure is not None
    payload = case.errors.payload * NOMINAL_ROBOT.body.mass
    before = true_robot(NOMINAL_ROBOT, case.errors)
    robot = with_structure(before, structure, payload)
    applied = apply_effects(robot)
    assert applied.payload == pytest.approx((payload, *structure.payload_place))
    assert robot.body.mass + applied.added_mass == pytest.approx(before.body.mass)
    assert applied.radius_scale.tolist() == list(structure.radii)
    assert applied.torque_scale.tolist() == list(case.errors.torque_constants)
    late = {channel: change.delay for channel, change in applied.channels.items()}
    expected = {name: structure.delays[kind] for kind, (_, names) in DELAYS.items() for name in names}
    assert late == expected
    for name, factor in structure.factors.items():
        table, _, key = name.partition(".")
        found, was = (getattr(getattr(one, table), key) for one in (robot, before))
        assert found == factor * was
    assert read_robot() == NOMINAL_ROBOT and not NOMINAL_ROBOT.effects


@pytest.mark.parametrize("plant", PLANTS)
def test_both_plants_stand_on_four_wheels_with_the_heaviest_and_the_lightest_robot(plant):
    case = draw_cases(CasePopulation("manoeuvres", 100, structure=DRAWN), [0])[0]
    for payload in (PAYLOAD, -PAYLOAD):
        errors = dataclasses.replace(case.errors, payload=payload)
        loaded = dataclasses.replace(case, plant=plant, errors=errors)
        made = make_true_plant(loaded, nominal_scenario(loaded), ())
        made.reset()
        for _ in range(600):
            made.step(CurrentCommand(np.zeros(4)))
        normal = made.truth()[[made.truth_names.index(f"normal_force_{i}") for i in (1, 2, 3, 4)]]
        made.close()
        assert normal.sum() == pytest.approx(9.81 * true_robot(NOMINAL_ROBOT, errors).body.mass, rel=0.02)
        assert normal.min() > 0.8 * normal.mean()


def test_both_structures_have_a_sentence_that_says_what_is_not_drawn():
    assert all(name in structure_sentence(name).lower() for name in STRUCTURES)
    assert "Not drawn" in structure_sentence(DRAWN)
