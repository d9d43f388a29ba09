"""MJCF of a wheel: hub on its axle, rollers around it, and a file that rolls one wheel along a floor."""

from __future__ import annotations

import math
from collections.abc import Iterable
from textwrap import indent
from xml.sax.saxutils import quoteattr

import numpy as np

from omnimj.errors import InputError
from omnimj.wheels.contact import SolverContact, solver_contact
from omnimj.wheels.ring import OMNI
from omnimj.wheels.wheel import RollerWheel

_RINGS, _AROUND = 7, 12  # vertices of a roller's mesh along its axis and around it
_MAX_LOAD = 1e4  # [kg]
MUJOCO_STEP = 0.002  # [s] MuJoCo's default, with which the file of a wheel has no options that may conflict


def numbers(*values: float) -> str:
    """Return numbers for an attribute, separated by blanks."""
    return " ".join(f"{value:.8g}" if abs(value) > 1e-15 else "0" for value in values)


def indented(text: str, by: int) -> str:
    """Return lines without the last newline, indented by a number of blanks."""
    return indent(text.strip("\n"), " " * by)


def roller_defaults(wheel: RollerWheel, contact: SolverContact, in_pairs: bool) -> str:
    """Write the default class of rollers.

    Args:
      wheel: Wheel of the rollers.
      contact: Contact of the rollers.
      in_pairs: Whether rollers touch only geoms that they are paired with.
    """
    long, b = wheel.half_length, wheel.roller_radius
    solref = f'solref="{numbers(contact.time_constant)} 1"'
    solimp = f'solimp="{numbers(contact.impedance, contact.impedance)} 0.001"'
    mu = numbers(contact.friction)
    if in_pairs:
        shape = 'contype="0" conaffinity="0"'
        pair = f'\n  <pair condim="3" friction="{mu} {mu}" {solref} {solimp}/>'
    else:
        shape = (
            f'contype="1" conaffinity="0" condim="3" priority="1" friction="{mu}"\n        {solref} {solimp}'
        )
        pair = ""
    return f"""\
<default class="roller">
  <!-- frictionloss or armature here would stop the rollers, which have hardly any inertia -->
  <joint type="hinge" axis="1 0 0"/>
  <geom type="ellipsoid" size="{numbers(long, b, b)}" mass="0" group="3" rgba="0.2 0.6 0.9 0.4"
        {shape}/>{pair}
</default>
<default class="rubber">
  <geom type="mesh" mesh="roller" material="rubber" contype="0" conaffinity="0" group="2" mass="0"/>
</default>
<default class="hub">
  <geom type="cylinder" zaxis="0 1 0" material="hub" contype="0" conaffinity="0" group="2" mass="0"/>
</default>
"""


def wheel_assets(wheel: RollerWheel) -> str:
    """Write the materials, and the shape of a roller: the ellipsoid, cut where a real roller ends."""
    cut, long = wheel.roller_half_length, wheel.half_length
    vertices = []
    for x in np.linspace(-cut, cut, _RINGS):
        radius = wheel.roller_radius * math.sqrt(1.0 - (x / long) ** 2)
        for turn in np.arange(_AROUND) * 2.0 * math.pi / _AROUND:
            point = (x, radius * math.cos(turn), radius * math.sin(turn))
            vertices.append(" ".join(f"{value:.4g}" if abs(value) > 1e-12 else "0" for value in point))
    lines = ["  ".join(vertices[k : k + 4]) for k in range(0, len(vertices), 4)]
    return f"""\
<material name="rubber" rgba="0.20 0.22 0.25 1" specular="0.2" shininess="0.2"/>
<material name="hub" rgba="0.75 0.77 0.80 1" specular="0.6" shininess="0.6"/>
<mesh name="roller" vertex="
{indented(chr(10).join(lines), 2)}"/>
"""


def wheel_body(wheel: RollerWheel, prefix: str, place: str, armature: float = 0.0, bare: bool = False) -> str:
    """Write the body of a wheel: axle along y, driving along x at a positive speed.

    Args:
      wheel: Wheel to write.
      prefix: Prefix of the names.
      place: Attributes that place the body.
      armature: Inertia of rotor and gear at the axle [kg.m2].
      bare: Whether to leave out what is only seen.
    """
    spin, across = wheel.roller_inertia
    about_axle, about_radius = wheel.hub_inertia
    turned = math.degrees(0.5 * math.pi - wheel.mounted_angle)
    slant = "" if wheel.roller_angle == OMNI else f' euler="0 0 {numbers(turned)}"'
    first = 0.5 * (wheel.rows - 1) * wheel.row_spacing
    seen = "" if bare else '\n  <geom class="rubber"/>'
    roller = f"""\
<body name="{prefix}roller" pos="0 {numbers(first, wheel.roller_radius - wheel.radius)}"{slant}>
  <joint name="{prefix}roller" class="roller"/>
  <inertial pos="0 0 0" mass="{numbers(wheel.roller_mass)}" diaginertia="{numbers(spin, across, across)}"/>
  <geom name="{prefix}roller" class="roller"/>{seen}
</body>
"""
    around = f"""\
<replicate count="{wheel.rollers}" euler="0 {numbers(360.0 / wheel.rollers)} 0" sep="_">
{indented(roller, 2)}
</replicate>
"""
    if wheel.rows > 1:
        offset = f'offset="0 {numbers(-wheel.row_spacing)} 0" euler="0 {numbers(360.0 / wheel.count)} 0"'
        around = f"""\
<replicate count="{wheel.rows}" {offset} sep="_row_">
{indented(around, 2)}
</replicate>
"""
    hub_inertia = numbers(about_radius, about_axle, about_radius)
    size = numbers(0.9 * wheel.hub_radius, 0.42 * wheel.width)
    seen = "" if bare else f'\n  <geom class="hub" size="{size}"/>'
    driven = f' armature="{numbers(armature)}"' if armature else ""
    return f"""\
<body name="{prefix}wheel" {place}>
  <joint name="{prefix}axle" type="hinge" axis="0 1 0"{driven}/>
  <inertial pos="0 0 0" mass="{numbers(wheel.hub_mass)}" diaginertia="{hub_inertia}"/>{seen}
{indented(around, 2)}
</body>
"""


def describe(wheel: RollerWheel) -> tuple[str, ...]:
    """Describe a wheel in lines for the comment at the head of a file."""
    around = f"{wheel.rows} rows of {wheel.rollers}" if wheel.rows > 1 else str(wheel.rollers)
    b, long = 1e3 * wheel.roller_radius, 1e3 * wheel.half_length
    lines = [
        f"Wheel of radius {1e3 * wheel.radius:g} mm with {around} rollers, ellipsoids with the semi-axes "
        f"{long:.4g}, {b:.4g} and {b:.4g} mm, so that their outline has the wheel's curvature.",
        f"Drop of the hub at hand-over from roller to roller: {1e6 * wheel.drop:.3g} µm.",
    ]
    if wheel.roller_angle != OMNI:
        angle, built = (math.degrees(a) for a in (wheel.roller_angle, wheel.mounted_angle))
        lines.append(
            f"Rollers lie at {built:.4g}° to the axle; a tilted one shows a smaller angle from above, "
            f"and {angle:.4g}° is in the middle of what a turn shows."
        )
    return tuple(lines)


def head_comment(lines: Iterable[str]) -> str:
    """Return a comment of an MJCF file; lines have no two hyphens in a row, which XML forbids there."""
    return f"<!--\n{indented(chr(10).join(lines), 2)}\n-->\n"


def made_by(command: str) -> str:
    """Return an element that keeps the command of a file; nothing for an empty one."""
    if not command:
        return ""
    return f'<custom>\n  <text name="command" data={quoteattr(command)}/>\n</custom>\n'


SURROUNDINGS = """\
<visual>
  <global offwidth="1280" offheight="960"/>
  <headlight ambient="0.36 0.36 0.37" diffuse="0.3 0.3 0.3" specular="0.08 0.08 0.08"/>
</visual>
"""
FLOOR_ASSETS = """\
<texture name="sky" type="skybox" builtin="gradient" rgb1="0.92 0.94 0.97" rgb2="0.70 0.76 0.84"
         width="256" height="256"/>
<texture name="tiles" type="2d" builtin="checker" rgb1="0.80 0.79 0.76" rgb2="0.75 0.74 0.71"
         width="512" height="512" mark="edge" markrgb="0.66 0.65 0.62"/>
<material name="floor" texture="tiles" texrepeat="2 2" texuniform="true"/>
"""
FLOOR = """\
<light name="sun" type="directional" pos="0 -0.75 1" dir="0.02 0.75 -1" diffuse="0.52 0.51 0.49"
       castshadow="true"/>
<geom name="floor" type="plane" size="20 20 0.1" material="floor"/>
"""


def wheel_file(
    wheel: RollerWheel, contact: SolverContact | None = None, load: float = 3.0, command: str = ""
) -> str:
    """Write an MJCF file of one wheel, which carries a load on a floor and is driven along it.

    The wheel is the body `wheel`: `<attach model="FILE" body="wheel" prefix="left_"/>` puts it elsewhere.

    Args:
      wheel: Wheel to write.
      contact: Contact of its rollers with the floor; when None, that of `solver_contact` at MuJoCo's step.
      load: Mass on the axle, without the wheel [kg].
      command: Command line that makes the file, kept in it.

    Raises:
      InputError: The load is out of range.
    """
    if not 0.0 < load <= _MAX_LOAD:
        raise InputError("wheel: load", f"found {load:g} kg", f"must be above 0 and at most {_MAX_LOAD:g} kg")
    contact = solver_contact(wheel.radius, timestep=MUJOCO_STEP) if contact is None else contact
    kind = "omni_wheel" if wheel.roller_angle == OMNI else "mecanum_wheel"
    lines = (
        *describe(wheel),
        "The carriage slides along x, y and z without turning, and rests on the wheel, whose speed is set.",
        'To use the wheel elsewhere: <attach model="…" body="wheel" prefix="left_"/>. Its axle is y.',
    )
    gain = 0.5 * wheel.inertia / contact.timestep  # a wheel in the air is stable below four times this
    step = "" if contact.timestep == MUJOCO_STEP else f'\n  <option timestep="{numbers(contact.timestep)}"/>'
    return f"""\
<mujoco model="{kind}">
{indented(head_comment(lines), 2)}
  <compiler angle="degree" autolimits="true"/>{step}
  <statistic center="0 0 {numbers(wheel.radius)}" extent="{numbers(6.0 * wheel.radius)}"/>
{indented(SURROUNDINGS + made_by(command), 2)}

  <default>
{indented(roller_defaults(wheel, contact, False), 4)}
  </default>

  <asset>
{indented(FLOOR_ASSETS + wheel_assets(wheel), 4)}
  </asset>

  <worldbody>
{indented(FLOOR, 4)}
    <body name="carriage" pos="0 0 {numbers(wheel.radius)}">
      <joint name="along" type="slide" axis="1 0 0"/>
      <joint name="sideways" type="slide" axis="0 1 0"/>
      <joint name="height" type="slide" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="{numbers(load)}" diaginertia="{numbers(*[load * wheel.radius**2] * 3)}"/>
      <camera name="chase" pos="0 {numbers(-6.0 * wheel.radius, 3.0 * wheel.radius)}" mode="track"
              xyaxes="1 0 0 0 0.45 0.9"/>
{indented(wheel_body(wheel, "", 'pos="0 0 0"'), 6)}
    </body>
  </worldbody>

  <actuator>
    <velocity name="motor" joint="axle" kv="{numbers(gain)}"/>
  </actuator>
</mujoco>
"""
