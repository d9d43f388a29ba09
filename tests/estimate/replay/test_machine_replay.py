import mujoco
import numpy as np
import pytest
from servo_logs import SERVO, write_servo_logs

from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.gap.check.acceptance import sound_dataset
from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.dataset import Dataset, Run
from omnimj.recording.read_dataset import read_dataset
from omnimj.resources import models_folder

TRUTH = [0.012, 0.025, 0.52, 4.8, 0.0005]


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("servo") / "loaded"
    write_servo_logs(folder, load_share=0.12, runs=3)
    return MachineReplay(read_dataset(folder), read_machine_file(SERVO))


def mismatch(replay, **effects):
    labels = {f"{name} (shaft)": np.array([value]) for name, value in effects.items()}
    (found,) = replay.simulate([Setting(np.array(TRUTH), labels)])
    return np.sqrt(np.nanmean((replay.measured - found) ** 2, axis=0))


def test_the_true_machine_needs_the_measured_voltage_and_moves_as_measured(loaded):
    voltage, position = mismatch(loaded, load_friction=0.12)
    assert voltage < 0.08 and position < 0.004
    other_voltage, other_position = mismatch(loaded)
    assert other_voltage > 3.0 * voltage and other_position > 5.0 * position


def test_an_effect_of_size_zero_changes_nothing(loaded):
    (plain,) = loaded.simulate([Setting(np.array(TRUTH))])
    for candidate in loaded.candidates:
        nulls = [s.typical if s.null_value is None else s.null_value for s in candidate.parameters]
        (other,) = loaded.simulate([Setting(np.array(TRUTH), {candidate.label: np.array(nulls)})])
        np.testing.assert_allclose(other, plain, atol=1e-9, err_msg=candidate.label)


def test_every_effect_of_typical_size_changes_a_channel(loaded):
    planar = {"grade (x)"}  # gravity turned about an axis in the plane of the swing
    for candidate in loaded.candidates:
        values = np.array([s.typical for s in candidate.parameters])
        settings = [Setting(np.array(TRUTH)), Setting(np.array(TRUTH), {candidate.label: values})]
        plain, other = loaded.simulate(settings)
        changed = np.nanmax(np.abs(other - plain)) > 1e-6
        assert changed or candidate.label in planar, candidate.label


@pytest.mark.slow
def test_rigid_body_forces_are_those_of_mujoco_for_two_links():
    machine = read_machine_file(models_folder() / "two_link_arm" / "two_link_arm.xml")
    time = np.arange(0.0, 3.0, 0.002)
    q = np.stack([0.8 * np.sin(3.0 * time), 0.6 * np.sin(5.0 * time + 1.0)], axis=1)
    columns = {"time": time, "position:shoulder": q[:, 0], "position:elbow": q[:, 1]}
    columns |= {f"control:{name}_motor": np.sin(time) for name in ("shoulder", "elbow")}
    replay = MachineReplay(Dataset(machine.file, "mjcf", (Run("a", columns, {}, {}),)), machine)
    forces = replay.input_balances()["control:elbow_motor"]
    m, d = machine.mj_model, mujoco.MjData(machine.mj_model)
    rows = np.flatnonzero(replay.log.valid[:, 1])[::100]
    for k in rows:
        log = replay.log
        d.qpos[:], d.qvel[:], d.qacc[:] = log.position[k], log.speed[k], log.acceleration[k]
        mujoco.mj_inverse(m, d)
        without = d.qfrc_inverse + d.qfrc_passive + d.qfrc_constraint
        at = int(np.flatnonzero(np.flatnonzero(replay.log.valid[:, 1]) == k)[0])
        assert forces[1][at] == pytest.approx(without[1], rel=1e-6, abs=1e-9)


def test_names_that_the_file_does_not_have_are_refused_with_the_choices(loaded):
    machine = read_machine_file(SERVO)
    time = np.arange(0.0, 2.0, 0.005)
    for name, choice in (("position:elbow", "shaft"), ("control:servo", "motor")):
        columns = {"time": time, "position:shaft": np.sin(time), "control:motor": time, name: time}
        dataset = Dataset(SERVO, "mjcf", (Run("a", columns, {}, {}),))
        with pytest.raises(UnknownNameError, match=f"unknown .* choices: {choice}"):
            MachineReplay(dataset, machine)


def test_an_actuator_without_input_is_refused():
    time = np.arange(0.0, 2.0, 0.005)
    dataset = Dataset(SERVO, "mjcf", (Run("a", {"time": time, "position:shaft": np.sin(time)}, {}, {}),))
    with pytest.raises(InputError, match=r"actuator 'motor' moves joint 'shaft'.*control:motor"):
        MachineReplay(dataset, read_machine_file(SERVO))


def test_a_joint_that_rests_is_named_and_has_no_candidates():
    time = np.arange(0.0, 4.0, 0.005)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(len(time))
    columns = {"time": time, "position:shaft": noise, "control:motor": 0.1 * np.sin(time)}
    replay = MachineReplay(Dataset(SERVO, "mjcf", (Run("a", columns, {}, {}),)), read_machine_file(SERVO))
    assert "shaft hardly moves" in replay.notes[0]
    assert not [c for c in replay.candidates if "shaft" in c.label and not c.is_sensor]


def test_a_command_of_the_wrong_sign_is_a_fault_of_the_data(tmp_path):
    write_servo_logs(tmp_path / "wrong", runs=2, sign=-1.0)
    with pytest.raises(InputError, match="control:motor acts against the motion"):
        sound_dataset(read_dataset(tmp_path / "wrong"), read_machine_file(SERVO))
