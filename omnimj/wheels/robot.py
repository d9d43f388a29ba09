"""Record of a drivable body on omni or mecanum wheels: layouts, kinematics, checks."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from omnimj.errors import InputError, UnknownNameError
from omnimj.signals import Array
from omnimj.wheels.ring import OMNI
from omnimj.wheels.wheel import RollerWheel, mecanum_wheel, omni_wheel

ACTUATORS = ("velocity", "motor")
"""Kinds of actuator: a speed controller per wheel [rad/s], or a torque [N.m]."""
_ROTOR_SHARE = 0.05  # inertia of rotor and gear at the axle, over that of the mass a wheel moves
_GAIN = 0.5  # velocity gain × step / inertia of a wheel in the air; explicit steps are stable below 2
_PLATE = 0.6  # half height of the body over the wheel's radius


@dataclass(frozen=True)
class Mount:
    """Place of a wheel on the body."""

    position: tuple[float, float]
    """Centre of the wheel, x ahead, y to the left [m]."""
    yaw: float
    """Direction in which the wheel drives at a positive speed, against x [rad]."""
    is_mirrored: bool = False
    """True if its rollers slant the other way."""


@dataclass(frozen=True)
class WheeledRobot:
    """Robot of a free body, wheels of one kind and an actuator each.

    Raises:
      InputError, UnknownNameError: A number is out of range, wheels overlap, or a name is unknown.
    """

    layout: str = "omni4"
    """Name in `LAYOUTS`."""
    wheel: RollerWheel = field(default_factory=omni_wheel)
    mass: float = 15.0
    """Mass with wheels [kg]."""
    arm: float = 0.25
    """Distance of omni wheels from the centre [m]."""
    wheelbase: float = 0.4
    """Distance from front to rear axles of mecanum wheels [m]."""
    track: float = 0.4
    """Distance from left to right mecanum wheels [m]."""
    top_speed: float = 2.0
    """Largest commanded speed of a wheel at its rim [m/s]."""
    actuators: str = "velocity"
    """One of `ACTUATORS`."""

    def __post_init__(self) -> None:
        if self.layout not in LAYOUTS:
            raise UnknownNameError("robot", "layout", self.layout, LAYOUTS)
        if self.actuators not in ACTUATORS:
            raise UnknownNameError("robot", "actuator", self.actuators, ACTUATORS)
        slanted = self.layout == "mecanum4"
        if slanted == (self.wheel.roller_angle == OMNI):
            kind, needed = ("omni", "mecanum") if slanted else ("mecanum", "omni")
            raise InputError("robot: wheel", f"is of the kind {kind}", f"{self.layout} needs {needed} wheels")
        for name, high in (("mass", 1e5), ("arm", 10.0), ("wheelbase", 20.0), ("track", 20.0)):
            _require(name, getattr(self, name), 0.0, high)
        _require("top_speed", self.top_speed, 0.0, 100.0)
        _require("mass", self.mass, 1.2 * len(self.mounts) * self.wheel.mass, 1e5)
        if slanted:
            _require("wheelbase", self.wheelbase, 2.02 * self.wheel.radius, 20.0)
            _require("track", self.track, 1.2 * self.wheel.width, 20.0)
        else:
            beside = 1.02 * self.wheel.radius / math.tan(math.pi / len(self.mounts))
            _require("arm", self.arm, beside + 0.5 * self.wheel.width, 10.0)

    @property
    def mounts(self) -> tuple[Mount, ...]:
        """Places of the wheels 1 … n, anticlockwise from the one ahead on the left."""
        return LAYOUTS[self.layout](self)

    def wheel_of(self, mount: Mount) -> RollerWheel:
        """Return the wheel at a mount, mirrored where the mount is."""
        return self.wheel.mirrored() if mount.is_mirrored else self.wheel

    @property
    def kinematics(self) -> Array:
        """Matrix from twist (v_x, v_y, yaw rate) to wheel speeds, shape (n, 3) [rad/m, rad/m, 1].

        Row of a wheel at p with roller axis e and driving direction u: (e_x, e_y, p_x e_y − p_y e_x)/(R e·u).
        """
        rows = []
        for mount in self.mounts:
            angle, (x, y) = self.wheel_of(mount).roller_angle, mount.position
            to_roller = mount.yaw + 0.5 * math.pi - angle
            e_x, e_y = math.cos(to_roller), math.sin(to_roller)
            rows.append(np.array([e_x, e_y, x * e_y - y * e_x]) / (self.wheel.radius * math.sin(angle)))
        return np.array(rows)

    def wheel_speeds(self, twist: Array) -> Array:
        """Return wheel speeds of a body that rolls without slip.

        Args:
          twist: v_x, v_y [m/s] and yaw rate [rad/s], shape (3,).

        Returns:
          Speeds of the wheels 1 … n, shape (n,) [rad/s].
        """
        return self.kinematics @ np.asarray(twist, dtype=float)

    @property
    def half_sides(self) -> tuple[float, float, float]:
        """Half length, half width and half height of the body [m]."""
        height = _PLATE * self.wheel.radius
        if self.layout == "mecanum4":
            return 0.5 * self.wheelbase, 0.5 * (self.track - 1.1 * self.wheel.width), height
        inside = self.arm - 0.55 * self.wheel.width
        return inside, inside, height

    @property
    def body_mass(self) -> float:
        """Mass without wheels [kg]."""
        return self.mass - len(self.mounts) * self.wheel.mass

    @property
    def body_inertia(self) -> tuple[float, float, float]:
        """Moments of inertia of the body, a box or disc, about x, y and z [kg.m2]."""
        x, y, z = self.half_sides
        if self.layout == "mecanum4":
            third = self.body_mass / 3.0
            return third * (y * y + z * z), third * (x * x + z * z), third * (x * x + y * y)
        across = self.body_mass * (0.25 * x * x + z * z / 3.0)
        return across, across, 0.5 * self.body_mass * x * x

    @property
    def rotor_inertia(self) -> float:
        """Inertia of rotor and gear at the axle, 0.05 m R²/n [kg.m2]."""
        return _ROTOR_SHARE * self.mass * self.wheel.radius**2 / len(self.mounts)

    def velocity_gain(self, timestep: float) -> float:
        """Return a gain of velocity actuators with which a wheel in the air is stable [N.m.s/rad]."""
        return _GAIN * (self.wheel.inertia + self.rotor_inertia) / timestep

    def torque_limit(self, friction: float) -> float:
        """Return the torque μ m g R/n at which the wheels spin [N.m]."""
        return friction * self.mass * 9.81 * self.wheel.radius / len(self.mounts)


def wheeled_robot(
    layout: str = "omni4",
    wheel: RollerWheel | None = None,
    *,
    mass: float | None = None,
    arm: float | None = None,
    wheelbase: float | None = None,
    track: float | None = None,
    top_speed: float = 2.0,
    actuators: str = "velocity",
) -> WheeledRobot:
    """Return a robot; what is None is in proportion to the wheels.

    Args:
      layout: Name in `LAYOUTS`.
      wheel: Wheel; that of 50 mm radius which the layout needs when None.
      mass: Mass with wheels [kg]; 15 kg · (R/50 mm)² when None, or three times the wheels' if that is more.
      arm: Distance of omni wheels from the centre [m]; 5 R when None.
      wheelbase: Distance from front to rear mecanum wheels [m]; 8 R when None.
      track: Distance from left to right mecanum wheels [m]; 8 R when None.
      top_speed: Largest commanded speed of a wheel at its rim [m/s].
      actuators: One of `ACTUATORS`.

    Raises:
      InputError, UnknownNameError: As in `WheeledRobot`.
    """
    wheel = wheel_of_layout(layout)() if wheel is None else wheel
    usual = max(15.0 * (wheel.radius / 0.05) ** 2, 12.0 * wheel.mass)
    return WheeledRobot(
        layout,
        wheel,
        usual if mass is None else mass,
        5.0 * wheel.radius if arm is None else arm,
        8.0 * wheel.radius if wheelbase is None else wheelbase,
        8.0 * wheel.radius if track is None else track,
        top_speed,
        actuators,
    )


def _require(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high or value == 0.0:
        rule = (
            f"must be at least {low:.4g} and at most {high:g}"
            if low
            else f"must be above 0, at most {high:g}"
        )
        raise InputError(f"robot: {name}", f"found {value:g}", rule)


def _around(robot: WheeledRobot, count: int) -> tuple[Mount, ...]:
    """Omni wheels in equal angles, the first and the last on both sides of x; all drive anticlockwise."""
    mounts = []
    for k in range(count):
        at = (2 * k + 1) * math.pi / count
        place = (robot.arm * math.cos(at), robot.arm * math.sin(at))
        mounts.append(Mount(place, at + 0.5 * math.pi))
    return tuple(mounts)


def _at_corners(robot: WheeledRobot) -> tuple[Mount, ...]:
    """Mecanum wheels ahead left, rear left, rear right, ahead right; all drive ahead.

    Rollers at the floor point across the diagonals, so that the wheels can turn the robot.
    """
    x, y = 0.5 * robot.wheelbase, 0.5 * robot.track
    return (
        Mount((x, y), 0.0, True),
        Mount((-x, y), 0.0),
        Mount((-x, -y), 0.0, True),
        Mount((x, -y), 0.0),
    )


LAYOUTS: Mapping[str, Callable[[WheeledRobot], tuple[Mount, ...]]] = MappingProxyType(
    {
        "omni3": lambda robot: _around(robot, 3),
        "omni4": lambda robot: _around(robot, 4),
        "mecanum4": _at_corners,
    }
)
"""Layouts of wheels by name."""


def wheel_of_layout(layout: str) -> Callable[..., RollerWheel]:
    """Return the function that makes the wheels of a layout.

    Raises:
      UnknownNameError: The layout is unknown.
    """
    if layout not in LAYOUTS:
        raise UnknownNameError("robot", "layout", layout, LAYOUTS)
    return mecanum_wheel if layout == "mecanum4" else omni_wheel
