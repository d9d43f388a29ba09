"""The sensors of robot and rig: what a controller may see, seeded and reproducible bit for bit.

Wheel speed: encoder on the motor shaft (noise, dead band, counts) → the amplifier's speed (difference over a
sample, first-order filter) → speed monitor → analog input. Current: noise → monitor → analog input.
Accelerometer and gyro: noise → first-order bandwidth → bias → range → analog input. Heading: renewed at its
own rate → converter over one turn. Then the sensor faults, then the effects of the machine's sensors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from omnimj.effects import ChannelEffect
from omnimj.errors import InputError
from omnimj.parameters.parts import Motor, Sensors
from omnimj.plant import sensor_chain as chain
from omnimj.plant import sensor_rows as row_of
from omnimj.plant.effects import ChannelEffects
from omnimj.plant.faults import Fault
from omnimj.plant.interface import RIG_CHANNELS, robot_channels
from omnimj.signals import Array, Measurement, RigMeasurement

_BLOCK = 512  # samples whose random numbers are drawn at once


class _Channels:
    """Channels with their state and their own random numbers: neither knows of the other channels."""

    def __init__(
        self,
        names: Sequence[str],
        rows: Sequence[Array],
        seed: int,
        faults: Sequence[Fault],
        ideal: bool,
        changes: Mapping[str, ChannelEffect] | None,
    ):
        if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
            raise InputError("seed", f"found {seed!r}", "must be a whole number of at least 0")
        self._seed = int(seed)
        self._rows = np.array([row_of.ideal(row) if ideal else row for row in rows])
        acting = sorted((f for f in faults if f.kind == "sensor"), key=lambda f: f.onset)
        fault_rows = [row_of.fault(f, names) for f in acting]
        self._fault_rows = np.array(fault_rows).reshape(-1, chain.FAULT_ROW)
        self._changes = ChannelEffects(names, changes, rows[0][chain.PERIOD]) if changes else None
        self.values = np.zeros(len(names))
        self.reset()

    def _streams(self) -> list[np.random.Generator]:
        """One per channel and one per fault, which depends on its channel and its turn there only."""
        keys = [(0, c) for c in range(len(self._rows))]
        seen = [0] * len(self._rows)
        for c in self._fault_rows[:, chain.CHANNEL].astype(int):
            seen[c] += 1
            keys.append((seen[c], int(c)))
        seeds = (np.random.SeedSequence(self._seed, spawn_key=key) for key in keys)
        return [np.random.Generator(np.random.PCG64(s)) for s in seeds]

    def reset(self) -> None:
        """Back to the start of the same run: the same numbers come again."""
        self._generators = self._streams()
        self._faults = self._fault_rows.copy()
        if self._changes is not None:
            self._changes.reset()
        self._states = np.zeros((len(self._rows), chain.STATE_ROW))
        self._states[:, chain.LAST] = np.nan
        for c, (row, state) in enumerate(zip(self._rows, self._states, strict=True)):
            first, start = self._generators[c].standard_normal(2)
            state[chain.BIAS] = row[chain.SPREAD] * first
            if row[chain.LAW] == chain.ENCODER:
                # somewhere between two counts, the shaft in the middle of its dead band
                state[chain.ANGLE] = state[chain.BEHIND] = start * 2.0 * math.pi
                state[chain.COUNTED] = np.rint(state[chain.BEHIND] / row[chain.COUNT]) * row[chain.COUNT]
            elif row[chain.LAW] == chain.FILTERED:
                a = row[chain.DECAY]
                state[chain.FILTER] = start * row[chain.NOISE] * math.sqrt((1.0 - a) / (1.0 + a))
        self._noise = np.empty((len(self._generators), _BLOCK))
        self._column = _BLOCK

    def read(self, time: float) -> Array:
        """Readings of `values` at a time [s], a fresh array."""
        if self._column == _BLOCK:
            for generator, row in zip(self._generators, self._noise, strict=True):
                generator.standard_normal(out=row)
            self._column = 0
        column = self._column
        self._column = column + 1
        readings = chain.sample_channels(
            self._rows, self._states, self._faults, self._noise, column, time, self.values
        )
        if self._changes is not None:
            self._changes.apply(readings)
        return readings


class RobotSensors:
    """Sensors of a robot with n wheels; each instance is a set of its own."""

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
        """Sensors at the start of a run.

        Args:
          sensors: Constants of the chain.
          motor: Gives the gear between wheel and encoder.
          wheels: Number of wheels n.
          period: Time between two samples [s].
          seed: The same seed gives the same run bit for bit.
          faults: Those of kind `sensor` act here.
          ideal: No chain: true values, the heading wrapped; faults and effects still act.
          changes: What effects make of single channels' readings.
        """
        n = self._wheels = wheels
        current, speed = row_of.current(sensors, period), row_of.wheel_speed(sensors, motor, period)
        rows = [current] * n + [speed] * n + [row_of.acceleration(sensors, period)] * 2
        rows += [row_of.yaw_rate(sensors, period), row_of.yaw(sensors, period)]
        self._channels = _Channels(robot_channels(n), rows, seed, faults, ideal, changes)

    def reset(self) -> None:
        """Back to the start of the same run: the same readings come again."""
        self._channels.reset()

    def measure(
        self,
        time: float,
        current: ArrayLike,
        wheel_speed: ArrayLike,
        acceleration: ArrayLike,
        yaw_rate: float,
        heading: float,
    ) -> Measurement:
        """One sample; to be called once per period.

        Args:
          time: Time of the sample [s].
          current: True currents, shape (n,) [A].
          wheel_speed: True wheel speeds after the gear, shape (n,) [rad/s].
          acceleration: Body-frame acceleration at the centre, shape (2,) [m/s²].
          yaw_rate: True yaw rate [rad/s].
          heading: True heading, wrapped or not [rad].

        Returns:
          Fresh arrays; a quantity that is not finite is read as NaN.
        """
        n, values = self._wheels, self._channels.values
        values[:n] = current
        values[n : 2 * n] = wheel_speed
        values[2 * n : 2 * n + 2] = acceleration
        values[2 * n + 2] = yaw_rate
        values[2 * n + 3] = heading
        time = float(time)  # an integer would make the kernel compile anew
        r = self._channels.read(time)
        yaw_rate, yaw = r[2 * n + 2 :].tolist()
        return Measurement(time, r[:n], r[n : 2 * n], r[2 * n : 2 * n + 2], yaw_rate, yaw)


class RigSensors:
    """Sensors of the test rig: motor encoder and current monitor, measuring wheels, accelerometer.

    Speeds along the rail and of the gantry come from encoders on small measuring wheels that the data
    acquisition counts itself.
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
        """Sensors at the start of a run; arguments as for `RobotSensors`."""
        rail = row_of.rail_speed(sensors, period)
        rows = [row_of.current(sensors, period), row_of.wheel_speed(sensors, motor, period), rail]
        rows += [row_of.acceleration(sensors, period), rail]
        self._channels = _Channels(RIG_CHANNELS, rows, seed, faults, ideal, changes)

    def reset(self) -> None:
        """Back to the start of the same run: the same readings come again."""
        self._channels.reset()

    def measure(
        self,
        time: float,
        current: float,
        wheel_speed: float,
        carriage_speed: float,
        carriage_acceleration: float,
        lateral_speed: float,
    ) -> RigMeasurement:
        """One sample; to be called once per period. Units as in `RigMeasurement`."""
        values = self._channels.values
        values[0], values[1], values[2] = current, wheel_speed, carriage_speed
        values[3], values[4] = carriage_acceleration, lateral_speed
        time = float(time)  # an integer would make the kernel compile anew
        return RigMeasurement(time, *self._channels.read(time).tolist())
