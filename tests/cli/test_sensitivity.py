"""`omnimj sensitivity` on the command line: files, exit codes, bad flags."""

from __future__ import annotations

import html
import json
import re

import pytest
from inline_executor import InlineExecutor

from omnimj.cli.main import main
from omnimj.studies import runner, workers
from omnimj.studies.sensitivity import study

SHORT = ("sensitivity", "rig_constant_current", "--set", "duration=0.2", "--set", "checks={}")
FILES = {
    "report.html",
    "runs",
    "sensitivity.json",
    "sensitivity.md",
    "sensitivity.svg",
    "sensitivity_plan.json",
}


@pytest.mark.slow
def test_a_study_writes_its_files_and_goes_on_without_driving_again(tmp_path, capsys, monkeypatch, undrawn):
    monkeypatch.setattr(workers, "ProcessPoolExecutor", lambda *_, **__: InlineExecutor())
    argv = [
        *SHORT,
        "--trajectories",
        "2",
        "--workers",
        "2",
        "--method",
        "off",
        "--out",
        str(tmp_path / "out"),
    ]
    assert main(argv) == 0
    printed = capsys.readouterr().out
    assert (
        "Measure first: motor." in printed
        and "nominal" in printed
        and f"written to {tmp_path / 'out'}" in printed
    )
    assert "the controller those of the model file" in printed and "it is 0" in printed
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES
    found = json.loads((tmp_path / "out" / "sensitivity.json").read_text(encoding="utf-8"))
    runs = 2 * (len(found["parameters"]) + 1)
    assert found["runs"] == runs and found["noise_runs"] == study.REPEATS and not found["errors"]
    assert 0.8 < sum(rank["share"] for rank in found["measure_first"]) <= 1.0
    page = html.unescape((tmp_path / "out" / "report.html").read_text(encoding="utf-8"))
    assert found["measure_first"][0]["parameter"] in page and "What changes which result" in page
    ids = re.findall(r'\sid="([^"]+)"', page)
    assert len(ids) == len(set(ids)), "every id of the page is there once"
    page = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    assert "http://" not in page and "https://" not in page
    written = (tmp_path / "out" / "runs" / "noise_00.json").stat().st_mtime_ns
    assert main([*argv, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == found
    assert (tmp_path / "out" / "runs" / "noise_00.json").stat().st_mtime_ns == written


def test_ctrl_c_exits_with_130_and_keeps_what_there_is(tmp_path, capsys, monkeypatch):
    def interrupting(work, *_):
        return False  # broken off before anything came back

    monkeypatch.setattr(runner, "run_in_workers", interrupting)
    assert main([*SHORT, "--out", str(tmp_path / "out")]) == 130
    printed = capsys.readouterr().out
    assert (
        "interrupted; the same command resumes it" in printed
        and "0 of " in printed
        and "finished (interrupted)" in printed
    )
    found = json.loads((tmp_path / "out" / "sensitivity.json").read_text(encoding="utf-8"))
    assert found["interrupted"] and found["results"] == {} and found["measure_first"] == []
    assert (tmp_path / "out" / "report.html").stat().st_size > 1000


def test_a_run_that_broke_down_exits_with_1_and_is_named(tmp_path, capsys, monkeypatch):
    def broken(work, *_):
        runs = tmp_path / "out" / "runs"
        (runs / "trajectory_0000_003.json").write_text('{"error": "SimulationError: it flew"}')
        return True

    monkeypatch.setattr(runner, "run_in_workers", broken)
    assert main([*SHORT, "--out", str(tmp_path / "out")]) == 1
    assert "trajectory_0000_003: SimulationError: it flew" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        ([], "the following arguments are required: scenario, --out"),
        (["nylon_pach", "--out", "o"], "unknown scenario 'nylon_pach'; did you mean 'nylon_patch'?"),
        (["circle_8m_kinematic", "--out", "o"], "is at the kinematic level"),
        (["ramp", "--out", "o"], "flat floor only"),
        (["nylon_patch"], "the following arguments are required: --out"),
        (["nylon_patch", "--out", "o", "--plant", "real"], "unknown plant 'real'"),
        (["nylon_patch", "--out", "o", "--plant", "udp:127.0.0.1:9750"], "in a simulation only"),
        (["nylon_patch", "--out", "o", "--method", "best"], "unknown method 'best'"),
        (["nylon_patch", "--out", "o", "--trajectories", "1"], "must be a whole number, at least 2"),
        (
            ["nylon_patch", "--out", "o", "--range", "0"],
            "--range: found '0'; must be above 0 and at most 0.9",
        ),
        (["nylon_patch", "--out", "o", "--range", "nan"], "must be above 0 and at most 0.9"),
        (["nylon_patch", "--out", "o", "--source", "guessed"], "--source: unknown source 'guessed'"),
        (["nylon_patch", "--out", "o", "--source", "identified"], "there is nothing to vary"),
        (["nylon_patch", "--out", "o", "--set", "colour=red"], "--set colour: unknown key"),
        (["nylon_patch", "--out", "o", "--model", "no.toml"], "no.toml: no such file"),
        (["nylon_patch", "--out", "o", "--trajectory", "3"], "unknown option '--trajectory'"),
    ],
)
def test_bad_flags_are_one_line(refused, argv, expected):
    assert expected in refused("sensitivity", *argv)


def test_out_must_be_empty(refused, tmp_path):
    (tmp_path / "mine.txt").touch()
    assert "is not empty" in refused("sensitivity", "nylon_patch", "--out", str(tmp_path))
