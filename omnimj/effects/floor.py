"""Effects of the floor: another traction law's numbers, another stretch of floor."""

from __future__ import annotations

from omnimj.effects.effect import RIG, ROBOT, Effect, EffectParameter, MachineChanges, Values
from omnimj.physics.effect_terms import PATCH

_FOLLOWS = {"mu_c": ("mu_c", "mu_s", "D"), "sigma_0": ("sigma_0", "B"), "sigma_2": ("sigma_2",)}
"""Numbers of a floor that a scale acts on: g(V_r) of LuGre and the height of the Magic Formula as a
whole; the stiffness of either law."""


def _floor_traction(changes: MachineChanges, values: Values) -> None:
    for name, numbers in _FOLLOWS.items():
        for number in numbers:
            changes.floor_scale[number] = changes.floor_scale.get(number, 1.0) * values[name]


def _floor_patch(changes: MachineChanges, values: Values) -> None:
    changes.shaped(PATCH, values["scale"] - 1.0, values["start"], values["end"])


def _scale(name: str) -> EffectParameter:
    return EffectParameter(name, "1", 0.05, 10.0, 0.7, 1.0)


EFFECTS = (
    Effect(
        "floor_traction",
        "the traction parameters are not this floor's",
        "floor",
        (RIG, ROBOT),
        (_scale("mu_c"), _scale("sigma_0"), _scale("sigma_2")),
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
    ),
)
