"""What a device says: frames of its session, numbered as they leave, and when each telemetry did."""

from __future__ import annotations

import math
from collections import deque

from omnimj.hardware.device_limits import Refusal
from omnimj.hardware.messages import Fault, FaultCode, Frame, Message, Telemetry

_REMEMBERED = 256  # telemetries: 20 ms at 10 kHz and some more
_MASK = 2**32 - 1


class Voice:
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

    def say_fault(self, now: float, refusal: Refusal, sequence: int, latched: bool) -> None:
        """Which rule was broken, by the frame with this number (0: by none)."""
        self.say(
            now, Fault(refusal.code, refusal.wheel, refusal.value, refusal.limit, sequence, latched=latched)
        )

    def say_busy(self, now: float) -> None:
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
