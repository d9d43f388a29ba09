"""What a link may send."""

from __future__ import annotations

import enum
import secrets
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from omnimj.errors import LinkLost
from omnimj.link.calibration import device_config, require_hardware
from omnimj.link.codec.frames import decode, encode
from omnimj.link.codec.key import Key, read_key
from omnimj.link.codec.layout import DropCounts, DropReason
from omnimj.link.codec.messages import Arm, Capabilities, Command, Frame, Hello, Ping, ResetFault, Stop
from omnimj.link.device.limits import is_zero_command
from omnimj.link.host.frame_log import FrameLog
from omnimj.link.host.state_machine import MAX_LOST_FRAMES, Host, HostState, Reading
from omnimj.link.quality import LOSS_WINDOW
from omnimj.link.transport.address import Address, SerialAddress, parse_address
from omnimj.link.transport.interface import Transport
from omnimj.link.transport.serial_port import SerialTransport
from omnimj.link.transport.udp import UdpTransport
from omnimj.parameters.robot import Robot


class LinkMode(enum.Enum):
    """What a link may send."""

    DRIVE = "drive"
    DRY_RUN = "dry run"
    """Hello, ping, and commands of zero; it is never armed."""
    READONLY = "readonly"
    """Hello and ping: a device tells its readings to whoever began the session."""

    def permits(self, frame: Frame) -> bool:
        """Whether a frame may leave."""
        if self is LinkMode.DRIVE or isinstance(frame.message, Hello | Ping):
            return True
        return (
            self is LinkMode.DRY_RUN and isinstance(frame.message, Command) and is_zero_command(frame.message)
        )


# A host at its wire: sends what the host says, gives it what comes, and waits with an eye on the clock.

ANSWER_TIMEOUT = 2.0
"""How long a device may take to answer what it is asked for the first time [s]."""
_ASK_AGAIN = 0.05  # [s]
_AGAIN_FIRST, _AGAIN_LAST, _TIMES = 0.05, 1.0, 10  # [s], [s]: before a frame is sent again in lock-step
_PINGS = 8
_PING_EVERY = 0.1  # [s]: two clocks part by 0.01 ms in it, if one is off by 1e-4


class Link:
    """One host, one transport."""

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
        """Nothing is sent yet.

        Args:
          host: Keyed if there is a key.
          transport: Closed by `close`.
          key: Of this link.
          mode: What may be sent.
          log: Takes every frame; closed by `close`.
          name: For messages.
          clock: Monotonic [s].
        """
        self.host, self.mode, self.name = host, mode, name
        self.drops = DropCounts()
        """What came and was no frame."""
        self.sent, self.received, self.resent = 0, 0, 0
        """Frames."""
        self._transport, self._key, self._log, self._clock = transport, key, log, clock
        self._may_move, self._next_ping = False, 0.0

    @property
    def now(self) -> float:
        """Of the host's clock [s]."""
        return self._clock()

    @property
    def reading(self) -> Reading:
        """The newest.

        Raises:
          LinkLost: There is none.
        """
        if self.host.reading is None:
            raise LinkLost("there is no telemetry yet")
        return self.host.reading

    @property
    def capabilities(self) -> Capabilities | None:
        """What the device is; None before it has said so."""
        return self.host.capabilities

    @property
    def is_keyed(self) -> bool:
        """Whether every frame is signed."""
        return self._key is not None

    # --- frames out and in

    def send(self, *frames: Frame) -> None:
        """Sends, as far as the mode lets it through.

        A stop that the host sends by itself leaves only if this link has asked for motion: it would be obeyed
        although another host's robot drives.
        """
        for frame in frames:
            if not self.mode.permits(frame) or (isinstance(frame.message, Stop) and not self._may_move):
                continue
            self._may_move = self._may_move or isinstance(frame.message, Arm)
            packet, now = encode(frame, self._key), self.now
            self._transport.send(packet)
            self.sent += 1
            if self._log is not None:
                self._log.sent(now, packet)

    def poll(self) -> None:
        """Everything that has come; sends what the host says to it."""
        for packet in self._transport.receive():
            now, frame = self.now, decode(packet, self._key)
            if isinstance(frame, DropReason):
                self.drops.add(frame)
                if self._log is not None:
                    self._log.dropped(now, packet)
                continue
            self.received += 1
            if self._log is not None:
                self._log.received(now, packet)
            self.send(*self.host.on_frame(now, frame))

    def wait(self, until: float, holds: Callable[[], bool] = lambda: False) -> bool:
        """Takes what comes until something holds or the time is over [s]; the host's rules on time are asked.

        Returns:
          Whether it holds.
        """
        while True:
            self.poll()
            now = self.now
            self.send(*self.host.check(now))
            if holds() or self.host.state is HostState.STOPPED:
                return holds()
            if now >= until:
                return False
            self._transport.wait(until - now)

    def listen(self, until: float, holds: Callable[[], bool]) -> bool:
        """Takes what comes until something holds or the time is over [s], also after a stop; asks no rules.

        Returns:
          Whether it holds.
        """
        self.poll()
        while not holds():
            now = self.now
            if now >= until:
                return False
            self._transport.wait(until - now)
            self.poll()
        return True

    # --- what may be asked

    def connect(self) -> Capabilities:
        """Hello, capabilities, clock and first telemetry; nothing is armed.

        In lock-step there is no telemetry before a command, so a command of zero is sent.

        Raises:
          LinkLost: Nobody answers, somebody else drives it, or it is not the device that was expected.
        """
        if self.host.state in (HostState.ARMING, HostState.ARMED):
            self.stop("a new session is asked for")
        self._may_move = False
        # a device that has another key than this link says nothing, as one that is not there
        key = "has another key or none" if self.is_keyed else "wants a key"
        words = f"does not answer: it is not there, or {key}"
        self._ask(self.host.hello, lambda: self.host.state is HostState.CONNECTED, words)
        if self.host.expected.lock_step:
            self.exchange(self.zero())
        else:
            for k in range(_PINGS):
                self._ask(self.host.ping, lambda k=k: self.host.clock.answers > k, "does not answer a ping")
            self._ask(None, lambda: self.host.reading is not None, "sends no telemetry that is new enough")
        found = self.host.capabilities
        assert found is not None
        return found

    def refresh_clock(self) -> None:
        """A ping now and then, so that the offset of the clocks stays known; in real time once per period."""
        if self.now >= self._next_ping:
            self._next_ping = self.now + _PING_EVERY
            self.send(self.host.ping(self.now))

    def zero(self) -> Frame:
        """A command that asks for nothing."""
        return self.host.command(self.now, (0.0,) * self.host.expected.wheels)

    def arm(self) -> Reading:
        """Zero commands, then arm; the first telemetry that says that it is armed.

        Raises:
          LinkLost: The device refuses, with its reason, or does not say that it is armed.
        """
        self.host.require_link()
        if self.host.expected.lock_step:
            self.exchange(self.host.arm(self.now))
            return self.reading
        begin = asked = self.now
        while self.host.state is not HostState.ARMED:
            # who did not listen for a while has lost frames, which says nothing about the link from now on
            lost = self.host.arrivals.lost
            if self.now - begin > ANSWER_TIMEOUT:
                few = f"{lost} of the last {LOSS_WINDOW} frames were lost: it is not armed over such a link"
                self.stop(few if lost >= MAX_LOST_FRAMES else "the device does not say that it is armed")
            self.host.require_link()
            self.send(self.zero())
            if self.reading.telemetry.acknowledged and lost < MAX_LOST_FRAMES and self.now >= asked:
                self.send(self.host.arm(self.now))
                asked = self.now + _ASK_AGAIN
            before = self.reading
            self.wait(
                self.now + self.host.expected.period,
                lambda before=before: self.host.state is HostState.ARMED and self.reading is not before,
            )
        return self.reading

    def reset_fault(self) -> None:
        """Says that the device's fault has been seen; nothing moves by that.

        Raises:
          LinkLost: The fault stands.
        """
        if self.host.expected.lock_step:
            self.exchange(self.host.reset_fault(self.now))
        else:
            fault = lambda: self.reading.telemetry.fault == 0  # noqa: E731
            self._ask(self.host.reset_fault, fault, "keeps its fault")

    def exchange(self, frame: Frame) -> Reading:
        """Lock-step: one frame, and the telemetry that answers it; asked again as long as that is lost.

        Raises:
          LinkLost: The device refuses, or no answer comes.
        """
        host, message = self.host, frame.message

        def is_answered() -> bool:
            told = host.reading
            if isinstance(message, Command):
                return told is not None and told.telemetry.acknowledged == frame.sequence
            if isinstance(message, ResetFault):
                return told is not None and told.telemetry.fault == 0
            return host.state is HostState.ARMED

        wait = _AGAIN_FIRST
        for k in range(_TIMES):
            self.resent += k > 0
            self.send(frame)
            if self.wait(self.now + wait, is_answered) or host.state is HostState.STOPPED:
                break
            wait = min(2.0 * wait, _AGAIN_LAST)
        else:
            self.stop(f"{self.name} does not answer, though it was asked {_TIMES} times")
        host.require_link()
        return self.reading

    def stop(self, reason: str = "stop was asked for") -> None:
        """Ends what this link drives, by three stops; may be asked for at any time, again and again."""
        self.send(*self.host.stop(self.now, reason))

    def stop_any_host(self) -> None:
        """As `stop`, though another host's robot may stop by it: for a person with a finger on a key."""
        self._may_move = True
        self.stop()

    def close(self) -> None:
        """Stops what it drives and lets go of the wire; may be called twice."""
        if self.host.state is not HostState.IDLE:
            self.stop("the link was closed")
        self._transport.close()
        if self._log is not None:
            self._log.close()

    def _ask(self, ask: Callable[[float], Frame] | None, holds: Callable[[], bool], words: str) -> None:
        """Asks again and again until something holds."""
        until = self.now + ANSWER_TIMEOUT
        while not holds():
            if self.now >= until:
                words = f"{self.name} {words}"
                self.stop(words)
                raise LinkLost(words)
            if ask is not None:
                self.send(ask(self.now))
            self.wait(min(until, self.now + _ASK_AGAIN), holds)
            self.host.require_link()


# From an address to a link.


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
    """A link to the device at an address, which must be wired as the robot's model file says.

    Args:
      address: `serial:DEVICE?baud=N` or `udp:HOST:PORT`.
      robot: With [hardware].
      key_file: Of a link that may leave this machine.
      lock_step: As opposed to real time.
      mode: What may be sent.
      log_to: A new file for every frame.
      about: What the log says of itself, beside the address and the calibration's hash.

    Raises:
      InputError: No [hardware], a wrong address or key file, or a wire that cannot be opened.
    """
    where = parse_address(address, "--plant") if isinstance(address, str) else address
    key = None if key_file is None else read_key(key_file)
    period = 1.0 / robot.sensors.sample_rate
    hardware = require_hardware(robot)
    expected = device_config(hardware, period, lock_step=lock_step, keyed=key is not None)
    if isinstance(where, SerialAddress):
        transport: Transport = SerialTransport(where)
    else:
        transport = UdpTransport(where, key is not None)
    log = None
    if log_to is not None:
        facts = {"address": str(where), "calibration_hash": f"{expected.calibration_hash:016x}"}
        log = FrameLog(log_to, {"plant": "uto_robot", **facts, "mode": mode.value, **(about or {})})
    host = Host(expected, lambda: secrets.randbits(64))
    return Link(host, transport, key=key, mode=mode, log=log, name=str(where))
