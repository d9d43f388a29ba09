"""Effects of the linear axis: its own names for effects on the parts of its MJCF file.

Friction, springs, play and inertia are those of any joint; `force` is the declared force of the drive, the
current times the declared force constant, so that the drive's gain shows beside it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from omnimj.effects.effect import AXIS, ChannelEffect, Effect, EffectParameter, Hook, Selector, Values
from omnimj.effects.parts import ACTUATOR, BODY, JOINT, Part, PartChanges, adds, adds_term, scales, sets_terms
from omnimj.parameters import Axis
from omnimj.parameters.parts import GRAVITY

ANY = 1e3
GUIDE, CARRIAGE, DRIVE = "carriage", "carriage", "drive"
"""Joint, body and actuator of the axis' MJCF file."""
CHANNELS: Mapping[str, str] = MappingProxyType(
    {
        "position": f"position:{GUIDE}",
        "velocity": f"velocity:{GUIDE}",
        "force": f"force:{DRIVE}",
        "current": f"force:{DRIVE}",
    }
)
"""Column of an axis' log → channel of the MJCF file; a log has either force or current."""


def part_values(axis: Axis) -> dict[Part, float]:
    """Constants of an axis as quantities of its MJCF file; what lies before the play is the armature."""
    body = axis.axis
    return {
        (JOINT, GUIDE, "damping"): body.viscous,
        (JOINT, GUIDE, "frictionloss"): body.coulomb,
        (JOINT, GUIDE, "armature"): body.drive_mass,
        (BODY, CARRIAGE, "mass"): body.mass - body.drive_mass,
        (ACTUATOR, DRIVE, "gain"): body.force_constant,
    }


def _on(hook: Hook) -> Hook:
    """Hook of any machine, acting on the parts of the axis."""
    return lambda changes, values: hook(changes, {**values, JOINT: GUIDE, BODY: CARRIAGE, ACTUATOR: DRIVE})


def _reading(changes: PartChanges, column: str, scale: float = 1.0, offset: float = 0.0, delay: float = 0.0):
    """Change the readings of a column; no scale acts on an offset, in whatever order effects come."""
    before = changes.channels.get(CHANNELS[column], ChannelEffect())
    found = ChannelEffect(before.scale * scale, before.offset + offset, before.delay + delay)
    changes.channels[CHANNELS[column]] = found


def _scaled(column: str) -> Hook:
    return lambda changes, values: _reading(changes, column, scale=values["scale"])


def _bias(changes: PartChanges, values: Values) -> None:
    _reading(changes, "force", offset=changes.values[ACTUATOR, DRIVE, "gain"] * values["bias"])


def _delay(changes: PartChanges, values: Values) -> None:
    _reading(changes, values["channel"], delay=values["delay"])


def _grade(changes: PartChanges, values: Values) -> None:
    """Weight of all that moves along the guide: gravity is turned, and the armature has no weight in MJCF."""
    changes.tilt["y"] = changes.tilt.get("y", 0.0) + values["slope"]
    weight = GRAVITY * changes.values[JOINT, GUIDE, "armature"]
    changes.add_term(JOINT, GUIDE, "offset", -weight * math.sin(values["slope"]))


def _scale(typical: float, low: float = 0.2) -> tuple[EffectParameter, ...]:
    return (EffectParameter("scale", "1", low, 2.0, typical, 1.0),)


def _effect(name: str, words: str, where: str, parameters, hooks, selectors=()) -> Effect:
    return Effect(name, words, where, (AXIS,), tuple(parameters), tuple(selectors), tuple(hooks))


_P = EffectParameter
_PLACE = {"place_force": "force", "place_position": "position", "place_width": "width"}
EFFECTS: tuple[Effect, ...] = (
    _effect(
        "coulomb",
        "dry friction of the guide is not as declared, or missing",
        "guide",
        [_P("force", "N", -200.0, 500.0, 4.0)],
        [_on(adds(JOINT, "frictionloss", "force"))],
    ),
    _effect(
        "viscous",
        "viscous friction of the guide is not as declared, or missing",
        "guide",
        [_P("coefficient", "N.s/m", -1e3, 1e4, 40.0)],
        [_on(adds(JOINT, "damping", "coefficient"))],
    ),
    _effect(
        "asymmetric_viscous",
        "viscous friction is not the same in both directions (forward − backward)",
        "guide",
        [_P("difference", "N.s/m", -ANY, ANY, 40.0)],
        [_on(adds_term(JOINT, "asymmetric_viscous", "difference"))],
    ),
    _effect(
        "asymmetric_coulomb",
        "dry friction is not the same in both directions (forward − backward)",
        "guide",
        [_P("difference", "N", -200.0, 200.0, 4.0)],
        [_on(adds_term(JOINT, "asymmetric_coulomb", "difference"))],
    ),
    _effect(
        "stribeck",
        "extra friction near standstill",
        "guide",
        [_P("force", "N", -100.0, 200.0, 5.0), _P("velocity", "m/s", 1e-3, 0.2, 0.02, None)],
        [_on(sets_terms(JOINT, "stribeck_force", stribeck_force="force", stribeck_velocity="velocity"))],
    ),
    _effect(
        "position_friction",
        "a sticky place on the guide",
        "guide",
        [
            _P("force", "N", -100.0, 300.0, 5.0),
            _P("position", "m", -10.0, 10.0, 0.0, None),
            _P("width", "m", 2e-3, 1.0, 0.03, None),
        ],
        [
            _on(
                sets_terms(
                    JOINT, "place_force", place_force="force", place_position="position", place_width="width"
                )
            )
        ],
    ),
    _effect(
        "force_offset",
        "a constant force: counterweight, cable, offset of the amplifier",
        "guide",
        [_P("force", "N", -ANY, ANY, 3.0)],
        [_on(adds_term(JOINT, "offset", "force"))],
    ),
    _effect(
        "payload",
        "more or less mass than declared",
        "carriage",
        [_P("mass", "kg", -90.0, 500.0, 5.0)],
        [_on(adds(BODY, "mass", "mass"))],
    ),
    _effect(
        "grade",
        "the guide is not level (slope upward)",
        "guide",
        [_P("slope", "rad", -0.5, 0.5, 0.003)],
        [_grade],
    ),
    _effect(
        "cable_drag",
        "a force proportional to position: cable, hose, spring",
        "carriage",
        [_P("stiffness", "N/m", -ANY, ANY, 20.0), _P("rest_position", "m", -10.0, 10.0, 0.0, None)],
        [_on(sets_terms(JOINT, "spring", spring="stiffness", spring_rest="rest_position"))],
    ),
    _effect(
        "air_drag",
        "a force quadratic in speed",
        "carriage",
        [_P("coefficient", "N.s2/m2", -ANY, 1e4, 40.0)],
        [_on(adds_term(JOINT, "drag", "coefficient"))],
    ),
    _effect(
        "force_scale",
        "the drive's gain is not as declared",
        "drive",
        _scale(1.05),
        [_on(scales(ACTUATOR, "gain"))],
    ),
    _effect(
        "torque_constant",
        "the motor gives another force per ampere than declared",
        "drive",
        _scale(0.95),
        [_on(scales(ACTUATOR, "gain"))],
    ),
    _effect(
        "backlash",
        "play in the drive train at reversal (measured at the carriage)",
        "drive",
        [_P("angle", "m", 0.0, 0.02, 2e-4)],
        [_on(adds_term(JOINT, "play", "angle"))],
    ),
    _effect(
        "position_scale",
        "the encoder's constant is not as declared",
        "sensors",
        _scale(1.03),
        [_scaled("position")],
    ),
    _effect(
        "velocity_scale",
        "the tachometer's constant is not as declared",
        "sensors",
        _scale(1.03),
        [_scaled("velocity")],
    ),
    _effect(
        "current_bias",
        "the force (or current) monitor has an offset",
        "sensors",
        [_P("bias", "A", -10.0, 10.0, 0.1)],
        [_bias],
    ),
    _effect(
        "current_scale",
        "the gain of the force (or current) monitor is not as declared",
        "sensors",
        _scale(1.05),
        [_scaled("force")],
    ),
    _effect(
        "sensor_delay",
        "one channel is late",
        "sensors",
        [_P("delay", "s", 0.0, 0.2, 0.005)],
        [_delay],
        [Selector("channel", tuple(CHANNELS))],
    ),
)
"""Effects of the linear axis; those shared with other plants have the same names."""
