"""Physical parameters as functions of the estimated deviations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from omnimj.estimate.robot.balance import BalanceConstants, SensorErrors
from omnimj.estimate.robot.records import RobotEstimate
from omnimj.estimate.robot.uncertainty import Doubt
from omnimj.estimate.robot.unknowns import Unknowns
from omnimj.signals import Array

LOSS_SPEEDS = (5.0, 10.0, 20.0)
"""Wheel speeds at which the loss of a wheel is stated [rad/s]."""


class Quantity(NamedTuple):
    """One number of a robot."""

    name: str
    words: str
    unit: str
    of: Callable[[Array], float]
    """Its value for a vector of deviations."""
    is_parameter: bool = True
    """False for a number that follows from others, whose excitation is not judged again."""


def estimates(doubt: Doubt) -> tuple[tuple[Quantity, RobotEstimate], ...]:
    """All numbers of a fitted robot with intervals."""
    zero, found = np.zeros(len(doubt.fit.x)), []
    for one in quantities(doubt.fit.unknowns):
        value, low, high = doubt.interval(one.of)
        left = doubt.left_of_prior(one.of)
        estimate = RobotEstimate(one.name, one.words, one.unit, value, low, high, one.of(zero), left)
        found.append((one, estimate))
    return tuple(found)


def quantities(u: Unknowns) -> Iterator[Quantity]:
    """All numbers of a robot, those of each wheel first."""
    for i in range(len(u.nominal.axle)):
        yield from _of_wheel(u, i)
    yield from _of_motors(u)
    yield from _of_body(u)
    yield from _of_sensors(u)


def _balance(u: Unknowns, of: Callable[[BalanceConstants], float]) -> Callable[[Array], float]:
    return lambda x: float(of(u.constants(x)))


def torque_constants(u: Unknowns, c: BalanceConstants) -> Array:
    """Torque constant of each motor at the model file's gear efficiency, shape (n,) [N.m/A]."""
    motor, robot = u.robot.motor, c.robot
    lost = u.nominal.robot.torque / (motor.torque_constant * u.torque_scale)
    return robot.torque / lost


def _of_wheel(u: Unknowns, i: int) -> Iterator[Quantity]:
    wheel, radius = i + 1, float(u.nominal.robot.radius[i])
    yield Quantity(
        f"torque_constant_{wheel}",
        f"torque constant of motor {wheel}",
        "N.m/A",
        _balance(u, lambda c: torque_constants(u, c)[i]),
        False,
    )
    yield Quantity(
        f"torque_ratio_{wheel}",
        f"torque constant of motor {wheel} over the mean of all",
        "1",
        _balance(u, lambda c: c.robot.torque[i] / c.robot.torque.mean()),
    )
    yield Quantity(
        f"dry_loss_{wheel}",
        f"dry loss of wheel {wheel}, as torque at the wheel",
        "N.m",
        _balance(u, lambda c: c.robot.dry[i] * radius),
    )
    yield Quantity(
        f"viscous_loss_{wheel}",
        f"viscous loss of wheel {wheel}, as torque at the wheel",
        "N.m.s/rad",
        _balance(u, lambda c: c.robot.viscous[i] * radius),
    )
    for speed in LOSS_SPEEDS:
        yield Quantity(
            f"loss_{wheel}_at_{speed:g}",
            f"whole loss of wheel {wheel} at {speed:g} rad/s",
            "N.m",
            _balance(u, lambda c, w=speed: (c.robot.dry[i] + c.robot.viscous[i] * w) * radius),
            False,
        )


def _of_motors(u: Unknowns) -> Iterator[Quantity]:
    efficiency = u.robot.motor.gear_efficiency
    yield Quantity(
        "torque_constant",
        "torque constant, mean of all motors",
        "N.m/A",
        _balance(u, lambda c: torque_constants(u, c).mean()),
    )
    yield Quantity(
        "back_driving_efficiency",
        "efficiency of the gear while the wheel drives the motor",
        "1",
        _balance(u, lambda c: 1.0 / (c.robot.driven.mean() * efficiency)),
    )


def _of_body(u: Unknowns) -> Iterator[Quantity]:
    yield Quantity("mass", "mass", "kg", _balance(u, lambda c: c.robot.mass))
    yield Quantity(
        "mass_ratio",
        "mass over the mean traction per ampere",
        "kg.A/N",
        _balance(u, lambda c: c.robot.mass / c.robot.torque.mean()),
    )
    yield Quantity(
        "yaw_inertia", "yaw inertia about the centre", "kg.m2", _balance(u, lambda c: c.robot.yaw_inertia)
    )
    yield Quantity(
        "inertia_ratio",
        "yaw inertia over mass",
        "m2",
        _balance(u, lambda c: c.robot.yaw_inertia / c.robot.mass),
    )
    yield Quantity("centre_x", "centre of mass, x", "m", _balance(u, lambda c: c.robot.centre[0]))
    yield Quantity("centre_y", "centre of mass, y", "m", _balance(u, lambda c: c.robot.centre[1]))
    yield Quantity(
        "roller_dry", "dry drag of the rollers over the load", "1", _balance(u, lambda c: c.robot.roller_dry)
    )
    yield Quantity(
        "roller_viscous",
        "viscous drag of the rollers over the load",
        "s/m",
        _balance(u, lambda c: c.robot.roller_viscous),
    )


def _of_sensors(u: Unknowns) -> Iterator[Quantity]:
    def errors(of: Callable[[SensorErrors], float]) -> Callable[[Array], float]:
        return lambda x: float(of(u.errors(x)))

    for i in range(len(u.nominal.axle)):
        name, words = f"current_offset_{i + 1}", f"offset of current monitor {i + 1}"
        yield Quantity(name, words, "A", errors(lambda e, i=i: e.current[i]))
    if (late := u.pose_delay) is not None:
        words = "delay of the measured position behind the currents"
        yield Quantity("position_delay", words, "s", errors(lambda e: late + e.acceleration_delay))
        words = "delay of the measured heading behind the currents"
        yield Quantity("heading_delay", words, "s", errors(lambda e: late + e.yaw_rate_delay))
        return
    words = "delay of the accelerometer behind the currents, beyond its bandwidth"
    yield Quantity("acceleration_delay", words, "s", errors(lambda e: e.acceleration_delay))
    words = "delay of the gyro behind the currents, beyond its bandwidth"
    yield Quantity("yaw_rate_delay", words, "s", errors(lambda e: e.yaw_rate_delay))
