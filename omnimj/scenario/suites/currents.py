"""What the rig is driven with: currents over time that keep the carriage on its rail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from omnimj.parameters import Rig
from omnimj.plant.planar_rig import PlanarRig
from omnimj.signals import Array, CurrentCommand

MARGIN = 0.03
"""A run ends this far before the carriage or the gantry does [m]."""

_REST = 0.2  # [s] before and after: the accelerometer shows its offset
_REST_SIDEWAYS = 0.05  # [s] the gantry is under way already and its travel is short
_LONGEST = 2.5  # [s] of a constant current
_SLOWEST = 3.0  # [s] after which a stroke is given up that gets nowhere
_STANDING = 0.02  # [m/s]


@dataclass(frozen=True)
class RigDrive:
    """Current over time, and how fast the gantry moves sideways meanwhile."""

    current: Array
    """Set values, one per sample period, shape (k,) [A]."""
    lateral_speed: float = 0.0
    """[m/s]."""


@dataclass(frozen=True)
class Stroke:
    """Drive to a place, coast, brake to a stand."""

    current: float
    """Positive drives away from the rail's start, negative back [A]."""
    place: float
    """Where the current ends, from the start [m]."""
    coast: float = 0.0
    """Time without current [s]."""
    brake: float = 0.0
    """Size of the current that then stops the carriage [A]; 0: the next stroke begins at once."""


def constant(rig: Rig, current: float, lateral_speed: float = 0.0) -> RigDrive:
    """Rest, then a constant current until the rail ends, as in sections 4.2-4.4."""
    rest = _REST_SIDEWAYS if lateral_speed else _REST
    rate = rig.sensors.sample_rate
    values = np.zeros(round((rest + _LONGEST) * rate) + 1)
    values[round(rest * rate) :] = current
    return RigDrive(values, lateral_speed)


def strokes(
    rig: Rig, floor: str, mass: float, plan: tuple[Stroke, ...], lateral_speed: float = 0.0
) -> RigDrive:
    """Strokes to and fro as currents over time.

    When to switch is found once with the nominal planar model, as one would find it in a trial run, so that
    all repeats are driven alike.

    Args:
      rig: The nominal rig.
      floor: Name of the floor.
      mass: m_T [kg].
      plan: One stroke after the other.
      lateral_speed: Of the gantry [m/s].
    """
    trial = _Trial(rig, floor, mass, lateral_speed)
    trial.hold(0.0, _REST_SIDEWAYS if lateral_speed else _REST)
    for stroke in plan:
        way = 1.0 if stroke.current > 0.0 else -1.0
        trial.hold(stroke.current, _SLOWEST, lambda x, v, s=stroke, w=way: w * (x - s.place) >= 0.0)
        trial.hold(0.0, stroke.coast, lambda x, v, w=way: w * v <= _STANDING)
        if stroke.brake:
            trial.hold(-way * stroke.brake, _SLOWEST, lambda x, v, w=way: w * v <= 0.0)
    trial.hold(0.0, _REST)
    return RigDrive(np.array(trial.currents), lateral_speed)


def on_rail(rig: Rig, position: Array, lateral_position: Array) -> int:
    """How many samples there are before the carriage or the gantry comes to the end of its travel.

    Args:
      rig: The rig.
      position: Of the carriage from its start, shape (n,) [m].
      lateral_position: Of the gantry from its start, shape (n,) [m].
    """
    body = rig.rig
    low = -max(body.start_position - MARGIN, MARGIN)
    high = body.rail_length - body.start_position - MARGIN
    beyond = (position < low) | (position > high) | (np.abs(lateral_position) > body.lateral_travel - MARGIN)
    return int(np.argmax(beyond)) if beyond.any() else len(position)


class _Trial:
    """Drives the nominal rig and notes the currents."""

    def __init__(self, rig: Rig, floor: str, mass: float, lateral_speed: float):
        self._plant = PlanarRig(rig, floor, mass=mass, lateral_speed=lateral_speed, ideal_sensors=True)
        self._plant.reset()
        self.currents: list[float] = []

    def hold(
        self, current: float, seconds: float, until: Callable[[float, float], bool] | None = None
    ) -> None:
        """Holds a current until position [m] and speed [m/s] of the carriage say so, or the time is over."""
        command = CurrentCommand(np.array([current]))
        for _ in range(round(seconds / self._plant.period)):
            position, speed = self._plant.truth()[:2].tolist()
            if until is not None and until(position, speed):
                return
            self.currents.append(current)
            self._plant.step(command)
