"""The linear axis: its two files agree, MuJoCo moves it as hand-written equations do, its names are known."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from axis_logs import AXIS, COULOMB, DRIVE_MASS, FORCE_CONSTANT, MASS, VISCOUS

from omnimj.effects import effects_of
from omnimj.effects.axis import CHANNELS
from omnimj.effects.parts import ACTUATOR
from omnimj.errors import InputError
from omnimj.plant.mujoco.machine import apply_part_effects, read_machine_file, with_part_effects
from omnimj.resources import models_folder

FILE = models_folder() / "linear_axis" / "linear_axis.xml"
NAMES = (
    *("coulomb", "viscous", "asymmetric_viscous", "asymmetric_coulomb", "stribeck", "position_friction"),
    *("force_offset", "force_scale", "position_scale", "velocity_scale", "payload", "grade", "cable_drag"),
    *("air_drag", "torque_constant", "backlash", "current_bias", "current_scale", "sensor_delay"),
)


@pytest.fixture
def mj_model():
    return mujoco.MjModel.from_xml_path(str(models_folder() / "linear_axis" / "scene.xml"))


def test_mjcf_and_toml_hold_the_same_numbers():
    machine = read_machine_file(FILE)
    assert AXIS.values == {**machine.values, (ACTUATOR, "drive", "lag"): 5e-4}
    assert np.array_equal(AXIS.mj_model.jnt_range, machine.mj_model.jnt_range)
    (one,), (other,) = AXIS.drives, machine.drives
    assert (one.force_range, one.command_range) == (other.force_range, other.command_range)


def test_mjcf_and_toml_are_uncertain_about_the_same():
    widths = {one.part: (one.half_width, one.value - one.beyond) for one in AXIS.uncertain}
    own = read_machine_file(FILE).uncertain
    assert widths == {one.part: (one.half_width, one.value) for one in own}


def test_mujoco_moves_the_axis_as_equations_written_by_hand_do(mj_model, measured):
    mj_data = mujoco.MjData(mj_model)
    carriage, errors, fine = mj_data.joint("carriage"), [], 20
    x = v = 0.0
    for k in range(4000):
        force = 120.0 * math.sin(2.0 * math.pi * 0.8 * k * 1e-3) + (15.0 if k > 3000 else 0.0)
        mj_data.ctrl[0] = force / FORCE_CONSTANT
        mujoco.mj_step(mj_model, mj_data)
        for _ in range(fine):
            friction = VISCOUS * v + COULOMB * math.tanh(v / 1e-4)
            v += 1e-3 / fine * (force - friction) / MASS
            x += 1e-3 / fine * v
        errors.append((carriage.qpos[0] - x, carriage.qvel[0] - v))
    position, speed = np.abs(errors).max(axis=0)
    measured("axis, MuJoCo against equations [m]", position, 3e-4)
    assert position < 3e-4
    assert speed < 1e-3


def test_the_screw_turns_with_the_carriage(mj_model):
    mj_data = mujoco.MjData(mj_model)
    mj_data.ctrl[0] = 60.0 / FORCE_CONSTANT
    mujoco.mj_step(mj_model, mj_data, 800)
    turned = mj_data.joint("screw").qpos[0]
    assert turned == pytest.approx(2.0 * math.pi * mj_data.joint("carriage").qpos[0] / 0.02, rel=0.01)


def changes(**effects):
    found = apply_part_effects(with_part_effects(AXIS, effects))
    kinds = (found.added, found.scales, found.terms, found.tilt, found.channels)
    return [{key: value for key, value in kind.items() if value != 0.0} for kind in kinds]


def test_the_axis_has_the_effects_of_the_vocabulary():
    assert set(effects_of("linear_axis")) == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_an_effect_acts_at_its_typical_size_and_vanishes_at_its_stated_value(name):
    effect = effects_of("linear_axis")[name]
    chosen = {s.name: s.choices[0] for s in effect.selectors}
    assert any(changes(**{name: effect.typical() | chosen}))
    nothing = ({}, {}, {}, {}, {})
    for kind, empty in zip(changes(**{name: effect.null_values() | chosen}), nothing, strict=True):
        left = {key: value for key, value in kind.items() if value not in (1.0, (1.0, 0.0, 0.0))}
        assert left == empty


def test_a_bias_in_ampere_is_a_force_by_the_force_constant():
    found = apply_part_effects(with_part_effects(AXIS, {"current_bias": {"bias": 0.1}}))
    assert found.channels[CHANNELS["current"]].offset == pytest.approx(0.1 * FORCE_CONSTANT)


def test_all_that_moves_weighs_on_a_slope():
    found = apply_part_effects(with_part_effects(AXIS, {"grade": {"slope": 0.01}}))
    offset = found.terms["joint", "carriage", "offset"]
    assert found.tilt == {"y": 0.01}
    assert offset == pytest.approx(-DRIVE_MASS * 9.81 * math.sin(0.01))


def test_a_second_sticky_place_is_refused():
    place = {"force": 5.0, "position": 0.1, "width": 0.02}
    with pytest.raises(InputError, match="found this effect twice"):
        with_part_effects(AXIS, {"position_friction": place, "position_friction_2": place})
