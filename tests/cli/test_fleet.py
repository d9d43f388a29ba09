"""A command over a folder of datasets does for each what it does for one, on any executor, and continues."""

from __future__ import annotations

import json
import pickle
import shutil
from concurrent.futures import Executor, Future
from pathlib import Path

import pytest
from rig_runs import twin_run

from omnimj.cli.main import main
from omnimj.parameters import read_floors, read_rig
from omnimj.recording.write_dataset import DatasetWriter
from omnimj.studies import workers

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture(scope="module")
def one(tmp_path_factory) -> Path:
    """A dataset of a run of the rig."""
    rig, floor = read_rig(), read_floors()["natural_stone"]
    path = tmp_path_factory.mktemp("data") / "one"
    writer = DatasetWriter(path, "quarter_rig", {"floor": "natural_stone", "mass": rig.rig.masses[0]})
    writer.add(twin_run(rig, floor, 1.2, 3, name="run_120"))
    return path


@pytest.fixture
def night(one, tmp_path) -> Path:
    """Two datasets, and one that nobody can read."""
    for name in ("robot_1", "robot_2"):
        shutil.copytree(one, tmp_path / "night" / name)
    (tmp_path / "night" / "robot_3").mkdir()
    (tmp_path / "night" / "robot_3" / "dataset.toml").write_text("plant = 3\n", encoding="utf-8")
    return tmp_path / "night"


class Copying(Executor):
    """Does at once, with copies, what a process would get of the work."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        work, its_args, its_kwargs = pickle.loads(pickle.dumps((fn, args, kwargs)))
        try:
            future.set_result(pickle.loads(pickle.dumps(work(*its_args, **its_kwargs))))
        except Exception as error:
            future.set_exception(error)
        return future


@pytest.mark.slow
def test_processes_diagnose_each_dataset_of_a_fleet_as_it_is_alone(one, night, tmp_path, capsys):
    diagnosed_alike(one, night, tmp_path, capsys)


@pytest.mark.slow
@pytest.mark.parametrize("executor", [(), ("--executor", "threads", "--workers", "2")])
def test_each_dataset_of_a_fleet_is_diagnosed_as_it_is_alone(
    one, night, tmp_path, capsys, executor, monkeypatch
):
    monkeypatch.setattr(workers, "ProcessPoolExecutor", lambda *_, **__: Copying())
    diagnosed_alike(one, night, tmp_path, capsys, executor)


def diagnosed_alike(one, night, tmp_path, capsys, executor=()):
    """Diagnoses a folder of datasets, and compares with the diagnosis of one."""
    assert main(["diagnose", str(one), "--out", str(tmp_path / "alone")]) == 0
    capsys.readouterr()
    assert main(["diagnose", str(night), "--out", str(tmp_path / "out"), *executor]) == 1
    printed = capsys.readouterr().out
    assert "robot_1" in printed and "failed: robot_3" in printed and printed.count("written to") == 1
    alone = json.loads((tmp_path / "alone" / "diagnoses.json").read_text(encoding="utf-8"))
    for name in ("robot_1", "robot_2"):
        folder = tmp_path / "out" / name
        own = json.loads((folder / "diagnoses.json").read_text(encoding="utf-8"))
        assert own["runs"] == alone["runs"]
        trace, same = folder / "run_120.parquet", tmp_path / "alone" / "run_120.parquet"
        assert (folder / "report.html").is_file() and trace.stat().st_size == pytest.approx(
            same.stat().st_size, rel=0.01
        )
    content = json.loads((tmp_path / "out" / "fleet.json").read_text(encoding="utf-8"))
    assert set(content["datasets"]) == {"robot_1", "robot_2"} and "plant" in content["failed"]["robot_3"]
    assert content["datasets"]["robot_1"]["runs"] == 1


def test_a_fleet_continues_with_the_datasets_that_are_missing(night, tmp_path, capsys):
    command = ["diagnose", str(night), "--out", str(tmp_path / "out"), "--executor", "threads"]
    assert main(command) == 1
    kept = tmp_path / "out" / "robot_1" / "report.html"
    before = kept.stat().st_mtime_ns
    shutil.rmtree(night / "robot_3")
    (tmp_path / "out" / "datasets" / "robot_2.json").unlink()
    redone = tmp_path / "out" / "robot_2" / "report.html"
    redone.unlink()
    assert main(command) == 0
    assert kept.stat().st_mtime_ns == before and redone.is_file()
    assert main([*command, "--method", "off"]) == 2
    assert "holds a fleet with other settings" in capsys.readouterr().err


def test_results_never_go_into_the_folder_of_the_datasets(night, capsys):
    assert main(["diagnose", str(night), "--out", str(night / "out")]) == 2
    assert "lies in the folder of the datasets" in capsys.readouterr().err


@pytest.mark.slow
def test_floors_are_identified_for_each_dataset_of_a_fleet(night, tmp_path, capsys):
    command = ["identify", str(night), "--out", str(tmp_path / "out"), "--executor", "threads"]
    assert main(command) == 1
    content = json.loads((tmp_path / "out" / "fleet.json").read_text(encoding="utf-8"))
    alike = content["datasets"]["robot_1"]["floors"], content["datasets"]["robot_2"]["floors"]
    assert alike[0] == alike[1] and "natural_stone" in alike[0]
    assert "natural_stone" in capsys.readouterr().out
    assert (tmp_path / "out" / "robot_2" / "floors.toml").is_file()
