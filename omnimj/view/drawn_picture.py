"""A picture of a model without OpenGL: its visible geoms as shaded triangles with a depth buffer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from matplotlib.image import imsave
from numpy.typing import NDArray

from omnimj.physics.native import kernel
from omnimj.view.poses import body_appearance

if TYPE_CHECKING:
    from omnimj.view.picture import Camera

Array = NDArray[np.float64]
_LIGHT = np.array([0.35, -0.45, 0.82])
_SKY = np.array([0.86, 0.89, 0.93])
_TILES = np.array([[0.915, 0.907, 0.885], [0.882, 0.873, 0.850]])
_SHADOW, _TRAIL = np.array([0.74, 0.73, 0.70]), np.array([0.0, 0.447, 0.698])
_TILE = 0.25  # [m]
_VIEW = np.tan(np.radians(45.0) / 2)  # MuJoCo's default field of view
_NEAR = 0.05  # [m]
_FINE = 2  # samples per pixel and direction, averaged in the end


@kernel
def paint(corners, nearness, colors, image, buffer):
    """Paints triangles into an image wherever they are nearer than what is there.

    Args:
      corners: Picture coordinates of the corners [samples], shape (t, 3, 2).
      nearness: 1/depth at the corners, linear in the picture, shape (t, 3).
      colors: Shape (t, 3).
      image: Changed in place, shape (height, width, 3).
      buffer: 1/depth of what is painted, changed in place, shape (height, width).
    """
    height, width = buffer.shape
    for t in range(corners.shape[0]):
        (ax, ay), (bx, by), (cx, cy) = corners[t, 0], corners[t, 1], corners[t, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        for row in range(max(0, int(min(ay, by, cy))), min(height, int(max(ay, by, cy)) + 2)):
            for column in range(max(0, int(min(ax, bx, cx))), min(width, int(max(ax, bx, cx)) + 2)):
                x, y = column + 0.5, row + 0.5
                b = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
                c = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
                if b < 0.0 or c < 0.0 or b + c > 1.0:
                    continue
                near = (
                    nearness[t, 0]
                    + b * (nearness[t, 1] - nearness[t, 0])
                    + c * (nearness[t, 2] - nearness[t, 0])
                )
                if near > buffer[row, column]:
                    buffer[row, column] = near
                    image[row, column] = colors[t]


class _Canvas:
    """A picture in perspective, with a depth buffer."""

    def __init__(self, camera: Camera, size: tuple[int, int]):
        azimuth, elevation = np.radians(camera.azimuth), np.radians(camera.elevation)
        level = np.cos(elevation)
        self.ahead = np.array([np.cos(azimuth) * level, np.sin(azimuth) * level, np.sin(elevation)])
        self.right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
        self.up = np.cross(self.right, self.ahead)
        self.eye = np.asarray(camera.target) - camera.distance * self.ahead
        width, height = _FINE * size[0], _FINE * size[1]
        self.image = np.tile(_SKY, (height, width, 1))
        self.buffer = np.zeros((height, width))

    def add(self, triangles: Array, colors: Array) -> None:
        """Paints triangles of the world, shape (t, 3, 3) [m], with colours (t, 3)."""
        away = triangles - self.eye
        depth = away @ self.ahead
        shown = depth.min(axis=1) > _NEAR
        away, depth = away[shown], depth[shown]
        height, width = self.buffer.shape
        scale = 0.5 * height / (depth * _VIEW)
        x, y = 0.5 * width + (away @ self.right) * scale, 0.5 * height - (away @ self.up) * scale
        paint(np.stack([x, y], axis=-1), 1.0 / depth, colors[shown], self.image, self.buffer)

    def smooth(self) -> Array:
        """The picture in its final size, shape (height, width, 3)."""
        height, width = self.buffer.shape
        return self.image.reshape(height // _FINE, _FINE, width // _FINE, _FINE, 3).mean(axis=(1, 3))


def draw(
    mj_model: mujoco.MjModel, qpos: Array, path: Path, camera: Camera, trail: Array, size: tuple[int, int]
) -> None:
    """Draws a model in one pose into a PNG.

    Args:
      mj_model: Compiled model.
      qpos: Shape (nq,).
      path: The file to write.
      camera: Where to look from.
      trail: Points of a path on the floor, shape (k, 2) [m].
      size: Width and height [pixels].
    """
    canvas = _Canvas(camera, size)
    triangles, colors = _shaded(mj_model, qpos, -canvas.ahead)
    canvas.add(*_floor(np.asarray(camera.target)))
    shadow = triangles - triangles[..., 2:] / _LIGHT[2] * _LIGHT
    shadow[..., 2] = 2e-4  # just above the floor
    canvas.add(shadow, np.tile(_SHADOW, (len(shadow), 1)))
    if len(trail) > 1:
        canvas.add(*_ribbon(trail))
    canvas.add(triangles, colors)
    imsave(path, np.clip(canvas.smooth(), 0.0, 1.0))


def _shaded(mj_model: mujoco.MjModel, qpos: Array, to_eye: Array) -> tuple[Array, Array]:
    """All visible triangles in the world (t, 3, 3) and their colours (t, 3), lit from above and ahead."""
    mj_data = mujoco.MjData(mj_model)
    mj_data.qpos[:] = qpos
    mujoco.mj_kinematics(mj_model, mj_data)
    corners, colors = [], []
    for body in range(mj_model.nbody):
        look = body_appearance(mj_model, body)
        if look is None:
            continue
        surface = look.surface.moved(mj_data.xpos[body], mj_data.xmat[body].reshape(3, 3))
        corners.append(surface.vertices[surface.triangles])
        normals = surface.normals[surface.triangles].mean(axis=1)
        bright = (
            0.45 + 0.35 * np.clip(normals @ _LIGHT, 0.0, 1.0) + 0.25 * np.clip(normals @ to_eye, 0.0, 1.0)
        )
        colors.append(look.colors[surface.triangles[:, 0], :3] / 255.0 * bright[:, None])
    return np.concatenate(corners), np.concatenate(colors)


def _floor(target: Array) -> tuple[Array, Array]:
    """Tiles around what is looked at; fixed to the world, so that two pictures can be compared."""
    steps = np.arange(-24, 24)
    origin = np.round(target[:2] / _TILE).astype(int)
    i, j = np.meshgrid(steps + origin[0], steps + origin[1], indexing="ij")
    square = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]])
    corner = np.stack([i, j, np.zeros_like(i)], axis=-1).reshape(-1, 1, 1, 3)
    colors = _TILES[((i + j) % 2).ravel()]
    return _TILE * (corner + square).reshape(-1, 3, 3), np.repeat(colors, 2, axis=0)


def _ribbon(trail: Array, half_width: float = 0.004) -> tuple[Array, Array]:
    """A path on the floor as a flat ribbon."""
    kept = trail[np.linspace(0, len(trail) - 1, min(len(trail), 400)).astype(int)]
    along = np.gradient(kept, axis=0)
    across = np.column_stack([-along[:, 1], along[:, 0]])
    across *= half_width / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    height = np.full((len(kept), 1), 4e-4)
    left, right = np.hstack([kept + across, height]), np.hstack([kept - across, height])
    first = np.stack([left[:-1], right[:-1], right[1:]], axis=1)
    second = np.stack([left[:-1], right[1:], left[1:]], axis=1)
    triangles = np.concatenate([first, second])
    return triangles, np.tile(_TRAIL, (len(triangles), 1))
