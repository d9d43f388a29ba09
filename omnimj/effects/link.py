"""Effects of the bodies of any machine: a payload, and the direction of gravity."""

from __future__ import annotations

from omnimj.effects.effect import MJCF, Effect, EffectParameter, Selector, Values
from omnimj.effects.parts import BODY, ON_BODY, PartChanges, Payload

AXIS_OF_TILT = Selector("axis", ("x", "y"))
"""World axis about which gravity is turned."""


def _loaded(changes: PartChanges, values: Values) -> None:
    changes.payloads.append(Payload(str(values[BODY]), values["mass"], values["distance"]))


def _tilted(changes: PartChanges, values: Values) -> None:
    axis = str(values[AXIS_OF_TILT.name])
    changes.tilt[axis] = changes.tilt.get(axis, 0.0) + values["slope"]


EFFECTS: tuple[Effect, ...] = (
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
"""Effects of bodies and of the base."""
