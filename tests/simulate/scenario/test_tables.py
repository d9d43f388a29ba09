"""Single entries and small tables of a scenario file: bounds, defaults, and the place in every message."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import Rule
from omnimj.simulate.kinematic import KinematicCase
from omnimj.simulate.scenario.tables import (
    DIAGNOSIS_KEYS,
    KINEMATIC_KEYS,
    kinematic_faults,
    number_entry,
    read_diagnosis,
    read_kinematics,
    read_model_key,
    read_scene_key,
    table_entries,
    text_entry,
)

UNIT = Rule(0.0, 1.0, False)


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_a_number_is_returned_within_its_bounds_and_refused_with_its_place_beyond_them(value):
    if 0.0 <= value <= 1.0:
        assert number_entry({"share": value}, "share", "s.toml", UNIT) == value
    else:
        with pytest.raises(InputError, match=r"^s\.toml: share: "):
            number_entry({"share": value}, "share", "s.toml", UNIT)


def test_a_missing_number_is_its_default_or_refused():
    assert number_entry({}, "share", "s.toml", UNIT, 0.25) == 0.25
    with pytest.raises(InputError, match=r"s\.toml: share: is missing"):
        number_entry({}, "share", "s.toml", UNIT)


@pytest.mark.parametrize("value", [None, "", "two\nlines", 3, ["a"]])
def test_a_text_is_one_line(value):
    assert text_entry({"floor": "pvc"}, "floor", "s.toml") == "pvc"
    with pytest.raises(InputError, match=r"s\.toml: floor: "):
        text_entry({} if value is None else {"floor": value}, "floor", "s.toml")


def test_tables_are_a_list_and_none_by_default():
    assert table_entries({}, "faults", "s.toml") == []
    with pytest.raises(InputError, match=r"\[\[faults\]\]"):
        table_entries({"faults": {"kind": "slip"}}, "faults", "s.toml")


def test_models_and_scenes_are_shipped_by_name_or_files_beside_the_scenario(tmp_path):
    scenario = tmp_path / "s.toml"
    assert read_model_key({}, scenario) is None and read_scene_key({}, scenario) is None
    for read, key, suffix in ((read_model_key, "model", ".toml"), (read_scene_key, "scene", ".xml")):
        own = tmp_path / f"own{suffix}"
        with pytest.raises(InputError, match=f"there is no file {own}"):
            read({key: own.name}, scenario)
        own.write_text("")
        assert read({key: own.name}, scenario) == own
    assert str(read_model_key({"model": "three_wheel"}, scenario)) == "three_wheel"
    shipped = read_scene_key({"scene": "obstacles"}, scenario)
    assert shipped is not None and shipped.is_file()


@pytest.mark.parametrize(
    ("read", "keys"), [(read_kinematics, KINEMATIC_KEYS), (read_diagnosis, DIAGNOSIS_KEYS)]
)
def test_an_unknown_key_lists_the_known_ones(read, keys):
    wheels = (4,) if read is read_kinematics else ()
    with pytest.raises(UnknownNameError) as caught:
        read({"nonsense": 1}, "s.toml: table", *wheels)
    assert all(key in str(caught.value) for key in keys)
    with pytest.raises(InputError, match="a table is needed"):
        read(5, "s.toml: table", *wheels)


def test_an_empty_kinematics_table_is_a_healthy_robot_without_weights():
    case = read_kinematics({}, "s.toml: kinematics", 3)
    assert case == KinematicCase(weights=(1.0,) * 3, misalignment=(0.0,) * 3)
    assert kinematic_faults(case) == []


def test_misaligned_axles_and_a_lost_wheel_become_fault_records():
    table = {"misalignment": [0.0, 0.1, 0.0], "lost_wheel": 3, "lost_from": 2.0}
    axle, lost = kinematic_faults(read_kinematics(table, "s.toml: kinematics", 3))
    assert (axle["kind"], axle["wheel"], axle["onset"], axle["angle"]) == ("misalignment", 2, 0.0, 0.1)
    assert (lost["kind"], lost["wheel"], lost["onset"], lost["end"]) == ("demand_lost", 3, 2.0, None)


@pytest.mark.parametrize("value", [0.6, -0.6, math.nan, "0.1"])
def test_an_axle_is_turned_by_half_a_radian_at_most(value):
    with pytest.raises(InputError, match=r"misalignment\[0\]"):
        read_kinematics({"misalignment": [value, 0.0, 0.0]}, "s.toml: kinematics", 3)
