"""The robot's MJCF with a corner for each wheel of its model file: copies of the first in `uto_robot.xml`."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

from omnimj.errors import InputError
from omnimj.parameters import Robot
from omnimj.parameters.robot import WheelMount

ROBOT_FILE = "uto_robot.xml"
_ARM = 0.25  # [m] at which the file's wheels and the frames beside them stand
_OF_A_WHEEL = re.compile(r"(corner|guide|motor)_1\b|wheel_1(?=_)")


def robot_mjcf(robot: Robot, path: Path) -> bytes:
    """The MJCF of a robot with as many wheels as its model file has, to stand in for `uto_robot.xml`.

    Corners, motors and contact sensors are those of wheel 1 under other numbers; where they stand and what
    they weigh is written into the parsed model later, as for the file itself.

    Args:
      robot: The constants.
      path: `uto_robot.xml`; what is no XML is handed on as it is, for MuJoCo to say what is wrong with it.

    Raises:
      InputError: It lacks a part that is to be copied.
    """
    content, count = path.read_bytes(), len(robot.wheels)
    try:
        root = ET.fromstring(content)
    except ET.ParseError:
        return content
    chassis = _found(root, ".//body[@name='chassis']")
    _multiply(chassis, "corner_1", r"corner_\d+", count)
    _multiply(_found(root, "actuator"), "motor_1", r"motor_\d+", count)
    _multiply(_found(root, "sensor"), "wheel_1_contact", r"wheel_\d+_contact", count)
    _set_frames(chassis, robot.wheels)
    for asset in root.iterfind(".//model[@file]"):
        asset.set("file", str((path.parent / Path(asset.get("file", ""))).resolve()))
    return ET.tostring(root)


def _found(root: ET.Element, path: str) -> ET.Element:
    element = root.find(path)
    if element is None:
        raise InputError(ROBOT_FILE, f"has no {path}", "its first corner is copied for every wheel")
    return element


def _multiply(parent: ET.Element, first: str, kind: str, count: int) -> None:
    """In the place of all children of a kind: copies of the first, numbered 1 … count, behind the others."""
    text = ET.tostring(_found(parent, f"*[@name='{first}']"), encoding="unicode")
    for child in [c for c in parent if re.fullmatch(kind, c.get("name", ""))]:
        parent.remove(child)
    for i in range(1, count + 1):
        parent.append(ET.fromstring(_OF_A_WHEEL.sub(lambda m, i=i: m[0][:-1] + str(i), text)))


def _set_frames(chassis: ET.Element, mounts: Iterable[WheelMount]) -> None:
    """What the chassis carries beside each wheel, which is only seen, stands beside each wheel there is."""
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
