"""Sensors of robot and rig, the only inputs of a controller; seeded and reproducible bit for bit.

Wheel speed: encoder on the motor shaft (noise, dead band, counts) → the amplifier's speed (difference over a
sample, first-order filter) → speed monitor → analog input. Current: noise → monitor → analog input.
Accelerometer and gyro: noise → first-order bandwidth → bias → range → analog input. Heading: updated at its
own rate → converter over one turn. Then the sensor faults, then the effects of the machine's sensors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from omnimj.effects import ChannelEffect
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.parts import Motor, Sensors
from omnimj.plant import sensor_chain as chain
from omnimj.plant.faults import Fault
from omnimj.plant.interface import RIG_CHANNELS, robot_channels
from omnimj.plant.sensor_chain import ChannelParameters, ChannelState, SensorFault
from omnimj.signals import Array, Measurement, RigMeasurement

MODES = MappingProxyType(
    {
        "bias": chain.BIASED,
        "freeze": chain.FROZEN,
        "drift": chain.DRIFTING,
        "noise": chain.NOISY,
        "scale": chain.SCALED,
    }
)
"""Modes of sensor faults by name, with their codes in the kernel."""

_BLOCK = 512  # number of samples whose random numbers are drawn at once


class _MachineSensors:
    """Channels of a machine with their states and random numbers, each independent of the other channels.

    The order of the channels is that of the readings.
    """

    def __init__(
        self,
        names: Sequence[str],
        channels: Sequence[ChannelParameters],
        seed: int,
        faults: Sequence[Fault],
        ideal: bool,
        changes: Mapping[str, ChannelEffect] | None,
    ):
        self._seed = _checked_seed(seed)
        self._channels = [_ideal(channel) if ideal else channel for channel in channels]
        acting = sorted((f for f in faults if f.kind == "sensor"), key=lambda f: f.onset)
        self._faults = [_sensor_fault(f, names) for f in acting]
        self._effects = _packed_effects(names, changes or {}, channels[0].period)
        self.values = np.zeros(len(names))
        """Physical quantities that the next sample is taken of, shape (channels,)."""
        self.reset()

    def _streams(self) -> list[np.random.Generator]:
        """One random generator per channel and fault; a fault's depends on channel and rank there."""
        keys = [(0, c) for c in range(len(self._channels))]
        seen = [0] * len(self._channels)
        for fault in self._faults:
            c = int(fault.channel)
            seen[c] += 1
            keys.append((seen[c], c))
        seeds = (np.random.SeedSequence(self._seed, spawn_key=key) for key in keys)
        return [np.random.Generator(np.random.PCG64(s)) for s in seeds]

    def reset(self, seed: int | None = None) -> None:
        """Return to the start of the run, with the noise of a seed; the same noise again when None.

        Raises:
          InputError: A seed that is not a whole number of at least 0.
        """
        if seed is not None:
            self._seed = _checked_seed(seed)
        self._generators = self._streams()
        streams = zip(self._channels, self._generators, strict=False)
        states = [_start(channel, *g.standard_normal(2)) for channel, g in streams]
        self.chain = chain.SensorChain(
            np.array(self._channels),
            np.array(states),
            np.array(self._faults).reshape(-1, chain.FAULT_SIZE),
            np.empty((len(self._generators), _BLOCK)),
            np.array([_BLOCK]),
            self._effects,
            chain.empty_delay_line(self._effects),
        )
        """Arrays of the sensors, for kernels that read them in a loop; `refill` keeps their noise coming."""

    def refill(self) -> None:
        """Draw the next random numbers where all are used."""
        if self.chain.column[0] == _BLOCK:
            for generator, row in zip(self._generators, self.chain.noise, strict=True):
                generator.standard_normal(out=row)
            self.chain.column[0] = 0


class RobotSensors(_MachineSensors):
    """Sensors of a robot with n wheels."""

    def __init__(
        self,
        sensors: Sensors,
        motor: Motor,
        wheels: int,
        period: float,
        seed: int,
        faults: Sequence[Fault] = (),
        ideal: bool = False,
        changes: Mapping[str, ChannelEffect] | None = None,
    ):
        """Prepare the sensors for the start of a run.

        Args:
          sensors: Constants of the chain.
          motor: Motor, for the gear between wheel and encoder.
          wheels: Number of wheels n.
          period: Sample period [s].
          seed: Seed of the noise; equal seeds give equal runs bit for bit.
          faults: Faults of the run, of which those of kind `sensor` act here.
          ideal: Whether to return true values, with the heading wrapped; faults and effects still act.
          changes: Sensor effects by channel.
        """
        n = self._wheels = wheels
        current, speed = _current(sensors, period), _wheel_speed(sensors, motor, period)
        channels = [current] * n + [speed] * n + [_acceleration(sensors, period)] * 2
        channels += [_yaw_rate(sensors, period), _yaw(sensors, period)]
        super().__init__(robot_channels(n), channels, seed, faults, ideal, changes)

    def as_measurement(self, time: float, readings: Array) -> Measurement:
        """Return readings as a measurement.

        Args:
          time: Time of the sample [s].
          readings: Readings in the order of `robot_channels`, shape (2n+4,).
        """
        n, r = self._wheels, readings
        yaw_rate, yaw = r[2 * n + 2 :].tolist()
        return Measurement(time, r[:n], r[n : 2 * n], r[2 * n : 2 * n + 2], yaw_rate, yaw)


class RigSensors(_MachineSensors):
    """Sensors of the test rig: motor encoder and current monitor, measuring wheels, accelerometer.

    Speeds along the rail and of the gantry come from encoders on small measuring wheels, counted by the data
    acquisition itself.
    """

    def __init__(
        self,
        sensors: Sensors,
        motor: Motor,
        period: float,
        seed: int,
        faults: Sequence[Fault] = (),
        ideal: bool = False,
        changes: Mapping[str, ChannelEffect] | None = None,
    ):
        """Prepare the sensors for the start of a run; arguments as for `RobotSensors`."""
        rail = _rail_speed(sensors, period)
        channels = [_current(sensors, period), _wheel_speed(sensors, motor, period), rail]
        channels += [_acceleration(sensors, period), rail]
        super().__init__(RIG_CHANNELS, channels, seed, faults, ideal, changes)

    def as_measurement(self, time: float, readings: Array) -> RigMeasurement:
        """Return readings as a measurement.

        Args:
          time: Time of the sample [s].
          readings: Readings in the order of `RIG_CHANNELS`, shape (5,).
        """
        return RigMeasurement(time, *readings.tolist())


def _checked_seed(seed: int) -> int:
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
        raise InputError("seed", f"found {seed!r}", "must be a whole number of at least 0")
    return int(seed)


def _packed_effects(names: Sequence[str], changes: Mapping[str, ChannelEffect], period: float) -> Array:
    """Packed `chain.ReadingEffect` of the changed channels, shape (m, EFFECT_SIZE)."""
    rows = [
        chain.ReadingEffect(
            names.index(name), change.scale, change.offset, change.delay / period, name == "yaw"
        )
        for name, change in changes.items()
        if name in names  # a pose is measured by others
    ]
    return np.array(rows, float).reshape(-1, chain.EFFECT_SIZE)


def _start(channel: ChannelParameters, first: float, second: float) -> ChannelState:
    """State before the first sample, from two standard normal numbers."""
    bias = channel.spread * first
    if channel.law == chain.ENCODER:
        # somewhere between two counts, the shaft in the middle of its dead band
        angle = second * 2.0 * math.pi
        return ChannelState(angle, angle, float(np.rint(angle / channel.count)) * channel.count, bias=bias)
    if channel.law == chain.FILTERED:
        a = channel.decay
        return ChannelState(filtered=second * channel.noise * math.sqrt((1.0 - a) / (1.0 + a)), bias=bias)
    return ChannelState(bias=bias)


def _converter_step(full_scale: float, bits: int) -> float:
    return 2.0 * full_scale / 2.0**bits


def _current(s: Sensors, period: float) -> ChannelParameters:
    """Current: noise, monitor, analog input."""
    full_scale = s.current_monitor_range
    return ChannelParameters(
        chain.MONITOR,
        period,
        noise=s.current_noise,
        full_scale=full_scale,
        step=_converter_step(full_scale, s.current_monitor_bits),
        daq_step=_converter_step(full_scale, s.daq_input_bits),
    )


def _wheel_speed(s: Sensors, motor: Motor, period: float) -> ChannelParameters:
    """Wheel speed: encoder on the motor shaft, the amplifier's speed, monitor, analog input."""
    full_scale = s.speed_monitor_range
    return ChannelParameters(
        chain.ENCODER,
        period,
        gain=motor.gear_ratio,
        count=2.0 * math.pi / s.encoder_counts,
        hysteresis=s.encoder_hysteresis,
        noise=s.encoder_noise,
        decay=math.exp(-period / s.speed_filter),
        full_scale=full_scale,
        step=_converter_step(full_scale, s.speed_monitor_bits),
        daq_step=_converter_step(full_scale, s.daq_input_bits),
    )


def _rail_speed(s: Sensors, period: float) -> ChannelParameters:
    """Speed over ground: encoder on a measuring wheel, counted by the data acquisition itself."""
    return ChannelParameters(
        chain.ENCODER,
        period,
        gain=1.0 / s.carriage_encoder_radius,
        count=2.0 * math.pi / s.carriage_encoder_counts,
        hysteresis=s.encoder_hysteresis,
        noise=s.carriage_encoder_noise,
        decay=math.exp(-period / s.speed_filter),
    )


def _acceleration(s: Sensors, period: float) -> ChannelParameters:
    """Acceleration along one axis: noise, bandwidth, bias, range, analog input."""
    chain_of = (s.accelerometer_noise, s.accelerometer_bandwidth, s.accelerometer_bias)
    return _filtered(*chain_of, s.accelerometer_range, s.daq_input_bits, period)


def _yaw_rate(s: Sensors, period: float) -> ChannelParameters:
    """Yaw rate of the gyro: the same chain as the accelerometer's."""
    return _filtered(s.gyro_noise, s.gyro_bandwidth, s.gyro_bias, s.gyro_range, s.daq_input_bits, period)


def _filtered(
    noise: float, bandwidth: float, bias: float, full_scale: float, bits: int, period: float
) -> ChannelParameters:
    decay = math.exp(-2.0 * math.pi * bandwidth * period)
    return ChannelParameters(
        chain.FILTERED,
        period,
        # white noise ahead of the filter, scaled so that its RMS behind the filter is `noise`
        noise=noise * math.sqrt((1.0 + decay) / (1.0 - decay)),
        decay=decay,
        full_scale=full_scale,
        daq_step=_converter_step(full_scale, bits),
        spread=bias,
    )


def _yaw(s: Sensors, period: float) -> ChannelParameters:
    """Heading: updated at its own rate, rounded by its converter."""
    # the analog input resolves more finely, and every code of the converter is one of its codes
    step = 2.0 * math.pi / 2.0 ** min(s.yaw_bits, s.daq_input_bits)
    return ChannelParameters(chain.HEADING, period, step=step, updates=s.yaw_update_rate * period, turns=1.0)


def _ideal(channel: ChannelParameters) -> ChannelParameters:
    """Channel that returns the true value."""
    return ChannelParameters(chain.IDEAL, channel.period, turns=channel.turns)


def _sensor_fault(given: Fault, channels: Sequence[str]) -> SensorFault:
    """Convert a sensor fault on one of the named channels for the kernel.

    Raises:
      UnknownNameError: The plant has no such channel, or there is no such mode.
    """
    channel, mode = given.numbers["channel"], given.numbers["mode"]
    if channel not in channels:
        raise UnknownNameError("sensor fault", "channel", channel, channels)
    if mode not in MODES:
        raise UnknownNameError("sensor fault", "mode", mode, MODES)
    return SensorFault(
        channels.index(str(channel)),
        MODES[str(mode)],
        float(given.numbers.get("size", 0.0)),
        given.onset,
        math.inf if given.end is None else given.end,
    )
