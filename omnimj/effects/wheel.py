"""Effects at the wheels: rollers, bearings, rolling, shape."""

from __future__ import annotations

import math

from omnimj.effects.effect import (
    MOST_WHEELS,
    RIG,
    ROBOT,
    Effect,
    EffectParameter,
    MachineChanges,
    Selector,
    Values,
    adds_to_constant,
    adds_to_term,
)

WHEEL = Selector("wheel", tuple(range(1, MOST_WHEELS + 1)))
"""Selector of the robot wheel on which an effect acts."""
ANY_WHEEL = Selector("wheel", WHEEL.choices, optional=True)
"""The same where the effect acts on all wheels if none is named."""


ROLLER_FRICTION = (
    adds_to_constant("wheel", "roller_dry", "roller_dry"),
    adds_to_constant("wheel", "roller_viscous", "roller_viscous"),
)
"""Hooks of the parameters `roller_dry` and `roller_viscous`."""


def _roller_ripple(changes: MachineChanges, values: Values) -> None:
    # two staggered rows: the contact changes rollers twice per pitch
    wheel = changes.machine.wheel
    changes.set_term("ripple", values["amplitude"], ripple_order=wheel.rows * wheel.rollers_per_row)


def _wheel_radius(changes: MachineChanges, values: Values) -> None:
    changes.radius_scale[changes.wheel_rows(values)] *= values["scale"]


def _wheel_misalignment(changes: MachineChanges, values: Values) -> None:
    changes.misalignment[changes.wheel_rows(values)] += values["angle"]


_RADIUS = ("wheel_radius", "the rolling radius is not as declared", "wheel")
_SCALE = (EffectParameter("scale", "1", 0.5, 1.5, 1.03, 1.0),)
_BEARING = ("bearing_friction", "friction of the wheel's bearings is not as declared", "wheel")
_BEARING_TORQUES = (
    EffectParameter("torque", "N.m", -0.1, 0.5, 0.03),
    EffectParameter("viscous", "N.m.s/rad", 0.0, 0.05, 0.001),
)
_BEARING_HOOKS = (adds_to_term("axle_dry", "torque"), adds_to_term("axle_viscous", "viscous"))

EFFECTS = (
    Effect(
        "roller_friction",
        "lateral friction of the rollers is not as declared",
        "wheel",
        (ROBOT,),
        (
            EffectParameter("roller_dry", "1", -0.2, 0.5, 0.03),
            EffectParameter("roller_viscous", "s/m", -0.5, 2.0, 0.03),
        ),
        hooks=ROLLER_FRICTION,
    ),
    Effect(
        "rolling_resistance",
        "constant resistance to rolling, proportional to the normal force",
        "wheel",
        (RIG, ROBOT),
        (EffectParameter("mu_roll", "1", 0.0, 0.2, 0.025),),
        hooks=(adds_to_constant("wheel", "rolling_resistance", "mu_roll"),),
    ),
    Effect(*_BEARING, (RIG,), _BEARING_TORQUES, hooks=_BEARING_HOOKS),
    Effect(*_BEARING, (ROBOT,), _BEARING_TORQUES, (ANY_WHEEL,), _BEARING_HOOKS),
    Effect(
        "roller_ripple",
        "the force ripples as rollers pass under the wheel",
        "wheel",
        (RIG, ROBOT),
        (EffectParameter("amplitude", "N", -20.0, 20.0, 2.0),),
        hooks=(_roller_ripple,),
        turns_with_wheel=True,
    ),
    Effect(*_RADIUS, (RIG,), _SCALE, hooks=(_wheel_radius,), quantity="wheel.radius"),
    Effect(*_RADIUS, (ROBOT,), _SCALE, (WHEEL,), (_wheel_radius,)),
    Effect(
        "wheel_misalignment",
        "an axle is off its direction",
        "wheel",
        (ROBOT,),
        (EffectParameter("angle", "rad", -0.5 * math.pi, 0.5 * math.pi, 0.06),),
        (WHEEL,),
        (_wheel_misalignment,),
    ),
)
