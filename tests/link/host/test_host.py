"""The host's rules that end in stop, dense around every boundary; and nothing moves again unasked."""

import dataclasses
import itertools
import math
from typing import Any

import pytest
from device_driver import CALIBRATION_HASH, CHANNELS, IDENTITY, LIMITS, PERIOD, ZERO

from omnimj.errors import LinkLost, OmnimjError
from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    Challenge,
    ChannelKind,
    Command,
    Fault,
    FaultCode,
    Frame,
    Hello,
    Ping,
    Pong,
    Quantity,
    Raw,
    Reset,
    Status,
    Stop,
    Telemetry,
)
from omnimj.link.device.config import DeviceConfig, limits_hash
from omnimj.link.device.state_machine import Device
from omnimj.link.host.state_machine import Host, HostState, format_fault
from omnimj.link.quality import ClockOffset, LossCounter

EXPECTED = DeviceConfig(3, PERIOD, CHANNELS, LIMITS, CALIBRATION_HASH)
OWN = limits_hash(LIMITS)
SESSION = 77
IDLE = Status(0)


def after(x):
    return math.nextafter(x, math.inf)


class Other:
    """Plays the device: sends any message that the test needs."""

    def __init__(self, connected=True, **expected):
        nonces = itertools.count(1)
        self.host: Any = Host(dataclasses.replace(EXPECTED, **expected), lambda: next(nonces))
        self.sequence, self.session = 0, SESSION
        self.keyed = self.host.expected.keyed
        if connected:
            self.ask()
            assert self.capabilities() == ()
            assert self.host.state is HostState.CONNECTED

    def ask(self, device=IDENTITY):
        """The host's hello and what it answers to the challenge."""
        self.nonce = self.host.hello(0.0).message.nonce
        return self.challenge(device)

    def challenge(self, device=IDENTITY, cookie=99, **changed):
        found = Challenge(self.nonce, cookie, device)
        self.sequence -= 1  # outside of the session
        return self.say(dataclasses.replace(found, **changed), session=0, sequence=0)

    def say(self, message, now=0.0, time=None, arrived=None, **header):
        self.sequence += 1
        facts = {"session": self.session, "sequence": self.sequence, "authentic": self.keyed}
        at = round(1e6 * now) if time is None else time
        return self.host.on_frame(now, Frame(message, time=at, **{**facts, **header}), arrived)

    def capabilities(self, now=0.0, session=SESSION, **changed):
        e = self.host.expected
        found = Capabilities(
            self.nonce, e.period, e.lock_step, 3, e.channels, e.limits, OWN, e.calibration_hash
        )
        self.session = session
        return self.say(dataclasses.replace(found, **changed), now)

    def telemetry(self, now=0.0, status=IDLE, acknowledged=0, fault: Any = FaultCode.NONE, **header):
        age = 0.0 if acknowledged else math.inf
        return self.say(Telemetry(acknowledged, age, status, fault, 0, 0, ZERO), now, **header)

    def armed(self, now=0.0):
        self.telemetry(now)
        self.host.arm(now)
        assert self.host.state is HostState.ARMING
        assert self.telemetry(now, Status.ARMED) == ()
        assert self.host.state is HostState.ARMED
        return self


def expect_stopped(host, frames, reason):
    """Three stops, the reason, and nothing more without hello."""
    assert [f.message for f in frames] == [Stop()] * 3
    assert len({f.sequence for f in frames}) == 1 and frames[0].session == host.session
    assert host.state is HostState.STOPPED
    assert host.reason == reason
    for ask in (host.arm, host.ping, host.reset, lambda now: host.command(now, ZERO)):
        with pytest.raises(LinkLost) as lost:
            ask(1.0)
        assert str(lost.value) == reason
    with pytest.raises(LinkLost):
        host.require_link()
    assert host.check(1e9) == ()  # told once
    assert host.state is HostState.STOPPED


def test_link_lost_is_an_omnimj_error_and_a_connection_error():
    assert issubclass(LinkLost, OmnimjError) and issubclass(LinkLost, ConnectionError)


def test_hello_is_the_same_question_until_it_is_answered():
    other = Other(connected=False)
    host = other.host
    assert host.state is HostState.IDLE
    first, second = host.hello(1.5), host.hello(2.0)
    assert first.message == second.message == Hello(1)
    assert (first.session, first.sequence, first.time, second.sequence) == (0, 1, 1_500_000, 2)
    other.nonce = 1
    (answer,) = other.challenge()
    assert answer.message == host.hello(2.5).message == Hello(1, 99, IDENTITY)
    other.capabilities()
    assert host.hello(3.0).message == Hello(2)
    assert host.state is HostState.ASKING
    assert host.session == 0


def test_a_device_that_lays_out_its_messages_otherwise_is_not_the_one_that_was_expected():
    other = Other(connected=False)
    other.ask()
    e = other.host.expected
    found = Capabilities(other.nonce, e.period, False, 3, e.channels, e.limits, OWN, e.calibration_hash)
    frames = other.say(found, same_schema=False)
    words = "its messages have another layout (schema)"
    expect_stopped(other.host, frames, f"this is not the device that was expected: {words}")


@pytest.mark.parametrize(("raw", "counts"), [(ZERO, 1), (ZERO, 7), (ZERO[:2], 0), ((*ZERO, 0.0), 0)])
def test_telemetry_with_other_channels_than_the_capabilities_ends_the_link(raw, counts):
    for armed in (False, True):
        other = Other().armed() if armed else Other()
        before = other.host.reading
        telemetry = Telemetry(0, math.inf, Status.ARMED, FaultCode.NONE, 0, 0, raw, counts)
        frames = other.say(telemetry)
        expect_stopped(other.host, frames, "its telemetry has other channels than its capabilities")
        assert other.host.reading is before
        assert other.say(telemetry) == () and other.host.dropped == 2


def test_before_there_is_a_session_no_request_is_allowed():
    host = Other(connected=False).host
    assert (host.session, host.fault) == (0, None)
    for _ in range(2):
        for ask in (host.arm, host.ping, host.reset, lambda now: host.command(now, ZERO)):
            with pytest.raises(LinkLost, match="there is no session"):
                ask(0.0)
        host.hello(0.0)
    host.require_link()


def test_frames_carry_the_session_and_rise():
    other = Other()
    host = other.host
    other.telemetry()
    frames = [host.ping(0.5), host.command(0.5, ZERO), host.reset(0.5)]
    assert [f.sequence for f in frames] == [1, 2, 3]
    assert {f.session for f in frames} == {SESSION}
    assert {f.time for f in frames} == {500_000}
    assert [f.authentic for f in frames] == [False] * 3
    assert frames[1].message == Command(ZERO, 0.05, 0, other.sequence)
    assert frames[2].message == Reset(other.sequence)
    other.telemetry()
    assert host.arm(0.0).message == Arm(OWN, CALIBRATION_HASH, other.sequence)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"wheels": 4}, "it has 4 wheels, the model 3"),
        ({"lock_step": True}, "it runs in lock-step, expected is real time"),
        ({"period": 0.5}, "its period is 0.5 s, the model's 0.000976562 s"),
        (
            {"channels": CHANNELS[:2]},
            "it has no channel 2, the model has wheel_speed of wheel 3 in volts there",
        ),
        (
            {"channels": (CHANNELS[0], ChannelKind(Quantity.YAW, 0, Raw.COUNTS), CHANNELS[2])},
            "channel 1 is yaw in counts, the model has wheel_speed of wheel 2 in volts there",
        ),
        (
            {"limits": dataclasses.replace(LIMITS, heating=9.0)},
            "its limit heating is 9, the model's 1.75",
        ),
        ({"limits_hash": OWN + 1}, "its limits have another hash"),
        ({"calibration_hash": 5}, "it was commissioned with another calibration"),
        ({"session": 0}, "it gives no session"),
    ],
)
def test_another_device_than_expected_is_named_in_the_error(changed, words):
    other = Other(connected=False)
    other.ask()
    answer = other.capabilities(**changed)
    expect_stopped(other.host, answer, f"this is not the device that was expected: {words}")


def test_a_real_time_device_is_not_taken_for_one_in_lock_step():
    other = Other(connected=False, lock_step=True)
    other.ask()
    other.capabilities(lock_step=False)
    assert other.host.reason.endswith("it runs in real time, expected is lock-step")


def test_a_device_may_have_more_channels_and_anything_where_the_host_uses_none():
    unused = ChannelKind(Quantity.OTHER, 0, Raw.VOLTS)
    other = Other(connected=False, channels=(*CHANNELS, unused, unused))
    other.ask()
    supply = ChannelKind(Quantity.SUPPLY, 0, Raw.COUNTS)
    assert other.capabilities(channels=(*CHANNELS, supply)) == ()
    assert other.host.state is HostState.CONNECTED
    assert Other(period=0.001).host.state is HostState.CONNECTED  # which float32 does not hold exactly


def test_only_the_answer_to_the_own_hello_counts():
    other = Other(connected=False)
    other.nonce = 1
    assert other.capabilities() == ()
    assert other.host.state is HostState.IDLE
    other.ask()
    assert other.capabilities(nonce=2) == ()
    assert other.host.state is HostState.ASKING
    assert other.host.dropped == 2
    assert other.capabilities() == ()
    assert other.host.state is HostState.CONNECTED


def test_the_same_answer_again_is_no_restart():
    other = Other().armed()
    assert other.capabilities() == ()
    assert other.host.state is HostState.ARMED
    assert other.host.arrivals.newest == other.sequence


@pytest.mark.parametrize("changed", [{"session": SESSION + 1}, {"period": 0.5}])
@pytest.mark.parametrize("armed", [False, True])
def test_another_session_or_other_capabilities_mean_that_the_device_has_restarted(changed, armed):
    other = Other()
    if armed:
        other.armed()
    answer = other.capabilities(**changed)
    other.session = SESSION
    expect_stopped(other.host, answer, "the device has begun another session: it has restarted")


def test_a_stopped_host_takes_no_capabilities():
    other = Other()
    other.host.stop(0.0)
    assert other.capabilities(session=99) == ()
    assert other.host.session == SESSION
    assert other.host.dropped == 1


def test_busy_ends_only_the_request_whose_nonce_it_carries():
    other = Other(connected=False)
    nonce = other.host.hello(0.0).message.nonce
    busy = Fault(FaultCode.BUSY, 0, 0.0, 0.0, nonce & 0xFFFFFFFF, False)
    assert other.say(dataclasses.replace(busy, sequence=busy.sequence ^ 1), session=0) == ()
    assert (other.host.state, other.host.dropped) == (HostState.ASKING, 1)
    answer = other.say(busy, session=0)
    expect_stopped(other.host, answer, "another host has the armed device")


def test_busy_without_a_request_is_dropped():
    busy = Fault(FaultCode.BUSY, 0, 0.0, 0.0, 0, False)
    other = Other(connected=False)
    assert other.say(busy, session=0) == ()
    assert (other.host.state, other.host.dropped) == (HostState.IDLE, 1)
    other = Other().armed()
    assert other.say(busy, session=0) == ()
    assert (other.host.state, other.host.dropped) == (HostState.ARMED, 1)


def test_arming_takes_telemetry_and_is_done_when_the_device_confirms_it():
    other = Other()
    host = other.host
    with pytest.raises(LinkLost, match="there is no telemetry yet"):
        host.arm(0.0)
    assert host.state is HostState.CONNECTED
    other.telemetry()
    host.arm(0.0)
    other.telemetry()
    assert host.state is HostState.ARMING
    host.arm(0.0)
    other.telemetry(status=Status.ARMED)
    assert host.state is HostState.ARMED
    host.arm(0.0)
    assert host.state is HostState.ARMED


def test_a_device_that_is_armed_without_a_request_is_not_believed():
    other = Other()
    answer = other.telemetry(status=Status.ARMED)
    expect_stopped(other.host, answer, "it is armed without a request")


def test_an_acknowledgement_of_what_was_not_sent_is_not_believed():
    other = Other().armed()
    sent = other.host.command(0.0, ZERO).sequence
    other.host.ping(0.0)
    assert other.telemetry(0.0, Status.ARMED, acknowledged=sent) == ()
    answer = other.telemetry(0.0, Status.ARMED, acknowledged=sent + 1)
    expect_stopped(other.host, answer, "it acknowledges a command that was not sent")


def test_time_that_runs_backwards_is_not_believed():
    other = Other().armed()
    assert other.telemetry(0.01, Status.ARMED, time=10_000) == ()
    assert other.telemetry(0.011, Status.ARMED, time=10_000) == ()
    answer = other.telemetry(0.012, Status.ARMED, time=9_999)
    expect_stopped(other.host, answer, "its time runs backwards")


def test_another_device_than_the_one_met_before_or_the_models_is_refused_with_both_identities():
    other = Other()
    other.host.stop(0.0)
    answer = other.ask(device=IDENTITY + 1)
    words = f"another device answers: {IDENTITY + 1:016x} instead of {IDENTITY:016x}"
    expect_stopped(other.host, answer, words)
    other = Other(connected=False, identity=7)
    words = f"another device answers: {IDENTITY:016x} instead of {7:016x}"
    expect_stopped(other.host, other.ask(), words)


def test_a_challenge_to_another_nonce_or_without_a_request_is_dropped():
    other = Other(connected=False)
    other.nonce = 1
    assert other.challenge() == () and other.host.dropped == 1
    other.host.hello(0.0)
    assert other.challenge(nonce=5) == () and other.host.dropped == 2
    other = Other()
    assert other.challenge() == () and other.host.state is HostState.CONNECTED


def test_two_refusals_within_a_second_are_borne_and_three_end_the_run():
    stale = Fault(FaultCode.STALE, 0, 0.06, 0.05, 9, False)
    other = Other().armed()
    for now in (0.0, 0.5, 1.25, 1.75, 2.5):
        assert other.say(stale, now) == ()
    assert other.host.state is HostState.ARMED and other.host.fault == stale
    answer = other.say(stale, 2.6)
    expect_stopped(other.host, answer, "the device reports: stale (0.06, limit 0.05)")
    other = Other(lock_step=True).armed()
    assert other.say(stale) != ()  # nothing is late in lock-step


def test_a_command_names_the_newest_telemetry_and_a_reset_too():
    other = Other()
    assert other.host.command(0.0, ZERO).message.telemetry == 0
    with pytest.raises(LinkLost, match="no telemetry yet"):
        other.host.reset(0.0)
    other.telemetry()
    assert other.host.command(0.0, ZERO).message.telemetry == other.sequence
    assert other.host.reset(0.0).message == Reset(other.sequence)


def test_while_not_armed_only_zero_may_be_commanded():
    other = Other()
    other.telemetry()
    for _ in range(2):
        for currents, brake in (((0.0, 0.0, 5e-324), 0), (ZERO, 1), ((math.nan, 0.0, 0.0), 0)):
            with pytest.raises(LinkLost, match="the device is not armed"):
                other.host.command(0.0, currents, brake)
        assert other.host.command(0.0, (0.0, -0.0, 0.0)).message.valid_for == 0.05
        other.host.arm(0.0)
    other.telemetry(status=Status.ARMED)
    frame = other.host.command(0.0, [0.5, 0.25, 0.0], 2, 0.125)
    assert frame.message == Command((0.5, 0.25, 0.0), 0.125, 2, other.sequence)


def test_no_hello_while_the_device_is_driven():
    other = Other()
    other.telemetry()
    other.host.arm(0.0)
    for _ in range(2):
        with pytest.raises(LinkLost, match="stop first"):
            other.host.hello(0.0)
        other.telemetry(status=Status.ARMED)
    assert other.host.session == SESSION


# --- the rules that end in stop


def test_the_age_of_telemetry_is_reported_in_milliseconds():
    other = Other().armed()
    other.host.check(5.0)
    assert other.host.reason == "the newest telemetry is 5000.0 ms old"
    other = Other().armed(1.0)
    other.host.command(1.0, ZERO)
    other.telemetry(4.0, Status.ARMED)
    other.host.check(4.0)
    assert other.host.reason == "a command has not been acknowledged for 3000.0 ms"


@pytest.mark.parametrize("state", ["arming", "armed"])
def test_telemetry_may_be_20_ms_old_and_not_one_number_older(state):
    other = Other().armed()
    if state == "arming":
        other = Other()
        other.telemetry()
        other.host.arm(0.0)
    assert other.host.check(0.0) == other.host.check(0.02) == ()
    answer = other.host.check(after(0.02))
    expect_stopped(other.host, answer, "the newest telemetry is 20.0 ms old")


def test_age_is_counted_from_the_sample_once_the_clocks_are_known():
    other = Other()
    host = other.host
    nonce = host.ping(0.0).message.nonce
    other.say(Pong(nonce), now=0.0, time=5_000_000)  # the device's clock is 5 s ahead
    other.telemetry(0.015625, time=5_000_000)
    assert (host.reading.sampled, host.reading.arrived) == (0.0, 0.015625)
    host.arm(0.015625)
    assert host.check(0.02) == ()
    assert host.check(after(0.02)) != ()


def test_telemetry_that_comes_more_than_20_ms_late_is_not_used():
    other = Other()
    host = other.host
    other.say(Pong(host.ping(0.0).message.nonce), now=0.0, time=0)
    assert other.telemetry(0.02, time=0) == ()
    assert host.reading.sequence == other.sequence and host.dropped == 0
    assert other.telemetry(after(0.02), time=0) == ()
    assert host.reading.sequence == other.sequence - 1 and host.dropped == 1


def test_telemetry_ages_in_the_queue_of_a_busy_host():
    """Telemetry that has waited for a second is not used, whether or not the clocks are known."""
    for known in (False, True):
        other = Other()
        host = other.host
        if known:
            other.say(Pong(host.ping(0.0).message.nonce), now=0.0, time=0)
        other.telemetry(1.0, time=0 if known else 1_000_000, arrived=0.0)
        assert host.reading is None and host.dropped == 1
        other.telemetry(1.0, time=1_000_000, arrived=0.984375)
        assert (host.reading.sampled, host.reading.arrived) == (0.984375, 0.984375)
        host.arm(1.0)
        assert host.check(1.004) == ()
        assert host.check(1.005) != ()


def test_the_way_of_a_ping_ends_at_the_socket():
    other = Other()
    host = other.host
    other.say(Pong(host.ping(1.0).message.nonce), now=3.0, time=5_000_000, arrived=1.25)
    assert (host.clock.round_trip, host.clock.offset) == (0.25, 5.0 - 1.125)


def test_a_sample_is_never_from_the_future():
    other = Other()
    other.say(Pong(other.host.ping(0.0).message.nonce), now=0.0, time=0)
    other.telemetry(1.0, time=1_500_000)
    assert other.host.reading.sampled == 1.0


def test_four_of_the_last_20_frames_may_be_lost_and_not_five():
    other = Other().armed()
    other.sequence += 4
    other.telemetry(status=Status.ARMED)
    assert other.host.arrivals.lost == 4
    assert other.host.check(0.0) == ()
    other.sequence += 1
    other.telemetry(status=Status.ARMED)
    expect_stopped(other.host, other.host.check(0.0), "5 of the last 20 frames were lost")


def test_losses_no_longer_count_after_20_frames():
    other = Other().armed()
    for _ in range(5):
        other.sequence += 1
        for _ in range(4):
            other.telemetry(status=Status.ARMED)
        assert other.host.check(0.0) == ()
    assert other.host.arrivals.lost == 4


def test_a_command_may_wait_40_ms_for_its_acknowledgement_and_not_one_number_longer():
    other = Other().armed()
    host = other.host
    sent = host.command(0.0, ZERO).sequence
    host.command(0.01, ZERO)
    for now in (0.015, 0.03, 0.04):
        other.telemetry(now, Status.ARMED, acknowledged=sent - 1)
        assert host.check(now) == ()
    answer = host.check(after(0.04))
    expect_stopped(host, answer, "a command has not been acknowledged for 40.0 ms")


def test_an_acknowledgement_is_good_for_all_commands_before_it():
    other = Other().armed()
    host = other.host
    host.command(0.0, ZERO)
    second = host.command(0.02, ZERO).sequence
    third = host.command(0.03, ZERO).sequence
    other.telemetry(0.05, Status.ARMED, acknowledged=second)
    assert host.check(0.065) == ()
    other.telemetry(0.0701, Status.ARMED, acknowledged=second)
    assert host.check(0.0701) != ()
    assert third == second + 1


def test_before_the_device_is_armed_commands_may_wait():
    other = Other()
    other.host.command(0.0, ZERO)
    other.telemetry(0.1)
    other.host.arm(0.1)
    assert other.host.check(0.1) == ()


def test_without_motion_a_link_of_any_quality_is_accepted():
    other = Other()
    assert other.host.check(9.0) == ()
    other.telemetry(0.0)
    other.sequence += 30
    other.telemetry(0.0)
    assert other.host.check(9.0) == ()
    assert other.host.state is HostState.CONNECTED


def test_in_lock_step_time_does_not_count_nor_do_losses():
    other = Other(lock_step=True).armed()
    other.sequence += 30
    other.say(Pong(other.host.ping(0.0).message.nonce), now=0.0, time=0)
    other.telemetry(99.0, Status.ARMED, time=0)
    assert other.host.reading.arrived == 99.0
    other.host.command(0.0, ZERO)
    assert other.host.check(1e6) == ()
    assert other.host.state is HostState.ARMED


@pytest.mark.parametrize("armed", [False, True])
def test_a_fault_of_the_device_ends_in_stop(armed):
    fault = Fault(FaultCode.CURRENT_RATE, 2, 1.25, 1.0, 9, True)
    other = Other().armed() if armed else Other()
    if not armed:
        other.telemetry()
        other.host.arm(0.0)
    answer = other.say(fault)
    expect_stopped(other.host, answer, "the device reports: current rate at wheel 2 (1.25, limit 1)")
    assert other.host.fault == fault


def test_a_fault_is_reported_with_its_description():
    assert (
        format_fault(Fault(FaultCode.ARM_LIMITS, 0, 0.0, 0.0, 1, False))
        == "the device reports: arm limits (0, limit 0)"
    )
    assert (
        format_fault(Fault(FaultCode.SENSOR, 3, math.nan, 4.0, 0, True))
        == "the device reports: sensor at wheel 3"
    )


def test_a_fault_before_arming_is_kept_and_a_fault_in_the_telemetry_can_be_reset():
    other = Other()
    fault = Fault(FaultCode.NOT_ARMED, 0, 0.0, 0.0, 3, False)
    assert other.say(fault) == ()
    assert other.host.fault == fault
    assert other.telemetry(status=Status.FAULT, fault=FaultCode.HEATING) == ()
    assert other.host.state is HostState.CONNECTED
    other.host.arm(0.0)
    answer = other.telemetry(status=Status.FAULT, fault=FaultCode.COMMAND_TOO_OLD)
    expect_stopped(other.host, answer, "the device has a fault: command too old")


def test_a_device_that_somebody_else_has_stopped_is_stopped():
    other = Other().armed()
    expect_stopped(other.host, other.telemetry(), "the device is no longer armed")


def test_stop_may_be_requested_at_any_time_and_gives_three_frames_each_time():
    for prepare in (lambda: Other(connected=False), Other, lambda: Other().armed()):
        host = prepare().host
        session = host.session
        for _ in range(3):
            frames = host.stop(2.0, "enough")
            assert [f.message for f in frames] == [Stop()] * 3
            assert {f.session for f in frames} == {session}
            assert (host.state, host.reason) == (HostState.STOPPED, "enough")
        host.stop(3.0, "another reason")
        assert host.reason == "enough"
    host = Other().host
    host.stop(0.0)
    assert host.reason == "stop was requested"


def test_after_a_stop_telemetry_is_read_but_nothing_is_sent_and_armed_means_nothing():
    other = Other().armed()
    other.host.stop(0.0)
    for status in (Status.ARMED, Status(0), Status.FAULT):
        assert other.telemetry(5.0, status) == ()
        assert other.host.reading.telemetry.status == status
    assert other.host.state is HostState.STOPPED
    assert other.host.hello(6.0).message == Hello(2)
    assert (other.host.state, other.host.reason, other.host.reading) == (HostState.ASKING, "", None)
    assert other.telemetry(6.0, Status.ARMED) == ()
    assert other.host.state is HostState.ASKING


# --- what is dropped


def test_frames_of_another_session_repeats_and_late_ones_are_dropped():
    other = Other()
    other.telemetry()
    newest = other.sequence
    for header in ({"session": 1}, {"session": 0}, {"sequence": newest}, {"sequence": newest - 1}):
        before, other.sequence = other.host.reading, newest
        dropped = other.host.dropped
        assert other.telemetry(1.0, Status.ARMED, **header) == ()
        assert other.host.reading is before
        assert other.host.dropped == dropped + 1
    other.sequence = newest
    other.telemetry(1.0)
    assert other.host.reading.arrived == 1.0


def test_before_there_is_a_session_frames_of_session_zero_are_dropped():
    other = Other(connected=False)
    other.host.hello(0.0)
    assert other.telemetry(session=0) == ()
    assert other.host.reading is None
    assert other.host.dropped == 1


@pytest.mark.parametrize("message", [Stop(), Hello(1), Ping(1), Command(ZERO, 0.05), Reset(0)])
def test_messages_that_only_a_host_may_send_are_dropped(message):
    other = Other()
    assert other.say(message) == ()
    assert other.host.dropped == 1
    assert other.host.state is HostState.CONNECTED


def test_with_a_key_what_is_not_authentic_is_dropped():
    other = Other(keyed=True).armed()
    assert other.telemetry(1.0, authentic=False) == ()
    assert other.say(Fault(FaultCode.CURRENT, 1, 0.0, 0.0, 0, True), authentic=False) == ()
    other.keyed = False
    assert other.capabilities(session=5) == ()
    assert other.host.dropped == 3
    assert other.host.state is HostState.ARMED
    assert other.host.ping(0.0).authentic


# --- clocks and losses


def test_the_offset_is_that_of_the_shortest_round_trip():
    clock = ClockOffset()
    assert not clock.known and math.isnan(clock.offset) and clock.round_trip == math.inf
    for nonce, sent, came, device in ((1, 0.0, 1.0, 10.0), (2, 2.0, 2.25, 12.5), (3, 3.0, 3.5, 99.0)):
        clock.sent(nonce, sent)
        clock.answered(nonce, came, device)
    assert clock.known
    assert (clock.round_trip, clock.offset) == (0.25, 12.5 - 2.125)
    clock.answered(2, 2.0, 0.0)  # a second time
    clock.answered(9, 2.0, 0.0)  # never asked
    assert clock.round_trip == 0.25


def test_a_ping_from_long_ago_counts_no_more_since_clocks_drift():
    clock = ClockOffset()
    for nonce in range(17):
        clock.sent(nonce, 0.0)
        clock.answered(nonce, 0.001 if nonce == 0 else 0.5, 7.0)
        assert clock.round_trip == (0.001 if nonce < 16 else 0.5)
    clock = ClockOffset()
    for nonce in range(17):
        clock.sent(nonce, 0.0)
    clock.answered(0, 1.0, 7.0)
    assert not clock.known
    clock.answered(1, 1.0, 7.0)
    assert clock.known


def test_losses_agree_with_a_plain_count():
    arrivals, came = LossCounter(), set(range(-30, 1))
    for sequence in (1, 2, 4, 3, 9, 9, 10, 28, 29, 29, 60, 61, 100, 90, 101, 121):
        assert arrivals.take(sequence) == (sequence > max(came))
        if sequence > max(came):
            came.add(sequence)
        newest = max(came)
        assert arrivals.newest == newest
        assert arrivals.lost == sum(k not in came for k in range(newest - 19, newest + 1))


# --- both cores together


def test_host_and_device_understand_each_other_from_hello_to_stop():
    sessions = itertools.count(500)
    device = Device(EXPECTED, lambda now, raw: tuple(raw), lambda: next(sessions))
    nonces = itertools.count(1)
    host = Host(EXPECTED, lambda: next(nonces))
    now = 0.0

    def give(*frames):
        for frame in frames:
            for answer in device.on_frame(now, frame):
                give(*host.on_frame(now, answer))

    give(host.hello(now))
    assert host.state is HostState.CONNECTED
    give(host.ping(now))
    for k in range(40):
        now += PERIOD
        for frame in device.tick(now, ZERO):
            give(*host.on_frame(now, frame))
        give(host.ping(now))
        give(*host.check(now))
        armed = host.state is HostState.ARMED
        give(host.command(now, (0.25, 0.0, -0.5) if armed else ZERO))
        if host.state is HostState.CONNECTED:
            give(host.arm(now))
        assert device.output.currents == ((0.25, 0.0, -0.5) if k >= 2 else ZERO)
    assert host.state is HostState.ARMED
    assert abs(host.clock.offset) <= 1e-6  # times travel in microseconds
    now += 0.03
    give(*host.check(now))
    assert device.output.currents == ZERO and not device.armed
    assert host.reason == "the newest telemetry is 30.0 ms old"
    assert device.dropped == device.refused == host.dropped == 0
