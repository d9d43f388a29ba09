"""Constants of a robot with n wheels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from omnimj.display import Displayed
from omnimj.errors import InputError
from omnimj.parameters.hardware import Hardware, read_hardware
from omnimj.parameters.model_file import EffectValues, model_path, read_effects, read_model_file
from omnimj.parameters.parts import Bearing, Contact, Motor, Sensors, Wheel
from omnimj.parameters.reading import Provenance, positive, quantity, read_table


@dataclass(frozen=True)
class RobotBody:
    """Masses and suspension of the robot."""

    mass: float = positive("kg")
    """Total mass."""
    yaw_inertia: float = positive("kg.m2")
    """Total inertia about the vertical through the centre."""
    com_height: float = positive("m")
    """Height of the centre of mass of the whole robot above the floor."""
    suspension_stiffness: float = positive("N/m")
    """Stiffness of the suspension of each wheel."""
    suspension_damping: float = quantity("N.s/m", 0.0)
    """Damping of the suspension of each wheel."""
    suspension_travel: float = positive("m")
    """Travel of the suspension between the stops."""
    unsprung_mass: float = positive("kg")
    """Unsprung mass of each corner (wheel, motor, carriage), part of the total mass."""
    accelerometer_x: float = quantity("m", -2.0, 2.0, default=0.0)
    """Position of the accelerometer ahead of the centre, in the body frame."""
    accelerometer_y: float = quantity("m", -2.0, 2.0, default=0.0)
    """The same to the left."""


@dataclass(frozen=True)
class WheelMount:
    """Position and driving direction of one wheel in the body frame."""

    position: tuple[float, ...] = quantity("m", -10.0, 10.0)
    """Position x, y of the wheel centre."""
    drives_along: tuple[float, ...] = quantity("1", -1.0, 1.0)
    """Unit vector u along which a positive wheel speed drives the robot."""
    roller_angle: float = quantity("rad", math.pi / 9.0, 8.0 * math.pi / 9.0, default=math.pi / 2.0)
    """Angle γ from the axle z × u to the axis of the roller on the floor, towards u: π/2 for an omni wheel,
    π/4 or 3π/4 for a mecanum wheel. Traction acts along that axis; the roller turns freely across it."""

    @property
    def roller_axis(self) -> tuple[float, float]:
        """Roller axis a = sin γ u + cos γ (z × u), a unit vector in the body frame."""
        u, (s, c) = self.drives_along, roller_sin_cos(self.roller_angle)
        return s * u[0] - c * u[1], s * u[1] + c * u[0]


def roller_sin_cos(angle: float) -> tuple[float, float]:
    """Sine and cosine of γ, exactly 1 and 0 for an omni wheel."""
    return math.sin(angle), math.sin(math.pi / 2.0 - angle)


@dataclass(frozen=True)
class Control:
    """Gains and limits of the cascade."""

    speed_proportional: float = quantity("A.s/rad", 0.0)
    """Proportional gain of the wheel-speed loop."""
    speed_integral: float = quantity("A/rad", 0.0)
    """Integral gain of the wheel-speed loop."""
    yaw_rate_proportional: float = quantity("1", 0.0)
    """Proportional gain of the yaw-rate loop, added to the yaw-rate demand."""
    heading_proportional: float = quantity("1/s", 0.0)
    """Proportional gain of the heading hold, if the scenario uses it."""
    current_limit: float = positive("A")
    """Final limit: largest current command."""
    current_rate_limit: float = positive("A/s")
    """Final limit: largest rate of change of the current command."""
    wheel_speed_limit: float = positive("rad/s")
    """Final limit: above this wheel speed no current may accelerate the wheel further."""
    yaw_rate_lag: float = quantity("1", 1.0, default=1.0)
    """Gain of the yaw-rate loop for slow errors over that for fast ones; 1: the same for all."""
    yaw_rate_corner: float = positive("Hz", default=4.0)
    """Frequency above which errors of the yaw rate are fast."""


@dataclass(frozen=True)
class Robot(Displayed):
    """All constants of a robot with n wheels."""

    plant: ClassVar[str] = "uto_robot"
    """Kind of machine, as named in model files."""

    wheel: Wheel
    bearing: Bearing
    motor: Motor
    contact: Contact
    sensors: Sensors
    body: RobotBody
    wheels: tuple[WheelMount, ...]
    control: Control
    provenance: Mapping[str, Provenance]
    """Unit and source of each number, under keys such as `motor.torque_constant`."""
    file: Path
    """Model file from which these constants were read."""
    effects: EffectValues = field(default_factory=dict)
    """Effects added to the model, with names and parameters as in `omnimj.effects`."""
    hardware: Hardware | None = None
    """Wiring; None if the model file has none."""

    @property
    def wheel_count(self) -> int:
        """Number of wheels n."""
        return len(self.wheels)

    @property
    def roller_angles(self) -> tuple[float, ...]:
        """Roller angle γ of each wheel, length n [rad]."""
        return tuple(mount.roller_angle for mount in self.wheels)

    @property
    def accelerometer(self) -> np.ndarray:
        """Position of the accelerometer in the body frame, shape (2,) [m]."""
        return np.array([self.body.accelerometer_x, self.body.accelerometer_y])

    @property
    def wheel_positions(self) -> np.ndarray:
        """Wheel centres in the body frame, shape (n, 2) [m]."""
        return np.array([w.position for w in self.wheels])

    @property
    def drive_directions(self) -> np.ndarray:
        """Unit vectors u_i of the driving directions, shape (n, 2)."""
        return np.array([w.drives_along for w in self.wheels])

    @property
    def rolling_directions(self) -> np.ndarray:
        """Directions d_i = a_i/(a_i·u_i) of rolling, r φ̇_i = d_i·v, and of traction, shape (n, 2)."""
        return np.array([np.array(w.roller_axis) / math.sin(w.roller_angle) for w in self.wheels])

    @property
    def side_directions(self) -> np.ndarray:
        """Directions z × u_i / sin γ_i along which a rolling wheel turns its rollers, shape (n, 2)."""
        u, angles = self.drive_directions, np.array([w.roller_angle for w in self.wheels])
        return np.column_stack((-u[:, 1], u[:, 0])) / np.sin(angles)[:, None]


def _read_mounts(entries: Any, path: Path, provenance: dict[str, Provenance]) -> tuple[WheelMount, ...]:
    if not isinstance(entries, list) or len(entries) < 3:
        raise InputError(f"{path}: [[wheels]]", "at least three wheels are needed")
    mounts = []
    for i, entry in enumerate(entries, start=1):
        mount = read_table(WheelMount, entry, lambda _: path, provenance, f"wheels.{i}")
        if len(mount.position) != 2 or len(mount.drives_along) != 2:
            raise InputError(f"{path}: wheels.{i}", "position and drives_along need two numbers each")
        if not math.isclose(math.hypot(*mount.drives_along), 1.0, abs_tol=1e-9):
            raise InputError(
                f"{path}: wheels.{i}.drives_along", f"found {list(mount.drives_along)}", "must have length 1"
            )
        mounts.append(mount)
    return tuple(mounts)


def read_robot(path: Path | str | None = None) -> Robot:
    """Read `robot.toml`, or a copy of it with changed values.

    Args:
      path: Model file, or the name of a shipped one; the robot of the source when None.

    Raises:
      InputError: A value is missing or breaks its rule; the message names file, key, value and rule.
    """
    path = model_path(path, "uto_robot/robot.toml")
    file = read_model_file(path, Robot.plant, ("body", "wheels", "control", "effects", "hardware"))
    provenance: dict[str, Provenance] = {}
    mounts = _read_mounts(file.own.get("wheels"), path, provenance)
    robot = Robot(
        **file.shared_parts(provenance),
        body=file.table(RobotBody, "body", provenance),
        wheels=mounts,
        control=file.table(Control, "control", provenance),
        provenance=MappingProxyType(provenance),
        file=path,
        effects=read_effects(file.own, path, provenance),
        hardware=read_hardware(file.own, path, len(mounts)),
    )
    _require_consistent(robot)
    return robot


def _require_consistent(robot: Robot) -> None:
    """Check rules that involve several numbers."""
    body, wheel, corners = robot.body, robot.wheel, robot.body.unsprung_mass * len(robot.wheels)
    if corners >= body.mass:
        raise InputError(
            f"{robot.file}: body.unsprung_mass",
            f"found {body.unsprung_mass:g}",
            f"{len(robot.wheels)} corners must weigh less than the robot, body.mass = {body.mass:g}",
        )
    if wheel.mass >= body.unsprung_mass:
        raise InputError(
            f"{robot.file}: wheel.mass",
            f"found {wheel.mass:g}",
            f"must be below body.unsprung_mass, {body.unsprung_mass:g}",
        )
    x, y = robot.wheel_positions.T
    u_x, u_y = robot.rolling_directions.T
    if np.linalg.matrix_rank(np.column_stack([u_x, u_y, x * u_y - y * u_x]), tol=1e-6) < 3:
        raise InputError(
            f"{robot.file}: [[wheels]]", "these wheels cannot drive the robot along x, along y and in yaw"
        )
