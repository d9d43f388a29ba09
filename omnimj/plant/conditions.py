"""What is wrong at one time: faults with onset and end, turned into numbers that a plant applies.

Several faults at once combine: losses, grips and radius scales multiply, braking torques and misalignment
angles add. Where only one can hold (floor under a wheel, free or hard-over, payload, slope) the one with the
latest onset wins; at equal onsets the later one in the list.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from omnimj.parameters.parts import Motor
from omnimj.physics.motor import (
    BRAKE,
    KT_SCALE,
    LIMIT,
    NO_LOAD,
    OVERRIDE,
    OVERRIDE_CURRENT,
    PARALLEL_TORQUE,
    motor_row,
)
from omnimj.signals import Array

LOCKING_TORQUE = 100.0
"""Brake of a locked wheel [N.m]: ten times beyond the motor (1 N.m) and the floor at top speed (7 N.m)."""

_LATE = 1e-9  # [s] a time summed up from steps may lie this much below the onset it stands for


@dataclass(frozen=True)
class Fault:
    """One fault of a scenario: the truth that a simulated plant is given and a controller never sees."""

    kind: str
    """`motor`, `free`, `locked`, `hard_over`, `slip`, `all_wheel_slip`, `misalignment`, `wheel_radius`,
    `payload`, `slope` or `sensor`."""
    onset: float
    """First time at which it holds [s]."""
    end: float | None = None
    """First time at which it holds no more [s]; None: it stays."""
    wheel: int | None = None
    """The wheel 1…n it sits on; None for faults of the whole plant and of its sensors."""
    numbers: Mapping[str, float | str] = field(default_factory=dict)
    """The kind's own keys: `loss`, `grip`, `angle`, …"""

    def holds_at(self, time: float) -> bool:
        """Whether onset ≤ time < end, to a nanosecond [s]."""
        return time + _LATE >= self.onset and (self.end is None or time + _LATE < self.end)


@dataclass(frozen=True)
class Conditions:
    """What holds at one time, for a plant to apply; n wheels."""

    motor_rows: Array
    """Numbers of each wheel's motor for `physics.motor`, shape (n, MOTOR_ROW)."""
    grip: Array
    """Factor 0…1 on traction, shape (n,)."""
    floors: tuple[str | None, ...]
    """Per wheel the name of the floor that replaces the one it stands on; None: no replacement."""
    misalignment: Array
    """Angle of each axle about the vertical, counter-clockwise, shape (n,) [rad]."""
    radius_scale: Array
    """True rolling radius over the nominal one, shape (n,)."""
    payload: tuple[float, float, float]
    """Mass [kg] and its place x, y in the body frame [m]."""
    slope: tuple[float, float]
    """Inclination of the floor and the world direction that points downhill [rad]."""


def event_times(faults: Iterable[Fault]) -> tuple[float, ...]:
    """Times at which conditions change, sorted, each once [s]; sensor faults change none."""
    acting = [fault for fault in faults if fault.kind != "sensor"]
    onsets = {fault.onset for fault in acting}
    return tuple(sorted(onsets | {fault.end for fault in acting if fault.end is not None}))


def conditions(faults: Iterable[Fault], time: float, motor: Motor, wheels: int) -> Conditions:
    """What the faults make of a healthy plant at one time.

    Args:
      faults: In the order of the scenario; sensor faults are left to the sensors.
      time: Time [s].
      motor: The healthy motor.
      wheels: Number of wheels n.

    Returns:
      Fresh arrays; a healthy plant when no fault holds.
    """
    rows = np.tile(motor_row(motor), (wheels, 1))
    grip, scale, angle = np.ones(wheels), np.ones(wheels), np.zeros(wheels)
    floors: list[str | None] = [None] * wheels
    payload, slope = (0.0, 0.0, 0.0), (0.0, 0.0)
    for fault in sorted((f for f in faults if f.holds_at(time)), key=lambda f: f.onset):
        numbers = fault.numbers
        at = slice(None) if fault.wheel is None else slice(fault.wheel - 1, fault.wheel)
        if fault.kind in ("motor", "free", "locked", "hard_over"):
            _degrade(rows[at], fault)
        elif fault.kind in ("slip", "all_wheel_slip"):
            grip[at] *= float(numbers.get("grip", 1.0))
            if "floor" in numbers:
                floors[at] = [str(numbers["floor"])] * len(floors[at])
        elif fault.kind == "misalignment":
            angle[at] += float(numbers["angle"])
        elif fault.kind == "wheel_radius":
            scale[at] *= float(numbers["scale"])
        elif fault.kind == "payload":
            payload = (float(numbers["mass"]), float(numbers.get("x", 0.0)), float(numbers.get("y", 0.0)))
        elif fault.kind == "slope":
            slope = (float(numbers["angle"]), float(numbers.get("direction", 0.0)))
    return Conditions(rows, grip, tuple(floors), angle, scale, payload, slope)


def _degrade(rows: Array, fault: Fault) -> None:
    """Changes the motor rows, shape (1, MOTOR_ROW), in place."""
    numbers = fault.numbers
    if "loss" in numbers:
        rows[:, KT_SCALE] *= 1.0 - float(numbers["loss"])
    if "braking_torque" in numbers:
        # the second motor's shaft also has to overcome its own friction, once
        rows[:, PARALLEL_TORQUE] = np.maximum(rows[:, PARALLEL_TORQUE], rows[:, NO_LOAD])
        rows[:, PARALLEL_TORQUE] += float(numbers["braking_torque"])
    if fault.kind == "locked":
        rows[:, BRAKE] = LOCKING_TORQUE
    elif fault.kind == "free":
        rows[:, OVERRIDE] = 1.0
    elif fault.kind == "hard_over":
        # without a current of its own it runs forward with all that the amplifier gives
        rows[:, OVERRIDE] = 2.0
        rows[:, OVERRIDE_CURRENT] = numbers.get("current", rows[0, LIMIT])
