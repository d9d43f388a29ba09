"""Effects of the linear axis, which change its constants or its `extras`.

`physics.axis.axis_row` packs both for the kernels.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType

from omnimj.effects.effect import AXIS, Effect, EffectParameter, Hook, MachineChanges, Selector, Values
from omnimj.errors import InputError

ANY = 1e3
DELAYS: Mapping[str, str] = MappingProxyType(
    {
        "position": "position_delay",
        "velocity": "velocity_delay",
        "force": "force_delay",
        "current": "force_delay",
    }
)
"""Delay parameter of each channel; a log has either force or current."""


def _change(changes: MachineChanges, **entries: float) -> None:
    extras = dataclasses.replace(changes.machine.extras, **entries)
    changes.machine = dataclasses.replace(changes.machine, extras=extras)


def _body(name: str, parameter: str) -> Hook:
    """Hook that adds to a constant, which cannot fall below zero, or for the mass below a tenth of it."""

    def hook(changes: MachineChanges, values: Values) -> None:
        body = changes.machine.axis
        least = 0.1 * body.mass if name == "mass" else 0.0
        body = dataclasses.replace(body, **{name: max(getattr(body, name) + values[parameter], least)})
        changes.machine = dataclasses.replace(changes.machine, axis=body)

    return hook


def _add(name: str, parameter: str) -> Hook:
    def hook(changes: MachineChanges, values: Values) -> None:
        _change(changes, **{name: getattr(changes.machine.extras, name) + values[parameter]})

    return hook


def _times(name: str) -> Hook:
    def hook(changes: MachineChanges, values: Values) -> None:
        _change(changes, **{name: getattr(changes.machine.extras, name) * values["scale"]})

    return hook


def _once(amplitude: str, parameter: str, **shape: str) -> Hook:
    """Hook that sets an amplitude and its shape; the effect may act only once on a machine."""

    def hook(changes: MachineChanges, values: Values) -> None:
        if values[parameter] == 0.0:
            return
        if getattr(changes.machine.extras, amplitude) != 0.0:
            raise InputError("effects", "found this effect twice", "it can act once on a machine")
        _change(changes, **{amplitude: values[parameter]}, **{k: values[v] for k, v in shape.items()})

    return hook


def _bias(changes: MachineChanges, values: Values) -> None:
    # added after the gain, so that the order of the two effects does not matter
    bias = changes.machine.axis.force_constant * values["bias"]
    _change(changes, monitor_bias=changes.machine.extras.monitor_bias + bias)


def _delay(changes: MachineChanges, values: Values) -> None:
    name = DELAYS[values["channel"]]
    _change(changes, **{name: getattr(changes.machine.extras, name) + values["delay"]})


def _scale(typical: float, low: float = 0.2) -> tuple[EffectParameter, ...]:
    return (EffectParameter("scale", "1", low, 2.0, typical, 1.0),)


def _effect(name: str, words: str, where: str, parameters, hooks, selectors=()) -> Effect:
    return Effect(name, words, where, (AXIS,), tuple(parameters), tuple(selectors), tuple(hooks))


_P = EffectParameter
EFFECTS: tuple[Effect, ...] = (
    _effect(
        "coulomb",
        "dry friction of the guide is not as declared, or missing",
        "guide",
        [_P("force", "N", -200.0, 500.0, 4.0)],
        [_body("coulomb", "force")],
    ),
    _effect(
        "viscous",
        "viscous friction of the guide is not as declared, or missing",
        "guide",
        [_P("coefficient", "N.s/m", -1e3, 1e4, 40.0)],
        [_body("viscous", "coefficient")],
    ),
    _effect(
        "asymmetric_viscous",
        "viscous friction is not the same in both directions (forward − backward)",
        "guide",
        [_P("difference", "N.s/m", -ANY, ANY, 40.0)],
        [_add("asymmetric_viscous", "difference")],
    ),
    _effect(
        "asymmetric_coulomb",
        "dry friction is not the same in both directions (forward − backward)",
        "guide",
        [_P("difference", "N", -200.0, 200.0, 4.0)],
        [_add("asymmetric_coulomb", "difference")],
    ),
    _effect(
        "stribeck",
        "extra friction near standstill",
        "guide",
        [_P("force", "N", -100.0, 200.0, 5.0), _P("velocity", "m/s", 1e-3, 0.2, 0.02, None)],
        [_once("stribeck_force", "force", stribeck_velocity="velocity")],
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
        [_once("place_force", "force", place="position", place_width="width")],
    ),
    _effect(
        "force_offset",
        "a constant force: counterweight, cable, offset of the amplifier",
        "guide",
        [_P("force", "N", -ANY, ANY, 3.0)],
        [_add("offset", "force")],
    ),
    _effect(
        "payload",
        "more or less mass than declared",
        "carriage",
        [_P("mass", "kg", -90.0, 500.0, 5.0)],
        [_body("mass", "mass")],
    ),
    _effect(
        "grade",
        "the guide is not level (slope upward)",
        "guide",
        [_P("slope", "rad", -0.5, 0.5, 0.003)],
        [_add("slope", "slope")],
    ),
    _effect(
        "cable_drag",
        "a force proportional to position: cable, hose, spring",
        "carriage",
        [_P("stiffness", "N/m", -ANY, ANY, 20.0), _P("rest_position", "m", -10.0, 10.0, 0.0, None)],
        [_once("cable_stiffness", "stiffness", cable_rest="rest_position")],
    ),
    _effect(
        "air_drag",
        "a force quadratic in speed",
        "carriage",
        [_P("coefficient", "N.s2/m2", -ANY, 1e4, 40.0)],
        [_add("air", "coefficient")],
    ),
    _effect(
        "force_scale",
        "the drive's gain is not as declared",
        "drive",
        _scale(1.05),
        [_times("force_scale")],
    ),
    _effect(
        "torque_constant",
        "the motor gives another force per ampere than declared",
        "drive",
        _scale(0.95),
        [_times("force_scale")],
    ),
    _effect(
        "backlash",
        "play in the drive train at reversal (measured at the carriage)",
        "drive",
        [_P("angle", "m", 0.0, 0.02, 2e-4)],
        [_add("play", "angle")],
    ),
    _effect(
        "position_scale",
        "the encoder's constant is not as declared",
        "sensors",
        _scale(1.03),
        [_times("position_scale")],
    ),
    _effect(
        "velocity_scale",
        "the tachometer's constant is not as declared",
        "sensors",
        _scale(1.03),
        [_times("velocity_scale")],
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
        [_times("monitor_scale")],
    ),
    _effect(
        "sensor_delay",
        "one channel is late",
        "sensors",
        [_P("delay", "s", 0.0, 0.2, 0.005)],
        [_delay],
        [Selector("channel", tuple(DELAYS))],
    ),
)
"""Effects of the linear axis; those shared with other plants have the same names."""
