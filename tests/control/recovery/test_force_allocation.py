"""Shares of a load in force space: the demand within bounds, as evenly as possible."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from omnimj.control.recovery.force_allocation import REGULARISATION, allocate_forces
from omnimj.control.robot_constants import robot_constants
from omnimj.parameters import read_robot

FORCES = robot_constants(read_robot()).forces
ARM = 0.25
ALL = np.ones(4, bool)
forces = st.floats(-15.0, 15.0)


def shares(wrench, most=None, used=ALL):
    return allocate_forces(
        FORCES, ARM, np.array(wrench), np.full(4, 100.0) if most is None else np.array(most), used
    )


@given(forces, forces, st.floats(-3.0, 3.0))
def test_four_wheels_give_the_demanded_wrench_with_the_least_effort(f_x, f_y, moment):
    wrench = np.array((f_x, f_y, moment))
    assert shares(wrench) == pytest.approx(np.linalg.pinv(FORCES) @ wrench, abs=0.02)


@given(forces, forces, st.floats(-3.0, 3.0), st.integers(0, 3))
def test_three_wheels_give_the_same_and_the_fourth_nothing(f_x, f_y, moment, lost):
    used = ALL.copy()
    used[lost] = False
    found = shares((f_x, f_y, moment), used=used)
    assert found[lost] == 0.0
    assert FORCES @ found == pytest.approx(np.array((f_x, f_y, moment)), abs=0.05)


@given(forces, forces, st.floats(-3.0, 3.0), st.lists(st.floats(0.5, 6.0), min_size=4, max_size=4))
def test_no_wheel_gets_more_than_its_limit_and_hardly_any_force_is_given_away(f_x, f_y, moment, most):
    """The second route is a bounded least-squares solver; bounds met one after the other come close to it."""
    wrench = np.array((f_x, f_y, moment))
    found = shares(wrench, most)
    assert np.all(np.abs(found) <= np.array(most) + 1e-9)
    weight = np.diag((1.0, 1.0, 1.0 / ARM))
    whole = np.vstack((weight @ FORCES, np.sqrt(REGULARISATION) * np.eye(4)))
    best = lsq_linear(whole, np.concatenate((weight @ wrench, np.zeros(4))), (-np.array(most), most))
    missing = np.linalg.norm(weight @ (FORCES @ found - wrench))
    assert missing <= np.linalg.norm(weight @ (FORCES @ best.x - wrench)) * 1.2 + 0.3
