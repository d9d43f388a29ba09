"""Steady driving by the balance of forces, against the planar plant driven until nothing changes."""

from dataclasses import replace

import numpy as np
import pytest

from omnimj.effects import apply_effects, with_effects
from omnimj.parameters import read_floors, read_robot
from omnimj.physics.equilibrium import (
    SMOOTHING,
    steady_current,
    steady_force,
    steady_ratio,
    steady_rows,
    steady_twist,
    traction_rows,
)
from omnimj.physics.kinematics import rolling_matrix
from omnimj.physics.motor import driven_by_measured_current, motor_parameters
from omnimj.physics.planar import (
    PlanarModel,
    driven_wheel,
    output_size,
    planar_constants,
    planar_output,
    planar_state,
    state_size,
    step,
)
from omnimj.physics.planar_wheel import WheelLoad, wheel_torque_bounds
from omnimj.physics.wheel import packed

LAWS = {
    "by slip speed": {},
    "by creep ratio": {"turnover": 20.0, "mu_c": 1.5, "mu_s": 1.5},
    "soft": {"turnover": 20.0, "mu_c": 1.5, "mu_s": 1.5, "rolling_resistance": 0.12},
    "soft under rollers": {
        "turnover": 20.0,
        "mu_c": 3.0,
        "mu_s": 3.0,
        "rolling_resistance": 0.03,
        "roller_resistance": 0.15,
        "roller_dry": 0.05,
    },
}
ROLLERS = {"roller_friction": {"roller_dry": 0.03, "roller_viscous": 0.1}}
NO_CURVE = np.zeros(0)


def model_of(floor_numbers, effects=None, heavy_wheels=False):
    robot = with_effects(read_robot("robotino"), {**ROLLERS, **(effects or {})})
    changed = apply_effects(robot)
    machine = changed.machine
    if heavy_wheels:  # keep their speed
        machine = replace(machine, wheel=replace(machine.wheel, inertia=1e9))
    floor = read_floors()["natural_stone"]
    floor = replace(floor, numbers={**floor.numbers, **floor_numbers})
    made = planar_constants(machine, 0.0, 1.0, 1.0, changed.payload)
    motor = packed(driven_by_measured_current(motor_parameters(machine.motor)))
    return PlanarModel(
        made.body,
        made.wheels,
        np.array([motor] * 3),
        np.tile(floor.row, (3, 1)),
        changed.terms,
        False,
    )


def rims(direction, speed=0.2):
    robot = read_robot("robotino")
    twist = speed * np.array([np.cos(direction), np.sin(direction), 0.0])
    return rolling_matrix(robot.wheel_positions, robot.rolling_directions) @ twist / robot.wheel.radius


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("direction", [0.0, 0.4, 1.6, -2.3])
def test_the_planar_plant_ends_at_the_equilibrium_when_its_wheels_keep_their_speed(law, direction):
    effects = {"load_offset": {"x": -0.03, "y": 0.01}}
    speeds = rims(direction)
    found = np.zeros(3)
    assert steady_twist(model_of(LAWS[law], effects), speeds, NO_CURVE, found)
    model = model_of(LAWS[law], effects, heavy_wheels=True)
    state, output = np.zeros(state_size(3)), np.zeros(output_size(3))
    views = planar_state(state)
    views.wheel_speed[:] = speeds
    step(state, np.zeros(3), model, 0.001, 6000, output)
    assert np.allclose(views.wheel_speed, speeds, rtol=1e-4)
    assert np.allclose(views.twist, found, atol=1e-3), (views.twist, found)
    assert planar_output(output).normal.sum() == pytest.approx(11.3 * 9.81)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_the_steady_current_gives_the_torque_that_the_floor_takes(law):
    model, speeds, forces = model_of(LAWS[law]), rims(0.5), np.zeros(4)
    twist = np.zeros(3)
    steady_twist(model, speeds, NO_CURVE, twist)
    for i, speed in enumerate(speeds):
        driven = driven_wheel(model, i)
        current = steady_current(driven, speed, twist, forces)
        ahead, aside = forces[:2]
        load = WheelLoad(driven.wheel.normal, ahead, aside)
        low, high = wheel_torque_bounds(driven, current, speed, load)
        resisted = LAWS[law].get("rolling_resistance", 0.0) * driven.wheel.normal * driven.wheel.wheel.radius
        share = abs(forces[2]) / np.hypot(forces[2], forces[3])
        needed = driven.wheel.wheel.radius * ahead + np.sign(speed) * resisted * share
        assert (low if speed > 0.0 else high) == pytest.approx(needed, abs=2e-4)


@pytest.mark.parametrize("law", LAWS)
def test_slip_and_current_give_back_the_force_that_the_floor_takes(law):
    model, speeds = model_of(LAWS[law]), np.array([rims(angle) for angle in (0.2, 0.9, 1.7, 2.5, 4.1)])
    rows, found, forces = np.zeros((len(speeds), 6)), np.zeros((*speeds.shape, 3)), np.zeros(4)
    steady_rows(model, speeds, NO_CURVE, rows)
    traction_rows(model, rows, speeds, found)
    for b, i in np.ndindex(speeds.shape):
        driven = driven_wheel(model, i)
        steady_force(driven, speeds[b, i], rows[b, :3], SMOOTHING, forces)
        assert found[b, i, 2] == pytest.approx(forces[0] / driven.wheel.normal, abs=1e-6)
        law_ratio = steady_ratio(driven.floor, found[b, i, 0], found[b, i, 1], SMOOTHING)
        assert found[b, i, 2] == pytest.approx(law_ratio, abs=1e-6)


def test_by_creep_ratio_a_robot_without_dry_friction_slips_alike_at_any_speed():
    numbers = {"turnover": 20.0, "mu_c": 3.0, "mu_s": 3.0, "sigma_2": 1e-9, "rolling_resistance": 0.1}
    model = model_of(numbers)
    model.wheels[:, 2:4] = 0.0  # no friction of the rollers themselves
    shares = []
    for speed in (0.1, 0.2, 0.4):
        twist = np.zeros(3)
        steady_twist(model, rims(0.3, speed), NO_CURVE, twist)
        shares.append(twist / speed)
    assert np.allclose(shares[0], shares[1], atol=20 * SMOOTHING**2 / 0.1**2 + 2e-3)
    assert np.allclose(shares[1], shares[2], atol=2e-3)


def test_without_drag_a_robot_rolls_and_a_load_offset_changes_nothing():
    model = model_of({})
    model.wheels[:, 2:4] = 0.0
    rows = np.zeros((1, 6))
    steady_rows(model, rims(0.7)[None], NO_CURVE, rows)
    assert np.allclose(rows[0, :3], [0.2 * np.cos(0.7), 0.2 * np.sin(0.7), 0.0], atol=1e-6)
