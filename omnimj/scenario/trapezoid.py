"""How far along a motion one is at a time: trapezoids of speed, in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.signals import Array


@dataclass(frozen=True)
class Trapezoid:
    """Speeds up, cruises, slows down to rest."""

    speed: float
    """Cruising speed, not negative [m/s] (or rad/s)."""
    acceleration: float
    """Positive [m/s²]."""
    deceleration: float
    """Positive [m/s²]."""
    cruise_time: float
    """At constant speed; may be infinite [s]."""

    @property
    def duration(self) -> float:
        """From rest to rest [s]."""
        return self.speed / self.acceleration + self.cruise_time + self.speed / self.deceleration

    def distance_at(self, time: Array) -> Array:
        """s(t) = ∫ v dt, 0 before the start and constant after the end [m]."""
        rise, fall = self.speed / self.acceleration, self.speed / self.deceleration
        up = np.clip(time, 0.0, rise)
        cruise = np.clip(time - rise, 0.0, self.cruise_time)
        down = np.clip(time - rise - self.cruise_time, 0.0, fall)
        return (
            0.5 * self.acceleration * up**2 + self.speed * (cruise + down) - 0.5 * self.deceleration * down**2
        )


def over_distance(distance: float, speed: float, acceleration: float, deceleration: float) -> Trapezoid:
    """The quickest trapezoid over a distance [m]; a triangle where the speed cannot be reached.

    v²/2 (1/a + 1/d) is the distance of speeding up and slowing down.
    """
    both = 0.5 * (1.0 / acceleration + 1.0 / deceleration)
    speed = min(speed, float(np.sqrt(distance / both)))
    if speed == 0.0:
        return Trapezoid(0.0, acceleration, deceleration, 0.0)
    return Trapezoid(speed, acceleration, deceleration, max(0.0, distance / speed - both * speed))


def one_after_another(motions: Sequence[Trapezoid], time: Array) -> Array:
    """Distance of all motions together, each starting when the one before has ended [m]."""
    total, start = np.zeros_like(time), 0.0
    for motion in motions:
        total += motion.distance_at(time - start)
        start += motion.duration
    return total
