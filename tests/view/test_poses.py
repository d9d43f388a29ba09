"""What is shown is what was simulated: the visible model moves by the poses of the lean one."""

from __future__ import annotations

import numpy as np
import pytest

from omnimj.parameters import read_floors, read_robot
from omnimj.plant.mujoco.assembly import robot_model
from omnimj.signals import Trace
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.view.poses import body_frames, visible_model, visible_poses, wheel_bodies
from omnimj.view.rerun.meshes import body_appearance


def test_the_robot_to_be_seen_has_the_joints_of_the_robot_that_is_simulated():
    scenario = read_scenario("nylon_patch")
    visible = visible_model(scenario)
    lean = robot_model(read_robot(), read_floors()["natural_stone"], scenario.patches, lean=True)
    assert [visible.joint(j).name for j in range(visible.njnt)] == [
        lean.joint(j).name for j in range(lean.njnt)
    ]
    np.testing.assert_array_equal(visible.jnt_qposadr, lean.jnt_qposadr)
    np.testing.assert_allclose(visible.body_pos, lean.body_pos)


@pytest.mark.parametrize(
    "name, bodies", [("nylon_patch", ("chassis", "corner_1")), ("rig_lateral", ("gantry", "carriage"))]
)
def test_machines_have_something_to_see(name, bodies):
    mj_model = visible_model(read_scenario(name))
    for body in [mj_model.body(b).id for b in bodies] + wheel_bodies(mj_model):
        assert body_appearance(mj_model, body) is not None


def test_a_floor_of_ones_own_can_be_seen(tmp_path):
    mats = tmp_path / "mats.toml"
    mats.write_text(
        '[mat]\ndescription = "a mat"\nlaw = "creep_ratio"\nsource = "chosen"\nmu = 0.6\n'
        "creep_stiffness = 12.0\nrelaxation_length = 0.015\ndamping_time = 0.005\n"
    )
    assert visible_model(read_scenario("nylon_patch", ["floor=mat"], floors_file=mats)).njnt > 0


def test_a_planar_run_moves_the_robot_along_its_path(robot_trace: Trace):
    poses = visible_poses(read_scenario("nylon_patch"), robot_trace)
    assert poses is not None
    frames = body_frames(poses)
    chassis = poses.mj_model.body("chassis").id
    at = np.searchsorted(robot_trace["time"], poses.time - 1e-9)
    np.testing.assert_allclose(frames.position[:, chassis, 0], robot_trace["x"][at], atol=1e-12)
    heading = 2.0 * np.arctan2(frames.quaternion[:, chassis, 3], frames.quaternion[:, chassis, 0])
    np.testing.assert_allclose(heading, robot_trace["heading"][at], atol=1e-12)


def test_without_truth_and_poses_there_is_nothing_to_move(rig_trace: Trace):
    assert visible_poses(read_scenario("rig_lateral"), rig_trace) is None


def test_poses_of_another_machine_are_refused(robot_trace: Trace):
    with pytest.raises(ValueError, match="coordinates"):
        visible_poses(read_scenario("nylon_patch"), robot_trace, np.zeros(2), np.zeros((2, 23)))
