"""Effects of any machine that an MJCF file describes: measured channels, actuators, joints, bodies, gravity.

Units of a joint's effects are those of a slide joint; on a hinge they are those of `parts.joint_unit`.
"""

from __future__ import annotations

from collections.abc import Callable

from omnimj.effects.effect import MJCF, Effect, EffectParameter, Hook, Selector, Values
from omnimj.effects.parts import (
    ACTUATOR,
    BODY,
    CHANNEL,
    JOINT,
    ON_ACTUATOR,
    ON_BODY,
    ON_CHANNEL,
    ON_JOINT,
    PartChanges,
    Payload,
    adds,
    adds_term,
    scale_parameter,
    scales,
    sets_terms,
)

NO_LIMIT = 1e9
"""Force at which a limit vanishes [N or N.m]."""
AXIS_OF_TILT = Selector("axis", ("x", "y"))
"""World axis about which gravity is turned."""
_CHANNEL_UNITS = {"position": "m", "velocity": "m/s", "force": "N", "sensor": "1"}
_ANY = 1e6
_P = EffectParameter


def _scaled(changes: PartChanges, values: Values) -> None:
    changes.change_channel(str(values[CHANNEL]), scale=values["scale"])


def _shifted(changes: PartChanges, values: Values) -> None:
    changes.change_channel(str(values[CHANNEL]), offset=values["bias"])


def _delayed(changes: PartChanges, values: Values) -> None:
    changes.change_channel(str(values[CHANNEL]), delay=values["delay"])


def _limited(changes: PartChanges, values: Values) -> None:
    name = str(values[ACTUATOR])
    changes.limits[name] = min(values["limit"], changes.limits.get(name, NO_LIMIT))


def _driven_back(changes: PartChanges, values: Values) -> None:
    key = (ACTUATOR, str(values[ACTUATOR]), "braking")
    changes.terms[key] = (1.0 + changes.terms.get(key, 0.0)) / values["efficiency"] - 1.0


def _loaded(changes: PartChanges, values: Values) -> None:
    changes.payloads.append(Payload(str(values[BODY]), values["mass"], values["distance"]))


def _tilted(changes: PartChanges, values: Values) -> None:
    axis = str(values[AXIS_OF_TILT.name])
    changes.tilt[axis] = changes.tilt.get(axis, 0.0) + values["slope"]


def _maker(where: str, on: Selector) -> Callable[..., Effect]:
    """Function that declares effects of one kind of parts."""

    def declare(
        name: str,
        words: str,
        parameters: tuple[EffectParameter, ...],
        hook: Hook,
        has_threshold: bool = False,
        quantity: str = "",
    ) -> Effect:
        facts = {"has_threshold": has_threshold, "quantity": quantity}
        return Effect(name, words, where, (MJCF,), parameters, (on,), (hook,), **facts)

    return declare


_of_channel = _maker("sensors", ON_CHANNEL)
_of_actuator = _maker("drive", ON_ACTUATOR)
_of_joint = _maker(JOINT, ON_JOINT)


def _of_kind(kind: str, unit: str) -> tuple[Effect, Effect]:
    """Scale and bias of one kind of channels, the first part of a column's name."""
    bias = (_P("bias", unit, -1e6, 1e6, 0.02),)
    return (
        _of_channel(
            f"{kind}_scale", f"the measured {kind} has another scale", scale_parameter(1.03, -2.0), _scaled
        ),
        _of_channel(f"{kind}_bias", f"the measured {kind} has an offset", bias, _shifted),
    )


EFFECTS: tuple[Effect, ...] = (
    *(effect for kind, unit in _CHANNEL_UNITS.items() for effect in _of_kind(kind, unit)),
    _of_channel("sensor_delay", "one channel is late", (_P("delay", "s", 0.0, 0.2, 0.005),), _delayed),
    _of_actuator(
        "gain",
        "the actuator gives another force per command than declared, or its command is scaled in the log",
        scale_parameter(0.9),
        scales(ACTUATOR, "gain"),
        quantity="gain",
    ),
    _of_actuator(
        "torque_constant",
        "the motor gives another force per ampere, and another voltage per speed, than declared",
        scale_parameter(0.9),
        scales(ACTUATOR, "torque_constant"),
        quantity="torque_constant",
    ),
    _of_actuator(
        "back_emf",
        "the motor's voltage per speed is not as declared",
        scale_parameter(0.8, 0.0, 3.0),
        scales(ACTUATOR, "back_emf"),
    ),
    _of_actuator(
        "actuator_delay",
        "the actuator answers late, or the position of its joint is measured late",
        (_P("delay", "s", 0.0, 0.2, 0.005),),
        adds_term(ACTUATOR, "delay", "delay"),
    ),
    _of_actuator(
        "actuator_lag",
        "the force follows the command with a first-order lag",
        (_P("time_constant", "s", 0.0, 0.5, 0.01),),
        adds(ACTUATOR, "lag", "time_constant"),
        quantity="lag",
    ),
    _of_actuator(
        "saturation",
        "the force has a limit",
        (_P("limit", "N", 0.0, NO_LIMIT, 1.0, NO_LIMIT),),
        _limited,
        has_threshold=True,
    ),
    _of_actuator(
        "soft_saturation",
        "the force per command falls as the force grows: F/(1 + c |F|), as by magnetic saturation",
        (_P("coefficient", "1/N", 0.0, _ANY, 0.1),),
        adds_term(ACTUATOR, "fading", "coefficient"),
    ),
    _of_actuator(
        "back_driving",
        "where the motion drives the motor, 1/efficiency of its force arrives: a gear with losses, or a "
        "drive that brakes less than it drives",
        (_P("efficiency", "1", 0.2, 2.0, 0.9, 1.0),),
        _driven_back,
    ),
    _of_joint(
        "coulomb",
        "dry friction of the joint is not as declared, or missing",
        (_P("force", "N", -_ANY, _ANY, 0.1),),
        adds(JOINT, "frictionloss", "force"),
        quantity="frictionloss",
    ),
    _of_joint(
        "viscous",
        "viscous friction of the joint is not as declared, or missing",
        (_P("coefficient", "N.s/m", -_ANY, _ANY, 0.1),),
        adds(JOINT, "damping", "coefficient"),
        quantity="damping",
    ),
    _of_joint(
        "quadratic_friction",
        "a friction quadratic in the speed of the joint",
        (_P("coefficient", "N.s2/m2", -_ANY, _ANY, 0.1),),
        adds(JOINT, "quadratic_damping", "coefficient"),
        quantity="quadratic_damping",
    ),
    _of_joint(
        "asymmetric_coulomb",
        "dry friction of the joint is not the same in both directions (forward − backward)",
        (_P("difference", "N", -_ANY, _ANY, 0.1),),
        adds_term(JOINT, "asymmetric_coulomb", "difference"),
    ),
    _of_joint(
        "asymmetric_viscous",
        "viscous friction of the joint is not the same in both directions (forward − backward)",
        (_P("difference", "N.s/m", -_ANY, _ANY, 0.1),),
        adds_term(JOINT, "asymmetric_viscous", "difference"),
    ),
    _of_joint(
        "stribeck",
        "extra friction of the joint near standstill",
        (_P("force", "N", -_ANY, _ANY, 0.1), _P("velocity", "m/s", 1e-6, _ANY, 0.1, None)),
        sets_terms(JOINT, "stribeck_force", stribeck_force="force", stribeck_velocity="velocity"),
    ),
    _of_joint(
        "position_friction",
        "extra dry friction of the joint around one place",
        (
            _P("force", "N", -_ANY, _ANY, 0.1),
            _P("position", "m", -_ANY, _ANY, 0.0, None),
            _P("width", "m", 1e-9, _ANY, 0.1, None),
        ),
        sets_terms(JOINT, "place_force", place_force="force", place_position="position", place_width="width"),
    ),
    _of_joint(
        "load_friction",
        "dry friction that grows with the force or torque that the joint transmits",
        (_P("share", "1", -0.9, 0.9, 0.1),),
        adds_term(JOINT, "load_share", "share"),
    ),
    _of_joint(
        "armature",
        "inertia that turns with the drive (rotor and gears) is not as declared, or missing",
        (_P("inertia", "kg", -_ANY, _ANY, 0.1),),
        adds(JOINT, "armature", "inertia"),
        quantity="armature",
    ),
    _of_joint(
        "stiffness",
        "a force proportional to the position of the joint: spring, cable, hose",
        (_P("stiffness", "N/m", -_ANY, _ANY, 0.1), _P("rest_position", "m", -_ANY, _ANY, 0.0, None)),
        sets_terms(JOINT, "spring", spring="stiffness", spring_rest="rest_position"),
    ),
    _of_joint(
        "force_offset",
        "a constant force on the joint, or an offset of the measured force or command",
        (_P("force", "N", -_ANY, _ANY, 0.1),),
        adds_term(JOINT, "offset", "force"),
    ),
    _of_joint(
        "compliance",
        "a spring between the motor, which is measured, and what the joint moves",
        (_P("compliance", "m/N", 0.0, _ANY, 0.01),),
        adds_term(JOINT, "compliance", "compliance"),
    ),
    _of_joint(
        "backlash",
        "play between the motor, which is measured, and what the joint moves, at every reversal",
        (_P("angle", "m", 0.0, _ANY, 1e-3),),
        adds_term(JOINT, "play", "angle"),
        has_threshold=True,
    ),
    Effect(
        "payload",
        "a mass that the model lacks, on the line from the body's joint through its centre of mass",
        BODY,
        (MJCF,),
        (
            EffectParameter("mass", "kg", -1e3, 1e3, 0.1),
            EffectParameter("distance", "m", -10.0, 10.0, 0.1, None),
        ),
        (ON_BODY,),
        (_loaded,),
        quantity="mass",
    ),
    Effect(
        "grade",
        "the machine does not stand level: gravity is turned about an axis of the world",
        "base",
        (MJCF,),
        (EffectParameter("slope", "rad", -0.5, 0.5, 0.02),),
        (AXIS_OF_TILT,),
        (_tilted,),
    ),
)
"""Effects of channels, actuators, joints, bodies and the base."""
