"""What an evaluation draws."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import pickle
from collections import Counter

import numpy as np
import pytest

from omnimj.parameters import read_floors, read_robot
from omnimj.plant.faults import read_fault
from omnimj.plant.interface import robot_channels
from omnimj.recording.json_files import to_jsonable
from omnimj.studies.evaluation import trial
from omnimj.studies.evaluation.cases import (
    FLOORS,
    PLANTS,
    SUITES,
    CasePopulation,
    case_reference,
    draw_cases,
    nominal_scenario,
)
from omnimj.studies.evaluation.trial import drive_case, make_true_plant
from omnimj.studies.random_structure import DRAWN
from omnimj.studies.random_truth import BOUNDS, CLASSES, NONE, PAYLOAD, WHEEL_FAULTS, true_floor, true_robot

MANY = [case for suite in SUITES for case in draw_cases(CasePopulation(suite, 100), range(300))]


def drawn_structure():
    return draw_cases(CasePopulation("manoeuvres", 100, structure=DRAWN), [0])[0].structure


def test_the_same_seed_draws_the_same_cases_and_another_seed_others():
    for suite in SUITES:
        again = draw_cases(CasePopulation(suite, 100), range(300))
        assert again == [case for case in MANY if case.suite == suite]
        others = draw_cases(CasePopulation(suite, 101), range(300))
        assert not {case.noise for case in others} & {case.noise for case in again}


@pytest.mark.slow
def test_other_faults_or_floors_change_nothing_else_of_a_case():
    for k in range(16):
        case = draw_cases(CasePopulation("missions", 100), [k])[0]
        other = draw_cases(CasePopulation("missions", 100, faults=(NONE,), floors=("pvc",)), [k])[0]
        assert (other.fault, other.faults, other.floor) == (NONE, (), "pvc")
        same = dataclasses.replace(other, fault=case.fault, faults=case.faults, floor=case.floor)
        assert same == case
        assert np.array_equal(case_reference(case, 1e-2).velocity, case_reference(other, 1e-2).velocity)


def test_a_drawn_structure_changes_nothing_else_of_a_case():
    for suite in SUITES:
        for k in range(16):
            case = draw_cases(CasePopulation(suite, 100, structure=DRAWN), [k])[0]
            assert case.structure is not None
            assert dataclasses.replace(case, structure=None) == draw_cases(CasePopulation(suite, 100), [k])[0]


def test_a_structure_does_not_depend_on_faults_floors_or_plants():
    for k in range(10):
        case = draw_cases(CasePopulation("missions", 100, structure=DRAWN), [k])[0]
        choice = CasePopulation("missions", 100, ("twin",), ("pvc",), (NONE,), structure=DRAWN)
        assert draw_cases(choice, [k])[0].structure == case.structure


@pytest.mark.parametrize(
    ("suite", "seed", "index", "digest"),
    [
        ("missions", 100, 0, "b6790f87d3afb34a"),
        ("missions", 8000, 3, "9f8ef30d99662a04"),
        ("manoeuvres", 100, 7, "45d9d2e23d47da32"),
        ("manoeuvres", 60, 39, "78179001c2b9bad6"),
    ],
)
def test_a_nominal_case_is_what_its_seed_drew_before_structures_could_be_drawn(suite, seed, index, digest):
    record = draw_cases(CasePopulation(suite, seed), [index])[0].to_dict()
    assert record.pop("structure") is None
    text = json.dumps(record, sort_keys=True)
    assert hashlib.sha256(text.encode()).hexdigest()[:16] == digest


def test_every_fault_is_one_that_a_scenario_could_have_and_begins_inside_the_run():
    robot, floors = read_robot(), read_floors()
    for case in MANY:
        assert (case.fault == NONE) == (not case.faults)
        for record in case.fault_records():
            table = {key: value for key, value in record.items() if value is not None}
            read_fault(table, case.name, len(robot.wheels), floors, case.duration)
            if record["kind"] == "sensor":
                assert record["channel"] in robot_channels(4)


@pytest.mark.parametrize("suite", SUITES)
def test_every_class_is_drawn_and_fault_free_cases_have_their_share(suite):
    counts = Counter(case.fault for case in MANY if case.suite == suite)
    assert set(counts) == set(CLASSES)
    share = SUITES[suite].healthy
    assert abs(counts[NONE] / 300 - share) < 4.0 * math.sqrt(share * (1.0 - share) / 300)


def test_only_the_chosen_classes_are_drawn():
    population = CasePopulation("missions", 7, faults=("slip", "two"))
    drawn = {case.fault for case in draw_cases(population, range(60))}
    assert drawn == {"slip", "two"}


def pair_of(case):
    first, second = case.faults
    assert first.onset <= second.onset
    return frozenset(((first.kind, first.wheel), (second.kind, second.wheel)))


def test_twenty_eight_cases_of_two_faults_have_each_pair_of_the_eight_once():
    orders = []
    for choice in (
        CasePopulation("missions", 100, faults=("two",)),
        CasePopulation("missions", 101, faults=("two",)),
    ):
        pairs = [pair_of(case) for case in draw_cases(choice, range(84))]
        for first in (0, 28, 56):
            assert len(set(pairs[first : first + 28])) == 28
        assert all(len(pair) == 2 and pair <= set(WHEEL_FAULTS) for pair in pairs)
        orders += [pairs[first : first + 28] for first in (0, 28, 56)]
    assert all(one != other for k, one in enumerate(orders) for other in orders[:k])


@pytest.mark.slow
def test_among_other_classes_pairs_come_in_turn_too():
    choice = CasePopulation("missions", 100, faults=("none", "slip", "two"))
    pairs = [pair_of(case) for case in draw_cases(choice, range(400)) if case.fault == "two"]
    assert len(pairs) > 56 and len(set(pairs[:28])) == len(set(pairs[28:56])) == 28
    late = next(case for case in draw_cases(choice, range(1020, 1100)) if case.fault == "two")
    before = sum(case.fault == "two" for case in draw_cases(choice, range(late.index)))
    begin = before - before % 28
    cases = draw_cases(choice, range(late.index + 1))
    turn = [pair_of(case) for case in cases if case.fault == "two"][begin:]
    assert len(set(turn)) == len(turn) == before % 28 + 1


def test_which_of_a_pair_comes_first_and_how_large_both_are_is_drawn():
    choice = CasePopulation("missions", 100, faults=("two",))
    cases = draw_cases(choice, range(280))
    firsts = {(pair_of(case), case.faults[0].kind, case.faults[0].wheel) for case in cases}
    assert len(firsts) > 50
    assert 0.4 < sum(case.faults[0].onset == case.faults[1].onset for case in cases) / 280 < 0.6


def test_forty_eight_manoeuvres_have_each_direction_at_each_speed_once():
    for first in (0, 48):
        cases = draw_cases(CasePopulation("manoeuvres", 5), range(first, first + 48))
        assert len({(case.direction, case.speed) for case in cases}) == 48


def test_a_manoeuvre_is_from_rest_to_rest_along_its_direction_and_its_fault_begins_in_motion():
    for case in (c for c in MANY[300:340]):
        reference = case_reference(case, 1e-3)
        speed = np.linalg.norm(reference.velocity, axis=1)
        assert speed[0] == speed[-1] == 0.0 and len(speed) == 5001
        assert speed.max() == pytest.approx({"low": 0.5, "high": 1.0}[case.speed])
        fastest = reference.velocity[np.argmax(speed)]
        assert case.direction is not None
        away = math.atan2(fastest[1], fastest[0]) - case.direction
        assert abs(math.remainder(away, 2.0 * math.pi)) < 1e-9
        if case.faults:
            assert speed[: round(1e3 * case.faults[0].onset) + 2].max() > 0.0


def test_a_mission_has_legs_at_the_stated_speeds_and_stands_at_both_ends():
    reference = case_reference(MANY[0], 1e-2)
    speed = np.linalg.norm(reference.velocity, axis=1)
    assert len(speed) == 6001 and speed[0] == speed[-1] == 0.0
    assert 0.2 < speed.max() <= 1.0 and (speed[100:-300] == 0.0).any() and reference.yaw_rate.any()


def test_the_true_robot_differs_from_the_nominal_one_within_its_bounds_and_the_draws_fill_them():
    nominal, floors = read_robot(), read_floors()
    factors: dict[str, list[float]] = {}
    for case in MANY:
        robot = true_robot(nominal, case.errors)
        mass = robot.body.mass / nominal.body.mass
        assert abs(mass - 1.0) <= PAYLOAD + BOUNDS["mass"]
        factors.setdefault("mass", []).append(mass - case.errors.payload)
        factors.setdefault("inertia", []).append(robot.body.yaw_inertia / nominal.body.yaw_inertia)
        friction = factors.setdefault("friction", [])
        friction.append(robot.motor.no_load_torque / nominal.motor.no_load_torque)
        friction.append(robot.wheel.roller_dry / nominal.wheel.roller_dry)
        friction.append(robot.bearing.dry / nominal.bearing.dry)
        scales = [one["scale"] for one in robot.effects.values()]
        assert [one["wheel"] for one in robot.effects.values()] == [1, 2, 3, 4] and len(set(scales)) == 4
        factors.setdefault("torque_constant", []).extend(float(s) for s in scales)
        floor = floors[case.floor]
        laid = true_floor(floor, case.errors).numbers
        factors.setdefault("floor", []).extend(laid[key] / floor.numbers[key] for key in laid)
        assert laid["mu_s"] / laid["mu_c"] == pytest.approx(floor.numbers["mu_s"] / floor.numbers["mu_c"])
    for kind, found in factors.items():
        assert max(abs(f - 1.0) for f in found) <= BOUNDS[kind] + 1e-12
        assert min(found) < 1.0 - 0.9 * BOUNDS[kind] and max(found) > 1.0 + 0.9 * BOUNDS[kind]
    assert nominal == read_robot()


@pytest.mark.slow
@pytest.mark.parametrize("plant", PLANTS)
def test_both_plants_carry_the_heaviest_and_the_lightest_robot_on_every_floor(plant):
    nominal, case = read_robot(), MANY[0]
    for floor, payload in zip(FLOORS, (PAYLOAD, -PAYLOAD, PAYLOAD, -PAYLOAD), strict=True):
        errors = dataclasses.replace(case.errors, payload=payload)
        heavy = dataclasses.replace(case, plant=plant, floor=floor, errors=errors)
        made = make_true_plant(heavy, nominal_scenario(heavy), ())
        made.reset()
        normal = made.truth()[[made.truth_names.index(f"normal_force_{i}") for i in (1, 2, 3, 4)]]
        made.close()
        weight = 9.81 * true_robot(nominal, errors).body.mass
        assert normal.sum() == pytest.approx(weight, rel=0.02)


def test_a_task_travels_to_other_processes_and_a_case_to_json():
    drawn = draw_cases(CasePopulation("missions", 100, structure=DRAWN), range(3))
    for case in MANY[:20] + drawn:
        function, (again, method) = pickle.loads(pickle.dumps((drive_case, (case, "off"))))
        assert function is drive_case and again == case and method == "off"
        assert json.loads(json.dumps(case.to_dict())) == to_jsonable(case.to_dict())


@pytest.mark.parametrize("structure", [None, drawn_structure()])
def test_method_and_controller_get_the_nominal_robot_and_floor_and_no_fault(monkeypatch, structure):
    scenarios, driven = [], []
    monkeypatch.setattr(trial, "make_detector", lambda name, scenario, *_: scenarios.append(scenario))
    drive = trial.drive_on_plant

    def note_driven(scenario, plant, detector):
        driven.append(scenario)  # the controller is made for it
        return drive(scenario, plant, detector)

    monkeypatch.setattr(trial, "drive_on_plant", note_driven)
    case = next(c for c in MANY if c.fault == "two" and c.suite == "manoeuvres")
    result = drive_case(dataclasses.replace(case, duration=2.5, structure=structure), "any")
    assert "error" not in result and len(scenarios) == 3 and driven == scenarios
    for scenario in scenarios:
        assert scenario.faults == () and scenario.patches == () and not scenario.constants.effects
        assert scenario.constants == read_robot() and scenario.floors == read_floors()
        assert scenario.floor == case.floor


def test_with_and_without_the_method_the_same_noise_comes():
    case = dataclasses.replace(MANY[0], duration=1.0)
    scenario = nominal_scenario(case)
    first, again = (make_true_plant(case, scenario, ()).reset() for _ in range(2))
    assert np.array_equal(first.wheel_speed, again.wheel_speed) and first.yaw_rate == again.yaw_rate
    other = make_true_plant(dataclasses.replace(case, noise=case.noise + 1), scenario, ()).reset()
    assert not np.array_equal(first.current, other.current)


def test_a_motor_that_lacks_a_tenth_is_drawn_only_when_it_is_chosen():
    weak = draw_cases(CasePopulation("missions", 100, faults=("weak",)), range(20))
    assert {(c.fault, c.faults[0].kind) for c in weak} == {("weak", "motor")}
    assert {c.faults[0].numbers["loss"] for c in weak} == {0.1}
    assert {c.faults[0].wheel for c in weak} == {1, 2, 3, 4} and {c.faults[0].onset for c in weak} == {3.0}
    usual = {case.fault for case in draw_cases(CasePopulation("missions", 100), range(200))}
    assert "weak" not in usual
