"""Server of an emulated device on a wire: addressing of answers, and periods in real time."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from omnimj.link.codec.frames import decode, encode
from omnimj.link.codec.key import Key, SessionKeys
from omnimj.link.codec.layout import PROTOCOL, DropCounts, DropReason
from omnimj.link.codec.messages import Frame, Hello, MessageType
from omnimj.link.device.emulated import EmulatedDevice
from omnimj.link.quality import TimeHistogram
from omnimj.link.transport.interface import Listener, Peer

SILENT_HOST_TIMEOUT = 5.0
"""Silence after which an armed device in lock-step accepts another host [s].

Simulated time, in which commands expire, does not advance meanwhile.
"""
_MAX_BACKLOG = 10  # periods; beyond this delay the missed ones are skipped
_MAX_DRAINED = 4096  # packets taken from the socket at once
_MAX_OWN, _MAX_FOREIGN = 256, 64  # newest packets then processed, of the session's host and of others


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
        report: Callable[[str], object] = lambda line: None,
        monitor: Peer = None,
    ):
        """Prepare to serve; the caller closes the listener.

        Args:
          emulated: Device, keyed if there is a key.
          listener: Listener on the wire of the device.
          key: Key of the link.
          clock: Monotonic clock with any origin [s].
          report: Called with one line when the wire is gone or back, and once when a host speaks another
            version of the protocol.
          monitor: Address that gets a copy of every frame to the session's host, and from which nothing is
            accepted; none if None.
        """
        self.emulated, self.drops, self.timing = emulated, DropCounts(), PeriodStatistics()
        self.frames = 0
        """Number of received frames."""
        self._listener, self._clock, self._report = listener, clock, report
        self._keys = None if key is None else SessionKeys(key, lambda: emulated.device.connection)
        self._has_reported, self._was_open = False, True
        self._host: Peer = None
        self._monitor = monitor
        self._invalid = 0  # of the listener, counted so far
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
        """Process what has arrived: stops first, then the session's host, then the newest of others."""
        self._report_wire()
        for packet, peer in self._arrived():
            now, frame = self._clock(), decode(packet, self._keys)
            if isinstance(frame, DropReason):
                self._drop(now, frame, packet, peer)
                continue
            self.frames += 1
            self._release_silent_host(now, frame)
            device = self.emulated.device
            session = device.session
            answers = self.emulated.on_frame(now - self._begin, frame, _address(peer))
            if device.session != session:
                self._host = peer  # the sender of a successful hello receives the answers
            if frame.session == device.session:
                self._last_heard = now
            self._send(answers, peer)

    def _arrived(self) -> list[tuple[bytes, Peer]]:
        """Packets to process; under a flood the oldest of other senders than the host are dropped."""
        found: list[tuple[bytes, Peer]] = []
        while len(found) < _MAX_DRAINED and (batch := self._listener.receive()):
            found += batch
        stops = [one for one in found if is_stop(one[0])]
        own = [one for one in found if one[1] == self._host and not is_stop(one[0])]
        foreign = [one for one in found if one[1] != self._host and not is_stop(one[0])]
        left_out = max(0, len(own) - _MAX_OWN) + max(0, len(foreign) - _MAX_FOREIGN)
        invalid = self._listener.drops.total
        self._count_dropped(self._clock(), left_out + invalid - self._invalid)
        self._invalid = invalid
        return stops[-_MAX_OWN:] + own[-_MAX_OWN:] + foreign[-_MAX_FOREIGN:]

    def _count_dropped(self, now: float, number: int) -> None:
        if number:
            self.emulated.device.on_invalid_packet(self.emulated.time(now - self._begin), number)

    def _report_wire(self) -> None:
        """Report a wire that is gone or back; the device goes on, and ends the session of a silent host."""
        is_open = self._listener.is_open
        if is_open != self._was_open:
            self._was_open = is_open
            self._report("the line is back" if is_open else "the line is gone: waiting until it is back")

    def _drop(self, now: float, reason: DropReason, packet: bytes, peer: Peer) -> None:
        self.drops.add(reason)
        self._count_dropped(now, 1)
        if reason is DropReason.PROTOCOL and not self._has_reported:
            self._has_reported = True
            sender = "the host" if peer is None else f"the host at {peer}"
            own = f"this device protocol {PROTOCOL}; the connection is refused"
            self._report(f"{sender} uses protocol {packet[0]}, {own}")

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
        """End a session in lock-step for a new host if it has been silent for too long."""
        is_hello = self._config.lock_step and isinstance(frame.message, Hello) and frame.message.cookie != 0
        if is_hello and self.emulated.device.armed and now - self._last_heard > SILENT_HOST_TIMEOUT:
            self.emulated.device.end_session(self.emulated.time(now - self._begin))

    def _send(self, answers: tuple[Frame, ...], peer: Peer) -> None:
        for answer in answers:
            to = peer if answer.session == 0 else self._host
            packet = encode(answer, self._keys)
            self._listener.send(packet, to)
            if self._monitor is not None and to == self._host:
                self._listener.send(packet, self._monitor)


def is_stop(packet: bytes) -> bool:
    """True if a packet claims to be a stop; it may still be corrupt."""
    return len(packet) > 1 and packet[1] == MessageType.STOP


def _address(peer: Peer) -> bytes:
    """Bytes that identify a sender; empty on a wire with a single far end."""
    return b"" if peer is None else repr(peer).encode()
