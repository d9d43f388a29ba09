"""Play between motor and link: against two masses integrated by the axis' equations, and in a replay."""

from dataclasses import replace

import numpy as np
import pytest

from omnimj.effects import with_effects
from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.mjcf.axis import as_machine_logs
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
from omnimj.estimate.replay.mjcf.play import follow_links, follow_motors
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.parameters import read_axis
from omnimj.physics.axis import DRIVE_SPEED, GAP, POSITION, SPEED, frozen, step
from omnimj.plant.axis import axis_row, drive_axis, servo
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.dataset import Dataset, Run
from omnimj.resources import models_folder
from omnimj.simulate.suites.axis import wander

AXIS = read_axis()
MACHINE = read_machine_file(models_folder() / "linear_axis" / "linear_axis.xml")
PERIOD, WIDE = 1e-3, 4e-4


def two_masses(duration=4.0):
    """States of drive and carriage under a force of two sines, at 20 steps per sample."""
    row = frozen(axis_row(with_effects(AXIS, {"backlash": {"angle": WIDE}})))
    state, states, fine = (0.0, 0.0, 0.5 * WIDE, 0.0, 0.0), [], 20
    for k in range(round(duration / PERIOD)):
        states.append(state)
        for s in range(fine):
            t = (k + (s + 0.5) / fine) * PERIOD
            force = 60.0 * np.sin(5.0 * t) + 25.0 * np.sin(14.0 * t)
            state = step(row, state, force, PERIOD / fine)
    return np.array(states)


def test_the_link_moves_behind_the_motor_as_the_second_of_two_masses(measured):
    states = two_masses()
    law = np.zeros(LAW)
    law[PLAY], law[REST_SPEED], law[DAMPING], law[DRY] = WIDE, 1e-5, AXIS.axis.viscous, AXIS.axis.coulomb
    position, speed = states[:, POSITION] + states[:, GAP], states[:, DRIVE_SPEED].copy()
    acceleration = np.gradient(speed, PERIOD)
    mass = np.full(len(speed), AXIS.axis.mass - AXIS.axis.drive_mass)
    found, stretches = np.empty((4, len(speed))), np.array([[0, len(speed), 0, 0]])
    follow_links(law, stretches, PERIOD, position, speed, acceleration, mass * acceleration, mass, found)
    gap = np.abs(found[0] - states[:, GAP])
    measured("gap of play against two masses, mean over the width [1]", gap.mean() / WIDE, 0.03)
    assert gap.mean() < 0.03 * WIDE
    assert np.abs(found[2] - states[:, SPEED]).mean() < 0.01 * np.abs(states[:, SPEED]).max()
    apart = np.abs(states[:, GAP]) < 0.49 * WIDE
    assert 0.02 < apart.mean() < 0.5 and (found[3][apart] == 0.0).mean() > 0.9


def test_the_motor_moves_before_the_link_as_the_first_of_two_masses(measured):
    states, inertia = two_masses(), AXIS.axis.drive_mass
    law = np.zeros(LAW)
    law[[GEAR, GAIN]], law[[LOW, HIGH]] = 1.0, (-np.inf, np.inf)
    law[PLAY], law[ARMATURE], law[DAMPING], law[DRY] = WIDE, inertia, AXIS.axis.viscous, AXIS.axis.coulomb
    times = np.arange(len(states)) * PERIOD
    forces = 60.0 * np.sin(5.0 * times) + 25.0 * np.sin(14.0 * times)
    position, speed = states[:, POSITION].copy(), states[:, SPEED].copy()
    acceleration, mass = np.gradient(speed, PERIOD), np.full(len(speed), AXIS.axis.mass - inertia)
    columns = (forces, position, speed, acceleration, mass * acceleration, mass)
    found, stretches, on = np.empty(len(speed)), np.array([[0, len(speed), 0, 0]]), np.ones(len(speed), bool)
    follow_motors(law, stretches, PERIOD, on, *columns, found)
    ahead = np.cumsum(found) * PERIOD / inertia  # speed of the motor beyond that of the link
    apart = np.abs(states[:, GAP]) < 0.49 * WIDE
    true = states[:, DRIVE_SPEED] - states[:, SPEED]
    error = np.abs(ahead - true).mean() / np.abs(true[apart]).max()
    measured("speed of a motor before its play, mean error over the largest [1]", error, 0.02)
    assert error < 0.02


@pytest.fixture(scope="module", params=["encoder on the motor", "encoder on the link"])
def loose(request):
    on_link = request.param == "encoder on the link"
    sensors = replace(AXIS.sensors, encoder_at_drive=int(not on_link))
    axis = with_effects(replace(AXIS, sensors=sensors), {"backlash": {"angle": 3e-4}})
    path = wander(0.1, 0.3, 12.0, PERIOD)
    columns = drive_axis(axis, path, servo(AXIS), seed=1)
    run = Run("a", {name: columns[name] for name in ("time", "force", "position")}, {}, {})
    machine = replace(MACHINE, encoders_on_links=MACHINE.joints if on_link else ())
    return MachineReplay(as_machine_logs(Dataset(MACHINE.file, "linear_axis", (run,)), machine), machine)


def test_a_play_in_the_logs_is_explained_by_its_width(loose):
    base = np.array([b.nominal for b in loose.base])
    rest = {}
    for width in (0.0, 1.5e-4, 3e-4, 4.5e-4):
        effects = {"backlash (carriage)": np.array([width])}
        (found,) = loose.simulate([Setting(base, effects)])
        rest[width] = float(np.sqrt(np.nanmean((loose.measured - found)[:, 0] ** 2)))
    assert min(rest, key=rest.__getitem__) == 3e-4
    assert rest[3e-4] < 0.3 * rest[0.0]


def test_momentum_is_kept_where_motor_and_link_meet(loose):
    """The force over a landing is that of both masses: what play adds has no mean beyond its rows."""
    base = np.array([b.nominal for b in loose.base])
    settings = [Setting(base), Setting(base, {"backlash (carriage)": np.array([3e-4])})]
    plain, other = loose.simulate(settings)
    change = (other - plain)[:, 0]
    assert abs(np.nanmean(change)) < 0.05 * np.nanstd(change)
