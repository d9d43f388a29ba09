"""What a bench check wants to know of the link itself: rates, what happens in silence, and stop.

The current that flows meanwhile is far below what turns a wheel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnimj.errors import LinkLost
from omnimj.link.codec.messages import FaultCode, Status
from omnimj.link.host.link import Link
from omnimj.link.host.state_machine import COMMAND_VALIDITY

LISTEN_TIME = 1.0
"""Time for which rates are counted [s]."""
TEST_CURRENT = 0.05
"""Current that flows while silence and stop are tried [A]."""
TIME_TOLERANCE = 0.020
"""By which what must happen may be known later: the wire, and this machine [s]."""
_FLOWS = 0.05  # [s] before the silence


@dataclass(frozen=True)
class TelemetryRates:
    """Of the telemetry."""

    received: int
    expected: float
    lost: int
    longest: float
    """Between two readings, by the device's clock [s]."""
    round_trip: float
    """The best that was seen [s]."""


@dataclass(frozen=True)
class StopResponse:
    """How motion ended."""

    after: float
    """From the last command, or the first stop, to the first telemetry that says so [s]."""
    fault: FaultCode
    flows: bool
    """Whether current still flows."""


def measure_rates(link: Link) -> TelemetryRates:
    """Rates of a connected link; nothing is armed."""
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
    """A little current, and then nothing more: the device must let go by itself, and say so.

    Raises:
      LinkLost: It could not be armed, or says nothing any more.
    """
    begin = _apply_test_current(link)
    link.listen(link.now + 10.0 * COMMAND_VALIDITY, lambda: Status.FAULT in link.reading.telemetry.status)
    return _stop_response(link, begin)


def check_stop(link: Link) -> StopResponse:
    """A little current, and stop.

    Raises:
      LinkLost: As `check_watchdog`.
    """
    _apply_test_current(link)
    begin = link.now
    link.stop()
    link.listen(link.now + 10.0 * COMMAND_VALIDITY, lambda: Status.ARMED not in link.reading.telemetry.status)
    return _stop_response(link, begin)


def is_fault_latched(link: Link) -> bool:
    """Whether a device that has let go refuses to be armed until its fault is reset.

    Raises:
      LinkLost: It does not answer.
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
    """Arms; current flows for a moment. When the last command was sent [s]."""
    link.arm()
    period, wheels = link.host.expected.period, link.host.expected.wheels
    begin, last = link.now, 0.0
    while (now := link.now) - begin < _FLOWS:
        last = now
        link.send(link.host.command(now, (TEST_CURRENT,) * wheels))
        link.wait(now + period)
        link.host.require_link()
    return last


def _stop_response(link: Link, begin: float) -> StopResponse:
    told = link.reading
    flows = Status.CURRENT_FLOWS in told.telemetry.status or Status.ARMED in told.telemetry.status
    return StopResponse(max(told.arrived - begin, 0.0), told.telemetry.fault, flows)
