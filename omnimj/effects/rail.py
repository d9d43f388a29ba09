"""Effects at the rail of the rig: additional friction and cables."""

from __future__ import annotations

from omnimj.effects.effect import (
    RIG,
    Effect,
    EffectParameter,
    MachineChanges,
    Values,
    adds_to_constant,
    adds_to_term,
)
from omnimj.effects.wheel import ROLLER_FRICTION


def _stribeck(changes: MachineChanges, values: Values) -> None:
    changes.set_term("stribeck", values["force"], stribeck_speed=values["velocity"])


def _position(changes: MachineChanges, values: Values) -> None:
    place, width = values["position"], values["width"]
    changes.set_term("sticky", values["force"], sticky_place=place, sticky_width=width)


def _cable_drag(changes: MachineChanges, values: Values) -> None:
    changes.add_to_term("cable", values["stiffness"])
    changes.add_to_term("cable_force", values["stiffness"] * values["rest_position"])


EFFECTS = (
    Effect(
        "lateral_coupling",
        "sideways motion loads the rail and the bearings through the friction of the rollers",
        "rail",
        (RIG,),
        (
            EffectParameter("roller_dry", "1", -0.2, 0.2, 0.02),
            EffectParameter("roller_viscous", "s/m", -0.5, 0.5, 0.02),
            EffectParameter("rail_dry", "1", -0.5, 0.5, 0.1),
        ),
        hooks=(*ROLLER_FRICTION, adds_to_constant("rig", "rail_dry", "rail_dry")),
    ),
    Effect(
        "rail_coulomb",
        "dry friction of the rail is not as declared",
        "rail",
        (RIG,),
        (EffectParameter("force", "N", -2.0, 10.0, 1.0),),
        hooks=(adds_to_term("guide_dry", "force"),),
        quantity="rig.rail_friction",
    ),
    Effect(
        "rail_viscous",
        "the rail has viscous friction",
        "rail",
        (RIG,),
        (EffectParameter("coefficient", "N.s/m", 0.0, 20.0, 1.5),),
        hooks=(adds_to_term("guide_viscous", "coefficient"),),
    ),
    Effect(
        "rail_stribeck",
        "the rail has extra friction near standstill",
        "rail",
        (RIG,),
        (
            EffectParameter("force", "N", -2.0, 10.0, 1.5),
            EffectParameter("velocity", "m/s", 0.005, 1.0, 0.15, None),
        ),
        hooks=(_stribeck,),
    ),
    Effect(
        "rail_position",
        "a sticky place on the rail",
        "rail",
        (RIG,),
        (
            EffectParameter("force", "N", -2.0, 20.0, 4.0),
            EffectParameter("position", "m", -2.0, 2.0, 0.5, None),
            EffectParameter("width", "m", 0.005, 0.5, 0.08, None),
        ),
        hooks=(_position,),
    ),
    Effect(
        "cable_drag",
        "a cable pulls with a force proportional to position",
        "rail",
        (RIG,),
        (
            EffectParameter("stiffness", "N/m", -20.0, 20.0, 2.0),
            EffectParameter("rest_position", "m", -2.0, 2.0, 0.0, None),
        ),
        hooks=(_cable_drag,),
    ),
)
