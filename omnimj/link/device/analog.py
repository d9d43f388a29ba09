"""A robot at an analog data-acquisition box, volts in and volts out, under the rules of a device.

An analog set value has no freshness: the box holds its last volts when this program dies. The watchdog must
then sit behind it, see `PROTOCOL.md`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

from omnimj.errors import InputError
from omnimj.link.calibration import device_config, wheel_speed_decoder
from omnimj.link.codec.messages import Frame
from omnimj.link.device.state_machine import Device
from omnimj.parameters.hardware import Hardware


class VoltBox(Protocol):
    """What a vendor's library must be wrapped into."""

    def read(self) -> Sequence[float]:
        """Volts at all inputs; OSError when the box does not answer."""
        ...

    def write(self, volts: Sequence[float]) -> None:
        """Volts at the outputs from channel 0 on."""
        ...


class AnalogDevice:
    """A box behind a device, for the same frames as any other; without relays, so a brake is zero current."""

    def __init__(
        self,
        box: VoltBox,
        hardware: Hardware,
        period: float,
        new_session: Callable[[], int],
        now: float = 0.0,
    ):
        """Zero volts, disarmed.

        Args:
          box: The data acquisition.
          hardware: The wiring, with outputs in V/A.
          period: Between two ticks [s].
          new_session: 32 random bits, fresh at each call.
          now: Time [s].

        Raises:
          InputError: The outputs' gains are not in V/A.
        """
        if any(output.unit != "V/A" for output in hardware.outputs):
            found = f"found a gain in {hardware.outputs[0].unit}"
            raise InputError("hardware.outputs", found, "an analog box needs V/A")
        self._box, self._outputs = box, hardware.outputs
        self.device = Device(device_config(hardware, period), wheel_speed_decoder(hardware), new_session, now)
        self._inputs = len(self.device.commissioned.channels)
        self._write()

    def on_frame(self, now: float, frame: Frame) -> tuple[Frame, ...]:
        """As `Device.on_frame`; a stop is at the amplifiers before this returns."""
        answer = self.device.on_frame(now, frame)
        self._write()
        return answer

    def tick(self, now: float) -> tuple[Frame, ...]:
        """Reads, judges, writes; to be called once per period."""
        try:
            volts = tuple(self._box.read())[: self._inputs]
        except OSError:
            volts = ()
        volts += (math.nan,) * (self._inputs - len(volts))  # a box that does not answer knows no speeds
        answer = self.device.tick(now, volts)
        self._write()
        return answer

    def close(self) -> None:
        """Zero volts, whatever was; may be called twice."""
        self._box.write([0.0] * self._channels)

    @property
    def _channels(self) -> int:
        return 1 + max(output.channel for output in self._outputs)

    def _write(self) -> None:
        """Volts = sign · gain · current; the device's currents have their signs already."""
        output, volts = self.device.output, [0.0] * self._channels
        for wheel in self._outputs:
            braked = output.brake >> (wheel.wheel - 1) & 1
            current = 0.0 if braked else output.currents[wheel.wheel - 1]
            volts[wheel.channel] = wheel.gain * current
        self._box.write(volts)
