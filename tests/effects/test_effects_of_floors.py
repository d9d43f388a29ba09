"""Effects that are about one floor, or about all."""

import pytest

from omnimj.effects import apply_effects, with_effects, with_further_effects
from omnimj.errors import InputError
from omnimj.parameters import read_floors, read_robot

ROBOT, FLOORS = read_robot(), read_floors()
BRISTLES = [name for name, floor in FLOORS.items() if floor.law == "lugre"]
SOFT = {"resistance": 0.1, "roller_resistance": 0.2, "roller_dry": 0.03}


def numbers(machine, floor):
    return apply_effects(machine).floor(FLOORS[floor]).numbers


def test_an_effect_of_one_floor_leaves_the_others_as_they_are():
    machine = with_effects(ROBOT, {"soft_floor": {**SOFT, "floor": "paperboard"}})
    found = numbers(machine, "paperboard")
    assert (found["rolling_resistance"], found["roller_resistance"], found["roller_dry"]) == (0.1, 0.2, 0.03)
    assert numbers(machine, "natural_stone") == FLOORS["natural_stone"].numbers


def test_an_effect_without_a_floor_is_that_of_every_floor_one_by_one():
    whole = with_effects(ROBOT, {"creep_ratio": {"compliance": 0.5, "slip_speed": 0.3}})
    single = with_further_effects(
        ROBOT, [("creep_ratio", {"compliance": 0.5, "slip_speed": 0.3, "floor": name}) for name in BRISTLES]
    )
    for name in BRISTLES:
        assert numbers(whole, name) == numbers(single, name)


def test_effects_of_all_floors_and_of_one_add_up():
    machine = with_further_effects(
        ROBOT,
        [("soft_floor", {"resistance": 0.1}), ("soft_floor", {"resistance": 0.02, "floor": "paperboard"})],
    )
    assert numbers(machine, "paperboard")["rolling_resistance"] == pytest.approx(0.12, rel=1e-12)
    assert numbers(machine, "natural_stone")["rolling_resistance"] == pytest.approx(0.1, rel=1e-12)


@pytest.mark.parametrize("wrong", [3, "", None, True])
def test_a_floor_that_is_no_name_is_refused(wrong):
    with pytest.raises(InputError, match=r"soft_floor\.floor: found .*; a name is needed"):
        with_effects(ROBOT, {"soft_floor": {**SOFT, "floor": wrong}})
