"""A load of unknown mass and place on a servo of which nobody knows the constants well."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_findings import rig_unexplained
from scipy.optimize import least_squares
from test_totals import Motor

from omnimj.effects import Interval
from omnimj.estimate.gap.find import find_gap
from omnimj.estimate.gap.records import UNDETERMINED, GivenUp
from omnimj.estimate.gap.sentences import next_step, summarize_finding
from omnimj.estimate.intervals import jackknife_deviations
from omnimj.estimate.replay.interface import CandidateEffect, CandidateParameter, Setting
from omnimj.estimate.replay.mjcf import settings
from omnimj.estimate.replay.mjcf.experiments import machine_experiments
from omnimj.estimate.replay.problem import Problem, fit, polish
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.signals import Array

MASS = CandidateParameter("mass", "kg", -0.1, 3.0, 0.01, 0.0, times="distance", least=-0.5)
PLACE = CandidateParameter("distance", "m", 0.05, 0.8, 0.2, None, spread=0.06)
LOAD = CandidateEffect("load", "load", "", (MASS, PLACE))

ARM, BAR = 0.15, 0.06  # of the link [m, kg]


@given(mass=st.floats(-0.5, 50.0), distance=st.floats(0.05, 0.8))
def test_mass_and_distance_are_those_of_the_fitted_moment(mass, distance):
    numbers = LOAD.numbers({"mass": mass, "distance": distance})
    assert numbers.tolist() == [mass * distance, distance]
    assert LOAD.values(numbers) == {"mass": pytest.approx(mass, rel=1e-12), "distance": distance}


def test_no_moment_at_a_short_distance_takes_more_than_the_body_has():
    assert LOAD.values(np.array([-0.1, 0.05]))["mass"] == -0.5


@given(length=st.floats(0.05, 1.0), share=st.floats(0.01, 1.0))
def test_a_body_reaches_beyond_its_centre_of_mass_as_far_as_its_last_geom(length, share):
    """A thin bar of 1 kg from the joint, with a small ball of 1 kg on it."""
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body><joint axis="0 1 0"/><geom type="capsule" size="1e-4" mass="1"'
        f' fromto="0 0 0 0 0 -{length}"/><geom type="sphere" size="1e-4" mass="1"'
        f' pos="0 0 -{share * length}"/></body></worldbody></mujoco>'
    )
    centre = 0.5 * (0.5 + share) * length
    assert settings._beyond_centre(model, 1) == pytest.approx(length - centre, abs=2e-4)


@pytest.mark.parametrize("peak", [0.0, 0.2, 3.0])
def test_a_proposed_load_is_half_the_links_mass_or_half_of_what_the_motor_held(tmp_path, peak):
    (tmp_path / "bar.xml").write_text(
        '<mujoco><worldbody><body name="bar"><joint name="shaft" axis="0 1 0"/>'
        '<geom type="capsule" size="0.01" fromto="0 0 0 0 0 -0.4" mass="0.3"/></body></worldbody>'
        '<actuator><motor joint="shaft"/></actuator></mujoco>'
    )
    machine = read_machine_file(tmp_path / "bar.xml")
    span = settings.JointSpan(-1.0, 1.0, 5.0, 10.0, 0.5 * peak, peak, True)
    masses = {one.run.get("added_mass", 0.0) for one in machine_experiments(machine, {"shaft": span})}
    assert sorted(masses) == [0.0, pytest.approx(0.5 * max(0.3, peak / (9.81 * 0.2)), rel=0.05)]


class Lever:
    """Torques g m d sin q + (m d² + J) a along a motion, J known to a tenth."""

    plant, channels, base = "lever", Motor.channels[:1], (replace(Motor.base[0], name="inertia"),)
    candidates, curves = (LOAD,), Motor.curves

    def __init__(self, noise: float):
        random = np.random.default_rng(2)
        self.segments = Motor(0.0).segments
        self._motion = random.uniform(-1.5, 1.5, 3200), 20.0 * random.standard_normal(3200)
        (clean,) = self.simulate([Setting(np.array([0.4]), {"load": np.array([0.4 * 0.2, 0.2])})])
        self.measured = clean + noise * random.standard_normal(clean.shape)

    def simulate(self, settings) -> list[Array]:
        angle, acceleration = self._motion
        found = []
        for setting in settings:
            moment, distance = setting.effects["load"]
            inertia = 0.1 * setting.base[0] + moment * distance
            found.append((9.81 * moment * np.sin(angle) + inertia * acceleration)[:, None])
        return found


@pytest.mark.parametrize("noise", [0.01, 1.0])
def test_a_polished_fit_is_at_the_minimum_that_another_solver_finds(noise):
    """Another route: all residuals and priors as one vector, by scipy, from the truth."""
    lever = Lever(noise)
    problem, used = Problem(lever, np.array([noise]), huber_scale=1e3), np.ones(3200, bool)  # type: ignore[arg-type]
    start = np.array([0.25, 0.01, 0.5])

    def stacked(x: Array) -> Array:
        (residual,) = problem.residuals([x], (LOAD,))
        place = (x[2] - PLACE.typical) / PLACE.spread
        return np.array([*residual.ravel(), math.sqrt(3.0) * (x[0] - 0.4) / 0.15, place])

    low, high = problem.bounds((LOAD,))
    expected = least_squares(
        stacked, (0.4, 0.08, 0.2), bounds=(low, high), x_scale=(0.1, 0.01, 0.1), xtol=1e-14
    )
    found = polish(problem, fit(problem, (LOAD,), start, used), used)
    assert found.loss == pytest.approx(2.0 * expected.cost, rel=1e-6)
    assert found.x == pytest.approx(expected.x, rel=0.02)


def test_a_place_that_the_data_leave_open_is_as_uncertain_as_was_known_beforehand():
    lever = Lever(30.0)
    problem, used = Problem(lever, np.array([30.0]), huber_scale=1e3), np.ones(3200, bool)  # type: ignore[arg-type]
    found = polish(problem, fit(problem, (LOAD,), np.array([0.4, 0.08, 0.3]), used), used)
    assert found.x[2] == pytest.approx(PLACE.typical, abs=0.3 * PLACE.spread)
    assert jackknife_deviations(problem, found, used)[0][2] == pytest.approx(PLACE.spread, rel=0.1)


def test_no_interval_is_wider_than_the_bounds_that_the_model_file_states():
    """Runs that contradict each other: each has a motor of its own, all but one beyond the stated bounds."""
    motor = Motor(damping=0.02)
    scales = np.repeat(np.linspace(1.5, 3.0, motor.runs), motor.rows)[:, None]
    motor.measured = motor.measured * scales
    problem, used = Problem(motor, np.full(2, 0.001)), np.ones(len(motor.measured), bool)  # type: ignore[arg-type]
    found = polish(problem, fit(problem, (), problem.start(), used), used)
    spread, _ = jackknife_deviations(problem, found, used)
    for base, value, width in zip(motor.base, found.x, spread, strict=True):
        reach = max(base.high - value, value - base.low)
        assert width <= math.sqrt(motor.runs - 1.0) * reach
        pressed = min(base.high - value, value - base.low) < 1e-9
        assert not pressed or width < 0.1 * (base.high - base.low)


def servo_logs(folder: Path, load: float, seed: int) -> None:
    """Logs of a position servo that swings a load at the end of a light bar, and a model without the load.

    K = 1.05 N.m/A, R = 2.6 Ohm, rotor 0.025 kg.m2; friction grows with the load of motor and of gravity, and
    towards standstill. The model file states other values of all of them, within generous bounds.
    """
    random, period, steps = np.random.default_rng(seed), 0.005, 25
    time = np.arange(0.0, 6.0, period)
    goals = {
        "two_sines": 0.8 * np.sin(np.pi * time) + 0.4 * np.sin(3.2 * np.pi * time),
        "drop": np.where(time < 2.0, 0.25 * np.pi * (np.cos(0.5 * np.pi * time) - 1.0), 0.0),
        "up_and_down": 0.25 * np.pi * (1.0 - np.cos(np.pi / 3.0 * time)),
        "chirp": 0.4 * np.pi * np.sin(time**2),
    }
    runs = [(f"{name}_{gain}", goal, gain) for gain in (3, 6, 12) for name, goal in goals.items()]
    goal = np.array([one for _, one, _ in runs])
    gain = np.array([float(one) for _, _, one in runs])
    supply = 12.0 + 0.05 * random.standard_normal(len(runs))
    inertia = (load + BAR / 3.0) * ARM**2 + 0.025
    q, w, rows = np.zeros(len(runs)), np.zeros(len(runs)), []
    for k in range(len(time)):
        voltage = np.clip(gain * (goal[:, k] - q), -1.0, 1.0) * supply
        rows.append((q.copy(), voltage))
        for _ in range(steps):
            motor = 1.05 / 2.6 * (voltage - 1.05 * w)
            gravity = -9.81 * (load + 0.5 * BAR) * ARM * np.sin(q)
            dry = 0.06 + 0.08 * np.abs(motor) + 0.12 * np.abs(gravity) + 0.05 * np.exp(-np.abs(w / 0.15))
            free = w + period / steps * (motor + gravity - 0.05 * w) / inertia
            w = np.sign(free) * np.maximum(np.abs(free) - period / steps * dry / inertia, 0.0)
            q = q + period / steps * w
    quantum = 2.0 * np.pi / 4096.0
    for j, (name, _, _) in enumerate(runs):
        position = quantum * np.round(np.array([row[0][j] for row in rows]) / quantum)
        speed = np.gradient(position, period) + 0.02 * random.standard_normal(len(time))
        columns = zip(time, position, speed, [row[1][j] for row in rows], strict=True)
        with (folder / f"{name}.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("time", "position:joint", "velocity:joint", "control:motor"))
            writer.writerows(tuple(f"{value:.6g}" for value in row) for row in columns)
    (folder / "dataset.toml").write_text('plant = "mjcf"\nmodel = "model.xml"\n')
    (folder / "model.xml").write_text(
        '<mujoco><compiler angle="radian"/><option timestep="0.001" integrator="implicitfast"/>\n'
        '<worldbody><body name="link"><joint name="joint" axis="0 -1 0" armature="0.02" damping="0.05"'
        ' frictionloss="0.05"/>\n'
        f'<geom type="capsule" size="0.006" fromto="0 0 0 0 0 -{ARM}" mass="{BAR}" contype="0"'
        ' conaffinity="0"/>'
        '</body></worldbody>\n<actuator><general name="motor" joint="joint" gainprm="0.4" biastype="affine"'
        ' biasprm="0 0 -0.4" ctrlrange="-13 13"/></actuator></mujoco>\n'
    )
    (folder / "model.toml").write_text(
        '[uncertain.joint.joint]\ndamping = { half_width = 0.1, unit = "N.m.s/rad" }\n'
        'frictionloss = { half_width = 0.1, unit = "N.m" }\n'
        'armature = { half_width = 0.01, unit = "kg.m2" }\n'
        '[uncertain.actuator.motor]\ntorque_constant = { half_width = 0.3, unit = "N.m/A" }\n'
        'resistance = { half_width = 0.8, unit = "Ohm" }\n'
    )


@pytest.mark.slow
@pytest.mark.parametrize("load", [0.15, 0.4, 0.9])
def test_an_unknown_load_on_a_servo_is_reported_whatever_its_friction(tmp_path, load):
    servo_logs(tmp_path, load, seed=round(100.0 * load))
    finding = find_gap(tmp_path)
    (own,) = [e for e in finding.effects if "payload" in (e.effect, *e.indistinguishable_from)]
    others = {e.effect for e in finding.effects if e is not own}
    assert own.effect == "payload" and others <= {"load_friction", "back_driving", "stribeck"}
    mass = own.parameters["mass"]
    assert mass.low is not None and mass.low > 0.0


def test_an_effect_of_which_the_data_do_not_tell_the_size_is_what_the_next_step_is_about():
    left = GivenUp("payload (link)", Interval(0.24, 0.17, 0.32), UNDETERMINED)
    finding = replace(rig_unexplained(), given_up=(left,), undetermined=left)
    assert "payload (link) would remove 24 % of it" in summarize_finding(finding)
    assert "no effect" not in summarize_finding(finding) + next_step(finding)
    assert next_step(finding).endswith("to determine payload (link).")
