"""A simulated plant behind the device's rules: what most users drive, since most have no robot.

The plant's physics becomes raw numbers by the inverse of the calibration, float32 as on the wire. Defects of
the wiring may be put in, which a bench check must find.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from omnimj.errors import InputError, UnknownNameError
from omnimj.link.calibration import WheelMap, channel_kinds, device_config, wheel_speed_decoder
from omnimj.link.codec.messages import Frame, Raw, Telemetry
from omnimj.link.device.state_machine import Device
from omnimj.parameters.hardware import Hardware
from omnimj.plant.interface import Plant
from omnimj.signals import Measurement

DEFECT_KINDS = ("sign", "gain", "dead")
"""Of a channel (`wheel_speed_2`) or a motor (`motor_3`): turned round, scaled by `value`, without effect."""
_HALF, _WHOLE = 2.0**31, 2.0**32


@dataclass(frozen=True, slots=True)
class WiringDefect:
    """Something that is wired wrongly."""

    kind: str
    """One of `DEFECT_KINDS`."""
    place: str
    """Channel of the robot, or `motor_1` …"""
    value: float = 1.0
    """Of `gain`: what is measured, or flows, over what should be."""

    @property
    def factor(self) -> float:
        """What the right number is multiplied by."""
        return {"sign": -1.0, "gain": self.value, "dead": 0.0}[self.kind]


class RawEncoder:
    """What the device's converters and counters say of a measurement."""

    def __init__(self, hardware: Hardware, defects: Sequence[WiringDefect] = ()):
        """Counters at zero."""
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
        """Counters at zero again."""
        self._angle = dict.fromkeys(self._angles, 0.0)

    def of(self, measured: Measurement, elapsed: float) -> tuple[float, ...]:
        """Raw = sign · SI / gain + offset; a wheel angle is the sum of speed × time, wrapped.

        Args:
          measured: What the plant says.
          elapsed: Since the measurement before [s].
        """
        values = np.concatenate(
            (measured.current, measured.wheel_speed, measured.acceleration, (measured.yaw_rate, measured.yaw))
        )
        values *= self._factor
        for k in self._angles:
            self._angle[k] += float(values[k]) * elapsed if math.isfinite(values[k]) else 0.0
            values[k] = self._angle[k]
        with np.errstate(over="ignore"):  # what float32 cannot hold is infinite there
            raw = (values / self._gain + self._offset).astype(np.float64)
            rounded = raw.astype(np.float32).tolist()
        found = [0.0] * len(self._kinds)
        for k, channel in enumerate(self._inputs):
            counts = self._kinds[channel.channel].raw is Raw.COUNTS
            wrap = channel.wrap if k in self._angle else 0.0
            found[channel.channel] = _wrap_count(float(raw[k]), wrap) if counts else rounded[k]
        return tuple(found)


def _wrap_count(value: float, wrap: float) -> int:
    """The nearest count as a counter of 32 bits shows it, or one that begins anew at `wrap`."""
    if not math.isfinite(value):
        return 0
    count = float(round(value))
    if 0.0 < wrap < _WHOLE:
        return int(count % wrap)
    return int((count + _HALF) % _WHOLE - _HALF)


class EmulatedDevice:
    """A plant, the device in front of it, and what is wired wrongly between the two.

    Each session begins the plant's run anew. In lock-step, frames are all it needs. In real time, `tick` is
    called once per period by whoever has the clock, and the run begins once more when the session is armed
    for the first time: faults of a scenario have their times from there, as the host's clock has.
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
        """The plant at its start, the device after power-up.

        Args:
          plant: Of a robot; the caller closes it.
          hardware: The wiring that the device was commissioned with.
          new_session: 32 random bits, fresh at each call.
          lock_step: One period per command instead of one per tick.
          keyed: Only authentic frames count.
          defects: What is wired wrongly.
          late: So many periods old are the readings that are sent, with the time of their sample.
          now: Clock [s].

        Raises:
          UnknownNameError: A defect of an unknown kind, or somewhere that does not exist.
          InputError: The plant is no robot with as many wheels as the wiring.
        """
        n = len(hardware.outputs)
        places = [i.name for i in hardware.inputs] + [f"motor_{i}" for i in range(1, n + 1)]
        for defect in defects:
            if defect.kind not in DEFECT_KINDS:
                raise UnknownNameError("--defect", "kind", defect.kind, DEFECT_KINDS)
            if defect.place not in places:
                raise UnknownNameError("--defect", "place", defect.place, places)
        commissioned = device_config(hardware, plant.period, lock_step=lock_step, keyed=keyed)
        self.device = Device(commissioned, wheel_speed_decoder(hardware), new_session, now)
        self._plant, self._readings, self._wheels = (
            plant,
            RawEncoder(hardware, defects),
            WheelMap.of(hardware),
        )
        self._motors = np.ones(n)
        for defect in defects:
            if defect.place.startswith("motor_"):
                self._motors[int(defect.place[6:]) - 1] *= defect.factor
        self._periods, self._session, self._has_begun = 0, 0, False
        self._taken: deque[tuple[float, tuple[float, ...]]] = deque(maxlen=late + 1)
        self._start()
        if len(self._measured.current) != n:
            found = f"found {len(self._measured.current)} wheels"
            raise InputError("plant", found, f"the wiring is for {n}")

    def on_frame(self, now: float, frame: Frame) -> tuple[Frame, ...]:
        """What is to be sent in answer, as by `Device.on_frame`.

        Args:
          now: Clock [s]; lock-step has its own.
          frame: From the wire.
        """
        if not self.device.commissioned.lock_step:
            return self._on_frame_in_time(now, frame)
        answer = self.device.on_frame(self._time, frame)
        if self.device.session != self._session:
            self._session = self.device.session
            self._start()
            self._tell(self._time, 0.0)
        if self.device.step_due:
            answer += self._step(self._time + self._plant.period)
        return answer

    def _on_frame_in_time(self, now: float, frame: Frame) -> tuple[Frame, ...]:
        answer = self.device.on_frame(now, frame)
        if self.device.session != self._session:
            self._session, self._has_begun = self.device.session, False
            self._start()
        if self.device.armed and not self._has_begun:
            self._has_begun = True
            self._measured = self._begun()  # counters go on
        return answer

    def tick(self, now: float) -> tuple[Frame, ...]:
        """Real time: one period is over [s]; what is to be sent to the session's host."""
        return self._step(now)

    def time(self, now: float) -> float:
        """Of the device's clock: `now`, or in lock-step its own [s]."""
        return self._time if self.device.commissioned.lock_step else now

    @property
    def _time(self) -> float:
        """Of lock-step, which goes on from session to session [s]."""
        return self._periods * self._plant.period

    def _begun(self) -> Measurement:
        """The plant at its start."""
        measured = self._plant.reset()
        if not isinstance(measured, Measurement):
            raise InputError("plant", "found the test rig", "a robot is needed")
        return measured

    def _start(self) -> None:
        """The run from its beginning, counters at zero."""
        self._measured = self._begun()
        self._readings.reset()
        self._taken.clear()

    def _step(self, now: float) -> tuple[Frame, ...]:
        """The plant's next period under what the amplifiers get, then the device's tick."""
        output = self.device.output
        command = self._wheels.meant(output.currents, output.brake)
        measured = self._plant.step(replace(command, current=self._motors * command.current))
        assert isinstance(measured, Measurement)
        self._measured = measured
        self._periods += 1
        return self._tell(now, self._plant.period)

    def _tell(self, now: float, elapsed: float) -> tuple[Frame, ...]:
        """The device's tick with the readings of now, or of as much earlier as they are late."""
        self._taken.append((now, self._readings.of(self._measured, elapsed)))
        time, raw = self._taken[0]
        said = self.device.tick(now, raw)
        stamp = round(1e6 * time)
        return tuple(replace(f, time=stamp) if isinstance(f.message, Telemetry) else f for f in said)
