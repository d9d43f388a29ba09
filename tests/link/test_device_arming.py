"""Who may arm the device, and when; sessions, sequences and keys."""

import math
from typing import Any

import pytest
from device_bench import CALIBRATION_HASH, CHANNELS, LIMITS, PERIOD, ZERO, Bench, codes, faults

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
    ResetFault,
    Status,
    Stop,
    Telemetry,
    counts_mask,
)
from omnimj.link.device.config import DeviceConfig
from omnimj.link.device.limits import MAX_TELEMETRY_AGE, check_arming, is_zero_command
from omnimj.link.device.state_machine import Device


def test_a_device_without_a_session_says_nothing_and_moves_nothing():
    bench = Bench()
    assert bench.tick(periods=3) == ()
    assert bench.command() == bench.arm() == bench.give(Ping(1)) == ()
    assert bench.device.dropped == 3
    assert bench.device.output.currents == ZERO
    assert bench.device.session == 0
    bench.hello()
    assert bench.device.dropped == 3
    bench.tick()
    assert (bench.telemetry.acknowledged, bench.telemetry.command_age) == (0, math.inf)


def test_hello_is_answered_by_what_the_device_is_under_a_fresh_session():
    bench = Bench(start=2.5)
    (answer,) = bench.hello(nonce=99)
    told = answer.message
    assert (answer.session, answer.sequence, answer.time) == (1001, 1, 2_500_000)
    facts = (99, PERIOD, False, 3, CHANNELS, LIMITS, bench.limits_hash, CALIBRATION_HASH)
    assert told == Capabilities(*facts)
    bench.give(Ping(1))
    (answer,) = bench.hello(nonce=100)
    assert answer.session == 1002


def test_a_hello_that_is_repeated_because_its_answer_was_lost_gets_the_same_session():
    bench = Bench()
    first, second = bench.hello(), bench.hello()
    assert first[0].session == second[0].session == 1001
    assert second[0].sequence == 2
    assert bench.hello(nonce=8)[0].session == 1002
    bench.give(Ping(1))
    assert bench.hello(nonce=8)[0].session == 1003  # it has been used


def test_a_session_is_never_zero_nor_the_one_before_and_has_32_bits():
    bench = Bench(sessions=[0, 1, 2**32 + 5, 2**32 - 1, 2**32 - 1, 7])
    assert [bench.hello(nonce=n)[0].session for n in range(1, 7)] == [1, 2, 5, 2**32 - 1, 1, 7]


def test_the_very_first_hello_begins_a_session_whatever_its_nonce():
    assert Bench().hello(nonce=0)[0].session == 1001


def test_arming_takes_a_zero_command_and_fresh_telemetry():
    bench = Bench()
    bench.hello()
    bench.tick()
    assert bench.command() == ()
    assert bench.arm() == ()
    assert bench.device.armed
    bench.tick()
    assert bench.telemetry.status == Status.ARMED
    assert (bench.telemetry.acknowledged, bench.telemetry.command_age) == (1, PERIOD)


def test_without_any_command_the_device_is_not_armed():
    bench = Bench()
    bench.hello()
    bench.tick()
    assert codes(bench.arm()) == [FaultCode.ARM_NOT_ZERO]
    assert not bench.device.armed
    assert bench.device.refused == 1
    assert bench.device.fault is FaultCode.NONE  # nothing is latched


def test_a_zero_command_that_is_no_longer_valid_does_not_arm():
    for waited, expected in ((64, []), (65, [FaultCode.ARM_NOT_ZERO])):
        bench = Bench()
        bench.hello()
        bench.command(valid_for=0.0625)
        bench.tick(periods=waited)
        assert codes(bench.arm()) == expected
        assert bench.device.armed == (not expected)


def test_a_command_of_the_session_before_does_not_arm_this_one():
    bench = Bench()
    bench.hello()
    bench.command()
    bench.hello(nonce=8)
    bench.tick()
    assert codes(bench.arm()) == [FaultCode.ARM_NOT_ZERO]


def test_telemetry_of_the_session_before_does_not_arm_this_one():
    bench = Bench()
    bench.hello()
    bench.tick(periods=3)
    bench.hello(nonce=8)
    bench.command()
    assert codes(bench.arm(telemetry=3)) == [FaultCode.ARM_STALE_TELEMETRY]


def test_telemetry_that_the_host_names_may_be_20_ms_old_and_must_have_been_sent():
    for periods, expected in ((20, []), (21, [FaultCode.ARM_STALE_TELEMETRY])):
        bench = Bench()
        bench.hello()
        bench.tick()
        seen = bench.said[-1].sequence
        bench.tick(periods=periods)
        bench.command()
        answer = bench.arm(telemetry=seen)
        assert codes(answer) == expected
        assert [f.value for f in faults(answer)] == [21 * PERIOD for _ in expected]
    for unknown in (0, 1, 99):  # 1 was the capabilities
        bench = Bench()
        bench.hello()
        bench.tick()
        bench.command()
        assert codes(bench.arm(telemetry=unknown)) == [FaultCode.ARM_STALE_TELEMETRY]
        assert faults(bench.said)[0].value == math.inf


def test_hashes_must_agree():
    bench = Bench()
    bench.hello()
    bench.tick()
    bench.command()
    assert codes(bench.arm(limits_hash=bench.limits_hash ^ 1)) == [FaultCode.ARM_LIMITS]
    assert codes(bench.arm(calibration_hash=CALIBRATION_HASH ^ 1)) == [FaultCode.ARM_CALIBRATION]
    assert not bench.device.armed
    assert bench.device.refused == 2
    assert bench.arm() == ()
    assert bench.device.armed


GOOD = (Arm(1, 2, 5), True, FaultCode.NONE, (1, 2), Command(ZERO, 0.05), 0.05, 0.02)


def test_reasons_against_arming_come_in_their_order_and_name_what_was_found():
    arm, same, fault, hashes, command, age, _ = GOOD
    assert check_arming(*GOOD) is None
    bad = Command((0.0, 0.0, 1e-30), 0.05)

    def refusal(*given):
        found: Any = check_arming(*given)
        return found.code, found.wheel, found.value, found.limit

    late = math.nextafter(MAX_TELEMETRY_AGE, 1.0)
    hot = FaultCode.HEATING
    assert refusal(arm, False, hot, (9, 9), bad, age, late) == (FaultCode.ARM_SCHEMA, 0, 0.0, 0.0)
    assert refusal(arm, same, hot, (9, 9), bad, age, late) == (FaultCode.ARM_FAULTY, 0, 5.0, 0.0)
    assert refusal(arm, same, fault, (9, 9), bad, age, late) == (FaultCode.ARM_LIMITS, 0, 0.0, 0.0)
    assert refusal(arm, same, fault, (1, 9), bad, age, late) == (FaultCode.ARM_CALIBRATION, 0, 0.0, 0.0)
    assert refusal(arm, same, fault, hashes, bad, age, late) == (FaultCode.ARM_NOT_ZERO, 0, 0.05, 0.05)
    old = math.nextafter(0.05, 1.0)
    assert refusal(arm, same, fault, hashes, command, old, late) == (FaultCode.ARM_NOT_ZERO, 0, old, 0.05)
    assert refusal(arm, same, fault, hashes, command, age, late) == (
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


def test_who_lays_out_messages_otherwise_may_ask_and_stop_but_never_arms():
    bench = Bench()
    assert isinstance(bench.hello(same_schema=False)[0].message, Capabilities)
    bench.tick()
    bench.command()
    own = Arm(bench.limits_hash, CALIBRATION_HASH, bench.said[-1].sequence)
    assert codes(bench.give(own, same_schema=False)) == [FaultCode.ARM_SCHEMA]
    assert not bench.device.armed and bench.device.fault is FaultCode.NONE
    assert bench.give(own) == () and bench.device.armed
    bench.give(Stop(), same_schema=False)
    assert not bench.device.armed


def test_every_telemetry_says_which_readings_are_counts():
    volts, counts = CHANNELS[0], ChannelKind(Quantity.YAW, 0, Raw.COUNTS)
    for channels, bits in (((volts,), 0), ((counts, volts, counts), 5)):
        bench = Bench()
        commissioned = DeviceConfig(3, PERIOD, channels, LIMITS, CALIBRATION_HASH)
        bench.device = Device(commissioned, lambda now, raw: ZERO, lambda: 7)
        bench.hello()
        bench.tick(ZERO[: len(channels)])
        assert bench.telemetry.counts == bits == counts_mask(channels)


def test_a_command_that_moves_is_refused_while_disarmed_and_latches_nothing():
    bench = Bench()
    bench.hello()
    for currents, brake in (((0.0, 0.0, 0.5), 0), (ZERO, 4), ((math.nan, 0.0, 0.0), 0), ((9.0, 0.0, 0.0), 0)):
        (fault,) = faults(bench.command(currents, brake=brake))
        assert fault == Fault(FaultCode.NOT_ARMED, 0, 0.0, 0.0, bench.sequence, latched=False)
    assert bench.device.fault is FaultCode.NONE
    assert bench.device.refused == 4
    bench.tick()
    assert bench.telemetry.acknowledged == 0
    assert codes(bench.arm()) == [FaultCode.ARM_NOT_ZERO]


def test_a_second_host_is_told_that_the_armed_device_is_busy_and_nothing_else():
    bench = Bench(start=1.0).driving()
    before = bench.device.session, bench.device.output
    (answer,) = bench.hello(nonce=5)
    assert answer.message == Fault(FaultCode.BUSY, 0, 0.0, 0.0, 0, latched=False)
    assert (answer.session, answer.sequence) == (0, 0)
    assert answer.time == round(bench.now * 1e6)
    assert (bench.device.session, bench.device.output) == before
    assert bench.device.refused == 1
    assert bench.command((0.5, -0.25, 0.125)) == ()


def test_frames_of_another_session_or_of_an_old_sequence_are_dropped_and_counted():
    bench = Bench().driving()
    for header in (
        {"session": 0},
        {"session": bench.session + 1},
        {"sequence": 0},
        {"sequence": bench.sequence},
        {"sequence": bench.sequence - 1},
    ):
        before = bench.device.dropped, bench.device.output
        assert bench.command((1.5, 0.0, 0.0), **header) == ()
        assert (bench.device.dropped - 1, bench.device.output) == before
    bench.tick()
    assert bench.telemetry.dropped == 5
    assert bench.device.output.currents == (0.5, -0.25, 0.125)


def test_sequences_may_leave_gaps():
    bench = Bench().driving()
    assert bench.command((0.25, 0.0, 0.0), sequence=1000) == ()
    bench.tick()
    assert bench.telemetry.acknowledged == 1000
    assert bench.device.output.currents == (0.25, 0.0, 0.0)


def test_its_own_words_come_back_are_dropped_and_use_up_no_sequence():
    bench = Bench().driving()
    for message in (
        bench.telemetry,
        Pong(1),
        Fault(FaultCode.NONE, 0, 0.0, 0.0, 0, False),
        bench.said[0].message,
    ):
        dropped = bench.device.dropped
        assert bench.give(message, sequence=10**6) == ()
        assert bench.device.dropped == dropped + 1
    assert bench.command(ZERO) == ()
    bench.tick()
    assert bench.telemetry.acknowledged == bench.sequence


def test_broken_frames_are_counted():
    bench = Bench().driving()
    for _ in range(3):
        bench.device.on_invalid_packet(bench.now)
    bench.tick()
    assert bench.telemetry.dropped == 3
    assert bench.device.armed


def test_counts_travel_modulo_2_to_32():
    bench = Bench()
    bench.hello()
    bench.device.dropped, bench.device.refused = 2**32 + 3, 2**32 + 4
    bench.tick()
    assert (bench.telemetry.dropped, bench.telemetry.refused) == (3, 4)


@pytest.mark.parametrize("message", [Hello(3), Ping(1), Command(ZERO, 0.05), ResetFault(), Arm(0, 0, 0)])
def test_with_a_key_what_is_not_authentic_is_dropped(message):
    bench = Bench(keyed=True).driving()
    session = 0 if isinstance(message, Hello) else bench.session
    assert bench.give(message, session=session, authentic=False) == ()
    assert bench.device.dropped == 1
    assert bench.device.armed
    bench.tick()
    assert bench.telemetry.acknowledged == 3


def test_with_a_key_everything_that_is_said_is_signed_and_without_one_nothing():
    for keyed in (True, False):
        bench = Bench(keyed=keyed).driving()
        bench.hello(nonce=5)
        bench.command((9.0, 0.0, 0.0))
        assert {f.authentic for f in bench.said} == {keyed}
        assert (Status.AUTHENTIC in bench.telemetry.status) == keyed


@pytest.mark.parametrize("keyed", [False, True])
@pytest.mark.parametrize("session", [0, 5, None])
def test_stop_is_obeyed_from_anybody_at_once_and_as_often_as_it_comes(keyed, session):
    bench = Bench(keyed=keyed).driving(brake=1)
    for _ in range(3):
        header = {} if session is None else {"session": session}
        assert bench.give(Stop(), sequence=0, authentic=False, **header) == ()
        assert bench.device.output.currents == ZERO and bench.device.output.brake == 0
        assert not bench.device.armed
    assert (bench.device.dropped, bench.device.fault) == (0, FaultCode.NONE)
    assert codes(bench.command((0.5, 0.0, 0.0))) == [FaultCode.NOT_ARMED]
    assert codes(bench.arm()) == [FaultCode.ARM_NOT_ZERO]  # the command before the stop does not count
    bench.command()
    bench.tick()
    assert bench.telemetry.status in (Status(0), Status.AUTHENTIC)
    assert bench.arm() == ()
    assert bench.device.armed


def test_stop_without_a_session_is_no_event():
    bench = Bench()
    assert bench.give(Stop()) == ()
    assert bench.device.dropped == 0


def test_stop_does_not_reset_a_fault():
    bench = Bench().driving()
    bench.command((9.0, 0.0, 0.0))
    bench.give(Stop())
    assert bench.device.fault is FaultCode.CURRENT


def test_ping_is_answered_with_its_nonce_and_the_time():
    bench = Bench(start=1.0)
    bench.hello()
    (answer,) = bench.give(Ping(42))
    assert (answer.message, answer.time, answer.session) == (Pong(42), 1_000_000, bench.session)


def test_telemetry_counts_its_own_sequence_and_carries_the_readings():
    bench = Bench()
    bench.hello()
    bench.tick((1.0, 2.0, 3.0))
    bench.tick((1.0, 2.0, -3.0))
    told = [f for f in bench.said if isinstance(f.message, Telemetry)]
    assert [f.sequence for f in told] == [2, 3]
    assert [f.time for f in told] == [round(1e6 * PERIOD), round(2e6 * PERIOD)]
    assert told[1].message.raw == (1.0, 2.0, -3.0)


def test_limits_are_those_that_travel():
    bench = Bench(limits=Bench().device.commissioned.limits)
    assert bench.device.commissioned.limits == LIMITS
    with pytest.raises(InputError, match="at least one is needed"):
        Device(DeviceConfig(0, PERIOD, (), LIMITS, 0), lambda now, raw: (), lambda: 1)
    with pytest.raises(InputError, match=r"limits\.current"):
        Bench(limits=type(LIMITS)(0.0, *[1.0] * 6))


def test_a_device_may_have_a_single_wheel():
    device = Device(DeviceConfig(1, PERIOD, CHANNELS[:1], LIMITS, 0), lambda now, raw: tuple(raw), lambda: 1)
    assert device.output.currents == (0.0,)


def test_in_lock_step_a_frame_without_a_sequence_is_no_repeat():
    bench = Bench(lock_step=True)
    bench.hello()
    assert bench.command(sequence=0) == ()
    assert bench.device.dropped == 1
