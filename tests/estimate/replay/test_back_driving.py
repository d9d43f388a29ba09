"""A gear that passes on another force where the motion drives the motor, against hand-written equations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from servo_logs import SERVO, write_servo_logs

from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.mjcf import kernels
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.estimate.replay.mjcf.rigid import RigidBodies
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.read_dataset import read_dataset

TRUTH = [0.012, 0.025, 0.52, 4.8, 0.0005]
ON = np.array([[True]])


def law_of(gear, gain, back_emf, efficiency):
    law = np.zeros(kernels.LAW)
    law[kernels.GEAR], law[kernels.GAIN], law[kernels.VELOCITY_GAIN] = gear, gain, -back_emf
    law[[kernels.LOW, kernels.DECLARED_LOW]], law[[kernels.HIGH, kernels.DECLARED_HIGH]] = -np.inf, np.inf
    law[kernels.BRAKING] = 1.0 / efficiency - 1.0
    law[kernels.FORCE_PER_UNIT] = gear * gain
    law[kernels.REST_SPEED], law[kernels.STRIBECK_VELOCITY] = 1e-3, 1.0
    return law


laws = st.builds(
    law_of,
    st.sampled_from([-3.0, 1.0, 20.0]),
    st.floats(0.05, 4.0),
    st.floats(0.0, 0.5),
    st.floats(0.3, 1.5),
)
inputs = st.floats(-2.0, 2.0)
speeds = st.floats(0.01, 2.0).flatmap(lambda v: st.sampled_from([v, -v]))


def balance(law, command, speed, needed):
    """What the balance of a joint at this speed lacks, its links needing a force."""
    found, friction = np.empty((1, 1)), np.empty((1, 1))
    numbers = (np.full((1, 1), one) for one in (0.0, speed, 0.0, needed, speed, speed, 1.0, command))
    given = kernels.Balance._make((np.zeros(1), *numbers, ON))
    kernels.missing_forces(law[None], kernels.no_curve(), given, found, friction)
    return found[0, 0] + friction[0, 0]


@given(laws, inputs, speeds)
def test_a_moving_joint_gets_the_force_of_its_motor_over_the_efficiency_where_it_brakes(law, command, speed):
    force = kernels.drive_force(law, command, 0.0, speed)
    share = 1.0 + law[kernels.BRAKING] if force * speed < 0.0 else 1.0
    assert -balance(law, command, speed, 0.0) == pytest.approx(share * force, rel=1e-9, abs=1e-9)


@given(laws, st.floats(-5.0, 5.0))
def test_a_gear_with_losses_holds_a_load_with_any_force_between_lifting_and_lowering(law, load):
    efficiency = 1.0 / (1.0 + law[kernels.BRAKING])
    weakest, strongest = sorted((min(efficiency, 1.0) * load, load))
    for share in (0.0, 0.5, 1.0):
        force = weakest + share * (strongest - weakest)
        lacking = balance(law, force / law[kernels.FORCE_PER_UNIT], 0.0, load)
        assert efficiency > 1.0 or lacking == pytest.approx(0.0, abs=1e-9)


@given(laws, inputs, speeds)
def test_the_input_that_a_motion_needs_is_found_from_its_force(law, command, speed):
    zero, v = np.zeros((1, 1)), np.array([[speed]])
    force = kernels.passed_on(law, kernels.drive_force(law, command, 0.0, speed), speed)
    found = np.array([[balance(law, 0.0, speed, force)]])
    kernels.to_inputs(law[None], zero, v, ON, found)
    assert found[0, 0] == pytest.approx(command, rel=1e-6, abs=1e-9)


@given(laws, inputs, speeds)
def test_an_error_of_the_input_gives_the_missing_force(law, command, speed):
    force = kernels.drive_force(law, command, 0.0, speed)
    tiny = 1e-6 * law[kernels.FORCE_PER_UNIT]
    lacking = np.array([[kernels.passed_on(law, force + tiny, speed) - kernels.passed_on(law, force, speed)]])
    kernels.to_input_errors(
        law[None], np.array([[command]]), np.zeros((1, 1)), np.array([[speed]]), ON, lacking
    )
    if abs(force) > abs(tiny):
        assert lacking[0, 0] == pytest.approx(1e-6, rel=1e-3)


@pytest.fixture(scope="module", params=[0.8, 1.15])
def driven_back(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("servo") / "gear"
    write_servo_logs(folder, runs=2, efficiency=request.param)
    return folder, request.param


def replay_of(folder):
    return MachineReplay(read_dataset(folder), read_machine_file(SERVO))


def test_a_servo_with_such_a_gear_needs_the_measured_voltage_and_moves_as_measured(driven_back, measured):
    (folder, efficiency), errors = driven_back, []
    replay = replay_of(folder)
    for effects in ({}, {"back_driving (motor)": np.array([efficiency])}):
        (found,) = replay.simulate([Setting(np.array(TRUTH), effects)])
        errors.append(np.sqrt(np.nanmean((replay.measured - found) ** 2, axis=0)))
    plain, true = errors
    measured("voltage of the true model [V]", float(true[0]), 0.1)
    measured("position of the true model after 0.5 s [rad]", float(true[1]), 0.004)
    assert true[0] < 0.1 and true[1] < 0.004
    assert plain[0] > 3.0 * true[0] and plain[1] > 3.0 * true[1]


@pytest.mark.slow
def test_mujoco_and_the_closed_form_agree_on_such_a_gear(driven_back, monkeypatch, measured):
    folder, efficiency = driven_back
    setting = Setting(np.array(TRUTH), {"back_driving (motor)": np.array([efficiency])})
    (closed,) = replay_of(folder).simulate([setting])
    with monkeypatch.context() as patch:
        patch.setattr(RigidBodies, "one_joint", lambda *_: None)
        (stepped,) = replay_of(folder).simulate([setting])
    wrong = np.sqrt(np.nanmean((closed - stepped) ** 2, axis=0)) / np.nanstd(stepped, axis=0)
    measured("difference of the two routes over the size of a channel [1]", float(wrong.max()), 2e-3)
    assert (wrong < 2e-3).all()


@pytest.mark.parametrize("name", ["load_friction", "stribeck", "position_friction"])
def test_extra_friction_is_never_less_than_none(driven_back, name):
    candidates = {c.label: c for c in replay_of(driven_back[0]).candidates}
    assert candidates[f"{name} (shaft)"].parameters[0].low == 0.0
