"""`omnimj import`: preview, proposed mapping, dataset, exit codes, one line per error."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from omnimj.cli.main import main
from omnimj.recording.read_dataset import read_dataset

Refused = Callable[..., str]
TIME = 20.0 * np.arange(100)


def write_log(path: Path, x_unit: str = "mm") -> Path:
    """A log of a robot with three wheels: milliseconds, degrees, rpm."""
    head = [
        "t [ms]",
        *(f"motor{k} speed [rpm]" for k in (1, 2, 3)),
        *(f"motor{k} current [mA]" for k in (1, 2, 3)),
    ]
    head += [f"x [{x_unit}]", f"y [{x_unit}]", "heading [deg]"]
    speeds = [300.0 * np.sin(TIME / 500.0 + k) for k in range(3)]
    rows = [TIME, *speeds, *(np.abs(s) + 5.0 for s in speeds), TIME, -TIME, TIME / 10.0 % 360.0]
    cells = [";".join(f"{v:.4f}".replace(".", ",") for v in row) for row in zip(*rows, strict=True)]
    path.write_text("\n".join([";".join(head), *cells]))
    return path


def test_a_log_with_units_becomes_a_dataset_in_one_step(tmp_path, capsys):
    out = tmp_path / "set"
    assert main(["import", str(write_log(tmp_path / "a.csv")), "--floor", "pvc", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "CSV, semicolon, decimal comma" in printed and "uto_robot (3 wheels, measured pose)" in printed
    assert "never negative though motor1 speed changes its sign" in printed and f"written to {out}" in printed
    (run,) = read_dataset(out).runs
    assert run.time[1] == pytest.approx(0.02) and run.columns["x"][50] == pytest.approx(1.0)
    assert run.columns["wheel_speed_1"].max() == pytest.approx(300.0 * np.pi / 30.0, rel=1e-3)
    assert np.all(run.columns["current_1"] * run.columns["wheel_speed_1"] >= 0.0)
    assert (out / "mapping.toml").is_file()


def test_the_mapping_beside_a_dataset_makes_the_same_dataset_again(tmp_path):
    log, first, second = write_log(tmp_path / "a.csv"), tmp_path / "first", tmp_path / "second"
    assert main(["import", str(log), "--floor", "pvc", "--out", str(first)]) == 0
    assert main(["import", str(log), "--mapping", str(first / "mapping.toml"), "--out", str(second)]) == 0
    assert (first / "a.parquet").read_bytes() == (second / "a.parquet").read_bytes()
    assert (first / "mapping.toml").read_bytes() == (second / "mapping.toml").read_bytes()


def test_a_preview_writes_a_mapping_to_edit_and_keeps_an_earlier_one(tmp_path, capsys):
    log, mapping = write_log(tmp_path / "a.csv", "pix"), tmp_path / "a.mapping.toml"
    assert main(["import", str(log)]) == 0
    printed = capsys.readouterr().out
    assert f"written to {mapping}" in printed
    assert "lacks: [defaults] floor, a scale of x, a scale of y" in printed
    mapping.write_text(f"# mine\n{mapping.read_text()}")
    assert main(["import", str(log)]) == 0
    assert "is there already and was kept" in capsys.readouterr().out and "# mine" in mapping.read_text()
    assert main(["import", str(log), "--force"]) == 0 and "# mine" not in mapping.read_text()


def test_an_incomplete_proposal_instead_of_a_dataset_ends_with_1_and_is_written(tmp_path, capsys):
    log, mapping = write_log(tmp_path / "a.csv", "pix"), tmp_path / "m.toml"
    argv = ["import", str(log), "--out", str(tmp_path / "set"), "--mapping", str(mapping)]
    assert main(argv) == 1
    assert "a scale of x" in capsys.readouterr().out and not (tmp_path / "set").exists()
    text = mapping.read_text().replace("# floor = ?", 'floor = "pvc"')
    mapping.write_text(text.replace('from = "x"', 'from = "x", scale = 0.002').replace("= ?", "= 0"))
    assert "scale of y" not in text
    assert main(argv) == 2
    assert "columns.y: column 'y' is in pix; give a scale to m" in capsys.readouterr().err
    mapping.write_text(mapping.read_text().replace('from = "y"', 'from = "y", scale = 0.002'))
    assert main(argv) == 0
    assert read_dataset(tmp_path / "set").runs[0].columns["x"][50] == pytest.approx(2.0)


def test_json_has_columns_runs_and_notes(tmp_path, capsys):
    assert main(["import", str(write_log(tmp_path / "a.csv")), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["plant"] == "uto_robot" and content["missing"] == ["[defaults] floor"]
    assert content["runs"]["a"]["rate"] == pytest.approx(50.0) and content["columns"][0]["becomes"] == "time"
    assert content["plants"]["uto_robot"] == [] and "carriage_speed" in content["plants"]["quarter_rig"]


def test_logs_of_one_name_in_two_folders_become_runs_with_the_names_of_the_folders(tmp_path):
    files = []
    for folder in ("pvc", "natural_stone"):
        (tmp_path / folder).mkdir()
        files.append(str(write_log(tmp_path / folder / "a.csv")))
    assert main(["import", *files, "--floor", "{folder}", "--out", str(tmp_path / "set")]) == 0
    runs = {run.name: run.conditions["floor"] for run in read_dataset(tmp_path / "set").runs}
    assert runs == {"pvc_a": "pvc", "natural_stone_a": "natural_stone"}


def test_a_floor_that_is_not_shipped_is_named(tmp_path, capsys):
    argv = ["import", str(write_log(tmp_path / "a.csv")), "--floor", "carpet", "--out", str(tmp_path / "set")]
    assert main(argv) == 0
    assert "floor 'carpet' is not shipped" in capsys.readouterr().out


def test_an_earlier_dataset_is_kept_without_force(tmp_path, capsys):
    log, out = str(write_log(tmp_path / "a.csv")), str(tmp_path / "set")
    assert main(["import", log, "--floor", "pvc", "--out", out]) == 0
    assert main(["import", log, "--floor", "pvc", "--out", out]) == 2
    assert "is not empty" in capsys.readouterr().err
    assert main(["import", log, "--floor", "pvc", "--out", out, "--force", "--format", "csv"]) == 0


def test_nothing_is_written_where_one_of_several_logs_is_wrong(tmp_path, capsys):
    good, bad = write_log(tmp_path / "a.csv"), tmp_path / "b.csv"
    lines = good.read_text().splitlines()
    bad.write_text("\n".join([*lines[:40], lines[40].replace(",", "?", 1), *lines[41:]]))
    assert main(["import", str(good), "--floor", "pvc", "--mapping", str(tmp_path / "m.toml")]) == 0
    capsys.readouterr()
    argv = ["import", str(good), str(bad), "--mapping", str(tmp_path / "m.toml")]
    assert main([*argv, "--out", str(tmp_path / "set")]) == 2
    line = capsys.readouterr().err
    assert "b.csv" in line and "row 41" in line and line.count("\n") == 1
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        ([], "required: FILE"),
        (["none.csv"], "none.csv: no such file"),
        (["none.xyz"], "the format is not known; choices: .csv, .dat"),
        (["a.csv", "--plant", "boat"], "--plant: unknown plant 'boat'; choices: linear_axis, mjcf"),
        (["a.csv", "--format", "xls"], "--format: unknown format 'xls'"),
    ],
)
def test_bad_input_is_one_line(refused: Refused, argv, expected):
    assert expected in refused("import", *argv)


def test_a_file_given_twice_is_refused(refused: Refused, tmp_path):
    log = str(write_log(tmp_path / "a.csv"))
    assert "comes from two files" in refused("import", log, log)


def test_options_that_the_mapping_states_are_refused_beside_it(refused: Refused, tmp_path):
    log, mapping = str(write_log(tmp_path / "a.csv")), str(tmp_path / "m.toml")
    Path(mapping).write_text('plant = "mjcf"\n[columns]\ntime = { from = "t" }\n')
    assert "--floor: found 'pvc'; the mapping" in refused(
        "import", log, "--mapping", mapping, "--floor", "pvc"
    )


def test_a_run_in_the_mapping_without_a_log_is_refused(refused: Refused, tmp_path):
    (tmp_path / "m.toml").write_text(
        'plant = "mjcf"\n[columns]\ntime = { from = "t" }\n[runs.b]\ndescription = "x"\n'
    )
    line = refused("import", str(write_log(tmp_path / "a.csv")), "--mapping", str(tmp_path / "m.toml"))
    assert "[runs.b]: there is no such run; choices: a" in line
