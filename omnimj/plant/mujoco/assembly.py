"""Compiled MuJoCo models of robot and rig: shape from MJCF, constants from TOML, floors as geoms."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from omnimj.errors import InputError
from omnimj.parameters import Floor, Rig, Robot, read_floors
from omnimj.parameters.floor import TRACTION_SIZE
from omnimj.parameters.parts import GRAVITY
from omnimj.parameters.robot import roller_sin_cos
from omnimj.physics.motor import MOTOR_SIZE, motor_parameters
from omnimj.plant.ground import Patch
from omnimj.plant.mujoco import slots
from omnimj.plant.mujoco.mjcf import (
    ROBOT_FILE,
    compile_spec,
    load_spec,
    native_contact,
    part,
    robot_mjcf,
    vertical_inertia,
    write_wheel,
)
from omnimj.resources import models_folder
from omnimj.signals import Array

_PATCH_COLOURS = {"nylon": (0.93, 0.95, 1.0, 1.0), "oil": (0.16, 0.13, 0.08, 1.0)}
_PATCH_COLOUR = (0.45, 0.58, 0.50, 1.0)
_VISUAL_GROUP = 2
_MAX_PAIRED_FLOORS = 6  # with more, MuJoCo's broad phase is faster
_FLOOR_STORE = (0.0, 0.0, -9.0)  # position of hidden geoms that only hold the parameters of a floor


def bind_floor(mj_model: mujoco.MjModel, geom: int, kind: float, floor: Floor) -> None:
    """Turn a geom into a floor or patch with the traction law of `floor`.

    Args:
      mj_model: Model, changed in place.
      geom: Index of the geom.
      kind: `slots.FLOOR` or `slots.PATCH`.
      floor: Gives the traction law.
    """
    mj_model.geom_user[geom, slots.KIND] = kind
    mj_model.geom_user[geom, slots.TRACTION : slots.TRACTION + TRACTION_SIZE] = floor.row


def wheel_slots(machine: Robot | Rig) -> np.ndarray:
    """Constants of a healthy wheel for `actuator_user`, shape (ACTUATOR_SLOTS,)."""
    row = np.zeros(slots.ACTUATOR_SLOTS)
    wheel, bearing, contact = machine.wheel, machine.bearing, machine.contact
    row[slots.RAIL_JOINT] = row[slots.FLOOR_OVERRIDE] = row[slots.SENSOR] = -1
    row[slots.GRIP] = row[slots.ROLLER_SIN] = 1.0
    row[slots.RADIUS] = wheel.radius
    row[slots.STIFFNESS], row[slots.DAMPING] = contact.stiffness, contact.damping
    row[slots.ROLLER_DRY : slots.ROLLING_RESISTANCE + 1] = (
        wheel.roller_dry,
        wheel.roller_viscous,
        wheel.roller_bristle_stiffness,
        wheel.roller_bristle_damping,
        wheel.roller_grip,
        wheel.roller_coast_time,
        wheel.rolling_resistance,
    )
    row[slots.BEARING_DRY : slots.BEARING_OVERHANG + 1] = (
        bearing.dry,
        bearing.viscous,
        0.5 * bearing.pitch_diameter,
        bearing.spacing,
        bearing.overhang,
    )
    row[slots.MOTOR : slots.MOTOR + MOTOR_SIZE] = motor_parameters(machine.motor)
    return row


def bind_wheels(mj_model: mujoco.MjModel, machine: Robot | Rig, wheels: int) -> None:
    """Mark the model for the native contact; fill the actuators `motor_1 … motor_n` and the rollers' geoms.

    Args:
      mj_model: Model, changed in place.
      machine: Gives the constants of the wheels.
      wheels: Number of wheels.

    Raises:
      InputError: The MJCF lacks a part, or its actuators are not in the order of the wheels.
    """
    for i in range(wheels):
        prefix = f"wheel_{i + 1}_"
        try:
            actuator = mj_model.actuator(f"motor_{i + 1}").id
            axle = mj_model.joint(f"{prefix}axle")
            sensor = mj_model.sensor(f"{prefix}contact")
        except KeyError as error:
            raise InputError("MJCF", f"wheel {i + 1}: {error.args[0]}") from None
        if sensor.dim[0] != len(slots.SENSOR_FIELDS):
            needed = f"the native contact writes {len(slots.SENSOR_FIELDS)} numbers"
            raise InputError("MJCF", f"sensor '{prefix}contact' has dim {sensor.dim[0]}", needed)
        if actuator != i:
            raise InputError(
                "MJCF", f"motor_{i + 1} is actuator {actuator + 1}", "motors come first, in order"
            )
        rollers = [b for b in range(mj_model.nbody) if mj_model.body(b).name.startswith(f"{prefix}roller_")]
        dofs = mj_model.body_dofadr[rollers]
        if not np.array_equal(dofs, np.arange(dofs[0], dofs[0] + len(rollers))):
            raise InputError("MJCF", f"the rollers of wheel {i + 1} are not consecutive bodies")
        row = wheel_slots(machine)
        row[[slots.ROLLER_SIN, slots.ROLLER_COS]] = roller_sin_cos(machine.roller_angles[i])
        row[slots.WHEEL_BODY], row[slots.WHEEL_DOF] = axle.bodyid[0], axle.dofadr[0]
        row[slots.FIRST_ROLLER_DOF], row[slots.ROLLER_COUNT] = dofs[0], len(rollers)
        row[slots.SENSOR], row[slots.ANGLE_ADDRESS] = sensor.adr[0], axle.qposadr[0]
        mj_model.actuator_user[i] = row
        for body in rollers:
            geom = mj_model.geom(mj_model.body(body).name).id
            mj_model.geom_user[geom, slots.KIND] = slots.ROLLER
            mj_model.geom_user[geom, slots.ROLLER_WHEEL] = i
    mj_model.actuator_user[0, slots.MAGIC] = slots.MAGIC_NUMBER
    mj_model.actuator_user[0, slots.WHEELS] = wheels


def bind_rail(mj_model: mujoco.MjModel, rig: Rig, weight: float) -> None:
    """Write the friction of the rail into its joint, and the index of the joint into the wheel's slots.

    Args:
      mj_model: Model, changed in place.
      rig: Gives the constants of the rail.
      weight: Weight of the quarter body [N].
    """
    body, rail = rig.rig, mj_model.joint("rail").id
    mj_model.jnt_user[rail] = (
        body.rail_friction,
        body.rail_dry,
        body.rail_viscous,
        body.rail_half_width,
        body.rail_height,
        body.contact_offset,
        body.com_offset,
        weight,
        body.rail_load_time,
    )
    mj_model.actuator_user[0, slots.RAIL_JOINT] = rail
    mj_model.actuator_user[0, slots.POSITION_ADDRESS] = mj_model.jnt_qposadr[rail]


def bind_effects(mj_model: mujoco.MjModel, terms: Array, measured_current: bool) -> None:
    """Write effects into the wheels' slots, and remove the limits if commands are measured currents.

    Args:
      mj_model: Model that `bind_wheels` has filled.
      terms: Packed effect terms, shape (wheels, TERMS).
      measured_current: Whether commands are measured currents.
    """
    wheels, columns = terms.shape
    mj_model.actuator_user[:wheels, slots.EFFECT_TERMS : slots.EFFECT_TERMS + columns] = terms
    if measured_current:
        mj_model.actuator_ctrllimited[:wheels] = 0


def _add_floors(spec: mujoco.MjSpec, patches: Sequence[Patch], extra: Iterable[str]) -> None:
    """Add patches as flat geoms in their order, and hidden geoms with the floors of `slip` faults."""
    spec.nuser_geom, spec.nuser_actuator = slots.GEOM_SLOTS, slots.ACTUATOR_SLOTS
    spec.nuser_jnt = slots.JOINT_SLOTS
    for k, patch in enumerate(patches, start=1):
        half = (0.5 * patch.size[0], 0.5 * patch.size[1], 0.0005)
        spec.worldbody.add_geom(
            name=f"patch_{k}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=half,
            pos=(*patch.center, -0.0004 + 1e-5 * k),  # slightly above the floor, against flicker
            euler=(0.0, 0.0, math.degrees(patch.yaw) if spec.compiler.degree else patch.yaw),
            rgba=_PATCH_COLOURS.get(patch.floor, _PATCH_COLOUR),
            contype=0,
            conaffinity=0,
            group=0,
        )
    for name in dict.fromkeys(extra):
        spec.worldbody.add_geom(
            name=f"floor_{name}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=(0.001, 0.0, 0.0),
            pos=_FLOOR_STORE,
            contype=0,
            conaffinity=0,
            group=5,
        )


def _remove_visual_parts(spec: mujoco.MjSpec) -> None:
    """Remove the parts that a step does not need, which take half of its time.

    Three of four geoms are visual only. MuJoCo's broad phase sorts 72 rollers in every step; the few
    roller-floor pairs are tested faster one by one. The accelerometer makes MuJoCo compute the accelerations
    of all bodies.
    """
    for geom in [g for g in spec.geoms if g.group == _VISUAL_GROUP]:
        spec.delete(geom)
    for sensor in [s for s in spec.sensors if s.type == mujoco.mjtSensor.mjSENS_ACCELEROMETER]:
        spec.delete(sensor)
    floors = [g for g in spec.geoms if int(g.conaffinity) & 2]
    if len(floors) > _MAX_PAIRED_FLOORS:
        return
    for floor in floors:
        floor.conaffinity = int(floor.conaffinity) & ~2
    for roller in [g for g in spec.geoms if g.contype == 2]:
        roller.contype = 0
        for floor in floors:
            spec.add_pair(
                geomname1=floor.name, geomname2=roller.name, margin=roller.margin, gap=roller.gap, condim=3
            )


def _compile(
    spec: mujoco.MjSpec,
    floor: Floor,
    patches: Sequence[Patch],
    extra: Iterable[str],
    floors: Mapping[str, Floor],
    lean: bool,
    path: Path,
) -> mujoco.MjModel:
    floor_geoms = [g for g in spec.geoms if int(g.conaffinity) & 2]  # geoms that rollers may touch
    for k, geom in enumerate(floor_geoms):
        geom.name = geom.name or f"unnamed_floor_{k}"
    floor_names = [g.name for g in floor_geoms]
    if lean:
        _remove_visual_parts(spec)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)  # a diverged run must show
    mj_model = compile_spec(spec, path)
    ids = [mj_model.geom(f"patch_{k}").id for k in range(1, len(patches) + 1)]
    for name in floor_names:
        geom = mj_model.geom(name).id
        bind_floor(mj_model, geom, slots.FLOOR, floor)
        if mj_model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE and ids:
            mj_model.geom_user[geom, slots.FIRST_PATCH : slots.PATCH_COUNT + 1] = ids[0], len(ids)
    for geom, patch in zip(ids, patches, strict=True):
        bind_floor(mj_model, geom, slots.PATCH, floors[patch.floor])
    for name in dict.fromkeys(extra):
        bind_floor(mj_model, mj_model.geom(f"floor_{name}").id, slots.PATCH, floors[name])
    return mj_model


def rest_depth(robot: Robot) -> float:
    """Depth of each wheel contact under the weight of the robot, m g/(n k) [m]."""
    return robot.body.mass * GRAVITY / len(robot.wheels) / robot.contact.stiffness


def _write_body(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Write masses, corners and suspension of the robot."""
    body, count = robot.body, len(robot.wheels)
    corners = [b.name for b in spec.bodies if b.name.startswith("corner_")]
    if len(corners) != count:
        found, rule = f"has {len(corners)} bodies corner_1, corner_2, …", f"{robot.file} has {count} wheels"
        raise InputError(f"MJCF model '{spec.modelname}'", found, rule)
    chassis = part(spec, "body", "chassis")
    sprung = body.mass - count * body.unsprung_mass
    chassis.mass = sprung
    # corners have their centre of mass at the height of the axles
    chassis.ipos = [0.0, 0.0, body.mass * (body.com_height - robot.wheel.radius) / sprung]
    chassis.pos = [0.0, 0.0, robot.wheel.radius - rest_depth(robot)]
    part(spec, "site", "centre").pos = [*robot.accelerometer, 0.0]  # of accelerometer and gyro
    rest = 0.0
    for i, mount in enumerate(robot.wheels, start=1):
        corner, guide = part(spec, "body", f"corner_{i}"), part(spec, "joint", f"guide_{i}")
        yaw = math.atan2(mount.drives_along[1], mount.drives_along[0])
        corner.pos = [*mount.position, 0.0]
        corner.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        corner.quat = [math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)]
        corner.mass = body.unsprung_mass - robot.wheel.mass
        inward = np.array(mount.position) - 0.06 * np.array([-math.sin(yaw), math.cos(yaw)])
        rest += corner.mass * float(inward @ inward) + corner.inertia[2]
        rest += robot.wheel.mass * float(np.dot(mount.position, mount.position))
        rest += vertical_inertia(robot.wheel, mount.roller_angle)
        guide.stiffness = [body.suspension_stiffness, 0.0, 0.0]
        guide.damping = [body.suspension_damping, 0.0, 0.0]
        guide.springref = -sprung * GRAVITY / count / body.suspension_stiffness
        guide.range = [-0.5 * body.suspension_travel, 0.5 * body.suspension_travel]
    about_vertical = body.yaw_inertia - rest
    if about_vertical <= 0.0:
        raise InputError(
            f"{robot.file}: body.yaw_inertia",
            f"found {body.yaw_inertia:g}",
            f"the corners alone have {rest:.3g} kg.m2",
        )
    chassis.inertia = [0.643 * about_vertical, 0.643 * about_vertical, about_vertical]


def robot_model(
    robot: Robot,
    floor: Floor,
    patches: Sequence[Patch] = (),
    extra_floors: Iterable[str] = (),
    floors: Mapping[str, Floor] | None = None,
    scene: Path | None = None,
    lean: bool = False,
) -> mujoco.MjModel:
    """Compile the robot on a floor, with all its parameters.

    Args:
      robot: Constants of the robot.
      floor: Floor outside the patches.
      patches: Patches of other floors; where they overlap, the later one is on top.
      extra_floors: Names of floors that a fault may put under a wheel.
      floors: Floors by name; the shipped ones when None.
      scene: Another MJCF scene (ramps, thresholds, height fields) that includes the robot.
      lean: Whether to speed up steps at the same result: no visual parts, no accelerometer (the twin reads
        accelerations from `qacc`), contacts tested pair by pair.

    Raises:
      InputError: The MJCF cannot be read, or the constants do not fit it.
    """
    floors = read_floors() if floors is None else floors
    path = models_folder() / "uto_robot" / "scene.xml" if scene is None else scene
    spec = load_spec(path, {ROBOT_FILE: robot_mjcf(robot, models_folder() / "uto_robot" / ROBOT_FILE)})
    _write_body(spec, robot)
    for i, mount in enumerate(robot.wheels, start=1):
        write_wheel(spec, f"wheel_{i}_", robot.wheel, robot.motor, mount.roller_angle)
        native_contact(spec, f"wheel_{i}_", f"motor_{i}", slots.ACTIVATIONS)
    extra = tuple(extra_floors)
    _add_floors(spec, patches, extra)
    mj_model = _compile(spec, floor, patches, extra, floors, lean, path)
    bind_wheels(mj_model, robot, len(robot.wheels))
    return mj_model


def rig_model(
    rig: Rig,
    floor: Floor,
    mass: float | None = None,
    extra_floors: Iterable[str] = (),
    patches: Sequence[Patch] = (),
    lean: bool = False,
    floors: Mapping[str, Floor] | None = None,
) -> mujoco.MjModel:
    """Compile the quarter test rig on a floor, with all its parameters.

    Args:
      rig: Constants of the rig.
      floor: Floor outside the patches.
      mass: Mass m_T of the quarter body [kg]; the first of the rig's masses when None.
      extra_floors: Names of floors that a fault may put under the wheel.
      patches: Patches of other floors.
      lean: Whether to speed up steps, as in `robot_model`.
      floors: Floors by name; the shipped ones when None.

    Raises:
      InputError: The mass leaves nothing for the body, or the MJCF cannot be read.
    """
    body, wheel = rig.rig, rig.wheel
    mass = body.masses[0] if mass is None else mass
    if not mass > wheel.mass:
        raise InputError(
            f"{rig.file}: mass", f"found {mass:g}", f"must be above the wheel's {wheel.mass:g} kg"
        )
    path = models_folder() / "quarter_rig" / "scene.xml"
    spec = load_spec(path)
    own = mass - wheel.mass
    height = (mass * body.com_height - wheel.mass * wheel.radius) / own
    carriage, gantry = part(spec, "body", "carriage"), part(spec, "body", "gantry")
    carriage.mass = own
    carriage.ipos = [0.0, mass * body.com_offset / own, height - body.rail_height]
    carriage.inertia = [body.tilt_inertia, body.tilt_inertia, 0.67 * body.tilt_inertia]
    gantry.pos = [0.0, 0.0, body.rail_height]
    gantry.mass = body.gantry_mass
    part(spec, "joint", "rail").range = [-body.start_position, body.rail_length - body.start_position]
    part(spec, "joint", "gantry").range = [-body.lateral_travel, body.lateral_travel]
    limit = math.degrees(body.tilt_limit) if spec.compiler.degree else body.tilt_limit
    part(spec, "joint", "tilt").range = [-limit, limit]
    part(spec, "site", "centre").pos = [0.0, 0.0, body.com_height - body.rail_height]
    part(spec, "body", "wheel_1_wheel").pos = [0.0, body.contact_offset, 0.0]
    drive = part(spec, "actuator", "gantry")
    drive.gainprm[0], drive.biasprm[2] = body.gantry_gain, -body.gantry_gain
    write_wheel(spec, "wheel_1_", wheel, rig.motor)
    native_contact(spec, "wheel_1_", "motor_1", slots.LATERAL_LOAD + 1)
    extra = tuple(extra_floors)
    _add_floors(spec, patches, extra)
    floors = read_floors() if floors is None else floors
    mj_model = _compile(spec, floor, patches, extra, floors, lean, path)
    bind_wheels(mj_model, rig, 1)
    bind_rail(mj_model, rig, mass * GRAVITY)
    return mj_model
