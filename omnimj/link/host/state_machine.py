"""Host side of the link as a state machine without clock and wire.

Motion takes three requests: hello, arm, command. A violation of any rule ends in `STOPPED` with its reason;
all three must then be requested again. The host accepts nothing impossible: an acknowledgement of what
it has not sent, a device armed without a request, time that runs backwards, or the answer of another device.
"""

from __future__ import annotations

import enum
import math
import struct
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from omnimj.errors import LinkLost
from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    Challenge,
    Command,
    Fault,
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
from omnimj.link.device.config import DeviceConfig, describe_mismatch, limits_hash
from omnimj.link.device.limits import MAX_TELEMETRY_AGE, round_to_float32
from omnimj.link.quality import LOSS_WINDOW, ClockOffset, LossCounter

MAX_LOST_FRAMES = 5
"""Number of lost frames among the last 20 of the device at which the host stops."""
ACKNOWLEDGE_TIMEOUT = 0.040
"""Age of the oldest unacknowledged command at which the host stops [s]; later ones acknowledge it too."""
COMMAND_VALIDITY = 0.050
"""Default lifetime of a command [s]."""
STOP_REPEATS = 3
"""Number of copies in which a stop is sent."""
MAX_REFUSALS, REFUSAL_WINDOW = 3, 1.0
"""Number of transient refusals within this time at which the host stops [s]."""
TRANSIENT = frozenset(
    (FaultCode.STALE, FaultCode.NOT_ARMED, FaultCode.ARM_NOT_ZERO, FaultCode.ARM_STALE_TELEMETRY)
)
"""Refusals that a delayed or lost frame explains."""
_CONNECTION = struct.Struct("<QQQ")
_MAX_PENDING = 1024  # commands that wait for an acknowledgement


class HostState(enum.Enum):
    """State of the host; the values appear in messages."""

    IDLE = "no session has been requested"
    LISTENING = "passive: only another host's session is heard"
    ASKING = "hello has been sent"
    CONNECTED = "the session stands"
    ARMING = "arm has been sent"
    ARMED = "the device reports that it is armed"
    STOPPED = "stopped"


_MOVING = (HostState.ARMING, HostState.ARMED)
_IN_SESSION = (HostState.CONNECTED, HostState.ARMING, HostState.ARMED)


@dataclass(frozen=True, slots=True)
class Reading:
    """Telemetry with its times on the host's clock."""

    telemetry: Telemetry
    sequence: int
    time: int
    """Time of the device's clock [µs]."""
    sampled: float
    """Time of sampling by the clocks' offset; time of arrival while the offset is unknown [s]."""
    arrived: float
    """Time of arrival [s]."""


class Host:
    """State machine for one device; its methods return the frames to send."""

    def __init__(self, expected: DeviceConfig, new_nonce: Callable[[], int]):
        """Start idle.

        Args:
          expected: Configuration that the device must have; if keyed, only authentic frames are accepted.
          new_nonce: Returns 64 fresh random bits.
        """
        self.expected, self._new_nonce = expected, new_nonce
        self.state, self.reason = HostState.IDLE, ""
        self.fault: Fault | None = None
        """Last fault that the device reported."""
        self.dropped = 0
        """Number of frames that were of another session, repeated, outdated or not authentic."""
        self._hashes = limits_hash(round_to_float32(expected.limits)), expected.calibration_hash
        self._nonce, self._cookie, self._device = 0, 0, 0
        self._identity = expected.identity
        self._start_session(0)

    def _start_session(self, session: int) -> None:
        self.session, self._sequence = session, 0
        self.reading: Reading | None = None
        """Newest reading."""
        self.arrivals, self.clock = LossCounter(), ClockOffset()
        self._pending: deque[tuple[int, float]] = deque(maxlen=_MAX_PENDING)
        self.capabilities: Capabilities | None = None
        """Capabilities of the device, once it has sent them."""
        self._layout = 0, 0
        self._refusals: deque[float] = deque(maxlen=MAX_REFUSALS)
        self._commanded = 0

    @property
    def connection(self) -> bytes:
        """Device's identity, nonce and cookie of the present connection, from which its key is derived."""
        return _CONNECTION.pack(self._device, self._nonce, self._cookie)

    def hello(self, now: float) -> Frame:
        """Request a session; repeated requests carry the same nonce and the newest cookie.

        Raises:
          LinkLost: The device is being driven; it must be stopped first.
        """
        if self.state in _MOVING:
            raise LinkLost("the device is being driven: stop first")
        if self.state is not HostState.ASKING:
            self._nonce, self._cookie, self._device = self._new_nonce(), 0, 0
            self._start_session(0)
            self.state, self.reason, self.fault = HostState.ASKING, "", None
        return self._frame(now, Hello(self._nonce, self._cookie, self._device))

    def listen(self) -> None:
        """Listen to the session of another host, whose challenge and capabilities the device repeats."""
        self._start_session(0)
        self.state, self.reason, self.fault = HostState.LISTENING, "", None

    def ping(self, now: float) -> Frame:
        """Request the time of the device's clock."""
        self._require(*_IN_SESSION)
        nonce = self._new_nonce()
        self.clock.sent(nonce, now)
        return self._frame(now, Ping(nonce))

    def arm(self, now: float) -> Frame:
        """Request arming; may be repeated until the device reports that it is armed.

        Raises:
          LinkLost: There is no session, or no telemetry yet.
        """
        newest = self._newest_sequence()
        if self.state is HostState.CONNECTED:
            self.state = HostState.ARMING
        return self._frame(now, Arm(*self._hashes, newest))

    def command(
        self, now: float, currents: Sequence[float], brake: int = 0, valid_for: float = COMMAND_VALIDITY
    ) -> Frame:
        """Command currents; nonzero ones only while armed.

        Args:
          now: Time [s].
          currents: At the amplifiers' own signs, shape (n,) [A].
          brake: Bit i−1: short the motor of wheel i.
          valid_for: Lifetime of the command [s].

        Raises:
          LinkLost: There is no session, or the device is not armed.
        """
        self._require(*_IN_SESSION)
        if self.state is not HostState.ARMED and (brake != 0 or any(current != 0.0 for current in currents)):
            raise LinkLost("the device is not armed")
        answered = 0 if self.reading is None else self.reading.sequence
        frame = self._frame(now, Command(tuple(currents), valid_for, brake, answered))
        self._commanded = frame.sequence
        self._pending.append((frame.sequence, now))
        return frame

    def reset(self, now: float) -> Frame:
        """Reset the device's latched stop and fault as the newest reading shows them; it stays disarmed.

        Raises:
          LinkLost: There is no session, or no telemetry yet.
        """
        return self._frame(now, Reset(self._newest_sequence()))

    def stop(self, now: float, reason: str = "stop was requested") -> tuple[Frame, ...]:
        """Stop: three copies of the frame; allowed at any time and repeatedly, the first reason is kept."""
        if self.state is not HostState.STOPPED:
            self.state, self.reason = HostState.STOPPED, reason
        return (self._frame(now, Stop()),) * STOP_REPEATS

    def require_link(self) -> None:
        """Check that the link has not ended.

        Raises:
          LinkLost: The link has ended; the message contains the reason.
        """
        if self.state is HostState.STOPPED:
            raise LinkLost(self.reason)

    def on_frame(self, now: float, frame: Frame, arrived: float | None = None) -> tuple[Frame, ...]:
        """Process a frame of the device and return the frames to send: a stop, a hello, or none.

        Args:
          now: Time [s].
          frame: Frame of the device.
          arrived: Time at which the frame reached the socket [s]; `now` if None.
        """
        message, arrived = frame.message, now if arrived is None else arrived
        if self.expected.keyed and not frame.authentic:
            self.dropped += 1
        elif isinstance(message, Challenge):
            return self._on_challenge(now, message)
        elif isinstance(message, Capabilities):
            return self._on_capabilities(now, frame, message)
        elif isinstance(message, Fault) and message.code is FaultCode.BUSY and frame.session == 0:
            if self.state is HostState.ASKING and message.sequence == self._nonce & 0xFFFFFFFF:
                return self.stop(now, "another host has the armed device")
            self.dropped += 1
        elif self.session == 0 or frame.session != self.session or not self.arrivals.take(frame.sequence):
            self.dropped += 1
        elif isinstance(message, Telemetry):
            return self._on_telemetry(now, frame, message, arrived)
        elif isinstance(message, Fault):
            return self._on_fault(now, message)
        elif isinstance(message, Pong):
            self.clock.answered(message.nonce, arrived, 1e-6 * frame.time)
        else:
            self.dropped += 1
        return ()

    def check(self, now: float) -> tuple[Frame, ...]:
        """Check the time limits, once per period, and return the frames to send: a stop, or none."""
        if self.state not in _MOVING or self.expected.lock_step or self.reading is None:
            return ()
        age = now - self.reading.sampled
        if age > MAX_TELEMETRY_AGE:
            return self.stop(now, f"the newest telemetry is {1e3 * age:.1f} ms old")
        if self.arrivals.lost >= MAX_LOST_FRAMES:
            return self.stop(now, f"{self.arrivals.lost} of the last {LOSS_WINDOW} frames were lost")
        if (
            self.state is HostState.ARMED
            and self._pending
            and now - self._pending[0][1] > ACKNOWLEDGE_TIMEOUT
        ):
            waited = 1e3 * (now - self._pending[0][1])
            return self.stop(now, f"a command has not been acknowledged for {waited:.1f} ms")
        return ()

    def _on_challenge(self, now: float, found: Challenge) -> tuple[Frame, ...]:
        """Return the cookie to the device, which must be the one that was met before."""
        listens = self.state is HostState.LISTENING
        if not listens and (self.state is not HostState.ASKING or found.nonce != self._nonce):
            # a device repeats the challenge of the present session for passive listeners
            is_own = (found.device, found.nonce, found.cookie) == (self._device, self._nonce, self._cookie)
            self.dropped += not is_own
            return ()
        if self._identity not in (0, found.device):
            reason = f"another device answers: {found.device:016x} instead of {self._identity:016x}"
            return self.stop(now, reason)
        self._nonce, self._cookie, self._device = found.nonce, found.cookie, found.device
        return () if listens else (self.hello(now),)

    def _on_fault(self, now: float, fault: Fault) -> tuple[Frame, ...]:
        """Stop while moving, but not at once for a refusal that a late frame explains."""
        self.fault = fault
        if self.state not in _MOVING:
            return ()
        if fault.code in TRANSIENT and not fault.latched and not self.expected.lock_step:
            self._refusals.append(now)
            if len(self._refusals) < MAX_REFUSALS or now - self._refusals[0] > REFUSAL_WINDOW:
                return ()
        return self.stop(now, format_fault(fault))

    def _on_capabilities(self, now: float, frame: Frame, found: Capabilities) -> tuple[Frame, ...]:
        heard = self.state is HostState.LISTENING and frame.session != self.session
        is_foreign = found.nonce != self._nonce and self.state is not HostState.LISTENING
        if is_foreign or self.state in (HostState.IDLE, HostState.STOPPED):
            self.dropped += 1
        elif self.state is HostState.ASKING or heard:
            self._start_session(frame.session)
            self._identity = self._device
            self.arrivals.newest = frame.sequence  # a listener may have joined late
            self.capabilities, self._layout = found, (len(found.channels), counts_mask(found.channels))
            mismatch = describe_mismatch(self.expected, found) if frame.session else "it gives no session"
            mismatch = mismatch if frame.same_schema else "its messages have another layout (schema)"
            if mismatch:
                return self.stop(now, f"this is not the device that was expected: {mismatch}")
            self.state = HostState.LISTENING if heard else HostState.CONNECTED
        elif (frame.session, found) != (self.session, self.capabilities):
            return self.stop(now, "the device has begun another session: it has restarted")
        else:
            self.arrivals.take(frame.sequence)  # repeated, for a hello or for passive listeners
        return ()

    def _on_telemetry(
        self, now: float, frame: Frame, telemetry: Telemetry, arrived: float
    ) -> tuple[Frame, ...]:
        if (len(telemetry.raw), telemetry.counts) != self._layout:
            self.dropped += 1
            reason = "its telemetry has other channels than its capabilities"
            return () if self.state is HostState.STOPPED else self.stop(now, reason)
        if reason := self._disbelief(frame, telemetry):
            self.dropped += 1
            return () if self.state is HostState.STOPPED else self.stop(now, reason)
        sampled = min(arrived, 1e-6 * frame.time - self.clock.offset) if self.clock.known else arrived
        if now - sampled > MAX_TELEMETRY_AGE and not self.expected.lock_step:
            self.dropped += 1  # outdated; `check` uses the previous one
            return ()
        self.reading = Reading(telemetry, frame.sequence, frame.time, sampled, arrived)
        while self._pending and self._pending[0][0] <= telemetry.acknowledged:
            self._pending.popleft()
        if self.state not in _MOVING:
            return ()
        if Status.FAULT in telemetry.status:
            return self.stop(now, f"the device has a fault: {_format_fault_code(telemetry.fault)}")
        if Status.ARMED in telemetry.status:
            self.state = HostState.ARMED
        elif self.state is HostState.ARMED:
            return self.stop(now, "the device is no longer armed")
        return ()

    def _disbelief(self, frame: Frame, telemetry: Telemetry) -> str:
        """Reason why a telemetry cannot be true; empty text if it can."""
        if telemetry.acknowledged > self._commanded and self.state is not HostState.LISTENING:
            return "it acknowledges a command that was not sent"
        if Status.ARMED in telemetry.status and self.state is HostState.CONNECTED:
            return "it is armed without a request"
        if self.reading is not None and frame.time < self.reading.time:
            return "its time runs backwards"
        return ""

    def _newest_sequence(self) -> int:
        self._require(*_IN_SESSION)
        if self.reading is None:
            raise LinkLost("there is no telemetry yet")
        return self.reading.sequence

    def _require(self, *states: HostState) -> None:
        self.require_link()
        if self.state not in states:
            raise LinkLost(f"there is no session: {self.state.value}")

    def _frame(self, now: float, message: Message) -> Frame:
        self._sequence += 1
        return Frame(message, self.session, self._sequence, round(now * 1e6), self.expected.keyed)


def format_fault(fault: Fault) -> str:
    """Describe a fault of the device in words."""
    where = f" at wheel {fault.wheel}" if fault.wheel else ""
    numbers = "" if math.isnan(fault.value) else f" ({fault.value:g}, limit {fault.limit:g})"
    return f"the device reports: {_format_fault_code(fault.code)}{where}{numbers}"


def _format_fault_code(code: FaultCode) -> str:
    return code.name.lower().replace("_", " ")
