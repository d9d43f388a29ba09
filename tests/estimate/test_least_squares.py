"""The solver finds the minimum that other routes find, and never leaves the bounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares, lsq_linear

from omnimj.estimate.least_squares import bounded_step, minimise, normal_equations
from omnimj.signals import Array


@dataclass(frozen=True)
class Plain:
    """Sum of squares of a function, differentiated numerically."""

    function: Callable[[Array], Array]
    low: Array
    high: Array

    def bounds(self) -> tuple[Array, Array]:
        return self.low, self.high

    def scales(self) -> Array:
        return np.full(len(self.low), 0.5)

    def prior(self, x: Array) -> tuple[Array, Array]:
        return np.zeros(len(x)), np.zeros(len(x))

    def residuals(self, points: Sequence[Array]) -> list[Array]:
        return [self.function(x) for x in points]

    def loss(self, x: Array, residual: Array) -> float:
        return float(residual @ residual)

    def jacobian(self, x: Array, known: Array | None) -> Array:
        steps = 1e-6 * np.eye(len(x))
        columns = [(self.function(x + s) - self.function(x - s)) / 2e-6 for s in steps]
        return np.stack(columns, axis=1) * self.scales()

    def update(self, jacobian: Array, residual: Array, moved: Array, step: Array) -> Array:
        return jacobian

    def normal_equations(self, jacobian: Array, residual: Array) -> Array:
        return normal_equations(jacobian, residual, np.ones(len(residual)))


def rosenbrock(x: Array) -> Array:
    return np.array([1.0 - x[0], 10.0 * (x[1] - x[0] ** 2)])


def tables(seed: int, rows: int = 30, n: int = 4) -> tuple[Array, Array]:
    random = np.random.default_rng(seed)
    return random.normal(size=(rows, n)), random.normal(size=rows)


@pytest.mark.parametrize("bound", [10.0, 0.8])
def test_a_curved_valley_ends_where_scipy_ends(bound):
    low, high = np.full(2, -2.0), np.full(2, bound)
    found = minimise(Plain(rosenbrock, low, high), np.array([-1.2, 0.5]), rounds=60, tolerance=1e-12)
    other = least_squares(rosenbrock, np.array([-1.2, 0.5]), bounds=(low, high))
    assert found.x == pytest.approx(other.x, abs=1e-3)
    assert found.loss == pytest.approx(2.0 * other.cost, abs=1e-6)


@given(st.integers(0, 1000))
def test_a_linear_problem_is_solved_with_one_jacobian(seed):
    a, b = tables(seed)
    wide = np.full(4, 100.0)
    found = minimise(Plain(lambda x: a @ x - b, -wide, wide), np.zeros(4), rounds=1)
    assert found.x == pytest.approx(np.linalg.lstsq(a, b, rcond=None)[0], abs=1e-3)


@given(st.integers(0, 1000), st.floats(0.05, 2.0))
def test_a_step_is_the_best_inside_its_bounds(seed, reach):
    a, b = tables(seed)
    box = np.full(4, -reach), np.full(4, reach)
    none = np.zeros(4), np.zeros(4)
    step = bounded_step(normal_equations(a, b, np.ones(len(b))), box, none, 0.0)
    best = lsq_linear(a, -b, bounds=box).x
    assert np.abs(step).max() <= reach + 1e-9
    assert np.sum((a @ step + b) ** 2) == pytest.approx(np.sum((a @ best + b) ** 2), rel=1e-6)


@given(st.integers(0, 1000))
def test_the_loss_never_rises(seed):
    start = np.random.default_rng(seed).uniform(-2.0, 2.0, 2)
    wide = np.full(2, 3.0)
    problem = Plain(rosenbrock, -wide, wide)
    assert minimise(problem, start, rounds=2).loss <= problem.loss(start, rosenbrock(start))


@given(st.integers(0, 1000))
def test_normal_equations_are_products_of_weighted_columns(seed):
    a, b = tables(seed)
    weight = np.random.default_rng(seed + 1).uniform(0.0, 2.0, len(b))
    weight[::3] = 0.0
    table = np.column_stack([a, b]) * weight[:, None]
    assert normal_equations(a, b, weight) == pytest.approx(table.T @ table, abs=1e-12)
