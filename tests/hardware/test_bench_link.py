"""Rates, silence and stop as the bench check sees them, in simulated time."""

from __future__ import annotations

import pytest
from wired_devices import PERIOD, World

from omnimj.errors import LinkLost
from omnimj.hardware.bench_link import LITTLE, count, fall_silent, is_latched, stop_it
from omnimj.hardware.device import Device
from omnimj.hardware.host import VALID_FOR
from omnimj.hardware.messages import FaultCode
from omnimj.hardware.simulated_wire import WireFaults


@pytest.fixture
def world():
    made = World()
    yield made
    made.close()


def test_every_reading_of_a_good_wire_is_counted(world):
    world.link.connect()
    rates = count(world.link)
    assert rates.lost == 0 and rates.received == pytest.approx(rates.expected, abs=2)
    assert PERIOD <= rates.longest < 1.5 * PERIOD


def test_what_a_bad_wire_loses_is_counted():
    world = World(to_host=WireFaults(loss=0.05), seed=4)
    world.link.connect()
    rates = count(world.link)
    assert 25 <= rates.lost <= 85
    assert rates.received == pytest.approx(rates.expected - rates.lost, abs=3)
    world.close()


def test_a_device_lets_go_of_a_silent_host_and_stays_so(world):
    world.link.connect()
    trip = fall_silent(world.link)
    assert trip.fault is FaultCode.COMMAND_TOO_OLD and not trip.flows
    assert trip.after == pytest.approx(VALID_FOR, abs=3.0 * PERIOD)
    assert any(flows for _, flows in world.flowed), "or else nothing was tried"
    assert is_latched(world.link)
    world.link.connect()
    world.link.reset_fault()
    assert not is_latched(world.link)


def test_a_stop_ends_the_current_within_two_periods(world):
    world.link.connect()
    trip = stop_it(world.link)
    assert not trip.flows and trip.fault is FaultCode.NONE and trip.after <= 2.0 * PERIOD
    assert not world.moves


def test_a_device_that_does_not_let_go_is_found_out(world, monkeypatch):
    """Its watchdog is taken out."""
    world.link.connect()
    monkeypatch.setattr(Device, "_advance", lambda self, now: None)
    trip = fall_silent(world.link)
    assert trip.flows and trip.fault is FaultCode.NONE


def test_the_current_that_flows_is_far_below_what_turns_a_wheel(world):
    world.link.connect()
    stop_it(world.link)
    assert LITTLE < 0.1
    assert abs(world.robot.truth()[:6]).max() < 1e-3


def test_a_device_that_falls_silent_itself_is_a_lost_link(world):
    world.link.connect()
    world.wire.set_faults(to_host=WireFaults(loss=1.0))
    with pytest.raises(LinkLost):
        count(world.link)
        stop_it(world.link)
