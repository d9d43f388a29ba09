"""Logs of a linear axis in the replay of any machine: one slide with a measured force."""

import dataclasses
import functools
import math

import numpy as np
import pytest
from axis_logs import FORCE_CONSTANT, FORCE_NOISE, axis_moves
from axis_reference import log_of, sign
from scipy.signal import savgol_filter

from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.gap.search.screening import screen_candidates
from omnimj.estimate.intervals import block_noise
from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.mjcf.delays import shifted
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.estimate.replay.problem import Problem, fit
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.dataset import Dataset, Run
from omnimj.resources import models_folder
from omnimj.simulate.machine.linear_axis import as_machine_logs

MACHINE = read_machine_file(models_folder() / "linear_axis" / "linear_axis.xml")
TRUTH = {"carriage.mass": 56.5, "carriage.frictionloss": 21.5, "carriage.damping": 190.0, "timing": -1.7e-4}
WHITE = FORCE_NOISE / math.sqrt(20.0)


@functools.cache
def logs(effect="", values=(), velocity=False, current=False):
    effects = {effect: dict(values)} if effect else {}
    true = {"mass": 96.5, "coulomb": 21.5, "viscous": 190.0}
    return axis_moves(effects, 3, seconds=6.0, velocity=velocity, current=current, true=true)


def replay_of(runs, machine=MACHINE):
    return MachineReplay(as_machine_logs(Dataset(machine.file, "linear_axis", tuple(runs)), machine), machine)


def rms(found, **changes):
    values = {**TRUTH, **changes}
    (simulated,) = found.simulate([Setting(np.array([values[b.name] for b in found.base]))])
    return np.sqrt(np.nanmean((found.measured - simulated) ** 2, axis=0))


def fitted(found, label):
    start = Problem(found, np.ones(len(found.channels)))
    (mismatch,) = start.mismatches([start.start()], ())
    problem = dataclasses.replace(start, noise=block_noise(found, mismatch))
    used = np.ones(len(found.measured), bool)
    base = fit(problem, (), problem.start(), used)
    (candidate,) = [c for c in found.candidates if c.label == label]
    (screened,) = screen_candidates(problem, base, [candidate], used)
    return base, fit(problem, (candidate,), screened.start, used)


@pytest.mark.slow
def test_the_true_axis_leaves_only_noise_with_and_without_a_stated_mass():
    found = replay_of(logs())
    force, position = rms(found)
    assert force < 1.25 * WHITE and position < 1.5e-4
    bare = [dataclasses.replace(run, conditions={}) for run in logs()]
    assert rms(replay_of(bare))[0] > 3.0 * force


@pytest.mark.slow
def test_the_balance_of_a_slide_has_mass_and_armature_once():
    found = replay_of(logs()).input_balances()["force:drive"]
    force, rigid, speed = found
    columns = np.stack([rigid, speed, np.sign(speed)], axis=1)[np.abs(speed) > 0.01]
    share = np.linalg.lstsq(columns, force[np.abs(speed) > 0.01], rcond=None)[0][0]
    assert share == pytest.approx(96.5 / 95.0, rel=3e-3)


def base_friction(v):
    return 20.0 * sign(v) + 200.0 * v


OTHERS = [
    ("asymmetric_coulomb", lambda x, v, t: base_friction(v) + 2.0, (4.0,)),
    (
        "position_friction",
        lambda x, v, t: base_friction(v) + 8.0 * math.exp(-0.5 * ((x - 0.03) / 0.02) ** 2) * sign(v),
        (8.0, 0.03, 0.02),
    ),
    (
        "stribeck",
        lambda x, v, t: base_friction(v) + 6.0 * math.exp(-((v / 0.02) ** 2)) * sign(v),
        (6.0, 0.02),
    ),
    ("stiffness", lambda x, v, t: base_friction(v) + 30.0 * (x - 0.02), (30.0, 0.02)),
    ("quadratic_friction", lambda x, v, t: base_friction(v) + 60.0 * v * abs(v), (60.0,)),
]


@pytest.mark.slow
@pytest.mark.parametrize(("label", "resistance", "expected"), OTHERS, ids=[o[0] for o in OTHERS])
def test_logs_of_a_simulator_that_shares_no_code_are_understood(label, resistance, expected, measured):
    runs = [Run(f"r{k}", log_of(resistance, seed=k, duration=8.0), {}, {}, "r") for k in range(2)]
    found = replay_of(runs)
    base, after = fitted(found, f"{label} (carriage)")
    assert after.loss < 0.2 * base.loss
    values = dict(zip((b.name for b in found.base), after.x, strict=False))
    assert values["carriage.mass"] == pytest.approx(55.0, rel=0.02)
    assert values["carriage.frictionloss"] == pytest.approx(20.0, rel=0.02)
    assert values["carriage.damping"] == pytest.approx(200.0, rel=0.02)
    for value, truth in zip(after.x[len(found.base) :], expected, strict=True):
        measured("slide's effects recovered from foreign logs [1]", abs(value / truth - 1.0), 0.1)
        assert value == pytest.approx(truth, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("period", [1e-3, 2e-3])
def test_a_rigid_axis_has_no_spring_between_its_motor_and_its_carriage(period, measured):
    def resistance(x, v, t):
        return base_friction(v)

    columns = [log_of(resistance, seed=k, duration=10.0, period=period, noise=0.1) for k in range(2)]
    found = replay_of([Run(f"r{k}", each, {}, {}, "r") for k, each in enumerate(columns)])
    base, after = fitted(found, "compliance (carriage)")
    information = after.jacobian.T @ after.jacobian + np.diag([3.0] * len(base.x) + [0.0])
    scale = Problem(found, np.ones(len(found.channels))).scales(after.effects)[-1]
    error = scale * float(np.sqrt(np.linalg.inv(information)[-1, -1]))
    measured("compliance of a rigid axis over its standard error [1]", after.x[-1] / error, 2.0)
    assert after.x[-1] < 2.0 * error < 1e-7 and after.loss > 0.99 * base.loss


@pytest.mark.slow
@pytest.mark.parametrize("angle", [2e-4, 4e-4])
def test_the_play_of_an_axis_is_found_in_its_size(angle, measured):
    base, after = fitted(replay_of(logs("backlash", (("angle", angle),))), "backlash (carriage)")
    measured("play of an axis, relative error [1]", abs(after.x[-1] / angle - 1.0), 0.02)
    assert after.loss < 0.1 * base.loss
    assert after.x[-1] == pytest.approx(angle, rel=0.02)


@pytest.mark.slow
def test_a_current_is_the_command_of_the_actuator():
    current = replay_of(logs(current=True))
    assert [c.name for c in current.channels][:2] == ["control:drive", "position:carriage"]
    # without the low-pass filter of measured forces: noise of the current, and of the position twice derived
    log, white = current.log, np.random.default_rng(0).standard_normal((2, 400_000))
    width, stride = round(2.0 * log.reach[0] / 1e-3) + 1, round(log.period / 1e-3)
    force = np.asarray(savgol_filter(FORCE_NOISE * white[0], width, 3))
    bends = np.asarray(savgol_filter(1.04e-6 * white[1], width, 3, deriv=2, delta=1e-3))
    triangle = np.convolve(np.ones(stride), np.ones(stride)) / stride**2
    rows = np.convolve(force - 96.5 * bends, triangle, "same")[::stride]
    expected = rows.reshape(-1, log.size).mean(axis=1).std()
    assert 0.9 * expected < rms(current)[0] * FORCE_CONSTANT < 1.15 * expected


def test_an_axis_needs_one_slide_with_one_actuator():
    for name in ("servo_arm", "two_link_arm"):
        machine = read_machine_file(models_folder() / name / f"{name}.xml")
        with pytest.raises(InputError, match="need one slide with one actuator"):
            replay_of(logs(), machine)


def test_a_mass_below_the_armature_and_an_unknown_body_are_refused():
    light = [dataclasses.replace(logs()[0], conditions={"mass": 30.0})]
    with pytest.raises(InputError, match=r"must be above the armature, 40 kg"):
        replay_of(light)
    dataset = as_machine_logs(Dataset(MACHINE.file, "linear_axis", tuple(logs()[:1])), MACHINE)
    wrong = dataclasses.replace(dataset.runs[0], conditions={"mass:sledge": 50.0})
    with pytest.raises(UnknownNameError, match=r"unknown body .*'sledge'; choices: .*carriage"):
        MachineReplay(dataclasses.replace(dataset, runs=(wrong,)), MACHINE)


def test_a_shift_by_a_part_of_a_row_keeps_what_changes_fast():
    time = np.arange(400.0)
    wave, found, stretches = np.sin(0.5 * time), np.empty(400), np.array([[0, 400, 0, 0]])
    shifted(wave, stretches, 0.5, True, found)
    inside = slice(2, -3)
    assert np.allclose(found[inside], np.sin(0.5 * (time + 0.5))[inside], atol=2e-3)
    assert np.abs(found).max() > 0.998
