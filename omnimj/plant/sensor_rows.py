"""The constants of each sensor as the numbers of its channel in the kernel, and faults as theirs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from omnimj.errors import UnknownNameError
from omnimj.parameters.parts import Motor, Sensors
from omnimj.plant import sensor_chain as chain
from omnimj.plant.faults import Fault
from omnimj.signals import Array

MODES = MappingProxyType(
    {
        "bias": chain.BIASED,
        "freeze": chain.FROZEN,
        "drift": chain.DRIFTING,
        "noise": chain.NOISY,
        "scale": chain.SCALED,
    }
)
"""Sensor faults by name, with their codes in the kernel."""


def _row(law: int, period: float, **numbers: float) -> Array:
    row = np.zeros(chain.CHANNEL_ROW)
    row[chain.LAW], row[chain.GAIN], row[chain.PERIOD], row[chain.RANGE] = law, 1.0, period, np.inf
    for name, value in numbers.items():
        row[getattr(chain, name.upper())] = value
    return row


def _step(full_scale: float, bits: int) -> float:
    return 2.0 * full_scale / 2.0**bits


def current(s: Sensors, period: float) -> Array:
    """Current: noise, monitor, analog input."""
    full_scale = s.current_monitor_range
    return _row(
        chain.MONITOR,
        period,
        noise=s.current_noise,
        range=full_scale,
        step=_step(full_scale, s.current_monitor_bits),
        daq_step=_step(full_scale, s.daq_input_bits),
    )


def wheel_speed(s: Sensors, motor: Motor, period: float) -> Array:
    """Wheel speed: encoder on the motor shaft, the amplifier's speed, monitor, analog input."""
    full_scale = s.speed_monitor_range
    return _row(
        chain.ENCODER,
        period,
        gain=motor.gear_ratio,
        count=2.0 * math.pi / s.encoder_counts,
        hysteresis=s.encoder_hysteresis,
        noise=s.encoder_noise,
        decay=math.exp(-period / s.speed_filter),
        range=full_scale,
        step=_step(full_scale, s.speed_monitor_bits),
        daq_step=_step(full_scale, s.daq_input_bits),
    )


def rail_speed(s: Sensors, period: float) -> Array:
    """Speed over ground: encoder on a measuring wheel, counted by the data acquisition itself."""
    return _row(
        chain.ENCODER,
        period,
        gain=1.0 / s.carriage_encoder_radius,
        count=2.0 * math.pi / s.carriage_encoder_counts,
        hysteresis=s.encoder_hysteresis,
        noise=s.carriage_encoder_noise,
        decay=math.exp(-period / s.speed_filter),
    )


def _filtered(
    period: float, full_scale: float, noise: float, bandwidth: float, spread: float, bits: int
) -> Array:
    decay = math.exp(-2.0 * math.pi * bandwidth * period)
    return _row(
        chain.FILTERED,
        period,
        # white noise in front of the filter, of such a size that its rms behind it is `noise`
        noise=noise * math.sqrt((1.0 + decay) / (1.0 - decay)),
        decay=decay,
        spread=spread,
        range=full_scale,
        daq_step=_step(full_scale, bits),
    )


def acceleration(s: Sensors, period: float) -> Array:
    """Acceleration along one axis: noise, bandwidth, bias, range, analog input."""
    full_scale, noise = s.accelerometer_range, s.accelerometer_noise
    bandwidth, bias = s.accelerometer_bandwidth, s.accelerometer_bias
    return _filtered(period, full_scale, noise, bandwidth, bias, s.daq_input_bits)


def yaw_rate(s: Sensors, period: float) -> Array:
    """Yaw rate of the gyro: the same chain as the accelerometer's."""
    return _filtered(period, s.gyro_range, s.gyro_noise, s.gyro_bandwidth, s.gyro_bias, s.daq_input_bits)


def yaw(s: Sensors, period: float) -> Array:
    """Heading: renewed at its own rate, on the grid of its converter."""
    # the analog input is the finer one and has the converter's codes among its own
    step = 2.0 * math.pi / 2.0 ** min(s.yaw_bits, s.daq_input_bits)
    return _row(chain.HEADING, period, step=step, updates=s.yaw_update_rate * period, turns=1.0)


def ideal(row: Array) -> Array:
    """The same channel without a chain."""
    return _row(chain.IDEAL, row[chain.PERIOD], turns=row[chain.TURNS])


def fault(given: Fault, channels: Sequence[str]) -> Array:
    """A sensor fault on one of the named channels.

    Raises:
      UnknownNameError: The plant has no such channel, or there is no such mode.
    """
    channel, mode = given.numbers["channel"], given.numbers["mode"]
    if channel not in channels:
        raise UnknownNameError("sensor fault", "channel", channel, channels)
    if mode not in MODES:
        raise UnknownNameError("sensor fault", "mode", mode, MODES)
    row = np.full(chain.FAULT_ROW, np.nan)
    row[chain.CHANNEL], row[chain.MODE] = channels.index(str(channel)), MODES[str(mode)]
    row[chain.SIZE] = given.numbers.get("size", 0.0)
    row[chain.ONSET] = given.onset
    row[chain.END] = np.inf if given.end is None else given.end
    return row
