"""Unknowns of a robot: their names, their priors from its model file, and the constants they lead to.

Torque constants, dry and viscous losses are a common part and a deviation of each wheel from it, both with
priors: wheels that the data cannot distinguish keep a common value. A force balance holds for any multiple
of all forces and masses together, so data determine ratios to the torque constant, and its absolute size
comes from the prior: it is the model file's, within its `uncertainty`, while the mass may be that of any
usual payload. The inertia of the wheels is scaled along.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from omnimj.control.robot_constants import robot_constants
from omnimj.effects.machine import apply_effects
from omnimj.estimate.robot.balance import BalanceConstants, SensorErrors
from omnimj.parameters import Robot
from omnimj.parameters.parts import GRAVITY
from omnimj.signals import Array

VISCOUS_AT = 100.0
"""Wheel speed at which 1 unit of viscous loss is as large as the nominal dry loss [rad/s]."""
PART_SPREAD = 0.05
"""Standard deviation of a motor's torque constant about the mean of its kind, relative."""
LOSS_SPREAD, VISCOUS_SPREAD = 0.15, 0.3
"""The same of a wheel's dry loss, relative, and of its viscous loss in units of `VISCOUS_AT`."""
AXLE_SPREAD = 0.1
"""Standard deviation of the friction of a wheel's bearings, relative to the whole dry loss."""
PAYLOAD_SPREAD, INERTIA_SPREAD = 0.12, 0.1
"""Relative standard deviations of mass and yaw inertia by an unknown payload."""
CENTRE_SPREAD = 0.03
"""Standard deviation of the centre of mass along each axis [m]."""
_LOSS, _VISCOUS, _GEAR = 0.15, 1.0, 0.5
_ROLLERS, _LEAST_ROLLERS = 0.3, 0.005  # relative, and [1] or [s/m] where the nominal friction is small
_PLACE, _KNOWN_PLACE = 0.05, 1e-6  # [m] of the accelerometer
_OFFSET, _DELAY, _POSE_DELAY = 0.005, 3e-3, 0.015  # [A], [s], [s]
_PER_YAW_RATE, _PER_YAW_RATE_SLOW = 1e-6, 0.1  # [A.s/rad] of a log of every sample, and of a slower one
_PLACES = ("accelerometer_x", "accelerometer_y")
_DELAYS = ("acceleration_delay", "yaw_rate_delay")
_BOX = math.sqrt(3.0)  # a box of half-width a has the standard deviation a/√3


@dataclass(frozen=True)
class Unknown:
    """One number that is estimated, as a deviation from nominal."""

    name: str
    """`torque_constant`, `torque_constant_2` (deviation of wheel 2), `mass`, …"""
    spread: float
    """Standard deviation of the prior, about 0."""


@dataclass(frozen=True)
class Unknowns:
    """All unknowns of a robot."""

    robot: Robot
    """The nominal robot."""
    nominal: BalanceConstants
    each: tuple[Unknown, ...]
    pose_delay: float | None = None
    """Delay of a measured pose that its rows have been freed of [s]; None with an inertial unit."""

    @property
    def torque_scale(self) -> Array:
        """Torque constants over that of the model file's motor before the estimate, shape (n,)."""
        return apply_effects(self.robot).torque_scale

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names in the order of a vector of deviations."""
        return tuple(one.name for one in self.each)

    @cached_property
    def spread(self) -> Array:
        """Standard deviations of the prior, shape (p,)."""
        return np.array([one.spread for one in self.each])

    def value(self, x: Array, name: str) -> float:
        """Entry of a vector of deviations, shape (p,), by name."""
        return float(x[self.names.index(name)])

    def wheels(self, x: Array, name: str) -> Array:
        """Deviation of each wheel, its own and the common part, shape (n,)."""
        return self.value(x, name) + self._own(x, name)

    def constants(self, x: Array) -> BalanceConstants:
        """Constants of the force balance for a vector of deviations, shape (p,)."""
        c, mass = self.nominal.robot, self.nominal.robot.mass * math.exp(self.value(x, "mass"))
        # wheels and rotors keep their ratio to the torque constants: theirs would be the only mass that is
        # known, and errors of what it accelerates, small as it is, would set the size of everything
        size = math.exp(self.wheels(x, "torque_constant").mean())
        axle = self.nominal.axle + c.dry * self._own(x, "axle_loss")
        robot = c._replace(
            torque=c.torque * np.exp(self.wheels(x, "torque_constant")),
            dry=axle + (c.dry - self.nominal.axle) * np.exp(self.wheels(x, "dry_loss")),
            viscous=c.viscous + c.dry / VISCOUS_AT * self.wheels(x, "viscous_loss"),
            driven=c.driven * math.exp(self.value(x, "back_driving")),
            mass=mass,
            load=mass * GRAVITY / len(c.torque),
            inertia=c.inertia * size,
            yaw_inertia=c.yaw_inertia * math.exp(self.value(x, "yaw_inertia")),
            centre=c.centre + np.array([self.value(x, "centre_x"), self.value(x, "centre_y")]),
            accelerometer=c.accelerometer + np.array([self.value(x, name) for name in _PLACES]),
            roller_dry=c.roller_dry + self.value(x, "roller_dry"),
            roller_viscous=c.roller_viscous + self.value(x, "roller_viscous"),
        )
        return BalanceConstants(robot, axle, self.nominal.rotor * size)

    def of_pose(self, delay: float) -> Unknowns:
        """The unknowns where the body's motion was measured by a camera of some delay [s]."""
        nominal = self.nominal._replace(robot=self.nominal.robot._replace(accelerometer=np.zeros(2)))
        fixed = self._with_spread(_PLACES, _KNOWN_PLACE)
        return replace(fixed._with_spread(_DELAYS, _POSE_DELAY), nominal=nominal, pose_delay=delay)

    def of_slow_logs(self) -> Unknowns:
        """The unknowns where the logs have fewer samples than the controller."""
        return self._with_spread(("current_per_yaw_rate",), _PER_YAW_RATE_SLOW)

    def _with_spread(self, names: tuple[str, ...], spread: float) -> Unknowns:
        each = [replace(one, spread=spread) if one.name in names else one for one in self.each]
        return replace(self, each=tuple(each))

    def _own(self, x: Array, name: str) -> Array:
        """Entries `NAME_1` … of the n wheels."""
        first = self.names.index(f"{name}_1")
        return x[first : first + len(self.nominal.axle)]

    def errors(self, x: Array) -> SensorErrors:
        """Errors of the sensors for a vector of deviations, shape (p,)."""
        return SensorErrors(
            self._own(x, "current_offset"),
            self.value(x, "current_per_yaw_rate"),
            self.value(x, "acceleration_delay"),
            self.value(x, "yaw_rate_delay"),
        )


def unknowns(robot: Robot, mass_is_known: bool = False) -> Unknowns:
    """Unknowns of a robot, with the effects of its model file, and their priors from it.

    Unless the logs state the mass, the robot may carry a payload.
    """
    n, c = len(robot.wheels), robot_constants(robot)
    payload = 0.0 if mass_is_known else PAYLOAD_SPREAD
    each = [
        *_of_wheels(n, "torque_constant", _relative(robot, "motor.torque_constant", 0.01), PART_SPREAD),
        *_of_wheels(n, "dry_loss", max(_relative(robot, "motor.no_load_torque", _LOSS), _LOSS), LOSS_SPREAD),
        *_of_wheels(n, "viscous_loss", _VISCOUS, VISCOUS_SPREAD),
        *(Unknown(f"axle_loss_{i + 1}", AXLE_SPREAD) for i in range(n)),
        Unknown("back_driving", _GEAR),
        Unknown("mass", math.hypot(_relative(robot, "body.mass", 0.01), payload)),
        Unknown("yaw_inertia", math.hypot(_relative(robot, "body.yaw_inertia", 0.05), INERTIA_SPREAD)),
        Unknown("centre_x", CENTRE_SPREAD),
        Unknown("centre_y", CENTRE_SPREAD),
        Unknown("roller_dry", max(_ROLLERS * c.roller_dry, _LEAST_ROLLERS)),
        Unknown("roller_viscous", max(_ROLLERS * c.roller_viscous, _LEAST_ROLLERS)),
        *(Unknown(name, _PLACE) for name in _PLACES),
        *(Unknown(f"current_offset_{i + 1}", _OFFSET) for i in range(n)),
        Unknown("current_per_yaw_rate", _PER_YAW_RATE),
        *(Unknown(name, _DELAY) for name in _DELAYS),
    ]
    return Unknowns(robot, _balance_constants(robot), tuple(each))


def _balance_constants(robot: Robot) -> BalanceConstants:
    c, scale = robot_constants(robot), apply_effects(robot).torque_scale
    shaft = robot.motor.no_load_torque * c.torque / (robot.motor.torque_constant * scale)
    return BalanceConstants(c, c.dry - shaft, robot.motor.reflected_inertia / c.radius)


def _of_wheels(wheels: int, name: str, common: float, own: float) -> list[Unknown]:
    """A common deviation and one of each wheel."""
    return [Unknown(name, common), *(Unknown(f"{name}_{i + 1}", own) for i in range(wheels))]


def _relative(robot: Robot, key: str, otherwise: float) -> float:
    """Standard deviation of a number of the model file over its value, from its `uncertainty`."""
    table, _, name = key.partition(".")
    value = float(getattr(getattr(robot, table), name))
    given = robot.provenance[key].uncertainty if key in robot.provenance else 0.0
    return given / _BOX / value if given > 0.0 and value > 0.0 else otherwise
