"""What a tuning goes on with, where its workers may be, and what it reports before hours are spent."""

from __future__ import annotations

import dataclasses
import re

import pytest
from inline_executor import InlineExecutor, quiet
from short_push import scenario_file

from omnimj.errors import InputError
from omnimj.parameters import read_robot
from omnimj.studies.tuning import trial
from omnimj.studies.tuning.cost import Limits, score
from omnimj.studies.tuning.draws import draw_trial, read_tuned_scenarios
from omnimj.studies.tuning.margins import LoopStability
from omnimj.studies.tuning.study import run_tuning
from omnimj.studies.tuning.trial import drive_trial


def test_trials_of_another_robot_scenario_or_version_are_never_gone_on_with(order, tmp_path):
    model = tmp_path / "robot.toml"
    text = read_robot().file.read_text(encoding="utf-8")
    model.write_text(text, encoding="utf-8")
    changed = dataclasses.replace(order, model=model)
    before = changed.plan()
    assert changed.plan() == before
    heavier = re.sub(r"(?m)^mass = \{ value = [\d.]+", "mass = { value = 21.0", text)
    assert heavier != text
    model.write_text(heavier, encoding="utf-8")
    assert changed.plan()["digests"] != before["digests"]
    model.write_text(text, encoding="utf-8")
    scenario_file(tmp_path, duration=0.7)
    assert changed.plan()["digests"] != before["digests"]
    scenario_file(tmp_path)
    assert changed.plan() == before


def test_another_folders_worker_reads_the_same_scenario(order, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    (scenario,) = read_tuned_scenarios(("push.toml",), None).values()
    draw = draw_trial("push.toml", scenario, 3, 0, "planar")
    here = drive_trial(draw, {}, None)
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert "facts" in here and drive_trial(draw, {}, None) == here


@pytest.mark.slow
def test_gains_before_that_break_a_judging_run_down_are_reported_before_the_search(order, monkeypatch):
    drive, driven = trial.drive_trial, []

    def fragile(draw, values, uses, thresholds):
        driven.append(draw.name)
        found = drive(draw, values, uses, thresholds)
        return found | {"facts": {"broke": "at 0.1 s: x is nan"}} if "_100_" in draw.name else found

    monkeypatch.setattr(trial, "drive_trial", fragile)
    with pytest.raises(InputError, match="a run with the gains before failed"):
        run_tuning(order, quiet, InlineExecutor())
    assert len(driven) == order.trials + order.judging


def test_a_candidate_with_more_margin_never_costs_more_for_it():
    costs = [
        score((), (), LoopStability(phase, 0.1), LoopStability(-10.0, 0.1), Limits()).cost
        for phase in (-20.0, 20.0, 41.0, 50.0)
    ]
    assert costs == sorted(costs, reverse=True)
    assert score(
        (), (), LoopStability(-10.0, 0.1), LoopStability(-10.0, 0.1), Limits()
    ).cost == pytest.approx(1.0)
