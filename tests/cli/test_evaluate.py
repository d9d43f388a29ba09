"""Bad flags of `omnimj evaluate`: one line, nothing driven."""

from __future__ import annotations

import pytest

from omnimj.resources import models_folder


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        (["--suite", "race"], "--suite: unknown suite 'race'; choices: manoeuvres, missions"),
        (["--method", "best"], "--method: unknown method 'best'; did you mean 'robust'?; choices: off"),
        (["--plant", "real"], "--plant: unknown plant 'real'; choices: planar, twin"),
        (["--plant", "planar,,twin"], "names with commas between them"),
        (["--faults", "slipp"], "--faults: unknown class of faults 'slipp'; did you mean 'slip'?"),
        (["--floor", "lava"], "--floor: unknown floor of the evaluation 'lava'"),
        (["--structure", "real"], "--structure: unknown structure 'real'; choices: drawn, nominal"),
        (["--trials", "0"], "--trials: found '0'; must be a whole number, at least 1"),
        (["--seed", "-1"], "--seed: found '-1'"),
        (["--workers", "many"], "--workers: found 'many'"),
        (["--set", "floor=pvc"], "--set floor: cannot be set here; cases are drawn"),
        (["--set", "diagnosis.variant=best"], "--set diagnosis.variant: unknown variant 'best'"),
        (["--set", "diagnosis.colour=red"], "unknown key"),
        (["--thresholds", "t.toml"], "--thresholds t.toml: the method is 'off'; they are those of 'robust'"),
        (["--method", "robust", "--thresholds", "t.toml"], "t.toml: no such file"),
        (["--sede", "1"], "unknown option '--sede'; did you mean '--seed'?"),
    ],
)
def test_a_flag_out_of_its_range(refused, argv, expected):
    assert expected in refused("evaluate", "--out", "out", *argv)


def test_out_is_needed_and_must_be_empty(refused, tmp_path):
    assert "required: --out" in refused("evaluate")
    (tmp_path / "mine.txt").touch()
    assert "is not empty" in refused("evaluate", "--out", str(tmp_path))


def test_an_effect_of_the_model_file_that_does_not_exist_is_refused_before_any_case(refused, tmp_path):
    shipped = (models_folder() / "uto_robot" / "robot.toml").read_text(encoding="utf-8")
    effect = "\n[effects.nonsense]\nx = { value = 1.0, unit = '1', source = 'chosen' }\n"
    model = tmp_path / "bad.toml"
    model.write_text(shipped + effect, encoding="utf-8")
    message = refused("evaluate", "--out", str(tmp_path / "out"), "--model", str(model))
    assert "bad.toml: effects" in message and "unknown effect of uto_robot 'nonsense'" in message
    assert not (tmp_path / "out").exists()
