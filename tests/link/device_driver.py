"""Drives a device in a test: the host's frames, a clock that is moved by hand, three wheels."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    Challenge,
    ChannelKind,
    Command,
    Fault,
    Frame,
    Hello,
    Limits,
    Message,
    Ping,
    Quantity,
    Raw,
    Reset,
    Telemetry,
)
from omnimj.link.device.config import DeviceConfig, limits_hash
from omnimj.link.device.state_machine import Device

LIMITS = Limits(
    current=1.5,
    current_rate=1024.0,
    continuous_current=0.5,
    heating=1.75,
    wheel_speed=40.0,
    message_rate=4000.0,
    valid_for=0.25,
)
IDENTITY = 0xD0D0_CAFE_0000_0001
PERIOD = 2.0**-10  # [s]: a power of two, so that sums of periods are exact
CALIBRATION_HASH = 0x1234_5678_9ABC_DEF0
CHANNELS = tuple(ChannelKind(Quantity.WHEEL_SPEED, wheel, Raw.VOLTS) for wheel in (1, 2, 3))
ZERO = (0.0, 0.0, 0.0)


class DeviceDriver:
    """Talks to a device as its host does; every frame of the device is kept in `received`."""

    def __init__(self, lock_step=False, keyed=False, limits=LIMITS, start=0.0, sessions=None, currents=None):
        self.keyed, self.now = keyed, start
        drawn = itertools.count(1001) if sessions is None else iter(sessions)
        commissioned = DeviceConfig(3, PERIOD, CHANNELS, limits, CALIBRATION_HASH, lock_step, keyed, IDENTITY)
        speeds, secret = lambda now, raw: tuple(raw), bytes(range(32))
        self.device = Device(
            commissioned, speeds, lambda: next(drawn), start, currents=currents, secret=secret
        )
        self.limits_hash = limits_hash(self.device.config.limits)
        self.sequence, self.session = 0, 0
        self.speeds, self.received = ZERO, []

    def frame(self, message: Message, **header) -> Frame:
        """A new frame of the host; the header may be another."""
        self.sequence += 1
        facts = {"session": self.session, "sequence": self.sequence, "time": 0, "authentic": self.keyed}
        return Frame(message, **{**facts, **header})

    def give(self, message: Message, peer=b"", **header) -> tuple[Frame, ...]:
        """Sends; what the device answers."""
        return self.deliver(self.frame(message, **header), peer)

    def deliver(self, frame: Frame, peer=b"") -> tuple[Frame, ...]:
        answer = self.device.on_frame(self.now, frame, peer)
        self.received += answer
        return answer

    def ask(self, nonce=7, peer=b"", **header) -> Hello:
        """The hello that returns the cookie of the challenge to a first one."""
        (answer,) = self.give(Hello(nonce), peer, **{"session": 0, **header})
        challenge = answer.message
        assert isinstance(challenge, Challenge)
        return Hello(nonce, challenge.cookie, challenge.device)

    def hello(self, nonce=7, peer=b"", **header) -> tuple[Frame, ...]:
        """Through the handshake; the answer to its second hello."""
        return self.enter(self.ask(nonce, peer, **header), peer, **header)

    def enter(self, hello: Hello, peer=b"", **header) -> tuple[Frame, ...]:
        """A hello with a cookie, and the session that it begins."""
        answer = self.give(hello, peer, **{"session": 0, **header})
        for frame in answer:
            if isinstance(frame.message, Capabilities):
                self.session, self.sequence = frame.session, 0
        return answer

    def begin(self, nonce=7) -> DeviceDriver:
        """Through the handshake and the first frame of the session, after which telemetry comes."""
        self.hello(nonce)
        self.give(Ping(0))
        return self

    def tick(self, speeds=None, periods=1) -> tuple[Frame, ...]:
        """So many periods later."""
        for _ in range(periods):
            self.now += PERIOD
            answer = self.device.tick(self.now, self.speeds if speeds is None else speeds)
            self.received += answer
        return answer

    @property
    def newest(self) -> int:
        """Sequence of the newest telemetry; 0: none."""
        numbers = (f.sequence for f in reversed(self.received) if isinstance(f.message, Telemetry))
        return next(numbers, 0)

    def command(self, currents=ZERO, valid_for=0.0625, brake=0, telemetry=None, **header):
        answered = self.newest if telemetry is None else telemetry
        return self.give(Command(currents, valid_for, brake, answered), **header)

    def arm(self, **changed) -> tuple[Frame, ...]:
        facts = {
            "limits_hash": self.limits_hash,
            "calibration_hash": CALIBRATION_HASH,
            "telemetry": self.newest,
        }
        return self.give(Arm(**{**facts, **changed}))

    def reset(self) -> tuple[Frame, ...]:
        """Reset what the newest telemetry shows."""
        return self.give(Reset(self.newest))

    def armed(self) -> DeviceDriver:
        """Through hello, telemetry, zero command and arm."""
        self.begin()
        self.tick()
        self.command()
        self.arm()
        assert self.device.armed
        return self

    def driving(self, currents=(0.5, -0.25, 0.125), **rest) -> DeviceDriver:
        """Armed, and currents flow."""
        self.armed()
        assert self.command(currents, **rest) == ()
        self.tick()
        assert self.device.output.currents == currents
        return self

    @property
    def telemetry(self) -> Telemetry:
        """The newest."""
        return next(f.message for f in reversed(self.received) if isinstance(f.message, Telemetry))


def faults(frames: Sequence[Frame]) -> list[Fault]:
    """Among the frames of the device."""
    return [f.message for f in frames if isinstance(f.message, Fault)]


def codes(frames: Sequence[Frame]) -> list:
    return [fault.code for fault in faults(frames)]


def with_limits(**changed) -> Limits:
    return dataclasses.replace(LIMITS, **changed)
