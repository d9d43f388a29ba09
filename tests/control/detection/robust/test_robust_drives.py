"""The robust method in the loop with the planar robot: quiet without a fault, right with one."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import in_turn, representative
from other_robots import write_slow

from omnimj.control.cascade.controller import Controller
from omnimj.control.compiled import CompiledController
from omnimj.control.detection.robust import RobustDetector
from omnimj.control.fault_tolerant import FaultTolerantController
from omnimj.parameters import read_robot
from omnimj.plant.faults import Fault
from omnimj.plant.planar import PlanarRobot
from omnimj.signals import Measurement, Target, Trace
from omnimj.simulate.driving import drive
from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.simulate.suites.missions import mission

ROBOT = read_robot()
SECONDS = 12.0
ONSET = 3.0


def driven(seed, floor="natural_stone", faults=(), robot=ROBOT, seconds=SECONDS) -> Trace:
    """A random mission with the robust method; it assumes the nominal robot whatever `robot` is."""
    plan = mission(np.random.default_rng(seed), seconds, 1e-3)
    controller = CompiledController(Controller(ROBOT), RobustDetector(ROBOT))
    plant = PlanarRobot(robot, floor, faults=faults, seed=seed)
    try:
        return drive(plant, controller, plan)
    finally:
        plant.close()


def named(trace):
    return [(d["kind"], d["wheels"]) for d in trace.about["diagnoses"]]


@pytest.mark.parametrize(
    ("floor", "payload"),
    in_turn(["natural_stone", "pvc", "paperboard", "natural_stone_capped"], [0.8, 1.2]),
)
def test_a_healthy_robot_with_another_load_on_any_floor_raises_no_alarm(floor, payload):
    body = dataclasses.replace(ROBOT.body, mass=ROBOT.body.mass * payload)
    trace = driven(int(1000 * payload), floor, robot=dataclasses.replace(ROBOT, body=body))
    assert named(trace) == []


@pytest.mark.parametrize(("wheel", "loss"), in_turn([1, 2, 3, 4], [0.57, 1.0]))
def test_a_weak_motor_is_named_and_its_loss_is_estimated(wheel, loss):
    trace = driven(40 + wheel, faults=[Fault("motor", ONSET, None, wheel, {"loss": loss})])
    # whether a wheel that stands is held is unknown at first: the same name comes twice then
    assert set(named(trace)) == {("motor", (wheel,))}
    assert not trace.about["diagnoses"][-1]["ambiguous_with"]
    assert trace[f"effectiveness_{wheel}"][-1] == pytest.approx(1.0 - loss, abs=0.06)
    others = [trace[f"effectiveness_{i}"][-1] for i in range(1, 5) if i != wheel]
    assert others == pytest.approx(np.ones(3), abs=0.08)


@pytest.mark.parametrize("wheel", [1, 3])
def test_with_half_the_sample_rate_a_weak_motor_is_named_as_soon(wheel, tmp_path):
    model = write_slow(tmp_path / "robot.toml", 500.0)
    scenario = read_scenario("degraded_motor", (f"faults.0.wheel={wheel}",), model)
    assert scenario.period == 2e-3
    metrics = run_scenario(scenario, "planar", "robust").metrics
    assert metrics["isolated"] and metrics["false_alarms"] == 0 and metrics["detection_delay"] < 0.12


@pytest.mark.parametrize("loss", [0.3, 0.57, 0.8])
def test_what_is_left_of_a_motor_is_estimated_as_soon_as_it_is_named(loss):
    trace = run_scenario(
        read_scenario("degraded_motor", (f"faults.0.loss={loss}",)), "planar", "robust"
    ).trace
    left = trace["effectiveness_1"]
    first = int(np.argmax(left < 1.0))
    assert trace["time"][first] - 0.8 < 0.12
    assert left[first : first + 50] == pytest.approx(1.0 - loss, abs=0.08)
    assert left[-1] == pytest.approx(1.0 - loss, abs=0.03)


@pytest.mark.parametrize(("losses", "wheel"), in_turn([(0.4, 0.75), (0.75, 0.4), (0.6, 0.0)], [2, 3, 4, 1]))
def test_a_weak_motor_that_gets_worse_or_better_is_measured_again_and_named_once(losses, wheel):
    first, then = losses
    faults = [
        Fault("motor", ONSET, 9.0, wheel, {"loss": first}),
        *([Fault("motor", 9.0, None, wheel, {"loss": then})] if then else []),
    ]
    trace = driven(40 + wheel, faults=faults, seconds=18.0)
    assert named(trace) == [("motor", (wheel,))]
    left = trace[f"effectiveness_{wheel}"]
    assert left[8999] == pytest.approx(1.0 - first, abs=0.08)
    assert left[-1] == pytest.approx(1.0 - then, abs=0.08)


@pytest.mark.parametrize(("wheel", "seed"), [(2, 23), pytest.param(4, 27, marks=pytest.mark.slow)])
def test_a_loss_too_small_for_the_jump_test_is_learnt_and_named(wheel, seed):
    trace = driven(seed, faults=[Fault("motor", ONSET, None, wheel, {"loss": 0.12})], seconds=40.0)
    assert named(trace) == [("motor", (wheel,))]
    assert trace[f"effectiveness_{wheel}"][-1] == pytest.approx(0.88, abs=0.04)


def test_a_weak_motor_whose_wheel_slips_as_well_is_both():
    weak, oily = Fault("motor", ONSET, None, 2, {"loss": 0.4}), Fault("slip", 8.0, None, 2, {"grip": 0.1})
    trace = driven(31, faults=[weak, oily], seconds=20.0)
    assert set(named(trace)) == {("motor", (2,)), ("slip", (2,))}
    assert [d["cleared"] for d in trace.about["diagnoses"] if d["kind"] == "motor"][-1] is None


@pytest.mark.parametrize("seed", representative(61, 62, 63))
def test_a_slip_is_named_once_while_it_lasts_and_taken_back_as_soon_as_the_wheel_is_loaded_again(seed):
    wheel, end = 1 + seed % 4, 9.0
    trace = driven(seed, faults=[Fault("slip", ONSET, end, wheel, {"grip": 0.2})], seconds=20.0)
    (found,) = trace.about["diagnoses"]
    loaded = (trace["time"] > end + 0.05) & (np.abs(trace[f"traction_force_{wheel}"]) > 3.0)
    assert found["kind"] == "slip" and end < found["cleared"] < trace["time"][loaded][0] + 0.15


@pytest.mark.parametrize("seed", representative(61, 62, 63, 64, 65, 66))
def test_a_wheel_without_grip_stays_one_diagnosis_through_stops_and_reversals(seed):
    oily = [Fault("slip", ONSET, None, 1 + seed % 4, {"grip": 0.05})]
    (found,) = driven(seed, faults=oily, seconds=25.0).about["diagnoses"]
    assert found["kind"] == "slip" and found["wheels"] == (1 + seed % 4,) and found["cleared"] is None


@pytest.mark.parametrize("wheel", [1, 2, 3, 4])
def test_a_slipping_wheel_is_named(wheel):
    trace = driven(60 + wheel, faults=[Fault("slip", ONSET, None, wheel, {"grip": 0.2})])
    assert named(trace)[0] == ("slip", (wheel,))
    assert trace.about["diagnoses"][0]["time"] > ONSET


@pytest.mark.parametrize("kind", ["free", "hard_over", "locked"])
@pytest.mark.parametrize("wheel", [1, 3])
def test_a_motor_that_does_not_obey_is_named_at_once(kind, wheel):
    trace = driven(80 + wheel, faults=[Fault(kind, ONSET, None, wheel)], seconds=6.0)
    first = trace.about["diagnoses"][0]
    assert (first["kind"], first["wheels"]) == (kind, (wheel,))
    assert ONSET < first["time"] < ONSET + 1.0


@pytest.mark.parametrize(
    ("channel", "mode", "size"),
    [
        ("yaw_rate", "bias", 0.1),
        ("yaw_rate", "freeze", None),
        ("acceleration_x", "freeze", None),
        ("wheel_speed_2", "freeze", None),
        ("acceleration_y", "bias", 1.0),
    ],
)
def test_a_faulty_sensor_is_named(channel, mode, size):
    numbers = {"channel": channel, "mode": mode} | ({} if size is None else {"size": size})
    trace = driven(7, faults=[Fault("sensor", ONSET, None, None, numbers)], seconds=8.0)
    first = trace.about["diagnoses"][0]
    assert (first["kind"], first["channel"]) == ("sensor", channel) and first["time"] > ONSET


def test_a_diagnosis_stays_when_the_robot_stands():
    """Standing is no sign of health."""
    trace = driven(41, faults=[Fault("motor", ONSET, None, 1, {"loss": 0.8})], seconds=14.0)
    (found,) = trace.about["diagnoses"]
    assert found["cleared"] is None
    assert trace["mode"][-1] == 2.0


def test_a_robot_that_stands_cannot_be_judged():
    method = RobustDetector(ROBOT)
    zero = Measurement(0.0, np.zeros(4), np.zeros(4), np.zeros(2), 0.0, 0.0)
    state = method.start(zero)
    for k in range(1, 200):
        state = method.step(state, dataclasses.replace(zero, time=k * 1e-3))
    assert state.log[-1] == 3.0 and state.diagnoses == ()


def test_the_same_measurements_give_the_same_diagnoses_and_the_state_before_is_left_as_it_was():
    method = RobustDetector(ROBOT)
    rng = np.random.default_rng(0)
    first = Measurement(0.0, np.zeros(4), np.full(4, 5.0), np.zeros(2), 0.0, 0.0)
    state = method.start(first)
    for k in range(1, 60):
        m = Measurement(
            k * 1e-3, rng.normal(0.3, 0.1, 4), rng.normal(5, 0.1, 4), rng.normal(0, 0.1, 2), 0.1, 0.0
        )
        once, again = method.step(state, m), method.step(state, m)
        assert np.array_equal(once.log, again.log) and once.diagnoses == again.diagnoses
        state = once


_ANY = st.floats(allow_nan=True, allow_infinity=True, width=64)


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 11), _ANY), min_size=1, max_size=8), st.integers(0, 30))
def test_whatever_sensors_read_the_command_is_finite_and_within_limits(corruptions, at):
    controller = FaultTolerantController(Controller(ROBOT), RobustDetector(ROBOT))
    good = Measurement(0.0, np.full(4, 0.3), np.full(4, 6.0), np.array([0.1, 0.2]), 0.1, 1.0)
    state = controller.start(good)
    target = Target(np.array([0.3, 0.0]), 0.1, 0.0)
    for k in range(1, 60):
        values = np.concatenate(
            (good.current, good.wheel_speed, good.acceleration, [good.yaw_rate, good.yaw])
        )
        if at <= k < at + 15:
            for place, value in corruptions:
                values[place] = value
        m = Measurement(k * 1e-3, values[:4], values[4:8], values[8:10], float(values[10]), float(values[11]))
        command, state = controller.step(state, m, target)
        assert np.isfinite(command.current).all()
        assert np.abs(command.current).max() <= ROBOT.control.current_limit
    for diagnosis in state.diagnoses:
        assert math.isfinite(diagnosis.time) and 0.0 <= diagnosis.confidence <= 1.0
