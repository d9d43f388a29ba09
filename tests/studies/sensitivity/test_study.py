"""A study as a whole: what it drives, keeps and refuses, and that it finds what must be found."""

from __future__ import annotations

import dataclasses
import json
import math
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from in_process import SHORT_RIG, SHORT_ROBOT, order_of
from inline_executor import InlineExecutor, quiet
from scipy.stats import sobol_indices, uniform

from omnimj.errors import InputError, SimulationError, UnknownNameError
from omnimj.signals import Trace
from omnimj.simulate.run import RunResult
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.studies.sensitivity import trial
from omnimj.studies.sensitivity.elementary_effects import NONE
from omnimj.studies.sensitivity.factors import find_factors
from omnimj.studies.sensitivity.study import REPEATS, SensitivityResult, run_sensitivity

RIG = len(find_factors(read_scenario("rig_constant_current"))[0])


def numbers(folder) -> dict:
    return json.loads((folder / "sensitivity.json").read_text(encoding="utf-8"))


def study_named(outcome: SensitivityResult, name: str):
    return next(study for study in outcome.studies if study.name == name)


def mu_star(outcome: SensitivityResult, result: str) -> dict[str, float]:
    study = study_named(outcome, result)
    return {one.name: m.mu_star for one, m in zip(outcome.factors, study.measures, strict=True)}


@pytest.fixture(scope="module")
def driven(tmp_path_factory) -> tuple[Path, InlineExecutor, SensitivityResult]:
    """A study of the rig: its folder, what was driven and the result."""
    out, executor = tmp_path_factory.mktemp("driven") / "out", InlineExecutor()
    return out, executor, run_sensitivity(order_of(out), quiet, executor)


@pytest.mark.slow
def test_a_study_drives_every_point_once_and_goes_on_where_it_stood(tmp_path, driven):
    folder, first, outcome = driven
    shutil.copytree(folder, tmp_path / "out")
    order = order_of(tmp_path / "out")
    assert len(first.calls) == REPEATS + 2 * (RIG + 1) and outcome.runs == 2 * (RIG + 1)
    assert {seed for _, values, seed in first.arguments if values} == {0}, "the same noise in all of them"
    assert sorted(seed for _, values, seed in first.arguments if not values) == list(range(REPEATS))
    before = numbers(tmp_path / "out")
    (tmp_path / "out" / "runs" / "trajectory_0001_007.json").unlink()
    again = InlineExecutor()
    run_sensitivity(order, quiet, again)
    assert len(again.calls) == 1 and numbers(tmp_path / "out") == before
    more = InlineExecutor()
    run_sensitivity(dataclasses.replace(order, trajectories=3), quiet, more)
    assert len(more.calls) == RIG + 1 and numbers(tmp_path / "out")["runs"] == 3 * (RIG + 1)


@pytest.mark.slow
def test_the_floor_is_the_effect_of_noise_or_the_smallest_measurable_change(driven):
    *_, outcome = driven
    travel, current = study_named(outcome, "travel"), study_named(outcome, "rms_current")
    assert (travel.noise, travel.floor) == (0.0, 1e-3)  # currents are given: no sensor acts on what it does
    assert current.noise > 0.0 and current.floor == max(current.noise, 1e-3)
    assert outcome.repeats == REPEATS


@pytest.mark.slow
def test_every_executor_gives_the_same_numbers(tmp_path, driven):
    with ThreadPoolExecutor(2) as executor:
        run_sensitivity(order_of(tmp_path / "out"), quiet, executor)
    assert numbers(tmp_path / "out") == numbers(driven[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    "other",
    [
        {"seed": 1},
        {"share": 0.1},
        {"sources": ("chosen", "text")},
        {"trial": dataclasses.replace(SHORT_RIG, overrides=("duration=0.1", "checks={}", "current=1"))},
        {"trial": dataclasses.replace(SHORT_RIG, method="published")},
    ],
    ids=lambda other: next(iter(other)),
)
def test_another_study_in_the_folder_is_not_mixed_with_this_one(tmp_path, other, monkeypatch):
    monkeypatch.setattr("omnimj.studies.sensitivity.study.drive_with", lambda *_: {"results": {}})
    order = order_of(tmp_path / "out")
    run_sensitivity(order, quiet, InlineExecutor())
    with pytest.raises(InputError, match="holds a sensitivity study with other settings"):
        run_sensitivity(dataclasses.replace(order, **other), quiet, InlineExecutor())
    forced = InlineExecutor()
    run_sensitivity(dataclasses.replace(order, force=True, **other), quiet, forced)
    assert len(forced.calls) > 2 * RIG


def test_a_number_that_is_not_varied_is_part_of_the_study_too(tmp_path, monkeypatch):
    monkeypatch.setattr("omnimj.studies.sensitivity.study.drive_with", lambda *_: {"results": {}})
    model = tmp_path / "rig.toml"
    model.write_text(read_scenario("rig_slip").constants.file.read_text(encoding="utf-8"), encoding="utf-8")
    order = order_of(tmp_path / "out", dataclasses.replace(SHORT_RIG, model=model))
    run_sensitivity(order, quiet, InlineExecutor())
    model.write_text(model.read_text(encoding="utf-8").replace("0.304", "0.4"), encoding="utf-8")
    with pytest.raises(InputError, match="holds a sensitivity study with other settings"):
        run_sensitivity(order, quiet, InlineExecutor())


def test_a_folder_with_something_else_is_left_alone(tmp_path):
    (tmp_path / "mine.txt").write_text("precious")
    with pytest.raises(InputError, match="is not empty"):
        run_sensitivity(order_of(tmp_path), quiet, InlineExecutor())


@pytest.mark.slow
def test_ctrl_c_keeps_what_was_driven_and_reports_it(tmp_path):
    def interrupted(phrase: str, share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    outcome = run_sensitivity(order_of(tmp_path / "out"), interrupted, InlineExecutor())
    assert outcome.interrupted and numbers(tmp_path / "out")["interrupted"]
    assert 0 < outcome.runs < 2 * (RIG + 1) and outcome.studies
    rest = InlineExecutor()
    assert not run_sensitivity(order_of(tmp_path / "out"), quiet, rest).interrupted
    assert len(rest.calls) == REPEATS + 2 * (RIG + 1) - outcome.runs - outcome.repeats


@pytest.mark.slow
def test_a_run_that_breaks_down_costs_its_own_effects_alone_and_is_tried_again(tmp_path, monkeypatch):
    drive, broken = trial.drive_with, []

    def breaking(config, values, seed):
        if values and len(broken) < 1:
            broken.append(values)
            return {"error": "SimulationError: it flew away"}
        return drive(config, values, seed)

    monkeypatch.setattr("omnimj.studies.sensitivity.study.drive_with", breaking)
    outcome = run_sensitivity(order_of(tmp_path / "out"), quiet, InlineExecutor())
    assert list(outcome.errors.values()) == ["SimulationError: it flew away"]
    counts = sorted(one.count for one in study_named(outcome, "travel").measures)
    assert counts == [1] + [2] * (RIG - 1)  # the first point of a trajectory has one neighbour
    assert not run_sensitivity(order_of(tmp_path / "out"), quiet, InlineExecutor()).errors


def test_a_simulation_that_fails_is_an_error_and_not_a_result(monkeypatch):
    trace = Trace({}, {"failure": "at 0.1 s: x is nan", "interrupted": True})
    scenario = read_scenario("rig_slip")
    monkeypatch.setattr(trial, "run_scenario", lambda *_, **__: RunResult(scenario, trace, {}))
    assert "x is nan" in trial.drive_with(SHORT_RIG, {}, 0)["error"]
    assert SimulationError.__name__ in trial.drive_with(SHORT_RIG, {}, 0)["error"]


def test_nothing_of_that_origin_and_no_such_origin_are_refused(tmp_path):
    with pytest.raises(InputError, match="there is nothing to vary"):
        run_sensitivity(order_of(tmp_path / "out", sources=("identified",)), quiet, InlineExecutor())
    with pytest.raises(UnknownNameError, match="unknown source 'guessed'"):
        run_sensitivity(order_of(tmp_path / "out", sources=("guessed",)), quiet, InlineExecutor())
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_what_the_planar_robot_does_not_have_changes_exactly_nothing(tmp_path):
    outcome = run_sensitivity(order_of(tmp_path / "out", SHORT_ROBOT, 1), quiet, InlineExecutor())
    absent = ("body.suspension_", "contact.", "wheel.mass", "wheel.roller_radius", "sensors.carriage_")
    for study in outcome.studies:
        for one, found, word in zip(outcome.factors, study.measures, study.verdicts, strict=True):
            if one.name.startswith(absent):
                assert found.mu_star == 0.0 and word == NONE, (study.name, one.name)
    assert mu_star(outcome, "mean_speed")["wheel.radius"] > 0.0


RANGES = {one.name: one for one in find_factors(read_scenario("rig_constant_current"))[0]}
ACTING = (
    "motor.gear_efficiency",
    "motor.torque_constant",
    "motor.no_load_torque",
    "motor.rotor_inertia",
    "wheel.inertia",
    "wheel.radius",
    "bearing.dry",
)
CURRENT, TIME = 0.5, 0.5  # [A, s]: far from where the supply leaves no more current


def travel(x):
    """½ a t² of the rig whose wheel rolls without slip, in closed form; x: the numbers above, shape (7, n).

    a = {[(K_t i − T_nl) E G − T_bearing]/r − F_rail}/{m + [I + J E G²]/r²}, the bearings' dry torque by
    Eqs. 4.37-4.38 without lateral force.
    """
    rig = read_scenario("rig_constant_current").constants
    efficiency, constant, no_load, rotor, inertia, radius, dry = x
    ratio, mass, normal = rig.motor.gear_ratio, rig.rig.masses[0], rig.rig.masses[0] * 9.81
    a, b = rig.bearing.spacing, rig.bearing.overhang
    bearing = dry * normal * ((a + b) / a + b / a) * rig.bearing.pitch_diameter / 2.0
    drive = ((constant * CURRENT - no_load) * efficiency * ratio - bearing) / radius - rig.rig.rail_friction
    return 0.5 * drive / (mass + (inertia + rotor * efficiency * ratio**2) / radius**2) * TIME**2


@pytest.mark.slow
def test_the_rig_s_travel_at_constant_current_is_ranked_as_sobol_ranks_its_closed_form(tmp_path):
    settings = (f"duration={TIME}", f"current={CURRENT}", "checks={}")
    config = dataclasses.replace(SHORT_RIG, overrides=settings)
    outcome = run_sensitivity(order_of(tmp_path / "out", config, 3), quiet, InlineExecutor())
    found = mu_star(outcome, "travel")
    dists = [uniform(RANGES[name].low, RANGES[name].high - RANGES[name].low) for name in ACTING]
    total = sobol_indices(func=travel, n=2**11, dists=dists, rng=np.random.default_rng(0)).total_order
    ours = sorted(ACTING, key=lambda name: -found[name])
    theirs = [ACTING[i] for i in np.argsort(-total)]
    assert ours[:4] == theirs[:4]
    # and by how much: the square root of a total index goes like μ* where all is nearly linear
    expected = np.sqrt(total) / math.sqrt(max(total))
    assert [found[name] / max(found.values()) for name in ACTING] == pytest.approx(expected, abs=0.06)
    others = [
        name for name, value in found.items() if name not in ACTING and value > 0.1 * max(found.values())
    ]
    assert not others
