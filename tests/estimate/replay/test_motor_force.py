"""Force per ampere that changes with the speed: its kernel, and a rig whose gear loses more at speed."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from omnimj.estimate.gap.find import find_gap
from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.motor_force import changes_of, motor_forces
from omnimj.estimate.replay.rig import kernels
from omnimj.estimate.replay.rig.replay import RigReplay
from omnimj.parameters import read_floors, read_rig
from omnimj.physics.effect_terms import terms_at, zero_terms
from omnimj.physics.motor import motor_at, motor_parameters
from omnimj.physics.rig import RigModel, rig_at, rig_parameters
from omnimj.physics.traction import traction_at
from omnimj.physics.wheel import packed
from omnimj.plant.interface import RIG_CHANNELS
from omnimj.plant.planar_rig import PlanarRig
from omnimj.recording.dataset import Dataset, Run
from omnimj.simulate.driving import drive_rig
from omnimj.studies.gap_benchmark import datasets
from omnimj.studies.gap_benchmark.cases import HiddenEffect, draw_cases
from omnimj.studies.gap_benchmark.datasets import DisturbedPlant
from omnimj.studies.gap_benchmark.unmodelled import RunContext, UnmodelledEffect

RIG, FLOORS = read_rig(), read_floors()
FORCES = motor_forces(1.5)


def force_per_ampere() -> float:
    """Force of the motor on the carriage [N/A]."""
    motor = RIG.motor
    return motor.torque_constant * motor.gear_ratio * motor.gear_efficiency / RIG.wheel.radius


@pytest.mark.parametrize("speed", [-2.0, -0.6, 0.0, 0.3, 0.75, 1.1, 1.5])
def test_the_change_is_interpolated_between_rest_half_and_full_speed(speed):
    effects = {FORCES[0].label: np.array([-0.1, -0.4]), FORCES[1].label: np.array([0.2, -0.2])}
    rows = packed(rig_parameters(RIG, 6.0, 1.0, 1.0, 0.0))
    motor, floor = motor_parameters(RIG.motor), FLOORS["natural_stone"].row
    parameters = kernels.KernelParameters(
        rows[None], np.array(motor), floor[None], zero_terms()[0], changes_of(FORCES, effects), 1.5
    )
    plain = RigModel(
        rig_at(rows), motor_at(parameters.motor), traction_at(floor), terms_at(zero_terms()[0]), False
    )
    found = kernels.with_changed_force(plain, parameters, speed, 3.0)
    axle, carriage = (np.interp(abs(speed), [0.0, 0.75, 1.5], values) for values in parameters.changes)
    assert found.motor == motor._replace(torque_scale=pytest.approx(1.0 + axle))
    assert found.terms.cable_force == pytest.approx(carriage * 3.0 * force_per_ampere())


def test_a_rig_whose_gear_loses_a_share_that_grows_with_the_speed_is_reproduced():
    lost = 0.8  # [N/A] at 1 m/s
    law = UnmodelledEffect("gear_law", lost, 1.0, 0.0)
    plant = DisturbedPlant(
        PlanarRig(RIG, "natural_stone", seed=3, floors=FLOORS), (law,), RunContext(0.0, 6.0), RIG
    )
    trace = drive_rig(plant, np.concatenate([np.zeros(100), np.full(900, 0.9), np.full(600, -0.5)]))
    columns = {name: trace[name] for name in ("time", *RIG_CHANNELS)}
    run = Run("run", columns, {}, {"floor": "natural_stone", "mass": RIG.rig.masses[0]}, "run")
    replay = RigReplay(Dataset(Path("runs"), "quarter_rig", (run,)), RIG, FLOORS)
    force = next(one for one in replay.structures if one.label.endswith("(on the carriage)"))
    (top,) = {one.fastest for one in replay.structures if hasattr(one, "fastest")}
    share = -lost * top / force_per_ampere()
    base = np.array([b.nominal for b in replay.base])
    with_it = Setting(base, {force.label: np.array([0.5 * share, share])})
    found = [replay.measured - simulated for simulated in replay.simulate([Setting(base), with_it])]
    sizes = [float(np.sqrt(np.nanmean(each[:, 1] ** 2))) for each in found]
    assert sizes[1] < 0.003 < 10.0 * sizes[1] < sizes[0]


def test_the_words_give_both_changes_and_the_speeds_at_which_they_hold():
    words, values = FORCES[0].describe(np.array([0.05, -0.123]))
    start = "a force per ampere at the axle that is"
    assert words == f"{start} 5 % larger at 0.75 m/s and 12 % smaller at 1.5 m/s than at rest"
    assert values == {"halfway": 0.05, "fastest": -0.123, "speed": 1.5}


@pytest.mark.slow
def test_an_effect_is_named_alone_on_a_rig_whose_gear_loses_more_at_speed(tmp_path):
    """Without such a change in the model drag and friction make up for it."""
    empty = next(case for case in draw_cases(6) if case.kind == "null")
    hidden = (HiddenEffect("current_bias", {"bias": 0.1}, "obvious"),)
    lost, per_ampere = UnmodelledEffect("gear_law", 0.5, 0.8, 0.0), force_per_ampere()
    datasets.make_dataset(dataclasses.replace(empty, hidden=hidden, structure=lost), tmp_path / "data")
    finding = find_gap(tmp_path / "data")
    assert [e.effect for e in finding.effects] == ["current_bias"]
    assert finding.outside is not None
    assert finding.outside.words.startswith("a force per ampere on the carriage that is")
    true = -0.5 / 0.8 * finding.outside.values["speed"] / per_ampere
    assert finding.outside.values["fastest"] == pytest.approx(true, rel=0.15)
