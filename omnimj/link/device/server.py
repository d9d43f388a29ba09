"""Server of an emulated device on a wire: addressing of answers, and periods in real time."""

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
"""Silence after which an armed device in lock-step accepts another host [s].

Simulated time, in which commands expire, does not advance meanwhile.
"""
_MAX_BACKLOG = 10  # periods; beyond this delay the missed ones are skipped


@dataclass
class PeriodStatistics:
    """Timing of the periods of a device in real time."""

    periods: int = 0
    missed: int = 0
    """Periods that began more than one period late."""
    skipped: int = 0
    """Periods that were skipped because the device was too far behind."""
    late: TimeHistogram = field(default_factory=TimeHistogram)
    """Delay of the beginning of each period."""

    def __str__(self) -> str:
        counts = f"{self.periods} periods, {self.missed} missed, {self.skipped} skipped"
        late = {name: f"{1e3 * value:.3g}" for name, value in self.late.as_record().items()}
        return f"{counts}; late by {late['p50']} ms (p50), {late['p99']} ms (p99), {late['max']} ms (max)"


class DeviceServer:
    """Server that passes frames between a listener and an emulated device."""

    def __init__(
        self,
        emulated: EmulatedDevice,
        listener: Listener,
        *,
        key: Key | None = None,
        clock: Callable[[], float] = time.monotonic,
    ):
        """Prepare to serve; the caller closes the listener.

        Args:
          emulated: Device, keyed if there is a key.
          listener: Listener on the wire of the device.
          key: Key of the link.
          clock: Monotonic clock with any origin [s].
        """
        self.emulated, self.drops, self.timing = emulated, DropCounts(), PeriodStatistics()
        self.frames = 0
        """Number of received frames."""
        self._listener, self._key, self._clock = listener, key, clock
        self._host: Peer = None
        self._begin = clock()
        self._last_heard, self._next = self._begin, self._begin
        self._config = emulated.device.config

    def run(self, goes_on: Callable[[], bool]) -> None:
        """Serve as long as `goes_on()` is true, which is evaluated at least ten times per second."""
        gc.collect()
        gc.freeze()  # a full garbage collection takes as long as many periods
        try:
            self._next = self._clock() + self._config.period
            while goes_on():
                self.serve_once(0.05)
        finally:
            gc.unfreeze()

    def serve_once(self, longest: float) -> None:
        """Process received frames and, in real time, a due period; wait for either at most `longest` [s]."""
        now = self._clock()
        if self._config.lock_step:
            self._listener.wait(longest)
            self._receive()
            return
        self._receive()
        if now >= self._next:
            self._tick(now)
        wait = min(longest, self._next - self._clock())
        if wait > 0.0:
            self._listener.wait(wait)

    def _receive(self) -> None:
        device = self.emulated.device
        for packet, peer in self._listener.receive():
            now, frame = self._clock(), decode(packet, self._key)
            if isinstance(frame, DropReason):
                self.drops.add(frame)
                device.on_invalid_packet(self.emulated.time(now - self._begin))
                continue
            self.frames += 1
            self._release_silent_host(now, frame)
            session = device.session
            answers = self.emulated.on_frame(now - self._begin, frame)
            if device.session != session:
                self._host = peer  # the sender of a successful hello receives the answers
            if frame.session == device.session:
                self._last_heard = now
            self._send(answers, peer)

    def _tick(self, now: float) -> None:
        period, timing = self._config.period, self.timing
        late = now - self._next
        timing.periods += 1
        timing.missed += late > period
        timing.late.add(late)
        self._send(self.emulated.tick(now - self._begin), self._host)
        self._next += period
        behind = int((now - self._next) / period)
        if behind > _MAX_BACKLOG:
            timing.skipped += behind
            self._next += behind * period

    def _release_silent_host(self, now: float, frame: Frame) -> None:
        """Disarm for a new host in lock-step if the armed session has been silent for too long."""
        is_hello = self._config.lock_step and isinstance(frame.message, Hello)
        if is_hello and self.emulated.device.armed and now - self._last_heard > SILENT_HOST_TIMEOUT:
            self.emulated.on_frame(0.0, Frame(Stop(), 0, 0, 0))

    def _send(self, answers: tuple[Frame, ...], peer: Peer) -> None:
        for answer in answers:
            to = peer if answer.session == 0 else self._host
            self._listener.send(encode(answer, self._key), to)
