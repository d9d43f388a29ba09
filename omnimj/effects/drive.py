"""Effects of the actuators of any machine: gain, motor constant, delay, lag, limit of the force."""

from __future__ import annotations

from omnimj.effects.effect import MJCF, Effect, EffectParameter, Hook, Values
from omnimj.effects.parts import ACTUATOR, ON_ACTUATOR, PartChanges, adds, adds_term, scale_parameter, scales

_P = EffectParameter
NO_LIMIT = 1e9
"""Force at which a limit vanishes [N or N.m]."""


def _limited(changes: PartChanges, values: Values) -> None:
    name = str(values[ACTUATOR])
    changes.limits[name] = min(values["limit"], changes.limits.get(name, NO_LIMIT))


def _effect(
    name: str, words: str, parameters: tuple[EffectParameter, ...], hook: Hook, has_threshold: bool = False
) -> Effect:
    hooks = (hook,)
    return Effect(
        name, words, "drive", (MJCF,), parameters, (ON_ACTUATOR,), hooks, has_threshold=has_threshold
    )


EFFECTS: tuple[Effect, ...] = (
    _effect(
        "gain",
        "the actuator gives another force per command than declared, or its command is scaled in the log",
        scale_parameter(0.9),
        scales(ACTUATOR, "gain"),
    ),
    _effect(
        "torque_constant",
        "the motor gives another force per ampere, and another voltage per speed, than declared",
        scale_parameter(0.9),
        scales(ACTUATOR, "torque_constant"),
    ),
    _effect(
        "back_emf",
        "the motor's voltage per speed is not as declared",
        scale_parameter(0.8, 0.0, 3.0),
        scales(ACTUATOR, "back_emf"),
    ),
    _effect(
        "actuator_delay",
        "the actuator answers late, or the position of its joint is measured late",
        (_P("delay", "s", 0.0, 0.2, 0.005),),
        adds_term(ACTUATOR, "delay", "delay"),
    ),
    _effect(
        "actuator_lag",
        "the force follows the command with a first-order lag",
        (_P("time_constant", "s", 0.0, 0.5, 0.01),),
        adds(ACTUATOR, "lag", "time_constant"),
    ),
    _effect(
        "saturation",
        "the force has a limit",
        (_P("limit", "N", 0.0, NO_LIMIT, 1.0, NO_LIMIT),),
        _limited,
        has_threshold=True,
    ),
)
"""Effects of an actuator."""
