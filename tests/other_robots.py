"""Robots of other layouts, made of the parts of the shipped one."""

from __future__ import annotations

import dataclasses
import math

from omnimj.parameters import Robot, read_robot
from omnimj.parameters.robot import WheelMount

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
