"""MJCF of a robot on omni or mecanum wheels, complete with floor and light."""

from __future__ import annotations

import math

from omnimj.errors import UnknownNameError
from omnimj.wheels.contact import SolverContact, solver_contact
from omnimj.wheels.model_text import twin_text
from omnimj.wheels.robot import WheeledRobot
from omnimj.wheels.wheel_xml import (
    FLOOR,
    FLOOR_ASSETS,
    SURROUNDINGS,
    describe,
    head_comment,
    indented,
    made_by,
    numbers,
    roller_defaults,
    wheel_assets,
    wheel_body,
)

TOUCHED = ("floor", "everything")
"""Geoms that rollers touch: the geom `floor`, pair by pair, or every geom whose conaffinity has bit 1."""


def robot_file(
    robot: WheeledRobot,
    contact: SolverContact | None = None,
    touch: str = "floor",
    bare: bool = False,
    command: str = "",
) -> str:
    """Write an MJCF file of a robot on a floor, which omnimj takes as a model file, too.

    Args:
      robot: Robot to write.
      contact: Contact of its rollers with the floor; that of `solver_contact` when None.
      touch: One of `TOUCHED`.
      bare: Whether to leave out what is only seen, which takes time in every step.
      command: Command line that makes the file, kept in it.

    Raises:
      UnknownNameError: `touch` is unknown.
    """
    if touch not in TOUCHED:
        raise UnknownNameError("robot", "value of touch", touch, TOUCHED)
    contact = solver_contact(robot.wheel.radius) if contact is None else contact
    in_pairs, radius = touch == "floor", robot.wheel.radius
    size = 2.0 * max(robot.half_sides[:2]) + 2.0 * radius
    pairs = f"\n\n  <contact>\n{indented(_pairs(robot), 4)}\n  </contact>" if in_pairs else ""
    return f"""\
<mujoco model="{robot.layout}">
{indented(head_comment(_describe(robot, in_pairs)), 2)}
  <compiler angle="degree" autolimits="true"/>
  <!-- tolerance: coarser than MuJoCo's, for speed; at rest the robot still moves by less than 1 nm in 3 s.
       island: the robot is one, and looking for more takes time in every step -->
  <option timestep="{numbers(contact.timestep)}" cone="elliptic" tolerance="1e-6">
    <flag island="disable"/>
  </option>
  <statistic center="0 0 {numbers(radius)}" extent="{numbers(size)}"/>
{indented(SURROUNDINGS + made_by(command) + twin_text(robot), 2)}

  <default>
{indented(roller_defaults(robot.wheel, contact, in_pairs), 4)}
{indented(_driven_defaults(robot, contact), 4)}
  </default>

  <asset>
{indented(FLOOR_ASSETS + wheel_assets(robot.wheel), 4)}
    <material name="body" rgba="0.93 0.94 0.95 1" specular="0.3" shininess="0.3"/>
    <material name="ahead" rgba="0.10 0.45 0.75 1"/>
  </asset>

  <worldbody>
{indented(FLOOR, 4)}
{indented(_chassis(robot, size, bare), 4)}
  </worldbody>{pairs}

  <actuator>
{indented(_actuators(robot), 4)}
  </actuator>

  <sensor>
    <velocimeter name="velocity" site="centre"/>
    <gyro name="turning" site="centre"/>
  </sensor>
</mujoco>
"""


def _describe(robot: WheeledRobot, in_pairs: bool) -> tuple[str, ...]:
    unit = "rad/s" if robot.actuators == "velocity" else "N.m"
    rows = [
        f"  motor_{i}: {numbers(*(round(k, 6) for k in row))}"
        for i, row in enumerate(robot.kinematics, start=1)
    ]
    touched = (
        "Rollers touch the geom 'floor' only, see <contact>; the option 'touch everything' changes that."
        if in_pairs
        else "Rollers touch every geom whose conaffinity has bit 1, such as MuJoCo's default geoms."
    )
    return (
        f"Robot {robot.layout}: x is ahead, y to the left; a {robot.actuators} actuator per wheel [{unit}].",
        *describe(robot.wheel),
        "Wheel speeds [rad/s] are the products of v_x, v_y [m/s] and yaw rate [rad/s] with",
        *rows,
        touched,
    )


def _driven_defaults(robot: WheeledRobot, contact: SolverContact) -> str:
    limit = robot.torque_limit(contact.friction)
    if robot.actuators == "motor":
        return f'<default class="drive">\n  <motor ctrlrange="{numbers(-limit, limit)}"/>\n</default>\n'
    top = robot.top_speed / robot.wheel.radius
    gain = robot.velocity_gain(contact.timestep)
    return f"""\
<default class="drive">
  <!-- kv: up to four times as large for this step; force: where the wheels begin to spin -->
  <velocity kv="{numbers(gain)}" ctrlrange="{numbers(-top, top)}" forcerange="{numbers(-limit, limit)}"/>
</default>
"""


def _chassis(robot: WheeledRobot, size: float, bare: bool) -> str:
    x, y, z = robot.half_sides
    up = 0.5 * robot.wheel.radius  # centre of the body above the axles
    shape, dimensions = ("box", (x, y, z)) if robot.layout == "mecanum4" else ("cylinder", (x, z))
    wheels = "\n".join(
        wheel_body(
            robot.wheel_of(mount),
            f"wheel_{i}_",
            f'pos="{numbers(*mount.position)} 0" euler="0 0 {numbers(math.degrees(mount.yaw))}"',
            robot.rotor_inertia,
            bare,
        ).rstrip()
        for i, mount in enumerate(robot.mounts, start=1)
    )
    seen = f"""
  <geom type="box" size="{numbers(0.12 * x, 0.04 * x, 0.03 * z)}" pos="{numbers(0.8 * x, 0.0, up + z)}"
        material="ahead" contype="0" conaffinity="0" mass="0"/>"""
    return f"""\
<body name="chassis" pos="0 0 {numbers(robot.wheel.radius)}">
  <freejoint name="free"/>
  <inertial pos="0 0 {numbers(up)}" mass="{numbers(robot.body_mass)}"
            diaginertia="{numbers(*robot.body_inertia)}"/>
  <site name="centre" size="0.005"/>
  <camera name="chase" pos="{numbers(-size, -size, size)}" mode="track"
          xyaxes="0.7071 -0.7071 0 0.40 0.40 0.825"/>
  <geom name="chassis" type="{shape}" size="{numbers(*dimensions)}" pos="0 0 {numbers(up)}" material="body"
        contype="1" conaffinity="0" mass="0"/>{"" if bare else seen}
{indented(wheels, 2)}
</body>
"""


def _pairs(robot: WheeledRobot) -> str:
    wheel, lines = robot.wheel, []
    digits = len(str(wheel.rollers - 1))
    for i in range(1, len(robot.mounts) + 1):
        for row in range(wheel.rows):
            after = f"_row_{row}" if wheel.rows > 1 else ""
            for k in range(wheel.rollers):
                name = f"wheel_{i}_roller_{k:0{digits}d}{after}"
                lines.append(f'<pair class="roller" geom1="floor" geom2="{name}"/>')
    return "\n".join(lines)


def _actuators(robot: WheeledRobot) -> str:
    return "\n".join(
        f'<{robot.actuators} name="motor_{i}" class="drive" joint="wheel_{i}_axle"/>'
        for i in range(1, len(robot.mounts) + 1)
    )
