"""The force channel against routes that share nothing with it: dense least squares, finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.stats import norm

from omnimj.control.detection.robust.accommodation import Accommodation
from omnimj.control.detection.robust.blocks import Block
from omnimj.control.detection.robust.force_balance import (
    NOISE,
    VISCOUS_AT,
    Recent,
    balance,
    columns,
    gear_column,
    lasting,
    roller_speeds,
    rolling_velocity,
    whiten,
)
from omnimj.control.detection.robust.glr import (
    FILLED,
    LONGEST_WINDOW,
    WINDOWS,
    JumpScores,
    initial_history,
    inverted,
    likelihood_ratios,
    no_scores,
    push_block,
)
from omnimj.control.detection.robust.parameter_filter import (
    LOSS,
    parameter_model,
    prior_deviation,
    short_term_precision,
    significant_losses,
    update_parameters,
)
from omnimj.control.robot_constants import robot_constants
from omnimj.parameters import read_robot
from omnimj.physics.kinematics import rolling_matrix

ROBOT = read_robot()
N, P = 4, columns(4)
C = robot_constants(ROBOT)
NONE = np.zeros(N, bool)
HEALTHY = Accommodation(~NONE, NONE, np.zeros(2, bool), NONE, np.zeros(N), False)
ANY_JUMP = parameter_model(N, 0.01, 120.0)._replace(
    smallest=np.full(2 * N + 2, -50.0), largest=np.full(2 * N + 2, 50.0)
)


def balanced(current, speed, acceleration=(0.3, -0.2), turning=0.1, spin=0.5, loss=None, theta=None, robot=C):
    """X and ρ of one block."""
    x, rho, force, side = np.zeros((3, P)), np.zeros(3), np.zeros(N), np.zeros(N)
    theta = np.zeros(P) if theta is None else theta
    current = np.asarray(current, float)
    block = Block(
        current,
        np.asarray(speed, float),
        np.asarray(acceleration, float),
        turning,
        np.zeros(N),
        spin,
        current,
        0.01,
    )
    known = HEALTHY if loss is None else HEALTHY._replace(losses=loss)
    roller_speeds(robot, block, np.zeros(2), side)
    balance(robot, block, theta, known, side, x, rho, force)
    return x, rho


def scored(x, rho, theta, cov) -> JumpScores:
    """Scores of some whitened blocks."""
    history, found = initial_history(P), no_scores(N)
    for own, right in zip(x, rho, strict=True):
        push_block(history, np.concatenate((own.ravel(), right, np.zeros(3))))
    likelihood_ratios(history, theta, np.linalg.inv(cov), ANY_JUMP, found)
    return found


def test_forces_are_the_transpose_of_rolling():
    assert C.forces == pytest.approx(rolling_matrix(ROBOT.wheel_positions, ROBOT.drive_directions).T)


@pytest.mark.parametrize("current", [(0.5, 0.3, -0.4, 0.6), (-0.5, 0.3, 0.9, -0.6)])
@pytest.mark.parametrize("wheel", range(N))
def test_a_loss_of_torque_constant_changes_the_balance_by_its_column(current, wheel):
    speed = (8.0, -5.0, -7.0, 9.0)
    x, before = balanced(current, speed)
    _, after = balanced(current, speed, loss=np.eye(N)[wheel] * 0.2)
    assert before - after == pytest.approx(0.2 * x[:, wheel], abs=1e-9)


BRAKED = ((-0.5, 0.3, 0.9, -0.6), (8.0, -5.0, -7.0, 9.0))
"""Currents and speeds of four wheels that the floor drives."""


def test_a_gear_of_another_driven_side_changes_the_balance_of_braked_wheels_by_its_column():
    current, speed = BRAKED
    gear = gear_column(N)
    other = C._replace(driven=C.driven * 0.7)
    x, before = balanced(current, speed)
    _, after = balanced(current, speed, robot=other)
    assert before - after == pytest.approx(-0.3 * x[:, gear], abs=1e-9)
    assert np.abs(x[:, gear]).max() > 1.0
    driving, _ = balanced(np.abs(current) * np.sign(speed), speed)
    assert not driving[:, gear].any()


def test_with_the_learnt_gear_the_law_is_exact_for_losses_and_friction_together():
    """The law is bilinear: columns at the learnt γ, and ρ at the nominal one."""
    current, speed = BRAKED
    theta, gear = np.zeros(P), gear_column(N)
    theta[gear] = -0.344  # E² − 1: a gear that multiplies by E in both directions
    truth = theta.copy()
    truth[1], truth[N + 2], truth[gear + 1] = 0.2, 0.5, 0.8
    driven, viscous = C.driven * (1.0 + theta[gear]), C.viscous + 0.8 * C.dry / VISCOUS_AT
    dry = C.dry * (1.0 + truth[N : 2 * N])
    robot = C._replace(driven=driven, viscous=viscous, dry=dry)
    x, before = balanced(current, speed, theta=theta)
    _, after = balanced(current, speed, loss=np.eye(N)[1] * 0.2, robot=robot)
    assert before - after == pytest.approx(x @ truth, abs=1e-9)


def test_a_centre_of_mass_beside_the_accelerometer_changes_the_balance_by_newtons_law():
    """Second route: the acceleration of the centre of mass of a rotating body, and the moment about it."""
    c, a, spin, turning = np.array([0.02, -0.01]), np.array([0.3, -0.2]), 0.5, 0.1
    x, before = balanced((0.5, 0.3, -0.4, 0.6), (8.0, -5.0, -7.0, 9.0))
    at_centre = a + spin * np.array([-c[1], c[0]]) - turning**2 * c
    # about the origin: I₀ ω̇ + m c × a, with I₀ that of the origin
    moment = C.mass * (c[0] * a[1] - c[1] * a[0])
    _, after = balanced((0.5, 0.3, -0.4, 0.6), (8.0, -5.0, -7.0, 9.0), robot=C._replace(centre=c))
    assert before - after == pytest.approx([*(C.mass * (at_centre - a)), moment])
    assert before - after == pytest.approx(x[:, gear_column(N) + 2 : gear_column(N) + 4] @ c)


def test_an_accelerometer_bias_changes_the_balance_by_its_column():
    x, before = balanced((0.5, 0.3, -0.4, 0.6), (8.0, -5.0, -7.0, 9.0))
    _, after = balanced((0.5, 0.3, -0.4, 0.6), (8.0, -5.0, -7.0, 9.0), acceleration=(0.3 + 0.05, -0.2 - 0.07))
    assert after - before == pytest.approx(0.05 * x[:, 2 * N] - 0.07 * x[:, 2 * N + 1])


def test_wheels_that_roll_measure_the_velocity():
    twist = np.array([0.4, -0.7, 0.3])
    speed = C.forces.T @ twist / ROBOT.wheel.radius
    assert rolling_velocity(C, speed, twist[2], np.ones(4, bool), -1) == pytest.approx(twist[:2])


@pytest.mark.slow
def test_whitened_noise_has_the_size_one():
    rng = np.random.default_rng(0)
    slowest, sideways = np.array([0.1, 9, 9, 9.0]), np.array([1.0, 1, 0.01, 1])
    unknown = HEALTHY._replace(unknown_force=np.array([False, False, False, True]))
    x, rho = np.zeros((3, P)), np.zeros(3)
    x[:, 2 * N + 2 : 2 * N + 5] = np.eye(3)
    whiten(C, np.zeros(P), np.zeros(N), Recent(slowest, sideways, np.zeros(N)), unknown, x, rho)
    factor = x[:, 2 * N + 2 : 2 * N + 5]  # L⁻¹
    cov = np.linalg.inv(factor) @ np.linalg.inv(factor).T
    sample = factor @ np.linalg.cholesky(cov) @ rng.standard_normal((3, 20000))
    assert np.cov(sample) == pytest.approx(np.eye(3), abs=0.05)
    # the force of wheel 4, which drives along x, is unknown: nothing is left of that direction
    assert np.linalg.norm(factor @ C.forces[:, 3]) < 0.05 * np.linalg.norm(factor @ C.forces[:, 1])


@pytest.mark.parametrize(
    ("current", "weak", "judged"), [(1.5, True, True), (1.5, False, False), (0.3, True, False)]
)
def test_a_slow_wheel_informs_on_its_motor_only_when_that_is_known_to_be_weak_and_gets_much_current(
    current, weak, judged
):
    currents, slow = np.array([current, 0.0, 0.0, 0.0]), np.array([0.1, 9.0, 9.0, 9.0])
    x, rho = balanced(currents, (0.0, 9.0, -9.0, 9.0))
    rows, known = x.copy(), HEALTHY._replace(degraded=np.array([weak, False, False, False]))
    whiten(C, np.zeros(P), currents, Recent(slow, np.ones(N), np.zeros(N)), known, x, rho)
    assert bool(x[:, 0].any()) is judged
    if judged:  # of the same balance as the others, with any friction that the wheel may hold
        assert x[:, lasting(N)].tolist() == [0.0] * 3
        spread = np.outer(C.forces[:, 0], C.forces[:, 0]) * C.dry[0] ** 2
        low = np.linalg.cholesky(np.diag(np.square(NOISE)) + spread)
        assert low @ x[:, 0] == pytest.approx(rows[:, 0])


def blocks(rng, theta, length):
    """Whitened blocks ρ = X θ + white noise."""
    x = rng.standard_normal((length, 3, P))
    rho = x @ theta + rng.standard_normal((length, 3))
    return x, rho


def test_learning_block_by_block_is_one_least_squares_with_the_prior():
    rng = np.random.default_rng(1)
    x, rho = blocks(rng, rng.normal(0.0, 0.1, P), 40)
    mean, cov = np.zeros(P), np.diag(prior_deviation(N) ** 2)
    for one, value in zip(x, rho, strict=True):
        update_parameters(mean, cov, np.zeros(P), P, 1.0, one, value)
    rows = x.reshape(-1, P)
    information = rows.T @ rows + np.diag(prior_deviation(N) ** -2)
    assert mean == pytest.approx(np.linalg.solve(information, rows.T @ rho.reshape(-1)), abs=1e-9)
    assert cov == pytest.approx(np.linalg.inv(information), abs=1e-12)


def test_whatever_was_learnt_the_precision_is_the_inverse_of_the_covariance_from_window_to_window():
    rng, theta, cov = np.random.default_rng(5), np.zeros(P), np.diag(prior_deviation(N) ** 2)
    model, identity = parameter_model(N, 0.01, 120.0), np.eye(P)
    for _ in range(50):
        update_parameters(
            theta, cov, model.walk, lasting(N), 1.0, rng.normal(size=(3, P)), rng.normal(size=3)
        )
    found = short_term_precision(cov, model.short_term, lasting(N))
    assert found @ (cov + np.diag(model.short_term)) == pytest.approx(identity, abs=1e-9)


@pytest.mark.parametrize("length", WINDOWS)
def test_the_score_of_a_window_is_that_of_the_whole_covariance_of_the_second_around_it(length):
    rng = np.random.default_rng(length)
    theta = rng.normal(0.0, 0.05, P)
    x, rho = blocks(rng, theta + np.eye(P)[1] * 0.6, length)
    cov = np.diag(prior_deviation(N) ** 2)
    found = scored(x, rho, theta, cov)
    best = {}
    for window in (w for w in WINDOWS if w <= length):
        rows, away, inside = x.reshape(-1, P), (rho - x @ theta).reshape(-1), 3 * (length - window)
        v = np.eye(len(away)) + rows @ cov @ rows.T
        for h in range(2 * N + 2):
            jump = rows[:, h].copy()
            jump[:inside] = 0.0
            weighed = np.linalg.solve(v, jump)
            information, score = jump @ weighed, away @ weighed
            size = score / information
            likelihood = 0.5 * score * size
            # what is left once θ is estimated from jump and blocks: e − X P Xᵀ V⁻¹ e
            left = (away - size * jump) - rows @ cov @ rows.T @ np.linalg.solve(v, away - size * jump)
            likelihood /= max(1.0, left[inside:] @ left[inside:] / (3 * window))
            if likelihood > best.get(h, (0.0,))[0]:
                best[h] = (likelihood, size, information**-0.5)
    for h, (likelihood, size, deviation) in best.items():
        assert found.likelihood[h] == pytest.approx(likelihood, rel=1e-6)
        assert found.size[h] == pytest.approx(size, rel=1e-6)
        assert found.deviation[h] == pytest.approx(deviation, rel=1e-6)


@pytest.mark.slow
def test_sums_over_windows_are_those_of_their_last_blocks_however_many_came_and_however_large_they_were():
    rng, history, pushed = np.random.default_rng(12), initial_history(P), []
    for number in range(1500):
        if number == 900:  # as after a decision
            history.cursor[FILLED] = 0
            pushed.clear()
        x, rho = rng.normal(size=(3, P)), rng.normal(size=3)
        x[:, rng.random(P) < 0.4] = 0.0
        if number % 400 == 70:  # an impact, whose trace must vanish with it
            x, rho = 1e6 * x, 1e6 * rho
        pushed.append((x, rho))
        push_block(history, np.concatenate((x.ravel(), rho, np.zeros(3))))
        if number % 97 and number not in (899, 1499):
            continue
        for w, length in enumerate(WINDOWS):
            last = pushed[-length:]
            x, rho = np.concatenate([x for x, _ in last]), np.concatenate([rho for _, rho in last])
            trace = 1e-16 * max(np.abs(x).max() ** 2 for x, _ in pushed[-3 * LONGEST_WINDOW :])
            exact = {"rel": 1e-9, "abs": 1e-9 + 1e3 * trace}
            assert np.tril(history.gram[w]) == pytest.approx(np.tril(x.T @ x), **exact)
            assert history.pull[w] == pytest.approx(x.T @ rho, **exact)
            assert history.squares[w] == pytest.approx(rho @ rho, **exact)


def test_without_a_jump_twice_the_score_is_as_rare_as_a_chi_square_variable():
    rng = np.random.default_rng(3)
    cov, theta = np.diag(prior_deviation(N) ** 2), np.zeros(P)
    over = []
    for _ in range(400):
        x, rho = blocks(rng, rng.normal(0.0, prior_deviation(N)), 5)
        found = scored(x, rho, theta, cov)
        over.append(2.0 * found.likelihood[0] > norm.ppf(0.975) ** 2)
    assert np.mean(over) <= 0.08  # 5 %, and three standard deviations


def test_a_loss_counts_only_once_a_drive_has_given_information_on_it():
    """A steady drive lets δ wander while its deviation grows; no motor is named for that."""
    theta, cov = np.zeros(columns(4)), np.diag(prior_deviation(4) ** 2)
    theta[1], theta[2] = 0.1, 0.1
    cov[2, 2] = (0.5 * LOSS) ** 2
    assert significant_losses(theta, cov, 4).tolist() == [0.0, 0.0, 0.1, 0.0]


@given(st.floats(-0.2, 0.2), st.floats(0.001, 0.9))
def test_a_loss_counts_only_beyond_four_of_its_own_deviations(loss, share):
    theta, cov = np.zeros(columns(4)), np.diag(prior_deviation(4) ** 2)
    deviation = share * LOSS
    theta[3], cov[3, 3] = loss, deviation**2
    assume(abs(loss - 4.0 * deviation) > 1e-9 and abs(share - 0.9) > 1e-9)
    assert significant_losses(theta, cov, 4)[3] == (loss if loss > 4.0 * deviation else 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("size", [1, 3, 25])
def test_the_inverse_by_cholesky_is_that_by_pivots(size):
    root = np.random.default_rng(size).normal(size=(size, size + 2))
    matrix = root @ root.T + 0.1 * np.eye(size)
    assert inverted(matrix) == pytest.approx(np.linalg.inv(matrix), rel=1e-9, abs=1e-9)
    assert np.array_equal(inverted(matrix), inverted(matrix).T)
