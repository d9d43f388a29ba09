"""Conversion between raw readings and SI units: gain, sign, offset, filter and wrap of `[hardware]`.

Only the host calibrates, so that recordings of raw readings can be read again with a better calibration.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.errors import InputError
from omnimj.link.codec.messages import ChannelKind, Limits, Quantity, Raw
from omnimj.link.device.config import CurrentDecoder, DeviceConfig, WheelSpeedDecoder, short_hash
from omnimj.link.device.limits import round_to_float32
from omnimj.parameters.hardware import Hardware, HardwareInput
from omnimj.parameters.robot import Robot
from omnimj.signals import Array, CurrentCommand, Measurement

_TURN = 2.0 * math.pi
_UNUSED = ChannelKind(Quantity.OTHER, 0, Raw.VOLTS)


def require_hardware(robot: Robot) -> Hardware:
    """Wiring of a robot, which must have one.

    Raises:
      InputError: The model file has no wiring, so the robot cannot be driven over a link.
    """
    if robot.hardware is None:
        raise InputError(robot.file, "there is no [hardware]", "a plant behind a wire needs its tables")
    return robot.hardware


def channel_kind(channel: HardwareInput) -> ChannelKind:
    """Kind that the device must report for a channel."""
    return ChannelKind(Quantity[channel.quantity.upper()], channel.wheel, Raw[channel.raw.upper()])


def channel_kinds(hardware: Hardware) -> tuple[ChannelKind, ...]:
    """Kinds of all channels of a device; channels unused by the wiring are `OTHER`."""
    kinds = [_UNUSED] * (1 + max(channel.channel for channel in hardware.inputs))
    for channel in hardware.inputs:
        kinds[channel.channel] = channel_kind(channel)
    return tuple(kinds)


def rounded_limits(hardware: Hardware) -> Limits:
    """Limits of the device, rounded to float32."""
    return round_to_float32(Limits(**dataclasses.asdict(hardware.limits)))


def canonical_text(hardware: Hardware) -> str:
    """Format the calibration as ASCII text, equal for equal wirings; every line ends with a line feed.

    `omnimj calibration 1`, then by increasing channel
    `input NAME QUANTITY RAW CHANNEL SIGN GAIN OFFSET FILTER WRAP`, then by increasing wheel
    `output WHEEL CHANNEL SIGN GAIN UNIT`; one space between words, real numbers as C's `%.17g`, integers as
    `%d`.
    """
    inputs = [
        f"input {i.name} {i.quantity} {i.raw} {i.channel} {i.sign} "
        f"{i.gain:.17g} {i.offset:.17g} {i.filter:.17g} {i.wrap:.17g}"
        for i in sorted(hardware.inputs, key=lambda i: i.channel)
    ]
    outputs = [
        f"output {o.wheel} {o.channel} {o.sign} {o.gain:.17g} {o.unit}"
        for o in sorted(hardware.outputs, key=lambda o: o.wheel)
    ]
    return "\n".join(["omnimj calibration 1", *inputs, *outputs, ""])


def calibration_hash(hardware: Hardware) -> int:
    """Hash of `canonical_text` that host and device compare."""
    return short_hash(canonical_text(hardware).encode("ascii"))


@dataclass(frozen=True)
class WheelMap:
    """Assignment of wheels to channels of the device: the host's wheel i is channel `channels[i − 1]`."""

    channels: tuple[int, ...]
    """Permutation of 0…n−1."""
    factors: tuple[float, ...]
    """Current at the device per ampere of the host's wheel i, at index i − 1 [A/A]."""

    @classmethod
    def from_hardware(cls, hardware: Hardware) -> WheelMap:
        """Build the assignment of a wiring; an analog box takes currents in the order of the wheels."""
        analog = hardware.outputs[0].unit == "V/A"
        channels = [o.wheel - 1 if analog else o.channel for o in hardware.outputs]
        factors = [o.sign * (1.0 if analog else o.gain) for o in hardware.outputs]
        return cls(tuple(channels), tuple(factors))

    def to_device(self, command: CurrentCommand) -> tuple[tuple[float, ...], int]:
        """Convert a command of the host to the device's currents, shape (n,) [A], and brake bits."""
        currents = [0.0] * len(self.channels)
        for channel, factor, current in zip(
            self.channels, self.factors, command.current.tolist(), strict=True
        ):
            currents[channel] = factor * current
        return tuple(currents), sum(1 << self.channels[wheel - 1] for wheel in command.brake)

    def from_device(self, currents: Sequence[float], brake: int) -> CurrentCommand:
        """Convert the device's currents, shape (n,) [A], and brake bits to a command of the host."""
        own = [
            currents[channel] / factor for channel, factor in zip(self.channels, self.factors, strict=True)
        ]
        wheels = range(1, len(self.channels) + 1)
        return CurrentCommand(np.array(own), tuple(w for w in wheels if brake >> self.channels[w - 1] & 1))


class Calibration:
    """Conversion of raw readings into measurements, with the state of filters and counters."""

    def __init__(self, hardware: Hardware):
        """Prepare for a run."""
        inputs = self._inputs = hardware.inputs
        self._wheels = (len(inputs) - 4) // 2
        self._order = np.array([i.channel for i in inputs])
        self._gain = np.array([i.sign * i.gain for i in inputs])
        self._offset = np.array([i.offset for i in inputs])
        self._angles = [k for k, i in enumerate(inputs) if i.quantity == "wheel_angle"]
        self._filtered = [k for k, i in enumerate(inputs) if i.filter > 0.0]
        self.reset()

    def reset(self) -> None:
        """Reset filters and counters."""
        self._time = math.nan
        self._previous: dict[int, tuple[float, float]] = {}
        self._speeds: dict[int, float] = {}
        self._filter_state: dict[int, float] = {}

    def convert(self, time: float, raw: Sequence[float]) -> Measurement:
        """Convert one sample of raw readings to a measurement in SI units.

        A wheel speed from an angle is the difference quotient over the samples' own times; it is 0 at the
        first sample, since a robot is armed at rest, and unchanged if time does not increase. A reading that
        is not finite becomes NaN and does not enter filters and counters.

        Args:
          time: Time of the sample [s].
          raw: Volts or counts of all channels of the device.
        """
        found = np.asarray(raw, dtype=float)[self._order]
        values = self._gain * (found - self._offset)
        n = self._wheels
        if self._angles:
            self._differentiate(time, found, values)
        if self._filtered:
            self._filter(time, values)
        self._time = time
        values[~np.isfinite(values)] = math.nan
        yaw = float(values[2 * n + 3]) % _TURN
        return Measurement(
            time,
            values[:n],
            values[n : 2 * n],
            values[2 * n : 2 * n + 2],
            float(values[2 * n + 2]),
            0.0 if yaw >= _TURN else yaw,
        )

    def _differentiate(self, time: float, found: Array, values: Array) -> None:
        """Set wheel speed = gain · wrapped difference of the raw angle / elapsed time."""
        for k in self._angles:
            raw, wrap = float(found[k]), self._inputs[k].wrap
            if not math.isfinite(raw):
                continue
            before, then = self._previous.get(k, (raw, math.nan))
            if time > then:
                turned = raw - before
                if wrap > 0.0:
                    turned -= wrap * round(turned / wrap)
                self._speeds[k] = float(self._gain[k]) * turned / (time - then)
            if not time <= then:
                self._previous[k] = raw, time
            values[k] = self._speeds.get(k, 0.0)

    def _filter(self, time: float, values: Array) -> None:
        """Low-pass filter y += (1 − e^(−Δt/τ)) (x − y); the difference of headings is wrapped to ±π."""
        elapsed = time - self._time
        for k in self._filtered:
            x, y = float(values[k]), self._filter_state.get(k, math.nan)
            if not math.isfinite(x):
                continue
            if math.isfinite(y):
                away = x - y
                if self._inputs[k].quantity == "yaw":
                    away -= _TURN * round(away / _TURN)
                x = y + (1.0 - math.exp(-max(elapsed, 0.0) / self._inputs[k].filter)) * away
            self._filter_state[k] = values[k] = x


def wheel_speed_decoder(hardware: Hardware) -> WheelSpeedDecoder:
    """Function by which a device computes its wheel speeds from raw readings, in its own order of wheels."""
    calibration, channels = Calibration(hardware), WheelMap.from_hardware(hardware).channels

    def speeds(now: float, raw: Sequence[float]) -> tuple[float, ...]:
        measured = calibration.convert(now, raw).wheel_speed.tolist()
        ordered = [0.0] * len(channels)
        for channel, speed in zip(channels, measured, strict=True):
            ordered[channel] = speed
        return tuple(ordered)

    return speeds


def motor_current_decoder(hardware: Hardware) -> CurrentDecoder:
    """Function by which a device computes the currents of its amplifiers from raw readings, unfiltered."""
    wheels = WheelMap.from_hardware(hardware)
    inputs = {i.wheel: i for i in hardware.inputs if i.quantity == "current"}

    def currents(raw: Sequence[float]) -> tuple[float, ...]:
        found = [0.0] * len(wheels.channels)
        for wheel, (channel, factor) in enumerate(zip(wheels.channels, wheels.factors, strict=True), start=1):
            i = inputs[wheel]
            found[channel] = factor * i.sign * i.gain * (raw[i.channel] - i.offset)
        return tuple(found)

    return currents


def device_config(
    hardware: Hardware, period: float, *, lock_step: bool = False, keyed: bool = False
) -> DeviceConfig:
    """Configuration of a device with this wiring.

    Args:
      hardware: Wiring.
      period: Time between two ticks [s].
      lock_step: Whether its time advances by one period per command.
      keyed: Whether it accepts authentic frames only.
    """
    wheels, kinds, limits = len(hardware.outputs), channel_kinds(hardware), rounded_limits(hardware)
    calibration = calibration_hash(hardware)
    return DeviceConfig(wheels, period, kinds, limits, calibration, lock_step, keyed, hardware.device)
