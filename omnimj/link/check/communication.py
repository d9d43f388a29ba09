"""Check of the communication with a device: rates, watchdog, and stop.

The test current is far below the one that turns a wheel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnimj.errors import LinkLost
from omnimj.link.codec.messages import FaultCode, Status
from omnimj.link.host.link import Link
from omnimj.link.host.state_machine import COMMAND_VALIDITY

LISTEN_TIME = 1.0
"""Time over which rates are measured [s]."""
TEST_CURRENT = 0.05
"""Current during the checks of watchdog and stop [A]."""
TIME_TOLERANCE = 0.020
"""Tolerance of reaction times, for the delays of wire and operating system [s]."""
_TEST_TIME = 0.05  # [s] with the test current


@dataclass(frozen=True)
class TelemetryRates:
    """Statistics of the telemetry."""

    received: int
    """Number of readings."""
    expected: float
    """Number of readings expected in this time."""
    lost: int
    """Number of lost readings."""
    longest: float
    """Longest time between two readings, by the device's clock [s]."""
    round_trip: float
    """Shortest round trip [s]."""


@dataclass(frozen=True)
class StopResponse:
    """Reaction of a device to silence or a stop."""

    after: float
    """Time from the last command or first stop to the first telemetry that reports the reaction [s]."""
    fault: FaultCode
    """Latched fault."""
    flows: bool
    """True if current still flows or may flow."""


def measure_rates(link: Link) -> TelemetryRates:
    """Measure the rates of a connected link, without arming."""
    first = before = link.reading
    begin, lost = link.now, link.host.arrivals.total_lost
    times = [first.time]
    while link.now - begin < LISTEN_TIME:
        link.refresh_clock()
        link.wait(begin + LISTEN_TIME, lambda before=before: link.reading is not before)
        link.host.require_link()
        if link.reading is not before:
            before = link.reading
            times.append(before.time)
    period = link.host.expected.period
    return TelemetryRates(
        round(1e-6 * (times[-1] - times[0]) / period) + 1 - (link.host.arrivals.total_lost - lost),
        (link.now - begin) / period,
        link.host.arrivals.total_lost - lost,
        1e-6 * float(np.diff(times).max(initial=0)),
        link.host.clock.round_trip if link.host.clock.known else 0.0,
    )


def check_watchdog(link: Link) -> StopResponse:
    """Apply the test current and fall silent: the device must cut the current by itself and report it.

    Raises:
      LinkLost: The device cannot be armed, or sends no more telemetry.
    """
    begin = _apply_test_current(link)
    link.listen(link.now + 10.0 * COMMAND_VALIDITY, lambda: Status.FAULT in link.reading.telemetry.status)
    return _stop_response(link, begin)


def check_stop(link: Link) -> StopResponse:
    """Apply the test current and stop.

    Raises:
      LinkLost: The device cannot be armed, or sends no more telemetry.
    """
    _apply_test_current(link)
    begin = link.now
    link.stop()
    link.listen(link.now + 10.0 * COMMAND_VALIDITY, lambda: Status.ARMED not in link.reading.telemetry.status)
    return _stop_response(link, begin)


def is_fault_latched(link: Link) -> bool:
    """True if a device with a latched fault refuses to be armed until the fault is reset.

    Raises:
      LinkLost: The device does not answer.
    """
    link.connect()
    if link.reading.telemetry.fault is FaultCode.NONE:
        return False
    try:
        link.arm()
    except LinkLost:
        return True
    link.stop()
    return False


def _apply_test_current(link: Link) -> float:
    """Arm, let the test current flow for a moment, and return the time of the last command [s]."""
    link.arm()
    period, wheels = link.host.expected.period, link.host.expected.wheels
    begin, last = link.now, 0.0
    while (now := link.now) - begin < _TEST_TIME:
        last = now
        link.send(link.host.command(now, (TEST_CURRENT,) * wheels))
        link.wait(now + period)
        link.host.require_link()
    return last


def _stop_response(link: Link, begin: float) -> StopResponse:
    reading = link.reading
    flows = Status.CURRENT_FLOWS in reading.telemetry.status or Status.ARMED in reading.telemetry.status
    return StopResponse(max(reading.arrived - begin, 0.0), reading.telemetry.fault, flows)
