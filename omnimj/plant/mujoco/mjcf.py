"""MJCF of robot and rig: read, replicated for the wheels of the model file, filled with their constants."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import mujoco

from omnimj.errors import InputError
from omnimj.parameters import Motor, Robot, Wheel
from omnimj.parameters.robot import WheelMount
from omnimj.plant.mujoco import slots

_NOT_READ = "is not a model that MuJoCo reads"


def _one_line(error: ValueError) -> str:
    return " ".join(str(error).split())


def load_spec(path: Path, includes: Mapping[str, bytes] | None = None) -> mujoco.MjSpec:
    """Parse an MJCF file.

    Args:
      path: MJCF file.
      includes: Contents that replace included files, by file name.

    Raises:
      InputError: MuJoCo cannot read the file; the message is that of MuJoCo.
    """
    try:
        return mujoco.MjSpec.from_file(
            str(path.resolve()), include=includes
        )  # includes relative to a relative path are not found
    except ValueError as error:
        raise InputError(path, _NOT_READ, _one_line(error)) from None


def compile_spec(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """Compile a parsed model.

    Raises:
      InputError: MuJoCo cannot compile the model; the message is that of MuJoCo.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise InputError(path, _NOT_READ, _one_line(error)) from None


def part(spec: mujoco.MjSpec, kind: str, name: str) -> Any:
    """Find a body, joint, geom, site, mesh or actuator by name.

    Raises:
      InputError: The MJCF has no such part.
    """
    found = getattr(spec, kind)(name)
    if found is None:
        raise InputError(f"MJCF model '{spec.modelname}'", f"has no {kind} '{name}'")
    return found


ROBOT_FILE = "uto_robot.xml"
_ARM = 0.25  # [m] from the centre to the wheels of the file and the frames beside them
_OF_A_WHEEL = re.compile(r"(corner|guide|motor)_1\b|wheel_1(?=_)")


def robot_mjcf(robot: Robot, path: Path) -> bytes:
    """MJCF of a robot with the wheels of its model file, in place of `uto_robot.xml`.

    Corners and motors are copies of those of wheel 1; positions and masses are written into
    the parsed model later.

    Args:
      robot: Constants of the robot.
      path: `uto_robot.xml`; a file that is not XML is returned unchanged, for MuJoCo to report.

    Raises:
      InputError: The file lacks a part that is to be copied.
    """
    content, count = path.read_bytes(), len(robot.wheels)
    try:
        root = ET.fromstring(content)
    except ET.ParseError:
        return content
    chassis = _found(root, ".//body[@name='chassis']")
    _replicate(chassis, "corner_1", r"corner_\d+", count)
    _replicate(_found(root, "actuator"), "motor_1", r"motor_\d+", count)
    _set_frames(chassis, robot.wheels)
    for asset in root.iterfind(".//model[@file]"):
        asset.set("file", str((path.parent / Path(asset.get("file", ""))).resolve()))
    return ET.tostring(root)


def _found(root: ET.Element, path: str) -> ET.Element:
    element = root.find(path)
    if element is None:
        raise InputError(ROBOT_FILE, f"has no {path}", "its first corner is copied for every wheel")
    return element


def _replicate(parent: ET.Element, first: str, kind: str, count: int) -> None:
    """Replace all children of a kind by copies of the first, numbered 1 … count, after the others."""
    text = ET.tostring(_found(parent, f"*[@name='{first}']"), encoding="unicode")
    for child in [c for c in parent if re.fullmatch(kind, c.get("name", ""))]:
        parent.remove(child)
    for i in range(1, count + 1):
        parent.append(ET.fromstring(_OF_A_WHEEL.sub(lambda m, i=i: m[0][:-1] + str(i), text)))


def _set_frames(chassis: ET.Element, mounts: Iterable[WheelMount]) -> None:
    """Copy the visual parts that the chassis carries beside a wheel to every wheel."""
    around = _found(chassis, "replicate")
    at = list(chassis).index(around)
    chassis.remove(around)
    for k, mount in enumerate(mounts):
        (x, y), (u_x, u_y) = mount.position, mount.drives_along
        frame = ET.Element("frame")
        frame.set("pos", f"{x - _ARM * -u_y:.9g} {y - _ARM * u_x:.9g} 0")
        frame.set("euler", f"0 0 {math.degrees(math.atan2(u_x, -u_y)):.9g}")
        frame.extend(list(around))
        chassis.insert(at + k, frame)


_FILE_ROW_OFFSET = 0.011  # [m] `uto_wheel.xml` shifts its second row by twice this
_FILE_HALF_LENGTH = math.sqrt(0.050 * 0.009)  # [m] radii for which the roller mesh is made
_FILE_ROLLER_RADIUS = 0.009  # [m]
_STRAIGHT = 0.5 * math.pi  # rollers of an omni wheel lie across its axle
_CUT = 0.0125 / _FILE_HALF_LENGTH  # a barrel's half length over the ellipsoid's


def roller_half_length(wheel: Wheel, angle: float = _STRAIGHT) -> float:
    """Half length √(R b)/sin γ of a roller whose outline has the wheel's curvature along its axis [m].

    In a direction at an angle γ to the axle, a cylinder of radius R has the curvature sin²γ/R.
    """
    return math.sqrt(wheel.radius * wheel.roller_radius) / math.sin(angle)


def roller_inertia(wheel: Wheel, angle: float) -> tuple[float, float]:
    """Spin inertia ½ m b² and transverse inertia m(3b² + L²)/12 of a roller of length L [kg.m2]."""
    length = 2.0 * _CUT * roller_half_length(wheel, angle)
    m, b = wheel.roller_mass, wheel.roller_radius
    return 0.5 * m * b**2, m * (3.0 * b**2 + length**2) / 12.0


def _about_axle(wheel: Wheel, angle: float) -> float:
    """Inertia of one roller about an axis through its centre along the axle [kg.m2]."""
    spin, across = roller_inertia(wheel, angle)
    return across + (spin - across) * math.cos(angle) ** 2


def hub_inertia(wheel: Wheel, angle: float = _STRAIGHT) -> float:
    """Inertia of a wheel about the axle without that of its rollers [kg.m2].

    Raises:
      InputError: The rollers alone exceed the inertia of the wheel.
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
    """Inertia of one wheel about the vertical through its centre, averaged over a turn [kg.m2]."""
    count = wheel.rows * wheel.rollers_per_row
    spin, across = roller_inertia(wheel, angle)
    ring = wheel.roller_mass * (0.5 * (wheel.radius - wheel.roller_radius) ** 2 + wheel.row_offset**2)
    return 0.71 * hub_inertia(wheel, angle) + count * (
        ring + 0.5 * (spin + 2.0 * across - _about_axle(wheel, angle))
    )


_LISTED = 0.003  # [m] depth up to which MuJoCo only lists a contact; deeper, its own catches the wheel
_SOLREF, _SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)  # MuJoCo's defaults
_FRICTION = (1.0, 0.005, 0.0001)


def native_contact(spec: mujoco.MjSpec, prefix: str, motor: str, activations: int) -> None:
    """Leave the contact of a wheel's rollers and its motor to the native callback.

    A negative margin keeps the rollers out of MuJoCo's solver, the gap lets MuJoCo list their contacts; the
    activations hold bristle deflections and motor currents. A user sensor takes slip velocity, normal force,
    traction and what else `slots.SENSOR_FIELDS` names.

    Args:
      spec: Model to change, whose file describes contact and motor of plain MuJoCo.
      prefix: Prefix of the wheel's names.
      motor: Name of its actuator.
      activations: Number of activations of the actuator.

    Raises:
      InputError: The model lacks the actuator.
    """
    for geom in [g for g in spec.geoms if g.name.startswith(f"{prefix}roller_")]:
        geom.margin, geom.gap, geom.priority = -_LISTED, _LISTED, 0
        geom.solref, geom.solimp, geom.friction = list(_SOLREF), list(_SOLIMP), list(_FRICTION)
    actuator = part(spec, "actuator", motor)
    actuator.dyntype, actuator.actdim = mujoco.mjtDyn.mjDYN_USER, activations
    actuator.gainprm[0] = 0.0
    spec.add_sensor(
        name=f"{prefix}contact",
        type=mujoco.mjtSensor.mjSENS_USER,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        objname=f"{prefix}wheel",
        dim=len(slots.SENSOR_FIELDS),
        needstage=mujoco.mjtStage.mjSTAGE_POS,  # in which MuJoCo zeroes it, before the callback writes it
    )


def write_wheel(
    spec: mujoco.MjSpec, prefix: str, wheel: Wheel, motor: Motor, angle: float = _STRAIGHT
) -> None:
    """Write mass, inertia, rollers and reflected rotor inertia of one attached wheel.

    Args:
      spec: Model to change.
      prefix: Prefix of the wheel's names.
      wheel: Constants of the wheel.
      motor: Constants of its motor.
      angle: Roller angle γ [rad].

    Raises:
      InputError: Rows or rollers differ from those of the file, or the wheel is lighter than its rollers.
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
