"""A device knows how old a command is: its age counts from the telemetry that it answers."""

from __future__ import annotations

import math

import pytest
from device_driver import PERIOD, ZERO, DeviceDriver, codes, faults

from omnimj.link.codec.messages import Command, Fault, FaultCode, Frame, Status, Stop
from omnimj.link.device.limits import CURRENT_SETTLING

MOVE = (0.5, 0.0, 0.0)


def test_a_command_may_answer_a_telemetry_as_old_as_its_valid_for_and_no_older():
    for periods, expected in ((64, []), (65, [FaultCode.STALE])):
        driver = DeviceDriver().begin()
        driver.tick()
        seen = driver.newest
        driver.tick(periods=periods)
        answer = driver.command(valid_for=0.0625, telemetry=seen)
        assert codes(answer) == expected
        assert [f.value for f in faults(answer)] == [65 * PERIOD for _ in expected]


@pytest.mark.parametrize("telemetry", [0, 1, 2, 9999, 2**32 - 1])
def test_a_command_that_answers_no_telemetry_is_stale(telemetry):
    driver = DeviceDriver().driving(MOVE)
    (fault,) = faults(driver.command(MOVE, telemetry=telemetry))
    assert fault == Fault(FaultCode.STALE, 0, math.inf, 0.0625, driver.sequence, latched=False)


def test_a_stale_command_is_as_good_as_lost():
    driver = DeviceDriver().driving(MOVE)
    seen = driver.newest
    before = driver.device._acknowledged
    driver.tick(periods=30)
    driver.command(MOVE, telemetry=seen - 1, valid_for=2 * PERIOD)
    assert driver.device.armed and driver.device.output.currents == MOVE
    driver.tick()
    assert driver.telemetry.acknowledged == before and driver.telemetry.refused == 1
    driver.command((0.25, 0.0, 0.0))
    driver.tick()
    assert driver.device.output.currents == (0.25, 0.0, 0.0)


@pytest.mark.parametrize("valid_for", [0.0, -1.0, math.nan, 9.0])
def test_a_lifetime_that_is_not_allowed_makes_no_command_fresh_nor_hides_behind_its_age(valid_for):
    driver = DeviceDriver().driving(MOVE)
    assert codes(driver.command(MOVE, valid_for=valid_for)) != [FaultCode.STALE]
    driver = DeviceDriver().driving(MOVE)
    assert codes(driver.command(MOVE, valid_for=valid_for, telemetry=1)) == [FaultCode.STALE]


def delayed(driver: DeviceDriver, delays: list[int], move=MOVE) -> None:
    """A host that answers each telemetry at once, on a path that delays command k by so many periods."""
    under_way: list[tuple[int, Frame]] = []
    for k, delay in enumerate(delays):
        driver.tick()
        frame = driver.frame(Command(move, 0.0625, 0, driver.newest))
        under_way.append((max([k + delay, *(when for when, _ in under_way)]), frame))  # in order
        for when, one in list(under_way):
            if when <= k:
                driver.deliver(one)
                under_way.remove((when, one))


def test_a_path_that_is_delayed_by_a_second_lets_no_current_flow():
    driver = DeviceDriver().begin()
    begin = driver.now
    delayed(driver, [1024] * 2048, ZERO)
    assert driver.now > begin + 1.9 and driver.telemetry.acknowledged == 0
    driver = DeviceDriver().driving(MOVE, valid_for=0.25)
    seen = driver.now
    late = [driver.frame(Command(MOVE, 0.25, 0, driver.newest)) for _ in range(1000)]
    flowed = []
    for k in range(2000):
        driver.tick()
        if k >= 1000:
            driver.deliver(late[k - 1000])
        flowed.append(driver.now if any(driver.device.output.currents) else 0.0)
    assert max(flowed) <= seen + 0.25
    assert driver.device.fault is FaultCode.COMMAND_TOO_OLD


def test_a_healthy_path_with_jitter_of_20_ms_runs_on():
    driver = DeviceDriver().driving(MOVE)
    delays = [(k * 7919) % 21 for k in range(2000)]
    delayed(driver, delays)
    assert driver.device.armed and driver.device.output.currents == MOVE
    assert driver.device.refused == 0


@pytest.mark.parametrize("held", [1, 10, 40])
def test_current_ends_within_valid_for_of_the_telemetry_however_long_the_command_travels(held):
    driver = DeviceDriver().driving(MOVE, valid_for=0.0625)
    seen = driver.now
    last = driver.frame(Command(MOVE, 0.0625, 0, driver.newest))
    for k in range(200):
        driver.tick()
        if k == held:
            driver.deliver(last)
        if any(driver.device.output.currents):
            assert driver.now <= seen + 0.0625


def test_arming_on_a_zero_command_that_waited_in_a_queue_is_refused():
    driver = DeviceDriver().begin()
    driver.tick()
    zero = driver.frame(Command(ZERO, 4 * PERIOD, 0, driver.newest))
    driver.tick(periods=3)
    assert driver.deliver(zero) == ()
    driver.tick(periods=2)
    assert codes(driver.arm()) == [FaultCode.ARM_NOT_ZERO]


def test_after_a_stop_a_zero_command_and_arm_are_not_enough():
    driver = DeviceDriver().driving(MOVE)
    driver.give(Stop(), session=0, sequence=0)
    driver.tick()
    assert Status.STOPPED in driver.telemetry.status
    driver.begin(nonce=9)  # nor is a new session
    driver.tick()
    driver.command()
    assert codes(driver.arm()) == [FaultCode.ARM_STOPPED]
    assert driver.reset() == () and not driver.device.armed
    driver.command()
    assert driver.arm() == () and driver.device.armed


def test_a_stop_of_a_device_that_was_never_armed_is_latched_too():
    driver = DeviceDriver()
    driver.give(Stop())
    assert driver.device.stopped
    driver.begin().tick()
    driver.command()
    assert codes(driver.arm()) == [FaultCode.ARM_STOPPED]


def test_brake_and_current_on_one_wheel_are_refused_and_latched():
    driver = DeviceDriver().driving(MOVE)
    (fault,) = faults(driver.command(MOVE, brake=3))
    assert fault == Fault(FaultCode.BRAKE_AND_CURRENT, 1, 0.5, 0.0, driver.sequence, latched=True)
    assert driver.device.fault is FaultCode.BRAKE_AND_CURRENT and not driver.device.armed
    driver = DeviceDriver().driving(MOVE)
    assert driver.command(MOVE, brake=6) == ()


class Amplifiers:
    """Measured currents that follow the set values but for an error per wheel."""

    def __init__(self, errors):
        self.errors, self.driver = errors, DeviceDriver(currents=self.read)

    def read(self, raw):
        output = self.driver.device.output
        return tuple(c + e for c, e in zip(output.currents, self.errors, strict=True))

    def drive(self, time, move=MOVE, brake=0):
        codes_seen = []
        for _ in range(round(time / PERIOD)):
            codes_seen += codes(self.driver.command(move, brake=brake)) + codes(self.driver.tick())
            if codes_seen:
                break
        return codes_seen


@pytest.mark.parametrize("error", [0.51, -0.51, math.nan, math.inf])
def test_a_current_that_does_not_follow_its_set_value_trips_within_half_a_second(error):
    robot = Amplifiers([0.0, 0.0, 0.0])
    robot.driver.driving(MOVE)
    robot.errors = [0.0, error, 0.0]
    begin = robot.driver.now
    assert robot.drive(2.0) == [FaultCode.CURRENT_DEVIATION]
    assert CURRENT_SETTLING < robot.driver.now - begin <= CURRENT_SETTLING + 3 * PERIOD
    assert faults(robot.driver.received)[-1].wheel == 2 and not robot.driver.device.armed


def test_a_current_that_follows_or_deviates_briefly_or_is_braked_trips_nothing():
    robot = Amplifiers([0.5, -0.5, 0.0])
    robot.driver.driving((0.25, 0.0, 0.0))
    assert robot.drive(1.0, (0.25, 0.0, 0.0)) == []
    robot.errors = [0.0, 0.7, 0.0]
    assert robot.drive(0.4) == []
    robot.errors = [0.0, 0.0, 0.0]
    assert robot.drive(0.1) == []
    robot.errors = [0.0, 0.7, 0.0]
    assert robot.drive(0.4) == []
    robot.errors = [0.0, 0.0, 0.0]
    assert robot.drive(0.1, brake=2) == []
    robot.errors = [0.0, 0.7, 0.0]
    assert robot.drive(1.0, brake=2) == []


def test_heat_counts_the_larger_of_set_and_measured_current_also_of_a_disarmed_device():
    robot = Amplifiers([0.0, 0.0, 1.5])
    robot.driver.begin()
    robot.driver.tick(periods=101)
    assert robot.driver.device._heat == (0.0, 0.0, 100 * PERIOD * (1.5**2 - 0.5**2))
    robot = Amplifiers([0.0, math.nan, 0.0])
    robot.driver.begin()
    robot.driver.tick(periods=10)
    assert robot.driver.device._heat == (0.0, 0.0, 0.0)
