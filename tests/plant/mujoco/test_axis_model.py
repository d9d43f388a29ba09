"""The axis' MJCF: the same numbers as its TOML, and MuJoCo's own friction moves it as the equations do."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from omnimj.parameters import read_axis
from omnimj.physics.axis import POSITION, SPEED, frozen, step
from omnimj.plant.axis import axis_row
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.resources import models_folder

AXIS = read_axis()
FILE = models_folder() / "linear_axis" / "linear_axis.xml"


@pytest.fixture
def mj_model():
    return mujoco.MjModel.from_xml_path(str(models_folder() / "linear_axis" / "scene.xml"))


def test_mjcf_and_toml_hold_the_same_numbers(mj_model):
    body, dof = AXIS.axis, int(mj_model.joint("carriage").dofadr[0])
    assert mj_model.body("carriage").mass[0] + mj_model.dof_armature[dof] == body.mass
    assert mj_model.dof_armature[dof] == body.drive_mass
    assert mj_model.dof_damping[dof] == body.viscous
    assert mj_model.dof_frictionloss[dof] == body.coulomb
    assert np.array_equal(mj_model.joint("carriage").range, [-body.travel, body.travel])
    (drive,) = read_machine_file(FILE).drives
    assert drive.force_range == (-body.force_limit, body.force_limit)
    assert drive.gain == body.force_constant
    assert drive.command_range[1] * drive.gain == body.force_limit


def test_mjcf_and_toml_are_uncertain_about_the_same():
    machine, origin = read_machine_file(FILE), AXIS.provenance
    widths = {one.name: one.half_width for one in machine.uncertain}
    names = {"carriage.damping": "viscous", "carriage.frictionloss": "coulomb", "carriage.mass": "mass"}
    assert widths == {name: origin[f"axis.{key}"].uncertainty for name, key in names.items()}


def test_mujoco_moves_the_axis_as_the_equations_do(mj_model, measured):
    mj_data = mujoco.MjData(mj_model)
    row = frozen(axis_row(AXIS))
    state = (0.0,) * 5
    carriage = mj_data.joint("carriage")
    errors = []
    for k in range(4000):
        force = 120.0 * math.sin(2.0 * math.pi * 0.8 * k * 1e-3) + (15.0 if k > 3000 else 0.0)
        mj_data.ctrl[0] = force / AXIS.axis.force_constant
        mujoco.mj_step(mj_model, mj_data)
        state = step(row, state, force, 1e-3)
        errors.append((carriage.qpos[0] - state[POSITION], carriage.qvel[0] - state[SPEED]))
    position, speed = np.abs(errors).max(axis=0)
    measured("axis, MuJoCo against equations [m]", position, 3e-4)
    assert position < 3e-4
    assert speed < 1e-3


def test_the_screw_turns_with_the_carriage(mj_model):
    mj_data = mujoco.MjData(mj_model)
    mj_data.ctrl[0] = 60.0 / AXIS.axis.force_constant
    mujoco.mj_step(mj_model, mj_data, 800)
    turned = mj_data.joint("screw").qpos[0]
    assert turned == pytest.approx(2.0 * math.pi * mj_data.joint("carriage").qpos[0] / 0.02, rel=0.01)
