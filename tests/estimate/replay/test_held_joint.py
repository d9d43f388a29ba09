"""A joint that dry friction holds, behind a noisy encoder: noise alone must not look like motion."""

import numpy as np
import pytest

from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.plant.mujoco.machine import read_machine_file, with_part_effects
from omnimj.recording.dataset import Dataset
from omnimj.resources import models_folder
from omnimj.simulate.suites.machine import drive_motion, plan_motions
from omnimj.simulate.suites.suite import RunConfig

SERVO = read_machine_file(models_folder() / "servo_arm" / "servo_arm.xml")
SLOW = ("slow", "crawl")


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
