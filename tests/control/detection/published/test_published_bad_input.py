"""Whatever sensors read, the published method goes on and its advice stays a matrix of numbers."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnimj.control.cascade.controller import Controller, is_good
from omnimj.control.detection.detector import VARIANTS, DetectorOptions
from omnimj.control.detection.published.decision import PRINTED_THRESHOLDS
from omnimj.control.detection.published.rig import PublishedRigDetector
from omnimj.control.detection.published.robot import PublishedRobotDetector
from omnimj.control.fault_tolerant import FaultTolerantController
from omnimj.errors import InputError
from omnimj.parameters import read_floors, read_rig, read_robot
from omnimj.parameters.robot import WheelMount
from omnimj.signals import Measurement, RigMeasurement, Target

STONE = read_floors()["natural_stone"]
ROBOT, RIG = read_robot(), read_rig()
ANY = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-50.0, 50.0))


def four(values):
    return st.lists(values, min_size=4, max_size=4).map(np.array)


MEASUREMENTS = st.builds(
    Measurement,
    time=st.one_of(ANY, st.floats(0.0, 0.05)),
    current=st.one_of(four(ANY), st.just(np.zeros(3)), four(st.floats(-5.0, 5.0))),
    wheel_speed=st.one_of(four(ANY), four(st.floats(-40.0, 40.0))),
    acceleration=st.one_of(st.just(np.zeros(2)), st.just(np.array([math.nan, 0.0])), st.just(np.zeros(0))),
    yaw_rate=ANY,
    yaw=st.floats(0.0, 6.2),
)
RIG_MEASUREMENTS = st.builds(RigMeasurement, *([ANY] * 6))


@pytest.mark.slow
@pytest.mark.parametrize("variant", VARIANTS)
@settings(max_examples=60)
@given(found=st.lists(MEASUREMENTS, min_size=1, max_size=12))
def test_no_measurement_stops_the_robot_s_method(variant, found):
    method = PublishedRobotDetector(ROBOT, STONE, PRINTED_THRESHOLDS, DetectorOptions(variant))
    state = method.start(found[0])
    for measurement in found:
        if is_good(measurement, 4):
            state = method.step(state, measurement)
        assert state.log.shape == (len(method.log_names),)
        assert state.reconfiguration is not None
        assert np.all(np.isfinite(state.reconfiguration.speed_per_twist))
        assert np.all(np.isfinite(state.observer))


@pytest.mark.parametrize("variant", VARIANTS)
@settings(max_examples=60)
@given(found=st.lists(RIG_MEASUREMENTS, min_size=1, max_size=12))
def test_no_measurement_stops_the_rig_s_method(variant, found):
    method = PublishedRigDetector(RIG, STONE, None, PRINTED_THRESHOLDS, DetectorOptions(variant))
    state = method.start(found[0])
    for measurement in found:
        state = method.step(state, measurement)
        assert state.log.shape == (len(method.log_names),)
        assert np.all(np.isfinite(state.observer))


def test_a_bad_measurement_never_reaches_the_detector():
    detector = PublishedRobotDetector(ROBOT, STONE, PRINTED_THRESHOLDS, DetectorOptions())
    controller = FaultTolerantController(Controller(ROBOT), detector)
    good, still = (
        Measurement(0.0, np.zeros(4), np.zeros(4), np.zeros(2), 0.0, 0.0),
        Target(np.zeros(2), 0.0, 0.0),
    )
    _, state = controller.step(controller.start(good), good, still)
    bad = dataclasses.replace(good, time=0.001, current=np.array([0.0, math.nan, 0.0, 0.0]))
    command, after = controller.step(state, bad, still)
    assert after.detector is state.detector and not command.current.any()


def test_a_wheel_that_drives_askew_has_no_row_in_table_5_2():
    askew = (WheelMount((0.25, 0.0), (0.6, -0.8)), *ROBOT.wheels[1:])
    with pytest.raises(InputError, match=r"Table 5\.2"):
        PublishedRobotDetector(
            dataclasses.replace(ROBOT, wheels=askew), STONE, PRINTED_THRESHOLDS, DetectorOptions()
        )
