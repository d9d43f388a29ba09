"""A robot behind a wire as a plant: the controller cannot tell it from the twin, but for the truth it lacks.

In lock-step a step is one command and one telemetry; simulated time is the device's. In real time the
device's telemetry is the clock: each reading is answered by a command, and one that does not come within one
and a half periods is stood in for by the one before, whose time says so.
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

# What must happen however a program ends: by its end, Ctrl-C, SIGTERM, or because its terminal is gone.

_SIGNALS = ("SIGTERM", "SIGHUP", "SIGBREAK")


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


class StopAtExit:
    """Calls `stop` when the program ends; makes SIGTERM and SIGHUP what Ctrl-C is, so that all is kept.

    Against kill -9, and a computer that hangs, there is only the device's own rule on the age of commands.
    """

    def __init__(self, stop: Callable[[], None]):
        """From now on, until `release`; signals where this is the main thread and nobody else has them."""
        self._stop, self._before = stop, dict[int, Any]()
        atexit.register(stop)
        if threading.current_thread() is not threading.main_thread():
            return
        for name in _SIGNALS:
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is signal.SIG_DFL:
                self._before[number] = signal.signal(number, _interrupt)

    def release(self) -> None:
        """The program may end as it likes; may be called twice."""
        atexit.unregister(self._stop)
        for number, before in self._before.items():
            with contextlib.suppress(ValueError):  # another thread than the one that asked for it
                if signal.getsignal(number) is _interrupt:
                    signal.signal(number, before)
        self._before.clear()


_SLACK = 0.5  # of a period: how long a reading may be late
_SILENCE = 0.5  # [s]: without motion nobody stops a link that is silent, so it is told
_NO_TRUTH = np.empty(0)


class HardwarePlant:
    """A `Plant` on a link. Its steps raise `LinkLost` once the link does not hold; it is then stopped."""

    truth_names: tuple[str, ...] = ()

    def __init__(self, link: Link, hardware: Hardware, *, reset_fault: bool = False):
        """Nothing is sent yet.

        Args:
          link: Not connected; closed by `close`.
          hardware: The wiring, of the link's robot.
          reset_fault: Whether a fault that the device has latched has been seen and may be reset.

        Raises:
          InputError: A link that may not arm, in lock-step, where time stands still without it.
        """
        expected = link.host.expected
        if expected.lock_step and link.mode is not LinkMode.DRIVE:
            found = f"--{link.mode.value.replace(' ', '-')}"
            raise InputError(found, "found with --lock-step", "there time stands still until it is armed")
        self.period = expected.period
        self.link = link
        self.is_lock_step, self._reset_fault = expected.lock_step, reset_fault
        self._calibration, self._wheels = Calibration(hardware), WheelMap.of(hardware)
        self._deadlines, self._is_open = Deadlines(), True
        self._ending = StopAtExit(self.close)
        self._reading: Reading | None = None

    # --- the plant

    def reset(self) -> Measurement:
        """A new session, its first measurement at time 0.

        In lock-step the device is armed by it. In real time the first step arms, so that a controller that
        takes its time to begin keeps no armed robot waiting; time 0 is then that of the first reading of the
        armed device.

        Raises:
          LinkLost: The device is not there, not the one that was expected, or does not let itself be armed.
        """
        self._calibration.reset()
        self._deadlines = Deadlines()
        self.link.connect()
        fault = self.link.reading.telemetry.fault
        if fault and self._reset_fault:
            self.link.reset_fault()
        elif fault and self.link.mode is LinkMode.DRIVE:
            words = fault.name.lower().replace("_", " ")
            self.link.stop(f"the device has latched {words}; --reset-fault says that it has been seen")
            self.link.host.require_link()
        reading = self.link.arm() if self.is_lock_step else self.link.reading
        self._began = self.is_lock_step
        self._take(reading)
        self._zero_time = reading.time
        self._measured = self._measure(reading)
        return self._measured

    def step(self, command: CurrentCommand) -> Measurement:
        """Sends one command; the reading after it.

        Raises:
          LinkLost: The link does not hold; three stops have been sent.
        """
        currents, brake = self._wheels.told(command)
        if self.is_lock_step:
            host = self.link.host
            self._deadlines.periods += 1
            reading = self.link.exchange(host.command(self.link.now, currents, brake))
            self._take(reading)
            self._measured = self._measure(reading)
            return self._measured
        self._begin()
        self._command(currents, brake)
        return self._next()

    def truth(self) -> Array:
        """None: nobody knows it."""
        return _NO_TRUTH

    def close(self) -> None:
        """Three stops, if this plant has been armed, and the end of the link; may be called twice."""
        if self._is_open:
            self._is_open = False
            try:
                self.link.close()
            finally:
                self._ending.release()
                gc.unfreeze()

    @property
    def record(self) -> LinkRecord:
        """How the link was, for `metrics.json`."""
        link, host = self.link, self.link.host
        told = None if host.reading is None else host.reading.telemetry
        return LinkRecord(
            address=link.name,
            mode="lock-step" if self.is_lock_step else "real time" if self._drives else link.mode.value,
            is_keyed=link.is_keyed,
            deadlines=self._deadlines,
            sent=link.sent,
            received=link.received,
            resent=link.resent,
            lost=host.arrivals.total_lost,
            dropped=link.drops.total + host.dropped,
            device_dropped=0 if told is None else told.dropped,
            device_refused=0 if told is None else told.refused,
            round_trip=host.clock.round_trip if host.clock.known else None,
            ended_by=host.reason if host.state is HostState.STOPPED and self._is_open else "",
        )

    # --- in real time

    @property
    def _drives(self) -> bool:
        return self.link.mode is LinkMode.DRIVE

    def _begin(self) -> None:
        """Once: arms, and begins to count time."""
        if self._began:
            return
        gc.collect()
        gc.freeze()  # what is there by now is not looked through again while the robot drives
        if self._drives:
            reading = self.link.arm()
        else:
            before = self.link.reading  # what has come since then is old by now
            self.link.wait(self.link.now + _SILENCE, lambda: self.link.reading is not before)
            reading = self.link.reading
        self._began = True
        self._take(reading)
        self._zero_time = reading.time
        self._measure(reading)

    def _command(self, currents: tuple[float, ...], brake: int) -> None:
        """What the mode lets out of it leaves now."""
        link, deadlines = self.link, self._deadlines
        link.refresh_clock()
        if self._drives:
            link.send(link.host.command(link.now, currents, brake))
        elif link.mode is LinkMode.DRY_RUN:
            link.send(link.zero())
        response = link.now - self._came
        deadlines.periods += 1
        deadlines.missed += response > self.period
        deadlines.response.add(response)

    def _next(self) -> Measurement:
        """The next reading, or the one before once more where none comes in time."""
        link, before = self.link, self._reading
        self._due += self.period
        link.wait(self._due + _SLACK * self.period, lambda: link.host.reading is not before)
        link.host.require_link()
        reading = link.reading
        if reading is before:
            self._deadlines.held, self._held = self._deadlines.held + 1, self._held + 1
            self._came = self._due + _SLACK * self.period  # from now on its answer is awaited
            if link.now - reading.came > _SILENCE:
                words = f"{link.name} has been silent for {link.now - reading.came:.2f} s"
                link.stop(words)
                raise LinkLost(words)
            return self._measured
        assert before is not None
        periods = round((reading.time - before.time) * 1e-6 / self.period)
        self._deadlines.skipped += max(0, periods - 1 - self._held)
        self._deadlines.late.add(max(0.0, reading.came - self._due))
        self._take(reading)
        self._measured = self._measure(reading)
        return self._measured

    # --- in both

    def _take(self, reading: Reading) -> None:
        self._reading, self._came, self._due, self._held = reading, reading.came, reading.came, 0
        if math.isfinite(reading.telemetry.command_age):
            self._deadlines.command_age.add(reading.telemetry.command_age)

    def _measure(self, reading: Reading) -> Measurement:
        """In SI, at the time since the run's beginning."""
        measured = self._calibration.measured(1e-6 * reading.time, reading.telemetry.raw)
        return dataclasses.replace(measured, time=(reading.time - self._zero_time) / 1e6)
