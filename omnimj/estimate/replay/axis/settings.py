"""Base parameters, candidate effects and free curves of a linear axis, in the form of the kernels."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from omnimj.effects import AXIS, MachineChanges, apply_effects, find_effect
from omnimj.estimate.replay.axis.log import AxisLog
from omnimj.estimate.replay.interface import (
    BaseParameter,
    CandidateEffect,
    CandidateParameter,
    Setting,
    candidate_effects,
)
from omnimj.parameters.axis import Axis
from omnimj.physics.axis import (
    CURVE_ROW,
    DRY_OVER_POSITION,
    DRY_OVER_TIME,
    FIRST_KNOT,
    FORCE_SCALE,
    KIND,
    KNOT,
    LAST_KNOT,
    OVER_POSITION,
    OVER_SPEED,
    OVER_TIME,
    POSITION_DELAY,
    axis_row,
    no_curve,
)
from omnimj.signals import Array

_NOTICED = 0.1  # share of the RMS measured force that an effect of typical size has
_SLOW = 0.4  # share of the top speed up to which friction counts as friction near standstill

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


def sized_candidates(axis: Axis, spans: Spans, without: tuple[str, ...]) -> tuple[CandidateEffect, ...]:
    """Candidate effects of an axis, with amplitudes and shapes scaled to the logs.

    Args:
      axis: Gives mass and force constant.
      spans: Range of each variable, from `spans_of`.
      without: Labels of effects that cannot show in these logs.
    """
    found = []
    for candidate in candidate_effects(AXIS, spans, without):
        shapes = tuple(
            _placed(s, spans) if s.null_value is None else _sized(s, axis, spans)
            for s in candidate.parameters
        )
        found.append(dataclasses.replace(candidate, parameters=shapes))
    return tuple(found)


def _sized(shape: CandidateParameter, axis: Axis, spans: Spans) -> CandidateParameter:
    """Scale the typical size of an amplitude to a tenth of the measured force."""
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


def _placed(shape: CandidateParameter, spans: Spans) -> CandidateParameter:
    """Limit a place, a width or a speed to the measured range."""
    low, high = spans["position"]
    reach, top = high - low, spans["speed"][1]
    bounds = {
        "position": (low, high, 0.5 * (low + high)),
        # with its rest position far outside the travel a cable is a constant force, which is another effect
        "rest_position": (low - reach, high + reach, 0.5 * (low + high)),
        "width": (0.01 * reach, 0.5 * reach, 0.1 * reach),
        "velocity": (0.003 * top, _SLOW * top, 0.05 * top),
    }
    if shape.name not in bounds:
        return shape
    least, most, typical = bounds[shape.name]
    trials = tuple(float(np.clip(t, least, most)) for t in shape.trials)
    return dataclasses.replace(shape, low=least, high=most, typical=typical, trials=trials)


TIMING = "timing"
"""Base parameter: lag of the position's clock behind that of the force, less than a sample period [s]."""

_BODY = ("mass", "drive_mass", "coulomb", "viscous", "force_constant")
_WORDS: Mapping[str, str] = MappingProxyType(
    {
        "mass": "all that moves",
        "drive_mass": "the drive's share of it",
        "coulomb": "dry friction",
        "viscous": "viscous friction",
        "force_constant": "force over current",
        TIMING: "offset between the clocks of force and position",
    }
)
CURVES: Mapping[str, int] = MappingProxyType(
    {
        "speed": OVER_SPEED,
        "position": OVER_POSITION,
        "time": OVER_TIME,
        "friction_over_position": DRY_OVER_POSITION,
        "friction_over_time": DRY_OVER_TIME,
    }
)
"""Variables of the free curves, for a force or a dry friction → kind of curve in the kernels."""


def base_parameters(axis: Axis, force_name: str, period: float) -> tuple[BaseParameter, ...]:
    """Uncertain parameters of the model file, and the offset between the clocks of force and position.

    Args:
      axis: Declared axis with its uncertainties.
      force_name: Column from which the force is taken, `force` or `current`.
      period: Sample period of the log [s].
    """
    found = []
    for name in _BODY:
        origin = axis.provenance[f"axis.{name}"]
        half, value = origin.uncertainty, getattr(axis.axis, name)
        if half <= 0.0 or (name == "force_constant" and force_name == "force"):
            continue
        least = 0.0 if name in ("coulomb", "viscous", "drive_mass") else 0.01 * value
        low = max(value - half, least)
        found.append(BaseParameter(name, origin.unit, value, low, value + half, _WORDS[name]))
    sample = 0.75 * period
    found.append(BaseParameter(TIMING, "s", 0.0, -sample, sample, _WORDS[TIMING]))
    return tuple(found)


def setting_row(
    axis: Axis, base: Sequence[BaseParameter], candidates: Mapping[str, CandidateEffect], setting: Setting
) -> Array:
    """Parameters of the kernels under a setting, with the declared mass.

    Args:
      axis: Declared axis with the effects that it has already.
      base: Base parameters of the replay.
      candidates: Candidate effects by label.
      setting: Values of base parameters and effects.

    Returns:
      Shape (AXIS_ROW,).
    """
    body, clock, gain = axis.axis, 0.0, 1.0
    for parameter, value in zip(base, np.asarray(setting.base, float), strict=True):
        if parameter.name == TIMING:
            clock = float(value)
        elif parameter.name == "force_constant":
            gain = float(value) / body.force_constant
        else:
            body = dataclasses.replace(body, **{parameter.name: float(value)})
    changes = MachineChanges(apply_effects(dataclasses.replace(axis, axis=body)).machine)
    for label, values in setting.effects.items():
        candidate = candidates[label]
        given = dict(candidate.selectors)
        given |= {s.name: float(v) for s, v in zip(candidate.parameters, values, strict=True)}
        for hook in find_effect(candidate.effect, AXIS, label).hooks:
            hook(changes, given)
    row = axis_row(changes.machine)
    row[FORCE_SCALE] *= gain
    row[POSITION_DELAY] += clock
    return row


def setting_curve(setting: Setting, spans: Spans) -> Array:
    """Free curve of a setting over the range of the logs, shape (CURVE_ROW,)."""
    if setting.curve is None:
        return no_curve()
    name, values = setting.curve
    curve = np.empty(CURVE_ROW)
    curve[FIRST_KNOT], curve[LAST_KNOT] = spans[name.removeprefix("friction_over_")]
    curve[KIND], curve[KNOT:] = CURVES[name], values
    return curve
