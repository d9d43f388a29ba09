"""The identified robot as a model file: a copy of the one it began with, with what the logs determine."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from omnimj.control.robot_constants import robot_constants
from omnimj.effects.effect import Interval
from omnimj.effects.machine import with_effects
from omnimj.effects.model_writer import format_model
from omnimj.estimate.robot.records import RobotIdentification
from omnimj.parameters import Robot

_REACH = 0.25
"""Largest distance of the mass from the centre that stands for a displaced centre of mass [m]."""
_REPLACED = ("torque_constant", "bearing_friction", "payload")

Effects = dict[str, dict[str, Any]]


def model_text(found: RobotIdentification) -> str:
    """Text of `model.toml`; `read_robot` reads from it the constants that were identified.

    Torque constants and losses of single wheels become the effects `torque_constant` and `bearing_friction`
    with `wheel`, a displaced centre of mass a `payload` that is part of the mass, a displaced accelerometer
    an `accelerometer_position`.

    Raises:
      InputError: A value that no model file can have.
    """
    changed, effects = model_changes(found)
    doubt = _relative_doubts(found)
    values = {
        name: Interval(value, value * (1.0 - doubt[name]), value * (1.0 + doubt[name]))
        if name in doubt and value > 0.0
        else value
        for name, value in changed.items()
    }
    return format_model(found.robot.file, effects, values)


def model_changes(found: RobotIdentification) -> tuple[dict[str, float], Effects]:
    """Changed values of the model file, `table.key` → value, and its effects with intervals."""
    changed, payload = _common_values(found)
    base = _with_values(_bare(found.robot), changed)
    base = with_effects(base, {"payload": payload}) if payload else base
    effects: Effects = {"payload": payload} if payload else _cleared(found.robot, "payload")
    effects |= _of_wheels(found, base) | _of_accelerometer(found)
    return changed, effects


def _relative_doubts(found: RobotIdentification) -> dict[str, float]:
    """Half-widths of the 90 % intervals of the common values, relative; those of ratios for masses."""

    def half(name: str) -> float:
        one = found[name]
        return 0.5 * (one.high - one.low) / abs(one.value) if one.value else 0.0

    def mean(name: str) -> float:
        return float(np.mean([half(f"{name}_{i + 1}") for i in range(len(found.robot.wheels))]))

    return {
        "motor.no_load_torque": mean("dry_loss"),
        "motor.viscous": mean("viscous_loss"),
        "motor.back_driving_efficiency": half("back_driving_efficiency"),
        "wheel.roller_dry": half("roller_dry"),
        "wheel.roller_viscous": half("roller_viscous"),
        "body.mass": half("mass_ratio"),
        "body.yaw_inertia": half("inertia_ratio"),
    }


def _bare(robot: Robot) -> Robot:
    """The robot without the effects that are written anew."""
    kept = {k: v for k, v in robot.effects.items() if k.rstrip("_0123456789") not in _REPLACED}
    return dataclasses.replace(robot, effects=kept)


def _cleared(robot: Robot, name: str) -> Effects:
    """An effect of the old model file that does nothing any more."""
    return {name: {"mass": 0.0, "x": 0.0, "y": 0.0}} if name in robot.effects else {}


def _common_values(found: RobotIdentification) -> tuple[dict[str, float], dict[str, float]]:
    """Values that all wheels share, and the payload that displaces the centre of mass."""
    u, (c, axle, _) = found.fit.unknowns, found.fit.unknowns.constants(found.fit.x)
    robot, nominal = found.robot, u.nominal.robot
    motor, mass = robot.motor, c.mass
    shaft = (c.dry - axle) / (nominal.dry - u.nominal.axle)
    per_friction = nominal.torque / (motor.torque_constant * u.torque_scale)
    viscous = max(float((c.viscous / (motor.gear_ratio * per_friction)).min()), 0.0)
    size = float((c.inertia / nominal.inertia).mean())
    whole = motor.rotor_inertia * (1.0 + robot.wheel.inertia / motor.reflected_inertia)
    values = {
        "motor.rotor_inertia": max(motor.rotor_inertia + (size - 1.0) * whole, 1e-3 * motor.rotor_inertia),
        "motor.no_load_torque": motor.no_load_torque * float(shaft.mean()),
        "motor.viscous": viscous,
        "motor.back_driving_efficiency": min(found["back_driving_efficiency"].value, 2.0),
        "wheel.roller_dry": max(robot.wheel.roller_dry + c.roller_dry - nominal.roller_dry, 0.0),
        "wheel.roller_viscous": max(
            robot.wheel.roller_viscous + c.roller_viscous - nominal.roller_viscous, 0.0
        ),
    }
    place = mass * np.asarray(c.centre)
    distance = float(np.hypot(*place))
    load = max(mass - robot.body.mass, distance / _REACH) if distance > 0.0 else 0.0
    payload: dict[str, float] = {}
    if load > 0.0:
        payload = {"mass": load, "x": float(place[0] / load), "y": float(place[1] / load)}
        values["body.yaw_inertia"] = c.yaw_inertia - distance**2 / load
    else:
        values["body.yaw_inertia"] = c.yaw_inertia
    values["body.mass"] = mass - load
    return values, payload


def _with_values(robot: Robot, changed: Mapping[str, float]) -> Robot:
    tables: dict[str, dict[str, float]] = {}
    for key, value in changed.items():
        table, _, name = key.partition(".")
        tables.setdefault(table, {})[name] = value
    parts: Any = {name: dataclasses.replace(getattr(robot, name), **new) for name, new in tables.items()}
    return dataclasses.replace(robot, **parts)


def _of_wheels(found: RobotIdentification, base: Robot) -> Effects:
    """Torque constants and losses of single wheels beyond the common values of `base`."""
    c, before = found.fit.unknowns.constants(found.fit.x).robot, robot_constants(base)
    scale = c.torque / before.torque
    dry = (c.dry - before.dry) * before.radius
    viscous = np.maximum((c.viscous - before.viscous) * before.radius, 0.0)
    effects: Effects = {}
    for i in range(len(scale)):
        wheel, tail = i + 1, f"_{i + 1}" if i else ""
        # the common size of all is the model file's motor; the ratio is what the data know
        estimate, loss = found[f"torque_ratio_{wheel}"], found[f"dry_loss_{wheel}"]
        share = scale[i] / estimate.value
        effects[f"torque_constant{tail}"] = {
            "wheel": wheel,
            "scale": Interval(float(scale[i]), float(estimate.low * share), float(estimate.high * share)),
        }
        effects[f"bearing_friction{tail}"] = {
            "wheel": wheel,
            "torque": Interval(
                float(dry[i]),
                float(dry[i] + loss.low - loss.value),
                float(dry[i] + loss.high - loss.value),
                "N.m",
            ),
            "viscous": float(viscous[i]),
        }
    return effects


def _of_accelerometer(found: RobotIdentification) -> Effects:
    """Place of the accelerometer beyond that of the model file; nothing where a pose was measured."""
    if found.fit.unknowns.pose_delay is not None:
        return {}
    values = {}
    for axis, stated in zip("xy", found.robot.accelerometer, strict=True):
        one = found[f"accelerometer_{axis}"]
        value, low, high = (float(v - stated) for v in (one.value, one.low, one.high))
        values[axis] = Interval(value, low, high, "m")
    return {"accelerometer_position": values}
