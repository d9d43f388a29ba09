"""Effects of the linear axis: the names that its datasets know for effects on the parts of its MJCF file."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from types import MappingProxyType

from omnimj.effects import mjcf
from omnimj.effects.effect import AXIS, Effect, EffectParameter, Hook, Selector, Values
from omnimj.effects.parts import ACTUATOR, BODY, CHANNEL, JOINT, PartChanges, adds
from omnimj.parameters.parts import GRAVITY

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
_PARTS = {JOINT: GUIDE, BODY: CARRIAGE, ACTUATOR: DRIVE}
_ALIKE: tuple[tuple[str, str, Mapping[str, float]], ...] = (
    ("coulomb", "coulomb", {"force": 4.0}),
    ("viscous", "viscous", {"coefficient": 40.0}),
    ("asymmetric_viscous", "asymmetric_viscous", {"difference": 40.0}),
    ("asymmetric_coulomb", "asymmetric_coulomb", {"difference": 4.0}),
    ("stribeck", "stribeck", {"force": 5.0, "velocity": 0.02}),
    ("position_friction", "position_friction", {"force": 5.0, "width": 0.03}),
    ("force_offset", "force_offset", {"force": 3.0}),
    ("cable_drag", "stiffness", {"stiffness": 20.0}),
    ("air_drag", "quadratic_friction", {"coefficient": 40.0}),
    ("backlash", "backlash", {"angle": 2e-4}),
    ("force_scale", "gain", {"scale": 1.05}),
    ("torque_constant", "gain", {"scale": 0.95}),
    ("position_scale", "position_scale", {}),
    ("velocity_scale", "velocity_scale", {}),
    ("current_scale", "force_scale", {"scale": 1.05}),
)
"""Name on the axis, that on any machine, and typical values."""


def _on(hook: Hook, channel: str = "") -> Hook:
    """Hook of any machine, acting on the parts of the axis."""
    return lambda changes, values: hook(changes, {**_PARTS, CHANNEL: channel, **values})


def _alike(name: str, general: Effect, typical: Mapping[str, float]) -> Effect:
    """Effect of any machine under a name of the axis."""
    kind = general.name.removesuffix("_scale")
    parameters = (dataclasses.replace(p, typical=typical.get(p.name, p.typical)) for p in general.parameters)
    hooks = tuple(_on(hook, CHANNELS.get(kind, "")) for hook in general.hooks)
    return dataclasses.replace(
        general, name=name, plants=(AXIS,), parameters=tuple(parameters), selectors=(), hooks=hooks
    )


def _bias(changes: PartChanges, values: Values) -> None:
    offset = changes.values[ACTUATOR, DRIVE, "gain"] * values["bias"]
    changes.change_channel(CHANNELS["force"], offset=offset)


def _delay(changes: PartChanges, values: Values) -> None:
    changes.change_channel(CHANNELS[values["channel"]], delay=values["delay"])


def _grade(changes: PartChanges, values: Values) -> None:
    """Weight of all that moves along the guide: gravity is turned, and the armature has no weight in MJCF."""
    changes.tilt["y"] = changes.tilt.get("y", 0.0) + values["slope"]
    weight = GRAVITY * changes.values[JOINT, GUIDE, "armature"]
    changes.add_term(JOINT, GUIDE, "offset", -weight * math.sin(values["slope"]))


def _own(name: str, words: str, where: str, parameter: EffectParameter, hook: Hook, selectors=()) -> Effect:
    return Effect(name, words, where, (AXIS,), (parameter,), selectors, (hook,))


_GENERAL = {effect.name: effect for effect in mjcf.EFFECTS}
_P = EffectParameter
EFFECTS: tuple[Effect, ...] = (
    *(_alike(name, _GENERAL[general], typical) for name, general, typical in _ALIKE),
    _own(
        "payload",
        "more or less mass than declared",
        BODY,
        _P("mass", "kg", -90.0, 500.0, 5.0),
        _on(adds(BODY, "mass", "mass")),
    ),
    _own(
        "grade",
        "the guide is not level (slope upward)",
        "base",
        _P("slope", "rad", -0.5, 0.5, 0.003),
        _grade,
    ),
    _own(
        "current_bias",
        "the force (or current) monitor has an offset",
        "sensors",
        _P("bias", "A", -10.0, 10.0, 0.1),
        _bias,
    ),
    _own(
        "sensor_delay",
        "one channel is late",
        "sensors",
        _P("delay", "s", 0.0, 0.2, 0.005),
        _delay,
        (Selector("channel", tuple(CHANNELS)),),
    ),
)
"""Effects of the linear axis."""
