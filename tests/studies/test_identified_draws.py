"""Random truth about an identified robot: its own wheels stay, and its intervals bound the draws."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from omnimj.effects import Interval, apply_effects, with_further_effects
from omnimj.effects.model_writer import format_model
from omnimj.errors import InputError
from omnimj.parameters import read_robot
from omnimj.resources import models_folder
from omnimj.studies.evaluation.cases import CasePopulation, draw_cases, nominal_scenario, require_four_wheels
from omnimj.studies.evaluation.trial import make_true_plant
from omnimj.studies.random_truth import BOUNDS, draw_parameter_errors, true_robot

SCALES = (1.06, 0.95, 1.0, 0.98)
HALF = 0.004


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Model file as `omnimj identify` writes it."""
    effects = {
        f"torque_constant{'' if k == 1 else f'_{k}'}": {
            "wheel": k,
            "scale": Interval(scale, scale - HALF, scale + HALF),
        }
        for k, scale in enumerate(SCALES, start=1)
    }
    changed = {
        "body.mass": Interval(17.0, 16.83, 17.17, "kg"),
        "wheel.roller_dry": Interval(0.02, 0.018, 0.022),
        "motor.viscous": 1e-5,
    }
    path = tmp_path_factory.mktemp("identified") / "model.toml"
    text = format_model(models_folder() / "uto_robot" / "robot.toml", effects, changed)
    path.write_text(text, encoding="utf-8")
    return path


def test_identified_numbers_vary_within_their_intervals_and_others_as_ever(file):
    robot, random = read_robot(file), np.random.default_rng(1)
    drawn = [draw_parameter_errors(random, robot) for _ in range(400)]
    torque = np.array([one.torque_constants for one in drawn]) - 1.0
    assert np.abs(torque).max(axis=0) == pytest.approx([HALF / scale for scale in SCALES], rel=0.05)
    for name, half in (("body.mass", 0.01), ("wheel.roller_dry", 0.1), ("bearing.dry", BOUNDS["friction"])):
        factors = np.array([one.constants[name] for one in drawn])
        assert np.abs(factors - 1.0).max() == pytest.approx(half, rel=0.05)
    assert not any(one.payload for one in drawn)


def test_a_robot_that_was_not_identified_is_drawn_as_before():
    errors = draw_parameter_errors(np.random.default_rng(5), read_robot())
    again = np.random.default_rng(5).uniform(-1.0, 1.0, 7)
    assert errors.constants["motor.no_load_torque"] == 1.0 + BOUNDS["friction"] * again[0]
    assert errors.constants["body.yaw_inertia"] == 1.0 + BOUNDS["inertia"] * again[4]


def test_the_true_robot_keeps_what_was_identified_of_each_wheel(file):
    robot = read_robot(file)
    errors = draw_parameter_errors(np.random.default_rng(2), robot)
    true = apply_effects(true_robot(robot, errors)).torque_scale
    assert true == pytest.approx(np.array(SCALES) * np.array(errors.torque_constants), rel=1e-12)
    more = with_further_effects(robot, [("torque_constant", {"wheel": 1, "scale": 0.5})] * 12)
    assert apply_effects(more).torque_scale[0] == pytest.approx(SCALES[0] * 0.5**12)


def test_a_case_of_an_identified_robot_has_its_constants(file, tmp_path):
    population = CasePopulation("manoeuvres", 100, faults=("none",), model=file, structure="drawn")
    case = draw_cases(population, [3])[0]
    scenario = nominal_scenario(case)
    assert scenario.robot.body.mass == pytest.approx(17.0)
    plant = make_true_plant(case, scenario, ())
    plant.close()
    assert case.to_dict()["model"] == str(file)
    assert "model" not in draw_cases(CasePopulation(), [0])[0].to_dict()
    assert len(population.plan()["model"]["sha256"]) == 16
    assert CasePopulation(model=Path("uto_robot")).plan()["model"]["file"].endswith("robot.toml")
    with pytest.raises(InputError, match=r"has 3 \[\[wheels\]\].*4 wheels"):
        require_four_wheels(CasePopulation(model=Path("three_wheel")))
    with pytest.raises(InputError, match="no such file"):
        require_four_wheels(CasePopulation(floors_file=tmp_path / "none.toml"))
