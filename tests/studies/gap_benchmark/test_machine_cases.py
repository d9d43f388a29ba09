"""The benchmark on machines with an MJCF file: what is hidden, and two ways to make the same logs."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from nightly import representative

from omnimj.errors import UnknownNameError
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.recording.dataset import Dataset
from omnimj.recording.read_dataset import read_dataset
from omnimj.simulate.machine.drive import logged_run, simulated_rows
from omnimj.studies.gap_benchmark.cases import HiddenEffect, case_from_dict
from omnimj.studies.gap_benchmark.hand_equations import integrated_rows
from omnimj.studies.gap_benchmark.machine_cases import (
    EQUATIONS,
    MUJOCO,
    SHIPPED,
    draw_machine_cases,
    machine_library,
    machine_true_values,
    make_machine_dataset,
    true_machine,
)
from omnimj.studies.gap_benchmark.plants import benchmark_plant
from omnimj.studies.gap_benchmark.trial import hidden_candidate, true_heldout

SERVO = draw_machine_cases("servo_arm", 3)
EMPTY = next(case for case in SERVO if case.kind == "null" and case.structure is None)
PRESENT = [
    ("load_friction", {"share": 0.15, "joint": "shaft"}),
    ("back_driving", {"efficiency": 0.85, "actuator": "motor"}),
    ("back_driving", {"efficiency": 1.15, "actuator": "motor"}),
    ("stribeck", {"force": 0.04, "velocity": 0.5, "joint": "shaft"}),
    ("actuator_lag", {"time_constant": 0.02, "actuator": "motor"}),
    ("payload", {"mass": 0.1, "distance": 0.15, "body": "arm"}),
    ("asymmetric_viscous", {"difference": 0.02, "joint": "shaft"}),
    ("position_scale", {"scale": 1.05, "channel": "position:shaft"}),
    ("grade", {"slope": 0.04, "axis": "y"}),
]


MACHINES = Path(__file__).parents[2] / "data" / "machines"


def hiding(plant="servo_arm", *effects: tuple[str, dict], maker=MUJOCO):
    hidden = tuple(HiddenEffect(name, values, "clear") for name, values in effects)
    base = {one.name: one.value for one in machine_library(plant).machine.uncertain}
    return dataclasses.replace(EMPTY, hidden=hidden, base=base, plant=plant, maker=maker)


GEAR = ("back_driving", {"efficiency": 0.85, "actuator": "motor"})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plant", "hidden"),
    [("two_link_arm", ()), ("servo_arm", (GEAR,)), ("linear_axis", ()), ("servo_arm", ())],
)
def test_equations_written_by_hand_move_the_true_machine_as_mujoco_does(plant, hidden, measured):
    library = machine_library(plant)
    plan, truth = library.loop.plan(5), true_machine(hiding(plant, *hidden))
    by_hand, by_mujoco = (rows(truth, library.loop.loop, plan) for rows in (integrated_rows, simulated_rows))
    travel = float(np.ptp(by_mujoco[:, 0], axis=0).min())
    position, command = (
        float(np.sqrt(((by_hand - by_mujoco)[:, row] ** 2).mean())) / size
        for row, size in ((0, travel), (2, float(np.std(by_mujoco[:, 2]))))
    )
    measured("position by hand and by MuJoCo, RMS over the travel [1]", position, 5e-4)
    measured("command by hand and by MuJoCo, RMS over its own [1]", command, 5e-3)
    assert position < 5e-4 and command < 5e-3


@pytest.mark.parametrize(("name", "values"), representative(*PRESENT, keep=2), ids=[p[0] for p in PRESENT])
def test_the_true_model_leaves_little_but_noise_in_the_logs_of_a_hidden_effect(name, values, measured):
    case, library = hiding("servo_arm", (name, values)), machine_library("servo_arm")
    truth = true_machine(case)
    plans = [library.loop.plan(k) for k in range(4)]
    runs = tuple(
        logged_run(f"run_{k}", truth, simulated_rows(truth, library.loop.loop, plan), k)
        for k, plan in enumerate(plans)
    )
    replay = MachineReplay(Dataset(library.machine.file, "mjcf", runs), library.machine)
    hidden_candidate(replay, case.hidden[0])
    left, empty = (true_heldout(replay, effects) for effects in (case.hidden, ()))
    ratio = max(empty[channel] / left[channel] for channel in left)
    measured("mismatch with a hidden effect over that of the true model, least [1]", 1.0 / ratio, 0.5)
    assert ratio > 2.0
    noise = {"control:motor": 0.07, "position:shaft": 1.5e-3}
    for channel, limit in noise.items():
        measured(f"mismatch of the true model, {channel}", left[channel], limit)
        assert left[channel] < limit


def test_a_seed_draws_the_same_cases_and_every_kind_of_them():
    assert draw_machine_cases("servo_arm", 3) == SERVO
    assert draw_machine_cases("servo_arm", 4) != SERVO
    kinds = [case.kind for case in SERVO]
    assert len(SERVO) == 60 and {k: kinds.count(k) for k in set(kinds)} == {
        "null": 15,
        "single": 27,
        "pair": 18,
    }
    assert {case.maker for case in SERVO} == {EQUATIONS, MUJOCO}
    assert 8 <= sum(case.structure is not None for case in SERVO) <= 32
    assert all(case_from_dict(case.to_dict()) == case for case in SERVO)
    hidden = {one.effect for case in SERVO for one in case.hidden}
    assert hidden == {c.effect for c in machine_library("servo_arm").candidates}


@pytest.mark.slow
def test_the_folder_of_a_dataset_names_its_model_and_nothing_of_the_truth(tmp_path):
    case = hiding("servo_arm", PRESENT[0], maker=MUJOCO)
    make_machine_dataset(case, tmp_path / "case_000")
    read = read_dataset(tmp_path / "case_000")
    assert read.plant == "mjcf" and read.model == machine_library("servo_arm").machine.file.resolve()
    assert len(read.runs) == 8 and set(read.runs[0].columns) == {"time", "position:shaft", "control:motor"}
    text = (tmp_path / "case_000" / "dataset.toml").read_text(encoding="utf-8")
    assert "load_friction" not in text and "share" not in text


def test_the_truth_of_an_effect_counts_the_error_of_the_same_quantity_in_the_base():
    case = hiding("servo_arm")
    wrong = dataclasses.replace(
        case, base={**case.base, "shaft.damping": 0.014, "motor.torque_constant": 0.42}
    )
    viscous = HiddenEffect("viscous", {"coefficient": 0.03, "joint": "shaft"}, "clear")
    assert machine_true_values(viscous, wrong) == {"coefficient": pytest.approx(0.034)}
    constant = HiddenEffect("torque_constant", {"scale": 0.9, "actuator": "motor"}, "clear")
    assert machine_true_values(constant, wrong) == {"scale": pytest.approx(0.9 * 1.05)}
    offset = HiddenEffect("force_offset", {"force": 0.1, "joint": "shaft"}, "clear")
    assert machine_true_values(offset, wrong) == {"force": 0.1}


def test_a_machine_of_the_benchmark_is_shipped_or_a_file():
    for name in SHIPPED:
        assert benchmark_plant(name).makers == ("twin",)
    with pytest.raises(UnknownNameError, match=r"--plant.*'servo'.*choices: PATH/NAME\.xml,.*servo_arm"):
        benchmark_plant("servo")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cart_pole", "pan_tilt", "gripper", "leg", "arm7"])
def test_every_joint_of_a_machine_moves_and_follows_its_plan_where_it_is_driven(name):
    library = machine_library(str(MACHINES / f"{name}.xml"))
    moving = {c.selectors["joint"] for c in library.candidates if c.effect == "viscous"}
    assert moving == set(library.machine.joints)
    plan = library.loop.plan(2)
    truth = true_machine(hiding(str(MACHINES / f"{name}.xml")))
    rows = simulated_rows(truth, library.loop.loop, plan)
    for j, drive in enumerate(truth.drives):
        if drive is not None:
            travel = float(np.ptp(plan.goal[:, j]))
            assert np.abs(rows[:, 0, j] - plan.goal[:-1, j]).max() < 0.05 * travel
