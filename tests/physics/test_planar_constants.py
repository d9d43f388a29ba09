"""A robot's numbers for the planar model: payload and static balance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from omnimj.errors import InputError
from omnimj.parameters import read_robot
from omnimj.physics.planar import body_at, planar_constants
from omnimj.physics.planar_wheel import planar_wheel_at

ROBOT = read_robot()
PLAIN = planar_constants(ROBOT)


def normal_forces(constants):
    return np.array([planar_wheel_at(row).normal for row in constants.wheels])


@given(st.floats(-3.0, 20.0), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
def test_static_normal_forces_balance_the_weight(mass, x, y):
    constants = planar_constants(ROBOT, payload=(mass, x, y))
    normal, p = normal_forces(constants), ROBOT.wheel_positions
    assert normal.sum() == pytest.approx((ROBOT.body.mass + mass) * 9.81)
    assert_allclose(p.T @ normal, mass * 9.81 * np.array([x, y]), atol=1e-9)
    assert_allclose(normal_forces(PLAIN), ROBOT.body.mass * 9.81 / 4)


@given(st.floats(-3.0, 20.0), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
def test_yaw_inertia_is_that_of_two_bodies_about_their_common_centre(extra, x, y):
    mass, reduced = ROBOT.body.mass, ROBOT.body.mass * extra / (ROBOT.body.mass + extra)
    body = body_at(planar_constants(ROBOT, payload=(extra, x, y)).body)
    assert body.mass == pytest.approx(mass + extra)
    assert body.yaw_inertia == pytest.approx(ROBOT.body.yaw_inertia + reduced * (x * x + y * y))
    assert_allclose([body.com_x, body.com_y], extra / (mass + extra) * np.array([x, y]))


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        ((-16.0, 0.0, 0.0), "payload.mass: found -16; must leave mass on the robot's 15.837 kg"),
        ((40.0, 0.9, 0.0), "lifts wheel 3 off the floor"),
        ((-9.0, 0.5, 0.0), "leaves no yaw inertia"),
    ],
)
def test_a_payload_that_cannot_be_is_refused(payload, words):
    with pytest.raises(InputError, match=words):
        planar_constants(ROBOT, payload=payload)
