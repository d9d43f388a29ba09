"""The gear answers to the moment, and the size of all forces rests on the model file."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from omnimj.estimate.robot.balance import SensorErrors, wheel_forces
from omnimj.estimate.robot.blocks import PERIOD, RunRows
from omnimj.estimate.robot.identify import identify_robot
from omnimj.estimate.robot.smoothing import Shafts, Smoother, shafts_of, together
from omnimj.estimate.robot.unknowns import unknowns
from omnimj.parameters import read_robot
from omnimj.recording.read_dataset import read_dataset
from omnimj.simulate.suites.catalogue import find_suite
from omnimj.simulate.suites.recording import RecordingConfig, record_suite

WIDTH, STEP = 0.03, 1e-3
EXACT = SensorErrors(np.zeros(4), 0.0, 0.0, 0.0)


def rows_of(shafts, count):
    zero, many, good = np.zeros((count, 4)), np.zeros(count), np.ones(count, bool)
    numbers = (many, zero, shafts, zero, zero, zero[:, :2], many, many, zero)
    return RunRows("run", "", *numbers, np.zeros(count, int), good, ~good)


def braking(stretches=1):
    """A current that changes its direction within one width of the filter while all wheels go on turning."""
    time = STEP * np.arange(1001.0)
    current = np.interp(time, [0.48, 0.52], [0.4, -0.4])
    smoother = Smoother(time, np.arange(0.1, 0.9, PERIOD), WIDTH)
    part = shafts_of(smoother, [current] * 4, [np.full_like(time, 10.0)] * 4, 0.0, 0.0)
    return current, smoother, together([part] * stretches)


def test_a_robot_that_begins_to_brake_is_pushed_by_the_mean_of_the_forces():
    constants = unknowns(read_robot()).nominal
    c, axle, _ = constants
    current, smoother, shafts = braking()
    shaft = c.torque * current[:, None] - c.viscous * 10.0 - (c.dry - axle)
    force = np.where(shaft < 0.0, c.driven * shaft, shaft) - axle
    # the other route: the law at every sample, and the whole filter after it
    mean = gaussian_filter1d(force[:, 0], WIDTH / STEP, mode="nearest")
    exact = np.interp(smoother.rows, smoother.grid, mean)
    found = wheel_forces(constants, EXACT, rows_of(shafts, len(smoother.rows)))[:, 0]
    assert found == pytest.approx(exact, abs=0.01 * np.ptp(exact))
    smooth = smoother.filtered(current)[:, None] * np.ones(4)
    turning, zero = np.full_like(smooth, 10.0), np.zeros_like(smooth)
    of_means = wheel_forces(constants, EXACT, rows_of(Shafts(smooth, turning, zero, zero), len(smooth)))[:, 0]
    assert np.abs(of_means - exact).max() > 5.0 * np.abs(found - exact).max()


def test_stretches_between_gaps_do_not_touch_each_other():
    constants = unknowns(read_robot()).nominal
    _, smoother, one = braking()
    _, _, two = braking(2)
    alone = wheel_forces(constants, EXACT, rows_of(one, len(smoother.rows)))
    both = wheel_forces(constants, EXACT, rows_of(two, 2 * len(smoother.rows)))
    assert both == pytest.approx(np.vstack([alone, alone]), abs=1e-12)


def test_inertia_of_the_wheels_keeps_its_ratio_to_the_torque_constants():
    start = unknowns(read_robot())
    x = np.random.default_rng(1).normal(0.0, start.spread)
    c, nominal = start.constants(x), start.nominal
    torque = np.exp(np.log(c.robot.torque / nominal.robot.torque).mean())
    assert c.robot.inertia == pytest.approx(torque * nominal.robot.inertia)
    assert c.rotor == pytest.approx(torque * nominal.rotor)


@pytest.mark.slow
def test_healthy_drives_of_the_nominal_robot_give_its_numbers_back(tmp_path):
    robot = read_robot()
    config = RecordingConfig(tmp_path / "logs", plant="planar")
    record_suite(find_suite("robot_missions"), config, choose=lambda runs: runs[:4])
    found = identify_robot(read_dataset(config.folder), robot)
    assert found["torque_constant"].value == pytest.approx(robot.motor.torque_constant, rel=0.03)
    mass = found["mass_ratio"]
    assert mass.low <= mass.nominal <= mass.high and mass.value == pytest.approx(mass.nominal, rel=0.02)
    inertia = found["inertia_ratio"]
    assert inertia.low <= inertia.nominal <= inertia.high
    assert inertia.value == pytest.approx(inertia.nominal, rel=0.04)
