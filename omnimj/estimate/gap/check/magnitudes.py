"""Magnitudes of the channels against what the machine can do and what its sensors can show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.estimate.gap.check.columns import fill_masked, moving_mask
from omnimj.estimate.gap.check.suspicions import GROSS, SURE_STRENGTH, Suspicion, units_of
from omnimj.parameters import Rig, Robot
from omnimj.recording.dataset import Run
from omnimj.signals import Array

_BEYOND = 1.5  # times the limit: a scale of typical size, noise and a push from outside stay below
FAR_BEYOND = 10.0
"""Times the limit of a channel from which a value is a fault of the data, however rare it is."""
_RARE = 1e-3  # share of samples that may lie beyond, as bursts do
_FEWEST = 3
_BULK = 0.75  # quantile of a channel in motion that only another unit puts beyond its sensor's range
_UNIT = float(np.exp(2.0 * GROSS))  # times the range, from which on only another unit explains a channel
_LITTLE = 0.01  # smallest share of the range that a channel usually has in motion
_USUAL_UNIT = 1000.0  # of a current or a force: milliamperes, millinewtons


@dataclass(frozen=True)
class Limit:
    """Largest magnitude of a channel."""

    channel: str
    value: float
    """Largest value of the machine [unit of the channel]."""
    range: float
    """Largest value that its sensor shows, at least `value`."""
    words: str
    """Reason, with the number."""
    is_place: bool = False
    """True if the limit is for the distance from the middle of the range, since a position has no zero."""


def rig_limits(rig: Rig) -> tuple[Limit, ...]:
    """Limits of the rig's channels."""
    current, speed = _motor_limits(rig)
    rim = rig.wheel.radius
    return (
        Limit("current", *current),
        Limit("wheel_speed", *speed),
        Limit("carriage_speed", rim * speed[0], rim * speed[1], f"{speed[2]} times its radius"),
        Limit("carriage_acceleration", *_accelerometer(rig)),
    )


def robot_limits(robot: Robot) -> tuple[Limit, ...]:
    """Limits of the robot's channels."""
    current, speed = _motor_limits(robot)
    wheels = range(1, len(robot.wheels) + 1)
    gyro = robot.sensors.gyro_range
    return (
        *(Limit(f"current_{i}", *current) for i in wheels),
        *(Limit(f"wheel_speed_{i}", *speed) for i in wheels),
        *(Limit(name, *_accelerometer(robot)) for name in ("acceleration_x", "acceleration_y")),
        Limit("yaw_rate", gyro, gyro, f"the gyro's range is {gyro:.4g} rad/s"),
    )


def _motor_limits(machine: Rig | Robot) -> tuple[tuple[float, float, str], tuple[float, float, str]]:
    """Limits of current and wheel speed: that of the amplifier, and that without load at full supply."""
    motor, sensors = machine.motor, machine.sensors
    fastest = motor.supply / (motor.torque_constant * motor.gear_ratio)
    current = (
        motor.current_limit,
        max(sensors.current_monitor_range, motor.current_limit),
        f"the amplifier's limit is {motor.current_limit:.4g} A",
    )
    words = f"the wheel's speed without load at {motor.supply:.4g} V is {fastest:.4g} rad/s"
    return current, (fastest, max(sensors.speed_monitor_range / motor.gear_ratio, fastest), words)


def _accelerometer(machine: Rig | Robot) -> tuple[float, float, str]:
    most = machine.sensors.accelerometer_range
    return most, most, f"the accelerometer's range is {most:.4g} m/s²"


def magnitude_suspicions(
    runs: Sequence[Run], limits: Sequence[Limit], speeds: Sequence[str]
) -> Iterator[Suspicion]:
    """Yield channels with values that the machine cannot reach.

    A channel that lies beyond its sensor's range most of the time is in another unit.

    Args:
      speeds: Channels that show whether the machine moves.
    """
    for limit in limits:
        sizes = {run.name: _sizes(run, limit) for run in runs if _has(run, limit)}
        if not sizes:
            continue
        others = [s for s in speeds if s != limit.channel]
        moving = [sizes[run.name][moving_mask(run, others)] for run in runs if run.name in sizes]
        usual = _quantile(np.concatenate(moving)) / limit.range
        tops = {name: _top(values, FAR_BEYOND * limit.value) / limit.value for name, values in sizes.items()}
        size = _unit(limit, usual) if usual > _UNIT else None
        if size is not None:
            yield _in_other_unit(limit, usual, size)
        elif max(tops.values()) > _BEYOND:
            yield _beyond(limit, tops)


def beyond_reach(found: Sequence[Suspicion]) -> tuple[str, ...]:
    """Channels that the magnitudes show to be wrong for sure."""
    return tuple(s.channel for s in found if s.kind in ("unit", "magnitude") and s.is_sure)


def _has(run: Run, limit: Limit) -> bool:
    return limit.channel in run.columns and len(run.time) > _FEWEST


def _sizes(run: Run, limit: Limit) -> Array:
    values = fill_masked(run, limit.channel)
    return np.abs(values - 0.5 * (values.min() + values.max()) if limit.is_place else values)


def _quantile(values: Array) -> float:
    return float(np.quantile(values, _BULK)) if values.size else 0.0


def _top(values: Array, far: float) -> float:
    """Largest value but for the few of bursts, unless these are far beyond everything."""
    if values.max() > far:
        return float(values.max())
    rank = max(_FEWEST, int(_RARE * len(values)))
    return float(np.partition(values, len(values) - rank)[len(values) - rank])


def _unit(limit: Limit, usual: float) -> float | None:
    """Most common unit that puts the channel within its range, and not far below; None if there is none."""
    known = {factor for factor, _ in units_of(limit.channel) if usual < factor < usual / _LITTLE}
    return _USUAL_UNIT if _USUAL_UNIT in known else min(known, default=None)


def _in_other_unit(limit: Limit, usual: float, size: float) -> Suspicion:
    words = f"{limit.channel} is usually {usual * limit.range:.4g}, and {limit.words}"
    words += f": divided by {size:.4g} it is within reach"
    return Suspicion(limit.channel, "unit", size, SURE_STRENGTH, words)


def _beyond(limit: Limit, tops: dict[str, float]) -> Suspicion:
    touched = tuple(name for name, top in tops.items() if top > _BEYOND)
    most = max(tops.values())
    words = f"{limit.channel} reaches {most * limit.value:.4g}, and {limit.words}"
    return Suspicion(limit.channel, "magnitude", most, most / _BEYOND, words, (), touched)
