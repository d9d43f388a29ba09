"""Who may arm the device, and when; sessions, sequences and keys."""

import math
from typing import Any

import pytest
from device_driver import CALIBRATION_HASH, CHANNELS, LIMITS, PERIOD, ZERO, DeviceDriver, codes, faults

from omnimj.errors import InputError
from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    ChannelKind,
    Command,
    Fault,
    FaultCode,
    Hello,
    Ping,
    Pong,
    Quantity,
    Raw,
    Reset,
    Status,
    Stop,
    Telemetry,
    counts_mask,
)
from omnimj.link.device.config import DeviceConfig
from omnimj.link.device.limits import MAX_TELEMETRY_AGE, check_arming, is_zero_command
from omnimj.link.device.state_machine import Device


def test_a_device_without_a_session_sends_nothing_and_moves_nothing():
    driver = DeviceDriver()
    assert driver.tick(periods=3) == ()
    assert driver.command() == driver.arm() == driver.give(Ping(1)) == ()
    assert driver.device.dropped == 3
    assert driver.device.output.currents == ZERO
    assert driver.device.session == 0
    driver.begin()
    assert driver.device.dropped == 3
    driver.tick()
    assert (driver.telemetry.acknowledged, driver.telemetry.command_age) == (0, math.inf)


def test_hello_is_answered_by_what_the_device_is_under_a_fresh_session():
    driver = DeviceDriver(start=2.5)
    (answer,) = driver.hello(nonce=99)
    capabilities = answer.message
    assert (answer.session, answer.sequence, answer.time) == (1001, 1, 2_500_000)
    facts = (99, PERIOD, False, 3, CHANNELS, LIMITS, driver.limits_hash, CALIBRATION_HASH)
    assert capabilities == Capabilities(*facts)
    driver.give(Ping(1))
    (answer,) = driver.hello(nonce=100)
    assert answer.session == 1002


def test_a_hello_that_is_repeated_because_its_answer_was_lost_gets_the_same_session():
    driver = DeviceDriver()
    hello = driver.ask()
    first, second = driver.enter(hello), driver.enter(hello)
    assert first[0].session == second[0].session == 1001
    assert second[0].sequence == 2
    assert driver.hello(nonce=8)[0].session == 1002
    driver.give(Ping(1))
    assert driver.hello(nonce=8)[0].session == 1003  # it has been used


def test_a_session_is_never_zero_nor_the_one_before_and_has_32_bits():
    driver = DeviceDriver(sessions=[0, 1, 2**32 + 5, 2**32 - 1, 2**32 - 1, 7])
    assert [driver.hello(nonce=n)[0].session for n in range(1, 7)] == [1, 2, 5, 2**32 - 1, 1, 7]


def test_the_very_first_hello_begins_a_session_whatever_its_nonce():
    assert DeviceDriver().hello(nonce=0)[0].session == 1001


def test_arming_takes_a_zero_command_and_fresh_telemetry():
    driver = DeviceDriver()
    driver.begin()
    driver.tick()
    assert driver.command() == ()
    assert driver.arm() == ()
    assert driver.device.armed
    driver.tick()
    assert driver.telemetry.status == Status.ARMED
    assert (driver.telemetry.acknowledged, driver.telemetry.command_age) == (2, PERIOD)


def test_without_any_command_the_device_is_not_armed():
    driver = DeviceDriver()
    driver.begin()
    driver.tick()
    assert codes(driver.arm()) == [FaultCode.ARM_NOT_ZERO]
    assert not driver.device.armed
    assert driver.device.refused == 1
    assert driver.device.fault is FaultCode.NONE  # nothing is latched


def test_a_zero_command_that_is_no_longer_valid_does_not_arm():
    for waited, expected in ((64, []), (65, [FaultCode.ARM_NOT_ZERO])):
        driver = DeviceDriver()
        driver.begin()
        driver.tick()
        driver.command(valid_for=0.0625)
        driver.tick(periods=waited)
        assert codes(driver.arm()) == expected
        assert driver.device.armed == (not expected)


def test_a_command_of_the_session_before_does_not_arm_this_one():
    driver = DeviceDriver()
    driver.begin()
    driver.command()
    driver.hello(nonce=8)
    driver.tick()
    assert codes(driver.arm()) == [FaultCode.ARM_NOT_ZERO]


def test_telemetry_of_the_session_before_does_not_arm_this_one():
    driver = DeviceDriver()
    driver.begin()
    driver.tick(periods=3)
    driver.begin(nonce=8)
    driver.tick()
    driver.command()
    assert codes(driver.arm(telemetry=5)) == [FaultCode.ARM_STALE_TELEMETRY]


def test_telemetry_that_the_host_names_may_be_20_ms_old_and_must_have_been_sent():
    for periods, expected in ((20, []), (21, [FaultCode.ARM_STALE_TELEMETRY])):
        driver = DeviceDriver()
        driver.begin()
        driver.tick()
        seen = driver.received[-1].sequence
        driver.tick(periods=periods)
        driver.command()
        answer = driver.arm(telemetry=seen)
        assert codes(answer) == expected
        assert [f.value for f in faults(answer)] == [21 * PERIOD for _ in expected]
    for unknown in (0, 1, 99):  # 1 was the capabilities
        driver = DeviceDriver()
        driver.begin()
        driver.tick()
        driver.command()
        assert codes(driver.arm(telemetry=unknown)) == [FaultCode.ARM_STALE_TELEMETRY]
        assert faults(driver.received)[0].value == math.inf


def test_hashes_must_agree():
    driver = DeviceDriver()
    driver.begin()
    driver.tick()
    driver.command()
    assert codes(driver.arm(limits_hash=driver.limits_hash ^ 1)) == [FaultCode.ARM_LIMITS]
    assert codes(driver.arm(calibration_hash=CALIBRATION_HASH ^ 1)) == [FaultCode.ARM_CALIBRATION]
    assert not driver.device.armed
    assert driver.device.refused == 2
    assert driver.arm() == ()
    assert driver.device.armed


GOOD = (Arm(1, 2, 5), True, FaultCode.NONE, False, (1, 2), Command(ZERO, 0.05), 0.05, 0.02)


def test_reasons_against_arming_come_in_their_order_and_name_what_was_found():
    arm, same, fault, stopped, hashes, command, age, _ = GOOD
    assert check_arming(*GOOD) is None
    bad = Command((0.0, 0.0, 1e-30), 0.05)

    def refusal(*given):
        found: Any = check_arming(*given)
        return found.code, found.wheel, found.value, found.limit

    late = math.nextafter(MAX_TELEMETRY_AGE, 1.0)
    hot = FaultCode.HEATING
    assert refusal(arm, False, hot, True, (9, 9), bad, age, late) == (FaultCode.ARM_SCHEMA, 0, 0.0, 0.0)
    assert refusal(arm, same, hot, True, (9, 9), bad, age, late) == (FaultCode.ARM_FAULTY, 0, 5.0, 0.0)
    assert refusal(arm, same, fault, True, (9, 9), bad, age, late) == (FaultCode.ARM_STOPPED, 0, 0.0, 0.0)
    assert refusal(arm, same, fault, stopped, (9, 9), bad, age, late) == (FaultCode.ARM_LIMITS, 0, 0.0, 0.0)
    assert refusal(arm, same, fault, stopped, (1, 9), bad, age, late) == (
        FaultCode.ARM_CALIBRATION,
        0,
        0.0,
        0.0,
    )
    assert refusal(arm, same, fault, stopped, hashes, bad, age, late) == (
        FaultCode.ARM_NOT_ZERO,
        0,
        0.05,
        0.05,
    )
    old = math.nextafter(0.05, 1.0)
    assert refusal(arm, same, fault, stopped, hashes, command, old, late) == (
        FaultCode.ARM_NOT_ZERO,
        0,
        old,
        0.05,
    )
    assert refusal(arm, same, fault, stopped, hashes, command, age, late) == (
        FaultCode.ARM_STALE_TELEMETRY,
        0,
        late,
        MAX_TELEMETRY_AGE,
    )
    assert MAX_TELEMETRY_AGE == 0.02


def test_zero_is_zero_current_of_every_wheel_and_no_brake():
    assert is_zero_command(Command(ZERO, 0.05)) and is_zero_command(Command((-0.0,) * 3, 0.05))
    for wheel in range(3):
        for current in (5e-324, -5e-324, math.nan, math.inf):
            assert not is_zero_command(Command((0.0,) * wheel + (current,) + (0.0,) * (2 - wheel), 0.05))
    assert not is_zero_command(Command(ZERO, 0.05, brake=1))


def test_a_host_with_another_message_layout_may_query_and_stop_but_never_arms():
    driver = DeviceDriver()
    assert isinstance(driver.hello(same_schema=False)[0].message, Capabilities)
    driver.give(Ping(0))
    driver.tick()
    driver.command()
    own = Arm(driver.limits_hash, CALIBRATION_HASH, driver.received[-1].sequence)
    assert codes(driver.give(own, same_schema=False)) == [FaultCode.ARM_SCHEMA]
    assert not driver.device.armed and driver.device.fault is FaultCode.NONE
    assert driver.give(own) == () and driver.device.armed
    driver.give(Stop(), same_schema=False)
    assert not driver.device.armed


def test_every_telemetry_marks_which_readings_are_counts():
    volts, counts = CHANNELS[0], ChannelKind(Quantity.YAW, 0, Raw.COUNTS)
    for channels, bits in (((volts,), 0), ((counts, volts, counts), 5)):
        driver = DeviceDriver()
        commissioned = DeviceConfig(3, PERIOD, channels, LIMITS, CALIBRATION_HASH)
        driver.device = Device(commissioned, lambda now, raw: ZERO, lambda: 7)
        driver.begin()
        driver.tick(ZERO[: len(channels)])
        assert driver.telemetry.counts == bits == counts_mask(channels)


def test_a_command_that_moves_is_refused_while_disarmed_and_latches_nothing():
    driver = DeviceDriver()
    driver.begin().tick()
    for currents, brake in (((0.0, 0.0, 0.5), 0), (ZERO, 4), ((math.nan, 0.0, 0.0), 0), ((9.0, 0.0, 0.0), 0)):
        (fault,) = faults(driver.command(currents, brake=brake))
        assert fault == Fault(FaultCode.NOT_ARMED, 0, 0.0, 0.0, driver.sequence, latched=False)
    assert driver.device.fault is FaultCode.NONE
    assert driver.device.refused == 4
    driver.tick()
    assert driver.telemetry.acknowledged == 0
    assert codes(driver.arm()) == [FaultCode.ARM_NOT_ZERO]


def test_a_second_host_learns_that_the_armed_device_is_busy_and_nothing_else():
    driver = DeviceDriver(start=1.0).driving()
    before = driver.device.session, driver.device.output
    (answer,) = driver.enter(driver.ask(nonce=5))
    assert answer.message == Fault(FaultCode.BUSY, 0, 0.0, 0.0, 5, latched=False)
    assert (answer.session, answer.sequence) == (0, 0)
    assert answer.time == round(driver.now * 1e6)
    assert (driver.device.session, driver.device.output) == before
    assert driver.device.refused == 1
    assert driver.command((0.5, -0.25, 0.125)) == ()


def test_frames_of_another_session_or_of_an_old_sequence_are_dropped_and_counted():
    driver = DeviceDriver().driving()
    for header in (
        {"session": 0},
        {"session": driver.session + 1},
        {"sequence": 0},
        {"sequence": driver.sequence},
        {"sequence": driver.sequence - 1},
    ):
        before = driver.device.dropped, driver.device.output
        assert driver.command((1.5, 0.0, 0.0), **header) == ()
        assert (driver.device.dropped - 1, driver.device.output) == before
    driver.tick()
    assert driver.telemetry.dropped == 5
    assert driver.device.output.currents == (0.5, -0.25, 0.125)


def test_sequences_may_leave_gaps():
    driver = DeviceDriver().driving()
    assert driver.command((0.25, 0.0, 0.0), sequence=1000) == ()
    driver.tick()
    assert driver.telemetry.acknowledged == 1000
    assert driver.device.output.currents == (0.25, 0.0, 0.0)


def test_its_own_frames_come_back_are_dropped_and_use_up_no_sequence():
    driver = DeviceDriver().driving()
    for message in (
        driver.telemetry,
        Pong(1),
        Fault(FaultCode.NONE, 0, 0.0, 0.0, 0, False),
        driver.received[0].message,
    ):
        dropped = driver.device.dropped
        assert driver.give(message, sequence=10**6) == ()
        assert driver.device.dropped == dropped + 1
    assert driver.command(ZERO) == ()
    driver.tick()
    assert driver.telemetry.acknowledged == driver.sequence


def test_broken_frames_are_counted():
    driver = DeviceDriver().driving()
    for _ in range(3):
        driver.device.on_invalid_packet(driver.now)
    driver.tick()
    assert driver.telemetry.dropped == 3
    assert driver.device.armed


def test_counts_travel_modulo_2_to_32():
    driver = DeviceDriver()
    driver.begin()
    driver.device.dropped, driver.device.refused = 2**32 + 3, 2**32 + 4
    driver.tick()
    assert (driver.telemetry.dropped, driver.telemetry.refused) == (3, 4)


@pytest.mark.parametrize("message", [Hello(3), Ping(1), Command(ZERO, 0.05), Reset(0), Arm(0, 0, 0)])
def test_with_a_key_what_is_not_authentic_is_dropped(message):
    driver = DeviceDriver(keyed=True).driving()
    session = 0 if isinstance(message, Hello) else driver.session
    assert driver.give(message, session=session, authentic=False) == ()
    assert driver.device.dropped == 1
    assert driver.device.armed
    driver.tick()
    assert driver.telemetry.acknowledged == 4


def test_with_a_key_every_frame_is_signed_and_without_one_none():
    for keyed in (True, False):
        driver = DeviceDriver(keyed=keyed).driving()
        driver.hello(nonce=5)
        driver.command((9.0, 0.0, 0.0))
        assert {f.authentic for f in driver.received} == {keyed}
        assert (Status.AUTHENTIC in driver.telemetry.status) == keyed


@pytest.mark.parametrize("keyed", [False, True])
@pytest.mark.parametrize("session", [0, 5, None])
def test_stop_is_obeyed_from_any_sender_at_once_and_as_often_as_it_comes(keyed, session):
    driver = DeviceDriver(keyed=keyed).driving((0.0, -0.25, 0.125), brake=1)
    for _ in range(3):
        header = {} if session is None else {"session": session}
        assert driver.give(Stop(), sequence=0, authentic=False, **header) == ()
        assert driver.device.output.currents == ZERO and driver.device.output.brake == 0
        assert not driver.device.armed
    assert (driver.device.dropped, driver.device.fault) == (0, FaultCode.NONE)
    assert codes(driver.command((0.5, 0.0, 0.0))) == [FaultCode.NOT_ARMED]
    driver.command()
    driver.tick()
    assert driver.telemetry.status in (Status.STOPPED, Status.STOPPED | Status.AUTHENTIC)
    assert codes(driver.arm()) == [FaultCode.ARM_STOPPED]
    assert driver.reset() == ()
    driver.give(Stop(), authentic=False)
    assert codes(driver.reset()) == [FaultCode.STALE]  # the host has not seen that stop
    driver.tick()
    assert driver.reset() == ()
    assert codes(driver.arm()) == [FaultCode.ARM_NOT_ZERO]  # the command before the stop does not count
    driver.command()
    driver.tick()
    assert driver.telemetry.status in (Status(0), Status.AUTHENTIC)
    assert driver.arm() == ()
    assert driver.device.armed


def test_stop_without_a_session_is_no_event():
    driver = DeviceDriver()
    assert driver.give(Stop()) == ()
    assert driver.device.dropped == 0


def test_stop_does_not_reset_a_fault():
    driver = DeviceDriver().driving()
    driver.command((9.0, 0.0, 0.0))
    driver.give(Stop())
    assert driver.device.fault is FaultCode.CURRENT


def test_ping_is_answered_with_its_nonce_and_the_time():
    driver = DeviceDriver(start=1.0)
    driver.begin()
    (answer,) = driver.give(Ping(42))
    assert (answer.message, answer.time, answer.session) == (Pong(42), 1_000_000, driver.session)


def test_telemetry_counts_its_own_sequence_and_carries_the_readings():
    driver = DeviceDriver()
    driver.begin()
    driver.tick((1.0, 2.0, 3.0))
    driver.tick((1.0, 2.0, -3.0))
    telemetry = [f for f in driver.received if isinstance(f.message, Telemetry)]
    assert [f.sequence for f in telemetry] == [3, 4]
    assert [f.time for f in telemetry] == [round(1e6 * PERIOD), round(2e6 * PERIOD)]
    assert telemetry[1].message.raw == (1.0, 2.0, -3.0)


def test_limits_are_those_that_travel():
    driver = DeviceDriver(limits=DeviceDriver().device.config.limits)
    assert driver.device.config.limits == LIMITS
    with pytest.raises(InputError, match="at least one is needed"):
        Device(DeviceConfig(0, PERIOD, (), LIMITS, 0), lambda now, raw: (), lambda: 1)
    with pytest.raises(InputError, match=r"limits\.current"):
        DeviceDriver(limits=type(LIMITS)(0.0, *[1.0] * 6))


def test_a_device_may_have_a_single_wheel():
    device = Device(DeviceConfig(1, PERIOD, CHANNELS[:1], LIMITS, 0), lambda now, raw: tuple(raw), lambda: 1)
    assert device.output.currents == (0.0,)


def test_in_lock_step_a_frame_without_a_sequence_is_no_repeat():
    driver = DeviceDriver(lock_step=True)
    driver.begin()
    assert driver.command(sequence=0) == ()
    assert driver.device.dropped == 1
