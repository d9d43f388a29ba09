"""Poses of the visible model of a machine over a run: recorded, or computed from the driven path.

The twin simulates a reduced model without the geoms for display only. The visible model has the same joints
in the same order, so the same poses apply to both.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from omnimj.plant.mujoco.assembly import rig_model, robot_model
from omnimj.signals import Array, Trace
from omnimj.simulate.scenario.scenario import Scenario

WHEEL_BODY = re.compile(r"^wheel_(\d+)")
_FIRST_HIDDEN_GROUP = 3  # MuJoCo's viewer shows groups 0 to 2; collision geoms are in group 3


@dataclass(frozen=True)
class Poses:
    """Model and its generalised positions over time."""

    mj_model: mujoco.MjModel
    time: Array
    """Times, shape (k,) [s]."""
    qpos: Array
    """Generalised positions, shape (k, nq)."""

    def thinned(self, rate: float) -> Poses:
        """Select at most `rate` poses per second, including the first and the last."""
        keep = thin(self.time, rate)
        return Poses(self.mj_model, self.time[keep], self.qpos[keep])


def thin(time: Array, rate: float) -> NDArray[np.int64]:
    """Select at most `rate` samples per second by index, shape (m,), including the first and the last."""
    if len(time) < 3:
        return np.arange(len(time))
    number = min(len(time), int(np.ceil((time[-1] - time[0]) * rate)) + 1)
    wanted = np.linspace(time[0], time[-1], max(number, 2))
    return np.unique(np.clip(np.searchsorted(time, wanted - 1e-9), 0, len(time) - 1))


@dataclass(frozen=True)
class BodyFrames:
    """World poses of all bodies over time."""

    time: Array
    """Times, shape (k,) [s]."""
    position: Array
    """Positions, shape (k, nbody, 3) [m]."""
    quaternion: Array
    """Orientations as unit quaternions w, x, y, z, shape (k, nbody, 4)."""


def body_frames(poses: Poses) -> BodyFrames:
    """Compute the world poses of every body by `mj_kinematics`, without dynamics or callbacks."""
    mj_model, mj_data = poses.mj_model, mujoco.MjData(poses.mj_model)
    position = np.empty((len(poses.time), mj_model.nbody, 3))
    quaternion = np.empty((len(poses.time), mj_model.nbody, 4))
    for k, qpos in enumerate(poses.qpos):
        mj_data.qpos[:] = qpos
        mujoco.mj_kinematics(mj_model, mj_data)
        position[k], quaternion[k] = mj_data.xpos, mj_data.xquat
    return BodyFrames(poses.time, position, quaternion)


def is_visible(mj_model: mujoco.MjModel, geom: int) -> bool:
    """Check that a geom is for display and not fully transparent."""
    return bool(mj_model.geom_group[geom] < _FIRST_HIDDEN_GROUP and geom_rgba(mj_model, geom)[3] > 0.0)


def geom_rgba(mj_model: mujoco.MjModel, geom: int) -> Array:
    """Return the RGBA colour of a geom, from its material if it has one, shape (4,)."""
    material = mj_model.geom_matid[geom]
    return mj_model.mat_rgba[material] if material >= 0 else mj_model.geom_rgba[geom]


def visible_geoms(mj_model: mujoco.MjModel, body: int) -> list[int]:
    """Return the indices of a body's visible geoms."""
    first, number = mj_model.body_geomadr[body], mj_model.body_geomnum[body]
    return [g for g in range(first, first + number) if is_visible(mj_model, g)]


def _signature(mj_model: mujoco.MjModel, body: int) -> tuple[object, ...] | None:
    """Return a key shared by bodies with the same parent, mesh, mesh pose and colour; None without a mesh."""
    geoms = visible_geoms(mj_model, body)
    if len(geoms) != 1 or mj_model.geom_type[geoms[0]] != mujoco.mjtGeom.mjGEOM_MESH:
        return None
    (g,) = geoms
    place = np.round(np.concatenate([mj_model.geom_pos[g], mj_model.geom_quat[g], geom_rgba(mj_model, g)]), 6)
    return int(mj_model.body_parentid[body]), int(mj_model.geom_dataid[g]), *place.tolist()


def identical_bodies(mj_model: mujoco.MjModel) -> list[list[int]]:
    """Group two or more bodies with the same parent and mesh, such as the rollers of a wheel."""
    groups: defaultdict[tuple[object, ...], list[int]] = defaultdict(list)
    for body in range(1, mj_model.nbody):
        signature = _signature(mj_model, body)
        if signature is not None:
            groups[signature].append(body)
    return [bodies for bodies in groups.values() if len(bodies) > 1]


def hinge_axis(mj_model: mujoco.MjModel, body: int) -> Array | None:
    """Return the axis of the body's first hinge in the body frame, shape (3,); None without a hinge."""
    first, number = mj_model.body_jntadr[body], mj_model.body_jntnum[body]
    for joint in range(first, first + number):
        if mj_model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
            return mj_model.jnt_axis[joint].copy()
    return None


def wheel_bodies(mj_model: mujoco.MjModel, groups: list[list[int]] | None = None) -> list[int]:
    """Return the bodies that turn on a wheel's axle, in the order of the wheels.

    A wheel is a body with rollers: two or more identical children.
    """
    groups = identical_bodies(mj_model) if groups is None else groups
    parents = {int(mj_model.body_parentid[group[0]]) for group in groups}
    return sorted(parents, key=lambda body: _wheel_number(mj_model, body))


def _wheel_number(mj_model: mujoco.MjModel, body: int) -> tuple[int, int]:
    found = WHEEL_BODY.match(mj_model.body(body).name)
    return (int(found[1]) if found else 0, body)


def wheel_axles(poses: Poses, frames: BodyFrames, bodies: list[int]) -> Array:
    """Compute the unit vectors of n wheel axles in the world at k instants, shape (k, n, 3)."""
    axles = np.empty((len(frames.time), len(bodies), 3))
    for i, body in enumerate(bodies):
        axis = hinge_axis(poses.mj_model, body)
        turn = Rotation.from_quat(frames.quaternion[:, body], scalar_first=True)
        axles[:, i] = turn.apply(np.array([0.0, 1.0, 0.0]) if axis is None else axis)
    return axles


def relative_frames(frames: BodyFrames, bodies: list[int], parent: int) -> tuple[Array, Array]:
    """Express the poses of m bodies at k instants in the frame of one parent body.

    Returns:
      Positions, shape (k, m, 3) [m], and quaternions w, x, y, z, shape (k, m, 4).
    """
    turn = Rotation.from_quat(frames.quaternion[:, parent], scalar_first=True)
    place = frames.position[:, bodies] - frames.position[:, parent, None]
    relative = [
        turn.inv() * Rotation.from_quat(frames.quaternion[:, body], scalar_first=True) for body in bodies
    ]
    quaternion = np.stack([rotation.as_quat(scalar_first=True) for rotation in relative], axis=1)
    return place @ turn.as_matrix(), quaternion  # row vectors times R: the inverse rotation


def robot_poses(mj_model: mujoco.MjModel, coordinates: Array) -> Array:
    """Convert x, y [m], heading and n wheel angles [rad], shape (k, 3 + n), to poses, shape (k, nq).

    All other joints keep the model's reference position.
    """
    qpos = np.tile(mj_model.qpos0, (len(coordinates), 1))
    half = 0.5 * coordinates[:, 2]
    (free,) = np.flatnonzero(mj_model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)[:1]
    first = mj_model.jnt_qposadr[free]
    qpos[:, first : first + 2] = coordinates[:, :2]
    qpos[:, first + 3], qpos[:, first + 6] = np.cos(half), np.sin(half)
    for column, body in enumerate(wheel_bodies(mj_model), start=3):
        qpos[:, mj_model.jnt_qposadr[mj_model.body_jntadr[body]]] = coordinates[:, column]
    return qpos


def poses_from_trace(
    mj_model: mujoco.MjModel, trace: Trace, rate: float = 50.0, turned: Array | None = None
) -> Poses:
    """Compute `rate` poses a second from the driven path, for runs without poses (planar model, hardware).

    The wheels turn by the integral of `wheel_speed_i` from the angles `turned`, shape (n,) [rad].
    """
    keep = thin(trace["time"], rate)
    step = np.diff(trace["time"], prepend=trace["time"][0])
    angles = np.cumsum(trace.wheels("wheel_speed") * step[:, None], axis=0)[keep]
    place = np.column_stack([trace[name][keep] for name in ("x", "y", "heading")])
    coordinates = np.column_stack([place, angles if turned is None else angles + turned])
    return Poses(mj_model, trace["time"][keep], robot_poses(mj_model, coordinates))


def visible_model(scenario: Scenario) -> mujoco.MjModel:
    """Compile the machine of a scenario on its floor, including geoms for display."""
    floor = scenario.floors[scenario.floor]
    if scenario.is_rig:
        return rig_model(scenario.rig, floor, scenario.rig_input.mass, patches=scenario.patches)
    return robot_model(scenario.robot, floor, scenario.patches, scene=scenario.scene)


def visible_poses(
    scenario: Scenario, trace: Trace, time: Array | None = None, qpos: Array | None = None
) -> Poses | None:
    """Return the poses of a run for its recording and picture; None if the motion of the machine is unknown.

    Recorded poses have the shape (k, nq) at times of shape (k,) [s]; without them a robot follows `x`, `y`,
    `heading` and wheel speeds.

    Raises:
      ValueError: The poses are not those of the machine in the scenario.
    """
    if time is None or qpos is None:
        known = {"x", "y", "heading", "wheel_speed_1"} <= set(trace.columns)
        return poses_from_trace(visible_model(scenario), trace) if known else None
    mj_model = visible_model(scenario)
    if qpos.shape != (len(time), mj_model.nq):
        raise ValueError(f"poses have shape {qpos.shape}, the machine has {mj_model.nq} coordinates")
    return Poses(mj_model, time, qpos)
