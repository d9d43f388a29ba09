"""`omnimj identify` on the command line: files, exit codes, one line per error."""

from __future__ import annotations

import json

import pytest
from rig_runs import twin_run

from omnimj.cli.main import main
from omnimj.estimate.identification import identify as identifying
from omnimj.parameters import read_floors, read_rig
from omnimj.recording.write_dataset import DatasetWriter

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Four runs on one floor."""
    rig, floor = read_rig(), read_floors()["natural_stone"]
    path = tmp_path_factory.mktemp("data") / "runs"
    writer = DatasetWriter(path, "quarter_rig", {"floor": "natural_stone", "mass": rig.rig.masses[0]})
    for seed, current in enumerate((0.6, 0.9, 1.2, 1.5)):
        writer.add(twin_run(rig, floor, current, seed, name=f"run_{round(100 * current):03d}"))
    return path


@pytest.fixture(scope="module", autouse=True)
def identified_once():
    """A floor is identified at the first command only."""
    found, identify = {}, identifying.identify_floor

    def first(floor, runs, rig, place):
        if floor not in found:
            found[floor] = identify(floor, runs, rig, place)
        return found[floor]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(identifying, "identify_floor", first)
        yield


def test_it_writes_floors_numbers_and_report(folder, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["identify", str(folder), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "natural_stone: 4 runs" in printed and "cannot be told apart" in printed and "sigma_2" in printed
    assert sorted(path.name for path in out.iterdir()) == [
        "floors.toml",
        "identification.json",
        "report.html",
    ]
    assert read_floors(out / "floors.toml")["natural_stone"].law == "lugre"
    content = json.loads((out / "identification.json").read_text(encoding="utf-8"))
    assert content["command"].startswith("omnimj identify") and content["floors"]["natural_stone"]["runs"]
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "cannot be told apart" in page and page.count("class='plot'") == 4
    assert "http://" not in page and "https://" not in page


def test_json_is_what_is_written(folder, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["identify", str(folder), "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((out / "identification.json").read_text())


def test_a_full_folder_is_kept_unless_forced(folder, tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("mine")
    assert main(["identify", str(folder), "--out", str(tmp_path)]) == 2
    assert "is not empty" in capsys.readouterr().err
    assert main(["identify", str(folder), "--out", str(tmp_path), "--force"]) == 0
    assert (tmp_path / "mine.txt").read_text() == "mine"


def test_ctrl_c_before_the_first_floor_writes_nothing(folder, tmp_path, monkeypatch):
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("omnimj.estimate.identification.identify.identify_floor", stop)
    assert main(["identify", str(folder), "--out", str(tmp_path / "out")]) == 130
    assert not (tmp_path / "out").exists()


def test_bad_input_is_one_line(refused, folder):
    assert "no such folder" in refused("identify", "nowhere", "--out", "out")
    assert "required: --out" in refused("identify", str(folder))
    assert "no such file" in refused("identify", str(folder), "--model", "none.toml", "--out", "out")
    assert "unknown option '--plant'" in refused("identify", str(folder), "--out", "out", "--plant", "twin")
