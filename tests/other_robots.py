"""Robots of other layouts, made of the parts of the shipped one."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import omnimj
from omnimj.parameters import Robot, read_robot
from omnimj.parameters.robot import WheelMount
from omnimj.resources import models_folder

STRAIGHT = 0.5 * math.pi


def star(count: int, arm: float = 0.25, first: float = 0.0) -> Robot:
    """Omni wheels at equal angles around the centre; all drive it clockwise."""
    angles = [first + 2.0 * math.pi * k / count for k in range(count)]
    mounts = [WheelMount((arm * math.cos(a), arm * math.sin(a)), (math.sin(a), -math.cos(a))) for a in angles]
    return dataclasses.replace(read_robot(), wheels=tuple(mounts))


def mecanum(length: float = 0.2, width: float = 0.2, angle: float = 0.25 * math.pi) -> Robot:
    """Four wheels that drive along x, the axes of their lowest rollers at right angles to the diagonals.

    Seen from above these make an O on the floor: the wheels have a moment about the centre.
    """
    places = ((length, width), (length, -width), (-length, -width), (-length, width))
    turned = (math.pi - angle, angle, math.pi - angle, angle)
    mounts = [WheelMount(p, (1.0, 0.0), g) for p, g in zip(places, turned, strict=True)]
    return dataclasses.replace(read_robot(), wheels=tuple(mounts))


def write_mecanum_of_the_guide(path: Path, yaw_gain: float = 3.0) -> Path:
    """The model file that the page on robots of your own describes in words."""
    guide = (Path(omnimj.__file__).parent / "docs" / "own_robot.md").read_text(encoding="utf-8")
    (ahead,) = re.findall(r"```toml\n(\[\[wheels.*?)```", guide, flags=re.DOTALL)
    behind = ahead.replace("[0.2, 0.2]", "[-0.2, -0.2]").replace("[0.2, -0.2]", "[-0.2, 0.2]")
    text = (models_folder() / "three_wheel" / "robot.toml").read_text(encoding="utf-8")
    body, rest = text.split("[[wheels]]", 1)[0], text[text.index("[control]") :]
    path.write_text(f"{body}{ahead}{behind}{_with_yaw_gain(rest, yaw_gain)}", encoding="utf-8")
    return path


def write_slow(path: Path, rate: float, yaw_gain: float = 3.0) -> Path:
    """The shipped robot over a slow line: fewer samples a second, and a gain that its loop can have then."""
    sensors = (models_folder() / "parts.toml").read_text(encoding="utf-8")
    sensors = sensors[sensors.index("[sensors]") :].split("\n[", 1)[0]
    sensors = re.sub(r"(?m)^(sample_rate = \{ value = )[\d.]+", rf"\g<1>{rate}", sensors)
    text = _with_yaw_gain(read_robot().file.read_text(encoding="utf-8"), yaw_gain)
    path.write_text(f"{text}\n{sensors}\n", encoding="utf-8")
    return path


def _with_yaw_gain(text: str, gain: float) -> str:
    return re.sub(r"(yaw_rate_proportional = \{ value = )[\d.]+", rf"\g<1>{gain}", text)
