"""Play between motor and link: against two masses with a stiff contact between them, and in a replay."""

import functools
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from axis_logs import AXIS, COULOMB, DRIVE_MASS, MASS, VISCOUS, axis_moves

from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.mjcf.kernels import (
    ARMATURE,
    DAMPING,
    DRY,
    GAIN,
    GEAR,
    HIGH,
    LAW,
    LOW,
    PLAY,
    REST_SPEED,
)
from omnimj.estimate.replay.mjcf.play import Drive, JointMotion, follow_links, follow_motors
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.dataset import Dataset
from omnimj.resources import models_folder
from omnimj.simulate.machine.linear_axis import as_machine_logs

MACHINE = read_machine_file(models_folder() / "linear_axis" / "linear_axis.xml")
PERIOD, WIDE = 1e-3, 4e-4


class Two(NamedTuple):
    """States of motor and link in every sample, shape (n,) each."""

    position: np.ndarray
    """Of the link [m]."""
    speed: np.ndarray
    gap: np.ndarray
    """Motor − link [m]."""
    motor_speed: np.ndarray


def force_at(time):
    return 60.0 * np.sin(5.0 * time) + 25.0 * np.sin(14.0 * time)


@functools.cache
def two_masses(duration=4.0, stiffness=1e8, fine=50):
    """Motor and link under a force of two sines, in steps of 20 µs; a damped contact, smooth friction."""
    h, count = PERIOD / fine, round(duration / PERIOD)
    damping = 2.0 * math.sqrt(stiffness * DRIVE_MASS)
    x = v = w = 0.0
    gap, rows = 0.5 * WIDE, np.empty((4, count))
    forces = force_at(np.arange(count * fine) * h).tolist()
    for k, force in enumerate(forces):
        if k % fine == 0:
            rows[:, k // fine] = x, v, gap, w
        beyond = abs(gap) - 0.5 * WIDE
        side = 1.0 if gap > 0.0 else -1.0
        push = side * max(stiffness * beyond + damping * side * (w - v), 0.0) if beyond > 0.0 else 0.0
        friction = VISCOUS * v + COULOMB * math.tanh(v / 1e-4)
        w += h * (force - push) / DRIVE_MASS
        v += h * (push - friction) / (MASS - DRIVE_MASS)
        x += h * v
        gap += h * (w - v)
    return Two(*rows)


@pytest.mark.slow
def test_the_link_moves_behind_the_motor_as_the_second_of_two_masses(measured):
    states = two_masses()
    law = np.zeros(LAW)
    law[PLAY], law[REST_SPEED], law[DAMPING], law[DRY] = WIDE, 1e-5, VISCOUS, COULOMB
    position, speed = states.position + states.gap, states.motor_speed.copy()
    acceleration = np.gradient(speed, PERIOD)
    mass = np.full(len(speed), MASS - DRIVE_MASS)
    found, stretches = np.empty((4, len(speed))), np.array([[0, len(speed), 0, 0]])
    motion = JointMotion(position, speed, acceleration, mass * acceleration, mass)
    follow_links(law, stretches, PERIOD, motion, found)
    gap = np.abs(found[0] - states.gap)
    measured("gap of play against two masses, mean over the width [1]", gap.mean() / WIDE, 0.03)
    assert gap.mean() < 0.03 * WIDE
    assert np.abs(found[2] - states.speed).mean() < 0.01 * np.abs(states.speed).max()
    apart = np.abs(states.gap) < 0.49 * WIDE
    assert 0.02 < apart.mean() < 0.5 and (found[3][apart] == 0.0).mean() > 0.9


@pytest.mark.slow
def test_the_motor_moves_before_the_link_as_the_first_of_two_masses(measured):
    states, inertia = two_masses(), DRIVE_MASS
    law = np.zeros(LAW)
    law[[GEAR, GAIN]], law[[LOW, HIGH]] = 1.0, (-np.inf, np.inf)
    law[PLAY], law[ARMATURE], law[DAMPING], law[DRY] = WIDE, inertia, VISCOUS, COULOMB
    forces = force_at(np.arange(len(states.speed)) * PERIOD)
    position, speed = states.position.copy(), states.speed.copy()
    acceleration, mass = np.gradient(speed, PERIOD), np.full(len(speed), MASS - inertia)
    motion = JointMotion(position, speed, acceleration, mass * acceleration, mass)
    found, stretches, on = np.empty(len(speed)), np.array([[0, len(speed), 0, 0]]), np.ones(len(speed), bool)
    follow_motors(law, stretches, PERIOD, Drive(forces, on), motion, found)
    ahead = np.cumsum(found) * PERIOD / inertia  # speed of the motor beyond that of the link
    apart = np.abs(states.gap) < 0.49 * WIDE
    true = states.motor_speed - states.speed
    error = np.abs(ahead - true).mean() / np.abs(true[apart]).max()
    measured("speed of a motor before its play, mean error over the largest [1]", error, 0.02)
    assert error < 0.02


@pytest.fixture(scope="module", params=["encoder on the motor", "encoder on the link"])
def loose(request):
    on_link = request.param == "encoder on the link"
    axis = replace(AXIS, encoders_on_links=AXIS.joints if on_link else ())
    run = axis_moves({"backlash": {"angle": 3e-4}}, 1, axis=axis, count=1)[0]
    machine = replace(MACHINE, encoders_on_links=axis.encoders_on_links)
    return MachineReplay(as_machine_logs(Dataset(MACHINE.file, "linear_axis", (run,)), machine), machine)


@pytest.mark.slow
def test_a_play_in_the_logs_is_explained_by_its_width(loose):
    base = np.array([b.nominal for b in loose.base])
    rest = {}
    for width in (0.0, 1.5e-4, 3e-4, 4.5e-4):
        effects = {"backlash (carriage)": np.array([width])}
        (found,) = loose.simulate([Setting(base, effects)])
        rest[width] = float(np.sqrt(np.nanmean((loose.measured - found)[:, 0] ** 2)))
    assert min(rest, key=rest.__getitem__) == 3e-4
    assert rest[3e-4] < 0.3 * rest[0.0]


@pytest.mark.slow
def test_momentum_is_kept_where_motor_and_link_meet(loose):
    """The force over a landing is that of both masses: what play adds has no mean beyond its rows."""
    base = np.array([b.nominal for b in loose.base])
    settings = [Setting(base), Setting(base, {"backlash (carriage)": np.array([3e-4])})]
    plain, other = loose.simulate(settings)
    change = (other - plain)[:, 0]
    assert abs(np.nanmean(change)) < 0.05 * np.nanstd(change)
