"""Rates, silence and stop as the link check measures them, in simulated time."""

from __future__ import annotations

import pytest
from simulated_wire import WireFaults
from wired_devices import PERIOD, World

from omnimj.errors import LinkLost
from omnimj.link.check.communication import (
    TEST_CURRENT,
    check_stop,
    check_watchdog,
    is_fault_latched,
    measure_rates,
)
from omnimj.link.codec.messages import FaultCode
from omnimj.link.device.state_machine import Device
from omnimj.link.host.state_machine import COMMAND_VALIDITY


@pytest.fixture
def world():
    made = World()
    yield made
    made.close()


def test_every_reading_of_a_good_wire_is_counted(world):
    world.link.connect()
    rates = measure_rates(world.link)
    assert rates.lost == 0 and rates.received == pytest.approx(rates.expected, abs=2)
    assert PERIOD <= rates.longest < 1.5 * PERIOD


def test_what_a_bad_wire_loses_is_counted():
    world = World(to_host=WireFaults(loss=0.05), seed=4)
    world.link.connect()
    rates = measure_rates(world.link)
    assert 25 <= rates.lost <= 85
    assert rates.received == pytest.approx(rates.expected - rates.lost, abs=3)
    world.close()


def test_a_device_stops_without_its_host_and_stays_stopped(world):
    world.link.connect()
    trip = check_watchdog(world.link)
    assert trip.fault is FaultCode.COMMAND_TOO_OLD and not trip.flows
    assert trip.after == pytest.approx(COMMAND_VALIDITY, abs=3.0 * PERIOD)
    assert any(flows for _, flows in world.flowed), "or else nothing was tried"
    assert is_fault_latched(world.link)
    world.link.connect()
    world.link.reset()
    assert not is_fault_latched(world.link)


def test_a_stop_ends_the_current_within_two_periods(world):
    world.link.connect()
    trip = check_stop(world.link)
    assert not trip.flows and trip.fault is FaultCode.NONE and trip.after <= 2.0 * PERIOD
    assert not world.moves


def test_a_device_that_does_not_stop_is_detected(world, monkeypatch):
    """Its watchdog is taken out."""
    world.link.connect()
    monkeypatch.setattr(Device, "_advance_time", lambda self, now: None)
    trip = check_watchdog(world.link)
    assert trip.flows and trip.fault is FaultCode.NONE


def test_the_current_that_flows_is_far_below_what_turns_a_wheel(world):
    world.link.connect()
    check_stop(world.link)
    assert TEST_CURRENT < 0.1
    assert abs(world.robot.truth()[:6]).max() < 1e-3


def test_a_device_that_stops_answering_is_a_lost_link(world):
    world.link.connect()
    world.wire.set_faults(to_host=WireFaults(loss=1.0))
    with pytest.raises(LinkLost):
        measure_rates(world.link)
        check_stop(world.link)
