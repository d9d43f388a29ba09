"""Kinematics: the law of rigid rolling, the published matrix, and what lies between them."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from published_map import published_jacobian, rotation

from omnimj.parameters import read_robot
from omnimj.physics.kinematics import rolling_matrix, weighted_inverse

ROBOT = read_robot()
L = 0.25
A = rolling_matrix(ROBOT.wheel_positions, ROBOT.drive_directions)
yaws = st.floats(-math.pi, math.pi)
twists = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
weights = st.tuples(*[st.floats(1.0, 1e4)] * 4)


@given(twists)
def test_rolling_speeds_are_the_printed_ones(twist):
    x, y, turn = twist  # Eqs. 3.50-3.53
    printed = [-y - turn * L, -x - turn * L, y - turn * L, x - turn * L]
    assert_allclose(A @ twist, printed, atol=1e-14)


@given(twists)
def test_opposite_wheels_share_their_sum(twist):
    v = A @ twist
    assert abs(v[0] + v[2] - v[1] - v[3]) < 1e-14


@given(yaws)
def test_the_printed_matrix_is_the_true_map_times_2_2_4(yaw):
    assert_allclose(published_jacobian(yaw, L) @ A @ rotation(yaw).T, np.diag([2.0, 2.0, 4.0]), atol=1e-13)


@given(yaws, twists, weights)
def test_weighted_inverse_is_the_printed_closed_form(yaw, twist, w):
    x, y, turn = twist
    w1, w2, w3, w4 = w
    s, c, k = math.sin(yaw), math.cos(yaw), 0.5 / sum(w)
    printed = [  # Eqs. 3.12-3.15
        -k * (turn * L * (w2 + w4) + y * (s * (w2 - w4) + c * (w2 + 2 * w3 + w4)))
        - k * x * (c * (w2 - w4) - s * (w2 + 2 * w3 + w4)),
        -k * (turn * L * (w1 + w3) + x * (s * (w3 - w1) + c * (w1 + w3 + 2 * w4)))
        - k * y * (c * (w1 - w3) + s * (w1 + w3 + 2 * w4)),
        -k * (turn * L * (w2 + w4) + x * (c * (w2 - w4) + s * (w2 + 2 * w1 + w4)))
        - k * y * (s * (w2 - w4) - c * (2 * w1 + w2 + w4)),
        k * (-turn * L * (w1 + w3) + x * (s * (w1 - w3) + c * (w1 + 2 * w2 + w3)))
        + k * y * (c * (w3 - w1) + s * (w1 + 2 * w2 + w3)),
    ]
    assert_allclose(weighted_inverse(published_jacobian(yaw, L), w) @ twist, printed, atol=1e-9)


@given(yaws, weights)
def test_weighted_inverse_is_a_right_inverse(yaw, w):
    j = published_jacobian(yaw, L)
    assert_allclose(j @ weighted_inverse(j, w), np.eye(3), atol=1e-9)


@given(twists, weights)
def test_weights_only_add_slip_of_all_wheels(twist, w):
    true_map = np.diag([0.5, 0.5, 0.25]) @ published_jacobian(0.0, L)
    extra = weighted_inverse(true_map, w) @ twist - A @ twist
    assert_allclose(extra, extra[0] * np.array([1.0, -1.0, 1.0, -1.0]), atol=1e-9)
