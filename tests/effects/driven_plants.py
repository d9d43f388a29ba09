"""Rig and robot with effects, driven the same way as twin and as equations."""

import functools

import numpy as np

from omnimj.effects import effects_of
from omnimj.parameters import read_floors, read_rig, read_robot
from omnimj.plant.mujoco.twin import RigTwin, RobotTwin
from omnimj.plant.planar import PlanarRobot
from omnimj.plant.planar_rig import PlanarRig
from omnimj.signals import CurrentCommand
from omnimj.simulate.driving import drive_rig

RIG, ROBOT, FLOORS = read_rig(), read_robot(), read_floors()
STONE = FLOORS["natural_stone"]


def selections(effect, most=None):
    """Choices of an effect's selector, at most so many; none of one that takes any name."""
    named = [s for s in effect.selectors if s.choices]
    return [{s.name: choice} for s in named for choice in s.choices[:most]] or [{}]


RIG_CASES = [
    (name, chosen) for name, effect in effects_of("quarter_rig").items() for chosen in selections(effect)
]
"""Every effect of the rig, with every choice of its selector."""
POSE_EFFECTS = ("heading_offset", "pose_scale")
"""Effects of a measured pose, which the plants' own sensors do not show."""
ROBOT_CASES = [
    (name, chosen)
    for name, effect in effects_of("uto_robot").items()
    if name not in (*POSE_EFFECTS, "load_sensitivity")
    for chosen in selections(effect, 2)
]
"""Every other effect of the robot that shows where all wheels carry the same load, with two choices of its
selector."""


def rig_currents(steps):
    """Forward, back, forward, up to the supply's limit [A]."""
    time = np.arange(steps) / 1000.0
    return np.where(time < 0.2, 0.9, np.where(time < 0.3, -0.8, 1.5))


def robot_currents(steps):
    """Along a diagonal while turning, with a reversal [A]."""
    time = np.arange(steps)[:, None] / 1000.0
    share = ROBOT.drive_directions @ np.array([0.77, 0.64])
    share = share / np.abs(share).max() + 0.05
    return np.where(time < 0.6, 0.9, np.where(time < 0.9, -0.7, 1.4)) * share


def rig_run(machine, kind, steps, lateral_speed=0.0, currents=None, **options):
    """Readings [current, wheel speed, carriage speed, acceleration], shape (steps, 4)."""
    options = {"lateral_speed": lateral_speed, "ideal_sensors": True, **options}
    plant = (
        RigTwin(machine, STONE, **options) if kind == "twin" else PlanarRig(machine, STONE.name, **options)
    )
    currents = rig_currents(steps) if currents is None else currents
    trace = drive_rig(plant, np.append(currents, 0.0))  # a row holds what was read before its current
    names = ("current", "wheel_speed", "carriage_speed", "carriage_acceleration")
    return np.column_stack([trace[name][1:] for name in names])


def robot_run(machine, kind, steps, currents=None, **options):
    """Currents, wheel speeds, accelerations, yaw rate, yaw as read, true v_x, v_y, shape (steps, 14)."""
    options = {"ideal_sensors": True, **options}
    plant = (
        RobotTwin(machine, STONE, **options)
        if kind == "twin"
        else PlanarRobot(machine, STONE.name, **options)
    )
    plant.reset()
    rows = []
    for current in robot_currents(steps) if currents is None else currents:
        m = plant.step(CurrentCommand(current))
        body = (*m.acceleration, m.yaw_rate, m.yaw, *plant.truth()[3:5])
        rows.append((*m.current, *m.wheel_speed, *body))
    return np.array(rows)


@functools.cache
def plain(machine, kind, steps, lateral_speed=0.0):
    """The run without effects."""
    if machine == "rig":
        return rig_run(RIG, kind, steps, lateral_speed)
    return robot_run(ROBOT, kind, steps)


def rms(values):
    """Over everything."""
    return float(np.sqrt(np.mean(np.square(values))))
