"""Emulated devices for tests: behind UDP, behind a pseudo-terminal, and on a wire in simulated time."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import os
import select
import socket
import threading
from collections.abc import Iterator
from typing import Any

from simulated_wire import SimulatedWire, WireFaults

from omnimj.link.calibration import device_config, require_hardware
from omnimj.link.codec.key import Key
from omnimj.link.codec.layout import DropCounts
from omnimj.link.codec.stream import PacketStream, stuff
from omnimj.link.device.emulated import EmulatedDevice
from omnimj.link.device.server import DeviceServer
from omnimj.link.host.link import Link, LinkMode
from omnimj.link.host.plant import HardwarePlant
from omnimj.link.host.state_machine import Host
from omnimj.link.transport.address import UdpAddress
from omnimj.link.transport.interface import SinglePeerListener
from omnimj.link.transport.udp import UdpListener
from omnimj.parameters import read_robot
from omnimj.plant.interface import Plant
from omnimj.plant.planar import PlanarRobot

ROBOT = read_robot()
WIRING = require_hardware(ROBOT)
PERIOD = 1.0 / ROBOT.sensors.sample_rate


def planar(**changed: Any) -> PlanarRobot:
    return PlanarRobot(ROBOT, "natural_stone", seed=3, **changed)


class Terminal:
    """The device's end of a pseudo-terminal; the host opens `path`."""

    def __init__(self):
        self._far, near = os.openpty()
        self.path = os.ttyname(near)
        self._near = near  # kept open, or the terminal ends with the host
        os.set_blocking(self._far, False)
        import tty

        tty.setraw(near)
        self._stream = PacketStream()
        self.failures, self.drops, self.is_open = 0, self._stream.drops, True

    def send(self, packet: bytes) -> None:
        try:
            os.write(self._far, stuff(packet))
        except OSError:
            self.failures += 1

    def receive(self) -> list[bytes]:
        try:
            return self._stream.feed(os.read(self._far, 65536))
        except OSError:
            return []

    def wait(self, longest: float) -> bool:
        return bool(select.select([self._far], [], [], longest)[0])

    def close(self) -> None:
        os.close(self._far)
        os.close(self._near)


@contextlib.contextmanager
def served(
    plant: Plant, kind: str, lock_step: bool = True, key: Key | None = None, **wrong: Any
) -> Iterator[str]:
    """A device in a thread of its own, with a key or wired wrongly if need be; its address."""
    if kind == "serial":
        terminal = Terminal()
        listener: Any = SinglePeerListener(terminal)
        address = f"serial:{terminal.path}"
    else:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        listener = UdpListener(UdpAddress("127.0.0.1", port))
        address = f"udp:127.0.0.1:{port}"
    sessions = itertools.count(1)
    device = EmulatedDevice(
        plant, WIRING, lambda: next(sessions), lock_step=lock_step, keyed=key is not None, **wrong
    )
    server = DeviceServer(device, listener, key=key)
    goes_on = threading.Event()
    thread = threading.Thread(target=server.run, args=(lambda: not goes_on.is_set(),))
    thread.start()
    try:
        yield address
    finally:
        goes_on.set()
        thread.join()
        listener.close()


class World:
    """A host, a wire and a device, whose one clock goes on when the host waits."""

    QUANTUM = PERIOD / 4.0

    def __init__(
        self,
        *,
        lock_step: bool = False,
        to_device: WireFaults | None = None,
        to_host: WireFaults | None = None,
        key: bytes | None = None,
        device_key: bytes | None = None,
        mode: LinkMode = LinkMode.DRIVE,
        seed: int = 1,
    ):
        self.wire = SimulatedWire(to_device, to_host, seed)
        self._sessions, self._nonces = itertools.count(1000), itertools.count(1)
        self.keyed, self.lock_step = key is not None, lock_step
        self._device_key = device_key if device_key is not None else key
        self.robot = planar()
        self.flowed: list[tuple[float, bool]] = []
        """Times and whether current flowed, once per quantum."""
        self.power_up()
        self.link = self.host_link(self.wire.host, key, mode)
        self.plant = HardwarePlant(self.link, WIRING)

    def host_link(self, end: Any, key: bytes | None = None, mode: LinkMode = LinkMode.DRIVE) -> Link:
        expected = device_config(WIRING, PERIOD, lock_step=self.lock_step, keyed=key is not None)
        host = Host(expected, lambda: next(self._nonces))
        secret = None if key is None else Key(key)
        return Link(host, Waiting(self, end), key=secret, mode=mode, clock=lambda: self.wire.now)

    def power_up(self) -> None:
        """A new device, as after its supply failed."""
        keyed = self._device_key is not None
        emulated = EmulatedDevice(
            self.robot,
            WIRING,
            lambda: next(self._sessions),
            lock_step=self.lock_step,
            keyed=keyed,
            now=0.0,
        )
        secret = Key(self._device_key) if self._device_key is not None else None
        self.server = DeviceServer(
            emulated, SinglePeerListener(self.wire.device), key=secret, clock=lambda: self.wire.now
        )

    @property
    def device(self):
        return self.server.emulated.device

    @property
    def moves(self) -> bool:
        """Whether current flows at the amplifiers."""
        return any(self.device.output.currents)

    def advance(self, time: float) -> None:
        """The device lives on for so long."""
        until = self.wire.now + time
        while self.wire.now < until - 1e-9:
            self.wire.advance(self.wire.now + self.QUANTUM)
            self.server.serve_once(0.0)
            self.flowed.append((self.wire.now, self.moves))

    def last_motion(self) -> float:
        return max((time for time, flows in self.flowed if flows), default=-1.0)

    def close(self) -> None:
        self.plant.close()
        self.robot.close()


@dataclasses.dataclass
class Waiting:
    """A transport that lets the world go on while it waits."""

    world: World
    end: Any
    failures: int = 0
    is_open: bool = True
    drops: DropCounts = dataclasses.field(default_factory=DropCounts)

    def send(self, packet: bytes) -> None:
        self.end.send(packet)

    def receive(self) -> list[bytes]:
        return self.end.receive()

    def wait(self, longest: float) -> bool:
        until = self.world.wire.now + longest
        self.world.server.serve_once(0.0)
        while not self.end.wait(0.0):
            self.world.advance(self.world.QUANTUM)
            if self.world.wire.now >= until:
                break
        return self.end.wait(0.0)

    def close(self) -> None:
        pass
