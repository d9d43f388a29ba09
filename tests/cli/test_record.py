"""`omnimj record`: exit codes, one line per error, and what is printed but not written."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from omnimj.cli.main import main
from omnimj.recording.read_dataset import read_dataset
from omnimj.signals import Trace

Refused = Callable[..., str]
QUICK = ("--plant", "planar", "--repeats", "1")


@pytest.fixture
def two_runs(monkeypatch):
    """Suites of their first two runs."""
    from omnimj.simulate.suites import recording

    def first_two(*arguments, **keywords):
        return planned(*arguments, **keywords)[:2]

    planned = recording.planned_runs
    monkeypatch.setattr(recording, "planned_runs", first_two)


def test_a_dataset_is_written_and_summarised(two_runs, tmp_path, capsys):
    out = tmp_path / "set"
    assert main(["record", "rig_currents", *QUICK, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "rig_currents: identification" in printed and "2 of 2 runs" in printed and str(out) in printed
    assert [run.name for run in read_dataset(out).runs] == ["stone_015", "stone_030"]


def test_json_holds_the_command_the_effects_and_the_seed(two_runs, tmp_path, capsys):
    out = tmp_path / "set"
    effect = "rail_viscous:coefficient=1.5"
    argv = ["record", "rig_currents", *QUICK, "--effect", effect, "--seed", "7", "--json", "--out", str(out)]
    assert main([*argv, "--format", "csv"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (
        content["effects"] == [effect]
        and content["seed"] == 7
        and content["runs"] == ["stone_015", "stone_030"]
    )
    assert content["command"].startswith("omnimj record rig_currents --plant planar")
    assert not content["interrupted"] and content["dataset"] == str(out)
    written = (out / "dataset.toml").read_text(encoding="utf-8")
    assert "viscous" not in written and "seed" not in written and "7" not in written
    assert sorted(file.name for file in out.iterdir()) == ["dataset.toml", "stone_015.csv", "stone_030.csv"]


def test_ctrl_c_keeps_what_was_finished(two_runs, tmp_path, capsys, monkeypatch):
    from omnimj.simulate.suites import rig

    def interrupted(plant, current, watch):
        trace = drive_rig(plant, current, watch)
        return Trace(trace.columns, {**trace.about, "interrupted": current[-1] > 0.2})

    drive_rig = rig.drive_rig
    monkeypatch.setattr(rig, "drive_rig", interrupted)
    assert main(["record", "rig_currents", *QUICK, "--out", str(tmp_path / "set")]) == 130
    printed = capsys.readouterr().out
    assert "interrupted" in printed and "1 of 2 runs" in printed
    assert [run.name for run in read_dataset(tmp_path / "set").runs] == ["stone_015"]


def test_an_earlier_dataset_is_kept_without_force(two_runs, tmp_path, capsys):
    argv = ["record", "rig_currents", *QUICK, "--out", str(tmp_path / "set")]
    assert main(argv) == 0
    assert main(argv) == 2
    assert "is not empty" in capsys.readouterr().err
    assert main([*argv, "--force", "--format", "csv"]) == 0
    assert not list((tmp_path / "set").glob("*.parquet"))


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        ([], "required: suite, --out"),
        (["rig_currents"], "required: --out"),
        (["rig_current", "--out", "x"], "unknown suite 'rig_current'; did you mean 'rig_currents'?"),
        (["rig_currents", "--out", "x", "--plant", "Twin"], "--plant: unknown plant of rig_currents 'Twin'"),
        (["rig_currents", "--out", "x", "--format", "xls"], "--format: unknown format 'xls'; choices: csv"),
        (["rig_currents", "--out", "x", "--seed", "-1"], "argument --seed: found '-1'"),
        (["rig_currents", "--out", "x", "--seed", "1.5"], "argument --seed: found '1.5'"),
        (["rig_currents", "--out", "x", "--seed", str(2**63)], "at most 9223372036854775807"),
        (["rig_currents", "--out", "x", "--repeats", "0"], "argument --repeats: found '0'"),
        (["rig_currents", "--out", "x", "--repeats", "27"], "at least 1 and at most 26"),
        (["rig_currents", "--out", "x", "--effect", "rust"], "unknown effect of quarter_rig 'rust'"),
        (["rig_currents", "--out", "x", "--effect", "grade:slop=1"], "did you mean 'slope'?"),
        (["rig_currents", "--out", "x", "--effect", "grade:slope=x"], "found 'x'; a number is needed"),
        (["rig_currents", "--out", "x", "--effect", "wheel_misalignment"], "unknown effect of quarter_rig"),
        (
            ["rig_currents", "--out", "x", "--effect", "grade", "--effect", "grade"],
            "'grade' is given twice; a second one is called grade_2",
        ),
        (["rig_currents", "--out", "x", "--model", "no.toml"], "no.toml: no such file"),
        (["rig_currents", "--outt", "x"], "required: --out"),
    ],
)
def test_bad_input_is_one_line(refused: Refused, argv, expected):
    assert expected in refused("record", *argv)


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(refused: Refused, tmp_path: Path):
    (tmp_path / "file").write_text("")
    assert "is a file" in refused("record", "rig_currents", "--out", str(tmp_path / "file"))
