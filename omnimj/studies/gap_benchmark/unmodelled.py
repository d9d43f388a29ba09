"""Physics outside the library: effects that no candidate describes, and small deviations of every machine."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from omnimj.parameters.parts import GRAVITY
from omnimj.physics.effect_terms import TERM
from omnimj.signals import Array

_FAR = 1e3  # [m] a patch up to here covers the whole rail
_ROCKING_DAMPING = 0.08  # damping ratio of a body that rocks on its suspension


@dataclass(frozen=True)
class UnmodelledKind:
    """Kind of physics outside the library."""

    amplitude: float
    """Noticeable amplitude, the unit of sizes."""
    shortest: float
    longest: float
    """Upper end of the range of its length [m, s, m/s, Hz or periods per turn, by kind]."""


KINDS: Mapping[str, UnmodelledKind] = {
    # the floor loses grip while it warms, within and between runs [1]
    "floor_drift": UnmodelledKind(0.3, 1.0, 3.0),
    # the rail is wavy: a grade that changes its sign along it [rad]
    "bent_rail": UnmodelledKind(0.02, 0.3, 0.8),
    # a force that repeats along the rail [N]
    "rail_joints": UnmodelledKind(1.5, 0.08, 0.2),
    # rail friction that fades after the start [N]
    "drying_rail": UnmodelledKind(2.0, 0.2, 0.8),
    # rail friction that peaks at one speed [N]
    "speed_hump": UnmodelledKind(2.0, 0.3, 0.8),
    # the accelerometer's offset grows with time [m/s³]
    "drifting_accelerometer": UnmodelledKind(0.4, 1.0, 1.0),
    # the carriage's encoder feels the gantry's speed [1]
    "sideways_crosstalk": UnmodelledKind(0.06, 1.0, 1.0),
    # the measuring wheel of the carriage runs out of true [1]
    "eccentric_encoder": UnmodelledKind(0.04, 0.01, 0.02),
}
"""Effects for which the workflow must not name any effect of the library, with the unit of the amplitude."""

STRUCTURES: Mapping[str, UnmodelledKind] = {
    # the gear wastes a share of its torque that grows with the speed, the amplitude at `length` [N/A]
    "gear_law": UnmodelledKind(0.8, 0.6, 1.0),
    # dry friction of the rail that builds up with speed and saturates [N]
    "friction_law": UnmodelledKind(0.2, 0.05, 0.3),
    # a force that repeats with the turn of the drive [N]
    "drive_ripple": UnmodelledKind(0.4, 1.3, 2.7),
    # the body rocks and shakes its accelerometer [1]
    "rocking": UnmodelledKind(0.12, 6.0, 12.0),
}
"""Small deviations of a real machine from the equations of the library, beside which effects are hidden."""


@dataclass(frozen=True)
class RunContext:
    """Conditions of a run that an effect depends on."""

    session: float
    """Position in the series of runs, 0 … 1."""
    mass: float
    """m_T [kg]."""


class Motion(NamedTuple):
    """True motion of a rig at the start of a sample."""

    time: float
    """Since the start of the run [s]."""
    position: float
    """Position of the carriage [m]."""
    speed: float
    """Speed of the carriage [m/s]."""
    wheel_angle: float
    """[rad]"""
    current: float
    """Motor current, within what the supply allows at this speed [A]."""


@dataclass(frozen=True)
class UnmodelledEffect:
    """Effect of one of `KINDS` or `STRUCTURES` with its numbers."""

    kind: str
    amplitude: float
    length: float
    phase: float

    def write_terms(self, row: Array, run: RunContext, motion: Motion) -> None:
        """Add to the terms of the next sample, in place.

        Args:
          row: Terms of `physics.effect_terms`, shape (TERMS,).
          run: Conditions of the run.
          motion: True motion of the rig.
        """
        row[TERM["active"]] = 1.0
        if self.kind == "floor_drift":
            warm = 0.5 * run.session + 0.5 * (1.0 - math.exp(-motion.time / self.length))
            stretch = [TERM[name] for name in ("patch", "patch_start", "patch_end")]
            row[stretch] = -self.amplitude * warm, -_FAR, _FAR
        row[TERM["cable_force"]] += self._force(run, motion)
        row[TERM["guide_dry"]] += self._dry_friction(motion)

    def _force(self, run: RunContext, motion: Motion) -> float:
        """Force on the carriage [N]."""
        if self.kind == "bent_rail":
            return run.mass * self.force_per_mass(motion.position)
        if self.kind == "rail_joints":
            return self.amplitude * self._wave(motion.position)
        if self.kind == "drive_ripple":
            return self.amplitude * math.sin(self.length * motion.wheel_angle + self.phase)
        if self.kind == "gear_law":
            return -self.amplitude * motion.current * abs(motion.speed) / self.length
        return 0.0

    def _dry_friction(self, motion: Motion) -> float:
        """Dry friction of the rail [N]."""
        speed = abs(motion.speed)
        if self.kind == "drying_rail":
            return self.amplitude * math.exp(-motion.time / self.length)
        if self.kind == "speed_hump":
            return self.amplitude * math.exp(-(((speed - self.length) / 0.1) ** 2))
        if self.kind == "friction_law":
            return self.amplitude * speed / (speed + self.length)
        return 0.0

    def force_per_mass(self, position: float) -> float:
        """Return gravity along a bent rail [m/s²]; 0 for every other kind."""
        if self.kind != "bent_rail":
            return 0.0
        return -GRAVITY * math.sin(self.amplitude * self._wave(position))

    def bend_readings(self, columns: Mapping[str, Array], position: Array) -> dict[str, Array]:
        """Return the sensor readings with this effect.

        Args:
          columns: Readings without it, shape (k,) each.
          position: True position of the carriage, shape (k,) [m].
        """
        bent = dict(columns)
        acceleration = columns["carriage_acceleration"]
        if self.kind == "drifting_accelerometer":
            bent["carriage_acceleration"] = acceleration + self.amplitude * columns["time"]
        elif self.kind == "rocking":
            shaken = self._rocked(acceleration, float(columns["time"][1] - columns["time"][0]))
            bent["carriage_acceleration"] = acceleration + self.amplitude * shaken
        elif self.kind == "sideways_crosstalk":
            bent["carriage_speed"] = columns["carriage_speed"] + self.amplitude * columns["lateral_speed"]
        elif self.kind == "eccentric_encoder":
            wave = np.sin(position / self.length + self.phase)
            bent["carriage_speed"] = columns["carriage_speed"] * (1.0 + self.amplitude * wave)
        elif self.kind == "bent_rail":
            felt = np.array([self.force_per_mass(x) for x in position.tolist()])
            bent["carriage_acceleration"] = acceleration - felt
        return bent

    def _wave(self, position: float) -> float:
        return math.sin(2.0 * math.pi * position / self.length + self.phase)

    def _rocked(self, acceleration: Array, period: float) -> Array:
        """Acceleration of a body that rocks at `length` [Hz] beyond that of its base, shape (k,) [m/s²]."""
        turn = 2.0 * math.pi * self.length * period
        radius = math.exp(-_ROCKING_DAMPING * turn)
        feedback = [1.0, -2.0 * radius * math.cos(turn), radius**2]
        return lfilter([sum(feedback)], feedback, acceleration) - acceleration


def draw_unmodelled(kind: str, size: float, random: np.random.Generator) -> UnmodelledEffect:
    """Draw an effect outside the library.

    Args:
      kind: One of `KINDS` or `STRUCTURES`.
      size: Amplitude relative to the noticeable one.
      random: Random generator, which also draws the sign if the kind has one.
    """
    about = {**KINDS, **STRUCTURES}[kind]
    has_sign = kind in ("drifting_accelerometer", "sideways_crosstalk")
    sign = float(random.choice((-1.0, 1.0))) if has_sign else 1.0
    length, phase = random.uniform(about.shortest, about.longest), random.uniform(0.0, 2.0 * math.pi)
    return UnmodelledEffect(kind, sign * size * about.amplitude, float(length), float(phase))
