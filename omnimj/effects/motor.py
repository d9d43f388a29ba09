"""Effects of motor, gear and amplifier."""

from __future__ import annotations

from omnimj.effects.effect import RIG, ROBOT, Effect, EffectParameter, MachineChanges, Values, adds_to_term
from omnimj.effects.wheel import WHEEL


def _torque_constant(changes: MachineChanges, values: Values) -> None:
    changes.torque_scale[changes.wheel_rows(values)] *= values["scale"]


def _back_driving(changes: MachineChanges, values: Values) -> None:
    changes.scale_back_driving(values["efficiency"])


def _backlash(changes: MachineChanges, values: Values) -> None:
    rotor = changes.machine.motor.reflected_inertia
    changes.set_term("backlash", values["angle"], rotor_inertia=rotor)


def _motor_cogging(changes: MachineChanges, values: Values) -> None:
    ratio = changes.machine.motor.gear_ratio
    changes.set_term("cogging", values["amplitude"] * ratio, cogging_order=values["poles"] * ratio)


_TORQUE = ("torque_constant", "the motor gives another torque per ampere than declared", "motor")
_SCALE = (EffectParameter("scale", "1", 0.2, 2.0, 0.9, 1.0),)

EFFECTS = (
    Effect(*_TORQUE, (RIG,), _SCALE, hooks=(_torque_constant,), quantity="motor.torque_constant"),
    Effect(*_TORQUE, (ROBOT,), _SCALE, (WHEEL,), (_torque_constant,)),
    Effect(
        "gear_loss",
        "the gear loses torque, growing with speed or load",
        "motor",
        (RIG, ROBOT),
        (
            EffectParameter("viscous", "N.m.s/rad", 0.0, 0.05, 0.002),
            EffectParameter("load", "1", 0.0, 0.8, 0.1),
        ),
        hooks=(adds_to_term("axle_viscous", "viscous"), adds_to_term("gear_load", "load")),
    ),
    Effect(
        "back_driving",
        "where the wheel drives the motor, the gear's efficiency is not as declared: 1/efficiency of the "
        "declared torque arrives",
        "motor",
        (RIG, ROBOT),
        (EffectParameter("efficiency", "1", 0.2, 2.0, 0.85, 1.0),),
        hooks=(_back_driving,),
    ),
    Effect(
        "backlash",
        "a dead zone in the gear at reversal",
        "motor",
        (RIG, ROBOT),
        (EffectParameter("angle", "rad", 0.0, 0.5, 0.04),),
        hooks=(_backlash,),
        has_impacts=True,
    ),
    Effect(
        "motor_cogging",
        "the torque ripples with the angle of the motor",
        "motor",
        (RIG, ROBOT),
        (
            EffectParameter("amplitude", "N.m", -0.02, 0.02, 0.004),
            EffectParameter("poles", "1", 1.0, 48.0, 2.0, None),
        ),
        hooks=(_motor_cogging,),
        turns_with_wheel=True,
    ),
    Effect(
        "supply_sag",
        "the supply drops with current, and top speed with it",
        "motor",
        (RIG, ROBOT),
        (EffectParameter("resistance", "ohm", 0.0, 20.0, 2.0),),
        hooks=(adds_to_term("sag", "resistance"),),
    ),
    Effect(
        "winding_heating",
        "the motor weakens with the time since start",
        "motor",
        (RIG, ROBOT),
        (EffectParameter("rate", "1/s", -0.5, 0.5, 0.04),),
        hooks=(adds_to_term("heating", "rate"),),
    ),
)
