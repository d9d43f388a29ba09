"""Effects of the floor: what its traction follows, and its resistance to rolling."""

from __future__ import annotations

from omnimj.effects.effect import (
    COMPLIANCE,
    FLOOR,
    ROBOT,
    Effect,
    EffectParameter,
    Hook,
    MachineChanges,
    Values,
)


def _creep_ratio(changes: MachineChanges, values: Values) -> None:
    change = changes.floor_change(values)
    change.add(COMPLIANCE, values["compliance"])
    change.multiply("sigma_2", values["slip_speed"])


def _adds(key: str, parameter: str) -> Hook:
    """Hook that adds a parameter of an effect to a number of the floor."""

    def hook(changes: MachineChanges, values: Values) -> None:
        changes.floor_change(values).add(key, values[parameter])

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
