"""`omnimj tune` and `--gains`: what is written, printed and refused."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest
from inline_executor import InlineExecutor
from mentions import mentions
from short_push import scenario_file

from omnimj.cli.main import main
from omnimj.control.detection.robust.thresholds import Thresholds, read_thresholds
from omnimj.studies import workers
from omnimj.studies.tuning import study, trial

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture
def push(tmp_path, monkeypatch) -> list[str]:
    """The command over a scenario of half a second, the work done at once."""
    monkeypatch.setattr(workers, "ProcessPoolExecutor", lambda *given, **named: InlineExecutor())
    small = ["--trials", "1", "--judging", "1", "--generations", "1", "--landscape", "0"]
    argv = ["tune", scenario_file(tmp_path, faults=""), "--only", "control.speed_proportional", *small]
    return [*argv, "--out", str(tmp_path / "g.toml")]


def test_the_command_writes_gains_and_a_page_and_its_exit_code_is_the_verdict(push, tmp_path, capsys):
    code = main(push)
    out, err = capsys.readouterr()
    content = tomllib.loads((tmp_path / "g.toml").read_text(encoding="utf-8"))["tuned"]
    assert code == (0 if content["better"] else 1)
    assert (
        content["command"].startswith("omnimj tune ")
        and "--only control.speed_proportional" in content["command"]
    )
    assert "phase margin" in out and mentions(out, "seed 100", "planar")
    assert "\r" not in err, "a pipe sees no progress bar"
    page = (tmp_path / "g_report.html").read_text(encoding="utf-8")
    assert "The search" in page and "Speed against robustness" in page
    assert main([*push, "--force", "--json"]) == code
    found = json.loads(capsys.readouterr().out)
    assert found["better"] == content["better"] and found["gains"].keys() == found["before"].keys()
    assert found["judged"][0]["before"]["cost"] == pytest.approx(1.0)


@pytest.mark.slow
def test_thresholds_from_a_file_are_those_that_candidates_are_driven_with(push, tmp_path, monkeypatch):
    file, seen = tmp_path / "t.toml", []
    units = {"motor": "nats", "drag": "nats", "accelerometer": "nats", "slip": "m", "worn": "1"}
    lines = [
        f'{name} = {{ value = 0.9, unit = "{unit}", source = "measured" }}' for name, unit in units.items()
    ]
    file.write_text("[thresholds]\n" + "\n".join(lines), encoding="utf-8")
    drive = trial.drive_trial

    def noting(draw, values, uses, thresholds=None):
        seen.append(thresholds)
        return drive(draw, values, uses, thresholds)

    monkeypatch.setattr(trial, "drive_trial", noting)
    assert main([*push, "--thresholds", str(file)]) in (0, 1)
    assert set(seen) == {read_thresholds(file)}
    assert main([*push, "--force"]) in (0, 1)
    plan = json.loads((tmp_path / "g_trials" / "tuning_plan.json").read_text(encoding="utf-8"))
    assert plan["thresholds"]["motor"] == Thresholds().motor and None in seen


def test_a_result_that_is_not_better_is_reported_and_exits_with_1(push, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("omnimj.studies.tuning.cost.Score.is_better_than", lambda self, other: False)
    assert main(push) == 1
    assert "NOT BETTER than the gains before" in capsys.readouterr().out
    text = (tmp_path / "g.toml").read_text(encoding="utf-8")
    assert "# NOT BETTER" in text and tomllib.loads(text)["tuned"]["better"] is False
    assert "NOT BETTER" in (tmp_path / "g_report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_ctrl_c_keeps_what_was_driven_and_the_same_command_ends_as_if_it_had_not_been(
    push, tmp_path, monkeypatch, capsys
):
    drive, left = study.TrialBatch.drive, [2]

    def broken_off(self, candidates, draws):
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt
        return drive(self, candidates, draws)

    monkeypatch.setattr(study.TrialBatch, "drive", broken_off)
    assert main(push) == 130
    assert not (tmp_path / "g.toml").exists() and not (tmp_path / "g_report.html").exists()
    assert list((tmp_path / "g_trials").glob("trial_*"))
    monkeypatch.setattr(study.TrialBatch, "drive", drive)
    assert main(push) in (0, 1)
    text = (tmp_path / "g.toml").read_text(encoding="utf-8")
    again = [*push, "--force"]
    (tmp_path / "g_trials").rename(tmp_path / "aside")
    main(again)
    whole = (tmp_path / "g.toml").read_text(encoding="utf-8")
    assert whole.replace(" --force", "") == text
    capsys.readouterr()


def test_a_file_that_is_there_is_not_replaced_without_force(push, tmp_path, capsys):
    (tmp_path / "g.toml").write_text("mine")
    assert main(push) == 2
    assert mentions(capsys.readouterr().err, "g.toml", "exists already", "--force")
    assert (tmp_path / "g.toml").read_text() == "mine"


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        (["nylon_path"], "unknown scenario 'nylon_path'; did you mean 'nylon_patch'"),
        (["rig_slip"], "SCENARIO rig_slip: cannot be used for tuning; a scenario of a robot with forces"),
        (["nylon_patch", "nylon_patch"], "'nylon_patch' occurs twice"),
        (
            ["nylon_patch", "--seed", "100"],
            "--seed: found '100'; must be a whole number, at least 0 and at most 99",
        ),
        (["nylon_patch", "--trials", "0"], "--trials: found '0'"),
        (["nylon_patch", "--only", "gravity"], "--only: unknown gain 'gravity'; choices: control,"),
        (["nylon_patch", "--plant", "real"], "--plant: unknown plant 'real'; choices: planar, twin"),
        (["nylon_patch", "--plant", "twin", "--twin", "2"], "--twin: found 2; --plant twin judges on it"),
        (["nylon_patch", "--landscape", "1"], "--landscape: found '1'; must be 0, or at least 2"),
        (["nylon_patch", "--bound", "recovery.slip_cap=-1:2"], "the smallest value must be 0 or more"),
        (["nylon_patch", "three_wheel_circle"], "all scenarios must be of one robot: pass --model"),
        (["nylon_patch", "--out", "."], "--out .: is a folder; a file is needed"),
        (["nylon_patch", "--saturation", "0"], "--saturation: found '0'; must be above 0"),
        (["nylon_patch", "--phase-margin", "wide"], "--phase-margin: found 'wide'"),
        (["nylon_patch", "--overshoot", "-1"], "--overshoot: found '-1'"),
        (["nylon_patch", "--gains", "none.toml"], "none.toml"),
        (
            ["nylon_patch", "--bound", "control.mass=1:"],
            "--bound: unknown gain 'control.mass'; choices: control.",
        ),
        (["nylon_patch", "--bound", "recovery.slip_cap"], "has the wrong form; write NAME=LOW:HIGH"),
        (["nylon_patch", "--bound", "recovery.slip_cap=a:"], "found 'a:'; two numbers separated by :"),
        (
            ["nylon_patch", "--bound", "recovery.slip_cap=2:1"],
            "found 2 and 1; the smallest value must be 0 or more",
        ),
        (["nylon_patch", "--bound", "recovery.slip_cap=1:2"], "the gain before is 0.2; must be from 1 to 2"),
        (
            ["nylon_patch", "--only", "control", "--bound", "recovery.slip_cap=0:2"],
            "--bound recovery.slip_cap: this gain is not tuned",
        ),
        (
            ["nylon_patch", "--executor", "tcp://a:1"],
            "--executor: found 'tcp://a:1'; an executor is one of these; choices: dask:tcp://HOST:PORT, ",
        ),
        (["nylon_patch", "--generations", "2", "--evaluations", "9"], "not allowed with argument"),
        (["nylon_patch", "--out", "no/such/g.toml"], "there is no folder no/such"),
        (["nylon_patch", "--model", "mine.toml"], "mine.toml: no such file"),
        ([], "required: SCENARIO"),
    ],
)
def test_a_flag_out_of_its_range(refused, argv, expected):
    out = [] if "--out" in argv else ["--out", "g.toml"]
    assert expected in refused("tune", *argv, *out)


def test_out_is_needed(refused):
    assert "required: --out" in refused("tune", "nylon_patch")


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        (["run", "nylon_patch"], "unknown gain 'speed'; choices: heading_proportional"),
        (["evaluate", "--out", "out"], "unknown gain 'speed'; choices: heading_proportional"),
        (["run", "rig_slip"], "--gains: rig_slip is driven on the test rig; it has no cascade"),
        (["evaluate", "--executor", "dask:here", "--out", "out"], "--executor: found 'dask:here'"),
        (
            ["sensitivity", "nylon_patch", "--executor", "dask:here", "--out", "out"],
            "--executor: found 'dask:here'",
        ),
        (
            ["evaluate", "--executor", "dask:tcp://a:1", "--record", "--out", "out"],
            "--record: found with --executor dask:tcp://a:1; recordings would stay on the disks",
        ),
    ],
)
def test_gains_and_executors_of_other_commands(refused, tmp_path, argv, expected):
    file = tmp_path / "bad.toml"
    file.write_text('[control]\nspeed = { value = 1.0, unit = "A", source = "tuned" }\n')
    gains = [] if "--executor" in argv else ["--gains", str(file)]
    assert expected in refused(*argv, *gains)


def test_gains_are_driven_with(tmp_path, capsys):
    scenario, file = scenario_file(tmp_path, faults=""), tmp_path / "g.toml"
    file.write_text('[control]\nspeed_proportional = { value = 0.1, unit = "A.s/rad", source = "tuned" }\n')

    def current(*more: str) -> float:
        assert main(["run", scenario, "--plant", "planar", "--json", *more]) == 0
        return json.loads(capsys.readouterr().out)["tracking_error_max"]

    assert current("--gains", str(file)) > 1.05 * current()


def test_an_evaluation_is_distinguished_from_one_with_other_gains(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(workers, "ProcessPoolExecutor", lambda *given, **named: InlineExecutor())
    file = tmp_path / "g.toml"
    file.write_text('[control]\nspeed_proportional = { value = 0.1, unit = "A.s/rad", source = "tuned" }\n')
    argv = ["evaluate", "--suite", "manoeuvres", "--trials", "1", "--faults", "motor", "--out"]
    argv += [str(tmp_path / "out")]
    assert main(argv) == 0
    before = json.loads(Path(tmp_path / "out" / "evaluation.json").read_text())
    assert main([*argv, "--gains", str(file)]) == 2
    assert "holds an evaluation with other settings" in capsys.readouterr().err
    assert main([*argv, "--gains", str(file), "--force"]) == 0
    after = json.loads(Path(tmp_path / "out" / "evaluation.json").read_text())
    assert after["plan"]["gains"]["control.speed_proportional"] == 0.1
    assert before["plan"]["gains"] != after["plan"]["gains"] and before["cases"] != after["cases"]
