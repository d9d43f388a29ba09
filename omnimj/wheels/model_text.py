"""Model file of omnimj for a robot on omni or mecanum wheels: its twin with the native LuGre contact."""

from __future__ import annotations

import json
import math
import tomllib
from xml.sax.saxutils import quoteattr

from omnimj.errors import InputError
from omnimj.wheels.ring import OMNI
from omnimj.wheels.robot import WheeledRobot

_ROLLERS = 18  # of the twin's wheel, in two rows
_CARRIED = 0.4  # [kg] of motor and carriage beside a wheel of the shipped robot, which moves 3.75 kg
_SHARE = 3.75  # [kg] of the shipped robot on each wheel, for which springs and gains were chosen


def model_text(robot: WheeledRobot) -> str:
    """Write the model file (TOML) of a robot for `omnimj run --model`.

    Geometry and masses are the robot's; motor, bearings, sensors and gains are those of the shipped parts.
    The wheels hang on springs that carry the load as the shipped robot's do.

    Raises:
      InputError: The wheels have other rollers than the twin's wheel.
    """
    reason = _no_twin(robot)
    if reason:
        raise InputError("robot: wheel", *reason)
    wheel = robot.wheel
    count = len(robot.mounts)
    share = robot.mass / count / _SHARE
    values = [
        ("mass", robot.mass, "kg"),
        ("yaw_inertia", _yaw_inertia(robot), "kg.m2"),
        ("com_height", wheel.radius + 0.5 * wheel.radius * robot.body_mass / robot.mass, "m"),
        ("suspension_stiffness", 4000.0 * share, "N/m"),
        ("suspension_damping", 120.0 * share, "N.s/m"),
        ("suspension_travel", 0.01, "m"),
        ("unsprung_mass", wheel.mass + _CARRIED * share, "kg"),
    ]
    wheels = [
        ("radius", wheel.radius, "m"),
        ("inertia", wheel.inertia, "kg.m2"),
        ("mass", wheel.mass, "kg"),
        ("roller_radius", wheel.roller_radius, "m"),
        ("roller_mass", wheel.roller_mass, "kg"),
        ("row_offset", 0.5 * wheel.row_spacing, "m"),
    ]
    gains = [
        ("speed_proportional", 0.29604 * share, "A.s/rad"),
        ("speed_integral", 3.325 * share, "A/rad"),
        ("yaw_rate_proportional", 3.0, "1"),
        ("heading_proportional", 4.4, "1/s"),
        ("current_limit", 1.5, "A"),
        ("current_rate_limit", 1000.0, "A/s"),
        ("wheel_speed_limit", robot.top_speed / wheel.radius, "rad/s"),
    ]
    tables = [
        _table("[body]", values),
        *_mounts(robot),
        _table("[wheel]", wheels),
        _table("[control]", gains),
    ]
    head = (
        f"# {robot.layout}: geometry and masses are given; motor, bearings, sensors and gains are chosen.\n"
    )
    return f'{head}plant = "uto_robot"\nparts = "parts.toml"\n\n' + "\n\n".join(tables) + "\n"


def twin_text(robot: WheeledRobot) -> str:
    """Write the element of an MJCF file with which `omnimj run --model` takes the file itself as a model.

    It holds the tables of `model_text` as JSON, or the reason for which there is no twin.
    """
    reason = _no_twin(robot)
    tables = {"no_twin": "; ".join(reason)} if reason else tomllib.loads(model_text(robot))
    return f'<custom>\n  <text name="omnimj_robot" data={quoteattr(json.dumps(tables))}/>\n</custom>\n'


def _no_twin(robot: WheeledRobot) -> tuple[str, ...]:
    """Parts of a robot that the twin lacks, and what it has instead; empty where it has all.

    The twin's mecanum wheel has the radius and the angle of any other, and its own number of rollers, which
    shows in the ripple of the hub alone.
    """
    wheel = robot.wheel
    if wheel.roller_angle != OMNI or (wheel.count == _ROLLERS and wheel.rows <= 2):
        return ()
    found = f"{wheel.count} rollers in {wheel.rows} rows"
    return f"has {found}", "the twin's wheel has 18, in two rows of nine"


def _table(heading: str, values: list[tuple[str, float, str]]) -> str:
    return "\n".join([heading, *(_entry(name, f"{value:.10g}", unit) for name, value, unit in values)])


def _entry(name: str, value: str, unit: str) -> str:
    return f'{name} = {{ value = {value}, unit = "{unit}", source = "chosen" }}'


def _mounts(robot: WheeledRobot) -> list[str]:
    written = []
    for mount in robot.mounts:
        x, y = mount.position
        lines = [
            "[[wheels]]",
            _entry("position", f"[{x!r}, {y!r}]", "m"),
            _entry("drives_along", f"[{math.cos(mount.yaw)!r}, {math.sin(mount.yaw)!r}]", "1"),
            _entry("roller_angle", repr(robot.wheel_of(mount).roller_angle), "rad"),
        ]
        written.append("\n".join(lines))
    return written


def _yaw_inertia(robot: WheeledRobot) -> float:
    """Inertia about the vertical, wheels included as if their mass were at their centres [kg.m2]."""
    return robot.body_inertia[2] + sum(
        robot.wheel.mass * float(x * x + y * y) + robot.wheel.hub_inertia[1]
        for x, y in (mount.position for mount in robot.mounts)
    )
