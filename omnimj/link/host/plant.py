"""Robot behind a wire as a plant; unlike the twin it has no truth signals.

In lock-step a step is one command and one telemetry, in the device's simulated time. In real time the
device's telemetry is the clock: each reading is answered by a command, and a reading that does not arrive
within one and a half periods is replaced by the previous one, with its time.
"""

from __future__ import annotations

import atexit
import contextlib
import dataclasses
import gc
import math
import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any

import numpy as np

from omnimj.errors import InputError, LinkLost
from omnimj.link.calibration import Calibration, WheelMap
from omnimj.link.host.link import Link, LinkMode
from omnimj.link.host.state_machine import HostState, Reading
from omnimj.link.quality import Deadlines, LinkRecord
from omnimj.parameters.hardware import Hardware
from omnimj.signals import Array, CurrentCommand, Measurement

_SIGNALS = ("SIGTERM", "SIGHUP", "SIGBREAK")


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


class StopAtExit:
    """Guard that calls `stop` when the program ends; SIGTERM and SIGHUP act like Ctrl-C to keep the results.

    If the program is killed by SIGKILL or the computer hangs, only the device's limit on the age of commands
    stops the robot.
    """

    def __init__(self, stop: Callable[[], None]):
        """Take effect until `release`; signals only in the main thread and only with default handlers."""
        self._stop, self._before = stop, dict[int, Any]()
        atexit.register(stop)
        if threading.current_thread() is not threading.main_thread():
            return
        for name in _SIGNALS:
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is signal.SIG_DFL:
                self._before[number] = signal.signal(number, _interrupt)

    def release(self) -> None:
        """Restore the signal handlers; may be called twice."""
        atexit.unregister(self._stop)
        for number, before in self._before.items():
            with contextlib.suppress(ValueError):  # not in the main thread
                if signal.getsignal(number) is _interrupt:
                    signal.signal(number, before)
        self._before.clear()


_SLACK = 0.5  # accepted delay of a reading, in periods
_SILENCE = 0.5  # [s] without telemetry after which a link that does not drive ends
_NO_TRUTH = np.empty(0)


class HardwarePlant:
    """`Plant` on a link; once the link has ended, a step raises `LinkLost` and the device is stopped."""

    truth_names: tuple[str, ...] = ()

    def __init__(self, link: Link, hardware: Hardware, *, reset_fault: bool = False):
        """Prepare the plant; nothing is sent.

        Args:
          link: Link that is not connected; closed by `close`.
          hardware: Wiring of the link's robot.
          reset_fault: Whether to reset a latched fault of the device.

        Raises:
          InputError: The link is in lock-step and may not arm, so that time would stand still.
        """
        expected = link.host.expected
        if expected.lock_step and link.mode is not LinkMode.DRIVE:
            found = f"--{link.mode.value.replace(' ', '-')}"
            raise InputError(found, "found with --lock-step", "there time stands still until it is armed")
        self.period = expected.period
        self.link = link
        self.is_lock_step, self._reset_fault = expected.lock_step, reset_fault
        self._calibration, self._wheels = Calibration(hardware), WheelMap.from_hardware(hardware)
        self._deadlines, self._is_open = Deadlines(), True
        self._exit_guard = StopAtExit(self.close)
        self._reading: Reading | None = None

    def reset(self) -> Measurement:
        """Begin a session and return its first measurement, at time 0.

        In lock-step this arms the device. In real time the first step does, so that an armed robot does not
        wait for a slow start of the controller; time 0 is then the first reading of the armed device.

        Raises:
          LinkLost: The device does not answer, is not the expected one, or refuses to be armed.
        """
        self._calibration.reset()
        self._deadlines = Deadlines()
        self.link.connect()
        fault = self.link.reading.telemetry.fault
        if fault and not self._reset_fault and self._drives:
            name = fault.name.lower().replace("_", " ")
            self.link.stop(f"the device has latched {name}; --reset-fault resets it")
            self.link.host.require_link()
        if self.link.is_latched and self._drives:
            self.link.reset()  # a new run has been requested
        reading = self.link.arm() if self.is_lock_step else self.link.reading
        self._is_running = self.is_lock_step
        self._note(reading)
        self._zero_time = reading.time
        self._measured = self._measure(reading)
        return self._measured

    def step(self, command: CurrentCommand) -> Measurement:
        """Send one command and return the next measurement.

        Raises:
          LinkLost: The link has ended; three stops have been sent.
        """
        currents, brake = self._wheels.to_device(command)
        if self.is_lock_step:
            host = self.link.host
            self._deadlines.periods += 1
            reading = self.link.exchange(host.command(self.link.now, currents, brake))
            self._note(reading)
            self._measured = self._measure(reading)
            return self._measured
        self._start_running()
        self._command(currents, brake)
        return self._next()

    def truth(self) -> Array:
        """Empty, shape (0,): a real robot has no truth signals."""
        return _NO_TRUTH

    def close(self) -> None:
        """Stop the device if it has been armed, and close the link; may be called twice."""
        if self._is_open:
            self._is_open = False
            try:
                self.link.close()
            finally:
                self._exit_guard.release()
                gc.unfreeze()

    @property
    def record(self) -> LinkRecord:
        """Summary of the link for `metrics.json`."""
        link, host = self.link, self.link.host
        telemetry = None if host.reading is None else host.reading.telemetry
        return LinkRecord(
            address=link.name,
            mode="lock-step" if self.is_lock_step else "real time" if self._drives else link.mode.value,
            is_keyed=link.is_keyed,
            deadlines=self._deadlines,
            sent=link.sent,
            received=link.received,
            resent=link.resent,
            lost=host.arrivals.total_lost,
            dropped=link.dropped,
            device_dropped=0 if telemetry is None else telemetry.dropped,
            device_refused=0 if telemetry is None else telemetry.refused,
            round_trip=host.clock.round_trip if host.clock.known else None,
            ended_by=host.reason if host.state is HostState.STOPPED and self._is_open else "",
        )

    @property
    def _drives(self) -> bool:
        return self.link.mode is LinkMode.DRIVE

    def _start_running(self) -> None:
        """Arm and start time at the first step."""
        if self._is_running:
            return
        gc.collect()
        gc.freeze()  # keeps garbage collections short while the robot drives
        if self.link.is_idle:
            self.link.connect()  # the device may have ended a session that was silent for so long
        if self._drives:
            reading = self.link.arm()
        else:
            before = self.link.reading  # outdated by now
            self.link.wait(self.link.now + _SILENCE, lambda: self.link.reading is not before)
            reading = self.link.reading
        self._is_running = True
        self._note(reading)
        self._zero_time = reading.time
        self._measure(reading)

    def _command(self, currents: tuple[float, ...], brake: int) -> None:
        """Send the command as far as the mode permits."""
        link, deadlines = self.link, self._deadlines
        link.refresh_clock()
        if self._drives:
            link.send(link.host.command(link.now, currents, brake))
        elif link.mode is LinkMode.DRY_RUN:
            link.send(link.zero())
        response = link.now - self._arrived
        deadlines.periods += 1
        deadlines.missed += response > self.period
        deadlines.response.add(response)

    def _next(self) -> Measurement:
        """Next measurement, or the previous one if none arrives in time."""
        link, before = self.link, self._reading
        self._due += self.period
        link.wait(self._due + _SLACK * self.period, lambda: link.host.reading is not before)
        link.host.require_link()
        reading = link.reading
        if reading is before:
            self._deadlines.held, self._held = self._deadlines.held + 1, self._held + 1
            self._arrived = self._due + _SLACK * self.period  # reference for the response time
            if link.now - reading.arrived > _SILENCE:
                reason = f"{link.name} has been silent for {link.now - reading.arrived:.2f} s"
                link.stop(reason)
                raise LinkLost(reason)
            return self._measured
        assert before is not None
        periods = round((reading.time - before.time) * 1e-6 / self.period)
        self._deadlines.skipped += max(0, periods - 1 - self._held)
        self._deadlines.late.add(max(0.0, reading.arrived - self._due))
        self._note(reading)
        self._measured = self._measure(reading)
        return self._measured

    def _note(self, reading: Reading) -> None:
        self._reading, self._arrived, self._due, self._held = reading, reading.arrived, reading.arrived, 0
        if math.isfinite(reading.telemetry.command_age):
            self._deadlines.command_age.add(reading.telemetry.command_age)

    def _measure(self, reading: Reading) -> Measurement:
        """Convert a reading to SI units, with the time since the beginning of the run."""
        measured = self._calibration.convert(1e-6 * reading.time, reading.telemetry.raw)
        return dataclasses.replace(measured, time=(reading.time - self._zero_time) / 1e6)
