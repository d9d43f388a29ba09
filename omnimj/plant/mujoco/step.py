"""One control period of the twins as kernels: MuJoCo's step by its address, readings, truth.

The stepwise plant takes the same readings by the same kernel, so that both ways give the same numbers.
"""

from __future__ import annotations

import ctypes
import functools
import math
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from llvmlite import ir
from numba import types
from numpy.typing import NDArray

from omnimj.physics.native import inlined, kernel
from omnimj.plant.mujoco import slots
from omnimj.plant.mujoco.memory import elapsed_time, intrinsic
from omnimj.plant.sensor_chain import SensorChain, read_sensors
from omnimj.signals import Array

FULL_TURN = 2.0 * math.pi
RAIL, TILT, GANTRY, AXLE = range(4)
"""Indices of `RigTwinArrays.joints`."""
JOINTS = ("rail", "tilt", "gantry", "wheel_1_axle")
"""Names of these joints in the model."""


class TwinArrays(NamedTuple):
    """MuJoCo's arrays of a robot with n wheels, its sensors and the time steps so far."""

    step: int
    """Address of `mj_step`."""
    model: int
    """Address of mjModel."""
    data: int
    """Address of mjData."""
    substeps: int
    """Simulation steps per control period."""
    period: float
    """Control period [s]."""
    ctrl: Array
    """Set currents, shape (n,) [A]."""
    shorted: Array
    """1 for motors that are shorted, shape (n,)."""
    braked: NDArray[np.uint8]
    """Mask of the motors that a command has shorted, shape (n,)."""
    currents: Array
    """Shape (n,) [A]."""
    backlash_rates: Array
    """Speed of the motor ahead of the wheel, shape (n,) [rad/s]."""
    axles: Array
    """Degrees of freedom of the axles, shape (n,), integers."""
    qpos: Array
    qvel: Array
    qacc: Array
    gravity: Array
    """Shape (3,) [m/s²]."""
    axes: Array
    """Rotation of the chassis, shape (3, 3)."""
    gyro: Array
    """Shape (3,) [rad/s]."""
    accelerometer: Array
    """Place of the accelerometer ahead of the centre and to its left, shape (2,) [m]."""
    sensed: Array
    """Slip velocity, normal force, traction of the wheels, shape (3, n) [m/s, N, N]."""
    turns: Array
    """Unwrapped heading at the last reading and its whole turns, shape (2,) [rad]."""
    steps: Array
    """Control periods since the start, shape (1,), integer."""
    values: Array
    """Physical quantities for the sensors, shape (2n+4,)."""
    sensors: SensorChain


@functools.cache
def function_address(name: str = "mj_step") -> int:
    """Address of a function of the MuJoCo library that this process has loaded."""
    library = ctypes.CDLL(_library_path())
    return int(ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0)


def step_address() -> int:
    """Address of `mj_step`."""
    return function_address()


def _library_path() -> str:
    folder = Path(mujoco.__file__).parent
    names = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
    return str(next(path for name in names for path in sorted(folder.glob(name))))


@intrinsic
def call_step(typingctx, step, model, data):
    """Call `mj_step(model, data)`, or another function with these arguments, at an address."""

    def codegen(context, builder, signature, arguments):
        pointer = ir.IntType(8).as_pointer()
        function = ir.FunctionType(ir.VoidType(), [pointer, pointer])
        target = builder.inttoptr(arguments[0], function.as_pointer())
        builder.call(target, [builder.inttoptr(argument, pointer) for argument in arguments[1:]])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), codegen


@kernel
def unwrap_heading(quaternion, turns):
    """Unwrapped heading [rad]; a diverged state, which is not finite, leaves the count of turns alone.

    Args:
      quaternion: Orientation of the chassis w, x, y, z, shape (4,).
      turns: Of `TwinArrays`, changed in place.
    """
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    turn = heading + turns[1] - turns[0]
    if math.isfinite(turn):
        turns[1] -= FULL_TURN * np.rint(turn / FULL_TURN)
    turns[0] = heading + turns[1]
    return turns[0]


@kernel
def measure_twin(twin):
    """Readings of all sensors now, a new array of shape (2n+4,).

    Accelerometer: Rᵀ(a − g) + ω̇ × r + ω × (ω × r) at its place r. The chassis is a free joint at the centre,
    whose accelerations are a, in the world, and ω̇, in the body. The encoders sit on the motors.
    """
    n, values = twin.currents.size, twin.values
    for i in range(n):
        values[i] = twin.currents[i]
        values[n + i] = twin.qvel[twin.axles[i]] + twin.backlash_rates[i]
    for k in range(2):
        values[2 * n + k] = 0.0
        for j in range(3):
            values[2 * n + k] += (twin.qacc[j] - twin.gravity[j]) * twin.axes[j, k]
    x, y = twin.accelerometer[0], twin.accelerometer[1]
    w_x, w_y, w_z = twin.gyro[0], twin.gyro[1], twin.gyro[2]
    values[2 * n] += w_x * w_y * y - (w_y * w_y + w_z * w_z) * x - twin.qacc[5] * y
    values[2 * n + 1] += w_x * w_y * x - (w_x * w_x + w_z * w_z) * y + twin.qacc[5] * x
    values[2 * n + 2] = twin.gyro[2]
    values[2 * n + 3] = unwrap_heading(twin.qpos[3:7], twin.turns)
    return read_sensors(twin.sensors, twin.steps[0] * twin.period, values)


@kernel
def short_motors(twin, brake):
    """Short the motors of a mask, shape (n,), and no others, unless a command has already done so."""
    changes = False
    for i in range(brake.size):
        changes = changes or (brake[i] != 0) != (twin.braked[i] != 0)
    if changes:
        for i in range(brake.size):
            twin.shorted[i] = twin.braked[i] = 1 if brake[i] else 0


@inlined
def finish_period(twin):
    """Simulate one control period of a twin of robot or rig with the set currents in `ctrl`."""
    for _ in range(twin.substeps):
        call_step(twin.step, twin.model, twin.data)
    twin.steps[0] += 1


@inlined
def step_twin(twin, current):
    """Hold set currents, shape (n,) [A], for one control period and return the readings at its end."""
    twin.ctrl[:] = current
    finish_period(twin)
    return measure_twin(twin)


@kernel
def twin_time(twin):
    """Time of the simulation of a twin of robot or rig [s]."""
    return elapsed_time(twin.data)


@kernel
def write_twin_truth(twin, truth):
    """Write pose, body twist, slip, normal force and traction in the order of `robot_truth_names`."""
    n, heading = twin.currents.size, twin.turns[0]
    c, s = math.cos(heading), math.sin(heading)
    vx, vy = twin.qvel[0], twin.qvel[1]
    truth[0], truth[1], truth[2] = twin.qpos[0], twin.qpos[1], heading
    truth[3], truth[4], truth[5] = c * vx + s * vy, c * vy - s * vx, twin.qvel[5]
    for k in range(3):
        for i in range(n):
            truth[6 + k * n + i] = twin.sensed[k, i]


class RigTwinArrays(NamedTuple):
    """MuJoCo's arrays of a rig, its sensors and the time steps so far."""

    step: int
    """Address of `mj_step`."""
    model: int
    """Address of mjModel."""
    data: int
    """Address of mjData."""
    substeps: int
    """Simulation steps per control period."""
    period: float
    """Control period [s]."""
    lateral_speed: float
    """Commanded speed of the gantry [m/s]."""
    ctrl: Array
    """Set current [A] and speed of the gantry [m/s], shape (2,)."""
    act: Array
    """Activations of the wheel's actuator."""
    joints: NDArray[np.int_]
    """Places of `JOINTS` in `qpos`, `qvel` and `qacc`, shape (4,)."""
    qpos: Array
    qvel: Array
    qacc: Array
    gravity: Array
    """Shape (3,) [m/s²]."""
    sensed: Array
    """Slip velocity [m/s], normal force, traction and lateral force [N], then others."""
    steps: Array
    """Control periods since the start, shape (1,), integer."""
    values: Array
    """Physical quantities for the sensors, shape (5,)."""
    sensors: SensorChain


@kernel
def measure_rig_twin(twin):
    """Readings of all sensors now, a new array in the order of `RIG_CHANNELS`.

    The encoder of the wheel sits on the motor.
    """
    values, joints, speed = twin.values, twin.joints, twin.qvel
    values[0] = twin.act[slots.CURRENT]
    values[1] = speed[joints[AXLE]] + twin.act[slots.BACKLASH_RATE]
    values[2] = speed[joints[RAIL]]
    values[3] = twin.qacc[joints[RAIL]] - twin.gravity[0]
    values[4] = speed[joints[GANTRY]]
    return read_sensors(twin.sensors, twin.steps[0] * twin.period, values)


@inlined
def step_rig_twin(twin, current):
    """Hold a set current [A] for one control period and return the readings at its end."""
    twin.ctrl[0], twin.ctrl[1] = current, twin.lateral_speed
    finish_period(twin)
    return measure_rig_twin(twin)


@kernel
def write_rig_twin_truth(twin, truth):
    """Write the true values in the order of `RIG_TRUTH_NAMES`."""
    place, speed, joints = twin.qpos, twin.qvel, twin.joints
    truth[0], truth[1], truth[2] = place[joints[RAIL]], speed[joints[RAIL]], speed[joints[AXLE]]
    truth[3], truth[4] = place[joints[GANTRY]], place[joints[TILT]]
    for k in range(4):
        truth[5 + k] = twin.sensed[k]
