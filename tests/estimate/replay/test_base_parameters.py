"""A machine with the nominal values of its uncertain parameters is the machine itself."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from omnimj.effects import FLOOR_SCALES, scale_floor
from omnimj.estimate.replay.base_parameters import adjust_machine, base_parameters
from omnimj.parameters import read_floors, read_rig, read_robot

MACHINES = {"rig": read_rig, "robot": read_robot}


@pytest.fixture(params=MACHINES)
def base(request):
    machine, floors = MACHINES[request.param](), read_floors()
    return machine, floors, base_parameters(machine, floors, ("pvc",), ("current",))


def test_nominal_values_change_nothing(base):
    machine, floors, parameters = base
    same = adjust_machine(machine, floors, parameters, np.array([p.nominal for p in parameters]))
    assert same.machine == machine
    assert same.floors == floors
    assert set(same.lags.values()) == {0.0} and same.mass_scale == 1.0


def test_every_parameter_changes_one_thing_and_stays_in_its_box(base):
    machine, floors, parameters = base
    nominal = np.array([p.nominal for p in parameters])
    plain = adjust_machine(machine, floors, parameters, nominal)
    for k, parameter in enumerate(parameters):
        assert parameter.low <= parameter.nominal <= parameter.high
        values = nominal.copy()
        values[k] = parameter.high
        changed = adjust_machine(machine, floors, parameters, values)
        fields = [f.name for f in dataclasses.fields(changed)]
        assert sum(getattr(changed, f) != getattr(plain, f) for f in fields) == 1, parameter.name


@pytest.mark.parametrize("key", FLOOR_SCALES)
def test_a_scale_of_a_floor_acts_on_its_group_alone(key):
    for floor in read_floors().values():
        scaled = scale_floor(floor, {key: 1.5})
        for name, value in floor.numbers.items():
            factor = 1.5 if name in FLOOR_SCALES[key] else 1.0
            assert scaled.numbers[name] == pytest.approx(factor * value)
