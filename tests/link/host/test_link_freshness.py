"""Delays, floods, replays and other protocols on a whole link in simulated time."""

from __future__ import annotations

import random
import zlib

import numpy as np
import pytest
from nightly import representative
from simulated_wire import WireFaults
from wired_devices import PERIOD, WIRING, World, planar

from omnimj.errors import LinkLost, NoAnswer
from omnimj.link.codec.frames import encode
from omnimj.link.codec.key import Key
from omnimj.link.codec.layout import PROTOCOL, DropCounts, DropReason
from omnimj.link.codec.messages import FaultCode, Frame, Hello, Ping, Status, Stop
from omnimj.link.device.emulated import EmulatedDevice
from omnimj.link.device.server import DeviceServer
from omnimj.link.host.plant import HardwarePlant
from omnimj.signals import CurrentCommand

MOVE = CurrentCommand(np.full(4, 0.3))
KEY = random.Random(1).randbytes(32)


def driving(**changed) -> World:
    world = World(**changed)
    world.plant.reset()
    for _ in range(30):
        world.plant.step(MOVE)
    assert world.moves
    return world


def of_protocol(packet: bytes, protocol: int) -> bytes:
    content = bytes((protocol,)) + packet[1:-4]
    return content + zlib.crc32(content).to_bytes(4, "little")


class Net:
    """Listener whose packets come from named senders; what is sent to each is counted."""

    failures = 0

    def __init__(self):
        self.arriving, self.sent = [], {}
        self.drops, self.is_open = DropCounts(), True

    def receive(self):
        batch, self.arriving = self.arriving[:64], self.arriving[64:]
        return batch

    def send(self, packet, peer):
        self.sent[peer] = self.sent.get(peer, 0) + len(packet)

    def wait(self, longest):
        return False

    def close(self):
        pass


class Served:
    """A device behind a net, by a clock that is moved by hand."""

    def __init__(self, key=None, **changed):
        self.net, self.now, self.lines = Net(), 0.0, []
        self.robot = planar()
        emulated = EmulatedDevice(self.robot, WIRING, lambda: 77, lock_step=False, keyed=key is not None)
        self.server = DeviceServer(
            emulated, self.net, key=key, clock=lambda: self.now, report=self.lines.append
        )
        self.device = emulated.device

    def receives(self, packet, peer, times=1):
        self.net.arriving += [(packet, peer)] * times
        self.server.serve_once(0.0)

    def wait(self, time):
        for _ in range(round(time / PERIOD)):
            self.now += PERIOD
            self.server.serve_once(0.0)


def test_a_replayed_hello_gets_no_more_bytes_than_it_brings_and_no_stream():
    served = Served(Key(KEY))
    recorded = encode(Frame(Hello(5), 0, 1, 0), Key(KEY))
    served.receives(recorded, "victim")
    served.wait(2.0)
    assert 0 < served.net.sent["victim"] <= len(recorded)
    assert served.device.session == 0
    without_key = encode(Frame(Hello(5), 0, 1, 0))
    served.receives(without_key, "stranger", 50)
    assert "stranger" not in served.net.sent


@pytest.mark.parametrize("order", [1, -1])
def test_in_a_flood_a_stop_is_obeyed_before_all_else(order):
    served = Served()
    packets = [(encode(Frame(Ping(k), 9, k, 0)), "flood") for k in range(3000)]
    served.net.arriving = [*packets, (encode(Frame(Stop(), 0, 0, 0)), "person")][::order]
    seen = []
    handle = served.server.emulated.on_frame
    served.server.emulated.on_frame = lambda now, frame, peer: (
        seen.append(frame.message) or handle(now, frame, peer)
    )
    served.server.serve_once(0.0)
    assert seen[0] == Stop() and served.device.stopped
    assert len(seen) == 1 + 64 and seen[-1] == Ping(2999 if order > 0 else 0)
    assert served.device.dropped == 3000 and served.net.arriving == []


def test_oversized_datagrams_and_broken_stuffing_count_as_dropped():
    served = Served()
    for reason in (DropReason.TOO_LONG, DropReason.STUFFING, DropReason.TOO_LONG):
        served.net.drops.add(reason)
    served.server.serve_once(0.0)
    served.server.serve_once(0.0)
    assert served.device.dropped == 3


def test_a_device_whose_line_is_gone_says_so_goes_on_and_serves_again():
    served = Served()
    served.net.is_open = False
    served.wait(3.0)
    assert served.server.timing.periods > 2900
    served.net.is_open = True
    served.wait(0.1)
    assert served.lines == ["the line is gone: waiting until it is back", "the line is back"]
    served.receives(encode(Frame(Hello(5), 0, 1, 0)), "host")
    assert served.net.sent["host"] > 0


def test_a_host_whose_line_is_gone_ends_with_that_message():
    world = driving()
    world.link._transport.is_open = False
    with pytest.raises(LinkLost, match="the device: the line is gone"):
        world.plant.step(MOVE)
    world.close()


def test_a_host_of_another_protocol_is_refused_in_one_line():
    served = Served()
    for sequence in range(5):
        packet = of_protocol(encode(Frame(Hello(5), 0, sequence, 0)), 1)
        served.receives(packet, ("10.0.0.9", 4000))
    host = "the host at ('10.0.0.9', 4000)"
    refused = f"uses protocol 1, this device protocol {PROTOCOL}; the connection is refused"
    assert served.lines == [f"{host} {refused}"]
    assert served.net.sent == {} and served.device.dropped == 5


def test_a_device_of_another_protocol_is_refused_in_one_line():
    world = World()
    old = of_protocol(encode(Frame(Ping(1), 5, 1, 0)), 1)
    world.server.serve_once = lambda longest: world.wire.inject(old, to_device=False)
    refused = f"uses protocol 1, this host protocol {PROTOCOL}; the connection is refused"
    with pytest.raises(LinkLost, match=refused):
        world.plant.reset()
    world.close()


def test_a_device_that_does_not_answer_may_speak_another_protocol():
    world = World()
    world.server.serve_once = lambda longest: None
    with pytest.raises(NoAnswer, match=f"does not speak protocol {PROTOCOL}"):
        world.plant.reset()
    world.close()


def test_a_path_delayed_by_a_second_carries_no_motion_after_the_hosts_last_command():
    world = driving()
    begin = world.wire.now
    world.wire.set_faults(WireFaults(delay=1.0))
    with pytest.raises(LinkLost):
        for _ in range(300):
            world.plant.step(MOVE)
    world.advance(3.0)
    assert world.last_motion() <= begin + 0.05 + 2.0 * PERIOD
    assert world.device.fault is FaultCode.COMMAND_TOO_OLD
    world.close()


@pytest.mark.parametrize("seed", representative(1, 2, 3))
def test_a_forward_path_with_20_ms_of_jitter_and_some_loss_runs_on(seed):
    world = driving(seed=seed)
    world.wire.set_faults(WireFaults(jitter=0.02, loss=0.05), WireFaults(loss=0.01))
    for _ in range(2000):
        world.plant.step(MOVE)
    assert world.moves and world.device.refused == 0
    world.close()


def test_a_device_held_up_for_long_refuses_what_waited_in_its_queue():
    world = driving()
    serve = world.server.serve_once
    world.server.serve_once = lambda longest: None
    with pytest.raises(LinkLost):
        for _ in range(100):
            world.plant.step(MOVE)
    held = world.wire.now
    world.advance(0.2)
    world.server.serve_once = serve
    world.flowed.clear()
    world.advance(0.5)
    assert world.last_motion() < 0.0 and not world.device.armed and held > 0.0
    world.close()


def test_a_new_run_resets_the_stop_of_the_run_before_and_nothing_else_does():
    world = driving()
    world.link.stop()
    world.advance(0.01)
    assert world.device.stopped
    second = World.host_link(world, world.wire.host)
    second.connect()
    assert Status.STOPPED in second.reading.telemetry.status and world.device.stopped
    with pytest.raises(LinkLost, match="arm stopped"):
        second.arm()
    world.plant = HardwarePlant(world.host_link(world.wire.host), WIRING)
    world.plant.reset()
    assert not world.device.stopped and not world.moves
    for _ in range(30):
        world.plant.step(MOVE)
    assert world.moves
    world.close()


def test_a_controller_that_starts_slowly_finds_a_new_session():
    world = World()
    world.plant.reset()
    world.advance(3.0)
    assert world.device.session == 0
    for _ in range(30):
        world.plant.step(MOVE)
    assert world.moves
    world.close()
