"""`omnimj diagnose`: what it finds in recorded runs, and what it refuses."""

from __future__ import annotations

import contextlib
import io
import json
import re
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from driven_missions import ONSET, as_run, driven
from mentions import mentions

from omnimj.cli.main import main
from omnimj.diagnosis import replay as diagnosing
from omnimj.parameters import read_rig
from omnimj.plant.faults import Fault
from omnimj.plant.planar_rig import PlanarRig
from omnimj.recording.dataset import Run
from omnimj.recording.read_dataset import read_dataset
from omnimj.recording.traces import read_trace
from omnimj.recording.write_dataset import DatasetWriter, write_dataset
from omnimj.simulate.driving import drive_rig

pytestmark = pytest.mark.usefixtures("undrawn")

SCHEMA = json.loads((Path(__file__).parent.parent / "schema" / "diagnoses.json").read_text(encoding="utf-8"))
FLOOR = {"floor": "natural_stone"}


def two_runs(commands: bool = True) -> list[Run]:
    return [
        as_run(driven(), "healthy", commands),
        as_run(driven(weak=True), "weak", commands),
    ]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A healthy mission, and one whose motor 2 loses 57 %."""
    path = tmp_path_factory.mktemp("data") / "runs"
    write_dataset(path, "uto_robot", FLOOR, two_runs())
    return path


@pytest.fixture(scope="module")
def done(folder, tmp_path_factory):
    """The folder that the command leaves, with what it prints beside it."""
    out, printed = tmp_path_factory.mktemp("done") / "out", io.StringIO()
    with contextlib.redirect_stdout(printed):
        assert main(["diagnose", str(folder), "--out", str(out)]) == 0
    (out.parent / "printed").write_text(printed.getvalue(), encoding="utf-8")
    return out


def read_diagnoses(out: Path) -> dict:
    content = json.loads((out / "diagnoses.json").read_text(encoding="utf-8"))
    jsonschema.validate(content, SCHEMA)
    return content


def test_a_healthy_mission_raises_no_alarm_and_a_weak_motor_is_named_at_its_wheel(done):
    runs = read_diagnoses(done)["runs"]
    assert runs["healthy"]["diagnoses"] == [] and 0.0 < runs["healthy"]["cannot_judge"] < 6.0
    (found,) = runs["weak"]["diagnoses"]
    assert (found["kind"], found["wheels"], found["cleared"]) == ("motor", [2], None)
    assert found["time"] > ONSET and abs(found["effectiveness"] - 0.43) < 0.1


def test_the_output_names_method_data_and_settings(done, folder):
    content = read_diagnoses(done)
    assert (content["method"], content["plant"], content["dataset"]) == ("robust", "uto_robot", str(folder))
    assert (
        content["command"].startswith("omnimj diagnose ")
        and content["version"]
        and not content["interrupted"]
    )


def test_a_trace_lies_beside_it_for_each_run(done, folder):
    for run in read_dataset(folder).runs:
        trace = read_trace(done / f"{run.name}.parquet")
        assert all(np.array_equal(trace[name], values) for name, values in run.columns.items())
        assert {"residual_motor_2", "threshold_motor_2", "effectiveness_4", "mode"} <= set(trace.columns)
        assert trace.about["run"] == run.name and trace.about["method"] == "robust"
    assert sorted(path.name for path in done.iterdir()) == [
        "diagnoses.json",
        "healthy.parquet",
        "report.html",
        "weak.parquet",
    ]


def test_the_report_holds_the_verdict_and_works_offline(done):
    page = (done / "report.html").read_text(encoding="utf-8")
    assert "Nothing found." in page and re.search(r"motor 2 is weak: 4\d % left", page)
    assert page.count("class='plot'") == 4
    assert not re.search(r"https?://", re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL))


def test_the_terminal_gets_a_table_and_json_is_what_is_written(done, tmp_path, capsys):
    printed = (done.parent / "printed").read_text(encoding="utf-8")
    assert re.search(r"run +what +when +confidence", printed)
    assert re.search(r"healthy +nothing found +cannot judge", printed) and "motor 2 is weak" in printed
    assert "1 diagnosis in 1 of 2 runs" in printed
    short = written(tmp_path / "short")
    assert main(["diagnose", short, "--json", "--out", str(tmp_path / "out")]) == 0
    assert json.loads(capsys.readouterr().out) == read_diagnoses(tmp_path / "out")


@pytest.mark.slow
@pytest.mark.parametrize("change", ["csv", "no commands"])
def test_csv_gives_the_same_diagnoses_and_so_do_logs_without_set_currents(done, tmp_path, change):
    runs = two_runs(commands=change == "csv")
    write_dataset(tmp_path / "other", "uto_robot", FLOOR, runs, table_format="csv")
    assert main(["diagnose", str(tmp_path / "other"), "--out", str(tmp_path / "out")]) == 0
    found, expected = read_diagnoses(tmp_path / "out")["runs"], read_diagnoses(done)["runs"]
    if change == "csv":
        assert found == expected
    for name, run in expected.items():
        diagnosed = [(d["kind"], d["wheels"]) for d in found[name]["diagnoses"]]
        assert diagnosed == [(d["kind"], d["wheels"]) for d in run["diagnoses"]]


@pytest.mark.slow
def test_the_published_method_runs_on_robot_logs(folder, tmp_path):
    assert main(["diagnose", str(folder), "--method", "published", "--out", str(tmp_path / "out")]) == 0
    content = read_diagnoses(tmp_path / "out")
    assert content["method"] == "published" and content["runs"]["healthy"]["cannot_judge"] == 0.0


def rig_run(name: str, faults: tuple[Fault, ...]) -> Run:
    rig = read_rig()
    plant = PlanarRig(rig, "natural_stone", faults=faults, seed=3)
    columns = drive_rig(plant, np.full(1201, 0.9)).columns
    kept = ("time", "current", "current_target", "wheel_speed", "carriage_speed", "carriage_acceleration")
    return Run(name, {key: columns[key] for key in kept}, {}, {**FLOOR, "mass": rig.rig.masses[0]})


@pytest.mark.slow
def test_rig_logs_get_the_published_method(tmp_path, capsys):
    runs = [
        rig_run("healthy", ()),
        rig_run("nylon", (Fault("slip", 0.0, wheel=1, numbers={"floor": "nylon"}),)),
    ]
    write_dataset(tmp_path / "rig", "quarter_rig", FLOOR, runs)
    assert main(["diagnose", str(tmp_path / "rig"), "--out", str(tmp_path / "out")]) == 0
    content = read_diagnoses(tmp_path / "out")
    assert content["method"] == "published" and content["runs"]["healthy"]["diagnoses"] == []
    assert [(d["kind"], d["wheels"]) for d in content["runs"]["nylon"]["diagnoses"]] == [("slip", [1])]
    assert "wheel 1 slips" in capsys.readouterr().out
    argv = ["diagnose", str(tmp_path / "rig"), "--method", "robust", "--out", str(tmp_path / "no")]
    assert main(argv) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and mentions(message, "--method", "'robust'", "choices: published")


@pytest.mark.slow
def test_ctrl_c_keeps_the_runs_that_are_finished(folder, tmp_path, monkeypatch, capsys):
    whole, seen = diagnosing.replay, []

    def stopping(run, *arguments):
        seen.append(run.name)
        if len(seen) == 2:
            raise KeyboardInterrupt
        return whole(run, *arguments)

    monkeypatch.setattr(diagnosing, "replay", stopping)
    out = tmp_path / "out"
    assert main(["diagnose", str(folder), "--out", str(out)]) == 130
    content = read_diagnoses(out)
    assert content["interrupted"] and list(content["runs"]) == ["healthy"]
    assert (out / "healthy.parquet").exists() and not (out / "weak.parquet").exists()
    assert "interrupted" in capsys.readouterr().out
    assert "Stopped before the last run" in (out / "report.html").read_text(encoding="utf-8")


def test_ctrl_c_before_the_first_run_leaves_nothing(folder, tmp_path, monkeypatch):
    def stopping(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(diagnosing, "replay", stopping)
    assert main(["diagnose", str(folder), "--out", str(tmp_path / "out")]) == 130
    assert not (tmp_path / "out").exists()


def test_force_replaces_an_earlier_result_and_nothing_else(tmp_path_factory, tmp_path):
    short = written(tmp_path_factory.mktemp("data") / "short")
    (tmp_path / "mine.txt").write_text("precious")
    (tmp_path / "report.html").write_text("old")
    assert main(["diagnose", short, "--out", str(tmp_path), "--force"]) == 0
    assert (tmp_path / "mine.txt").read_text() == "precious"
    assert (tmp_path / "report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_data_are_never_written_over(refused, folder):
    before = {path: path.read_bytes() for path in folder.iterdir()}
    for out in (folder, folder / "out"):
        assert "is a dataset's folder" in refused("diagnose", str(folder), "--force", "--out", str(out))
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_bad_flags_are_one_line(refused, folder, tmp_path):
    def refusal(*argv):
        return refused("diagnose", *argv, "--out", "out")

    assert "required: --out" in refused("diagnose", str(folder))
    assert "unknown method 'best'" in refusal(str(folder), "--method", "best")
    assert mentions(refusal(str(folder), "--method", "off"), "found 'off'", "choices: published")
    assert "no such folder" in refusal("nowhere")
    assert "no such file" in refusal(str(folder), "--model", "none.toml")
    assert "no such file" in refusal(str(folder), "--floors", "none.toml")
    assert "no such file" in refusal(str(folder), "--thresholds", "none.toml")
    wrong = tmp_path / "t.toml"
    wrong.write_text("[thresholds]\nmotor = 3\n")
    assert "thresholds.motor: found 3; write { value" in refusal(str(folder), "--thresholds", str(wrong))
    argv = (str(folder), "--thresholds", str(wrong), "--method", "published")
    assert mentions(refusal(*argv), "t.toml", "'published'", "'robust'")
    assert "no such file" in refusal(str(folder), "--gains", "none.toml")
    argv = (str(folder), "--gains", "g.toml", "--method", "published")
    assert mentions(refusal(*argv), "--gains g.toml", "'published'", "'robust'")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").touch()
    assert "is not empty" in refused("diagnose", str(folder), "--out", str(tmp_path / "full"))


def written(path: Path, plant: str = "uto_robot", **changed) -> str:
    """A dataset of one short run with some columns changed."""
    columns = dict(as_run(driven(), rows=slice(0, 2000)).columns) | changed
    DatasetWriter(path, plant, FLOOR, table_format="csv").add(Run("one", columns, {}, FLOOR))
    return str(path)


@pytest.fixture(scope="module")
def mission():
    """A short healthy mission, driven before anything forbids to drive."""
    return driven()


def test_hostile_data_are_one_line(mission, refused, tmp_path):
    slow = as_run(mission, rows=slice(None, None, 20))
    write_dataset(tmp_path / "slow", "uto_robot", FLOOR, [slow])
    message = refused("diagnose", str(tmp_path / "slow"), "--out", "out")
    assert mentions(message, "run 'one'", "50 per second", "at least 100")
    broken = np.array(driven()["yaw_rate"][:2000])
    broken[7] = np.nan
    message = refused("diagnose", written(tmp_path / "nan", yaw_rate=broken), "--out", "out")
    assert "one.csv: row 9, column 'yaw_rate'" in message
    backward = np.array(driven()["time"][:2000])[::-1].copy()
    assert "must increase" in refused("diagnose", written(tmp_path / "back", time=backward), "--out", "out")
    axis = {"time": np.arange(60.0), "position": np.arange(60.0), "force": np.zeros(60)}
    DatasetWriter(tmp_path / "axis", "linear_axis", {}).add(Run("one", axis, {}, {}))
    message = refused("diagnose", str(tmp_path / "axis"), "--out", "out")
    assert mentions(message, "linear_axis", "choices: quarter_rig, uto_robot")
    (tmp_path / "nothing").mkdir()
    assert "has no dataset.toml" in refused("diagnose", str(tmp_path / "nothing"), "--out", "out")


@pytest.mark.slow
def test_a_failed_sensor_in_a_log_is_named_and_wild_numbers_break_nothing(tmp_path):
    gyro = np.array(driven()["yaw_rate"])
    gyro[4000:] = gyro[4000]
    wild = np.array(driven()["current_3"])
    wild[-300:] = 1e9
    runs = []
    for name, changed in (("frozen", {"yaw_rate": gyro}), ("wild", {"current_3": wild})):
        runs.append(Run(name, {**as_run(driven()).columns, **changed}, {}, FLOOR))
    write_dataset(tmp_path / "data", "uto_robot", FLOOR, runs)
    assert main(["diagnose", str(tmp_path / "data"), "--out", str(tmp_path / "out")]) == 0
    by_run = read_diagnoses(tmp_path / "out")["runs"]
    diagnosed = [(d["kind"], d.get("channel")) for d in by_run["frozen"]["diagnoses"]]
    assert ("sensor", "yaw_rate") in diagnosed
    assert all(d["wheels"] == [3] for d in by_run["wild"]["diagnoses"]) and by_run["wild"]["diagnoses"]
    assert by_run["wild"]["notes"] == ["run wild: current_3 beyond ±10000 clipped"]
