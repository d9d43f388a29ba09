"""The compiled step does exactly what cascade, detector and recovery do one after the other."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import in_turn

from omnimj.control.cascade.controller import Controller
from omnimj.control.compiled import CompiledController
from omnimj.control.detection.robust import RobustDetector
from omnimj.control.fault_tolerant import FaultTolerantController
from omnimj.control.recovery import Recovery
from omnimj.parameters import read_robot
from omnimj.physics.native import on_compilation
from omnimj.plant.faults import Fault
from omnimj.plant.planar import PlanarRobot
from omnimj.signals import Target
from omnimj.simulate.driving import drive
from omnimj.simulate.suites.missions import mission

ROBOT = read_robot()


def controller_of(kind, recovers=True, **options):
    recovery = Recovery(ROBOT, **options) if recovers else None
    return kind(Controller(ROBOT), RobustDetector(ROBOT), recovery)


def driven(kind, faults, recovers, **options):
    plant = PlanarRobot(ROBOT, "natural_stone", faults=faults, seed=5)
    plan = mission(np.random.default_rng(5), 5.0, plant.period)
    return drive(plant, controller_of(kind, recovers, **options), plan)


FAULTS = {
    "hard over": (Fault("hard_over", 2.0, None, 2, {"current": 1.0}),),
    "healthy": (),
    "locked": (Fault("locked", 1.5, None, 1, {}),),
    "slip and motor": (
        Fault("slip", 1.8, 2.6, 1, {"grip": 0.1}),
        Fault("motor", 1.2, None, 2, {"loss": 0.57}),
    ),
    "sensor": (Fault("sensor", 2.0, None, None, {"channel": "yaw_rate", "mode": "bias", "size": 0.3}),),
}


@pytest.mark.parametrize(("name", "recovers"), in_turn(FAULTS, [True, False]))
def test_one_compiled_step_is_detector_recovery_and_cascade_bit_for_bit(name, recovers):
    faults = FAULTS[name]
    parts = driven(FaultTolerantController, faults, recovers)
    compiled = driven(CompiledController, faults, recovers)
    assert compiled.about["diagnoses"] == parts.about["diagnoses"]
    assert {fault.kind for fault in faults} == {found["kind"] for found in parts.about["diagnoses"]}
    assert list(compiled.columns) == list(parts.columns)
    for name in parts.columns:
        assert np.array_equal(compiled[name], parts[name], equal_nan=True), name


@settings(max_examples=30, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 59),
            st.sampled_from(["current", "wheel_speed", "acceleration", "yaw_rate", "yaw", "time", "short"]),
            st.sampled_from([math.nan, math.inf, -math.inf, 1e300, 0.0]),
        ),
        max_size=8,
    )
)
def test_broken_measurements_stop_neither_and_are_answered_alike(broken):
    parts, compiled = controller_of(FaultTolerantController), controller_of(CompiledController)
    plant = PlanarRobot(ROBOT, "natural_stone", seed=3)
    measured, target = plant.reset(), Target(np.array((0.3, 0.1)), 0.2, 0.0)
    states = [parts.start(measured), compiled.start(measured)]
    for k in range(60):
        seen = measured
        for when, field, value in broken:
            if when == k and field == "short":
                seen = dataclasses.replace(seen, wheel_speed=seen.wheel_speed[:2])
            elif when == k:
                now = getattr(seen, field)
                changed = np.full_like(now, value) if isinstance(now, np.ndarray) else value
                seen = dataclasses.replace(seen, **{field: changed})
        (first, states[0]), (second, states[1]) = (
            c.step(state, seen, target) for c, state in zip((parts, compiled), states, strict=True)
        )
        assert np.array_equal(first.current, second.current) and first.brake == second.brake
        assert np.array_equal(states[0].log, states[1].log, equal_nan=True)
        measured = plant.step(first)


def test_a_step_leaves_the_state_before_it_as_it_was():
    controller = controller_of(CompiledController, self_test=True)
    plant = PlanarRobot(ROBOT, "natural_stone", seed=2)
    measured, target = plant.reset(), Target(np.array((0.4, 0.0)), 0.0, 0.0)
    state = controller.start(measured)
    for _ in range(35):
        record, memory = state.record.tobytes(), state.memory.tobytes()
        command, after = controller.step(state, measured, target)
        assert state.record.tobytes() == record and state.memory.tobytes() == memory
        again, _ = controller.step(state, measured, target)
        assert np.array_equal(again.current, command.current), "the same input gives the same command"
        measured, state = plant.step(command), after


def laid_out(measurement, layout):
    arrays = {name: layout(getattr(measurement, name)) for name in ("current", "wheel_speed", "acceleration")}
    return dataclasses.replace(measurement, **arrays)


LAYOUTS = {
    "every third number": lambda a: np.repeat(a, 3)[::3],
    "backwards": lambda a: a[::-1].copy()[::-1],
    "read only": lambda a: np.frombuffer(a.tobytes()),
    "list": list,
}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
@pytest.mark.parametrize("kind", [FaultTolerantController, CompiledController])
def test_readings_laid_out_in_any_way_are_answered_alike_and_compile_nothing(kind, layout):
    controller, plant = controller_of(kind), PlanarRobot(ROBOT, "natural_stone", seed=3)
    measured, target, compiled = plant.reset(), Target(np.array((0.3, 0.1)), 0.2, 0.0), []
    plain = other = controller.start(measured)
    for k in range(40):  # blocks are judged, too
        command, plain = controller.step(plain, measured, target)
        if k == 20:  # everything has been called
            on_compilation(compiled.append)
        again, other = controller.step(other, laid_out(measured, layout) if k >= 20 else measured, target)
        assert np.array_equal(command.current, again.current)
        measured = plant.step(command)
    on_compilation(None)
    assert compiled == []
