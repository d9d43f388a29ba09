"""Runs of the axis: sensors, amplifier, controller."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from omnimj.effects import with_effects
from omnimj.errors import InputError
from omnimj.parameters import read_axis
from omnimj.plant.axis import AxisController, drive_axis, servo

AXIS = read_axis()
PERIOD = 1.0 / AXIS.sensors.sample_rate


def sines(duration=3.0):
    t = np.arange(round(duration / PERIOD)) * PERIOD
    w = 2.0 * np.pi * 0.5
    return np.stack([-0.1 * np.cos(w * t), 0.1 * w * np.sin(w * t), 0.1 * w * w * np.cos(w * t)], axis=1)


def drive(axis=AXIS, controller=None, **options):
    return drive_axis(axis, sines(), controller or servo(AXIS), **options)


def test_the_servo_follows_its_target():
    found = drive()
    assert np.abs(found["true_position"] - sines()[:, 0]).max() < 5e-4


def test_one_seed_gives_one_run_and_another_seed_another():
    a, b, c = drive(seed=1), drive(seed=1), drive(seed=2)
    assert all(np.array_equal(a[name], b[name]) for name in a)
    assert not np.array_equal(a["force"], c["force"])


def test_sensors_have_the_stated_noise_and_steps():
    found, s = drive(seed=5), AXIS.sensors
    error = found["position"] - found["true_position"]
    assert error.std() == pytest.approx(np.hypot(s.position_noise, s.position_resolution / 12**0.5), rel=0.05)
    counts = found["position"] / s.position_resolution
    assert np.allclose(counts, np.rint(counts), atol=1e-6)
    assert (found["velocity"] - found["true_velocity"]).std() == pytest.approx(s.velocity_noise, rel=0.05)


@pytest.mark.parametrize(
    ("effect", "values", "column", "expected"),
    [
        ("position_scale", {"scale": 1.1}, "position", lambda x: 1.1 * x["true_position"]),
        ("velocity_scale", {"scale": 0.9}, "velocity", lambda x: 0.9 * x["true_velocity"]),
        (
            "sensor_delay",
            {"delay": 0.003, "channel": "velocity"},
            "velocity",
            lambda x: np.concatenate([np.full(3, x["true_velocity"][0]), x["true_velocity"][:-3]]),
        ),
        (
            "sensor_delay",
            {"delay": 0.0025, "channel": "position"},
            "position",
            lambda x: np.interp(x["time"] - 0.0025, x["time"], x["true_position"]),
        ),
    ],
)
def test_a_sensor_effect_changes_what_is_read(effect, values, column, expected):
    found = drive(with_effects(AXIS, {effect: values}), ideal_sensors=True)
    assert np.allclose(found[column], expected(found), rtol=0.0, atol=1e-12)


def test_a_scaled_and_biased_monitor_shows_other_forces_for_the_same_motion():
    plain = drive(ideal_sensors=True)
    axis = with_effects(AXIS, {"current_scale": {"scale": 1.2}, "current_bias": {"bias": 0.5}})
    found = drive(axis, ideal_sensors=True)
    assert np.array_equal(found["true_position"], plain["true_position"])
    assert np.allclose(found["force"], 1.2 * plain["force"] + 0.5 * AXIS.axis.force_constant)


def test_feedback_hides_a_gap_from_position_and_shows_it_in_force():
    plain, more = (
        drive(ideal_sensors=True),
        drive(with_effects(AXIS, {"coulomb": {"force": 10.0}}), ideal_sensors=True),
    )
    moved = np.abs(plain["true_velocity"]) > 0.05
    position = np.abs(more["position"] - plain["position"])[moved].max() / 0.1
    force = np.abs(more["force"] - plain["force"])[moved].mean() / np.abs(plain["force"]).max()
    assert position < 2e-3
    assert force > 20.0 * position


def test_the_force_stays_below_its_limit():
    axis = dataclasses.replace(AXIS, axis=dataclasses.replace(AXIS.axis, force_limit=30.0))
    assert np.abs(drive(axis, ideal_sensors=True)["force"]).max() <= 30.0


def test_gains_that_no_axis_bears_are_refused():
    wild = AxisController(stiffness=1e12, damping=1e12, mass=95.0)
    axis = dataclasses.replace(AXIS, axis=dataclasses.replace(AXIS.axis, force_limit=1e300))
    with pytest.raises(InputError, match="softer gains"):
        drive(axis, wild)
