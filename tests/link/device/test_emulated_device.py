"""A plant behind the device: raw numbers that come back as the plant's own, lock-step, and defects."""

import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.errors import InputError, UnknownNameError
from omnimj.link.calibration import Calibration, WheelMap, device_config, require_hardware
from omnimj.link.codec.messages import FaultCode, Status
from omnimj.link.device.emulated import EmulatedDevice, RawEncoder, WiringDefect
from omnimj.link.host.state_machine import Host, HostState
from omnimj.parameters import read_rig, read_robot
from omnimj.plant.planar import PlanarRobot
from omnimj.plant.planar_rig import PlanarRig
from omnimj.signals import CurrentCommand, Measurement

ROBOT = read_robot()
WIRING = require_hardware(ROBOT)
PERIOD = 1.0 / ROBOT.sensors.sample_rate


def odd_wiring():
    """Counts, turned signs, places changed about."""
    inputs = []
    for i in WIRING.inputs:
        if i.name == "wheel_speed_3":
            counter = {"quantity": "wheel_angle", "raw": "counts", "gain": 1e-4, "wrap": 65536.0}
            i = dataclasses.replace(i, **counter)
        if i.name == "yaw":
            i = dataclasses.replace(i, raw="counts", gain=math.tau / 4096.0, offset=100.0)
        inputs.append(dataclasses.replace(i, channel=(i.channel * 5) % 13, sign=-i.sign))
    places = [(2, -1, 1.0), (0, 1, 0.5), (3, -1, 2.0), (1, 1, 1.0)]
    outputs = [
        dataclasses.replace(o, channel=c, sign=s, gain=g, unit="A/A")
        for o, (c, s, g) in zip(WIRING.outputs, places, strict=True)
    ]
    return dataclasses.replace(WIRING, inputs=tuple(inputs), outputs=tuple(outputs))


def plant(**changed):
    return PlanarRobot(ROBOT, "pvc", **changed)


class Drive:
    """A host at an emulated device in lock-step, or in real time by a clock moved by hand."""

    def __init__(self, wiring=WIRING, lock_step=True, **device):
        sessions, nonces = itertools.count(100), itertools.count(1)
        self.emulated = EmulatedDevice(
            plant(seed=3), wiring, lambda: next(sessions), lock_step=lock_step, **device
        )
        self.host: Any = Host(device_config(wiring, PERIOD, lock_step=lock_step), lambda: next(nonces))
        self.wheels, self.calibration, self.now = WheelMap.from_hardware(wiring), Calibration(wiring), 0.0
        self.give(self.host.hello(0.0))
        if not lock_step:
            self.give(self.host.ping(0.0))

    def give(self, *frames):
        for frame in frames:
            self.take(self.emulated.on_frame(self.now, frame))

    def take(self, answers):
        for answer in answers:
            self.give(*self.host.on_frame(self.now, answer))

    def wait(self, periods=1):
        for _ in range(periods):
            self.now += PERIOD
            self.take(self.emulated.tick(self.now))
            self.give(*self.host.check(self.now))

    def command(self, current):
        currents, brake = self.wheels.to_device(CurrentCommand(np.array(current)))
        self.give(self.host.command(self.now, currents, brake))

    def arm(self):
        self.command(np.zeros(4))
        self.give(self.host.arm(self.now))
        return self

    def measured(self):
        reading = self.host.reading
        return self.calibration.convert(1e-6 * reading.time, reading.telemetry.raw)


@given(
    st.lists(st.floats(-5.0, 5.0), min_size=12, max_size=12),
    st.booleans(),
)
def test_physics_comes_back_from_its_raw_numbers_but_for_quantisation(values, odd):
    wiring = odd_wiring() if odd else WIRING
    v = np.array(values)
    given_ = Measurement(0.0, v[:4], v[4:8], v[8:10], float(v[10]), float(v[11]) % math.tau)
    found = Calibration(wiring).convert(0.0, RawEncoder(wiring).encode(given_, 0.0))
    assert found.current == pytest.approx(given_.current, rel=1e-6, abs=1e-6)
    kept = [0, 1, 3] if odd else [0, 1, 2, 3]
    assert found.wheel_speed[kept] == pytest.approx(given_.wheel_speed[kept], rel=1e-6, abs=1e-6)
    assert found.acceleration == pytest.approx(given_.acceleration, rel=1e-6, abs=1e-6)
    assert found.yaw_rate == pytest.approx(given_.yaw_rate, rel=1e-6, abs=1e-6)
    assert math.cos(found.yaw - given_.yaw) > math.cos(math.tau / 4000.0)


def test_volts_are_float32_and_counts_are_whole():
    one = Measurement(0.0, np.full(4, 0.1), np.full(4, 0.1), np.full(2, 0.1), 0.1, 0.1)
    for wiring in (WIRING, odd_wiring()):
        raw = RawEncoder(wiring).encode(one, 1e-3)
        for i in wiring.inputs:
            value = raw[i.channel]
            assert isinstance(value, int) if i.raw == "counts" else float(np.float32(value)) == value


def test_what_is_not_finite_stays_so_in_volts_and_stands_still_in_counts():
    bad = Measurement(0.0, np.full(4, np.nan), np.full(4, np.nan), np.full(2, 1e300), math.inf, math.nan)
    raw = RawEncoder(WIRING).encode(bad, 1e-3)
    assert [math.isfinite(v) for v in raw] == [False] * 12
    raw = RawEncoder(odd_wiring()).encode(bad, 1e-3)
    assert [v for v in raw if math.isfinite(v)] == [0, 0, 0.0]  # speed 3, yaw, and the channel of no use


@pytest.mark.parametrize("wrap", [65536.0, 2.0**32])
def test_a_wheel_speed_goes_through_a_counter_and_back(wrap):
    wiring = odd_wiring()
    inputs = [dataclasses.replace(i, wrap=wrap) if i.quantity == "wheel_angle" else i for i in wiring.inputs]
    wiring = dataclasses.replace(wiring, inputs=tuple(inputs))
    readings, calibration = RawEncoder(wiring), Calibration(wiring)
    speeds = [0.0, 30.0, 30.0, -40.0, -40.0, 0.0] * 300
    for k, speed in enumerate(speeds):
        sample = Measurement(0.0, np.zeros(4), np.full(4, speed), np.zeros(2), 0.0, 0.0)
        found = calibration.convert(k * 1e-3, readings.encode(sample, 1e-3)).wheel_speed[2]
        # one count is 1e-4 rad, so a difference over 1 ms is known to 0.1 rad/s
        assert k == 0 or found == pytest.approx(speed, abs=0.1001)


@pytest.mark.parametrize("odd", [False, True])
def test_in_lock_step_the_host_sees_the_plant_itself_but_for_quantisation(odd):
    drive, alone = Drive(odd_wiring() if odd else WIRING), plant(seed=3)
    drive.arm()
    assert drive.host.state is HostState.ARMED
    expected = alone.reset()
    start = drive.host.reading.time
    for k in range(400):
        found = drive.measured()
        assert drive.host.reading.time - start == 1000 * k
        assert found.current == pytest.approx(expected.current, abs=1e-6)
        kept = [0, 1, 3] if odd else [0, 1, 2, 3]
        assert found.wheel_speed[kept] == pytest.approx(expected.wheel_speed[kept], abs=1e-5)
        assert found.yaw_rate == pytest.approx(expected.yaw_rate, abs=1e-6)
        if not odd:
            assert found.yaw == pytest.approx(expected.yaw, abs=1e-12)
        current = float(np.float32(0.5 * math.sin(0.05 * k)))
        drive.command([current, -current, 0.25 * current, current])
        expected = alone.step(CurrentCommand(np.array([current, -current, 0.25 * current, current])))
    assert abs(expected.wheel_speed).max() > 0.3  # it has moved


def test_a_repeated_command_moves_the_plant_once():
    drive = Drive().arm()
    current, _ = drive.wheels.to_device(CurrentCommand(np.full(4, 0.5)))
    frame = drive.host.command(0.0, current)
    drive.give(frame)
    time, reading = drive.host.reading.time, drive.host.reading
    drive.give(frame, frame)
    assert drive.host.reading is reading  # the same telemetry, already seen
    drive.command(np.full(4, 0.5))
    assert drive.host.reading.time == time + 1000


def test_each_session_in_lock_step_begins_the_run_anew_while_time_goes_on():
    drive = Drive().arm()
    runs, times = [], []
    for _ in range(2):
        run = []
        for _ in range(50):
            drive.command(np.full(4, 0.5))
            run.append(drive.host.reading.telemetry.raw)
            times.append(drive.host.reading.time)
        runs.append(run)
        drive.give(*drive.host.stop(0.0))
        drive.give(drive.host.hello(0.0))
        drive.command(np.zeros(4))
        drive.give(drive.host.reset(0.0))
        drive.arm()
    assert runs[0] == runs[1]
    assert times == sorted(times)


def test_a_brake_reaches_the_right_wheel():
    drive = Drive(odd_wiring()).arm()
    currents, brake = drive.wheels.to_device(CurrentCommand(np.zeros(4), (3,)))
    seen = []
    step = drive.emulated._plant.step
    drive.emulated._plant.step = lambda command: seen.append(command) or step(command)
    drive.give(drive.host.command(0.0, currents, brake))
    assert seen[0].brake == (3,)


def test_in_real_time_the_plant_moves_by_the_clock_and_a_silent_host_stops_it():
    drive = Drive(lock_step=False)
    drive.wait()
    drive.arm()
    drive.wait()
    assert drive.host.state is HostState.ARMED
    for _ in range(30):
        drive.command(np.full(4, 0.5))
        drive.wait()
    assert drive.measured().wheel_speed.min() > 1.0
    assert drive.emulated.device.output.currents == (0.5,) * 4
    for _ in range(52):
        drive.now += PERIOD
        drive.emulated.tick(drive.now)
    assert drive.emulated.device.fault is FaultCode.COMMAND_TOO_OLD
    assert drive.emulated.device.output.currents == (0.0,) * 4
    drive.give(*drive.host.check(drive.now))
    assert drive.host.state is HostState.STOPPED


@pytest.mark.parametrize("late", [0, 1, 5])
def test_readings_may_be_late_and_carry_their_time(late):
    drive = Drive(lock_step=False, late=late)
    for k in range(1, 12):
        drive.wait()
        assert drive.host.reading.time == round(1e6 * max(1, k - late) * PERIOD)
        assert drive.host.reading.sequence == k + 2


def test_readings_that_are_too_late_are_dropped_once_the_host_knows_the_clock():
    drive = Drive(lock_step=False, late=25)
    drive.give(drive.host.ping(0.0))
    drive.wait(40)
    # the first sample is given again and again until it is 20 ms old, give or take the rounding of times
    last = round(drive.host.reading.arrived / PERIOD)
    assert last in (20, 21)
    assert drive.host.dropped == 40 - last


@pytest.mark.parametrize(
    ("place", "index"), [("wheel_speed_2", 5), ("current_1", 0), ("yaw_rate", 10), ("acceleration_y", 9)]
)
@pytest.mark.parametrize(("kind", "factor"), [("sign", -1.0), ("gain", 0.5), ("dead", 0.0)])
def test_a_defect_of_a_channel_shows_there_and_nowhere_else(place, index, kind, factor):
    sample = Measurement(0.0, np.full(4, 0.5), np.full(4, 4.0), np.full(2, 2.0), 1.0, 1.0)
    right = RawEncoder(WIRING).encode(sample, 1e-3)
    wrong = RawEncoder(WIRING, [WiringDefect(kind, place, 0.5)]).encode(sample, 1e-3)
    assert wrong[index] == pytest.approx(factor * right[index])
    assert [w == r for w, r in zip(wrong, right, strict=True)].count(False) == 1


@pytest.mark.parametrize(("kind", "factor"), [("sign", -1.0), ("gain", 0.5), ("dead", 0.0)])
def test_a_defect_of_a_motor_shows_in_what_it_carries(kind, factor):
    drive = Drive(defects=[WiringDefect(kind, "motor_3", 0.5)]).arm()
    seen = []
    step = drive.emulated._plant.step
    drive.emulated._plant.step = lambda command: seen.append(command.current.tolist()) or step(command)
    drive.command([0.5, 0.25, 0.5, -0.25])
    assert seen == [[0.5, 0.25, 0.5 * factor, -0.25]]


def test_the_device_reports_that_current_flows():
    drive = Drive().arm()
    drive.command(np.full(4, 0.5))
    status = drive.host.reading.telemetry.status
    assert status == Status.ARMED | Status.CURRENT_FLOWS | Status.LOCK_STEP


def test_unknown_defects_and_other_plants_are_refused():
    with pytest.raises(UnknownNameError, match="unknown kind 'smell'"):
        Drive(defects=[WiringDefect("smell", "yaw")])
    with pytest.raises(UnknownNameError, match="unknown place 'motor_5'"):
        Drive(defects=[WiringDefect("sign", "motor_5")])
    rig = PlanarRig(read_rig(), "pvc", mass=3.0, lateral_speed=0.0)
    with pytest.raises(InputError, match="a robot is needed"):
        EmulatedDevice(rig, WIRING, lambda: 1, lock_step=True)
    three = dataclasses.replace(WIRING, outputs=WIRING.outputs[:3])
    with pytest.raises(InputError, match="found 4 wheels; the wiring is for 3"):
        EmulatedDevice(plant(), three, lambda: 1, lock_step=True)
