"""Effects of the sensors: offsets, scales, delays; an inverted sign is a scale of −1."""

from __future__ import annotations

import math
from collections.abc import Sequence

from omnimj import signals
from omnimj.effects.effect import (
    MOST_WHEELS,
    RIG,
    ROBOT,
    Effect,
    EffectParameter,
    Hook,
    MachineChanges,
    Selector,
    Values,
    wheel_number,
)

RIG_CHANNELS = signals.RIG_CHANNELS[:-1]
"""Measured channels of the rig; the gantry speed is commanded, not measured."""
ROBOT_CHANNELS = signals.robot_channels(MOST_WHEELS)
"""Measured channels of a robot with as many wheels as can be."""

_AXES = Selector("channel", ("acceleration_x", "acceleration_y"))


def _chosen(changes: MachineChanges, values: Values, channels: Sequence[str]) -> list[str]:
    """The channel that an effect names, or all of the machine."""
    named = [str(values["channel"])] if "channel" in values else channels
    return [name for name in named if wheel_number(name) <= changes.machine.wheel_count]


def _scaled(*channels: str) -> Hook:
    def hook(changes: MachineChanges, values: Values) -> None:
        for channel in _chosen(changes, values, channels):
            changes.change_channel(channel, scale=values["scale"])

    return hook


def _shifted(*channels: str) -> Hook:
    def hook(changes: MachineChanges, values: Values) -> None:
        for channel in _chosen(changes, values, channels):
            changes.change_channel(channel, offset=values["bias"])

    return hook


def _delayed(changes: MachineChanges, values: Values) -> None:
    changes.change_channel(str(values["channel"]), delay=values["delay"])


def _displaced(changes: MachineChanges, values: Values) -> None:
    for axis in ("x", "y"):
        changes.add_to_constant("body", f"accelerometer_{axis}", values[axis], least=-math.inf)


def _turned(changes: MachineChanges, values: Values) -> None:
    changes.change_channel("heading", offset=values["angle"])


def _scaled_pose(changes: MachineChanges, values: Values) -> None:
    for channel in ("x", "y"):
        changes.change_channel(channel, scale=values["scale"])


def _scale(typical: float) -> tuple[EffectParameter]:
    return (EffectParameter("scale", "1", -1.5, 2.0, typical, 1.0),)


def _bias(unit: str, most: float, typical: float) -> tuple[EffectParameter]:
    return (EffectParameter("bias", unit, -most, most, typical),)


_DELAY = ("sensor_delay", "one channel is late", "sensors")
_SECONDS = (EffectParameter("delay", "s", 0.0, 0.5, 0.02),)
_CURRENT_BIAS = ("current_bias", "the current monitor has an offset", "sensors")
_CURRENT_SCALE = ("current_scale", "the current monitor has another gain", "sensors")
_ACCELERATION_BIAS = ("acceleration_bias", "the accelerometer has an offset", "sensors")
_ACCELERATION_SCALE = ("acceleration_scale", "the accelerometer has another gain", "sensors")
_CURRENTS = ROBOT_CHANNELS[:MOST_WHEELS]

EFFECTS = (
    Effect(*_CURRENT_BIAS, (RIG,), _bias("A", 1.0, 0.05), hooks=(_shifted("current"),)),
    Effect(*_CURRENT_BIAS, (ROBOT,), _bias("A", 1.0, 0.05), hooks=(_shifted(*_CURRENTS),)),
    Effect(*_CURRENT_SCALE, (RIG,), _scale(1.1), hooks=(_scaled("current"),)),
    Effect(*_CURRENT_SCALE, (ROBOT,), _scale(1.1), hooks=(_scaled(*_CURRENTS),)),
    Effect(
        "wheel_speed_scale",
        "the wheel's encoder has another constant",
        "sensors",
        (RIG,),
        _scale(1.05),
        hooks=(_scaled("wheel_speed"),),
    ),
    Effect(
        "carriage_speed_scale",
        "the carriage's encoder has another constant",
        "sensors",
        (RIG,),
        _scale(1.05),
        hooks=(_scaled("carriage_speed"),),
    ),
    Effect(*_ACCELERATION_BIAS, (RIG,), _bias("m/s2", 5.0, 0.2), hooks=(_shifted("carriage_acceleration"),)),
    Effect(*_ACCELERATION_BIAS, (ROBOT,), _bias("m/s2", 5.0, 0.2), (_AXES,), (_shifted(),)),
    Effect(*_ACCELERATION_SCALE, (RIG,), _scale(1.15), hooks=(_scaled("carriage_acceleration"),)),
    Effect(*_ACCELERATION_SCALE, (ROBOT,), _scale(1.15), (_AXES,), (_scaled(),)),
    Effect(
        "accelerometer_position",
        "the accelerometer is not where the model has it and feels the turning of the body",
        "sensors",
        (ROBOT,),
        (EffectParameter("x", "m", -0.5, 0.5, 0.05), EffectParameter("y", "m", -0.5, 0.5, 0.05)),
        hooks=(_displaced,),
    ),
    Effect(
        "yaw_rate_bias",
        "the gyro has an offset",
        "sensors",
        (ROBOT,),
        _bias("rad/s", 1.0, 0.03),
        hooks=(_shifted("yaw_rate"),),
    ),
    Effect(
        "yaw_rate_scale",
        "the gyro has another gain",
        "sensors",
        (ROBOT,),
        _scale(1.1),
        hooks=(_scaled("yaw_rate"),),
    ),
    Effect(
        "heading_offset",
        "the marker of a measured pose is turned on the robot",
        "sensors",
        (ROBOT,),
        (EffectParameter("angle", "rad", -0.5, 0.5, 0.03),),
        hooks=(_turned,),
    ),
    Effect(
        "pose_scale",
        "the scale of a measured position, or the radius of all wheels, is not as declared",
        "sensors",
        (ROBOT,),
        (EffectParameter("scale", "1", 0.5, 1.5, 1.03, 1.0),),
        hooks=(_scaled_pose,),
    ),
    Effect(*_DELAY, (RIG,), _SECONDS, (Selector("channel", RIG_CHANNELS),), (_delayed,)),
    Effect(*_DELAY, (ROBOT,), _SECONDS, (Selector("channel", ROBOT_CHANNELS),), (_delayed,)),
)
