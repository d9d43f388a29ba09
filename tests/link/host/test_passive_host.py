"""A passive host hears the session of another one, wherever it joins, and sends nothing."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest
from wired_devices import PERIOD, WIRING, World

from omnimj.errors import LinkLost, NoAnswer
from omnimj.link.calibration import device_config
from omnimj.link.codec.key import Key
from omnimj.link.codec.layout import DropCounts
from omnimj.link.device.config import DeviceConfig
from omnimj.link.device.state_machine import ANNOUNCE_INTERVAL
from omnimj.link.host.link import Link, LinkMode
from omnimj.link.host.plant import HardwarePlant
from omnimj.link.host.state_machine import Host
from omnimj.signals import CurrentCommand

MOVE = CurrentCommand(np.full(4, 0.3))
KEY = random.Random(1).randbytes(32)


class Tap:
    """Wired to the device's transmitter; the world lives on while it waits."""

    def __init__(self, world: World):
        self._world, self._heard = world, len(world.wire.device.sent)
        self.failures, self.drops, self.is_open = 0, DropCounts(), True

    def send(self, packet):
        raise AssertionError("a passive host has sent something")

    def receive(self):
        heard = [packet for _, packet in self._world.wire.device.sent[self._heard :]]
        self._heard += len(heard)
        return heard

    def wait(self, longest):
        until = self._world.wire.now + longest
        while self._world.wire.now < until and len(self._world.wire.device.sent) == self._heard:
            if self._world.device.armed:
                self._world.plant.step(MOVE)
            else:
                self._world.advance(PERIOD)
        return len(self._world.wire.device.sent) > self._heard

    def close(self):
        pass


def driven(key=None) -> World:
    world = World(key=key)
    world.plant.reset()
    for _ in range(30):
        world.plant.step(MOVE)
    assert world.moves
    return world


def listener(world: World, key=None, mode=LinkMode.READONLY, **changed) -> Link:
    expected: DeviceConfig = replace(device_config(WIRING, PERIOD, keyed=key is not None), **changed)
    secret = None if key is None else Key(key)
    host = Host(expected, lambda: 1)
    return Link(host, Tap(world), key=secret, mode=mode, clock=lambda: world.wire.now)


@pytest.mark.slow
@pytest.mark.parametrize("key", [None, KEY], ids=["without key", "keyed"])
def test_a_passive_host_that_joins_late_reads_what_the_driving_host_reads(key):
    world = driven(key)
    link = listener(world, key)
    plant = HardwarePlant(link, WIRING)
    begin, session = world.wire.now, world.device.session
    plant.reset()
    assert world.wire.now - begin <= ANNOUNCE_INTERVAL + 3.0 * PERIOD
    for _ in range(100):
        measured = plant.step(MOVE)
        theirs, ours = world.link.reading, link.reading
        assert ours.sequence <= theirs.sequence and ours.time > begin * 1e6
    assert measured.time > 90 * PERIOD and link.sent == 0
    assert world.device.armed and world.device.session == session and world.device.refused == 0
    link.stop()
    link.close()
    plant.close()
    assert link.sent == 0 and world.device.armed and not world.device.stopped
    world.close()


def test_a_passive_host_goes_over_to_the_next_session():
    world = driven()
    link = listener(world)
    link.connect()
    before = link.host.session
    world.link.stop()
    world.plant = HardwarePlant(world.host_link(world.wire.host), WIRING)
    world.plant.reset()
    link.listen(world.wire.now + 2.0, lambda: link.host.session != before)
    assert link.host.session == world.device.session != before
    world.close()


def test_where_no_host_drives_a_passive_one_ends_with_one_line():
    world = World()
    with pytest.raises(NoAnswer, match="is silent: a passive host hears what a device sends to its monitor"):
        listener(world).connect()
    assert world.device.session == 0
    world.close()


@pytest.mark.slow
def test_a_passive_host_refuses_another_device_and_another_key():
    world = driven(KEY)
    with pytest.raises(LinkLost, match="another device answers: "):
        listener(world, KEY, identity=7).connect()
    with pytest.raises(NoAnswer):
        listener(world, bytes(reversed(KEY))).connect()
    with pytest.raises(LinkLost, match="not the device that was expected"):
        listener(world, KEY, wheels=3).connect()
    world.close()


@pytest.mark.slow
def test_the_repeated_challenge_does_not_disturb_its_host_nor_begin_a_session():
    world = driven(KEY)
    dropped = world.link.host.dropped
    for _ in range(round(2.5 * ANNOUNCE_INTERVAL / PERIOD)):
        world.plant.step(MOVE)
    assert world.link.host.dropped == dropped == 0 and world.moves
    world.close()
