"""Emulated device: a simulated plant behind the rules of a device.

The inverse of the calibration converts measurements to raw readings, in float32 as on the wire. Defects of
the wiring can be added, which `omnimj link check` must find.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from omnimj.errors import InputError, UnknownNameError
from omnimj.link.calibration import (
    WheelMap,
    channel_kinds,
    device_config,
    motor_current_decoder,
    wheel_speed_decoder,
)
from omnimj.link.codec.messages import Frame, Raw, Telemetry
from omnimj.link.device.state_machine import Device
from omnimj.parameters.hardware import Hardware
from omnimj.plant.interface import Plant
from omnimj.signals import Measurement

DEFECT_KINDS = ("sign", "gain", "dead")
"""Defects of a channel (`wheel_speed_2`) or motor (`motor_3`): inverted, scaled by `value`, disconnected."""
_HALF, _WHOLE = 2.0**31, 2.0**32


@dataclass(frozen=True, slots=True)
class WiringDefect:
    """Defect of the wiring."""

    kind: str
    """One of `DEFECT_KINDS`."""
    place: str
    """Channel of the robot, or `motor_1`, …"""
    value: float = 1.0
    """Ratio of the measured or actual value to the correct one, for kind `gain`."""

    @property
    def factor(self) -> float:
        """Factor on the correct value."""
        return {"sign": -1.0, "gain": self.value, "dead": 0.0}[self.kind]


class RawEncoder:
    """Encoder of measurements in SI units as raw readings of the device's converters and counters."""

    def __init__(self, hardware: Hardware, defects: Sequence[WiringDefect] = ()):
        """Start with counters at zero.

        Args:
          hardware: Wiring, with the calibration of every channel.
          defects: Defects of the wiring.
        """
        self._inputs, self._kinds = hardware.inputs, channel_kinds(hardware)
        named = {i.name: k for k, i in enumerate(hardware.inputs)}
        self._factor = np.ones(len(named))
        for defect in defects:
            if defect.place in named:
                self._factor[named[defect.place]] *= defect.factor
        self._gain = np.array([i.sign * i.gain for i in hardware.inputs])
        self._offset = np.array([i.offset for i in hardware.inputs])
        self._angles = [k for k, i in enumerate(hardware.inputs) if i.quantity == "wheel_angle"]
        self.reset()

    def reset(self) -> None:
        """Set counters to zero."""
        self._angle = dict.fromkeys(self._angles, 0.0)

    def encode(self, measured: Measurement, elapsed: float) -> tuple[float, ...]:
        """Encode a measurement: sign · SI / gain + offset; a wheel angle is the wrapped sum of speed × time.

        Args:
          measured: Measurement of the plant.
          elapsed: Time since the previous measurement [s].

        Returns:
          Volts or counts of every channel of the device.
        """
        values = np.concatenate(
            (measured.current, measured.wheel_speed, measured.acceleration, (measured.yaw_rate, measured.yaw))
        )
        values *= self._factor
        for k in self._angles:
            self._angle[k] += float(values[k]) * elapsed if math.isfinite(values[k]) else 0.0
            values[k] = self._angle[k]
        with np.errstate(over="ignore"):  # numbers beyond float32 become infinite
            raw = (values / self._gain + self._offset).astype(np.float64)
            rounded = raw.astype(np.float32).tolist()
        found = [0.0] * len(self._kinds)
        for k, channel in enumerate(self._inputs):
            counts = self._kinds[channel.channel].raw is Raw.COUNTS
            wrap = channel.wrap if k in self._angle else 0.0
            found[channel.channel] = _wrap_count(float(raw[k]), wrap) if counts else rounded[k]
        return tuple(found)


def _wrap_count(value: float, wrap: float) -> int:
    """Nearest count of a counter that wraps at `wrap`, or at 32 bits."""
    if not math.isfinite(value):
        return 0
    count = float(round(value))
    if 0.0 < wrap < _WHOLE:
        return int(count % wrap)
    return int((count + _HALF) % _WHOLE - _HALF)


class EmulatedDevice:
    """Simulated plant, the device in front of it, and the defects of the wiring between them.

    Each session resets the plant. In lock-step, frames alone drive it. In real time, the owner of the clock
    calls `tick` once per period, and the plant is reset again when the session is armed for the first time:
    the onset times of the faults of a scenario count from there, as on the host.
    """

    def __init__(
        self,
        plant: Plant,
        hardware: Hardware,
        new_session: Callable[[], int],
        *,
        lock_step: bool,
        keyed: bool = False,
        defects: Sequence[WiringDefect] = (),
        late: int = 0,
        now: float = 0.0,
    ):
        """Reset the plant and power up the device.

        Args:
          plant: Plant of a robot; the caller closes it.
          hardware: Wiring with which the device is configured.
          new_session: Returns 32 fresh random bits.
          lock_step: Whether time advances by one period per command instead of per tick.
          keyed: Whether only authentic frames are accepted.
          defects: Defects of the wiring.
          late: Delay of the readings in periods; telemetry carries the time of their sample.
          now: Time [s].

        Raises:
          UnknownNameError: Unknown kind or place of a defect.
          InputError: The plant is no robot, or the wiring has another number of wheels.
        """
        n = len(hardware.outputs)
        places = [i.name for i in hardware.inputs] + [f"motor_{i}" for i in range(1, n + 1)]
        for defect in defects:
            if defect.kind not in DEFECT_KINDS:
                raise UnknownNameError("--defect", "kind", defect.kind, DEFECT_KINDS)
            if defect.place not in places:
                raise UnknownNameError("--defect", "place", defect.place, places)
        config = device_config(hardware, plant.period, lock_step=lock_step, keyed=keyed)
        currents = motor_current_decoder(hardware)
        self.device = Device(config, wheel_speed_decoder(hardware), new_session, now, currents=currents)
        self._plant, self._encoder, self._wheels = (
            plant,
            RawEncoder(hardware, defects),
            WheelMap.from_hardware(hardware),
        )
        self._motors = np.ones(n)
        for defect in defects:
            if defect.place.startswith("motor_"):
                self._motors[int(defect.place[6:]) - 1] *= defect.factor
        self._periods, self._session, self._was_armed = 0, 0, False
        self._samples: deque[tuple[float, tuple[float, ...]]] = deque(maxlen=late + 1)
        self._begin_run()
        if len(self._measured.current) != n:
            found = f"found {len(self._measured.current)} wheels"
            raise InputError("plant", found, f"the wiring is for {n}")

    def on_frame(self, now: float, frame: Frame, peer: bytes = b"") -> tuple[Frame, ...]:
        """Process a frame and return the frames to send, as `Device.on_frame`.

        Args:
          now: Time [s]; ignored in lock-step, which has its own.
          frame: Received frame.
          peer: Address of its sender.
        """
        if not self.device.config.lock_step:
            return self._on_frame_in_real_time(now, frame, peer)
        answer = self.device.on_frame(self._time, frame, peer)
        if self.device.session not in (0, self._session):
            self._session = self.device.session
            self._begin_run()
            self._tick_device(self._time, 0.0)
        if self.device.step_due:
            answer += self._step(self._time + self._plant.period)
        return answer

    def _on_frame_in_real_time(self, now: float, frame: Frame, peer: bytes) -> tuple[Frame, ...]:
        answer = self.device.on_frame(now, frame, peer)
        if self.device.session not in (0, self._session):
            self._session, self._was_armed = self.device.session, False
            self._begin_run()
        if self.device.armed and not self._was_armed:
            self._was_armed = True
            self._measured = self._reset_plant()  # counters keep their values
        return answer

    def tick(self, now: float) -> tuple[Frame, ...]:
        """End a period in real time at `now` [s] and return the frames to send to the session's host."""
        return self._step(now)

    def time(self, now: float) -> float:
        """Time of the device's clock: `now`, or simulated time in lock-step [s]."""
        return self._time if self.device.config.lock_step else now

    @property
    def _time(self) -> float:
        """Simulated time in lock-step, which continues over sessions [s]."""
        return self._periods * self._plant.period

    def _reset_plant(self) -> Measurement:
        """Reset the plant."""
        measured = self._plant.reset()
        if not isinstance(measured, Measurement):
            raise InputError("plant", "found the test rig", "a robot is needed")
        return measured

    def _begin_run(self) -> None:
        """Begin a run, with counters at zero."""
        self._measured = self._reset_plant()
        self._encoder.reset()
        self._samples.clear()

    def _step(self, now: float) -> tuple[Frame, ...]:
        """Advance the plant by one period under the amplifiers' set values, then tick the device."""
        output = self.device.output
        command = self._wheels.from_device(output.currents, output.brake)
        measured = self._plant.step(replace(command, current=self._motors * command.current))
        assert isinstance(measured, Measurement)
        self._measured = measured
        self._periods += 1
        return self._tick_device(now, self._plant.period)

    def _tick_device(self, now: float, elapsed: float) -> tuple[Frame, ...]:
        """Tick the device with the present readings, or with earlier ones if they are delayed."""
        self._samples.append((now, self._encoder.encode(self._measured, elapsed)))
        time, raw = self._samples[0]
        frames = self.device.tick(now, raw)
        stamp = round(1e6 * time)
        return tuple(replace(f, time=stamp) if isinstance(f.message, Telemetry) else f for f in frames)
