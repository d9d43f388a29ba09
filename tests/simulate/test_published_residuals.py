"""Residuals of the published method against other routes: numpy over the trace, scipy over the equations."""

from __future__ import annotations

import math

import numpy as np
import pytest
import rig_reference
from nightly import latin
from published_reference import rig_force_rms, robot_force_rms, running_rms
from scipy.integrate import solve_ivp
from smooth_planar import derivative

from omnimj.control.detection.detector import DetectorOptions
from omnimj.diagnosis.published_thresholds import (
    MANOEUVRE,
    TrainingRun,
    rig_test,
    robot_test,
    run_with_residuals,
)
from omnimj.parameters import Rig, Robot
from omnimj.parameters.robot import read_robot
from omnimj.physics import planar
from omnimj.physics.effect_terms import zero_terms
from omnimj.physics.motor import driven_by_measured_current, motor_parameters
from omnimj.physics.planar import planar_constants
from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.scenario import read_scenario

MOTOR = "{kind = 'motor', wheel = 1, onset = 0.8, loss = 0.57}"
RIG_MOTOR = "{kind = 'motor', wheel = 1, onset = 0.0, braking_torque = 0.001}"


def robot_run(faults="", direction=0.6, plant="planar", variant="repaired"):
    test = robot_test(f"{MANOEUVRE}, speed = 'high', direction = {direction}", faults, "duration=3.0")
    return test, run_with_residuals(TrainingRun(test, 7, False), DetectorOptions(variant), plant)


def rig_run(faults="", current=0.9, plant="planar", variant="repaired"):
    test = rig_test(current, faults)
    return test, run_with_residuals(TrainingRun(test, 7, False), DetectorOptions(variant), plant)


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["planar", "twin"])
@pytest.mark.parametrize("faults", ["", MOTOR])
def test_r7_and_r8_are_what_the_columns_of_the_trace_give(faults, plant):
    test, trace = robot_run(faults, plant=plant)
    assert isinstance(test.constants, Robot)
    found = np.column_stack([trace["residual_force_x"], trace["residual_force_y"]])
    expected = robot_force_rms(test.constants, trace)
    # until the rollers' bearings have let go the reference has another micro-slip
    assert found == pytest.approx(expected, abs=0.08, rel=0.02)
    assert found[1000:] == pytest.approx(expected[1000:], abs=0.02, rel=0.02)
    assert (found[-1] > 1.5).any() == bool(faults)


@pytest.mark.parametrize(("faults", "plant"), latin(["", RIG_MOTOR], ["planar", "twin"]))
def test_r2_is_what_the_columns_of_the_trace_give(faults, plant):
    test, trace = rig_run(faults, plant=plant)
    assert isinstance(test.constants, Rig)
    expected = rig_force_rms(test.constants, test.constants.rig.masses[0], trace)
    assert trace["residual_force"] == pytest.approx(expected, abs=0.01)
    assert (expected[-1] > 1.0) == bool(faults)


@pytest.mark.slow
def test_the_robot_s_observer_integrates_the_equations_under_the_measured_currents():
    test, trace = robot_run(MOTOR)
    robot, current = test.constants, trace.wheels("current")
    assert isinstance(robot, Robot)
    constants, floor = planar_constants(robot), test.floors[test.floor].row
    motors = np.tile(np.array(driven_by_measured_current(motor_parameters(robot.motor))), (4, 1))
    floors = np.tile(floor, (4, 1))
    model = planar.PlanarModel(constants.body, constants.wheels, motors, floors, zero_terms(4), False)
    period, rows = 1e-3, 1500

    def rates(time, state):
        now = min(max(math.ceil(time / period - 1e-9), 1), rows)
        return derivative(state, current[now], model, 1e-3)

    solved = solve_ivp(
        rates, (0.0, rows * period), np.zeros(11), "LSODA", np.arange(0, rows + 1, 100) * period,
        rtol=1e-6, atol=1e-7, max_step=period,
    )  # fmt: skip
    measured, residual = trace.wheels("wheel_speed"), trace.wheels("residual_wheel_speed")
    observed = (measured - residual)[: rows + 1 : 100]
    assert observed == pytest.approx(solved.y[4:8].T, abs=0.02)
    assert np.abs(residual[rows]).max() > 2.0  # and the fault shows


def test_the_rig_s_observer_integrates_the_equations_under_the_measured_current():
    test, trace = rig_run("", 0.75)
    rig = test.constants
    assert isinstance(rig, Rig)
    floor, mass = test.floors[test.floor], rig.rig.masses[0]
    _, _, wheel_speed = rig_reference.integrate(rig, floor, mass, 0.75, 0.5)
    r1 = trace["wheel_speed"][:501] - wheel_speed
    # the reference is driven by the set value, the observer by what a noisy monitor made of it, and at once
    assert trace["residual_wheel_speed"][50:501] == pytest.approx(running_rms(r1, 1e-3)[50:], abs=0.03)


def test_as_printed_the_robot_s_observer_accelerates_itself_at_rest():
    """Erratum 4: T_nl without a sign turns every wheel backward while nothing moves."""
    robot = read_robot()
    still = robot_test("kind = 'hold'", "", "duration=1.0")
    trace = run_with_residuals(TrainingRun(still, 7, False), DetectorOptions("printed"), "planar")
    residuals = trace.wheels("residual_wheel_speed")
    assert np.abs(trace.wheels("wheel_speed")).max() < 0.2
    assert np.all(residuals[300] > 3.9)
    m = robot.motor
    bias = 2.0 * m.no_load_torque * m.gear_efficiency * m.gear_ratio / robot.wheel.radius
    rollers = 0.5 * robot.body.mass * 9.81 * robot.wheel.roller_dry  # with the sign of noise
    assert bias < trace["residual_force_x"][-1] < 1.05 * math.hypot(bias, rollers)


@pytest.mark.slow
def test_as_printed_the_force_residual_is_biased_in_one_direction():
    """Erratum 4: right along +y, 4 to 10 N along −y, with a threshold of 3.5 N."""
    rms = {}
    for name, direction in (("plus", math.pi / 2), ("minus", -math.pi / 2)):
        _, trace = robot_run("", direction, variant="printed")
        moving = np.abs(trace["wheel_speed_1"]) > 1.0
        squares = trace["residual_force_y"] ** 2 * trace["time"]
        step = np.diff(squares, prepend=0.0)[moving]
        rms[name] = math.sqrt(step.sum() / (1e-3 * moving.sum()))
    assert rms["plus"] < 2.0
    assert 4.0 < rms["minus"] < 10.0


@pytest.mark.slow
def test_the_method_uses_the_declared_floor_whatever_lies_on_it():
    patched = read_scenario("nylon_patch", ("diagnosis={recovery=false}",))
    bare = read_scenario("nylon_patch", ("diagnosis={recovery=false}", "patches=[]"))
    found = [run_scenario(s, "planar", "published").trace["residual_wheel_speed_1"] for s in (patched, bare)]
    assert np.abs(found[0]).max() > 3.0
    assert np.abs(found[1]).max() < 0.5


@pytest.mark.slow
def test_what_a_mission_does_not_measure_does_not_reach_the_method():
    """Truth columns aside, a fault that has not begun changes no residual."""
    _, healthy = robot_run("")
    _, later = robot_run("{kind = 'motor', wheel = 1, onset = 2.9, loss = 0.57}")
    for name in ("residual_wheel_speed_1", "residual_force_y"):
        assert np.array_equal(healthy[name][:2900], later[name][:2900])
