"""One control period of the rig's twin as a kernel: MuJoCo's step by its address, readings, truth.

The stepwise plant takes the same readings by the same kernel, so that both ways give the same numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnimj.physics.native import inlined, kernel
from omnimj.plant.mujoco import slots
from omnimj.plant.mujoco.robot_step import finish_period
from omnimj.plant.sensor_chain import SensorChain, read_sensors
from omnimj.signals import Array

RAIL, TILT, GANTRY, AXLE = range(4)
"""Indices of `RigTwinArrays.joints`."""
JOINTS = ("rail", "tilt", "gantry", "wheel_1_axle")
"""Names of these joints in the model."""


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
