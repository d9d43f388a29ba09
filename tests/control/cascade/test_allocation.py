import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from published_map import published_jacobian

from omnimj.control.cascade.allocation import checked_weights, published_map, wheel_speed_target
from omnimj.errors import InputError
from omnimj.parameters import read_robot
from omnimj.physics.kinematics import rolling_matrix, weighted_inverse

ROBOT = read_robot()
P, U, L = ROBOT.wheel_positions, ROBOT.drive_directions, 0.25
TWIST = st.tuples(*[st.floats(-2.0, 2.0)] * 3)


def printed_solution(w, x, y, yaw_rate):
    """Eqs. 3.12-3.15 at θ = 0, written out by hand."""
    w1, w2, w3, w4 = w
    k, q = 0.5 / sum(w), yaw_rate * L
    return np.array(
        [
            -k * (q * (w2 + w4) + y * (w2 + 2 * w3 + w4) + x * (w2 - w4)),
            -k * (q * (w1 + w3) + x * (w1 + w3 + 2 * w4) + y * (w1 - w3)),
            -k * (q * (w2 + w4) + x * (w2 - w4) - y * (2 * w1 + w2 + w4)),
            k * (-q * (w1 + w3) + x * (w1 + 2 * w2 + w3) + y * (w3 - w1)),
        ]
    )


def test_published_map_of_this_robot_is_the_printed_jacobian():
    np.testing.assert_allclose(published_map(P, U), published_jacobian(0.0, L), atol=1e-15)


@given(st.tuples(*[st.floats(0.01, 1e4)] * 4), TWIST)
def test_published_scale_is_equations_3_12_to_3_15(weights, twist):
    found = weighted_inverse(published_map(P, U), weights) @ twist
    np.testing.assert_allclose(found, printed_solution(weights, *twist), atol=1e-9)


@given(TWIST)
def test_published_scale_is_half_and_a_quarter_of_rolling(twist):
    scaled = rolling_matrix(P, U) @ (np.array([0.5, 0.5, 0.25]) * twist)
    published = weighted_inverse(published_map(P, U), np.ones(4))
    np.testing.assert_allclose(published @ twist, scaled, atol=1e-12)


def test_three_wheels_are_enough():
    angles = np.radians([0.0, 120.0, 240.0])
    p = 0.2 * np.column_stack([np.cos(angles), np.sin(angles)])
    u = np.column_stack([-np.sin(angles), np.cos(angles)])
    np.testing.assert_allclose(rolling_matrix(p, u) @ [0.0, 0.0, 1.0], np.full(3, 0.2))
    forward = published_map(p, u)
    np.testing.assert_allclose(forward @ weighted_inverse(forward, np.ones(3)), np.eye(3), atol=1e-12)


def test_wheel_speed_target_is_the_matrix_product():
    b = np.arange(12.0).reshape(4, 3)
    found = [wheel_speed_target(b, i, 0.3, -0.2, 1.1) for i in range(4)]
    np.testing.assert_allclose(found, b @ [0.3, -0.2, 1.1])


def test_bad_weights_are_named():
    for weights in ([1.0, 1.0], [1.0, 0.0, 1.0, 1.0], [1.0, np.nan, 1.0, 1.0]):
        with pytest.raises(InputError, match=r"weights: .*4 positive numbers"):
            checked_weights(weights, 4)
