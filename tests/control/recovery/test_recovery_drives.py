"""Recovery in the loop with the planar robot: lost wheels are made up for, and a robot at rest stays so."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import representative

from omnimj.control.cascade.controller import Controller
from omnimj.control.compiled import CompiledController
from omnimj.control.detection.detector import FaultEstimate
from omnimj.control.detection.robust import RobustDetector
from omnimj.control.fault_tolerant import FaultTolerantController
from omnimj.control.recovery import Recovery
from omnimj.control.recovery.modes import CAPPING, PIVOTING, REVERTED, STOPPING
from omnimj.parameters import read_robot
from omnimj.plant.faults import Fault
from omnimj.plant.planar import PlanarRobot
from omnimj.signals import Target, Trace
from omnimj.simulate.driving import drive
from omnimj.simulate.metrics import distance_to_path
from omnimj.simulate.scenario.drive import read_drive
from omnimj.simulate.suites.missions import mission

ROBOT = read_robot()
CIRCLE = {"kind": "circle", "diameter": 3.0, "speed": 0.5, "acceleration": 0.8, "start_time": 0.5}
ONSET = 3.0
NONE = np.zeros(4, bool)
WELL = FaultEstimate(np.zeros(4), NONE, NONE, NONE, NONE, np.zeros(2), np.zeros(4), -np.inf)


@dataclass(frozen=True)
class Assumed:
    """The state of a method that assumes given faults."""

    inner: Any
    fault_estimate: FaultEstimate
    diagnoses: tuple[()] = ()
    reconfiguration: None = None

    @property
    def log(self):
        return np.empty(0)


class AssumedFaults:
    """The robust method's velocity and forces with a given fault estimate from a time on."""

    log_names = ()

    def __init__(self, since: float, **fault_estimate: Any):
        self._inner, self._since = RobustDetector(ROBOT), since
        self._assumed = {"decided": since, **fault_estimate}

    def start(self, measurement: Any) -> Assumed:
        return Assumed(self._inner.start(measurement), WELL)

    def step(self, state: Assumed, measurement: Any, command: Any = None, bias: float = 0.0) -> Assumed:
        inner = self._inner.step(state.inner, measurement, command, bias)
        known = inner.fault_estimate if inner.fault_estimate is not None else WELL
        known = WELL._replace(velocity=known.velocity, force=known.force)
        assumes = measurement.time >= self._since
        return Assumed(inner, known._replace(**self._assumed) if assumes else known)


def circled(faults=(), method=None, recovery=True, seconds=13.0) -> Trace:
    """Half a circle and more with the faults, by the robust method unless another one is given."""
    plan = read_drive(CIRCLE, "circle", seconds, 1e-3)
    cascade = Controller(ROBOT, heading_hold=True)
    helps = Recovery(ROBOT, holds_heading=True) if recovery else None
    if method is None:
        controller = CompiledController(cascade, RobustDetector(ROBOT), helps)
    else:
        controller = FaultTolerantController(cascade, method, helps)
    plant = PlanarRobot(ROBOT, "natural_stone", faults=faults, seed=1, start=plan.start)
    try:
        return drive(plant, controller, plan.reference)
    finally:
        plant.close()


def strays(trace: Trace) -> float:
    centre = np.column_stack((trace["x"], trace["y"]))
    return float(distance_to_path(centre, np.column_stack((trace["target_x"], trace["target_y"]))).max())


@cache
def healthy() -> float:
    """Distance from the path without a fault [m]."""
    return strays(circled())


def lost(kind, wheel, onset=ONSET, **numbers):
    return Fault(kind, onset, None, wheel, numbers)


@pytest.mark.parametrize("wheel", representative(1, 4, 2, 3, keep=2))
def test_a_robot_with_a_free_wheel_stays_on_its_path(wheel):
    assert strays(circled([lost("free", wheel)])) <= 3.0 * healthy()


@pytest.mark.slow
@pytest.mark.parametrize("wheel", [2, 3, 1, 4])
def test_a_robot_with_a_held_wheel_turns_about_it_and_its_centre_stays_on_the_path(wheel):
    trace = circled([lost("locked", wheel)])
    assert trace["recovery"][-1] == PIVOTING
    assert strays(trace) <= 2.5 * healthy()
    assert strays(circled([lost("locked", wheel)], recovery=False, seconds=9.0)) > 10.0 * healthy()


@pytest.mark.parametrize(("first", "second"), representative((1, 2), (2, 4), (1, 3), (3, 4), keep=2))
def test_a_robot_without_two_motors_stays_within_ten_centimetres(first, second):
    trace = circled([lost("free", first), lost("free", second, ONSET + 2.0)])
    assert trace["recovery"][-1] == PIVOTING
    assert strays(trace) <= 0.10


def test_a_motor_that_runs_away_is_held():
    fault = [lost("hard_over", 2, current=1.0)]
    assert strays(circled(fault)) <= 0.10
    assert strays(circled(fault, recovery=False)) > 0.3


def test_a_robot_that_can_not_be_steered_is_brought_to_rest_and_stays_there():
    trace = circled([lost("free", wheel, 2.0 + wheel) for wheel in (1, 2, 3)])
    assert trace["recovery"][-1] == STOPPING
    late = trace["time"] > 7.0
    assert np.hypot(trace["twist_x"], trace["twist_y"])[late].max() < 0.01
    assert trace["pace"][-1] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("losses", [[0.0, 0.8, 0.0, 0.0], [0.7, 0.7, 0.7, 0.7]])
def test_a_loss_that_is_none_does_no_harm(losses):
    wrong = circled(method=AssumedFaults(ONSET, losses=np.array(losses)))
    assert strays(wrong) <= 2.0 * healthy()


@pytest.mark.slow
def test_a_dead_wheel_that_seems_to_pull_does_no_harm_to_the_path_since_the_place_is_held():
    lies = {"dead": np.array((False, True, False, False)), "force": np.array((0.0, 60.0, 0.0, 0.0))}
    assert strays(circled(method=AssumedFaults(ONSET, **lies))) <= 3.0 * healthy()


@pytest.mark.slow
def test_a_recovery_that_does_harm_is_withdrawn():
    """The velocity is a lie: the place would be driven back from where the robot is not, for ever."""
    lies = {"losses": np.array((0.5, 0.0, 0.0, 0.0)), "velocity": np.array((0.9, 0.0))}
    trace = circled(method=AssumedFaults(ONSET, **lies))
    taken = trace["time"][trace["recovery"] == REVERTED]
    assert ONSET + 0.3 <= taken[0] <= ONSET + 0.6
    late = trace["time"] > taken[0] + 0.5
    commanded = np.hypot(trace["target_twist_x"], trace["target_twist_y"])[late]
    assert commanded.max() <= CIRCLE["speed"] + 1e-9, "nothing is driven back any more"
    assert trace["recovery"][-1] == REVERTED


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.booleans(), min_size=20, max_size=20),
    st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6),
    st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4),
)
def test_a_robot_that_is_to_stand_stands_whatever_was_diagnosed(flags, numbers, losses):
    masks = [np.array(flags[4 * k : 4 * k + 4]) for k in range(4)]
    names = ("dead", "runaway", "held", "slipping")
    wrong = dict(zip(names, masks, strict=True)) | {
        "losses": np.array(losses),
        "velocity": np.array(numbers[:2]),
        "force": 10.0 * np.array(numbers[2:]),
        "trusts_gyro": flags[-1],
    }
    controller = FaultTolerantController(Controller(ROBOT), AssumedFaults(0.05, **wrong), Recovery(ROBOT))
    plant = PlanarRobot(ROBOT, "natural_stone", seed=3)
    measurement = plant.reset()
    state, still = controller.start(measurement), Target(np.zeros(2), 0.0, 0.0)
    for _ in range(400):
        command, state = controller.step(state, measurement, still)
        assert np.all(np.abs(command.current) <= ROBOT.control.current_limit)
        measurement = plant.step(command)
    x, y, heading, v_x, v_y = plant.truth()[:5]
    assert np.hypot(x, y) < 0.005
    assert abs(heading) < 0.01
    assert np.hypot(v_x, v_y) < 0.01


BROKEN = st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e300, 0.0])
PARTS = ("current", "wheel_speed", "acceleration", "yaw_rate", "yaw", "time", "short")


def corrupted(measurement, part, value, place):
    if part == "short":
        return replace(measurement, wheel_speed=measurement.wheel_speed[: place % 4])
    was = getattr(measurement, part)
    if isinstance(was, float):
        return replace(measurement, **{part: value})
    now = was.copy()
    if len(now):  # an earlier corruption may have left nothing of it
        now[place % len(now)] = value
    return replace(measurement, **{part: now})


@pytest.mark.slow
@pytest.mark.parametrize("wrong", ["dead", "runaway", "held", "slipping"])
@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.tuples(st.integers(60, 129), st.sampled_from(PARTS), BROKEN, st.integers(0, 7)), max_size=12)
)
def test_no_measurement_stops_a_recovery_and_its_currents_stay_within_limits(wrong, faults):
    assumed = {wrong: np.array((True, False, wrong == "slipping", False)), "velocity": np.array((0.3, 0.1))}
    controller = FaultTolerantController(Controller(ROBOT), AssumedFaults(0.05, **assumed), Recovery(ROBOT))
    plant = PlanarRobot(ROBOT, "natural_stone", seed=3)
    measurement, target = plant.reset(), Target(np.array((0.3, 0.1)), 0.2, 0.0)
    state = controller.start(measurement)
    for k in range(170):
        seen = measurement
        for when, part, value, place in faults:
            if when == k:
                seen = corrupted(seen, part, value, place)
        command, state = controller.step(state, seen, target)
        assert np.all(np.abs(command.current) <= ROBOT.control.current_limit)
        assert 0.0 <= state.time_scaling <= 1.0
        assert state.recovery is not None
        assert np.all(np.isfinite(state.recovery.log))
        measurement = plant.step(command)


@pytest.mark.slow
def test_the_heading_is_held_as_it_was_when_a_motor_broke():
    """Over five missions, since one may have its largest excursion before anything is known."""

    def excursion(seed, recovery):
        plan = mission(np.random.default_rng(seed), 20.0, 1e-3)
        fault = [Fault("motor", 5.0, None, 1 + seed % 4, {"loss": 0.7})]
        controller = CompiledController(Controller(ROBOT), RobustDetector(ROBOT), recovery)
        trace = drive(PlanarRobot(ROBOT, "natural_stone", faults=fault, seed=seed), controller, plan)
        away = np.unwrap(trace["heading"] - trace["target_heading"])[5000:]
        return np.abs(away - away[0]).max()

    ratios = [excursion(seed, Recovery(ROBOT)) / excursion(seed, None) for seed in range(5)]
    assert np.median(ratios) <= 0.5
    assert max(ratios) <= 1.05


def test_a_self_test_finds_a_dead_motor_before_the_robot_is_driven_and_the_plan_waits():
    plan = mission(np.random.default_rng(2), 6.0, 1e-3)
    controller = CompiledController(Controller(ROBOT), RobustDetector(ROBOT), Recovery(ROBOT, self_test=True))
    plant = PlanarRobot(ROBOT, "pvc", faults=[Fault("free", 0.0, None, 3)], seed=4)
    trace = drive(plant, controller, plan)
    first = trace.about["diagnoses"][0]
    assert (first["kind"], first["wheels"]) == ("free", (3,))
    assert first["time"] < 1.0
    waits = trace["time"] < 1.4
    assert np.hypot(trace["x"], trace["y"])[waits].max() < 0.005
    assert trace["pace"][waits].max() == 0.0
    assert trace["pace"][-1] == 1.0


@pytest.mark.parametrize("wheel", [1, 3])
def test_grip_that_returns_to_an_unloaded_wheel_is_noticed_since_the_wheel_is_probed(wheel):
    plan = read_drive(CIRCLE | {"diameter": 8.0, "speed": 0.4}, "circle", 10.0, 1e-3)
    oil = Fault("slip", 0.0, 5.0, wheel, {"grip": 0.1})
    ends = []
    for probes in (True, False):
        helps = Recovery(ROBOT, holds_heading=True, dithers=probes)
        controller = CompiledController(Controller(ROBOT, heading_hold=True), RobustDetector(ROBOT), helps)
        plant = PlanarRobot(ROBOT, "natural_stone", faults=[oil], seed=1, start=plan.start)
        (found,) = drive(plant, controller, plan.reference).about["diagnoses"]
        assert (found["kind"], found["wheels"]) == ("slip", (wheel,))
        ends.append(found["cleared"])
    assert 5.0 < ends[0] < 5.5 and ends[1] is None


def test_tracking_errors_of_the_fault_are_not_attributed_to_the_recovery():
    """A wheel slips while the robot speeds up: it falls behind for want of grip, help or no help."""
    plan = read_drive(
        {"kind": "profile", "direction": 1.57, "speed": "high", "cruise_time": 1.0}, "x", 4.0, 1e-3
    )
    fault = [Fault("slip", 0.0, None, 1, {"grip": 0.05})]
    controller = CompiledController(Controller(ROBOT), RobustDetector(ROBOT), Recovery(ROBOT))
    trace = drive(PlanarRobot(ROBOT, "natural_stone", faults=fault, seed=1), controller, plan.reference)
    assert CAPPING in trace["recovery"]
    assert REVERTED not in trace["recovery"]
