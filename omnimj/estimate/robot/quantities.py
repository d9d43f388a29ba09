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


def _constant(
    u: Unknowns, name: str, words: str, unit: str, of: Callable[[BalanceConstants], float]
) -> Quantity:
    """Number that follows from the constants of the balance."""
    return Quantity(name, words, unit, lambda x: float(of(u.constants(x))))


def _dependent(quantity: Quantity) -> Quantity:
    """The number as one that follows from others."""
    return quantity._replace(is_parameter=False)


def torque_constants(u: Unknowns, c: BalanceConstants) -> Array:
    """Torque constant of each motor at the model file's gear efficiency, shape (n,) [N.m/A]."""
    motor, robot = u.robot.motor, c.robot
    lost = u.nominal.robot.torque / (motor.torque_constant * u.torque_scale)
    return robot.torque / lost


def _of_wheel(u: Unknowns, i: int) -> Iterator[Quantity]:
    k, radius = i + 1, float(u.nominal.robot.radius[i])
    words = f"torque constant of motor {k}"
    yield _dependent(
        _constant(u, f"torque_constant_{k}", words, "N.m/A", lambda c: torque_constants(u, c)[i])
    )
    words = f"torque constant of motor {k} over the mean of all"
    yield _constant(u, f"torque_ratio_{k}", words, "1", lambda c: c.robot.torque[i] / c.robot.torque.mean())
    words = f"dry loss of wheel {k}, as torque at the wheel"
    yield _constant(u, f"dry_loss_{k}", words, "N.m", lambda c: c.robot.dry[i] * radius)
    words = f"viscous loss of wheel {k}, as torque at the wheel"
    yield _constant(u, f"viscous_loss_{k}", words, "N.m.s/rad", lambda c: c.robot.viscous[i] * radius)
    for speed in LOSS_SPEEDS:
        name, words = f"loss_{k}_at_{speed:g}", f"whole loss of wheel {k} at {speed:g} rad/s"

        def loss(c: BalanceConstants, speed: float = speed) -> float:
            return (c.robot.dry[i] + c.robot.viscous[i] * speed) * radius

        yield _dependent(_constant(u, name, words, "N.m", loss))


def _of_motors(u: Unknowns) -> Iterator[Quantity]:
    words = "torque constant, mean of all motors"
    yield _constant(u, "torque_constant", words, "N.m/A", lambda c: torque_constants(u, c).mean())
    words, efficiency = (
        "efficiency of the gear while the wheel drives the motor",
        u.robot.motor.gear_efficiency,
    )
    name = "back_driving_efficiency"
    yield _constant(u, name, words, "1", lambda c: 1.0 / (c.robot.driven.mean() * efficiency))


def _of_body(u: Unknowns) -> Iterator[Quantity]:
    yield _constant(u, "mass", "mass", "kg", lambda c: c.robot.mass)
    words = "mass over the mean traction per ampere"
    yield _constant(u, "mass_ratio", words, "kg.A/N", lambda c: c.robot.mass / c.robot.torque.mean())
    yield _constant(u, "yaw_inertia", "yaw inertia about the centre", "kg.m2", lambda c: c.robot.yaw_inertia)
    words = "yaw inertia over mass"
    yield _constant(u, "inertia_ratio", words, "m2", lambda c: c.robot.yaw_inertia / c.robot.mass)
    yield _constant(u, "centre_x", "centre of mass, x", "m", lambda c: c.robot.centre[0])
    yield _constant(u, "centre_y", "centre of mass, y", "m", lambda c: c.robot.centre[1])
    words = "dry drag of the rollers over the load"
    yield _constant(u, "roller_dry", words, "1", lambda c: c.robot.roller_dry)
    words = "viscous drag of the rollers over the load"
    yield _constant(u, "roller_viscous", words, "s/m", lambda c: c.robot.roller_viscous)


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
    for k, words in enumerate(("ahead of the centre", "left of the centre")):
        name = f"accelerometer_{'xy'[k]}"

        def place(c: BalanceConstants, k: int = k) -> float:
            return c.robot.accelerometer[k]

        yield _constant(u, name, f"accelerometer, {words}", "m", place)
    words = "delay of the accelerometer behind the currents, beyond its bandwidth"
    yield Quantity("acceleration_delay", words, "s", errors(lambda e: e.acceleration_delay))
    words = "delay of the gyro behind the currents, beyond its bandwidth"
    yield Quantity("yaw_rate_delay", words, "s", errors(lambda e: e.yaw_rate_delay))
