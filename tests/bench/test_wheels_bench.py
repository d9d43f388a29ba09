"""The bench of wheels measures what its table says."""

import json
import math

import mujoco
import numpy as np
import pytest

from omnimj.bench import wheels
from omnimj.bench.wheels import CONTACTS, SHAPES, Case, Rolling, cases, roll, worst
from omnimj.cli import bench
from omnimj.cli.main import main
from omnimj.wheels import LAYOUTS


def test_every_layout_meets_every_shape_and_both_kinds_of_wheel_every_contact():
    listed = set(cases())
    assert {(c.layout, c.shape) for c in listed} >= {(one, shape) for one in LAYOUTS for shape in SHAPES}
    assert {(c.layout, c.contact) for c in listed} >= {
        (one, c) for one in ("omni4", "mecanum4") for c in CONTACTS
    }


@pytest.mark.parametrize("shape", SHAPES)
def test_rollers_of_every_shape_reach_the_wheel_s_radius_and_turn_about_their_axis(shape):
    case = Case("omni4", shape, "as written")
    m = case.model()
    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{shape.upper()}")
    rollers = [g for g in range(m.ngeom) if "roller" in m.geom(g).name]
    assert len(rollers) == 72 and np.all(m.geom_type[rollers] == kind)
    d = mujoco.MjData(m)
    d.qpos[2] -= 1e-4
    mujoco.mj_forward(m, d)
    wheel = case.robot.wheel
    end = math.hypot(wheel.radius, wheel.roller_half_length)  # of a cylinder turned until its rim is lowest
    beyond = 0.0
    if shape == "cylinder":
        beyond = (
            end * math.cos(math.pi / 9 - math.atan2(wheel.roller_half_length, wheel.radius)) - wheel.radius
        )
    assert d.contact.dist.min() == pytest.approx(-1e-4 - max(beyond, 0.0), abs=2e-6)


def test_the_worst_of_several_is_the_largest_deviation_with_its_sign():
    found = [Rolling(0.1, -0.2, 0.0, 1.0, 2.0), Rolling(-0.3, 0.1, 0.5, 0.5, 3.0)]
    assert worst(found) == Rolling(-0.3, -0.2, 0.5, 1.0, 3.0)


def test_a_robot_that_is_dragged_aside_shows_it():
    case = Case("omni4", "ellipsoid", "as written")
    level = roll(case.model(), case.robot, math.pi / 4, 1)
    spec_model = case.model()
    spec_model.opt.gravity[1] = 0.5  # as on a slope to the left
    tilted = roll(spec_model, case.robot, 0.0, 1)
    assert abs(level.direction_error) < 0.003 < tilted.direction_error


@pytest.mark.slow
def test_the_command_prints_a_row_per_case_as_table_and_json(capsys, monkeypatch):
    chosen = [Case("omni3", "ellipsoid", "as written"), Case("omni3", "sphere", "as written")]
    monkeypatch.setattr(wheels, "cases", lambda: iter(chosen))
    monkeypatch.setattr(bench, "EFFORT", bench.Effort(directions=1, wheel_rounds=1))
    assert main(["bench", "--wheels"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3 and "ellipsoid" in lines[1] and "sphere" in lines[2]
    assert main(["bench", "--wheels", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [one["case"]["shape"] for one in found] == ["ellipsoid", "sphere"]
    assert abs(found[0]["rolling"]["speed_error"]) < 0.005 < abs(found[1]["rolling"]["speed_error"])
    assert all(one["step_us"] > 0.0 for one in found)
