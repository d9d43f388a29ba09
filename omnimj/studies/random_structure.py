"""Random structure of a robot: physics that the controller's model leaves out or simplifies.

`random_truth` changes the values of constants within the model. Here the robot itself differs: the direction
of the gear's losses, a radius per wheel, ripple and cogging, the place of the payload, load transfer and
sensor chains.

Two things are not drawn, since no robot plant has them: friction of bearings with a peak near standstill
(Stribeck; that of the floor is drawn with the floor, the stiction of the rollers here), and irregular sample
times. On the planar plant, which is rigid, height of the centre of mass and damping of the suspension change
nothing on level floor.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.effects import with_further_effects
from omnimj.parameters import Robot

NOMINAL, DRAWN = "nominal", "drawn"
STRUCTURES = (NOMINAL, DRAWN)
"""Structure of the true robot: that of the controller's model, or drawn for each case."""

FACTORS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "motor.gear_efficiency": (0.9, 1.1),
        "motor.viscous": (0.0, 3.0),
        "wheel.roller_bristle_stiffness": (0.5, 2.0),
        "body.com_height": (0.7, 1.3),
        "body.suspension_stiffness": (0.7, 1.3),
        "body.suspension_damping": (0.7, 1.3),
        "sensors.accelerometer_bandwidth": (0.5, 2.0),
        "sensors.gyro_bandwidth": (0.5, 2.0),
        "sensors.speed_filter": (0.5, 2.0),
    }
)
"""Smallest and largest factor on nominal constants."""
LEAST_BACK_DRIVING = 0.4
"""Smallest efficiency of a gear that the wheel drives; the largest is 1/E, a gear that gains what it lost."""
RADIUS = 0.003
"""Half-width of the error of each wheel's radius, relative to the nominal one."""
RIPPLE = 2.0
"""Largest amplitude of the force of passing rollers [N]."""
COGGING = 0.002
"""Largest amplitude of the motors' cogging torque, at the motor shaft [N.m]."""
POLES = (2, 5, 7, 14)
"""Periods of cogging per turn of the motor."""
PLACE = 0.02
"""Largest distance of the payload from the centre [m]."""
DELAYS: Mapping[str, tuple[float, tuple[str, ...]]] = MappingProxyType(
    {
        "wheel_speed": (0.002, tuple(f"wheel_speed_{i}" for i in range(1, 5))),
        "acceleration": (0.003, ("acceleration_x", "acceleration_y")),
        "yaw_rate": (0.003, ("yaw_rate",)),
        "yaw": (0.005, ("yaw",)),
    }
)
"""Largest delay [s] of the channels of each kind of sensor, which are equally late."""


@dataclass(frozen=True)
class RandomStructure:
    """Structure of a true robot with n wheels."""

    factors: Mapping[str, float]
    """`table.key` of the robot's constants → factor on the nominal value; keys of `FACTORS`."""
    back_driving_efficiency: float
    """E_b: wheel torque G_r T/E_b while the wheel drives the motor."""
    radii: tuple[float, ...]
    """True over nominal radius of each wheel, n of them."""
    ripple: float
    """Amplitude of the force of passing rollers; its sign is its phase, 0 or π [N]."""
    cogging: float
    """Amplitude of the motors' cogging torque, likewise [N.m]."""
    cogging_poles: int
    """Periods of cogging per turn of the motor."""
    payload_place: tuple[float, float]
    """Place of the payload in the body frame [m]."""
    delays: Mapping[str, float]
    """Kind of sensor, a key of `DELAYS` → delay [s]."""


def draw_structure(random: np.random.Generator, nominal: Robot) -> RandomStructure:
    """Draw a structure, all parts of it independently.

    The place of the payload is uniform in a disc; factors whose bounds are above 0 are uniform in their
    logarithm; all else is uniform within its bounds.

    Args:
      random: Generator that draws nothing else, so that other draws do not depend on the structure.
      nominal: The controller's robot, four wheels.
    """
    factors = {name: _factor(random, *bounds) for name, bounds in FACTORS.items()}
    efficiency = nominal.motor.gear_efficiency * factors["motor.gear_efficiency"]
    back_driving = float(random.uniform(LEAST_BACK_DRIVING, 1.0 / efficiency))
    radii = tuple(1.0 + RADIUS * float(random.uniform(-1.0, 1.0)) for _ in nominal.wheels)
    ripple, cogging = (most * float(random.uniform(-1.0, 1.0)) for most in (RIPPLE, COGGING))
    poles = int(random.choice(POLES))
    away, angle = PLACE * math.sqrt(random.random()), 2.0 * math.pi * random.random()
    place = (away * math.cos(angle), away * math.sin(angle))
    delays = {kind: float(random.uniform(0.0, most)) for kind, (most, _) in DELAYS.items()}
    return RandomStructure(factors, back_driving, radii, ripple, cogging, poles, place, delays)


def _factor(random: np.random.Generator, low: float, high: float) -> float:
    lot = float(random.random())
    return low + (high - low) * lot if low == 0.0 else low * (high / low) ** lot


def with_structure(robot: Robot, structure: RandomStructure, payload: float) -> Robot:
    """Return a robot with another structure.

    Args:
      robot: Robot whose mass includes the payload at its centre, from `random_truth.true_robot`.
      structure: The structure.
      payload: Mass of the payload, which is moved to its place; negative: parts removed there [kg].

    Raises:
      InputError: The robot has one of the effects of a structure already, and it can act only once.
    """
    changed: dict[str, dict[str, float]] = {"motor": {}, "body": {}}
    for name, factor in structure.factors.items():
        table, _, key = name.partition(".")
        changed.setdefault(table, {})[key] = factor * getattr(getattr(robot, table), key)
    changed["motor"]["back_driving_efficiency"] = structure.back_driving_efficiency
    changed["body"]["mass"] = robot.body.mass - payload
    tables = {table: dataclasses.replace(getattr(robot, table), **keys) for table, keys in changed.items()}
    return with_further_effects(dataclasses.replace(robot, **tables), _effects(structure, payload))


def _effects(structure: RandomStructure, payload: float) -> list[tuple[str, dict[str, Any]]]:
    """Return the effects of a structure, one for each wheel or channel that is changed."""
    x, y = structure.payload_place
    cogging = {"amplitude": structure.cogging, "poles": structure.cogging_poles}
    radii = [{"wheel": wheel, "scale": scale} for wheel, scale in enumerate(structure.radii, start=1)]
    late = [
        {"channel": channel, "delay": delay}
        for kind, delay in structure.delays.items()
        for channel in DELAYS[kind][1]
    ]
    return [
        ("roller_ripple", {"amplitude": structure.ripple}),
        ("motor_cogging", cogging),
        ("payload", {"mass": payload, "x": x, "y": y}),
        *(("wheel_radius", values) for values in radii),
        *(("sensor_delay", values) for values in late),
    ]


def structure_sentence(structure: str) -> str:
    """Return a sentence on the structure of the true robots, one of `STRUCTURES`."""
    if structure == NOMINAL:
        return "Structure nominal: the true robot has the physics of the controller's model."
    return (
        f"Structure drawn: gear efficiency ±10 %, driven backwards {LEAST_BACK_DRIVING:g} to 1/E, viscous "
        f"motor loss 0 to 3 times, radius of each wheel ±{100 * RADIUS:g} %, roller ripple to {RIPPLE:g} N, "
        f"cogging to {1e3 * COGGING:g} mN.m, payload {100 * PLACE:g} cm off-centre at most, stiction of the "
        "rollers, sensor bandwidths and speed filter half to twice, delays of sensors to 2, 3 or 5 ms, "
        "height of the centre of mass and suspension ±30 % (which act on the twin). Not drawn: friction of "
        "bearings near standstill, irregular sample times."
    )
