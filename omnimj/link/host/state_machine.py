"""The host's side of the link as a state machine without a clock and without a wire.

What may end in motion is asked for step by step: hello, arm, command. Any rule that is broken ends in
`STOPPED` with the reason in words; nothing moves again until somebody asks for all three anew.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from omnimj.errors import LinkLost
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
from omnimj.link.device.config import DeviceConfig, describe_mismatch, limits_hash
from omnimj.link.device.limits import MAX_TELEMETRY_AGE, round_to_float32
from omnimj.link.quality import LOSS_WINDOW, ClockOffset, LossCounter

STALE_TELEMETRY_AGE = MAX_TELEMETRY_AGE
"""Age of the newest telemetry at which the host stops [s]."""
MAX_LOST_FRAMES = 5
"""Of the last 20 frames of the device, at which the host stops."""
ACKNOWLEDGE_TIMEOUT = 0.040
"""Age of the oldest command that no telemetry acknowledges, nor one sent after it, at which it stops [s]."""
COMMAND_VALIDITY = 0.050
"""Of a command, unless told otherwise [s]."""
STOP_REPEATS = 3
"""So often a stop is sent."""
_COMMANDS = 1024  # kept until they are acknowledged


class HostState(enum.Enum):
    """Where the host is."""

    IDLE = "nothing has been asked"
    ASKING = "hello has been sent"
    CONNECTED = "there is a session"
    ARMING = "arm has been sent"
    ARMED = "the device says that it is armed"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True)
class Reading:
    """One telemetry with its times on the host's clock."""

    telemetry: Telemetry
    sequence: int
    time: int
    """Of the device's clock [µs]."""
    sampled: float
    """As far as is known: by the clocks' offset, or else when it came [s]."""
    came: float
    """[s]."""


class Host:
    """Talks to one device; frames to be sent come back from every call."""

    def __init__(self, expected: DeviceConfig, new_nonce: Callable[[], int]):
        """Nothing asked yet.

        Args:
          expected: What the device must be; only a keyed one's authentic frames count.
          new_nonce: 64 random bits, fresh at each call.
        """
        self.expected, self._new_nonce = expected, new_nonce
        self.state, self.reason = HostState.IDLE, ""
        self.fault: Fault | None = None
        """The last one that the device told."""
        self.dropped = 0
        """Frames that were foreign, old, stale or not authentic."""
        self._hashes = limits_hash(round_to_float32(expected.limits)), expected.calibration_hash
        self._nonce = 0
        self._begin(0)

    def _begin(self, session: int) -> None:
        self.session, self._sequence = session, 0
        self.reading: Reading | None = None
        """The newest."""
        self.arrivals, self.clock = LossCounter(), ClockOffset()
        self._waiting: deque[tuple[int, float]] = deque(maxlen=_COMMANDS)
        self.capabilities: Capabilities | None = None
        """What the device said that it is."""
        self._layout = 0, 0

    # --- what the host may ask

    def hello(self, now: float) -> Frame:
        """Asks for a session; asked again while there is no answer, it is the same question.

        Raises:
          LinkLost: The device is being driven; stop comes first.
        """
        if self.state in _MOVING:
            raise LinkLost("the device is being driven: stop first")
        if self.state is not HostState.ASKING:
            self._nonce = self._new_nonce()
            self._begin(0)
            self.state, self.reason, self.fault = HostState.ASKING, "", None
        return self._frame(now, Hello(self._nonce))

    def ping(self, now: float) -> Frame:
        """Asks for the device's clock."""
        self._require(*_IN_SESSION)
        nonce = self._new_nonce()
        self.clock.sent(nonce, now)
        return self._frame(now, Ping(nonce))

    def arm(self, now: float) -> Frame:
        """Asks for motion; may be asked again until the device says that it is armed.

        Raises:
          LinkLost: There is no session, or no telemetry yet.
        """
        self._require(*_IN_SESSION)
        if self.reading is None:
            raise LinkLost("there is no telemetry yet")
        if self.state is HostState.CONNECTED:
            self.state = HostState.ARMING
        return self._frame(now, Arm(*self._hashes, self.reading.sequence))

    def command(
        self, now: float, currents: Sequence[float], brake: int = 0, valid_for: float = COMMAND_VALIDITY
    ) -> Frame:
        """Currents at the amplifiers' own signs, shape (n,) [A]; anything but zero only while armed.

        Raises:
          LinkLost: The link does not stand, or it is not armed.
        """
        self._require(*_IN_SESSION)
        if self.state is not HostState.ARMED and (brake != 0 or any(current != 0.0 for current in currents)):
            raise LinkLost("the device is not armed")
        frame = self._frame(now, Command(tuple(currents), valid_for, brake))
        self._waiting.append((frame.sequence, now))
        return frame

    def reset_fault(self, now: float) -> Frame:
        """Says that the device's fault has been seen; it stays disarmed."""
        self._require(*_IN_SESSION)
        return self._frame(now, ResetFault())

    def stop(self, now: float, reason: str = "stop was asked for") -> tuple[Frame, ...]:
        """The stop to be sent, three times; may be asked for at any time, again and again.

        The first reason stays.
        """
        if self.state is not HostState.STOPPED:
            self.state, self.reason = HostState.STOPPED, reason
        return (self._frame(now, Stop()),) * STOP_REPEATS

    def require_link(self) -> None:
        """Passes while nothing has ended the link.

        Raises:
          LinkLost: With the reason.
        """
        if self.state is HostState.STOPPED:
            raise LinkLost(self.reason)

    # --- what comes from the device, and from time alone

    def on_frame(self, now: float, frame: Frame) -> tuple[Frame, ...]:
        """What must be sent because of a frame: a stop, or nothing."""
        message = frame.message
        if self.expected.keyed and not frame.authentic:
            self.dropped += 1
        elif isinstance(message, Capabilities):
            return self._on_capabilities(now, frame, message)
        elif isinstance(message, Fault) and message.code is FaultCode.BUSY and frame.session == 0:
            if self.state is HostState.ASKING:
                return self.stop(now, "another host has the armed device")
            self.dropped += 1
        elif self.session == 0 or frame.session != self.session or not self.arrivals.take(frame.sequence):
            self.dropped += 1
        elif isinstance(message, Telemetry):
            return self._on_telemetry(now, frame, message)
        elif isinstance(message, Fault):
            self.fault = message
            if self.state in _MOVING:
                return self.stop(now, format_fault(message))
        elif isinstance(message, Pong):
            self.clock.answered(message.nonce, now, 1e-6 * frame.time)
        else:
            self.dropped += 1
        return ()

    def check(self, now: float) -> tuple[Frame, ...]:
        """The rules that time alone can break, to be called every period: a stop, or nothing."""
        if self.state not in _MOVING or self.expected.lock_step or self.reading is None:
            return ()
        age = now - self.reading.sampled
        if age > STALE_TELEMETRY_AGE:
            return self.stop(now, f"the newest telemetry is {1e3 * age:.1f} ms old")
        if self.arrivals.lost >= MAX_LOST_FRAMES:
            return self.stop(now, f"{self.arrivals.lost} of the last {LOSS_WINDOW} frames were lost")
        if (
            self.state is HostState.ARMED
            and self._waiting
            and now - self._waiting[0][1] > ACKNOWLEDGE_TIMEOUT
        ):
            waited = 1e3 * (now - self._waiting[0][1])
            return self.stop(now, f"a command has not been acknowledged for {waited:.1f} ms")
        return ()

    def _on_capabilities(self, now: float, frame: Frame, found: Capabilities) -> tuple[Frame, ...]:
        if found.nonce != self._nonce or self.state in (HostState.IDLE, HostState.STOPPED):
            self.dropped += 1
        elif self.state is HostState.ASKING:
            self._begin(frame.session)
            self.arrivals.take(frame.sequence)
            self.capabilities, self._layout = found, (len(found.channels), counts_mask(found.channels))
            words = describe_mismatch(self.expected, found) if frame.session else "it gives no session"
            words = words if frame.same_schema else "it lays out its messages otherwise (schema)"
            if words:
                return self.stop(now, f"this is not the device that was expected: {words}")
            self.state = HostState.CONNECTED
        elif (frame.session, found) != (self.session, self.capabilities):
            return self.stop(now, "the device has begun another session: it has restarted")
        else:
            self.arrivals.take(frame.sequence)  # hello had been sent twice
        return ()

    def _on_telemetry(self, now: float, frame: Frame, telemetry: Telemetry) -> tuple[Frame, ...]:
        if (len(telemetry.raw), telemetry.counts) != self._layout:
            self.dropped += 1
            words = "its telemetry has other channels than its capabilities"
            return () if self.state is HostState.STOPPED else self.stop(now, words)
        sampled = min(now, 1e-6 * frame.time - self.clock.offset) if self.clock.known else now
        if now - sampled > STALE_TELEMETRY_AGE and not self.expected.lock_step:
            self.dropped += 1  # too late to be believed; `check` sees the one before
            return ()
        self.reading = Reading(telemetry, frame.sequence, frame.time, sampled, now)
        while self._waiting and self._waiting[0][0] <= telemetry.acknowledged:
            self._waiting.popleft()
        if self.state not in _MOVING:
            return ()
        if Status.FAULT in telemetry.status:
            return self.stop(now, f"the device has a fault: {_format_fault_code(telemetry.fault)}")
        if Status.ARMED in telemetry.status:
            self.state = HostState.ARMED
        elif self.state is HostState.ARMED:
            return self.stop(now, "the device is no longer armed")
        return ()

    def _require(self, *states: HostState) -> None:
        self.require_link()
        if self.state not in states:
            raise LinkLost(f"there is no session: {self.state.value}")

    def _frame(self, now: float, message: Message) -> Frame:
        self._sequence += 1
        return Frame(message, self.session, self._sequence, round(now * 1e6), self.expected.keyed)


_MOVING = (HostState.ARMING, HostState.ARMED)
_IN_SESSION = (HostState.CONNECTED, HostState.ARMING, HostState.ARMED)


def format_fault(fault: Fault) -> str:
    """A device's fault in words."""
    where = f" at wheel {fault.wheel}" if fault.wheel else ""
    numbers = "" if math.isnan(fault.value) else f" ({fault.value:g}, limit {fault.limit:g})"
    return f"the device says: {_format_fault_code(fault.code)}{where}{numbers}"


def _format_fault_code(code: FaultCode) -> str:
    return code.name.lower().replace("_", " ")
