"""Connection of a host to a transport: sending, receiving, and waiting for answers.

`connect` finds the device, verifies its configuration and waits for telemetry; it does not arm.
"""

from __future__ import annotations

import enum
import math
import secrets
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from omnimj.errors import LinkLost, NoAnswer
from omnimj.link.calibration import device_config, require_hardware
from omnimj.link.codec.frames import decode, encode
from omnimj.link.codec.key import Key, SessionKeys, read_key
from omnimj.link.codec.layout import PROTOCOL, DropCounts, DropReason
from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    Command,
    Frame,
    Hello,
    Ping,
    Reset,
    Status,
    Stop,
)
from omnimj.link.device.limits import MAX_TELEMETRY_AGE, is_zero_command
from omnimj.link.device.state_machine import SESSION_TIMEOUT
from omnimj.link.host.frame_log import FrameLog
from omnimj.link.host.state_machine import MAX_LOST_FRAMES, Host, HostState, Reading
from omnimj.link.quality import LOSS_WINDOW
from omnimj.link.transport.address import Address, SerialAddress, parse_address
from omnimj.link.transport.interface import PassiveTransport, Transport, waiting_time
from omnimj.link.transport.serial_port import SerialTransport
from omnimj.link.transport.udp import UdpListener, UdpTransport
from omnimj.parameters.robot import Robot

ANSWER_TIMEOUT = 2.0
"""Time within which a device must answer a request [s]."""
_REQUEST_INTERVAL = 0.05  # [s] between repeated requests in real time
_FIRST_RETRY, _LAST_RETRY, _MAX_TRIES = 0.05, 1.0, 10  # [s], [s]: waits for an answer in lock-step
_MAX_BATCHES = 16  # of packets per call, so that a flood cannot delay the caller for long
_PINGS = 8
_PING_INTERVAL = 0.1  # [s]: clocks that differ by 1e-4 drift apart by 0.01 ms within it


class LinkMode(enum.Enum):
    """Frames that a link may send."""

    DRIVE = "drive"
    DRY_RUN = "dry run"
    """Hello, ping and zero commands; the device is never armed."""
    READONLY = "readonly"
    """Nothing; the link listens to what the device sends to another host or its monitor."""

    def permits(self, frame: Frame) -> bool:
        """True if a frame may be sent."""
        if self is not LinkMode.DRY_RUN:
            return self is LinkMode.DRIVE
        message = frame.message
        return isinstance(message, Hello | Ping) or (
            isinstance(message, Command) and is_zero_command(message)
        )


class Link:
    """Host on a transport."""

    def __init__(
        self,
        host: Host,
        transport: Transport,
        *,
        key: Key | None = None,
        mode: LinkMode = LinkMode.DRIVE,
        log: FrameLog | None = None,
        name: str = "the device",
        clock: Callable[[], float] = time.monotonic,
    ):
        """Prepare the link; nothing is sent.

        Args:
          host: State machine of the host, keyed if there is a key.
          transport: Transport, closed by `close`.
          key: Key of the link.
          mode: Frames that may be sent.
          log: Log of all frames, closed by `close`.
          name: Name of the device in messages.
          clock: Monotonic clock [s].
        """
        self.host, self.mode, self.name = host, mode, name
        self.drops = DropCounts()
        """Dropped packets by reason."""
        self.sent, self.received, self.resent = 0, 0, 0
        """Numbers of sent, received and repeated frames."""
        self._transport, self._log, self._clock = transport, log, clock
        self._keys = None if key is None else SessionKeys(key, lambda: host.connection)
        self._has_armed, self._next_ping, self._last_sent = False, 0.0, -math.inf

    @property
    def now(self) -> float:
        """Time of the host's clock [s]."""
        return self._clock()

    @property
    def reading(self) -> Reading:
        """Newest reading.

        Raises:
          LinkLost: There is none yet.
        """
        if self.host.reading is None:
            raise LinkLost("there is no telemetry yet")
        return self.host.reading

    @property
    def capabilities(self) -> Capabilities | None:
        """Capabilities of the device; None before it has sent them."""
        return self.host.capabilities

    @property
    def dropped(self) -> int:
        """Number of dropped packets and frames, for any reason."""
        return self.drops.total + self._transport.drops.total + self.host.dropped

    @property
    def is_keyed(self) -> bool:
        """True if frames are authenticated."""
        return self._keys is not None

    def send(self, *frames: Frame) -> None:
        """Send frames that the mode permits.

        A stop is sent only if this link has requested arming: the device would obey it even while another
        host drives.
        """
        for frame in frames:
            if not self.mode.permits(frame) or (isinstance(frame.message, Stop) and not self._has_armed):
                continue
            self._has_armed = self._has_armed or isinstance(frame.message, Arm)
            packet, now = encode(frame, self._keys), self.now
            self._last_sent = now
            self._transport.send(packet)
            self.sent += 1
            if self._log is not None:
                self._log.sent(now, packet)

    def poll(self) -> None:
        """Process all received packets, up to a bound, and send the host's answers."""
        for _ in range(_MAX_BATCHES):
            packets = self._transport.receive()
            for packet in packets:
                self._take(packet)
            if not packets:
                return

    def _take(self, packet: bytes) -> None:
        """Process a received packet."""
        now, frame = self.now, decode(packet, self._keys)
        arrived = now - waiting_time(packet)
        if isinstance(frame, DropReason):
            self.drops.add(frame)
            self._refuse_version(frame, packet)
            if self._log is not None:
                self._log.dropped(arrived, packet)
            return
        self.received += 1
        if self._log is not None:
            self._log.received(arrived, packet)
        self.send(*self.host.on_frame(now, frame, arrived))

    def _refuse_version(self, reason: DropReason, packet: bytes) -> None:
        """End the request of a session if the device speaks another version of the protocol."""
        if reason is DropReason.PROTOCOL and self.host.state is HostState.ASKING:
            own = f"this host protocol {PROTOCOL}; the connection is refused"
            self.stop(f"{self.name} uses protocol {packet[0]}, {own}")

    def wait(self, until: float, holds: Callable[[], bool] = lambda: False) -> bool:
        """Process frames until `holds()` is true or the time `until` [s], applying the host's time limits.

        Returns:
          The last value of `holds()`.
        """
        while True:
            self.poll()
            now = self.now
            self.send(*self.host.check(now))
            if not self._transport.is_open and self.host.state is not HostState.IDLE:
                self.stop(f"{self.name}: the line is gone")
            if holds() or self.host.state is HostState.STOPPED:
                return holds()
            if now >= until:
                return False
            self._transport.wait(until - now)

    def listen(self, until: float, holds: Callable[[], bool]) -> bool:
        """Process frames until `holds()` or the time `until` [s], even after a stop, without time limits.

        Returns:
          The last value of `holds()`.
        """
        self.poll()
        while not holds():
            now = self.now
            if now >= until:
                return False
            self._transport.wait(until - now)
            self.poll()
        return True

    def connect(self) -> Capabilities:
        """Request a session, check the capabilities, measure the clock offset and wait for telemetry.

        In lock-step a zero command is sent, since there is no telemetry without a command. A passive link
        sends nothing and waits for the telemetry of another host's session.

        Raises:
          NoAnswer: The device does not answer.
          LinkLost: Another host drives the device, or it is not the expected device.
        """
        if self.host.state in (HostState.ARMING, HostState.ARMED):
            self.stop("a new session was requested")
        self._has_armed = False
        if self.mode is LinkMode.READONLY:
            return self._listen()
        if self.host.state is HostState.CONNECTED:
            self.host.hello(self.now)  # leaves the present session
        # a device with another key or of another protocol does not answer at all
        key = "has another key or none" if self.is_keyed else "wants a key"
        failure = f"does not answer: it is not connected, {key}, or does not speak protocol {PROTOCOL}"
        self._request(self.host.hello, lambda: self.host.state is HostState.CONNECTED, failure)
        if self.host.expected.lock_step:
            self.exchange(self.zero())
        else:
            for k in range(_PINGS):
                answered = lambda k=k: self.host.clock.answers > k  # noqa: E731
                self._request(self.host.ping, answered, "does not answer a ping")
            self._request(None, lambda: self.host.reading is not None, "sends no recent telemetry")
        found = self.host.capabilities
        assert found is not None
        return found

    def _listen(self) -> Capabilities:
        """Wait for the telemetry of another host's session."""
        self.host.listen()
        failure = "is silent: a passive host hears what a device sends to its monitor while another drives it"
        self._request(None, lambda: self.host.reading is not None, failure)
        found = self.host.capabilities
        assert found is not None
        return found

    @property
    def is_idle(self) -> bool:
        """True if nothing has been sent for so long that a device in real time may have ended the session."""
        if self.mode is LinkMode.READONLY:
            return False
        return not self.host.expected.lock_step and self.now - self._last_sent > 0.5 * SESSION_TIMEOUT

    def refresh_clock(self) -> None:
        """Send a ping if one is due, to track the offset of the clocks; called every period in real time."""
        if self.now >= self._next_ping and self.mode is not LinkMode.READONLY:
            self._next_ping = self.now + _PING_INTERVAL
            self.send(self.host.ping(self.now))

    def zero(self) -> Frame:
        """Command of zero currents."""
        return self.host.command(self.now, (0.0,) * self.host.expected.wheels)

    def arm(self) -> Reading:
        """Send zero commands, arm, and return the first reading of the armed device.

        Raises:
          LinkLost: The device refuses, or does not report in time that it is armed.
        """
        self.host.require_link()
        if self.host.expected.lock_step:
            self.exchange(self.host.arm(self.now))
            return self.reading
        begin = next_request = self.now
        while self.host.state is not HostState.ARMED:
            # frames lost while the host was busy do not count against the link
            lost = self.host.arrivals.lost
            if self.now - begin > ANSWER_TIMEOUT:
                lossy = f"{lost} of the last {LOSS_WINDOW} frames were lost: the link is too bad for arming"
                self.stop(lossy if lost >= MAX_LOST_FRAMES else "the device does not report that it is armed")
            self.host.require_link()
            if self.now - self.reading.arrived <= MAX_TELEMETRY_AGE:  # older ones are refused as stale
                self.send(self.zero())
            if self.reading.telemetry.acknowledged and lost < MAX_LOST_FRAMES and self.now >= next_request:
                self.send(self.host.arm(self.now))
                next_request = self.now + _REQUEST_INTERVAL
            before = self.reading
            self.wait(
                self.now + self.host.expected.period,
                lambda before=before: self.host.state is HostState.ARMED and self.reading is not before,
            )
        return self.reading

    def reset(self) -> None:
        """Reset the device's latched stop and fault, which begins a new run; it stays disarmed.

        Raises:
          LinkLost: They remain.
        """
        if self.host.expected.lock_step:
            self.exchange(self.host.reset(self.now))
        else:
            self._request(self.host.reset, lambda: not self.is_latched, "keeps its fault", LinkLost)

    @property
    def is_latched(self) -> bool:
        """True if the newest reading shows a latched stop or fault."""
        return bool(self.reading.telemetry.status & (Status.FAULT | Status.STOPPED))

    def exchange(self, frame: Frame) -> Reading:
        """Send a frame in lock-step and return the reading that answers it; repeated until it arrives.

        Raises:
          LinkLost: The device refuses or does not answer.
        """
        host, message = self.host, frame.message

        def is_answered() -> bool:
            reading = host.reading
            if isinstance(message, Command):
                return reading is not None and reading.telemetry.acknowledged == frame.sequence
            if isinstance(message, Reset):
                return reading is not None and not self.is_latched
            return host.state is HostState.ARMED

        wait = _FIRST_RETRY
        for k in range(_MAX_TRIES):
            self.resent += k > 0
            self.send(frame)
            if self.wait(self.now + wait, is_answered) or host.state is HostState.STOPPED:
                break
            wait = min(2.0 * wait, _LAST_RETRY)
        else:
            self.stop(f"{self.name} does not answer after {_MAX_TRIES} attempts")
        host.require_link()
        return self.reading

    def stop(self, reason: str = "stop was requested") -> None:
        """Stop a device that this link drives; may be called at any time and repeatedly."""
        self.send(*self.host.stop(self.now, reason))

    def close(self) -> None:
        """Stop the device if this link drives it, and close the transport; may be called twice."""
        if self.host.state is not HostState.IDLE:
            self.stop("the link was closed")
        self._transport.close()
        if self._log is not None:
            self._log.close()

    def _request(
        self,
        ask: Callable[[float], Frame] | None,
        holds: Callable[[], bool],
        failure: str,
        error: type[LinkLost] = NoAnswer,
    ) -> None:
        """Repeat a request until `holds()` is true; after `ANSWER_TIMEOUT` stop and raise `error`."""
        until = self.now + ANSWER_TIMEOUT
        while not holds():
            if self.now >= until:
                reason = f"{self.name} {failure}"
                self.stop(reason)
                raise error(reason)
            if ask is not None:
                self.send(ask(self.now))
            self.wait(min(until, self.now + _REQUEST_INTERVAL), holds)
            self.host.require_link()


def open_link(
    address: str | Address,
    robot: Robot,
    *,
    key_file: Path | str | None = None,
    lock_step: bool = False,
    mode: LinkMode = LinkMode.DRIVE,
    log_to: Path | None = None,
    about: dict[str, Any] | None = None,
) -> Link:
    """Open a link to a device with the wiring of the robot's model file; nothing is sent.

    Args:
      address: `serial:DEVICE?baud=N` or `udp:HOST:PORT`; for a passive link the own address, at which the
        copies for the monitor of a device arrive.
      robot: Robot with [hardware].
      key_file: Key of the link; required beyond this machine.
      lock_step: Whether the device's time advances by one period per command instead of in real time.
      mode: Frames that may be sent.
      log_to: New file for the log of all frames.
      about: Description in the log, besides the address and the calibration's hash.

    Raises:
      InputError: No [hardware], a wrong address or key file, or a wire that cannot be opened.
    """
    where = parse_address(address, "--plant") if isinstance(address, str) else address
    key = None if key_file is None else read_key(key_file)
    period = 1.0 / robot.sensors.sample_rate
    hardware = require_hardware(robot)
    expected = device_config(hardware, period, lock_step=lock_step, keyed=key is not None)
    transport = _open_transport(where, key is not None, mode is LinkMode.READONLY)
    log = None
    if log_to is not None:
        facts = {"address": str(where), "calibration_hash": f"{expected.calibration_hash:016x}"}
        log = FrameLog(log_to, {"plant": "uto_robot", **facts, "mode": mode.value, **(about or {})})
    host = Host(expected, lambda: secrets.randbits(64))
    return Link(host, transport, key=key, mode=mode, log=log, name=str(where))


def _open_transport(where: Address, keyed: bool, passive: bool) -> Transport:
    if isinstance(where, SerialAddress):
        return SerialTransport(where, passive=passive)
    return PassiveTransport(UdpListener(where, keyed)) if passive else UdpTransport(where, keyed)
