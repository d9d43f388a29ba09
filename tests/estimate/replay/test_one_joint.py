"""The closed form of a machine with a single joint against MuJoCo."""

import mujoco
import numpy as np
import pytest
from servo_logs import SERVO, write_servo_logs

from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.mjcf.one_joint import one_joint
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.estimate.replay.mjcf.rigid import RigidBodies
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.read_dataset import read_dataset

BODY = '<geom type="box" size=".1 .05 .02" pos=".1 .03 -.2" euler="20 30 40" mass="1.7"/>'


def machine(joint, option="", rest=""):
    return mujoco.MjModel.from_xml_string(f"""<mujoco><option gravity="1 2 -9" {option}/><worldbody>
      <site name="wall" pos="0 0 1"/><body name="link" euler="10 20 30">{joint}{BODY}
      <site name="tip" pos="0 0 -.3"/></body></worldbody>{rest}</mujoco>""")


@pytest.mark.parametrize(
    "joint",
    ['<joint axis="1 2 3"/>', '<joint type="slide" axis="0 1 2"/>', '<joint pos=".3 0 .1" axis="0 1 0"/>'],
    ids=["hinge", "slide", "hinge beside the body"],
)
def test_four_numbers_give_the_inverse_dynamics_of_a_single_joint(joint):
    model = machine(joint)
    found, mj_data = one_joint(model), mujoco.MjData(model)
    assert found is not None
    random = np.random.default_rng(1)
    for q, v, a in random.uniform(-6.0, 6.0, (20, 3)):
        mj_data.qpos[0], mj_data.qvel[0], mj_data.qacc[0] = q, v, a
        mujoco.mj_inverse(model, mj_data)
        assert found.force(q, a) == pytest.approx(mj_data.qfrc_inverse[0], rel=1e-9, abs=1e-9)


SPRING = """<tendon><spatial stiffness="5" springlength=".1"><site site="wall"/><site site="tip"/></spatial>
  </tendon>"""


@pytest.mark.parametrize(
    "model",
    [
        machine('<joint axis="1 0 0"/>', option='density="1000" viscosity=".1"'),
        machine('<joint axis="1 0 0"/>', rest=SPRING),
        machine('<joint axis="1 0 0"/><joint axis="0 1 0"/>'),
        machine('<joint axis="1 0 0" stiffness="3"/>'),
        machine("<freejoint/>"),
    ],
    ids=["in a fluid", "on a spring", "two joints", "with a spring of its own", "free"],
)
def test_a_machine_of_another_form_has_no_such_numbers(model):
    assert one_joint(model) is None


def windows_of(replay, monkeypatch, with_mujoco, base):
    with monkeypatch.context() as patch:
        if with_mujoco:
            patch.setattr(RigidBodies, "one_joint", lambda *_: None)
        (found,) = replay.simulate([Setting(np.array(base))])
    return found


@pytest.mark.parametrize(("dry", "most"), [(0.0, 2e-4), (0.025, 2e-3)], ids=["smooth", "with dry friction"])
def test_mujoco_and_the_closed_form_predict_the_same_channels(tmp_path, monkeypatch, measured, dry, most):
    write_servo_logs(tmp_path, load_share=0.12, runs=2)
    dataset = read_dataset(tmp_path)
    routes = []
    for with_mujoco in (False, True):
        replay = MachineReplay(dataset, read_machine_file(SERVO))
        base = [dry if b.name == "shaft.frictionloss" else b.nominal for b in replay.base]
        routes.append(windows_of(replay, monkeypatch, with_mujoco, base))
    size = np.nanstd(routes[1], axis=0)
    wrong = np.sqrt(np.nanmean((routes[0] - routes[1]) ** 2, axis=0)) / size
    measured("difference of the two routes over the size of a channel [1]", float(wrong.max()), most)
    assert np.array_equal(np.isnan(routes[0]), np.isnan(routes[1]))
    assert (wrong < most).all()
