"""Map of the floor from above: planned and driven path, patches, and the robot with its wheels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from omnimj.learning.options import Task
from omnimj.learning.simulation import Simulation
from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.motion import patch_corners

SIZE = 480
"""Width and height [pixels]."""
_ROOM = 0.6  # [m] around the planned path
_POINTS = 400  # of a path at most


class Scene:
    """Content of a map beside the robot, whose patches are those of a task."""

    def __init__(self, task: Task):
        self.task, self.trail = task, np.zeros((0, 2)).tolist()
        self._low, self._width = np.zeros(2), 1.0

    def begin(self, simulation: Simulation) -> None:
        """Begin an episode at the robot's pose, with the whole plan in view."""
        low, high = simulation.planned.min(axis=0), simulation.planned.max(axis=0)
        self._width = float((high - low).max()) + 2.0 * _ROOM
        self._low = 0.5 * (low + high) - 0.5 * self._width
        self.trail = [simulation.pose[:2].tolist()]

    def follow(self, simulation: Simulation) -> None:
        """Add the robot's position to its path."""
        self.trail.append(simulation.pose[:2].tolist())

    def pixels(self, points: Array | Sequence[Any]) -> list[tuple[float, float]]:
        """Pixels of points of the floor, shape (k, 2) [m]; y points upwards."""
        x, y = (np.asarray(points, float).reshape(-1, 2) - self._low).T * (SIZE / self._width)
        return list(zip(x.tolist(), (SIZE - y).tolist(), strict=True))


def draw(scene: Scene, simulation: Simulation) -> NDArray[np.uint8]:
    """Draw the map, shape (SIZE, SIZE, 3)."""
    image = Image.new("RGB", (SIZE, SIZE), "white")
    pen = ImageDraw.Draw(image)
    for patch in scene.task.patches:
        pen.polygon(scene.pixels(patch_corners(patch)), fill=palette.GRID, outline=palette.MUTED)
    for points, color, width in (
        (simulation.planned, palette.PLANNED, 2),
        (scene.trail, palette.MEASURED, 3),
    ):
        shown = scene.pixels(points)
        pen.line(shown[:: max(1, len(shown) // _POINTS)], fill=color, width=width)
    _draw_robot(pen, scene, simulation.pose)
    return np.asarray(image).copy()


def _draw_robot(pen: ImageDraw.ImageDraw, scene: Scene, pose: Array) -> None:
    robot, (c, s) = scene.task.robot, (np.cos(pose[2]), np.sin(pose[2]))
    turn, radius = np.array([[c, s], [-s, c]]), robot.wheel.radius
    reach = float(np.linalg.norm(robot.wheel_positions, axis=1).max())
    around = np.linspace(0.0, 2.0 * np.pi, 49)
    body = 0.8 * reach * np.column_stack([np.cos(around), np.sin(around)])
    pen.polygon(scene.pixels(body + pose[:2]), fill=palette.GRID, outline=palette.INK)
    ahead = np.array([[0.0, 0.0], [0.8 * reach, 0.0]]) @ turn
    pen.line(scene.pixels(ahead + pose[:2]), fill=palette.INK, width=2)
    for i, (place, along) in enumerate(zip(robot.wheel_positions, robot.drive_directions, strict=True)):
        across = np.array([-along[1], along[0]])
        corners = [place + radius * (a * along + 0.4 * b * across) for a, b in _CORNERS]
        color = palette.WHEELS[i % len(palette.WHEELS)]
        pen.polygon(scene.pixels(np.array(corners) @ turn + pose[:2]), fill=color)


_CORNERS = ((1, 1), (1, -1), (-1, -1), (-1, 1))
