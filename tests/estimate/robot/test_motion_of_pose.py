"""Accelerations from a measured pose are those of the motion, behind the same filter as all else."""

from __future__ import annotations

import math
from types import MappingProxyType

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from omnimj.estimate.robot.measured_pose import (
    delay_behind_torques,
    least_width,
    motion_of_pose,
    pose_samples,
)
from omnimj.estimate.robot.smoothing import Smoother, sample_noise
from omnimj.recording.dataset import Run

RADIUS, TURN, SWING, BEAT = 0.8, 0.7, 0.3, 2.0


def pose(time):
    """A robot that circles with a swing in its heading, far from the origin of the camera."""
    x, y = 12.0 + RADIUS * np.cos(TURN * time), -7.0 + RADIUS * np.sin(TURN * time)
    return np.column_stack([x, y, 3.0 + TURN * time + SWING * np.sin(BEAT * time)])


def logged(log_rate=100.0, camera_rate=30.0, noise=(0.0, 0.0), delay=0.0, duration=20.0, seed=1):
    """A log in which each picture is held until the next one arrives."""
    rng = np.random.default_rng(seed)
    taken = np.arange(0.0, duration, 1.0 / camera_rate)
    seen = pose(taken) + rng.normal(size=(len(taken), 3)) * np.array([noise[0], noise[0], noise[1]])
    time = np.arange(0.0, duration, 1.0 / log_rate)
    rows = seen[np.maximum(np.searchsorted(taken + delay, time + 1e-9) - 1, 0)]
    columns = {"time": time, "x": rows[:, 0], "y": rows[:, 1], "heading": rows[:, 2]}
    return as_run(columns)


def as_run(columns, masked=MappingProxyType({})):
    return Run("run", MappingProxyType(columns), masked=masked, conditions=MappingProxyType({}))


def poses(run):
    found = pose_samples(run, slice(None))
    assert found is not None
    return found


def motion(run, width, late=0.0):
    smoother = Smoother(run.time, np.arange(4.0, run.time[-1] - 4.0, 0.03), width)
    return smoother.rows, motion_of_pose(poses(run), smoother, late)


def swung(time):
    """Heading relative to the tangent, yaw rate and yaw acceleration."""
    rate = TURN + SWING * BEAT * np.cos(BEAT * time)
    return SWING * np.sin(BEAT * time), rate, -SWING * BEAT**2 * np.sin(BEAT * time)


@pytest.mark.parametrize("log_rate, camera_rate", [(20.0, 20.0), (100.0, 30.0), (1000.0, 50.0)])
def test_a_circle_has_its_centripetal_acceleration_wherever_the_camera_stands(log_rate, camera_rate):
    rows, found = motion(logged(log_rate, camera_rate), 0.1)
    angle, rate, change = swung(rows)
    speed, pull = RADIUS * TURN, RADIUS * TURN**2
    # the heading at time 0 is 3 rad where the radius points along x
    toward = np.column_stack([np.cos(3.0 + angle), -np.sin(3.0 + angle)])
    assert found.acceleration == pytest.approx(-pull * toward, abs=0.015)
    across = np.column_stack([np.sin(3.0 + angle), np.cos(3.0 + angle)])
    assert found.velocity == pytest.approx(speed * across, abs=0.01)
    passed = math.exp(-0.5 * (BEAT * 0.1) ** 2)  # of the swing by the Gaussian
    assert found.yaw_rate - TURN == pytest.approx(passed * (rate - TURN), abs=0.01)
    assert found.yaw_acceleration == pytest.approx(passed * change, abs=0.04)


def test_noise_of_pictures_makes_the_noise_of_the_closed_form():
    noise, width, rate = 2e-3, 0.1, 30.0
    run, quiet = logged(noise=(noise, 0.0), duration=400.0), logged(duration=400.0)
    error = motion(run, width)[1].acceleration - motion(quiet, width)[1].acceleration
    expected = noise * math.sqrt(3.0 / rate / (8.0 * math.sqrt(math.pi) * width**5))
    assert error.std() == pytest.approx(expected, rel=0.1)
    samples = poses(run)
    assert samples.noise[:2] == pytest.approx([noise, noise], rel=0.1)
    width = least_width(samples)
    assert noise * math.sqrt(3.0 / rate / (8.0 * math.sqrt(math.pi) * width**5)) <= 0.0505


def test_pictures_keep_their_even_times_behind_a_log_with_a_step_of_its_own():
    samples = poses(logged(100.0, 30.0))
    assert np.diff(samples.time) == pytest.approx(1.0 / 30.0, abs=1e-5)
    uneven = logged(100.0, 30.0)
    kept = np.random.default_rng(4).uniform(size=len(uneven.time)) > 0.3
    lost = as_run({n: v[kept] for n, v in uneven.columns.items()})
    assert len(poses(lost).time) <= len(samples.time)


def test_a_pose_at_rest_may_repeat_and_a_silent_one_is_refused():
    run = logged(duration=4.0)
    still = {n: (v if n == "time" else np.full(len(v), 2.0)) for n, v in run.columns.items()}
    _, found = motion(as_run({**still, "time": run.time * 5.0}), 0.1)
    assert not found.acceleration.any() and not found.velocity.any()
    masked = MappingProxyType({"x": np.ones(len(run.time), bool)})
    assert pose_samples(as_run(dict(run.columns), masked), slice(None)) is None


@pytest.mark.parametrize("late", [-0.03, 0.0, 0.08])
def test_the_delay_behind_torques_does_not_depend_on_their_size(late):
    time, rng = np.arange(0.0, 40.0, 0.03), np.random.default_rng(2)

    def signal(t, k):
        return sum(np.sin((1.0 + 0.7 * j + 0.2 * k) * t + j * k) for j in range(1, 5))

    predicted = np.column_stack([1.4 * signal(time, k) for k in range(3)])
    measured = np.column_stack([signal(time - late, k) for k in range(3)])
    measured += 0.5 * gaussian_filter1d(rng.normal(size=measured.shape), 0.1 / 0.03, axis=0)
    assert delay_behind_torques(time, predicted, measured) == pytest.approx(late, abs=0.004)


def test_noise_of_samples_is_that_of_the_noise_and_not_of_the_motion():
    time, rng = np.arange(0.0, 60.0, 0.02), np.random.default_rng(3)
    noise = 1e-3 * rng.normal(size=len(time))
    assert sample_noise(np.sin(3.0 * time) + noise, 4) == pytest.approx(1e-3, rel=0.05)
    assert sample_noise(noise) == pytest.approx(1e-3, rel=0.05)
