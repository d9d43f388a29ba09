"""Wheels whose rollers' axes are turned: kinematics, force and motion against second routes."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from other_robots import STRAIGHT, mecanum, star

from omnimj.errors import InputError
from omnimj.parameters import read_robot
from omnimj.parameters.robot import WheelMount, roller_sin_cos
from omnimj.physics.kinematics import rolling_matrix
from omnimj.physics.planar import planar_constants
from omnimj.physics.planar_wheel import contact_force, contact_velocity, planar_wheel_at, wheel_velocity
from omnimj.plant.planar import PlanarRobot
from omnimj.signals import CurrentCommand

ANGLES = st.floats(math.pi / 9.0, 8.0 * math.pi / 9.0)
SPEEDS = st.floats(-2.0, 2.0)


def with_rollers(angle):
    robot = star(5, 0.3, 0.4)
    return dataclasses.replace(
        robot, wheels=tuple(dataclasses.replace(w, roller_angle=angle) for w in robot.wheels)
    )


def test_rollers_across_the_axle_are_exactly_those_of_an_omni_wheel():
    assert roller_sin_cos(STRAIGHT) == (1.0, 0.0)
    robot = read_robot()
    assert np.array_equal(robot.rolling_directions, robot.drive_directions)


@pytest.mark.slow
@given(ANGLES, SPEEDS, SPEEDS, SPEEDS)
def test_wheels_at_the_speeds_of_the_rolling_matrix_do_not_slip_whatever_the_angle(angle, v_x, v_y, turn):
    robot = with_rollers(angle)
    rows = planar_constants(robot).wheels
    speeds = rolling_matrix(robot.wheel_positions, robot.rolling_directions) @ (v_x, v_y, turn)
    sides = rolling_matrix(robot.wheel_positions, robot.side_directions) @ (v_x, v_y, turn)
    for row, rim, side in zip(rows, speeds, sides, strict=True):
        wheel = planar_wheel_at(row)
        slip, sideways = contact_velocity(wheel, rim, *wheel_velocity(wheel, v_x, v_y, turn))
        assert slip == pytest.approx(0.0, abs=1e-12)
        assert sideways == pytest.approx(side, abs=1e-12)


@pytest.mark.slow
@given(ANGLES, SPEEDS, SPEEDS, SPEEDS, SPEEDS, SPEEDS)
def test_the_floor_takes_as_much_power_from_wheel_and_body_as_slip_and_rollers_waste(
    angle, rim, along, across, traction, drag
):
    wheel = planar_wheel_at(planar_constants(with_rollers(angle)).wheels[0])
    ahead, aside = contact_force(wheel, traction, drag)
    slip, sideways = contact_velocity(wheel, rim, along, across)
    given_up = ahead * along - aside * across - ahead * rim
    assert given_up == pytest.approx(-traction * slip - drag * sideways, abs=1e-12)


def test_a_mecanum_wheel_without_drag_is_an_omni_wheel_along_its_rollers_with_a_smaller_radius():
    """The floor feels the rollers' axis alone: r φ̇ sin γ along it, and F there is a torque r F sin γ."""
    whole = mecanum(0.24, 0.18, 1.0)
    wheel = dataclasses.replace(whole.wheel, roller_dry=0.0, roller_viscous=0.0, rolling_resistance=0.0)
    bearing = dataclasses.replace(whole.bearing, dry=0.0, viscous=0.0)
    turned = dataclasses.replace(whole, wheel=wheel, bearing=bearing)
    same = dataclasses.replace(
        turned,
        wheel=dataclasses.replace(wheel, radius=wheel.radius * math.sin(1.0)),
        wheels=tuple(WheelMount(w.position, w.roller_axis) for w in turned.wheels),
    )
    one, other = (PlanarRobot(robot, "natural_stone", ideal_sensors=True) for robot in (turned, same))
    one.reset()
    other.reset()
    rng = np.random.default_rng(1)
    for current in np.repeat(rng.uniform(-1.2, 1.2, (8, 4)), 100, axis=0):
        one.step(CurrentCommand(current))
        other.step(CurrentCommand(current))
    assert np.abs(one.truth()[:6]).max() > 0.1
    assert one.truth() == pytest.approx(other.truth(), abs=1e-9)


def test_a_roller_that_lies_along_the_axle_is_refused(tmp_path):
    text = read_robot(Path("three_wheel")).file.read_text(encoding="utf-8")
    path = tmp_path / "robot.toml"
    own = 'roller_angle = { value = 0.1, unit = "rad", source = "chosen" }\n'
    path.write_text(text.replace("position =", f"{own}position =", 1), encoding="utf-8")
    with pytest.raises(InputError, match=r"wheels\.1\.roller_angle: found 0\.1; must be at least 0\.349"):
        read_robot(path)
