"""The device's rules as a state machine without a clock and without a wire: what a firmware has to do.

Frames and times go in, frames and currents come out. `now` is the device's own monotonic clock; in lock-step
it is the plant's simulated time, which goes on by one period per command.

Current flows only while the device is armed, by a command that is still valid. Whatever is against a rule of
`device_limits` disarms at once and is latched: nothing flows then until reset-fault, a zero command, and arm.
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

# What a device says: frames of its session, numbered as they leave, and when each telemetry did.

_REMEMBERED = 256  # telemetries: 20 ms at 10 kHz and some more


class Outbox:
    """Collects what is to be sent."""

    def __init__(self, keyed: bool):
        """Without a session nothing is said.

        Args:
          keyed: Whether everything is to be signed.
        """
        self._keyed = keyed
        self._out: list[Frame] = []
        self.begin(0)

    def begin(self, session: int) -> None:
        """From now on in this session; 0: none."""
        self.session, self._said = session, 0
        self._told: deque[tuple[int, float]] = deque(maxlen=_REMEMBERED)

    def say(self, now: float, message: Message) -> None:
        """To the session's host; to nobody if there is none. Time in [s]."""
        if self.session != 0:
            self._said += 1
            self._out.append(self._frame(now, message, self.session, self._said & _MASK))
            if isinstance(message, Telemetry):
                self._told.append((self._said & _MASK, now))

    def put_fault(self, now: float, refusal: Refusal, sequence: int, latched: bool) -> None:
        """Which rule was broken, by the frame with this number (0: by none)."""
        self.say(
            now, Fault(refusal.code, refusal.wheel, refusal.value, refusal.limit, sequence, latched=latched)
        )

    def put_busy(self, now: float) -> None:
        """To a stranger: outside of the session, and no more than that."""
        busy = Fault(FaultCode.BUSY, 0, 0.0, 0.0, 0, latched=False)
        self._out.append(self._frame(now, busy, 0, 0))

    def again(self, frames: tuple[Frame, ...]) -> None:
        """What was said before, as it was."""
        self._out += frames

    @property
    def pending(self) -> tuple[Frame, ...]:
        """What is to be sent and has not been taken."""
        return tuple(self._out)

    def take(self) -> tuple[Frame, ...]:
        """What is to be sent now."""
        out, self._out = tuple(self._out), []
        return out

    def age(self, now: float, sequence: int) -> float:
        """Of the telemetry with this number [s]; infinite if there was none lately."""
        return next((now - time for said, time in self._told if said == sequence), math.inf)

    def _frame(self, now: float, message: Message, session: int, sequence: int) -> Frame:
        return Frame(message, session, sequence, round(now * 1e6), self._keyed)


_MASK = 2**32 - 1


class Device:
    """Between the wire and the amplifiers; n wheels.

    In real time: `tick` once per period with the readings of that moment, then write `output`. In lock-step:
    when `step_due`, move the plant by one period under `output`, then `tick`. In both: write `output` after
    every frame too, since a stop is obeyed at once.
    """

    def __init__(
        self,
        commissioned: DeviceConfig,
        speeds: WheelSpeedDecoder,
        new_session: Callable[[], int],
        now: float = 0.0,
    ):
        """The device after power-up: no session, disarmed.

        Args:
          commissioned: Its limits are rounded to float32.
          speeds: For the limit on wheel speed.
          new_session: 32 random bits, fresh at each call.
          now: Its clock [s].

        Raises:
          InputError: A limit is not above 0, or there is no wheel.
        """
        if commissioned.wheels < 1:
            raise InputError("device", f"found {commissioned.wheels} wheels", "at least one is needed")
        self.commissioned = replace(commissioned, limits=gate.round_to_float32(commissioned.limits))
        self._limits = self.commissioned.limits
        self._limits_hash = limits_hash(self._limits)
        self._speeds, self._new_session = speeds, new_session
        self._counts = counts_mask(commissioned.channels)
        self._zero = (0.0,) * commissioned.wheels
        self._nothing = Command(self._zero, -1.0)  # too old from the start
        self.armed = False
        self.fault = FaultCode.NONE
        """That is latched."""
        self.refused = 0
        self.dropped = 0
        self.step_due = False
        """Lock-step: a command waits for its period."""
        self._at = now
        self._heat, self._raw = self._zero, ()
        self._budget, self._strangers = RateLimiter(self._limits, now), RateLimiter(self._limits, now)
        self._voice = Outbox(commissioned.keyed)
        self._begin(nonce=0)
        self._halt(now)

    @property
    def session(self) -> int:
        """0: none yet."""
        return self._voice.session

    @property
    def output(self) -> AmplifierOutput:
        """What the amplifiers get now."""
        return AmplifierOutput(self._flows, self._brake)

    def on_invalid_packet(self, now: float) -> None:
        """Something came that is no frame, or of another schema."""
        self._advance(now)
        self.dropped += 1

    def on_frame(self, now: float, frame: Frame) -> tuple[Frame, ...]:
        """What is to be sent: frames of session 0 to whom this one came from, others to the session's host.

        A hello that begins a session makes its sender the session's host.
        """
        self._advance(now)
        message = frame.message
        if isinstance(message, Stop):
            self._halt(now)
        elif self.commissioned.keyed and not frame.authentic:
            self.dropped += 1
        elif isinstance(message, Hello):
            self._on_hello(now, message)
        elif frame.session != self.session or self.session == 0:
            self.dropped += 1
        elif not isinstance(message, Arm | Command | ResetFault | Ping):
            self.dropped += 1  # its own frame, come back
        elif frame.sequence > self._heard:
            self._heard, self._last, self._answer = frame.sequence, message, ()
            self._obey(now, message, frame)
            self._answer = self._voice.pending
        elif self.commissioned.lock_step and frame.sequence == self._heard and message == self._last:
            self._voice.again(self._answer)  # the answer was lost
        else:
            self.dropped += 1
        return self._voice.take()

    def tick(self, now: float, raw: Sequence[float]) -> tuple[Frame, ...]:
        """One period is over: what is to be sent to the session's host; `output` holds for the next one.

        Args:
          now: Time of the readings [s].
          raw: Volts or counts of every channel.
        """
        self._advance(now)
        self._raw, speeds = tuple(raw), self._speeds(now, raw)
        if self.armed:
            self._require(now, gate.check_wheel_speeds(self._limits, speeds))
        if not self.commissioned.lock_step:
            self._adopt(now)
            self._say_telemetry(now)
        elif self.step_due:
            self._say_telemetry(now)
            self._answer = self._voice.pending
        self.step_due = False
        return self._voice.take()

    def _obey(self, now: float, message: Arm | Command | ResetFault | Ping, frame: Frame) -> None:
        """A new frame of the session's host."""
        sequence = frame.sequence
        # simulated time says nothing about message rates
        if not self.commissioned.lock_step and not self._budget.spend(now):
            refusal = Refusal(FaultCode.MESSAGE_RATE, 0, self._budget.credit, self._limits.message_rate)
            if self.fault is FaultCode.NONE:
                self._refuse(now, refusal, sequence, latch=True)
            else:
                self.refused += 1  # the rate is of answers: it has been told once
        elif isinstance(message, Ping):
            self._voice.say(now, Pong(message.nonce))
        elif isinstance(message, Command):
            self._on_command(now, message, sequence)
        else:
            if isinstance(message, ResetFault):
                self.fault = FaultCode.NONE
            elif refusal := self._arm_refusal(now, message, frame.same_schema):
                self._refuse(now, refusal, sequence, latch=False)
                return
            else:
                self.armed = self._begun = True
                self._since = self._arrived  # what follows is held against the zero command
            if self.commissioned.lock_step:
                self._say_telemetry(now)

    def _on_command(self, now: float, command: Command, sequence: int) -> None:
        n = self.commissioned.wheels
        if len(command.currents) != n or not 0 <= command.brake < 2**n:
            refusal = Refusal(FaultCode.MALFORMED, 0, float(len(command.currents)), float(n))
            return self._refuse(now, refusal, sequence, latch=True)
        if not self.armed and not gate.is_zero_command(command):
            return self._refuse(now, Refusal(FaultCode.NOT_ARMED, 0, 0.0, 0.0), sequence, latch=False)
        before = AmplifierState(self._flows, self._since, self._heat)
        if refusal := gate.check_command(self._limits, self.commissioned.period, before, command, now):
            return self._refuse(now, refusal, sequence, latch=True)
        self._command, self._arrived = command, now
        self._acknowledged, self._taken = sequence, now
        if self.commissioned.lock_step and self._begun:
            self._adopt(now)
            self.step_due = True
        elif self.commissioned.lock_step:
            self._say_telemetry(now)  # time stands still until the session has been armed
        return None

    def _arm_refusal(self, now: float, arm: Arm, same_schema: bool) -> Refusal | None:
        hashes, standing = (self._limits_hash, self.commissioned.calibration_hash), now - self._arrived
        seen = self._voice.age(now, arm.telemetry)
        return gate.check_arming(arm, same_schema, self.fault, hashes, self._command, standing, seen)

    def _on_hello(self, now: float, hello: Hello) -> None:
        """Anybody may ask, out of a budget of their own; while the device is armed they are told nothing."""
        if not self.commissioned.lock_step and not self._strangers.spend(now):
            self.dropped += 1
            return
        if self.armed:
            self.refused += 1
            self._voice.put_busy(now)
            return
        if self.session == 0 or hello.nonce != self._nonce or self._heard > 0:
            drawn = self._new_session() & _MASK
            while drawn in (0, self.session):
                drawn = (drawn + 1) & _MASK
            self._voice.begin(drawn)
            self._begin(hello.nonce)
            self._halt(now)
        c, own = self.commissioned, self._limits_hash
        facts = (c.period, c.lock_step, c.wheels, c.channels, c.limits, own, c.calibration_hash)
        self._voice.say(now, Capabilities(hello.nonce, *facts))

    def _begin(self, nonce: int) -> None:
        """A session's own state; heat, fault and counts are the device's and stay."""
        self._nonce, self._heard = nonce, 0
        self._acknowledged, self._taken = 0, 0.0
        self._begun = False
        self._last: Message = Stop()
        self._answer: tuple[Frame, ...] = ()

    def _halt(self, now: float) -> None:
        """Zero current at once, disarmed."""
        self.armed = False
        self._command, self._arrived = self._nothing, now
        self._flows, self._brake, self._since = self._zero, 0, now

    def _adopt(self, now: float) -> None:
        """The newest command flows from now on."""
        if not self.armed:
            return
        self._require(
            now,
            gate.check_heating(self._limits, self.commissioned.period, self._heat, self._command.currents),
        )
        command = self._command  # none if that was too hot
        self._flows, self._brake, self._since = command.currents, command.brake, self._arrived

    def _advance(self, now: float) -> None:
        """What time alone does: motors warm up and cool down, a command grows too old."""
        elapsed = max(0.0, now - self._at)
        self._heat = tuple(
            gate.heat_after(self._limits, heat, current, elapsed)
            for heat, current in zip(self._heat, self._flows, strict=True)
        )
        self._at = max(self._at, now)
        if self.armed:
            self._require(now, gate.check_command_age(now - self._arrived, self._command.valid_for))

    def _require(self, now: float, refusal: Refusal | None) -> None:
        """Nothing is broken, or else it is latched and told."""
        if refusal is not None:
            self._latch(now, refusal, sequence=0)

    def _refuse(self, now: float, refusal: Refusal, sequence: int, latch: bool) -> None:
        self.refused += 1
        if latch:
            self._latch(now, refusal, sequence)
        else:
            self._voice.put_fault(now, refusal, sequence, latched=False)

    def _latch(self, now: float, refusal: Refusal, sequence: int) -> None:
        """Disarms; the first fault is the one that is kept."""
        self._halt(now)
        if self.fault is FaultCode.NONE:
            self.fault = refusal.code
        self._voice.put_fault(now, refusal, sequence, latched=True)

    def _say_telemetry(self, now: float) -> None:
        age = now - self._taken if self._acknowledged else math.inf
        facts = (
            self._acknowledged,
            age,
            self._status(),
            self.fault,
            self.refused & _MASK,
            self.dropped & _MASK,
        )
        self._voice.say(now, Telemetry(*facts, raw=self._raw, counts=self._counts))

    def _status(self) -> Status:
        facts = {
            Status.ARMED: self.armed,
            Status.FAULT: self.fault is not FaultCode.NONE,
            Status.LOCK_STEP: self.commissioned.lock_step,
            Status.CURRENT_FLOWS: self._flows != self._zero,
            Status.BRAKED: self._brake != 0,
            Status.AUTHENTIC: self.commissioned.keyed,
        }
        return Status(sum(bit for bit, holds in facts.items() if holds))
