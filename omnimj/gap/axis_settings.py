"""Settings of a linear axis' replay as the kernels' numbers: base, effects, free curve."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from omnimj.effects import AXIS, Changes, applied, find_effect
from omnimj.gap.axis_sizes import Spans
from omnimj.gap.replay import BaseParameter, CandidateForm, Setting
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

TIMING = "timing"
"""Base parameter: by which the clock of the position is behind that of the force, below a sample [s]."""

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
"""Variables over which a free force, or a free dry friction, may be laid."""


def base_parameters(axis: Axis, force_name: str, period: float) -> tuple[BaseParameter, ...]:
    """What the model file declares uncertain, and the part of a sample that lies between two clocks.

    Args:
      axis: As declared.
      force_name: The column that the force comes from.
      period: Of the log [s].
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
    axis: Axis, base: Sequence[BaseParameter], forms: Mapping[str, CandidateForm], setting: Setting
) -> Array:
    """The kernels' numbers under a setting, shape (AXIS_ROW,), for a run with the declared mass.

    Args:
      axis: As declared, with the effects it has already.
      base: Of the replay.
      forms: Candidates by label.
      setting: Their values.
    """
    body, clock, gain = axis.axis, 0.0, 1.0
    for parameter, value in zip(base, np.asarray(setting.base, float), strict=True):
        if parameter.name == TIMING:
            clock = float(value)
        elif parameter.name == "force_constant":
            gain = float(value) / body.force_constant
        else:
            body = dataclasses.replace(body, **{parameter.name: float(value)})
    changes = Changes(applied(dataclasses.replace(axis, axis=body)).machine)
    for label, values in setting.effects.items():
        form = forms[label]
        given = dict(form.selectors)
        given |= {s.name: float(v) for s, v in zip(form.parameters, values, strict=True)}
        for hook in find_effect(form.effect, AXIS, label).hooks:
            hook(changes, given)
    row = axis_row(changes.machine)
    row[FORCE_SCALE] *= gain
    row[POSITION_DELAY] += clock
    return row


def setting_curve(setting: Setting, spans: Spans) -> Array:
    """The setting's free curve over what the logs span, shape (CURVE_ROW,)."""
    if setting.curve is None:
        return no_curve()
    name, values = setting.curve
    curve = np.empty(CURVE_ROW)
    curve[FIRST_KNOT], curve[LAST_KNOT] = spans[name.removeprefix("friction_over_")]
    curve[KIND], curve[KNOT:] = CURVES[name], values
    return curve
