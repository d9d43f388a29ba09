"""The wiring check on a simulated robot: every defect is named, and a robot without one passes."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import checkerboard

from omnimj.link.calibration import Calibration
from omnimj.link.check.motions import MotionSequence
from omnimj.link.check.wiring import judge_wiring
from omnimj.link.device.emulated import RawEncoder, WiringDefect
from omnimj.parameters import read_robot
from omnimj.plant.planar import PlanarRobot
from omnimj.signals import CurrentCommand, Measurement

ROBOT = read_robot()
MOST = 0.8
WHEELS = range(1, 5)
BODY = ("yaw_rate", "yaw", "acceleration_x", "acceleration_y")


class KnownRobot:
    """A planar robot that computes nothing while its commands are those of its first run."""

    def __init__(self):
        self._robot = PlanarRobot(ROBOT, "natural_stone", seed=1)
        self.period = self._robot.period
        self._known: list[tuple[bytes, Measurement]] = []
        self._is_first = True

    def reset(self):
        self._done, self._is_first, self._parted = 0, not self._known, False
        return self._robot.reset()

    def step(self, command: CurrentCommand):
        current = command.current.tobytes()
        if not self._is_first and not self._parted:
            if self._done < len(self._known) and self._known[self._done][0] == current:
                self._done += 1
                return self._known[self._done - 1][1]
            self._parted = True
            for known, _ in self._known[: self._done]:
                self._robot.step(CurrentCommand(np.frombuffer(known)))
        measured = self._robot.step(command)
        if self._is_first:
            self._known.append((current, measured))
        return measured


@functools.cache
def known_robot():
    """It knows the run of the check on stone, its wiring being right."""
    robot = KnownRobot()
    moved(Miswired((), robot), True)
    return robot


class Miswired:
    """A planar robot seen through its wiring."""

    def __init__(self, defects, robot):
        self._plant = robot
        self.period, self.truth_names = self._plant.period, ()
        assert ROBOT.hardware is not None
        self._raw, self._calibration = RawEncoder(ROBOT.hardware, defects), Calibration(ROBOT.hardware)
        self._motors = np.ones(4)
        for defect in defects:
            if defect.place.startswith("motor_"):
                self._motors[int(defect.place[-1]) - 1] *= defect.factor

    def reset(self):
        self._raw.reset()
        self._calibration.reset()
        return self._seen(self._plant.reset(), 0.0)

    def step(self, command: CurrentCommand):
        return self._seen(
            self._plant.step(replace(command, current=self._motors * command.current)), self.period
        )

    def truth(self):
        return np.zeros(0)

    def close(self):
        pass

    def _seen(self, measured, elapsed):
        return self._calibration.convert(measured.time, self._raw.encode(measured, elapsed))


def moved(robot, on_floor):
    """The motions at rest, of one wheel each, and on the spot."""
    pulses = MotionSequence(robot, MOST)
    still = pulses.rest(0.3)
    single = [pulses.one(wheel, sign) for wheel in range(4) for sign in (1.0, -1.0)]
    turns = [pulses.turn(sign) for sign in (1.0, -1.0)] if on_floor else []
    return still, single, turns


def judged(motions, seen=None):
    still, single, turns = motions
    return {(f.place, f.kind) for f in judge_wiring(ROBOT, still, single, turns, seen)}


def checked(defects=(), on_floor=True, floor="natural_stone"):
    robot = known_robot() if floor == "natural_stone" else PlanarRobot(ROBOT, floor, seed=1)
    return judged(moved(Miswired(defects, robot), on_floor))


@pytest.mark.parametrize(
    ("floor", "on_floor"), checkerboard(("natural_stone", "pvc", "paperboard"), (True, False))
)
def test_a_robot_that_is_wired_well_passes(floor, on_floor):
    assert checked((), on_floor, floor=floor) == set()


OTHERS = (
    [f"current_{i}" for i in (1, 3, 4)] + [f"wheel_speed_{i}" for i in (1, 2, 3)] + ["motor_2", "motor_4"]
)


@pytest.mark.slow
@pytest.mark.parametrize("place", ["current_2", "wheel_speed_4", "motor_1", "motor_3", *BODY, *OTHERS])
def test_a_wrong_sign_is_reported_by_its_name(place):
    assert checked([WiringDefect("sign", place)]) == {(place, "sign")}


@pytest.mark.slow
@settings(max_examples=6, deadline=None)
@given(
    st.sets(st.sampled_from([f"wheel_speed_{i}" for i in WHEELS] + ["motor_1", "motor_4", "yaw"]), max_size=3)
)
def test_several_wrong_signs_are_reported_together(places):
    assert checked([WiringDefect("sign", p) for p in places]) == {(p, "sign") for p in places}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "factor"), checkerboard(("wheel_speed_1", "wheel_speed_4", "yaw_rate", "yaw"), (0.6, 1.5))
)
def test_a_wrong_gain_is_reported_by_its_name(place, factor):
    assert checked([WiringDefect("gain", place, factor)]) == {(place, "gain")}


@pytest.mark.slow
@pytest.mark.parametrize("place", ["motor_2", "current_2"])
def test_a_wrong_gain_of_amplifier_or_monitor_is_reported_as_either(place):
    assert checked([WiringDefect("gain", place, 0.6)]) == {("motor_2 or current_2", "gain")}


@pytest.mark.slow
@pytest.mark.parametrize("place", ["current_3", "wheel_speed_2", *BODY])
def test_a_dead_channel_is_reported(place):
    assert checked([WiringDefect("dead", place)]) == {(place, "dead")}


@pytest.mark.slow
def test_a_dead_motor_is_reported():
    assert checked([WiringDefect("dead", "motor_3")]) == {("motor_3 or current_3", "dead")}


@pytest.mark.slow
def test_off_the_floor_a_person_distinguishes_a_motor_from_its_channel():
    for place in ("motor_2", "wheel_speed_2"):
        motions = moved(Miswired([WiringDefect("sign", place)], known_robot()), on_floor=False)
        (found,) = {place for place, kind in judged(motions) if place != "current_2"}
        assert found == "motor_2 or wheel_speed_2"
        way = dict.fromkeys(range(4), 1) | {1: -1 if place == "motor_2" else 1}
        assert (place, "sign") in judged(motions, way)
