"""Effects on the moving body and the floor under it: mass, slope, air, traction, resistance to rolling."""

from __future__ import annotations

import math

from omnimj.effects.effect import (
    COMPLIANCE,
    FLOOR,
    FLOOR_SCALES,
    RIG,
    ROBOT,
    Effect,
    EffectParameter,
    Hook,
    MachineChanges,
    Values,
    adds_to_term,
)
from omnimj.errors import InputError
from omnimj.parameters.parts import GRAVITY


def _payload(changes: MachineChanges, values: Values) -> None:
    mass, x, y = values["mass"], values.get("x", 0.0), values.get("y", 0.0)
    before, x_before, y_before = changes.payload
    together = before + mass
    if together == 0.0:
        changes.payload = (0.0, 0.0, 0.0)
        return
    changes.payload = (
        together,
        (before * x_before + mass * x) / together,
        (before * y_before + mass * y) / together,
    )


def _load_offset(changes: MachineChanges, values: Values) -> None:
    # part of the mass, moved out by a fixed distance, so that mass and yaw inertia hardly change
    x, y, mass = values["x"], values["y"], changes.machine.body.mass
    offset = math.hypot(x, y)
    if offset > 0.0:
        moved = mass * offset / _MOVED
        changes.add_to_constant("body", "mass", -moved)
        _payload(changes, {"mass": moved, "x": x / offset * _MOVED, "y": y / offset * _MOVED})


def _grade_of_rail(changes: MachineChanges, values: Values) -> None:
    if changes.slope[0] and values["slope"]:
        raise InputError("effects", "found grade twice", "it can act once on a machine")
    changes.slope = (values["slope"], math.pi) if values["slope"] else changes.slope
    changes.add_to_term("grade", -GRAVITY * math.sin(values["slope"]))


def _grade_of_floor(changes: MachineChanges, values: Values) -> None:
    if changes.slope[0] and values["slope"]:
        raise InputError("effects", "found grade twice", "it can act once on a machine")
    if values["slope"]:
        changes.slope = (values["slope"], values["direction"] + math.pi)


def _floor_traction(changes: MachineChanges, values: Values) -> None:
    change = changes.floor_change(values)
    for name in FLOOR_SCALES:
        change.multiply(name, values[name])


def _floor_patch(changes: MachineChanges, values: Values) -> None:
    changes.set_term("patch", values["scale"] - 1.0, patch_start=values["start"], patch_end=values["end"])


def _creep_ratio(changes: MachineChanges, values: Values) -> None:
    change = changes.floor_change(values)
    change.add(COMPLIANCE, values["compliance"])
    change.multiply("sigma_2", values["slip_speed"])


def _adds(key: str, parameter: str) -> Hook:
    """Hook that adds a parameter of an effect to a number of the floor."""

    def hook(changes: MachineChanges, values: Values) -> None:
        changes.floor_change(values).add(key, values[parameter])

    return hook


_MOVED = 0.12
"""Distance by which `load_offset` moves part of the mass [m]."""
_PAYLOAD = ("payload", "more or less mass than declared", "body")
_GRADE = ("grade", "the floor or rail is not level", "body")
_SLOPE = EffectParameter("slope", "rad", -0.3, 0.3, 0.02)

EFFECTS = (
    Effect(
        *_PAYLOAD,
        (RIG,),
        (EffectParameter("mass", "kg", -1.5, 5.0, 0.5),),
        hooks=(_payload,),
    ),
    Effect(
        *_PAYLOAD,
        (ROBOT,),
        (
            EffectParameter("mass", "kg", -5.0, 20.0, 2.0),
            EffectParameter("x", "m", -0.3, 0.3, 0.0, None),
            EffectParameter("y", "m", -0.3, 0.3, 0.0, None),
        ),
        hooks=(_payload,),
    ),
    Effect(
        "load_offset",
        "the centre of mass is not where the model has it, so that the wheels carry other loads",
        "body",
        (ROBOT,),
        (EffectParameter("x", "m", -0.08, 0.08, 0.02), EffectParameter("y", "m", -0.08, 0.08, 0.02)),
        hooks=(_load_offset,),
    ),
    Effect(*_GRADE, (RIG,), (_SLOPE,), hooks=(_grade_of_rail,)),
    Effect(
        *_GRADE,
        (ROBOT,),
        (_SLOPE, EffectParameter("direction", "rad", -2.0 * math.pi, 2.0 * math.pi, 0.0, None)),
        hooks=(_grade_of_floor,),
    ),
    Effect(
        "air_drag",
        "a force that grows with the square of speed",
        "body",
        (RIG, ROBOT),
        (EffectParameter("coefficient", "N.s2/m2", 0.0, 50.0, 2.0),),
        hooks=(adds_to_term("air", "coefficient"),),
    ),
    Effect(
        "floor_traction",
        "the traction parameters are not this floor's",
        "floor",
        (RIG, ROBOT),
        tuple(EffectParameter(name, "1", 0.05, 10.0, 0.7, 1.0) for name in FLOOR_SCALES),
        (FLOOR,),
        hooks=(_floor_traction,),
    ),
    Effect(
        "floor_patch",
        "a stretch of floor with another friction",
        "floor",
        (RIG, ROBOT),
        (
            EffectParameter("scale", "1", 0.0, 5.0, 0.4, 1.0),
            EffectParameter("start", "m", -20.0, 20.0, 0.3, None),
            EffectParameter("end", "m", -20.0, 20.0, 0.6, None),
        ),
        hooks=(_floor_patch,),
        has_threshold=True,
    ),
    Effect(
        "creep_ratio",
        "traction follows the ratio of slip to rolling speed: bristles leave the contact as it rolls",
        "floor",
        (ROBOT,),
        (
            EffectParameter("compliance", "1", 0.0, 20.0, 0.5),
            EffectParameter("slip_speed", "1", 0.0, 5.0, 0.2, 1.0),
        ),
        (FLOOR,),
        hooks=(_creep_ratio,),
    ),
    Effect(
        "soft_floor",
        "the floor resists the rolling of wheels and rollers",
        "floor",
        (ROBOT,),
        (
            EffectParameter("resistance", "1", 0.0, 1.0, 0.1),
            EffectParameter("roller_resistance", "1", 0.0, 1.0, 0.05),
            EffectParameter("roller_dry", "1", 0.0, 1.0, 0.05),
        ),
        (FLOOR,),
        hooks=(
            _adds("rolling_resistance", "resistance"),
            _adds("roller_resistance", "roller_resistance"),
            _adds("roller_dry", "roller_dry"),
        ),
    ),
    Effect(
        "load_sensitivity",
        "traction grows with another power of the load",
        "floor",
        (ROBOT,),
        (EffectParameter("exponent", "1", -0.9, 1.0, 0.3),),
        (FLOOR,),
        hooks=(_adds("load_exponent", "exponent"),),
    ),
)
