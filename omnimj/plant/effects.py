"""Effects of a machine laid over the conditions that its faults make, and over what its sensors read."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from omnimj.effects.effect import AppliedEffects, ChannelEffect
from omnimj.physics.motor import driven_by_measured_current
from omnimj.plant.faults import Conditions
from omnimj.plant.sensor_chain import wrap
from omnimj.signals import Array


def conditions_with_effects(
    now: Conditions, effects: AppliedEffects, measured_current: bool = False
) -> Conditions:
    """What faults and effects make of the plant together.

    Payloads add up as point masses at their common centre; a slope by fault goes before one by effect.

    Args:
      now: What the faults make of it.
      effects: The machine's.
      measured_current: Commands are currents that were measured: no limit cuts them again.
    """
    rows = effects.motor_rows(now.motor_rows)
    return dataclasses.replace(
        now,
        motor_rows=driven_by_measured_current(rows) if measured_current else rows,
        misalignment=now.misalignment + effects.misalignment,
        radius_scale=now.radius_scale * effects.radius_scale,
        payload=_combined_payload(now.payload, effects.payload),
        slope=now.slope if now.slope[0] else effects.slope,
    )


def _combined_payload(
    first: tuple[float, float, float], second: tuple[float, float, float]
) -> tuple[float, float, float]:
    mass = first[0] + second[0]
    if not (first[0] and second[0]) or mass == 0.0:
        return first if first[0] and mass else second if mass else (0.0, 0.0, 0.0)
    x, y = ((first[0] * first[k] + second[0] * second[k]) / mass for k in (1, 2))
    return mass, x, y


class ChannelEffects:
    """Scale, offset and pure delay behind the sensor chain; a delay need not be a whole number of samples."""

    def __init__(self, names: Sequence[str], changes: Mapping[str, ChannelEffect], period: float):
        self._at = [names.index(name) for name in changes]
        self._turns = [names[c] == "yaw" for c in self._at]
        self._changes = list(changes.values())
        self._late = [change.delay / period for change in self._changes]
        self.reset()

    def reset(self) -> None:
        """Back to the start: before it every channel read what it reads first."""
        self._past: list[list[float]] = [[] for _ in self._at]

    def apply(self, readings: Array) -> None:
        """Changes one sample of all channels, in place."""
        for k, c in enumerate(self._at):
            change = self._changes[k]
            value = change.scale * float(readings[c]) + change.offset
            readings[c] = wrap(value) if self._turns[k] and math.isfinite(value) else value
            if self._late[k] > 0.0:
                readings[c] = self._delayed(k, float(readings[c]))

    def _delayed(self, k: int, value: float) -> float:
        """Value of `late` samples ago, on the straight line between two samples (the short way round)."""
        past, late = self._past[k], self._late[k]
        past.append(value)
        whole = int(late)
        if len(past) > whole + 2:
            del past[0]
        newer = past[max(len(past) - 1 - whole, 0)]
        older = past[max(len(past) - 2 - whole, 0)]
        step = older - newer
        if self._turns[k] and math.isfinite(step):
            step -= 2.0 * math.pi * float(np.rint(step / (2.0 * math.pi)))
            return float(wrap(newer + (late - whole) * step))
        return newer + (late - whole) * step if late > whole else newer
