"""Whatever frames come, in whatever order, at whatever times: current flows only when it may."""

from __future__ import annotations

import math

from device_driver import CALIBRATION_HASH, LIMITS, PERIOD, ZERO, DeviceDriver
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    Challenge,
    Command,
    Fault,
    FaultCode,
    Hello,
    Ping,
    Pong,
    Reset,
    Status,
    Stop,
    Telemetry,
)

CURRENTS = st.one_of(
    st.sampled_from([0.0, 0.25, -0.5, 0.5, 1.0, -1.5, 1.5]),
    st.sampled_from([math.nan, math.inf, 1.6, -9.0, math.nextafter(1.5, 2.0)]),
)
QUIET = st.sampled_from([0.0, 0.25, -0.25, 0.5])
VALID_FOR = st.sampled_from([PERIOD, 4 * PERIOD, 0.0625, 0.25, 0.0, -1.0, 0.5, math.nan])
OTHERS = st.sampled_from([Pong(1), Capabilities(1, PERIOD, False, 3, (), LIMITS, 0, 0)])


class AnyOrder(RuleBasedStateMachine):
    """Beside the device runs a plain account of what the host may expect, kept from what was sent only."""

    def __init__(self):
        super().__init__()
        self.driver = DeviceDriver()
        self.asked_to_arm = False  # since the last stop, fault or hello
        self.last = None  # the last command that was taken, and when
        self.stored = []

    @property
    def device(self):
        return self.driver.device

    def send(self, message, **header):
        """Sends and keeps the account."""
        before = self.device.dropped, self.device.refused
        frame = self.driver.frame(message, **header)
        self.stored.append(frame)
        self.account(message, self.driver.deliver(frame), before)

    def account(self, message, answer, before):
        for frame in answer:
            if isinstance(frame.message, Fault) and frame.message.latched:
                self.asked_to_arm, self.last = False, None
            if isinstance(frame.message, Capabilities) and frame.session != 0:
                self.driver.session = frame.session
                if frame.sequence == 1:
                    self.driver.sequence, self.asked_to_arm, self.last = 0, False, None
        taken = before == (self.device.dropped, self.device.refused)
        if isinstance(message, Stop):
            self.asked_to_arm, self.last = False, None
        elif isinstance(message, Arm) and taken:
            self.asked_to_arm = True
        elif isinstance(message, Command) and taken:
            self.last = message, self.driver.now

    @rule(nonce=st.integers(1, 3))
    def hello(self, nonce):
        self.send(Hello(nonce), session=0)
        challenge = self.driver.received[-1].message
        if isinstance(challenge, Challenge):
            self.send(Hello(nonce, challenge.cookie, challenge.device), session=0)

    @rule()
    def arm_rightly(self):
        self.send(Arm(self.driver.limits_hash, CALIBRATION_HASH, self.driver.newest))

    @rule()
    def drive_as_a_good_host_does(self):
        self.stop()
        self.hello(4)
        self.ping(0)
        self.wait(1)
        self.reset()
        self.zero()
        self.arm_rightly()
        self.command((0.25, 0.0, -0.25), 0)
        self.wait(1)
        assert self.device.output.currents == (0.25, 0.0, -0.25)

    @rule(limits=st.booleans(), calibration=st.booleans(), telemetry=st.integers(0, 5))
    def arm_somehow(self, limits, calibration, telemetry):
        self.send(Arm(self.driver.limits_hash ^ limits, CALIBRATION_HASH ^ calibration, telemetry))

    @rule()
    def zero(self):
        self.send(Command(ZERO, 0.0625, 0, self.driver.newest))

    @rule(currents=st.tuples(QUIET, QUIET, QUIET), brake=st.sampled_from([0, 0, 0, 5]))
    def command(self, currents, brake):
        self.send(Command(currents, 0.0625, brake, self.driver.newest))

    @rule(currents=st.tuples(CURRENTS, CURRENTS, CURRENTS), valid_for=VALID_FOR)
    def any_command(self, currents, valid_for):
        self.send(Command(currents, valid_for, 0, self.driver.newest))

    @rule(currents=st.tuples(QUIET, QUIET, QUIET), shift=st.integers(-3, 0))
    def old_command(self, currents, shift):
        self.send(
            Command(currents, 0.0625, 0, self.driver.newest), sequence=max(0, self.driver.sequence + shift)
        )

    @rule(currents=st.tuples(QUIET, QUIET, QUIET), back=st.integers(1, 300))
    def late_command(self, currents, back):
        """Answers a telemetry of long ago."""
        self.send(Command(currents, 0.0625, 0, max(0, self.driver.newest - back)))

    @rule(currents=st.tuples(QUIET, QUIET, QUIET), session=st.integers(0, 2))
    def foreign_command(self, currents, session):
        self.send(Command(currents, 0.0625, 0, self.driver.newest), session=session)

    @precondition(lambda self: self.stored)
    @rule(back=st.integers(1, 12))
    def replay(self, back):
        frame, before = self.stored[-min(back, len(self.stored))], (self.device.dropped, self.device.refused)
        self.account(frame.message, self.driver.deliver(frame), before)

    @rule()
    def stop(self):
        self.send(Stop(), session=0)
        assert self.device.output.currents == ZERO

    @rule()
    def reset(self):
        self.send(Reset(self.driver.newest))

    @rule(nonce=st.integers(0, 3))
    def ping(self, nonce):
        self.send(Ping(nonce))

    @rule(message=OTHERS)
    def nonsense(self, message):
        self.send(message)

    @rule()
    def broken(self):
        self.device.on_invalid_packet(self.driver.now)

    @rule(periods=st.sampled_from([1, 1, 1, 2, 30, 70]))
    def wait(self, periods):
        for _ in range(periods):
            self.account(None, self.driver.tick(), (-1, -1))

    @rule(part=st.sampled_from([0.25, 0.5, 1.5]))
    def wait_between_ticks(self, part):
        self.driver.now += part * PERIOD

    @rule(speed=st.sampled_from([0.0, 40.0, -41.0, math.nan]))
    def turn(self, speed):
        armed = self.device.armed
        self.account(None, self.driver.tick((0.0, speed, 0.0)), (-1, -1))
        assert not (armed and self.device.armed and not abs(speed) <= LIMITS.wheel_speed)

    @invariant()
    def current_flows_only_when_it_may(self):
        output = self.device.output
        if output.currents == ZERO and output.brake == 0:
            return
        assert self.device.armed and self.asked_to_arm and self.device.session
        assert self.device.fault is FaultCode.NONE and not self.device.stopped
        assert self.last is not None
        assert all(abs(current) <= LIMITS.current for current in output.currents)

    @invariant()
    def what_flows_after_a_tick_is_valid(self):
        at_tick = self.driver.received and self.driver.received[-1].time == round(self.driver.now * 1e6)
        if at_tick and self.device.armed:
            assert self.last is not None
            command, came = self.last
            assert self.driver.now - came <= command.valid_for
            answered = next(f for f in self.driver.received if self.is_telemetry(f, command.telemetry))
            assert self.driver.now - 1e-6 * answered.time <= command.valid_for + 1e-6

    def is_telemetry(self, frame, sequence):
        """Whether a frame is this telemetry of the present session."""
        facts = frame.session, frame.sequence
        return isinstance(frame.message, Telemetry) and facts == (self.device.session, sequence)

    @invariant()
    def a_latched_fault_means_no_current(self):
        if self.device.fault is not FaultCode.NONE or self.device.stopped:
            assert not self.device.armed
            assert self.device.output.currents == ZERO and self.device.output.brake == 0

    @invariant()
    def telemetry_says_how_it_is(self):
        if self.driver.received and isinstance(self.driver.received[-1].message, Telemetry):
            status = self.driver.received[-1].message.status
            assert (Status.CURRENT_FLOWS in status) <= (Status.ARMED in status)
            assert not (status & (Status.FAULT | Status.STOPPED) and Status.ARMED in status)


AnyOrder.TestCase.settings = settings(max_examples=150, stateful_step_count=50, deadline=None)
TestAnyOrder = AnyOrder.TestCase
