"""The robot as it really is: its constants off those that the controller believes in, and its payload."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from omnimj.effects import with_effects
from omnimj.parameters import Floor, Robot

PAYLOAD = 0.20
"""Half-width of the payload, as a share of the robot's mass; negative: parts were taken off."""
BOUNDS: Mapping[str, float] = MappingProxyType(
    {"torque_constant": 0.03, "friction": 0.20, "mass": 0.03, "inertia": 0.05, "floor": 0.20}
)
"""Half-widths of the errors, relative to the nominal value."""
_FRICTION = ("motor.no_load_torque", "bearing.dry", "wheel.roller_dry", "wheel.roller_viscous")
_INERTIA = ("body.yaw_inertia", "wheel.inertia", "motor.rotor_inertia")
_FLOOR = ("mu", "V_s", "sigma_0", "sigma_1", "sigma_2", "mu_cap")  # mu: both μ_c and μ_s


@dataclass(frozen=True)
class Errors:
    """Factors on nominal values."""

    constants: Mapping[str, float]
    """`table.key` of the robot's constants → factor; without the payload."""
    torque_constants: tuple[float, ...]
    """Factor per motor."""
    floor: Mapping[str, float]
    """Letter of the floor's numbers → factor; `mu` is of μ_c and μ_s."""
    payload: float
    """Carried at the centre, as a share of the nominal mass; it may be negative."""


def draw_errors(random: np.random.Generator, wheels: int) -> Errors:
    """Every factor on its own, evenly inside its bounds."""

    def factor(kind: str) -> float:
        return 1.0 + BOUNDS[kind] * float(random.uniform(-1.0, 1.0))

    constants = {name: factor("friction") for name in _FRICTION}
    constants |= {name: factor("inertia") for name in _INERTIA}
    constants["body.mass"] = factor("mass")
    motors = tuple(factor("torque_constant") for _ in range(wheels))
    floor = {letter: factor("floor") for letter in _FLOOR}
    return Errors(constants, motors, floor, PAYLOAD * float(random.uniform(-1.0, 1.0)))


def true_robot(nominal: Robot, errors: Errors) -> Robot:
    """The nominal robot with the errors in it; the payload adds no yaw inertia, it sits at the centre."""
    changed: dict[str, dict[str, float]] = {}
    for name, factor in errors.constants.items():
        table, _, key = name.partition(".")
        changed.setdefault(table, {})[key] = factor * getattr(getattr(nominal, table), key)
    changed["body"]["mass"] += errors.payload * nominal.body.mass
    tables = {
        table: dataclasses.replace(getattr(nominal, table), **values) for table, values in changed.items()
    }
    robot = dataclasses.replace(nominal, **tables)
    motors = {
        "torque_constant" if wheel == 1 else f"torque_constant_{wheel}": {"wheel": wheel, "scale": scale}
        for wheel, scale in enumerate(errors.torque_constants, start=1)
    }
    return with_effects(robot, motors)


def true_floor(nominal: Floor, errors: Errors) -> Floor:
    """The nominal floor with the errors in it; μ_c and μ_s keep their ratio."""
    numbers = {
        letter: value * errors.floor.get("mu" if letter in ("mu_c", "mu_s") else letter, 1.0)
        for letter, value in nominal.numbers.items()
    }
    return dataclasses.replace(nominal, numbers=MappingProxyType(numbers))
