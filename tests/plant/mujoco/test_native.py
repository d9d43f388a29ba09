"""The native callback is a pure function of model and state, whatever calls it."""

import ctypes

import mujoco
import mujoco.batch
import mujoco.rollout
import numpy as np
import pytest

from omnimj.errors import NativeLayoutError, OmnimjError
from omnimj.plant.mujoco import callback, memory
from omnimj.plant.mujoco.assembly import robot_model

callback.install()
INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION
CURRENTS = np.array([0.3, -0.9, 0.2, 0.8])


def state_of(mj_model, mj_data):
    state = np.empty(mujoco.mj_stateSize(mj_model, INTEGRATION))
    mujoco.mj_getState(mj_model, mj_data, state, INTEGRATION)
    return state


def moving(mj_model, steps=300, current=CURRENTS):
    mj_data = mujoco.MjData(mj_model)
    mj_data.ctrl[:] = current
    mujoco.mj_step(mj_model, mj_data, steps)
    return mj_data


@pytest.fixture(scope="module")
def mj_model(robot, floors):
    return robot_model(robot, floors["natural_stone"])


def test_forward_changes_no_state_and_repeats_itself(mj_model):
    d = moving(mj_model)
    before = state_of(mj_model, d)
    mujoco.mj_forward(mj_model, d)
    first = d.qacc.copy(), d.act_dot.copy(), d.sensordata.copy()
    mujoco.mj_forward(mj_model, d)
    assert np.array_equal(before, state_of(mj_model, d))
    for old, new in zip(first, (d.qacc, d.act_dot, d.sensordata), strict=True):
        assert np.array_equal(old, new)


def test_inverse_dynamics_returns_the_forces_of_forward_dynamics(mj_model):
    d = moving(mj_model)
    mujoco.mj_forward(mj_model, d)
    mujoco.mj_inverse(mj_model, d)
    assert np.abs(d.qfrc_inverse).max() < 1e-9


def test_a_saved_state_goes_on_as_the_original_did(mj_model):
    d = moving(mj_model)
    saved = state_of(mj_model, d)
    mujoco.mj_step(mj_model, d, 200)
    other = mujoco.MjData(mj_model)
    mujoco.mj_setState(mj_model, other, saved, INTEGRATION)
    mujoco.mj_step(mj_model, other, 200)
    assert np.array_equal(state_of(mj_model, d), state_of(mj_model, other))


@pytest.mark.slow
def test_every_integrator_comes_to_the_same_motion(robot, floors):
    ends = {}
    for integrator in ("EULER", "IMPLICIT", "IMPLICITFAST", "RK4"):
        m = robot_model(robot, floors["natural_stone"])
        m.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
        d = moving(m, 1500)
        ends[integrator] = np.concatenate([d.qpos[:2], d.qvel[:2], d.qvel[5:6]])
    for name, end in ends.items():
        assert np.abs(end - ends["EULER"]).max() < 0.01, name
        assert np.abs(end[:2]).max() > 0.3


def test_batch_equals_a_serial_loop_bit_for_bit(mj_model):
    currents = np.random.default_rng(4).uniform(-1.2, 1.2, (6, 4))
    serial = [state_of(mj_model, moving(mj_model, 250, c)) for c in currents]
    for threads in (1, 2):
        batch = mujoco.batch.Batch(mj_model, nsim=6, nthread=threads)
        batch.bind("ctrl")[:] = currents
        for _ in range(5):
            batch.step(nstep=50)
        assert np.array_equal(batch.state, np.array(serial))


def test_rollout_equals_a_serial_loop_bit_for_bit(mj_model):
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    size = mujoco.mj_stateSize(mj_model, full)
    currents = np.random.default_rng(5).uniform(-1.2, 1.2, (4, 4))
    start = np.empty(size)
    mujoco.mj_getState(mj_model, mujoco.MjData(mj_model), start, full)
    control = np.repeat(currents[:, None, :], 200, axis=1)
    with mujoco.rollout.Rollout(nthread=2) as rollout:
        data = [mujoco.MjData(mj_model) for _ in range(2)]
        states, sensed = rollout.rollout(mj_model, data, np.tile(start, (4, 1)), control)
    for k, current in enumerate(currents):
        d = moving(mj_model, 200, current)
        end = np.empty(size)
        mujoco.mj_getState(mj_model, d, end, full)
        assert np.array_equal(np.asarray(states)[k, -1], end)
        assert np.array_equal(np.asarray(sensed)[k, -1], d.sensordata)


def test_two_twins_with_different_floors_leave_each_other_alone(robot, floors):
    stone, ice = (robot_model(robot, floors[name]) for name in ("natural_stone", "ice"))
    alone = [state_of(m, moving(m, 400)) for m in (stone, ice)]
    assert not np.allclose(alone[0][:10], alone[1][:10])
    together = [mujoco.MjData(stone), mujoco.MjData(ice)]
    for d in together:
        d.ctrl[:] = CURRENTS
    for _ in range(400):
        for m, d in zip((stone, ice), together, strict=True):
            mujoco.mj_step(m, d)
    for m, d, expected in zip((stone, ice), together, alone, strict=True):
        assert np.array_equal(state_of(m, d), expected)


def test_a_model_saved_to_a_file_carries_its_parameters(robot, floors, tmp_path):
    ice = robot_model(robot, floors["ice"], lean=True)
    mujoco.mj_saveModel(ice, str(tmp_path / "robot.mjb"))
    again = mujoco.MjModel.from_binary_path(str(tmp_path / "robot.mjb"))
    assert np.array_equal(state_of(ice, moving(ice)), state_of(again, moving(again)))


def test_other_models_are_left_alone():
    m = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom type='plane' size='1 1 1'/><body pos='0 0 .2'><freejoint/>"
        "<geom size='.1'/></body></worldbody></mujoco>"
    )
    d = mujoco.MjData(m)
    mujoco.mj_step(m, d, 500)
    assert np.all(d.qfrc_passive == 0.0)
    assert d.qpos[2] == pytest.approx(0.1, abs=2e-3)


def test_the_layout_is_the_one_that_mujoco_binds():
    memory.check_offsets(memory.OFFSETS)


@pytest.mark.parametrize("field", [f for f in memory.Offsets._fields if f != "m_timestep"])
def test_a_wrong_offset_is_refused(field):
    wrong = memory.OFFSETS._replace(**{field: getattr(memory.OFFSETS, field) + 64})
    with pytest.raises(NativeLayoutError, match="refuses to run"):
        memory.check_offsets(wrong)


def test_another_library_s_callback_is_not_silenced():
    ours = mujoco.get_mjcb_passive()
    theirs = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(lambda m, d: None)
    mujoco.set_mjcb_passive(theirs)
    try:
        with pytest.raises(OmnimjError, match="mjcb_passive"):
            callback.install()
    finally:
        mujoco.set_mjcb_passive(ours)
