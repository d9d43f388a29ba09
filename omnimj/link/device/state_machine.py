"""Device as a state machine without clock and wire: the rules that a firmware implements.

Its inputs are frames and times, its outputs frames and currents. `now` is the device's own monotonic clock;
in lock-step it is the plant's simulated time, which advances by one period per command.

Current flows only while the device is armed, and only by a command that is still valid. Any violation of
`limits` disarms at once and is latched, and so is a stop: no current flows until reset, a zero command, and
arm. A session takes a handshake, is silent until its host has sent a frame, and ends when its host is silent.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from omnimj.errors import InputError
from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    Challenge,
    Command,
    FaultCode,
    Frame,
    Hello,
    Message,
    Ping,
    Pong,
    Reset,
    Status,
    Stop,
    Telemetry,
    counts_mask,
)
from omnimj.link.device import limits as gate
from omnimj.link.device.config import (
    AmplifierOutput,
    CurrentDecoder,
    DeviceConfig,
    WheelSpeedDecoder,
    limits_hash,
)
from omnimj.link.device.handshake import Handshake
from omnimj.link.device.limits import AmplifierState, RateLimiter, Refusal
from omnimj.link.device.outbox import Outbox

_MASK = 2**32 - 1
SESSION_TIMEOUT = 1.0
"""Silence after which a session in real time ends [s]."""
ANNOUNCE_INTERVAL = 1.0
"""Time between two repetitions of challenge and capabilities in a session, for passive listeners [s]."""


class Device:
    """State machine between the wire and the amplifiers of n wheels.

    In real time, call `tick` once per period with the current readings, then write `output`. In lock-step,
    when `step_due`, advance the plant by one period under `output`, then call `tick`. In both, write `output`
    after every frame too, since a stop takes effect at once.
    """

    def __init__(
        self,
        config: DeviceConfig,
        speeds: WheelSpeedDecoder,
        new_session: Callable[[], int],
        now: float = 0.0,
        *,
        currents: CurrentDecoder | None = None,
        secret: bytes | None = None,
    ):
        """Power up: no session, disarmed.

        Args:
          config: Configuration; its limits are rounded to float32.
          speeds: Wheel speeds from raw readings, for the limit on wheel speed.
          new_session: Returns 32 fresh random bits.
          now: Time of the device's clock [s].
          currents: Measured currents from raw readings; None if they are not measured.
          secret: Secret of the handshake, 32 random bytes; drawn if None.

        Raises:
          InputError: A limit is not above 0, or there is no wheel.
        """
        if config.wheels < 1:
            raise InputError("device", f"found {config.wheels} wheels", "at least one is needed")
        self.config = replace(config, limits=gate.round_to_float32(config.limits))
        self._limits = self.config.limits
        self._limits_hash = limits_hash(self._limits)
        self._speeds, self._decode_currents, self._new_session = speeds, currents, new_session
        self._counts = counts_mask(config.channels)
        self._zero = (0.0,) * config.wheels
        self._expired_command = Command(self._zero, -1.0)  # too old until a command arrives
        self.armed = False
        self.fault, self.stopped = FaultCode.NONE, False
        """Latched fault, and whether a stop is latched."""
        self.refused = 0
        """Valid frames that were refused since power-up."""
        self.dropped = 0
        """Packets that were dropped since power-up."""
        self.step_due = False
        """True if, in lock-step, a command is waiting for its period."""
        self._time = now
        self._heat, self._raw, self._measured = self._zero, (), self._zero
        self._limiter, self._hello_limiter = RateLimiter(self._limits, now), RateLimiter(self._limits, now)
        # an age up to the longest valid_for is known, with other frames in between
        self._outbox = Outbox(config.keyed, 2 + math.ceil(self._limits.valid_for / config.period))
        self._handshake = Handshake(config.identity, secret)
        self._start_session(now)
        self._disarm(now)

    @property
    def session(self) -> int:
        """Number of the session; 0: none yet."""
        return self._outbox.session

    @property
    def connection(self) -> bytes:
        """Identity, host's nonce and cookie of the newest session, from which its key is derived."""
        return self._handshake.connection

    @property
    def identity(self) -> int:
        """Identity of the device."""
        return self._handshake.identity

    @property
    def output(self) -> AmplifierOutput:
        """Present set values of the amplifiers."""
        return AmplifierOutput(self._currents, self._brake)

    def on_invalid_packet(self, now: float, number: int = 1) -> None:
        """Count packets that are no frames, or frames of another schema."""
        self._advance_time(now)
        self.dropped += number

    def on_frame(self, now: float, frame: Frame, peer: bytes = b"") -> tuple[Frame, ...]:
        """Process a frame and return the frames to send.

        Frames of session 0 go to the sender of `frame`, others to the session's host; a hello that begins a
        session makes its sender the session's host.

        Args:
          now: Time of the device's clock [s].
          frame: Received frame.
          peer: Address of its sender; empty on a wire with a single far end.
        """
        self._advance_time(now)
        message = frame.message
        if isinstance(message, Stop):
            self._disarm(now)
            self.stopped, self._latched_at = True, self._outbox.sequence
        elif self.config.keyed and not frame.authentic:
            self.dropped += 1
        elif isinstance(message, Hello):
            self._on_hello(now, message, peer)
        elif frame.session != self.session or self.session == 0 or peer != self._handshake.peer:
            self.dropped += 1
        elif not isinstance(message, Arm | Command | Reset | Ping):
            self.dropped += 1  # reflected frame of a device
        elif frame.sequence > self._last_sequence:
            self._is_confirmed, self._heard_at = True, now
            self._last_sequence, self._last_message, self._answer = frame.sequence, message, ()
            self._handle(now, message, frame)
            self._answer = self._outbox.pending
        elif (
            self.config.lock_step and frame.sequence == self._last_sequence and message == self._last_message
        ):
            self._outbox.repeat(self._answer)  # the answer was lost
        else:
            self.dropped += 1
        return self._outbox.drain()

    def end_session(self, now: float) -> None:
        """End the session, disarmed."""
        self._outbox.start_session(0)
        self._start_session(now)
        self._disarm(now)

    def tick(self, now: float, raw: Sequence[float]) -> tuple[Frame, ...]:
        """End a period and return the frames to send to the session's host; `output` holds for the next one.

        Args:
          now: Time of the readings [s].
          raw: Volts or counts of every channel.
        """
        self._advance_time(now)
        self._raw, speeds = tuple(raw), self._speeds(now, raw)
        if self.armed:
            self._check(now, gate.check_wheel_speeds(self._limits, speeds))
        self._compare_currents(now, raw)
        if not self.config.lock_step:
            self._apply_command(now)
            self._put_telemetry(now)
            self._announce(now)
        elif self.step_due:
            self._put_telemetry(now)
            self._answer = self._outbox.pending
        self.step_due = False
        return self._outbox.drain()

    def _compare_currents(self, now: float, raw: Sequence[float]) -> None:
        """Check that the measured currents follow the set values of the period that ends."""
        if self._decode_currents is None:
            return
        self._measured = self._decode_currents(raw)
        n = self.config.wheels
        if not self.armed:
            self._deviates_since = (math.inf,) * n
            return
        pairs = zip(self._currents, self._measured, strict=True)
        wrong = [gate.deviates(self._limits, current, measured) for current, measured in pairs]
        self._deviates_since = tuple(
            min(since, now) if wrong[i] and not self._brake >> i & 1 else math.inf
            for i, since in enumerate(self._deviates_since)
        )
        self._check(now, gate.check_deviation(self._deviates_since, now))

    def _handle(self, now: float, message: Arm | Command | Reset | Ping, frame: Frame) -> None:
        """Process a new frame of the session's host."""
        sequence = frame.sequence
        # message rates have no meaning in simulated time
        if not self.config.lock_step and not self._limiter.allows(now):
            refusal = Refusal(FaultCode.MESSAGE_RATE, 0, self._limiter.credit, self._limits.message_rate)
            if self.fault is FaultCode.NONE:
                self._refuse(now, refusal, sequence, latch=True)
            else:
                self.refused += 1  # the rate limits answers, and the fault has been sent
        elif isinstance(message, Ping):
            self._outbox.put(now, Pong(message.nonce))
        elif isinstance(message, Command):
            self._on_command(now, message, sequence)
        else:
            if isinstance(message, Reset):
                if refusal := self._reset_refusal(now, message):
                    self._refuse(now, refusal, sequence, latch=False)
                    return
                self.fault, self.stopped = FaultCode.NONE, False
            elif refusal := self._arm_refusal(now, message, frame.same_schema):
                self._refuse(now, refusal, sequence, latch=False)
                return
            else:
                self.armed = self._was_armed = True
                self._currents_since = self._arrived_at  # the next command is compared with the zero command
            if self.config.lock_step:
                self._put_telemetry(now)

    def _on_command(self, now: float, command: Command, sequence: int) -> None:
        n = self.config.wheels
        if len(command.currents) != n or not 0 <= command.brake < 2**n:
            refusal = Refusal(FaultCode.MALFORMED, 0, float(len(command.currents)), float(n))
            return self._refuse(now, refusal, sequence, latch=True)
        answered = self._age_of_answered(now, command)
        if refusal := gate.check_freshness(self._limits, command, answered):
            return self._refuse(now, refusal, sequence, latch=False)
        if not self.armed and not gate.is_zero_command(command):
            return self._refuse(now, Refusal(FaultCode.NOT_ARMED, 0, 0.0, 0.0), sequence, latch=False)
        before = AmplifierState(self._currents, self._currents_since, self._heat)
        if refusal := gate.check_command(self._limits, self.config.period, before, command, now):
            return self._refuse(now, refusal, sequence, latch=True)
        self._command, self._arrived_at = command, now
        self._lives_from = self._accepted_from = now - answered
        self._acknowledged = sequence
        if self.config.lock_step and self._was_armed:
            self._apply_command(now)
            self.step_due = True
        elif self.config.lock_step:
            self._put_telemetry(now)  # time does not advance before the session is armed
        return None

    def _arm_refusal(self, now: float, arm: Arm, same_schema: bool) -> Refusal | None:
        hashes, age = (self._limits_hash, self.config.calibration_hash), now - self._lives_from
        telemetry_age = self._outbox.telemetry_age(now, arm.telemetry)
        return gate.check_arming(
            arm, same_schema, self.fault, self.stopped, hashes, self._command, age, telemetry_age
        )

    def _age_of_answered(self, now: float, command: Command) -> float:
        """Age of the telemetry that a command answers; 0 in lock-step, where time waits for the command."""
        return 0.0 if self.config.lock_step else self._outbox.telemetry_age(now, command.telemetry)

    def _reset_refusal(self, now: float, reset: Reset) -> Refusal | None:
        """Refusal of a reset by a host that has not seen the newest stop or fault, or not recently."""
        age, allowed = self._outbox.telemetry_age(now, reset.telemetry), self._limits.valid_for
        if reset.telemetry > self._latched_at and age <= allowed:
            return None
        return Refusal(FaultCode.STALE, 0, age, allowed)

    def _on_hello(self, now: float, hello: Hello, peer: bytes) -> None:
        """Challenge the sender, or begin a session if it returns the cookie; hellos have their own rate."""
        if not self.config.lock_step and not self._hello_limiter.allows(now):
            self.dropped += 1
            return
        repeated = self.session != 0 and self._last_sequence == 0 and self._handshake.is_newest(hello, peer)
        if not repeated and not self._handshake.is_valid(now, hello, peer):
            self._outbox.put_challenge(now, self._handshake.challenge(now, hello, peer))
            return
        if self.armed:
            self.refused += 1
            self._outbox.put_busy(now, hello.nonce)
            return
        if not repeated:
            drawn = self._new_session() & _MASK
            while drawn in (0, self.session):
                drawn = (drawn + 1) & _MASK
            self._outbox.start_session(drawn)
            self._handshake.begin_session(hello, peer)
            self._start_session(now)
            self._disarm(now)
        self._put_capabilities(now, hello.nonce)

    def _put_capabilities(self, now: float, nonce: int) -> None:
        c, own = self.config, self._limits_hash
        facts = (c.period, c.lock_step, c.wheels, c.channels, c.limits, own, c.calibration_hash)
        self._outbox.put(now, Capabilities(nonce, *facts))
        self._announced_at = now

    def _announce(self, now: float) -> None:
        """Repeat what a passive listener needs to understand the session, which it may have joined late."""
        if self._is_confirmed and now - self._announced_at >= ANNOUNCE_INTERVAL:
            begun_by = self._handshake.hello
            self._outbox.put_challenge(now, Challenge(begun_by.nonce, begun_by.cookie, begun_by.device))
            self._put_capabilities(now, begun_by.nonce)

    def _start_session(self, now: float) -> None:
        """Reset the state of a session; heat, fault, stop and counters belong to the device and are kept."""
        self._last_sequence, self._latched_at = 0, 0
        self._acknowledged, self._accepted_from = 0, now
        self._is_confirmed, self._heard_at = False, now
        self._was_armed, self._announced_at = False, now
        self._last_message: Message = Stop()
        self._answer: tuple[Frame, ...] = ()

    def _disarm(self, now: float) -> None:
        """Disarm with zero current at once."""
        self.armed = False
        self._command, self._arrived_at, self._lives_from = self._expired_command, now, now
        self._currents, self._brake, self._currents_since = self._zero, 0, now
        self._deviates_since = (math.inf,) * self.config.wheels

    def _apply_command(self, now: float) -> None:
        """Apply the newest command from now on."""
        if not self.armed:
            return
        self._check(
            now,
            gate.check_heating(self._limits, self.config.period, self._heat, self._command.currents),
        )
        command = self._command  # expired if the check has disarmed the device
        self._currents, self._brake, self._currents_since = command.currents, command.brake, self._arrived_at

    def _advance_time(self, now: float) -> None:
        """Update motor heating, check the age of the command, and end a silent session."""
        elapsed = max(0.0, now - self._time)
        self._heat = tuple(
            gate.heat_after(self._limits, heat, _larger(current, measured), elapsed)
            for heat, current, measured in zip(self._heat, self._currents, self._measured, strict=True)
        )
        self._time = max(self._time, now)
        if self.armed:
            self._check(now, gate.check_command_age(now - self._lives_from, self._command.valid_for))
        is_silent = now - self._heard_at > SESSION_TIMEOUT and not self.config.lock_step
        if self.session != 0 and is_silent:
            self.end_session(now)

    def _check(self, now: float, refusal: Refusal | None) -> None:
        """Latch a violation, if there is one."""
        if refusal is not None:
            self._latch(now, refusal, sequence=0)

    def _refuse(self, now: float, refusal: Refusal, sequence: int, latch: bool) -> None:
        self.refused += 1
        if latch:
            self._latch(now, refusal, sequence)
        else:
            self._outbox.put_fault(now, refusal, sequence, latched=False)

    def _latch(self, now: float, refusal: Refusal, sequence: int) -> None:
        """Disarm and report a fault; the first latched fault is kept."""
        self._disarm(now)
        if self.fault is FaultCode.NONE:
            self.fault = refusal.code
        self._latched_at = self._outbox.sequence
        self._outbox.put_fault(now, refusal, sequence, latched=True)

    def _put_telemetry(self, now: float) -> None:
        if not self._is_confirmed:
            return
        age = now - self._accepted_from if self._acknowledged else math.inf
        facts = (
            self._acknowledged,
            age,
            self._status(),
            self.fault,
            self.refused & _MASK,
            self.dropped & _MASK,
        )
        self._outbox.put(now, Telemetry(*facts, raw=self._raw, counts=self._counts))

    def _status(self) -> Status:
        facts = {
            Status.ARMED: self.armed,
            Status.FAULT: self.fault is not FaultCode.NONE,
            Status.LOCK_STEP: self.config.lock_step,
            Status.CURRENT_FLOWS: self._currents != self._zero,
            Status.BRAKED: self._brake != 0,
            Status.AUTHENTIC: self.config.keyed,
            Status.STOPPED: self.stopped,
        }
        return Status(sum(bit for bit, holds in facts.items() if holds))


def _larger(current: float, measured: float) -> float:
    """Larger of a set value and a measured current by magnitude; the set value if none is measured [A]."""
    return measured if abs(measured) > abs(current) and math.isfinite(measured) else current
