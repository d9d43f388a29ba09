"""Effects of the measured channels of any machine: scale, bias, delay of `position:elbow` and others."""

from __future__ import annotations

from omnimj.effects.effect import MJCF, Effect, EffectParameter, Hook, Values
from omnimj.effects.parts import CHANNEL, ON_CHANNEL, PartChanges, scale_parameter

KINDS = ("position", "velocity", "force", "sensor")
"""Kinds of channels with a scale and a bias; the first part of a column's name."""


def _scaled(changes: PartChanges, values: Values) -> None:
    changes.change_channel(str(values[CHANNEL]), scale=values["scale"])


def _shifted(changes: PartChanges, values: Values) -> None:
    changes.change_channel(str(values[CHANNEL]), offset=values["bias"])


def _delayed(changes: PartChanges, values: Values) -> None:
    changes.change_channel(str(values[CHANNEL]), delay=values["delay"])


def _effect(name: str, words: str, parameters: tuple[EffectParameter, ...], hook: Hook) -> Effect:
    return Effect(name, words, "sensors", (MJCF,), parameters, (ON_CHANNEL,), (hook,))


def _of_kind(kind: str) -> tuple[Effect, Effect]:
    unit = {"position": "m", "velocity": "m/s", "force": "N", "sensor": "1"}[kind]
    bias = (EffectParameter("bias", unit, -1e6, 1e6, 0.02),)
    return (
        _effect(
            f"{kind}_scale", f"the measured {kind} has another scale", scale_parameter(1.03, -2.0), _scaled
        ),
        _effect(f"{kind}_bias", f"the measured {kind} has an offset", bias, _shifted),
    )


EFFECTS: tuple[Effect, ...] = (
    *(effect for kind in KINDS for effect in _of_kind(kind)),
    _effect(
        "sensor_delay", "one channel is late", (EffectParameter("delay", "s", 0.0, 0.2, 0.005),), _delayed
    ),
)
"""Effects of a channel."""
