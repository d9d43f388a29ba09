"""The one layout of wheels that the published method knows."""

from __future__ import annotations

import numpy as np

from omnimj.parameters import Robot

LAYOUT = "Table 5.2 is for four omni wheels of which 1 and 3 drive along y, 2 and 4 along x, or the other way"
"""The rule, for messages."""
WHEELS = 4


def other_layout(robot: Robot) -> str:
    """What of a robot's wheels the published method is not for; empty where it fits."""
    u, n = robot.drive_directions, len(robot.wheels)
    if n != WHEELS:
        return f"found {n} wheels"
    if not np.all(np.isclose(np.abs(u).max(axis=1), 1.0, atol=1e-6)):
        return "a wheel drives askew"
    along_x = np.abs(u[:, 0]) > 0.5
    if np.any(along_x != along_x[[2, 3, 0, 1]]) or along_x[0] == along_x[1]:
        return "wheels 1 and 3 do not drive across wheels 2 and 4"
    if any(abs(wheel.roller_angle - 0.5 * np.pi) > 1e-6 for wheel in robot.wheels):
        return "a wheel has turned rollers"
    return ""
