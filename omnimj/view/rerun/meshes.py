"""Triangle meshes with colours from MuJoCo geoms and bodies, for viewers that cannot read MuJoCo models."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnimj.signals import Array
from omnimj.view.poses import geom_rgba, visible_geoms

ROUND = 28
"""Number of corners that approximate a circle."""
_STRIPE = 0.45
"""Brightness of the stripe that shows the rotation of a body of revolution, relative to its colour."""
_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_BOX_FACES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


@dataclass(frozen=True)
class Surface:
    """Triangle mesh with normals."""

    vertices: Array
    """Vertices, shape (v, 3) [m]."""
    normals: Array
    """Unit normals, shape (v, 3)."""
    triangles: NDArray[np.int64]
    """Vertex indices, counter-clockwise seen from outside, shape (t, 3)."""

    def moved(self, position: Array, rotation: Array) -> Surface:
        """Return the surface rotated by a matrix, shape (3, 3), and then shifted, shape (3,) [m]."""
        return Surface(self.vertices @ rotation.T + position, self.normals @ rotation.T, self.triangles)


def joined(surfaces: list[Surface]) -> Surface:
    """Merge several surfaces into one."""
    offsets = np.cumsum([0, *(len(s.vertices) for s in surfaces[:-1])])
    return Surface(
        np.concatenate([s.vertices for s in surfaces]),
        np.concatenate([s.normals for s in surfaces]),
        np.concatenate([s.triangles + o for s, o in zip(surfaces, offsets, strict=True)]),
    )


def box(half: Array) -> Surface:
    """Make a box around the origin with half the edge lengths along x, y and z, shape (3,) [m]."""
    corners = _CORNERS[_BOX_FACES] * half
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    quads = np.arange(24).reshape(6, 4)
    return Surface(corners.reshape(-1, 3), np.repeat(normals, 4, axis=0), _split(quads))


def _split(quads: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def revolved(profile: Array, normals: Array, corners: int = ROUND) -> Surface:
    """Revolve a profile of radii and heights, shape (k, 2) [m], about z, from the bottom to the top.

    The normals have a radial and a vertical component at each point, shape (k, 2).
    """
    angle = np.linspace(0.0, 2.0 * np.pi, corners + 1)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])

    def turn(values: Array) -> Array:
        flat = values[:, None, :1] * ring[None]
        return np.concatenate([flat, np.repeat(values[:, None, 1:], len(ring), axis=1)], axis=2).reshape(
            -1, 3
        )

    rows, around = np.meshgrid(np.arange(len(profile) - 1), np.arange(corners), indexing="ij")
    first = (rows * (corners + 1) + around).ravel()
    quads = np.column_stack([first, first + 1, first + corners + 2, first + corners + 1])
    return Surface(turn(profile), turn(normals), _split(quads))


def cylinder(radius: float, half_length: float, corners: int = ROUND) -> Surface:
    """Make a cylinder along z with flat ends; lengths in m."""
    up, out = np.array([0.0, 1.0]), np.array([1.0, 0.0])
    low, high = np.array([radius, -half_length]), np.array([radius, half_length])
    side = revolved(np.array([low, high]), np.array([out, out]), corners)
    bottom = revolved(np.array([[0.0, -half_length], low]), np.array([-up, -up]), corners)
    top = revolved(np.array([high, [0.0, half_length]]), np.array([up, up]), corners)
    return joined([side, bottom, top])


def ellipsoid(half: Array, corners: int = ROUND) -> Surface:
    """Make an ellipsoid around the origin with semi-axes along x, y and z, shape (3,) [m]."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, corners // 2 + 1)
    profile = np.column_stack([np.cos(angle), np.sin(angle)])
    sphere = revolved(profile, profile, corners)
    normals = sphere.normals / half
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Surface(sphere.vertices * half, normals, sphere.triangles)


def capsule(radius: float, half_length: float, corners: int = 10) -> Surface:
    """Make a cylinder along z, `half_length` without the ends, with hemispherical ends; lengths in m."""
    angle = np.concatenate([np.linspace(-np.pi / 2, 0, 4), np.linspace(0, np.pi / 2, 4)])
    normals = np.column_stack([np.cos(angle), np.sin(angle)])
    shift = np.column_stack([np.zeros(8), np.repeat([-half_length, half_length], 4)])
    return revolved(radius * normals + shift, normals, corners)


def mesh(mj_model: mujoco.MjModel, number: int) -> Surface:
    """Return a mesh of the model with a separate vertex per triangle corner."""
    faces = slice(
        mj_model.mesh_faceadr[number], mj_model.mesh_faceadr[number] + mj_model.mesh_facenum[number]
    )
    points = mj_model.mesh_vert[mj_model.mesh_vertadr[number] :][mj_model.mesh_face[faces].ravel()]
    normals = mj_model.mesh_normal[mj_model.mesh_normaladr[number] :][mj_model.mesh_facenormal[faces].ravel()]
    triangles = np.arange(len(points)).reshape(-1, 3)
    return Surface(points.astype(float), normals.astype(float), triangles)


def height_field(mj_model: mujoco.MjModel, number: int) -> Surface:
    """Return the top surface of a height field of the model."""
    rows, columns = int(mj_model.hfield_nrow[number]), int(mj_model.hfield_ncol[number])
    half_x, half_y, top, _ = mj_model.hfield_size[number]
    first = mj_model.hfield_adr[number]
    height = top * mj_model.hfield_data[first : first + rows * columns].reshape(rows, columns)
    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    points = np.stack([x, y, height], axis=-1)
    along, across = np.gradient(points, axis=1), np.gradient(points, axis=0)
    normals = np.cross(along, across)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    corner = np.arange(rows * columns).reshape(rows, columns)
    quads = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]], axis=-1)
    return Surface(points.reshape(-1, 3), normals.reshape(-1, 3), _split(quads.reshape(-1, 4)))


def geom_surface(mj_model: mujoco.MjModel, geom: int) -> Surface | None:
    """Triangulate a geom in its own frame; None for a plane."""
    kind = mujoco.mjtGeom(mj_model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        return height_field(mj_model, mj_model.geom_dataid[geom])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return mesh(mj_model, mj_model.geom_dataid[geom])
    return _primitive(kind, *mj_model.geom_size[geom].tolist())


@functools.lru_cache(maxsize=256)  # a wheel repeats its forks and pins eighteen times
def _primitive(kind: mujoco.mjtGeom, first: float, second: float, third: float) -> Surface | None:
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return box(np.array([first, second, third]))
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return cylinder(first, second)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return capsule(first, second)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return ellipsoid(np.array([first, first, first]))
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return ellipsoid(np.array([first, second, third]))
    return None


@dataclass(frozen=True)
class Appearance:
    """Visible surface of a body in the body frame, with a colour per vertex."""

    surface: Surface
    colors: NDArray[np.uint8]
    """RGBA colours of the vertices, shape (v, 4)."""


def body_appearance(mj_model: mujoco.MjModel, body: int) -> Appearance | None:
    """Return the surface and colours of a body; None without a visible geom."""
    return _appearance(mj_model, visible_geoms(mj_model, body))


def obstacle_appearance(mj_model: mujoco.MjModel) -> Appearance | None:
    """Return the surface and colours of ramps, thresholds and height fields, without floor patches."""
    standing = [g for g in visible_geoms(mj_model, 0) if not mj_model.geom(g).name.startswith("patch_")]
    return _appearance(mj_model, standing)


def _appearance(mj_model: mujoco.MjModel, geoms: list[int]) -> Appearance | None:
    surfaces, colors = [], []
    for geom in geoms:
        surface = geom_surface(mj_model, geom)
        if surface is None:
            continue
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, mj_model.geom_quat[geom])
        surfaces.append(surface.moved(mj_model.geom_pos[geom], rotation.reshape(3, 3)))
        rgba = np.round(255 * geom_rgba(mj_model, geom)).astype(np.uint8)
        colors.append(np.tile(rgba, (len(surface.vertices), 1)))
    return Appearance(joined(surfaces), np.concatenate(colors)) if surfaces else None


def appearance_key(mj_model: mujoco.MjModel, body: int) -> bytes:
    """Return a key that is equal for bodies of equal `body_appearance`."""
    geoms = visible_geoms(mj_model, body)
    colors = np.array([geom_rgba(mj_model, geom) for geom in geoms])
    numbers = (
        mj_model.geom_type,
        mj_model.geom_dataid,
        mj_model.geom_size,
        mj_model.geom_pos,
        mj_model.geom_quat,
    )
    return b"".join(values[geoms].tobytes() for values in numbers) + colors.tobytes()


def striped(base: Appearance, axis: Array) -> Appearance:
    """Darken two opposite sectors about an axis to make the rotation of a body of revolution visible.

    The axis is in the body frame, of any length, shape (3,).
    """
    axis = axis / np.linalg.norm(axis)
    first = np.cross(axis, [0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0])
    second = np.cross(axis, first)
    # by vertex, so that the viewer blends the edge of the stripe; whole triangles would leave saw teeth
    angle = np.arctan2(base.surface.vertices @ second, base.surface.vertices @ first)
    dark = angle % np.pi < 0.3 * np.pi
    colors = base.colors.copy()
    colors[dark, :3] = (_STRIPE * colors[dark, :3]).astype(np.uint8)
    return Appearance(base.surface, colors)
