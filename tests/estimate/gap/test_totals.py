"""Effect and base parameter of one quantity: the whole deviation is stated, with an interval that holds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from healthy_recordings import rig_steps

from omnimj.estimate.gap.search.totals import is_held, with_totals
from omnimj.estimate.intervals import jackknife_deviations
from omnimj.estimate.replay.interface import (
    BaseParameter,
    CandidateEffect,
    CandidateParameter,
    Channel,
    Segment,
    Setting,
)
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.estimate.replay.problem import Fit, Problem, fit
from omnimj.estimate.replay.rig.replay import RigReplay
from omnimj.parameters import read_floors, read_rig
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.dataset import Dataset
from omnimj.resources import models_folder
from omnimj.signals import Array
from omnimj.simulate.machine.drive import declared_values, logged_run, machine_loop, simulated_rows
from omnimj.simulate.machine.truth import machine_truth

SHARED = {
    "rig": {
        "torque_constant": "motor.torque_constant",
        "wheel_radius": "wheel.radius",
        "rail_coulomb": "rig.rail_friction",
    },
    "linear_axis": {
        "coulomb (carriage)": "carriage.frictionloss",
        "viscous (carriage)": "carriage.damping",
        "payload (carriage)": "carriage.mass",
    },
    "servo_arm": {
        "coulomb (shaft)": "shaft.frictionloss",
        "viscous (shaft)": "shaft.damping",
        "torque_constant (motor)": "motor.torque_constant",
    },
}
"""Machine → effect and the base parameter that is the same quantity."""


def replay_of(machine):
    """Replay of a short recording of a machine without hidden effects."""
    if machine == "rig":
        rig, logs = read_rig(), rig_steps()
        mass = {"mass": rig.rig.masses[0]}
        runs = tuple(replace(run, conditions={**run.conditions, **mass}) for run in logs.runs)
        return RigReplay(replace(logs, runs=runs), rig, read_floors())
    model = read_machine_file(models_folder() / machine / f"{machine}.xml")
    truth, loop = machine_truth(model, declared_values(model)), machine_loop(model)
    plan = loop.plan(5)
    run = logged_run("run", truth, simulated_rows(truth, loop.loop, plan), 5)
    return MachineReplay(Dataset(model.file, model.plant, (run,)), model)


@pytest.mark.slow
@pytest.mark.parametrize("machine", SHARED)
def test_what_the_base_has_of_a_quantity_can_go_into_the_effect_without_any_change(machine):
    replay = replay_of(machine)
    assert {c.label: c.quantity for c in replay.candidates if c.quantity} == SHARED[machine]
    problem = Problem(replay, np.ones(len(replay.channels)))
    for candidate in (c for c in replay.candidates if c.quantity):
        x = problem.start()
        k = [b.name for b in replay.base].index(candidate.quantity)
        x[k] += 0.3 * (replay.base[k].high - x[k])
        own = [p.null_value if p.null_value is not None else p.typical for p in candidate.parameters]
        own[0] += 0.2 * (candidate.parameters[0].typical - own[0])
        x = np.append(x, own)
        (residual,) = problem.residuals([x], (candidate,))
        before = Fit((candidate,), x, residual, problem.central_jacobian(x, (candidate,)), 0.0)
        after = with_totals(problem, before)
        (again,) = problem.residuals([after.x], (candidate,))
        size = np.sqrt(np.mean(residual**2))
        assert np.max(np.abs(again - residual)) < 1e-9 * max(size, 1.0), candidate.label
        assert after.x[k] == replay.base[k].nominal and after.x[-len(own)] != own[0]
        assert is_held(problem, after).nonzero()[0].tolist() == [k]
        fresh = problem.central_jacobian(after.x, (candidate,))[:, -len(own)]
        assert np.linalg.norm(fresh - after.jacobian[:, -len(own)]) < 1e-3 * np.linalg.norm(fresh)


@pytest.mark.parametrize("label", ["coulomb (shaft)", "viscous (shaft)"])
def test_where_nothing_of_a_quantity_is_left_the_effect_is_all_of_it(label):
    replay = replay_of("servo_arm")
    problem = Problem(replay, np.ones(len(replay.channels)))
    candidate = next(c for c in replay.candidates if c.label == label)
    k = [b.name for b in replay.base].index(candidate.quantity)
    nominal, x = replay.base[k].nominal, problem.start()
    x[k] = 0.5 * (replay.base[k].low + nominal)
    x = np.append(x, -nominal)  # less than nothing, which the machine takes for nothing
    (residual,) = problem.residuals([x], (candidate,))
    assert not problem.central_jacobian(x, (candidate,))[:, -1].any()
    after = with_totals(problem, Fit((candidate,), x, residual, problem.jacobian(x, (candidate,)), 0.0))
    assert after.x[-1] == -nominal and after.x[k] == nominal
    (again,) = problem.residuals([after.x], (candidate,))
    assert np.abs(again - residual).max() < 1e-9 * np.sqrt(np.mean(residual**2))
    assert problem.central_jacobian(after.x, (candidate,))[:, -1].any()


def test_a_total_beyond_the_bounds_of_the_effect_stays_divided():
    motor: Any = Motor(damping=0.3)
    problem = Problem(motor, np.ones(2))
    candidate = replace(motor.candidates[0], quantity="constant")
    narrow = replace(candidate.parameters[0], high=0.25)
    tight = replace(candidate, parameters=(narrow,))
    x = np.array([0.6, 4.0, 0.2])
    (residual,) = problem.residuals([x], (candidate,))
    before = Fit((tight,), x, residual, problem.jacobian(x, (candidate,)), 0.0)
    after = with_totals(problem, before)
    assert np.array_equal(after.x, x) and not is_held(problem, after).any()


INERTIA = 0.01


@dataclass
class Motor:
    """Voltage that a motor needs along a motion, u = (R/K)(J a + d v) + K v, and its speed after some time.

    J is known and d hidden; both give K/R and c = d + K²/R, and the stated uncertainty alone tells K from d.
    """

    damping: float
    plant = "motor"
    channels = (Channel("voltage", "V", "voltage"), Channel("speed", "1", "speed"))
    base = (BaseParameter("constant", "1", 0.4, 0.25, 0.55), BaseParameter("resistance", "1", 4.0, 2.5, 5.5))
    candidates = (
        CandidateEffect(
            "viscous", "viscous", "", (CandidateParameter("damping", "1", -1.0, 1.0, 0.01, 0.0),)
        ),
    )
    curves = MappingProxyType({})
    runs, rows = 8, 400

    def __post_init__(self):
        random = np.random.default_rng(1)
        shape = self.runs * self.rows
        self._motion = 20.0 * random.standard_normal((2, shape))
        time = np.asarray(0.01 * np.arange(self.rows), float)
        self.segments = tuple(
            Segment(f"run_{k}", f"run_{k}", k * self.rows, (k + 1) * self.rows, time)
            for k in range(self.runs)
        )
        true = Setting(np.array([0.47, 4.7]), {"viscous": np.array([self.damping])})
        (clean,) = self.simulate([true])
        self.measured = clean + 0.001 * random.standard_normal(clean.shape)

    def simulate(self, settings: Sequence[Setting]) -> list[Array]:
        acceleration, speed = self._motion
        found = []
        for setting in settings:
            constant, resistance = setting.base
            damping = setting.effects["viscous"][0] if "viscous" in setting.effects else 0.0
            voltage = resistance / constant * (INERTIA * acceleration + damping * speed) + constant * speed
            rate = damping + constant**2 / resistance
            end = 10.0 * constant / resistance / rate  # under 10 V
            after = end + (speed - end) * np.exp(-0.1 * rate / INERTIA)
            found.append(np.stack([voltage, after], axis=1))
        return found


def test_an_interval_is_as_wide_as_the_prior_leaves_what_the_data_cannot_tell():
    """Along K(1 + ε), R(1 + ε) the damping changes by −ε K²/R; the prior gives the deviation of ε."""
    motor: Any = Motor(damping=0.02)
    problem = Problem(motor, np.full(2, 0.001))
    used = np.ones(len(motor.measured), bool)
    effects = motor.candidates
    found = fit(problem, effects, np.array([0.4, 4.0, 0.01]), used)
    exact = replace(found, jacobian=problem.central_jacobian(found.x, effects))
    constant, resistance, _ = found.x
    prior = [np.sqrt(3.0) * v / (0.5 * (b.high - b.low)) for v, b in zip(found.x, motor.base, strict=False)]
    expected = constant**2 / resistance / math.hypot(*prior)
    assert jackknife_deviations(problem, exact, used)[0][2] == pytest.approx(expected, rel=0.05)
    # one-sided differences make up knowledge that the data do not have
    rough = replace(found, jacobian=problem.jacobian(found.x, effects))
    assert jackknife_deviations(problem, rough, used)[0][2] < 0.5 * expected
