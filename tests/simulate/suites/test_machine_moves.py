"""Test plan of any machine with an MJCF file: it stays in range, excites what it should, logs as a logger."""

from __future__ import annotations

import numpy as np
import pytest
from axis_logs import AXIS, FORCE_CONSTANT, MASS, axis_moves

from omnimj.cli.main import main
from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.plant.mujoco.machine import read_machine_file, with_part_effects
from omnimj.recording.read_dataset import read_dataset
from omnimj.resources import models_folder
from omnimj.simulate.machine.drive import Motion, declared_values, logged_run, machine_loop, simulated_rows
from omnimj.simulate.machine.truth import machine_truth
from omnimj.simulate.suites.machine import LOADED, MOTIONS, plan_motions

SERVO = models_folder() / "servo_arm" / "servo_arm.xml"
TRAVEL = float(AXIS.mj_model.jnt_range[0, 1])
(DRIVE,) = AXIS.drives


@pytest.mark.slow
def test_every_motion_stays_on_the_guide_and_below_the_force():
    for run in axis_moves():
        assert np.abs(run.columns["position"]).max() < TRAVEL
        assert np.abs(run.columns["force"]).max() < 0.9 * DRIVE.force_range[1]
        assert np.ptp(run.columns["position"]) > 0.05 * TRAVEL


@pytest.mark.slow
def test_every_motion_goes_both_ways():
    for run in axis_moves(seconds=8.0):
        speed = np.diff(run.columns["position"])
        assert (speed > 1e-5).sum() > 400
        assert (speed < -1e-5).sum() > 400


def test_a_seed_makes_the_same_dataset_again_and_another_seed_another():
    one, same, other = (axis_moves(seed=seed, seconds=2.0, count=2) for seed in (9, 9, 10))
    for a, b, c in zip(one, same, other, strict=True):
        assert all(np.array_equal(a.columns[name], b.columns[name]) for name in a.columns)
        assert not np.array_equal(a.columns["force"], c.columns["force"])


def test_a_payload_is_declared_by_the_mass_and_what_the_model_lacks_is_not():
    for runs in (axis_moves(seconds=1.0), axis_moves({"payload": {"mass": 20.0}}, seconds=1.0)):
        (loaded,) = [run for run in runs if run.conditions]
        assert (loaded.name, loaded.conditions["mass"]) == (LOADED, pytest.approx(MASS + 5.5))


def test_a_log_of_current_is_force_over_its_constant():
    (force,) = axis_moves(seconds=1.0, count=1)
    (current,) = axis_moves(seconds=1.0, count=1, current=True, velocity=True)
    assert set(current.columns) == {"time", "current", "position", "velocity"}
    assert np.allclose(current.columns["current"] * FORCE_CONSTANT, force.columns["force"])


def test_a_declared_force_of_a_weak_drive_is_that_of_its_current():
    weak = with_part_effects(AXIS, {"torque_constant": {"scale": 0.8}})
    loop, truth = machine_loop(AXIS, 1e-3), machine_truth(weak, declared_values(AXIS))
    rows = simulated_rows(truth, loop.loop, loop.plan(0, Motion(2.0)))
    (true,) = rows[:, 3].T
    logged = logged_run("a", truth, rows, 0, loop.period).columns["force:drive"]
    assert logged @ true / (true @ true) == pytest.approx(1.0 / 0.8, rel=1e-3)


@pytest.mark.slow
def test_any_machine_is_recorded_and_its_true_effect_leaves_only_noise(tmp_path):
    order = ["record", "machine_moves", "--model", str(SERVO), "--repeats", "1", "--seed", "3"]
    hidden = ["--effect", "viscous:coefficient=0.05", "--out", str(tmp_path / "data")]
    assert main([*order, *hidden]) == 0
    dataset, machine = read_dataset(tmp_path / "data"), read_machine_file(SERVO)
    assert [run.name for run in dataset.runs] == sorted([*MOTIONS, LOADED])
    left = []
    true = with_part_effects(machine, {"viscous": {"coefficient": 0.05}})  # of the only joint
    for known in (machine, true):
        replay = MachineReplay(dataset, known)
        (found,) = replay.simulate([Setting(np.array([b.nominal for b in replay.base]))])
        left.append(np.sqrt(np.nanmean((replay.measured - found) ** 2, axis=0)))
    assert (left[1] < 0.2 * left[0]).all()


def test_a_machine_without_a_file_is_refused(tmp_path, capsys):
    assert main(["record", "machine_moves", "--out", str(tmp_path / "data")]) == 2
    assert "needs its MJCF file" in capsys.readouterr().err
    assert not (tmp_path / "data").exists()


def test_an_effect_needs_its_part_where_there_are_several(tmp_path, capsys):
    arm = models_folder() / "two_link_arm" / "two_link_arm.xml"
    order = ["record", "machine_moves", "--model", str(arm), "--out", str(tmp_path / "data")]
    assert main([*order, "--effect", "viscous:coefficient=0.1"]) == 2
    assert "'joint' is missing; name one of the choices; choices: elbow, shoulder" in capsys.readouterr().err
    assert main([*order, "--effect", "viscous:coefficient=0.1,joint=hip"]) == 2
    assert "choices: " in capsys.readouterr().err


def test_the_plan_of_an_arm_moves_every_joint():
    machine = read_machine_file(models_folder() / "two_link_arm" / "two_link_arm.xml")
    *plain, loaded = plan_motions(machine, 0)
    assert [one.name for one in plain] == list(MOTIONS) and not any(one.conditions for one in plain)
    (stated,) = loaded.conditions
    assert stated == f"mass:{machine.parts('body')[-1]}"
