"""Effects of the joints of any machine: friction, springs, inertia of the drive, steady forces.

Units are those of a slide joint; on a hinge they are those of `parts.joint_unit`.
"""

from __future__ import annotations

from omnimj.effects.effect import MJCF, Effect, EffectParameter, Hook
from omnimj.effects.parts import JOINT, ON_JOINT, adds, adds_term, sets_terms

_ANY = 1e6
_P = EffectParameter


def _effect(
    name: str, words: str, parameters: tuple[EffectParameter, ...], hook: Hook, has_threshold: bool = False
) -> Effect:
    hooks = (hook,)
    return Effect(name, words, JOINT, (MJCF,), parameters, (ON_JOINT,), hooks, has_threshold=has_threshold)


EFFECTS: tuple[Effect, ...] = (
    _effect(
        "coulomb",
        "dry friction of the joint is not as declared, or missing",
        (_P("force", "N", -_ANY, _ANY, 0.1),),
        adds(JOINT, "frictionloss", "force"),
    ),
    _effect(
        "viscous",
        "viscous friction of the joint is not as declared, or missing",
        (_P("coefficient", "N.s/m", -_ANY, _ANY, 0.1),),
        adds(JOINT, "damping", "coefficient"),
    ),
    _effect(
        "quadratic_friction",
        "a friction quadratic in the speed of the joint",
        (_P("coefficient", "N.s2/m2", -_ANY, _ANY, 0.1),),
        adds(JOINT, "quadratic_damping", "coefficient"),
    ),
    _effect(
        "asymmetric_coulomb",
        "dry friction of the joint is not the same in both directions (forward − backward)",
        (_P("difference", "N", -_ANY, _ANY, 0.1),),
        adds_term(JOINT, "asymmetric_coulomb", "difference"),
    ),
    _effect(
        "asymmetric_viscous",
        "viscous friction of the joint is not the same in both directions (forward − backward)",
        (_P("difference", "N.s/m", -_ANY, _ANY, 0.1),),
        adds_term(JOINT, "asymmetric_viscous", "difference"),
    ),
    _effect(
        "stribeck",
        "extra friction of the joint near standstill",
        (_P("force", "N", -_ANY, _ANY, 0.1), _P("velocity", "m/s", 1e-6, _ANY, 0.1, None)),
        sets_terms(JOINT, "stribeck_force", stribeck_force="force", stribeck_velocity="velocity"),
    ),
    _effect(
        "position_friction",
        "extra dry friction of the joint around one place",
        (
            _P("force", "N", -_ANY, _ANY, 0.1),
            _P("position", "m", -_ANY, _ANY, 0.0, None),
            _P("width", "m", 1e-9, _ANY, 0.1, None),
        ),
        sets_terms(JOINT, "place_force", place_force="force", place_position="position", place_width="width"),
    ),
    _effect(
        "load_friction",
        "dry friction that grows with the force or torque that the joint transmits",
        (_P("share", "1", -0.9, 0.9, 0.1),),
        adds_term(JOINT, "load_share", "share"),
    ),
    _effect(
        "armature",
        "inertia that turns with the drive (rotor and gears) is not as declared, or missing",
        (_P("inertia", "kg", -_ANY, _ANY, 0.1),),
        adds(JOINT, "armature", "inertia"),
    ),
    _effect(
        "stiffness",
        "a force proportional to the position of the joint: spring, cable, hose",
        (_P("stiffness", "N/m", -_ANY, _ANY, 0.1), _P("rest_position", "m", -_ANY, _ANY, 0.0, None)),
        sets_terms(JOINT, "spring", spring="stiffness", spring_rest="rest_position"),
    ),
    _effect(
        "force_offset",
        "a constant force on the joint, or an offset of the measured force or command",
        (_P("force", "N", -_ANY, _ANY, 0.1),),
        adds_term(JOINT, "offset", "force"),
    ),
    _effect(
        "compliance",
        "a spring between the motor, which is measured, and what the joint moves",
        (_P("compliance", "m/N", 0.0, _ANY, 0.01),),
        adds_term(JOINT, "compliance", "compliance"),
    ),
    _effect(
        "backlash",
        "play between the motor, which is measured, and what the joint moves, at every reversal",
        (_P("angle", "m", 0.0, _ANY, 1e-3),),
        adds_term(JOINT, "play", "angle"),
        has_threshold=True,
    ),
)
"""Effects of a joint."""
