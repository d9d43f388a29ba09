"""Effects of the linear axis: each acts, vanishes at its stated value, and keeps to the vocabulary."""

from __future__ import annotations

import numpy as np
import pytest

from omnimj.effects import AXIS, effects_of, with_effects
from omnimj.errors import InputError
from omnimj.parameters import read_axis
from omnimj.physics.axis import AXIS_ROW, COULOMB, MASS, MONITOR_BIAS
from omnimj.plant.axis import axis_row, drive_axis, servo
from omnimj.simulate.suites.axis import wander

MACHINE = read_axis()
PATH = wander(0.15, 0.3, 3.0, 1e-3)
NAMES = (
    *("coulomb", "viscous", "asymmetric_viscous", "asymmetric_coulomb", "stribeck", "position_friction"),
    *("force_offset", "force_scale", "position_scale", "velocity_scale", "payload", "grade", "cable_drag"),
    *("air_drag", "torque_constant", "backlash", "current_bias", "current_scale", "sensor_delay"),
)


def values_of(effect, values):
    chosen = {s.name: s.choices[0] for s in effect.selectors}
    return values | chosen


def test_the_axis_has_the_effects_of_the_vocabulary():
    assert set(effects_of(AXIS)) == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_an_effect_of_typical_size_changes_the_run(name):
    effect = effects_of(AXIS)[name]
    changed = with_effects(MACHINE, {name: values_of(effect, effect.typical())})
    plain = drive_axis(MACHINE, PATH, servo(MACHINE), ideal_sensors=True)
    found = drive_axis(changed, PATH, servo(MACHINE), ideal_sensors=True)
    force = np.abs(found["force"] - plain["force"]).max()
    velocity = np.abs(found["velocity"] - plain["velocity"]).max()
    assert force > 1.0 or velocity > 2e-3


@pytest.mark.parametrize("name", NAMES)
def test_an_effect_vanishes_at_its_stated_value(name):
    effect = effects_of(AXIS)[name]
    gone = with_effects(MACHINE, {name: values_of(effect, effect.null_values())})
    used = np.ones(AXIS_ROW, bool)
    plain, found = axis_row(MACHINE), axis_row(gone)
    for k in np.flatnonzero(plain != found):
        used[k] = False  # a shape without its amplitude
    assert used.sum() >= AXIS_ROW - 1
    a = drive_axis(MACHINE, PATH, servo(MACHINE))
    b = drive_axis(gone, PATH, servo(MACHINE))
    assert all(np.array_equal(a[column], b[column]) for column in a)


def test_a_second_sticky_place_is_refused():
    place = {"force": 5.0, "position": 0.1, "width": 0.02}
    with pytest.raises(InputError, match="found this effect twice"):
        with_effects(MACHINE, {"position_friction": place, "position_friction_2": place})


def test_friction_never_falls_below_none_and_some_mass_is_left():
    light = with_effects(MACHINE, {"coulomb": {"force": -100.0}, "payload": {"mass": -90.0}})
    row = axis_row(light)
    assert row[COULOMB] == 0.0
    assert row[MASS] > 0.0
    found = drive_axis(light, PATH, servo(MACHINE, bandwidth=10.0))
    assert np.isfinite(found["force"]).all()


def test_a_bias_in_ampere_is_a_force_by_the_force_constant():
    plain, row = axis_row(MACHINE), axis_row(with_effects(MACHINE, {"current_bias": {"bias": 0.1}}))
    plain[MONITOR_BIAS] = 0.1 * MACHINE.axis.force_constant
    assert np.array_equal(row, plain)
