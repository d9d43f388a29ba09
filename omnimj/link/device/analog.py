"""Device rules in front of an analog data-acquisition box, volts in and volts out.

An analog set value does not expire: the box holds its last voltage if this program ends unexpectedly. The
watchdog must therefore be behind the box, see `PROTOCOL.md`, section 4.8.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

from omnimj.errors import InputError
from omnimj.link.calibration import device_config, motor_current_decoder, wheel_speed_decoder
from omnimj.link.codec.messages import Frame
from omnimj.link.device.state_machine import Device
from omnimj.parameters.hardware import Hardware


class VoltBox(Protocol):
    """Interface to a vendor's data-acquisition library."""

    def read(self) -> Sequence[float]:
        """Voltages of all inputs [V]; raises OSError if the box does not answer."""
        ...

    def write(self, volts: Sequence[float]) -> None:
        """Set the voltages of the outputs from channel 0 on [V]."""
        ...


class AnalogDevice:
    """Data-acquisition box behind a `Device`; it has no relays, so a brake means zero current."""

    def __init__(
        self,
        box: VoltBox,
        hardware: Hardware,
        period: float,
        new_session: Callable[[], int],
        now: float = 0.0,
    ):
        """Start disarmed at zero volts.

        Args:
          box: Data-acquisition box.
          hardware: Wiring, with output gains in V/A.
          period: Time between two ticks [s].
          new_session: Returns 32 fresh random bits.
          now: Time [s].

        Raises:
          InputError: The gain of an output is not in V/A.
        """
        if any(output.unit != "V/A" for output in hardware.outputs):
            found = f"found a gain in {hardware.outputs[0].unit}"
            raise InputError("hardware.outputs", found, "an analog box needs V/A")
        self._box, self._outputs = box, hardware.outputs
        config, speeds = device_config(hardware, period), wheel_speed_decoder(hardware)
        currents = motor_current_decoder(hardware)
        self.device = Device(config, speeds, new_session, now, currents=currents)
        self._inputs = len(self.device.config.channels)
        self._write()

    def on_frame(self, now: float, frame: Frame) -> tuple[Frame, ...]:
        """Process a frame as `Device.on_frame` does; a stop reaches the amplifiers before this returns."""
        answer = self.device.on_frame(now, frame)
        self._write()
        return answer

    def tick(self, now: float) -> tuple[Frame, ...]:
        """Read inputs, apply the device's rules and write outputs; to be called once per period."""
        try:
            volts = tuple(self._box.read())[: self._inputs]
        except OSError:
            volts = ()
        volts += (math.nan,) * (self._inputs - len(volts))  # unknown speeds if the box does not answer
        answer = self.device.tick(now, volts)
        self._write()
        return answer

    def close(self) -> None:
        """Set zero volts; may be called twice."""
        self._box.write([0.0] * self._channels)

    @property
    def _channels(self) -> int:
        return 1 + max(output.channel for output in self._outputs)

    def _write(self) -> None:
        """Write volts = gain · current; the device's currents include the sign."""
        output, volts = self.device.output, [0.0] * self._channels
        for wheel in self._outputs:
            braked = output.brake >> (wheel.wheel - 1) & 1
            current = 0.0 if braked else output.currents[wheel.wheel - 1]
            volts[wheel.channel] = wheel.gain * current
        self._box.write(volts)
