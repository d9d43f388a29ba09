"""What happens to wheel 1 in a shipped scenario, on the twin, to every other wheel: by symmetry.

The robot is the same after a quarter turn but for its wheels' numbers: wheel k stands where wheel 1 is after
k − 1 quarter turns clockwise. A drive and a patch are turned with it.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from nightly import latin, representative

from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.scenario import read_scenario

WHEELS = (1, 2, 3, 4)
ACCELERATING = 0.46
"""RMS current of wheel 1 in `degraded_motor` with a healthy motor [A]."""
STARTS = 0.5
"""Beginning of the acceleration in `nylon_patch` [s]."""
SIZES = (0.57, 0.8)
"""Levels 1 and 2 of the source."""


def quarter_turns(wheel):
    """From wheel 1 to this one, counter-clockwise."""
    return -(wheel - 1)


def turned(point, wheel):
    """A place or a size beside wheel 1, beside another wheel instead."""
    angle = 0.5 * math.pi * quarter_turns(wheel)
    c, s = round(math.cos(angle)), round(math.sin(angle))
    return c * point[0] - s * point[1], s * point[0] + c * point[1]


def direction(name, wheel):
    """The override that turns the drive."""
    velocity = read_scenario(name).drive.reference.velocity
    x, y = turned(velocity[np.argmax(np.hypot(*velocity.T))], wheel)
    return f"drive.direction={math.atan2(y, x)}"


def nylon(wheel):
    """`nylon_patch` with the sheet under another wheel."""
    (patch,) = read_scenario("nylon_patch").patches
    center, size = turned(patch.center, wheel), turned(patch.size, wheel)
    return (
        direction("nylon_patch", wheel),
        f"patches.0.center=[{center[0]}, {center[1]}]",
        f"patches.0.size=[{abs(size[0])}, {abs(size[1])}]",
    )


def weak(wheel, number):
    """`degraded_motor` with another motor."""
    fault = f'{{ kind = "motor", wheel = {wheel}, onset = 0.8, {number} }}'
    return direction("degraded_motor", wheel), f"faults=[{fault}]"


def driven(name, overrides):
    return run_scenario(read_scenario(name, overrides), "twin", "robust").metrics


def diagnosed(metrics):
    return [(d["kind"], d["wheels"]) for d in metrics["diagnoses"]]


def braking(share):
    """Torque of a second motor that eats a share of the current that the healthy motor takes [N.m]."""
    motor = read_scenario("degraded_motor").constants.motor
    return share * ACCELERATING * motor.torque_constant


@pytest.mark.parametrize("wheel", WHEELS)
def test_the_variant_for_wheel_1_is_the_scenario_itself_and_the_others_are_turned(wheel):
    scenario, own = read_scenario("nylon_patch"), read_scenario("nylon_patch", nylon(wheel))
    (patch,), (moved,) = scenario.patches, own.patches
    assert math.dist(moved.center, turned(patch.center, wheel)) < 1e-12
    assert moved.covers(own.wheel_positions).tolist() == [k == wheel for k in WHEELS]
    assert math.prod(moved.size) == pytest.approx(math.prod(patch.size))
    if wheel == 1:
        assert moved == patch
        assert np.allclose(own.drive.reference.velocity, scenario.drive.reference.velocity)


@pytest.mark.parametrize("wheel", representative(4, 3, 1, 2, keep=2))
def test_a_wheel_that_starts_on_nylon_is_named_in_time_and_let_go_in_time_and_nothing_else_is_named(wheel):
    metrics = driven("nylon_patch", nylon(wheel))
    (fault,) = metrics["faults"]
    assert (fault["kind"], fault["wheel"]) == ("slip", wheel)
    assert metrics["isolated"] and metrics["false_alarms"] == 0
    (found,) = metrics["diagnoses"]
    assert (found["kind"], found["wheels"]) == ("slip", [wheel])
    assert STARTS < found["time"] <= STARTS + 0.15
    assert fault["end"] < found["cleared"] <= fault["end"] + 0.3


@pytest.mark.parametrize(("wheel", "share"), latin((2, 3, 1, 4), SIZES))
def test_a_motor_that_loses_torque_is_isolated_and_nothing_else_is_named(wheel, share):
    metrics = driven("degraded_motor", weak(wheel, f"loss = {share}"))
    assert metrics["isolated"] and diagnosed(metrics) == [("motor", [wheel])]
    assert metrics["false_alarms"] == 0 and metrics["detection_delay"] <= 0.12


@pytest.mark.parametrize(("wheel", "share"), latin((2, 3, 1, 4), SIZES))
def test_a_second_motor_in_parallel_is_isolated_and_nothing_else_is_named(wheel, share):
    metrics = driven("degraded_motor", weak(wheel, f"braking_torque = {braking(share)}"))
    assert metrics["isolated"] and diagnosed(metrics) == [("motor", [wheel])]
    assert metrics["false_alarms"] == 0
