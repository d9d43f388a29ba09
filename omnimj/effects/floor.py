"""Effects of the floor: what its traction follows, and its resistance to rolling."""

from __future__ import annotations

from omnimj.effects.effect import (
    COMPLIANCE,
    ROBOT,
    Effect,
    EffectParameter,
    Hook,
    MachineChanges,
    Values,
)


def _creep_ratio(changes: MachineChanges, values: Values) -> None:
    changes.floor_extra[COMPLIANCE] = changes.floor_extra.get(COMPLIANCE, 0.0) + values["compliance"]
    changes.floor_scale["sigma_2"] = changes.floor_scale.get("sigma_2", 1.0) * values["slip_speed"]


def _adds(key: str, parameter: str) -> Hook:
    """Hook that adds a parameter of an effect to a number of the floor."""

    def hook(changes: MachineChanges, values: Values) -> None:
        changes.floor_extra[key] = changes.floor_extra.get(key, 0.0) + values[parameter]

    return hook


EFFECTS = (
    Effect(
        "creep_ratio",
        "traction follows the ratio of slip to rolling speed: bristles leave the contact as it rolls",
        "floor",
        (ROBOT,),
        (
            EffectParameter("compliance", "1", 0.0, 20.0, 0.5),
            EffectParameter("slip_speed", "1", 0.0, 5.0, 0.2, 1.0),
        ),
        hooks=(_creep_ratio,),
    ),
    Effect(
        "soft_floor",
        "the floor resists the rolling of wheels and rollers against their direction",
        "floor",
        (ROBOT,),
        (EffectParameter("resistance", "1", 0.0, 1.0, 0.1),),
        hooks=(_adds("rolling_resistance", "resistance"),),
    ),
    Effect(
        "load_sensitivity",
        "traction grows with another power of the load",
        "floor",
        (ROBOT,),
        (EffectParameter("exponent", "1", -0.9, 1.0, 0.3),),
        hooks=(_adds("load_exponent", "exponent"),),
    ),
)
