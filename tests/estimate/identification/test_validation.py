"""Measured currents drive the model: the right one at the noise level, a wrong one above it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from rig_runs import dataset, twin_run

from omnimj.effects import with_effects
from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.identification.validation import (
    TABLE_4_2,
    TABLE_4_3,
    TABLE_4_4,
    published_errors,
    validate,
)
from omnimj.recording.dataset import Run

NOISE = 0.005
"""RMS of the carriage's encoder and of its filter [m/s]."""


@pytest.fixture(scope="module")
def runs(rig, floors):
    """Three conditions, one of them twice."""
    stone, pvc = floors["natural_stone"], floors["pvc"]
    return (
        twin_run(rig, stone, 0.45, 1),
        twin_run(rig, stone, 0.45, 2),
        twin_run(rig, pvc, 1.5, 3, 1.9593),
        twin_run(rig, stone, 0.9, 4, lateral_speed=-0.35, duration=0.9),
    )


def test_the_model_that_made_the_data_is_at_the_noise_level(rig, floors, runs, measured):
    found = validate(dataset(*runs), rig, floors)
    worst = max(cell.rms["twin"] for cell in found.cells)
    measured("RMS speed error of the twin on its own data [m/s]", worst, NOISE)
    assert worst <= NOISE
    planar = max(cell.rms["planar"] for cell in found.cells)
    measured("the same of the planar rig [m/s]", planar, 0.015)
    assert planar <= 0.015


def test_conditions_become_cells_beside_the_published_ones(rig, floors, runs):
    found = validate(dataset(*runs), rig, floors, ("planar",))
    keys = [(c.floor, c.mass, c.lateral_speed, c.current) for c in found.cells]
    assert keys == [
        ("natural_stone", 3.9593, 0.0, 0.45),
        ("pvc", 1.9593, 0.0, 1.5),
        ("natural_stone", 3.9593, -0.35, 0.9),
    ]
    assert len(found.cells[0].runs) == 2
    assert [c.published for c in found.cells] == [(0.024,), (0.029,), (0.066, 0.008)]


@pytest.mark.parametrize(
    "wrong",
    [
        lambda rig: dataclasses.replace(rig, motor=dataclasses.replace(rig.motor, torque_constant=0.044)),
        lambda rig: with_effects(rig, {"rail_viscous": {"coefficient": 2.0}}),
    ],
)
def test_a_wrong_model_is_above_the_noise(rig, floors, runs, wrong):
    right, other = (validate(dataset(*runs), model, floors, ("planar",)) for model in (rig, wrong(rig)))
    assert other.mean("planar") > 2.5 * right.mean("planar")


def test_a_model_with_the_effect_that_made_the_data_is_at_the_noise_level(rig, floors):
    sticky = with_effects(rig, {"rail_viscous": {"coefficient": 3.0}, "current_scale": {"scale": 1.2}})
    run = twin_run(sticky, floors["pvc"], 0.9)
    without, with_it = (validate(dataset(run), model, floors, ("twin",)) for model in (rig, sticky))
    assert with_it.mean("twin") < NOISE < 0.1 * without.mean("twin")
    assert with_it.effects == ("rail_viscous", "current_scale")


def test_reversals_and_braking_are_replayed(rig, floors):
    current = np.concatenate((np.full(400, 1.2), np.full(500, -1.2), np.zeros(100)))
    run = twin_run(rig, floors["natural_stone"], current)
    assert run.columns["carriage_speed"].min() < -0.2
    found = validate(dataset(run), rig, floors, ("twin",))
    assert found.mean("twin") <= NOISE


@pytest.mark.parametrize("plant", ["twin", "planar"])
def test_a_run_that_begins_in_motion_is_replayed_from_there(rig, floors, plant):
    whole = twin_run(rig, floors["pvc"], 0.9)
    late = Run("late", {k: v[400:] for k, v in whole.columns.items()}, {}, whole.conditions)
    found = validate(dataset(late), rig, floors, (plant,))
    assert late.columns["carriage_speed"][0] > 0.5
    assert found.mean(plant) < 0.02


def test_a_measured_current_is_not_cut_by_the_supply_again(rig, floors):
    """A model with less supply than the rig had must not clip what did flow."""
    run = twin_run(rig, floors["natural_stone"], 1.5)
    weak = dataclasses.replace(rig, motor=dataclasses.replace(rig.motor, supply=12.0, current_limit=0.5))
    for plant in ("twin", "planar"):
        errors = [validate(dataset(run), model, floors, (plant,)).mean(plant) for model in (rig, weak)]
        assert errors[0] == pytest.approx(errors[1], rel=1e-9)


def test_every_published_cell_is_found_and_no_other():
    for (mass, floor), errors in TABLE_4_2.items():
        assert len(errors) == 8
        assert published_errors(floor, mass, 0.0, 0.6) == (errors[1],)
    for speed, errors in TABLE_4_3.items():
        assert published_errors("natural_stone", 3.9593, speed, 1.5) == (errors[3], TABLE_4_4[speed][3])
    assert published_errors("natural_stone", 3.9593, 0.0, 0.52) == ()
    assert published_errors("pvc", 3.9593, 0.35, 0.6) == ()
    assert published_errors("oil", 3.9593, 0.0, 0.6) == ()
    assert published_errors("natural_stone", 3.5, 0.0, 0.6) == ()


def test_the_published_means_are_those_of_the_text():
    means = [np.mean(list(table.values())) for table in (TABLE_4_3, TABLE_4_4)]
    assert means == pytest.approx([0.055, 0.023], abs=6e-4)


def test_ctrl_c_keeps_the_runs_that_were_finished(rig, floors, runs):
    def stop(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    found = validate(dataset(*runs), rig, floors, ("planar",), stop)
    assert found.interrupted and len(found.runs) == 2 and len(found.cells) == 1


def test_other_plants_unknown_floors_and_impossible_masses_are_refused(rig, floors, runs):
    with pytest.raises(InputError, match=r"plant: found 'linear_axis'"):
        validate(dataset(*runs, plant="linear_axis"), rig, floors)
    with pytest.raises(UnknownNameError, match=r"--plant: unknown plant 'moon'"):
        validate(dataset(*runs), rig, floors, ("moon",))
    with pytest.raises(UnknownNameError, match="unknown floor 'pvc'"):
        validate(dataset(runs[2]), rig, {"natural_stone": floors["natural_stone"]}, ("planar",))
    light = Run("light", runs[0].columns, {}, {"floor": "pvc", "mass": 0.1})
    with pytest.raises(InputError, match=r"run light: mass: found 0\.1; must be above wheel\.mass"):
        validate(dataset(light), rig, floors, ("planar",))
