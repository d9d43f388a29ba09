"""Drives a device in a test: the host's frames, a clock that is moved by hand, three wheels."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    ChannelKind,
    Command,
    Fault,
    Frame,
    Hello,
    Limits,
    Message,
    Quantity,
    Raw,
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
PERIOD = 2.0**-10  # [s]: a power of two, so that sums of periods are exact
CALIBRATION_HASH = 0x1234_5678_9ABC_DEF0
CHANNELS = tuple(ChannelKind(Quantity.WHEEL_SPEED, wheel, Raw.VOLTS) for wheel in (1, 2, 3))
ZERO = (0.0, 0.0, 0.0)


class DeviceDriver:
    """Talks to a device as its host does; every frame of the device is kept in `received`."""

    def __init__(self, lock_step=False, keyed=False, limits=LIMITS, start=0.0, sessions=None):
        self.keyed, self.now = keyed, start
        drawn = itertools.count(1001) if sessions is None else iter(sessions)
        commissioned = DeviceConfig(3, PERIOD, CHANNELS, limits, CALIBRATION_HASH, lock_step, keyed)
        self.device = Device(commissioned, lambda now, raw: tuple(raw), lambda: next(drawn), start)
        self.limits_hash = limits_hash(self.device.config.limits)
        self.sequence, self.session = 0, 0
        self.speeds, self.received = ZERO, []

    def frame(self, message: Message, **header) -> Frame:
        """A new frame of the host; the header may be another."""
        self.sequence += 1
        facts = {"session": self.session, "sequence": self.sequence, "time": 0, "authentic": self.keyed}
        return Frame(message, **{**facts, **header})

    def give(self, message: Message, **header) -> tuple[Frame, ...]:
        """Sends; what the device answers."""
        return self.deliver(self.frame(message, **header))

    def deliver(self, frame: Frame) -> tuple[Frame, ...]:
        answer = self.device.on_frame(self.now, frame)
        self.received += answer
        return answer

    def hello(self, nonce=7, **header) -> tuple[Frame, ...]:
        answer = self.give(Hello(nonce), **{"session": 0, **header})
        for frame in answer:
            if isinstance(frame.message, Capabilities):
                self.session, self.sequence = frame.session, 0
        return answer

    def tick(self, speeds=None, periods=1) -> tuple[Frame, ...]:
        """So many periods later."""
        for _ in range(periods):
            self.now += PERIOD
            answer = self.device.tick(self.now, self.speeds if speeds is None else speeds)
            self.received += answer
        return answer

    def command(self, currents=ZERO, valid_for=0.0625, brake=0, **header) -> tuple[Frame, ...]:
        return self.give(Command(currents, valid_for, brake), **header)

    def arm(self, **changed) -> tuple[Frame, ...]:
        sequences = [f.sequence for f in self.received if isinstance(f.message, Telemetry)]
        facts = {
            "limits_hash": self.limits_hash,
            "calibration_hash": CALIBRATION_HASH,
            "telemetry": sequences[-1] if sequences else 0,
        }
        return self.give(Arm(**{**facts, **changed}))

    def armed(self) -> DeviceDriver:
        """Through hello, telemetry, zero command and arm."""
        self.hello()
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
