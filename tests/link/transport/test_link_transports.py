"""Wires carry packets, or lose them; they never wait and never raise."""

from __future__ import annotations

import os
import select
import socket
import sys
import time

import pytest
from cobs import cobs
from sample_frames import GOLDEN
from simulated_wire import SimulatedWire, WireFaults

from omnimj.errors import InputError
from omnimj.link.codec.frames import encode
from omnimj.link.codec.layout import DropReason
from omnimj.link.transport import serial_port
from omnimj.link.transport.address import SerialAddress, UdpAddress, is_loopback, parse_address
from omnimj.link.transport.interface import PassiveTransport, SinglePeerListener, waiting_time
from omnimj.link.transport.serial_port import SerialTransport
from omnimj.link.transport.udp import UdpListener, UdpTransport

PACKET = encode(GOLDEN["telemetry of the robot"])
OTHER = encode(GOLDEN["command"])
HERE = "127.0.0.1"
pty_needed = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are of POSIX")


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("serial:/dev/ttyACM0", SerialAddress("/dev/ttyACM0", 921_600)),
        ("serial:/dev/ttyUSB1?baud=115200", SerialAddress("/dev/ttyUSB1", 115_200)),
        ("serial:COM3?baud=1843200", SerialAddress("COM3", 1_843_200)),
        ("udp:127.0.0.1:9750", UdpAddress("127.0.0.1", 9750)),
        ("udp:robot.local:1", UdpAddress("robot.local", 1)),
        ("udp:[::1]:65535", UdpAddress("::1", 65535)),
        ("udp:[fe80::1%eth0]:9750", UdpAddress("fe80::1%eth0", 9750)),
        ("udp:9750", UdpAddress("127.0.0.1", 9750)),
        ("udp::9750", UdpAddress("127.0.0.1", 9750)),
    ],
)
def test_addresses_are_read_and_written(text, address):
    assert parse_address(text) == address == parse_address(str(address))


NO_ADDRESSES = """
serial|serial:|serial:?baud=9600|serial:/dev/x?baud=|serial:/dev/x?baud=0|serial:/dev/x?baud=-1
serial:/dev/x?baud=9.6e3|serial:/dev/x?parity=e|serial:/dev/x?baud=1_0|serial:/dev/x?baud=99999999
serial:/dev/x?baud=٣|tcp:host:1|udp|udp:|udp:host|udp:host:|udp:host:0|udp:host:65536|udp:host: 1
udp:host:+1|udp:::1:9750|udp:[::1]9750|udp:[host]:1|udp:[::1:1|udp:a b:1|udp:host/x:1|/dev/ttyACM0
UDP:host:1|
"""


@pytest.mark.parametrize("text", NO_ADDRESSES.strip().replace("\n", "|").split("|"))
def test_an_invalid_address_is_refused_in_one_line(text):
    with pytest.raises(InputError) as caught:
        parse_address(text, "--plant")
    assert str(caught.value).startswith("--plant: ") and "\n" not in str(caught.value)


INSIDE, OUTSIDE = ("127.0.0.1", "127.8.9.1", "::1"), ("0.0.0.0", "::", "192.168.0.7", "localhost", "")


@pytest.mark.parametrize("host", INSIDE + OUTSIDE)
def test_loopback_is_what_never_leaves_this_machine(host):
    assert is_loopback(host) is (host in INSIDE)


@pytest.fixture
def udp():
    """A device's end and a host's."""
    device = UdpListener(_free())
    host = UdpTransport(UdpAddress(HERE, device.port))
    yield device, host
    device.close()
    host.close()


def _free() -> UdpAddress:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((HERE, 0))
        return UdpAddress(HERE, probe.getsockname()[1])


def test_datagrams_go_there_and_back_and_silence_does_not_wait(udp):
    device, host = udp
    assert device.receive() == [] == host.receive() and not host.wait(0.0)
    host.send(OTHER)
    assert device.wait(1.0)
    ((packet, peer),) = device.receive()
    assert packet == OTHER
    device.send(PACKET, peer)
    device.send(PACKET, peer)
    assert host.wait(1.0) and host.receive() == [PACKET, PACKET]
    assert device.failures == host.failures == 0


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux stamps datagrams in nanoseconds")
def test_a_datagram_knows_how_long_it_has_waited_in_the_queue(udp, monkeypatch):
    device, host = udp
    packet, peer, begin, later = b"", None, 0, 0
    for _ in range(100):
        begin = time.time_ns()
        host.send(OTHER)
        assert device.wait(1.0)
        later = time.time_ns() + 700_000_000
        with monkeypatch.context() as busy:  # the program is busy for 0.7 s
            busy.setattr(time, "time_ns", lambda later=later: later)
            packet, peer = device.receive()[0]
        if waiting_time(packet) >= 0.7:
            break
        device.wait(0.01)  # the kernel begins to stamp a moment after the first socket has asked for it
    assert 0.7 <= waiting_time(packet) <= 1e-9 * (later - begin)
    device.send(OTHER, peer)
    monkeypatch.setattr(time, "time_ns", lambda: begin - 3_600_000_000_000)  # somebody sets the clock back
    assert host.wait(1.0)
    (packet,) = host.receive()
    assert packet == OTHER and waiting_time(packet) == 0.0


def test_a_wire_without_time_stamps_reports_no_waiting_time():
    wire = SimulatedWire()
    wire.host.send(OTHER)
    assert [waiting_time(packet) for packet in wire.device.receive()] == [0.0]


def test_a_host_receives_frames_of_its_device_alone(udp):
    device, host = udp
    host.send(OTHER)
    ((_, peer),) = device.receive()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(PACKET, peer)
    device.send(OTHER, peer)
    assert host.wait(1.0) and host.receive() == [OTHER]


def test_datagrams_over_512_bytes_are_dropped_and_a_flood_comes_in_portions(udp):
    device, host = udp
    host.send(bytes(513))
    host.send(bytes(3000))
    host.send(bytes(512))
    assert [packet for packet, _ in device.receive()] == [bytes(512)]
    assert device.drops[DropReason.TOO_LONG] == 2 and device.failures == 0
    for _ in range(100):
        host.send(OTHER)
    assert [len(device.receive()) for _ in range(3)] == [64, 36, 0]


def test_a_device_that_is_gone_is_an_empty_read(udp):
    device, host = udp
    device.close()
    device.close()
    for _ in range(3):
        host.send(OTHER)
        assert host.receive() == []
    assert host.failures > 0
    assert device.receive() == [] and not device.wait(0.0)
    device.send(OTHER, (HERE, 1))
    host.close()
    host.send(OTHER)
    assert host.receive() == [] and not host.wait(0.0)


def test_off_loopback_a_key_is_required():
    for host in ("0.0.0.0", "::", "192.0.2.1"):
        for end in (UdpListener, UdpTransport):
            with pytest.raises(InputError, match="key"):
                end(UdpAddress(host, 9))
    UdpListener(UdpAddress("0.0.0.0", _free().port), keyed=True).close()


def test_unknown_hosts_and_occupied_ports_are_refused_in_one_line(udp):
    device, _ = udp
    with pytest.raises(InputError, match="cannot be used"):
        UdpListener(UdpAddress(HERE, device.port))
    with pytest.raises(InputError, match="not found"):
        UdpTransport(UdpAddress("no.such.host.invalid", 9))


def test_ipv6_where_this_machine_has_it():
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as probe:
            probe.bind(("::1", 0))
            port = probe.getsockname()[1]
    except OSError:
        pytest.skip("no IPv6 on this machine")
    device, host = UdpListener(UdpAddress("::1", port)), UdpTransport(UdpAddress("::1", port))
    host.send(OTHER)
    assert device.wait(1.0) and device.receive()[0][0] == OTHER
    device.close()
    host.close()


@pytest.fixture
def line():
    """A serial transport on a pseudo-terminal, and the descriptor of its far end."""
    far, near = os.openpty()
    transport = SerialTransport(SerialAddress(os.ttyname(near)))
    os.close(near)
    os.set_blocking(far, False)
    yield transport, far
    transport.close()
    os.close(far)


def read(far: int, silence: float = 0.1) -> bytes:
    """All that the far end gets; the system may take its time to bring it there."""
    taken = b""
    while select.select([far], [], [], silence)[0]:
        taken += os.read(far, 65536)
    return taken


def come(transport: SerialTransport, count: int) -> list[bytes]:
    """So many packets."""
    found = []
    while len(found) < count and transport.wait(1.0):
        found += transport.receive()
    return found


@pty_needed
def test_a_serial_line_stuffs_and_unstuffs(line):
    transport, far = line
    assert transport.receive() == [] and not transport.wait(0.0)
    transport.send(PACKET)
    assert read(far) == b"\0" + cobs.encode(PACKET) + b"\0"
    stuffed = cobs.encode(OTHER) + b"\0"
    os.write(far, b"noise\0" + stuffed + stuffed[:7])
    assert come(transport, 1) == [OTHER]
    os.write(far, stuffed[7:])
    assert come(transport, 1) == [OTHER]
    assert transport.drops.total == 1 and transport.failures == 0


@pty_needed
def test_a_port_that_takes_nothing_more_loses_whole_packets_without_waiting(line):
    transport, far = line
    begin = time.perf_counter()
    for _ in range(2000):  # 200 kB, more than any terminal holds
        transport.send(PACKET)
    assert time.perf_counter() - begin < 2.0 and transport.failures > 0
    taken = read(far)
    while transport._rest:
        transport.receive()  # finishes what it has begun
        taken += read(far)
    transport.send(OTHER)
    taken += read(far)
    pieces = taken.split(b"\0")
    assert pieces[0] == pieces[-1] == b"" and pieces[-2] == cobs.encode(OTHER)
    assert set(pieces[1:-2]) == {cobs.encode(PACKET)}
    assert len(pieces) - 3 + transport.failures == 2000


@pty_needed
def test_a_pulled_cable_is_an_empty_read():
    far, near = os.openpty()
    transport = SerialTransport(SerialAddress(os.ttyname(near)))
    os.close(near)
    os.close(far)
    transport.send(PACKET)
    assert transport.receive() == [] and transport.failures > 0
    transport.close()
    transport.close()
    transport.send(PACKET)
    assert transport.receive() == [] and not transport.wait(0.0)


@pty_needed
def test_a_port_belongs_to_one_host(line):
    transport, _ = line
    with pytest.raises(InputError, match="cannot be opened"):
        SerialTransport(SerialAddress(transport._port.port))
    with pytest.raises(InputError, match="cannot be opened"):
        SerialTransport(SerialAddress("/dev/no-such-port"))


def test_a_simulated_wire_without_faults_is_a_wire():
    wire = SimulatedWire()
    device = SinglePeerListener(wire.device)
    wire.host.send(OTHER)
    assert device.wait(0.0) and device.receive() == [(OTHER, None)]
    device.send(PACKET)
    assert wire.host.receive() == [PACKET] and wire.host.receive() == []
    device.close()
    wire.device.send(PACKET)
    assert wire.host.receive() == [] and device.failures == 1


def _arrivals(faults: WireFaults, seed: int = 1, count: int = 4000) -> list[tuple[float, int]]:
    """When which of the packets, sent one per millisecond, come."""
    wire, found = SimulatedWire(to_device=faults, seed=seed), []
    for k in range(count + 300):
        wire.advance(k / 1000)
        found += [(k, int.from_bytes(packet, "little")) for packet in wire.device.receive()]
        if k < count:
            wire.host.send(k.to_bytes(4, "little"))
    return found


def test_a_simulated_wire_has_the_set_rates_of_its_faults():
    assert abs(len(_arrivals(WireFaults(loss=0.3))) / 4000 - 0.7) < 0.04
    assert abs(len(_arrivals(WireFaults(duplication=0.2))) / 4000 - 1.2) < 0.04
    assert all(k == max(n + 20, n + 1) for k, n in _arrivals(WireFaults(delay=0.0195)))
    late = _arrivals(WireFaults(delay=0.01, jitter=0.1))
    assert len(late) == 4000 and sorted(n for _, n in late) == list(range(4000))
    assert [n for _, n in late] != list(range(4000)), "they overtake each other"
    assert all(10 <= k - n <= 111 for k, n in late) and max(k - n for k, n in late) > 100
    come = {n for _, n in _arrivals(WireFaults(delay=0.01, cuts=((1.0, 1.5),)))}
    assert come == set(range(4000)) - set(range(990, 1500)), "under way or sent while it was cut"


def test_the_same_seed_is_the_same_wire():
    bad = WireFaults(loss=0.2, jitter=0.01, duplication=0.1)
    assert _arrivals(bad, 3, 300) == _arrivals(bad, 3, 300) != _arrivals(bad, 4, 300)


def test_what_was_captured_can_be_played_again():
    wire = SimulatedWire(to_device=WireFaults(loss=1.0))
    wire.host.send(OTHER)
    assert wire.device.receive() == [] and wire.host.lost == 1
    for _, packet in wire.host.sent:
        wire.inject(packet)
    assert wire.device.receive() == [OTHER]
    wire.set_faults(to_device=WireFaults())
    wire.reconnect_host().send(PACKET)
    wire.inject(OTHER, to_device=False)
    assert wire.device.receive() == [PACKET] and wire.host.receive() == [OTHER]


def test_a_wire_never_holds_more_than_it_may():
    wire = SimulatedWire(to_host=WireFaults(delay=1.0))
    for _ in range(10_005):
        wire.device.send(b"")
    assert wire.device.lost == 5
    wire.advance(2.0)
    wire.advance(1.0)
    assert wire.now == 2.0 and len(wire.host.receive()) == 10_000


@pty_needed
def test_a_line_that_was_gone_carries_packets_again(tmp_path, monkeypatch):
    monkeypatch.setattr(serial_port, "REOPEN_INTERVAL", 0.0)
    name = tmp_path / "port"
    far, near = os.openpty()
    name.symlink_to(os.ttyname(near))
    transport = SerialTransport(SerialAddress(str(name)))
    os.write(far, cobs.encode(OTHER)[:9])
    assert transport.wait(1.0) and transport.receive() == []
    os.close(near)
    os.close(far)
    assert transport.receive() == [] and not transport.is_open and transport.drops.total == 1
    transport.send(PACKET)
    assert transport.receive() == [] and not transport.wait(0.0) and not transport.is_open
    far, near = os.openpty()
    name.unlink()
    name.symlink_to(os.ttyname(near))
    assert transport.receive() == [] and transport.is_open
    transport.send(PACKET)
    assert read(far) == b"\0" + cobs.encode(PACKET) + b"\0"
    os.write(far, cobs.encode(OTHER) + b"\0")
    assert come(transport, 1) == [OTHER] and transport.drops.total == 1
    transport.close()
    assert transport.receive() == [] and not transport.is_open
    os.close(near)
    os.close(far)


@pty_needed
def test_a_passive_end_of_a_line_or_socket_sends_no_byte():
    far, near = os.openpty()
    transport = SerialTransport(SerialAddress(os.ttyname(near)), passive=True)
    os.close(near)
    transport.send(PACKET)
    os.write(far, b"\0" + cobs.encode(OTHER) + b"\0")
    assert come(transport, 1) == [OTHER] and read(far, 0.02) == b"" and transport.failures == 1
    transport.close()
    os.close(far)
    listening = _free()
    passive, sender = PassiveTransport(UdpListener(listening)), UdpTransport(listening)
    sender.send(OTHER)
    assert passive.wait(1.0) and passive.receive() == [OTHER]
    passive.send(PACKET)
    assert sender.receive() == [] and passive.failures == 1
    sender.close()
    passive.close()
    assert not passive.is_open and passive.drops.total == 0
