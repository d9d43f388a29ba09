"""Writes the numbers of a wheel into the bodies that `uto_wheel.xml` attached."""

from __future__ import annotations

import math

import mujoco

from omnimj.errors import InputError
from omnimj.parameters import Motor, Wheel
from omnimj.twin.spec_parts import part

_FILE_ROW_OFFSET = 0.011  # [m] `uto_wheel.xml` shifts its second row by twice this
_FILE_HALF_LENGTH = math.sqrt(0.050 * 0.009)  # [m] the roller mesh is made for these
_FILE_ROLLER_RADIUS = 0.009  # [m]
_STRAIGHT = 0.5 * math.pi  # rollers of an omni wheel lie across its axle
_CUT = 0.0125 / _FILE_HALF_LENGTH  # a barrel's half length over the ellipsoid's


def roller_half_length(wheel: Wheel, angle: float = _STRAIGHT) -> float:
    """√(R b)/sin γ: with it the rollers' outline has the curvature of the wheel along their axes [m].

    Along a direction that is turned by γ from the axle a cylinder of radius R has the curvature sin²γ/R.
    """
    return math.sqrt(wheel.radius * wheel.roller_radius) / math.sin(angle)


def roller_inertia(wheel: Wheel, angle: float) -> tuple[float, float]:
    """Spin ½ m b² and transverse m(3b² + L²)/12 of a roller of length L [kg.m2]."""
    length = 2.0 * _CUT * roller_half_length(wheel, angle)
    m, b = wheel.roller_mass, wheel.roller_radius
    return 0.5 * m * b**2, m * (3.0 * b**2 + length**2) / 12.0


def _about_axle(wheel: Wheel, angle: float) -> float:
    """Of one roller about an axis through its centre and along the axle [kg.m2]."""
    spin, across = roller_inertia(wheel, angle)
    return across + (spin - across) * math.cos(angle) ** 2


def hub_inertia(wheel: Wheel, angle: float = _STRAIGHT) -> float:
    """Wheel inertia about the axle less that of its rollers [kg.m2].

    Raises:
      InputError: The rollers alone have more.
    """
    count = wheel.rows * wheel.rollers_per_row
    ring = wheel.roller_mass * (wheel.radius - wheel.roller_radius) ** 2
    left = wheel.inertia - count * (ring + _about_axle(wheel, angle))
    if left <= 0.0 or wheel.mass <= count * wheel.roller_mass:
        raise InputError(
            "model file: wheel.inertia",
            f"found {wheel.inertia:g} kg.m2 and {wheel.mass:g} kg",
            "the rollers alone have more",
        )
    return left


def vertical_inertia(wheel: Wheel, angle: float = _STRAIGHT) -> float:
    """Of one wheel about the vertical through its centre, the mean over its turns [kg.m2]."""
    count = wheel.rows * wheel.rollers_per_row
    spin, across = roller_inertia(wheel, angle)
    ring = wheel.roller_mass * (0.5 * (wheel.radius - wheel.roller_radius) ** 2 + wheel.row_offset**2)
    return 0.71 * hub_inertia(wheel, angle) + count * (
        ring + 0.5 * (spin + 2.0 * across - _about_axle(wheel, angle))
    )


def write_wheel(
    spec: mujoco.MjSpec, prefix: str, wheel: Wheel, motor: Motor, angle: float = _STRAIGHT
) -> None:
    """Mass, inertia, rollers and reflected rotor inertia of one attached wheel.

    Args:
      spec: The model.
      prefix: Of the wheel's names.
      wheel: Its numbers.
      motor: Its motor's.
      angle: γ of its rollers [rad].

    Raises:
      InputError: Other rows or rollers than the file has, or a wheel lighter than its rollers.
    """
    rollers = [b for b in spec.bodies if b.name.startswith(f"{prefix}roller_")]
    if (wheel.rows, wheel.rows * wheel.rollers_per_row) != (2, len(rollers)):
        raise InputError(
            "model file: wheel.rollers_per_row",
            f"found {wheel.rows} rows of {wheel.rollers_per_row}",
            f"uto_wheel.xml has 2 rows of {len(rollers) // 2}; change it there, too",
        )
    hub = part(spec, "body", f"{prefix}wheel")
    about_axle = hub_inertia(wheel, angle)
    hub.mass = wheel.mass - len(rollers) * wheel.roller_mass
    hub.inertia = [0.71 * about_axle, about_axle, 0.71 * about_axle]
    part(spec, "joint", f"{prefix}axle").armature = motor.reflected_inertia
    spin, across = roller_inertia(wheel, angle)
    turn = 0.5 * (_STRAIGHT - angle)  # half of it, about the line from the axle to the roller
    for body in rollers:
        second_row = body.name.endswith("_row_1")
        y = 2.0 * _FILE_ROW_OFFSET - wheel.row_offset if second_row else wheel.row_offset
        body.pos = [0.0, y, -(wheel.radius - wheel.roller_radius)]
        body.quat = [math.cos(turn), 0.0, 0.0, math.sin(turn)]
        body.mass = wheel.roller_mass
        body.inertia = [spin, across, across]
        part(spec, "geom", body.name).size = [
            roller_half_length(wheel, angle),
            wheel.roller_radius,
            wheel.roller_radius,
        ]
    thick = wheel.roller_radius / _FILE_ROLLER_RADIUS
    part(spec, "mesh", f"{prefix}roller").scale = [
        roller_half_length(wheel, angle) / _FILE_HALF_LENGTH,
        thick,
        thick,
    ]
