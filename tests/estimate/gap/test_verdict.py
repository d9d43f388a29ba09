"""The next experiment is the run in which the rivals' predictions differ most."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.gap.plants import PLANTS, find_plant, read_machine
from omnimj.estimate.gap.verdict import next_experiment
from omnimj.estimate.replay.interface import Experiment
from omnimj.estimate.replay.problem import Fit, Problem

RUNS = tuple(Experiment(f"run_{k}", f"run {k}", {"gain": float(k)}) for k in range(4))


class Linear:
    """Predictions proportional to the gain of a run and the first parameter of a model."""

    base = ()

    def candidate_experiments(self):
        return RUNS

    def predict(self, settings, experiment):
        return [np.full((5, 1), setting.base[0] * experiment.run["gain"]) for setting in settings]


def problem(replay) -> Problem:
    split = SimpleNamespace(
        replay=replay, noise=np.array([0.5]), split=lambda x, effects: (SimpleNamespace(base=x), 0.0)
    )
    return cast(Problem, cast(Any, split))


def fitted(value: float) -> Fit:
    return Fit((), np.array([value]), np.zeros((5, 1)), np.zeros((5, 0)), 0.0)


def test_the_run_with_the_largest_difference_is_chosen():
    found = next_experiment(problem(Linear()), fitted(1.0), [("rival", fitted(2.0))])
    assert found is not None
    assert found["run"] == {"gain": 3.0}
    assert found["parting"] == {"rival": pytest.approx(6.0)}
    assert found["separates"] == ["rival"]


def test_rivals_with_equal_predictions_are_not_separated():
    found = next_experiment(problem(Linear()), fitted(1.0), [("twin", fitted(1.0)), ("rival", fitted(0.0))])
    assert found is not None and found["separates"] == ["rival"]


def test_without_rivals_there_is_no_experiment():
    assert next_experiment(problem(Linear()), fitted(1.0), []) is None


def test_a_plant_reads_its_own_model_files_only():
    for name, plant in PLANTS.items():
        if plant.model is None:
            continue
        assert read_machine(name, None) == plant.read(None)
    with pytest.raises(InputError, match="plant: found 'quarter_rig'"):
        read_machine("uto_robot", read_machine("quarter_rig", None).file)
    with pytest.raises(UnknownNameError, match="quarter_rig"):
        find_plant("hovercraft")
