"""What a linear axis' logs span, and candidates whose sizes and places suit them.

One catalogue serves an axis of a hundred grams and one of a ton: what is worth noticing is a share of the
forces that were measured.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from omnimj.effects import AXIS
from omnimj.gap.axis_log import AxisLog
from omnimj.gap.forms import candidate_forms
from omnimj.gap.replay import CandidateForm, Shape
from omnimj.parameters.axis import Axis

_NOTICED = 0.1  # of the measured force, RMS
_SLOW = 0.4  # of the highest speed: friction that ends above it is not friction near standstill

Spans = Mapping[str, tuple[float, float]]
"""Variable → lowest and highest value."""


def spans_of(log: AxisLog) -> Spans:
    """Range of `position`, `speed` (symmetric) and `time`; `force` from 0 to its RMS."""
    position, speed = log.smooth[:, 0], log.smooth[:, 1]
    top = max(float(np.abs(speed).max()), 1e-9)
    low, high = float(position.min()), float(position.max())
    return {
        "position": (low, max(high, low + 1e-9)),
        "speed": (-top, top),
        "time": (0.0, float(log.times.max())),
        "force": (0.0, max(float(np.sqrt(np.mean(log.force**2))), 1e-9)),
    }


def sized_candidates(axis: Axis, spans: Spans, without: tuple[str, ...]) -> tuple[CandidateForm, ...]:
    """Every effect of an axis as the search sees it.

    Args:
      axis: Gives mass and force constant.
      spans: See `spans_of`.
      without: Labels that cannot show in these logs.
    """
    found = []
    for form in candidate_forms(AXIS, spans, without):
        shapes = tuple(
            _placed(s, spans) if s.vanishes is None else _sized(s, axis, spans) for s in form.parameters
        )
        found.append(dataclasses.replace(form, parameters=shapes))
    return tuple(found)


def _sized(shape: Shape, axis: Axis, spans: Spans) -> Shape:
    """An amplitude: its typical size takes a tenth of the measured force."""
    force = _NOTICED * spans["force"][1]
    speed, reach = 0.5 * spans["speed"][1], 0.5 * (spans["position"][1] - spans["position"][0])
    typical = {
        "N": force,
        "N.s/m": force / speed,
        "N.s2/m2": force / speed**2,
        "N/m": force / reach,
        "kg": 0.05 * axis.axis.mass,
        "A": force / axis.axis.force_constant,
    }.get(shape.unit, shape.typical)
    return dataclasses.replace(shape, typical=float(np.clip(typical, shape.low, shape.high)))


def _placed(shape: Shape, spans: Spans) -> Shape:
    """A place, a width or a speed: inside what was measured."""
    low, high = spans["position"]
    reach, top = high - low, spans["speed"][1]
    bounds = {
        "position": (low, high, 0.5 * (low + high)),
        # a cable that is slack far outside the travel is a constant force, which has its own name
        "rest_position": (low - reach, high + reach, 0.5 * (low + high)),
        "width": (0.01 * reach, 0.5 * reach, 0.1 * reach),
        "velocity": (0.003 * top, _SLOW * top, 0.05 * top),
    }
    if shape.name not in bounds:
        return shape
    least, most, typical = bounds[shape.name]
    trials = tuple(float(np.clip(t, least, most)) for t in shape.trials)
    return dataclasses.replace(shape, low=least, high=most, typical=typical, trials=trials)
