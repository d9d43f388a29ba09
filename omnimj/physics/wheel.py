"""One driven omni wheel, the same on the robot and on the rig: its parameters, bearings and rollers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnimj.parameters.parts import Bearing, Motor, Wheel
from omnimj.physics.native import inlined, kernel
from omnimj.physics.traction import exact_step, mean_deflection, rolling_resistance


class WheelParameters(NamedTuple):
    """Parameters of a wheel, in the form used by the kernels."""

    radius: float
    """Rolling radius r [m]."""
    inertia: float
    """Inertia about the axle, rotor included: I + (J_r + J_g) E G_r² [kg.m²]."""
    roller_dry: float
    """μ_R,dry."""
    roller_viscous: float
    """μ_R,vis [s/m]."""
    roller_stiffness: float
    """Micro-slip stiffness of the rollers' bearings over the normal force [1/m]."""
    roller_damping: float
    """Micro-slip damping of the same [s/m]."""
    rolling: float
    """Rolling resistance over the normal force μ_rol."""
    bearing_dry: float
    """μ_bearing,dry."""
    bearing_viscous: float
    """μ_bearing,vis [s/rad]."""
    pitch_radius: float
    """Half the pitch diameter of the bearings [m]."""
    spacing: float
    """Distance a between the bearings [m]."""
    overhang: float
    """Distance b from the outer bearing to the wheel's mid-plane [m]."""


WHEEL_SIZE = len(WheelParameters._fields)
"""Numbers of a packed wheel."""


def wheel_parameters(
    wheel: Wheel, bearing: Bearing, motor: Motor, radius_scale: float = 1.0
) -> WheelParameters:
    """Parameters of a wheel with its bearings and its motor's inertia.

    Args:
      wheel: Its constants.
      bearing: Its bearings.
      motor: Its motor, for the reflected rotor inertia.
      radius_scale: True over nominal rolling radius.
    """
    return WheelParameters(
        wheel.radius * radius_scale,
        wheel.inertia + motor.reflected_inertia,
        wheel.roller_dry,
        wheel.roller_viscous,
        wheel.roller_bristle_stiffness,
        wheel.roller_bristle_damping,
        wheel.rolling_resistance,
        bearing.dry,
        bearing.viscous,
        0.5 * bearing.pitch_diameter,
        bearing.spacing,
        bearing.overhang,
    )


@kernel
def passive_roller_damping(damping, dry, sideways):
    """Micro-slip damping of rollers on a floor with rolling resistance, at most d/|u| [s/m].

    Their dry coefficient d changes with the direction of rolling. A bristle that springs back as d falls then
    resists still: |z| k (1 − σ1 |u|/d) + σ1 |u| ≥ 0.

    Args:
      damping: σ1 [s/m].
      dry: d of rollers and floor [1].
      sideways: Velocity u that turns the roller [m/s].
    """
    return min(damping, dry / abs(sideways)) if sideways != 0.0 else damping


@inlined
def wheel_on_floor(wheel, floor, rim, along, sideways):
    """The wheel with the rolling resistance of the floor under it: see `traction.rolling_resistance`.

    Args:
      wheel: `WheelParameters`.
      floor: `TractionParameters`.
      rim: r φ̇ [m/s].
      along: Velocity V of the wheel along its drive [m/s].
      sideways: Velocity u that turns the roller [m/s].
    """
    on_wheel, on_rollers = rolling_resistance(floor, max(abs(rim), abs(along)), sideways)
    dry, damping = wheel.roller_dry + on_rollers, wheel.roller_damping
    if on_rollers > 0.0:
        damping = passive_roller_damping(damping, dry, sideways)
    return WheelParameters(
        wheel.radius,
        wheel.inertia,
        dry,
        wheel.roller_viscous,
        wheel.roller_stiffness,
        damping,
        wheel.rolling + on_wheel,
        *wheel[7:],
    )


@kernel
def roller_friction(wheel, z, lateral_speed, normal_force, h):
    """Friction F_f of the rollers' bearings over a step, Eqs. 3.32-3.35.

    A bristle with g = μ_R,dry replaces sign(v): it holds at rest without creeping or chattering and gives
    F_N [μ_R,dry sign(v) + μ_R,vis v] once v has passed μ_R,dry over its stiffness.

    Args:
      wheel: `WheelParameters`.
      z: Micro-slip deflection of the bearings [m].
      lateral_speed: Speed at which the rollers turn, v [m/s].
      normal_force: F_N [N].
      h: Step [s].

    Returns:
      Next deflection [m] and mean friction F_f [N].
    """
    # on a soft floor d = μ_R,dry changes, and the bristle stays passive: F v − d/dt(k z²/2) = k² z² |v|/d ≥ 0
    viscous = wheel.roller_viscous * lateral_speed
    if wheel.roller_dry <= 0.0:
        return 0.0, normal_force * viscous
    rate = wheel.roller_stiffness * abs(lateral_speed) / wheel.roller_dry
    z_next = exact_step(z, lateral_speed, rate, h)
    mean = mean_deflection(z, z_next, lateral_speed, rate, h)
    ratio = wheel.roller_stiffness * mean + wheel.roller_damping * (z_next - z) / h
    return z_next, normal_force * (ratio + viscous)


@kernel
def bearing_friction(wheel, normal_force, lateral_force):
    """Dry torque and viscous coefficient of the wheel's bearings, Eqs. 4.37-4.38 [N.m, N.m.s/rad].

    F_A = (F_N (a + b) − G r)/a, F_B = (F_N b − G r)/a; G > 0 is the rollers' friction on a wheel that moves
    away from its bearings (outward on the robot, along +z × u).

    Args:
      wheel: `WheelParameters`.
      normal_force: F_N [N].
      lateral_force: G [N].
    """
    a, b = wheel.spacing, wheel.overhang
    tilting = lateral_force * wheel.radius
    load = abs((normal_force * (a + b) - tilting) / a) + abs((normal_force * b - tilting) / a)
    return wheel.bearing_dry * load * wheel.pitch_radius, wheel.bearing_viscous * load * wheel.pitch_radius


def packed(parameters: tuple) -> np.ndarray:
    """Numbers of a NamedTuple, nested by one level at most, in one row for kernels; shape (numbers,)."""
    flat: list[float] = []
    for part in parameters:
        flat += part if isinstance(part, tuple) else (part,)
    return np.array(flat, dtype=np.float64)


@kernel
def store(values, row):
    """Write the numbers of a NamedTuple into the first places of a row."""
    for k in range(len(values)):
        row[k] = values[k]
