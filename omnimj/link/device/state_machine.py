"""Device as a state machine without clock and wire: the rules that a firmware implements.

Its inputs are frames and times, its outputs frames and currents. `now` is the device's own monotonic clock;
in lock-step it is the plant's simulated time, which advances by one period per command.

Current flows only while the device is armed, and only by a command that is still valid. Any violation of
`limits` disarms at once and is latched: no current flows until reset-fault, a zero command, and arm.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

from omnimj.errors import InputError
from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    Command,
    Fault,
    FaultCode,
    Frame,
    Hello,
    Message,
    Ping,
    Pong,
    ResetFault,
    Status,
    Stop,
    Telemetry,
    counts_mask,
)
from omnimj.link.device import limits as gate
from omnimj.link.device.config import AmplifierOutput, DeviceConfig, WheelSpeedDecoder, limits_hash
from omnimj.link.device.limits import AmplifierState, RateLimiter, Refusal

_MASK = 2**32 - 1
_REMEMBERED = 256  # telemetries: more than 20 ms at 10 kHz


class Outbox:
    """Queue of frames to send, numbered within the session, with the times of recent telemetries."""

    def __init__(self, keyed: bool):
        """Start without a session, in which nothing is sent.

        Args:
          keyed: Whether frames are to be tagged.
        """
        self._keyed = keyed
        self._queue: list[Frame] = []
        self.start_session(0)

    def start_session(self, session: int) -> None:
        """Begin a session (0: none), with frame numbers from 1."""
        self.session, self._sequence = session, 0
        self._telemetry_times: deque[tuple[int, float]] = deque(maxlen=_REMEMBERED)

    def put(self, now: float, message: Message) -> None:
        """Queue a message for the session's host at time `now` [s]; ignored without a session."""
        if self.session != 0:
            self._sequence += 1
            self._queue.append(self._frame(now, message, self.session, self._sequence & _MASK))
            if isinstance(message, Telemetry):
                self._telemetry_times.append((self._sequence & _MASK, now))

    def put_fault(self, now: float, refusal: Refusal, sequence: int, latched: bool) -> None:
        """Queue a fault about the frame with this sequence number (0: no frame)."""
        self.put(
            now, Fault(refusal.code, refusal.wheel, refusal.value, refusal.limit, sequence, latched=latched)
        )

    def put_busy(self, now: float) -> None:
        """Queue the answer to a host other than the session's, outside of the session."""
        busy = Fault(FaultCode.BUSY, 0, 0.0, 0.0, 0, latched=False)
        self._queue.append(self._frame(now, busy, 0, 0))

    def repeat(self, frames: tuple[Frame, ...]) -> None:
        """Queue earlier frames unchanged."""
        self._queue += frames

    @property
    def pending(self) -> tuple[Frame, ...]:
        """Queued frames."""
        return tuple(self._queue)

    def drain(self) -> tuple[Frame, ...]:
        """Remove and return the queued frames."""
        out, self._queue = tuple(self._queue), []
        return out

    def telemetry_age(self, now: float, sequence: int) -> float:
        """Age of the telemetry with this sequence number [s]; infinite if it is unknown."""
        return next((now - time for number, time in self._telemetry_times if number == sequence), math.inf)

    def _frame(self, now: float, message: Message, session: int, sequence: int) -> Frame:
        return Frame(message, session, sequence, round(now * 1e6), self._keyed)


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
    ):
        """Power up: no session, disarmed.

        Args:
          config: Configuration; its limits are rounded to float32.
          speeds: Wheel speeds from raw readings, for the limit on wheel speed.
          new_session: Returns 32 fresh random bits.
          now: Time of the device's clock [s].

        Raises:
          InputError: A limit is not above 0, or there is no wheel.
        """
        if config.wheels < 1:
            raise InputError("device", f"found {config.wheels} wheels", "at least one is needed")
        self.config = replace(config, limits=gate.round_to_float32(config.limits))
        self._limits = self.config.limits
        self._limits_hash = limits_hash(self._limits)
        self._speeds, self._new_session = speeds, new_session
        self._counts = counts_mask(config.channels)
        self._zero = (0.0,) * config.wheels
        self._expired_command = Command(self._zero, -1.0)  # too old until a command arrives
        self.armed = False
        self.fault = FaultCode.NONE
        """Latched fault."""
        self.refused = 0
        """Valid frames that were refused since power-up."""
        self.dropped = 0
        """Packets that were dropped since power-up."""
        self.step_due = False
        """True if, in lock-step, a command is waiting for its period."""
        self._time = now
        self._heat, self._raw = self._zero, ()
        self._limiter, self._hello_limiter = RateLimiter(self._limits, now), RateLimiter(self._limits, now)
        self._outbox = Outbox(config.keyed)
        self._start_session(nonce=0)
        self._disarm(now)

    @property
    def session(self) -> int:
        """Number of the session; 0: none yet."""
        return self._outbox.session

    @property
    def output(self) -> AmplifierOutput:
        """Present set values of the amplifiers."""
        return AmplifierOutput(self._currents, self._brake)

    def on_invalid_packet(self, now: float) -> None:
        """Count a packet that is no frame, or one of another schema."""
        self._advance_time(now)
        self.dropped += 1

    def on_frame(self, now: float, frame: Frame) -> tuple[Frame, ...]:
        """Process a frame and return the frames to send.

        Frames of session 0 go to the sender of `frame`, others to the session's host; a hello that begins a
        session makes its sender the session's host.

        Args:
          now: Time of the device's clock [s].
          frame: Received frame.
        """
        self._advance_time(now)
        message = frame.message
        if isinstance(message, Stop):
            self._disarm(now)
        elif self.config.keyed and not frame.authentic:
            self.dropped += 1
        elif isinstance(message, Hello):
            self._on_hello(now, message)
        elif frame.session != self.session or self.session == 0:
            self.dropped += 1
        elif not isinstance(message, Arm | Command | ResetFault | Ping):
            self.dropped += 1  # reflected frame of a device
        elif frame.sequence > self._last_sequence:
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
        if not self.config.lock_step:
            self._apply_command(now)
            self._put_telemetry(now)
        elif self.step_due:
            self._put_telemetry(now)
            self._answer = self._outbox.pending
        self.step_due = False
        return self._outbox.drain()

    def _handle(self, now: float, message: Arm | Command | ResetFault | Ping, frame: Frame) -> None:
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
            if isinstance(message, ResetFault):
                self.fault = FaultCode.NONE
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
        if not self.armed and not gate.is_zero_command(command):
            return self._refuse(now, Refusal(FaultCode.NOT_ARMED, 0, 0.0, 0.0), sequence, latch=False)
        before = AmplifierState(self._currents, self._currents_since, self._heat)
        if refusal := gate.check_command(self._limits, self.config.period, before, command, now):
            return self._refuse(now, refusal, sequence, latch=True)
        self._command, self._arrived_at = command, now
        self._acknowledged, self._accepted_at = sequence, now
        if self.config.lock_step and self._was_armed:
            self._apply_command(now)
            self.step_due = True
        elif self.config.lock_step:
            self._put_telemetry(now)  # time does not advance before the session is armed
        return None

    def _arm_refusal(self, now: float, arm: Arm, same_schema: bool) -> Refusal | None:
        hashes, age = (self._limits_hash, self.config.calibration_hash), now - self._arrived_at
        telemetry_age = self._outbox.telemetry_age(now, arm.telemetry)
        return gate.check_arming(arm, same_schema, self.fault, hashes, self._command, age, telemetry_age)

    def _on_hello(self, now: float, hello: Hello) -> None:
        """Begin a session, or answer that an armed device is busy; hellos have their own rate limit."""
        if not self.config.lock_step and not self._hello_limiter.allows(now):
            self.dropped += 1
            return
        if self.armed:
            self.refused += 1
            self._outbox.put_busy(now)
            return
        if self.session == 0 or hello.nonce != self._nonce or self._last_sequence > 0:
            drawn = self._new_session() & _MASK
            while drawn in (0, self.session):
                drawn = (drawn + 1) & _MASK
            self._outbox.start_session(drawn)
            self._start_session(hello.nonce)
            self._disarm(now)
        c, own = self.config, self._limits_hash
        facts = (c.period, c.lock_step, c.wheels, c.channels, c.limits, own, c.calibration_hash)
        self._outbox.put(now, Capabilities(hello.nonce, *facts))

    def _start_session(self, nonce: int) -> None:
        """Reset the state of a session; heat, fault and counters belong to the device and are kept."""
        self._nonce, self._last_sequence = nonce, 0
        self._acknowledged, self._accepted_at = 0, 0.0
        self._was_armed = False
        self._last_message: Message = Stop()
        self._answer: tuple[Frame, ...] = ()

    def _disarm(self, now: float) -> None:
        """Disarm with zero current at once."""
        self.armed = False
        self._command, self._arrived_at = self._expired_command, now
        self._currents, self._brake, self._currents_since = self._zero, 0, now

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
        """Update motor heating and check the age of the command."""
        elapsed = max(0.0, now - self._time)
        self._heat = tuple(
            gate.heat_after(self._limits, heat, current, elapsed)
            for heat, current in zip(self._heat, self._currents, strict=True)
        )
        self._time = max(self._time, now)
        if self.armed:
            self._check(now, gate.check_command_age(now - self._arrived_at, self._command.valid_for))

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
        self._outbox.put_fault(now, refusal, sequence, latched=True)

    def _put_telemetry(self, now: float) -> None:
        age = now - self._accepted_at if self._acknowledged else math.inf
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
        }
        return Status(sum(bit for bit, holds in facts.items() if holds))
