"""The emulated device at its wire: who gets which answer, and the clock of real time."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from omnimj.link.codec.frames import decode, encode
from omnimj.link.codec.key import Key
from omnimj.link.codec.layout import DropCounts, DropReason
from omnimj.link.codec.messages import Frame, Hello, Stop
from omnimj.link.device.emulated import EmulatedDevice
from omnimj.link.quality import TimeHistogram
from omnimj.link.transport.interface import Listener, Peer

SILENT_HOST_TIMEOUT = 5.0
"""Lock-step: an armed device that has heard nothing for so long [s] takes another host, since its own time,
by which commands grow old, stands still."""
_MAX_BACKLOG = 10  # periods behind: then those between are left out


@dataclass
class PeriodStatistics:
    """How a device in real time kept its periods."""

    periods: int = 0
    missed: int = 0
    """That began more than a period late."""
    skipped: int = 0
    """That were left out, since the device was too far behind."""
    late: TimeHistogram = field(default_factory=TimeHistogram)
    """Of the beginning of each period."""

    def __str__(self) -> str:
        words = f"{self.periods} periods, {self.missed} missed, {self.skipped} left out"
        told = {name: f"{1e3 * value:.3g}" for name, value in self.late.as_record().items()}
        return f"{words}; late by {told['p50']} ms (p50), {told['p99']} ms (p99), {told['max']} ms (max)"


class DeviceServer:
    """Frames from a listener to the device and back."""

    def __init__(
        self,
        emulated: EmulatedDevice,
        listener: Listener,
        *,
        key: Key | None = None,
        clock: Callable[[], float] = time.monotonic,
    ):
        """Nothing is heard yet; the caller closes the listener.

        Args:
          emulated: Keyed if there is a key.
          listener: Its wire.
          key: Of this link.
          clock: Monotonic, begins anywhere [s].
        """
        self.emulated, self.drops, self.kept = emulated, DropCounts(), PeriodStatistics()
        self.frames = 0
        """That came."""
        self._listener, self._key, self._clock = listener, key, clock
        self._host: Peer = None
        self._begin = clock()
        self._heard, self._next = self._begin, self._begin
        self._commissioned = emulated.device.commissioned

    def run(self, goes_on: Callable[[], bool]) -> None:
        """Serves as long as something holds, which is asked at least ten times per second."""
        gc.collect()
        gc.freeze()  # to look through all that is there takes as long as many periods
        try:
            self._next = self._clock() + self._commissioned.period
            while goes_on():
                self.turn(0.05)
        finally:
            gc.unfreeze()

    def turn(self, longest: float) -> None:
        """What has come, and in real time the period if it is due; waits for either, so long at most [s]."""
        now = self._clock()
        if self._commissioned.lock_step:
            self._listener.wait(longest)
            self._take()
            return
        self._take()
        if now >= self._next:
            self._tick(now)
        wait = min(longest, self._next - self._clock())
        if wait > 0.0:
            self._listener.wait(wait)

    def _take(self) -> None:
        device = self.emulated.device
        for packet, peer in self._listener.receive():
            now, frame = self._clock(), decode(packet, self._key)
            if isinstance(frame, DropReason):
                self.drops.add(frame)
                device.on_invalid_packet(self.emulated.time(now - self._begin))
                continue
            self.frames += 1
            self._leave_the_silent(now, frame)
            session = device.session
            answers = self.emulated.on_frame(now - self._begin, frame)
            if device.session != session:
                self._host = peer  # who begins a session hears its answers
            if frame.session == device.session:
                self._heard = now
            self._send(answers, peer)

    def _tick(self, now: float) -> None:
        period, kept = self._commissioned.period, self.kept
        late = now - self._next
        kept.periods += 1
        kept.missed += late > period
        kept.late.add(late)
        self._send(self.emulated.tick(now - self._begin), self._host)
        self._next += period
        behind = int((now - self._next) / period)
        if behind > _MAX_BACKLOG:
            kept.skipped += behind
            self._next += behind * period

    def _leave_the_silent(self, now: float, frame: Frame) -> None:
        """A host that was killed would keep the device for ever."""
        is_asked = self._commissioned.lock_step and isinstance(frame.message, Hello)
        if is_asked and self.emulated.device.armed and now - self._heard > SILENT_HOST_TIMEOUT:
            self.emulated.on_frame(0.0, Frame(Stop(), 0, 0, 0))

    def _send(self, answers: tuple[Frame, ...], peer: Peer) -> None:
        for answer in answers:
            to = peer if answer.session == 0 else self._host
            self._listener.send(encode(answer, self._key), to)
