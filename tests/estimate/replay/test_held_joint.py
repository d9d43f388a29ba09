"""A joint that dry friction holds: neither noise of its encoder nor a filter must look like motion."""

from pathlib import Path

import numpy as np
import pytest

from omnimj.estimate.intervals import block_noise
from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.plant.mujoco.machine import read_machine_file, with_part_effects
from omnimj.recording.dataset import Dataset
from omnimj.resources import models_folder
from omnimj.signals import Array
from omnimj.simulate.machine.drive import declared_values, logged_run, machine_loop, simulated_rows
from omnimj.simulate.machine.truth import machine_truth
from omnimj.simulate.suites.machine import drive_motion, plan_motions
from omnimj.simulate.suites.suite import RunConfig

SERVO = read_machine_file(models_folder() / "servo_arm" / "servo_arm.xml")
GRIPPER = read_machine_file(Path(__file__).parents[2] / "data" / "machines" / "gripper.xml")
SLOW = ("slow", "crawl")


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.02, 0.05])
def test_a_joint_that_creeps_with_known_friction_lacks_no_command(friction, measured):
    known = with_part_effects(SERVO, {"coulomb": {"force": friction}})
    moves = [one.drive for one in plan_motions(SERVO, 0) if one.name in SLOW]
    runs = tuple(drive_motion(known, SERVO, one, RunConfig("twin", seed)) for seed, one in enumerate(moves))
    replay = MachineReplay(Dataset(SERVO.file, "mjcf", runs), known)
    resting = np.mean(np.abs(replay.log.speed) < 3.0 * replay.log.speed_noise)
    assert resting > 0.3
    (found,) = replay.simulate([Setting(np.array([b.nominal for b in replay.base]))])
    error = (replay.measured - found)[:, 0]
    held = 2.0 * (0.02 + friction) * 4.0 / 0.4  # of the command, between the two directions of friction [V]
    share = float(np.sqrt(np.nanmean(error**2))) / held
    measured("command that a held joint lacks, over the jump of its friction [1]", share, 0.05)
    assert share < 0.05


def gripper_errors(rest: float) -> tuple[MachineReplay, Array]:
    """Replay of a gripper that follows its plan and then stays where it is; errors of its true model."""
    loop, truth = machine_loop(GRIPPER), machine_truth(GRIPPER, declared_values(GRIPPER))
    runs = []
    for seed in range(3):
        plan = loop.plan(seed)
        more = ((0, round(rest * len(plan.goal))), (0, 0))
        goal, force = (np.pad(values, more, mode="edge") for values in (plan.goal, plan.force))
        held = plan._replace(goal=goal, rate=np.pad(plan.rate, more), force=force)
        runs.append(logged_run(f"run_{seed}", truth, simulated_rows(truth, loop.loop, held), seed))
    replay = MachineReplay(Dataset(GRIPPER.file, "mjcf", tuple(runs)), GRIPPER)
    (found,) = replay.simulate([Setting(np.array([b.nominal for b in replay.base]))])
    return replay, replay.measured - found


@pytest.mark.slow
def test_a_joint_that_rests_between_its_strokes_lacks_no_command(measured):
    error = gripper_errors(0.0)[1][:, :2]
    share = float(np.sqrt(np.nanmean(error**2))) / (2.0 * 1.5 / 15.0)
    measured("command that a finger lacks, over the jump of its friction [1]", share, 0.01)
    assert share < 0.01


@pytest.mark.slow
def test_a_log_that_rests_most_of_its_time_has_the_noise_of_its_motion():
    noise = {rest: block_noise(*gripper_errors(rest)) for rest in (0.0, 3.0)}
    assert noise[3.0] == pytest.approx(noise[0.0], rel=0.25)
    error = gripper_errors(3.0)[1]
    assert (np.sqrt(np.nanmean(error**2, axis=0)) < 1.1 * noise[3.0]).all()
