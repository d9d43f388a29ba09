"""Which numbers are varied, between which bounds, and what the plant and the controller are made of then."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from in_process import SHORT_RIG, SHORT_ROBOT

from omnimj.parameters import read_rig, read_robot
from omnimj.resources import models_folder
from omnimj.simulate import run
from omnimj.simulate.scenario.scenario import Scenario, read_scenario
from omnimj.studies.sensitivity.factors import ExcludedFactor, Factor, find_factors, floors_in
from omnimj.studies.sensitivity.trial import TrialConfig, drive_with, nominal_scenario, true_scenario

SCENARIO = read_scenario("nylon_patch")
FOUND, LEFT = find_factors(SCENARIO)
BY_NAME = {one.name: one for one in FOUND}
REASONS = {one.name: one.reason for one in LEFT}


def robot_with(tmp_path: Path, more: str) -> Path:
    """A copy of the robot's file with some more."""
    text = (models_folder() / "uto_robot" / "robot.toml").read_text(encoding="utf-8")
    path = tmp_path / "robot.toml"
    path.write_text(text + more, encoding="utf-8")
    return path


@pytest.mark.parametrize(("read", "name"), [(read_robot, "nylon_patch"), (read_rig, "rig_slip")])
def test_every_chosen_number_is_varied_or_left_out_for_a_reason(read, name):
    found, left = find_factors(read_scenario(name))
    chosen = {key for key, origin in read().provenance.items() if origin.source == "chosen"}
    names = [one.name for one in (*found, *left)]
    assert len(names) == len(set(names))
    assert {one for one in names if not one.startswith("floor.")} == chosen
    assert all(one.reason for one in left)


def test_a_stated_uncertainty_is_the_range_and_a_fifth_where_there_is_none():
    constant, resistance = BY_NAME["motor.torque_constant"], BY_NAME["motor.resistance"]
    assert (constant.low, constant.high) == pytest.approx((0.0388, 0.0412)) and constant.stated
    assert (resistance.low, resistance.high) == pytest.approx((4.0, 6.0)) and not resistance.stated
    wider = {one.name: one for one in find_factors(SCENARIO, share=0.5)[0]}
    assert wider["motor.torque_constant"] == constant
    assert (wider["motor.resistance"].low, wider["motor.resistance"].high) == pytest.approx((2.5, 7.5))


@pytest.mark.parametrize("share", [0.2, 1e-6])
def test_whole_numbers_stay_whole_and_move_by_one_at_least(share):
    found, _ = find_factors(SCENARIO, share=share)
    counts = next(one for one in found if one.name == "sensors.carriage_encoder_counts")
    assert counts.whole and counts.high - counts.low >= 2.0
    values = [counts.at(place) for place in (0.0, 1 / 3, 2 / 3, 1.0)]
    assert all(value == int(value) for value in values) and len(set(values)) >= 3
    changed = true_scenario(SCENARIO, {counts.name: values[1]}).constants.sensors.carriage_encoder_counts
    assert isinstance(changed, int) and changed == values[1]


def test_a_zero_without_an_uncertainty_is_left_out_and_with_one_it_is_varied(tmp_path):
    assert "it is 0" in REASONS["bearing.viscous"] and "bearing.viscous" not in BY_NAME
    more = '[bearing]\nviscous = { value = 0.0, unit = "s/rad", source = "chosen", uncertainty = 1e-4 }\n'
    found, _ = find_factors(read_scenario("nylon_patch", (), robot_with(tmp_path, more)))
    viscous = next(one for one in found if one.name == "bearing.viscous")
    assert (viscous.low, viscous.high) == (0.0, 1e-4)  # friction is not negative


def test_a_range_is_cut_where_the_number_may_not_be():
    wide = {one.name: one for one in find_factors(SCENARIO, share=0.9)[0]}
    assert wide["motor.gear_efficiency"].high == 1.0
    far = {one.name: one for one in find_factors(SCENARIO, share=1.0)[0]}
    assert 0.0 < far["motor.resistance"].low < 0.1  # above zero it must be


def test_settings_of_the_controller_are_not_varied_whatever_their_origin():
    found, left = find_factors(SCENARIO, ("chosen", "tuned", "text", "datasheet"))
    assert not any(one.name.startswith("control.") or one.name == "sensors.sample_rate" for one in found)
    assert {"control.speed_integral", "sensors.sample_rate"} <= {one.name for one in left}
    assert {"wheel.rows", "wheel.rollers_per_row"} <= {one.name for one in left}  # the twin's wheel has them
    assert "body.mass" in {one.name for one in found} and "body.mass" not in BY_NAME


def test_the_floors_of_hall_patches_and_faults_count_by_their_own_origin():
    assert floors_in(SCENARIO) == ("natural_stone", "nylon")
    floors = [one for one in FOUND if one.name.startswith("floor.")]
    assert {one.name.split(".")[1] for one in floors} == {"nylon"}  # the stone's numbers are published
    assert len(floors) == len(SCENARIO.floors["nylon"].numbers)
    text = {one.name: one for one in find_factors(SCENARIO, ("text",))[0]}
    grip = text["floor.natural_stone.mu_c"]
    assert (grip.low, grip.high) == pytest.approx((0.12 * 0.95, 0.12 * 1.05)) and grip.stated
    slipping = read_scenario("oil_everywhere")
    assert floors_in(slipping)[1:] and any(
        one.name.startswith("floor.oil.") for one in find_factors(slipping)[0]
    )
    capped = read_scenario("nylon_patch", ("floor=natural_stone_capped", "patches=[]"))
    assert [one.name for one in find_factors(capped)[0] if one.name.startswith("floor.")] == [
        "floor.natural_stone_capped.mu_cap"
    ]


def test_a_list_of_numbers_is_stretched_as_a_whole_and_a_direction_is_left_alone(tmp_path):
    text = (models_folder() / "uto_robot" / "robot.toml").read_text(encoding="utf-8")
    path = tmp_path / "robot.toml"
    path.write_text(text.replace('unit = "m", source = "text" }', 'unit = "m", source = "chosen" }'))
    scenario = read_scenario("nylon_patch", ("patches=[]",), path)
    found, left = find_factors(scenario)
    place = next(one for one in found if one.name == "wheels.3.position")
    assert (place.nominal, place.low, place.high) == pytest.approx((0.25, 0.2, 0.3))
    changed = true_scenario(scenario, {"wheels.3.position": 0.3}).constants
    assert changed.wheel_positions[2].tolist() == pytest.approx([-0.3, 0.0])
    assert (changed.wheel_positions[[0, 1, 3]] == scenario.constants.wheel_positions[[0, 1, 3]]).all()
    directions = find_factors(scenario, ("text",))[1]
    assert ExcludedFactor("wheels.1.drives_along", "a direction") in directions and left != directions


def test_an_effect_of_the_model_file_is_varied_too(tmp_path):
    more = '[effects.payload]\nmass = { value = 2.0, unit = "kg", source = "chosen" }\n'
    more += 'x = { value = 0.0, unit = "m", source = "chosen" }\n'
    more += 'y = { value = 0.0, unit = "m", source = "chosen" }\n'
    scenario = read_scenario("nylon_patch", (), robot_with(tmp_path, more))
    load = next(one for one in find_factors(scenario)[0] if one.name == "effects.payload.mass")
    assert (load.low, load.high) == pytest.approx((1.6, 2.4))
    changed = true_scenario(scenario, {load.name: load.high}).constants
    assert changed.effects["payload"]["mass"] == load.high
    assert scenario.constants.effects["payload"]["mass"] == 2.0


def value_of(scenario: Scenario, name: str) -> float:
    table, _, key = name.partition(".")
    if table == "floor":
        floor, _, letter = key.rpartition(".")
        return scenario.floors[floor].numbers[letter]
    return getattr(getattr(scenario.constants, table), key)


@pytest.mark.parametrize("varied", FOUND, ids=lambda one: one.name)
def test_the_truth_differs_in_what_was_changed_and_in_nothing_else(varied: Factor):
    changed = true_scenario(SCENARIO, {varied.name: varied.high})
    assert value_of(changed, varied.name) == varied.high != value_of(SCENARIO, varied.name)
    for one in FOUND:
        if one is not varied:
            assert value_of(changed, one.name) == value_of(SCENARIO, one.name) == one.nominal
    same = [f.name for f in dataclasses.fields(Scenario) if f.name not in ("constants", "floors")]
    assert all(getattr(changed, name) is getattr(SCENARIO, name) for name in same)


@pytest.mark.parametrize("config", [SHORT_ROBOT, SHORT_RIG], ids=["robot", "rig"])
def test_the_plant_gets_the_changed_numbers_and_the_controller_those_of_the_files(config, monkeypatch):
    config = dataclasses.replace(config, method="published")
    made_of, believed = [], []
    make_plant, make_method, make = run.make_plant, run.make_detector, run.make_diagnosing_controller

    def watched_plant(scenario, *rest):
        made_of.append(scenario)
        return make_plant(scenario, *rest)

    def watched_method(name, scenario, *rest):
        believed.append(scenario)
        return make_method(name, scenario, *rest)

    def watched_controller(scenario, method):
        believed.append(scenario)
        return make(scenario, method)

    monkeypatch.setattr(run, "make_plant", watched_plant)
    monkeypatch.setattr(run, "make_detector", watched_method)
    monkeypatch.setattr(run, "make_diagnosing_controller", watched_controller)
    scenario = nominal_scenario(config)
    found = find_factors(scenario)[0]
    nominal, values = drive_with(config, {}, 0), {one.name: one.high for one in found}
    changed = drive_with(config, values, 0)
    assert "error" not in nominal and "error" not in changed
    assert nominal["results"] != changed["results"]
    assert [value_of(made_of[1], one.name) for one in found] == [one.high for one in found]
    assert made_of[0].constants == scenario.constants
    # everything that the controller was made of is as in the files, in both runs
    assert believed and all(one.constants == scenario.constants for one in believed)
    assert all(dict(one.floors) == dict(scenario.floors) for one in believed)


def test_a_change_in_the_model_file_raises_no_alarm_and_the_same_one_hidden_does(tmp_path):
    text = (models_folder() / "quarter_rig" / "rig.toml").read_text(encoding="utf-8")
    model = tmp_path / "rig.toml"
    stronger = '[motor]\ntorque_constant = { value = 0.05, unit = "N.m/A", source = "measured" }\n'
    model.write_text(text + stronger, encoding="utf-8")
    config = TrialConfig("rig_constant_current", method="published")
    known = drive_with(dataclasses.replace(config, model=model), {}, 0)["results"]
    unknown = drive_with(config, {"motor.torque_constant": 0.05}, 0)["results"]
    assert known["travel"] == unknown["travel"]  # one and the same plant, and nobody steers it
    assert known["false_alarms"] == 0.0 < unknown["false_alarms"]


@pytest.mark.parametrize("name", ["nylon_patch", "rig_lateral"])
@pytest.mark.parametrize("end", ["low", "high"])
def test_the_twin_takes_all_of_them_at_either_end(name, end):
    config = TrialConfig(name, ("duration=0.02", "checks={}"), plant="twin", method="off")
    found = find_factors(nominal_scenario(config), ("chosen", "text", "datasheet"))[0]
    assert "error" not in drive_with(config, {one.name: getattr(one, end) for one in found}, 0)


@pytest.mark.parametrize(
    ("config", "expected"),
    [
        (TrialConfig("circle_8m_kinematic"), "is at the kinematic level"),
        (TrialConfig("nylon_patch", plant="udp:127.0.0.1:9"), "can be changed in a simulation only"),
        (TrialConfig("rig_slip", method="robust"), "the rig has one wheel"),
    ],
)
def test_what_cannot_be_varied_is_refused(config, expected):
    with pytest.raises(ValueError, match=expected):
        nominal_scenario(config)
