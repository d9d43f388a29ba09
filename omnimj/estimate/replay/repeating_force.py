"""A force that repeats along the way: F = a sin(2π s/p) + b cos(2π s/p).

s is the way that the wheel rolled, or the place on the rail. Joints of a rail, teeth of a belt, a bent axle:
no library can list every force that repeats with distance. The search may have such a force in its model, so
that the effects of the library need not stand in for it. Its periods are longer than those of rollers and
motor poles, which are effects of the library.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from omnimj.estimate.replay.interface import CandidateParameter, Description, Structure
from omnimj.physics.effect_terms import TERM, mark_active
from omnimj.signals import Array

_ALONG = {"rolled": "that the wheel rolls", "rail": "along the rail"}
_ORDERS = 0.65, 4.5  # periods per turn of the wheel
_STEP = 0.14  # of trial orders: a few turns of a run tell orders apart that differ by about 0.2
_TYPICAL, _MOST = 0.5, 10.0  # [N]


@dataclass(frozen=True)
class RepeatingForce(Structure):
    """Force of unknown phase and period."""

    def describe(self, numbers: Array) -> Description:
        """Describe its size √(a² + b²) [N] and period [m]."""
        sine, cosine, period = numbers.tolist()
        size = math.hypot(sine, cosine)
        along = self.words.partition("repeats ")[2]
        words = f"a force of {size:.2g} N that repeats every {period:.3g} m {along}"
        return Description(words, {"force": size, "period": period})


def repeating_forces(turn: float) -> tuple[RepeatingForce, ...]:
    """The force as candidates: one that goes with the wheel, one with the rail.

    Args:
      turn: Distance per turn of the wheel [m].
    """
    lowest, highest = _ORDERS
    periods = tuple(float(turn / order) for order in np.arange(lowest + _STEP, highest, _STEP))
    parts = [CandidateParameter(n, "N", -_MOST, _MOST, _TYPICAL, 0.0) for n in ("sine", "cosine")]
    period = CandidateParameter("period", "m", turn / highest, turn / lowest, turn, None, periods)
    return tuple(
        RepeatingForce(
            f"repeating force ({along})",
            "",
            f"a force that repeats {words}",
            (*parts, period),
            causes="joints, teeth, something out of true",
        )
        for along, words in _ALONG.items()
    )


def with_repeating_force(
    terms: Array, forces: tuple[RepeatingForce, ...], effects: Mapping[str, Array], turn: float
) -> Array:
    """Packed effect terms, shape (TERMS,), with the force of a model; the same terms without one."""
    rolled, rail = (force.label for force in forces)
    if rolled in effects:
        sine, cosine, period = effects[rolled].tolist()
        order, wave = turn / period, 0.0
    elif rail in effects:
        sine, cosine, period = effects[rail].tolist()
        order, wave = 0.0, 2.0 * math.pi / period
    else:
        return terms
    changed = terms.copy()
    places = [TERM[f"repeating_{name}"] for name in ("sine", "cosine", "order", "wave")]
    changed[places] = sine, cosine, order, wave
    mark_active(changed[None])
    return changed
