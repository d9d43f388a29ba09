"""Force per ampere that changes with the speed: F = K i (1 + g(|v|)).

g is 0 at rest and straight between its values at half of the largest speed and at the largest. Losses of
gears and motors that are proportional to the load grow with the speed in many ways, of which a library has a
few. The search may have such a change in its model, so that drag, friction and masses need not stand in for
it. It acts at the axle, where it goes through the contact of the wheel, or on the carriage itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from omnimj.estimate.replay.interface import CandidateParameter, Description, Structure
from omnimj.signals import Array

_PLACES = ("at the axle", "on the carriage")
_TYPICAL, _LEAST, _MOST = -0.05, -0.9, 0.9


@dataclass(frozen=True)
class MotorForceOverSpeed(Structure):
    """Change of the force per ampere with the speed."""

    fastest: float = 1.0
    """Largest speed [m/s]."""

    def describe(self, numbers: Array) -> Description:
        """Describe the relative changes g at half of the largest speed and at the largest."""
        middle, top = numbers.tolist()
        parts = (
            f"{100.0 * abs(change):.2g} % {'larger' if change > 0.0 else 'smaller'} at {speed:.2g} m/s"
            for change, speed in ((middle, 0.5 * self.fastest), (top, self.fastest))
        )
        words = f"{self.words.partition(' that ')[0]} that is {' and '.join(parts)} than at rest"
        return Description(words, {"halfway": middle, "fastest": top, "speed": self.fastest})


def motor_forces(fastest: float) -> tuple[MotorForceOverSpeed, ...]:
    """The change as candidates: one at the axle, one on the carriage.

    Args:
      fastest: Largest speed of the runs [m/s].
    """
    parts = [CandidateParameter(n, "1", _LEAST, _MOST, _TYPICAL, 0.0) for n in ("halfway", "fastest")]
    return tuple(
        MotorForceOverSpeed(
            f"force per ampere over speed ({place})",
            "",
            f"a force per ampere {place} that changes with the speed",
            tuple(parts),
            causes="losses of gear or motor that grow with speed and load",
            fastest=fastest,
        )
        for place in _PLACES
    )


def changes_of(forces: tuple[MotorForceOverSpeed, ...], effects: Mapping[str, Array]) -> Array:
    """Change g at the axle and on the carriage, at rest, half of the largest speed and the largest, (2, 3).

    Args:
      forces: `motor_forces`.
      effects: Label → fitted numbers of the model's effects.
    """
    found = np.zeros((len(forces), 3))
    for row, force in zip(found, forces, strict=True):
        if force.label in effects:
            row[1:] = effects[force.label]
    return found
