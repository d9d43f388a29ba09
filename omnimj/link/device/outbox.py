"""Frames that a device is about to send, numbered within the session, and the times of recent telemetries."""

from __future__ import annotations

import math
from collections import deque

from omnimj.link.codec.messages import Challenge, Fault, FaultCode, Frame, Message, Telemetry
from omnimj.link.device.limits import Refusal

_MASK = 2**32 - 1


class Outbox:
    """Queue of frames to send, numbered within the session, with the times of recent telemetries."""

    def __init__(self, keyed: bool, remembered: int = 256):
        """Start without a session, in which nothing is sent.

        Args:
          keyed: Whether frames are to be tagged.
          remembered: Number of telemetries whose times are kept.
        """
        self._keyed, self._remembered = keyed, remembered
        self._queue: list[Frame] = []
        self.start_session(0)

    def start_session(self, session: int) -> None:
        """Begin a session (0: none), with frame numbers from 1."""
        self.session, self._sequence = session, 0
        self._telemetry_times: deque[tuple[int, float]] = deque(maxlen=self._remembered)

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

    def put_challenge(self, now: float, challenge: Challenge) -> None:
        """Queue the answer to a hello, outside of any session."""
        self._queue.append(self._frame(now, challenge, 0, 0))

    def put_busy(self, now: float, nonce: int) -> None:
        """Queue the answer to a hello while another host drives, bound to its nonce."""
        busy = Fault(FaultCode.BUSY, 0, 0.0, 0.0, nonce & _MASK, latched=False)
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

    @property
    def sequence(self) -> int:
        """Number of frames queued in this session."""
        return self._sequence

    def telemetry_age(self, now: float, sequence: int) -> float:
        """Age of the telemetry with this sequence number [s]; infinite if it is unknown."""
        times = reversed(self._telemetry_times)
        return next((now - time for number, time in times if number == sequence), math.inf)

    def _frame(self, now: float, message: Message, session: int, sequence: int) -> Frame:
        return Frame(message, session, sequence, round(now * 1e6), self._keyed)
