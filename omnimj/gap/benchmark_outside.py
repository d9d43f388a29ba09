"""Truths that no effect of the library equals: what the workflow must not give a name to.

Each is a force, a friction or a grip that depends on place, speed or time, written into the plant between two
samples, or a reading that is bent afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from omnimj.physics.effect_terms import ACTIVE, CABLE_FORCE, DRY, PATCH, PATCH_END, PATCH_START
from omnimj.signals import Array

_GRAVITY = 9.81
_FAR = 1e3  # [m] a patch that ends here is everywhere


@dataclass(frozen=True)
class Kind:
    """One way to be outside of the library."""

    words: str
    amplitude: float
    """A size that is worth noticing."""
    unit: str
    shortest: float
    longest: float
    """Range of its length: metres, seconds or metres per second, as the kind has it."""


KINDS: Mapping[str, Kind] = {
    "floor_drift": Kind("the floor loses grip while it warms, within and between runs", 0.3, "1", 1.0, 3.0),
    "bent_rail": Kind("the rail is wavy: a grade that changes its sign along it", 0.02, "rad", 0.3, 0.8),
    "rail_joints": Kind("a force that repeats along the rail", 1.5, "N", 0.08, 0.2),
    "drying_rail": Kind("rail friction that fades after the start", 2.0, "N", 0.2, 0.8),
    "speed_hump": Kind("rail friction that peaks at one speed", 2.0, "N", 0.3, 0.8),
    "drifting_accelerometer": Kind("the accelerometer's offset grows with time", 0.4, "m/s3", 1.0, 1.0),
    "sideways_crosstalk": Kind("the carriage's encoder feels the gantry's speed", 0.06, "1", 1.0, 1.0),
    "eccentric_encoder": Kind("the measuring wheel of the carriage runs out of true", 0.04, "1", 0.01, 0.02),
}


@dataclass(frozen=True)
class Moment:
    """What a run has of its own."""

    session: float
    """Where in the series of runs it is, 0 … 1."""
    mass: float
    """m_T [kg]."""


@dataclass(frozen=True)
class Outside:
    """One of `KINDS` with its numbers."""

    kind: str
    amplitude: float
    length: float
    phase: float

    def write_terms(self, row: Array, run: Moment, time: float, position: float, speed: float) -> None:
        """Writes what holds during the next sample into a wheel's row of terms, in place.

        Args:
          row: Of `physics.effect_terms`, shape (TERMS,).
          run: Which run it is.
          time: Since the run's start [s].
          position: Of the carriage [m].
          speed: Of the carriage [m/s].
        """
        row[ACTIVE] = 1.0
        if self.kind == "floor_drift":
            warm = 0.5 * run.session + 0.5 * (1.0 - math.exp(-time / self.length))
            row[PATCH], row[PATCH_START], row[PATCH_END] = -self.amplitude * warm, -_FAR, _FAR
        elif self.kind == "bent_rail":
            row[CABLE_FORCE] = run.mass * self.force_per_mass(position)
        elif self.kind == "rail_joints":
            row[CABLE_FORCE] = self.amplitude * self._wave(position)
        elif self.kind == "drying_rail":
            row[DRY] = self.amplitude * math.exp(-time / self.length)
        elif self.kind == "speed_hump":
            row[DRY] = self.amplitude * math.exp(-(((abs(speed) - self.length) / 0.1) ** 2))

    def force_per_mass(self, position: float) -> float:
        """Gravity along a bent rail [m/s²]; 0 for every other kind."""
        if self.kind != "bent_rail":
            return 0.0
        return -_GRAVITY * math.sin(self.amplitude * self._wave(position))

    def bend_readings(self, columns: Mapping[str, Array], position: Array) -> dict[str, Array]:
        """What the sensors say instead.

        Args:
          columns: As the undisturbed sensors gave them.
          position: True position of the carriage, shape (n,) [m].
        """
        bent = dict(columns)
        if self.kind == "drifting_accelerometer":
            bent["carriage_acceleration"] = (
                columns["carriage_acceleration"] + self.amplitude * columns["time"]
            )
        elif self.kind == "sideways_crosstalk":
            bent["carriage_speed"] = columns["carriage_speed"] + self.amplitude * columns["lateral_speed"]
        elif self.kind == "eccentric_encoder":
            wave = np.sin(position / self.length + self.phase)
            bent["carriage_speed"] = columns["carriage_speed"] * (1.0 + self.amplitude * wave)
        elif self.kind == "bent_rail":
            felt = np.array([self.force_per_mass(x) for x in position.tolist()])
            bent["carriage_acceleration"] = columns["carriage_acceleration"] - felt
        return bent

    def _wave(self, position: float) -> float:
        return math.sin(2.0 * math.pi * position / self.length + self.phase)


def draw_outside(kind: str, size: float, random: np.random.Generator) -> Outside:
    """One of `KINDS` at a size relative to what is worth noticing, its sign drawn where it may have one."""
    about = KINDS[kind]
    has_sign = kind in ("drifting_accelerometer", "sideways_crosstalk")
    sign = float(random.choice((-1.0, 1.0))) if has_sign else 1.0
    length, phase = random.uniform(about.shortest, about.longest), random.uniform(0.0, 2.0 * math.pi)
    return Outside(kind, sign * size * about.amplitude, float(length), float(phase))
