"""`omnimj export`: files beside the run, exit codes, one line per error; and back through `omnimj import`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from recording.made_datasets import RIG, csv_text, rig_columns, robot_columns

from omnimj.cli.main import main
from omnimj.recording.read_dataset import read_dataset
from omnimj.recording.traces import write_trace
from omnimj.signals import Trace

Refused = Callable[..., str]


def write_run(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    columns = robot_columns(120)
    truth = {name: np.sin(columns["time"] + k) for k, name in enumerate(("x", "y", "heading"))}
    write_trace(folder / "trace.parquet", Trace({**columns, **truth}, {"scenario": "made"}))
    return folder


@pytest.mark.parametrize("form", ["mcap", "csv", "mat"])
@pytest.mark.parametrize("given", ["folder", "file"])
def test_a_run_is_written_beside_its_trace_and_kept_without_force(tmp_path, capsys, form, given):
    run = write_run(tmp_path / "run")
    argv = ["export", str(run if given == "folder" else run / "trace.parquet"), "--to", form]
    assert main(argv) == 0
    assert capsys.readouterr().out == f"16 columns, 120 rows written to {run / f'trace.{form}'}\n"
    before = (run / f"trace.{form}").stat().st_mtime_ns
    assert main(argv) == 2 and "exists already" in capsys.readouterr().err
    assert (run / f"trace.{form}").stat().st_mtime_ns == before
    assert main([*argv, "--force"]) == 0


@pytest.mark.parametrize("form", ["mcap", "csv", "mat"])
def test_an_exported_run_is_imported_as_it_was_without_an_edited_mapping(tmp_path, form):
    run, log, out = write_run(tmp_path / "run"), tmp_path / "made" / f"log.{form}", tmp_path / "set"
    assert main(["export", str(run), "--to", form, "--out", str(log)]) == 0
    assert main(["import", str(log), "--floor", "pvc", "--out", str(out)]) == 0
    (found,) = read_dataset(out).runs
    for name, values in robot_columns(120).items():
        same = found.columns[name] - values
        if name == "yaw":
            same = (same + np.pi) % (2.0 * np.pi) - np.pi  # the import unwraps angles
        assert np.abs(same).max() < 1e-9, name


def test_a_run_of_a_dataset_is_exported(tmp_path, capsys):
    (tmp_path / "dataset.toml").write_text(RIG)
    (tmp_path / "dash.csv").write_text(csv_text(rig_columns(80)))
    out = tmp_path / "dash.mcap"
    assert main(["export", str(tmp_path / "dash.csv"), "--to", "mcap"]) == 0
    assert f"6 columns, 80 rows written to {out}" in capsys.readouterr().out
    assert main(["export", str(tmp_path), "--to", "mcap"]) == 2
    assert "is a dataset; give one of its runs: dash.csv" in capsys.readouterr().err


def test_mcap_without_its_library_names_the_extra_and_csv_needs_none(tmp_path, monkeypatch, capsys):
    run = write_run(tmp_path / "run")
    for library in ("mcap", "mcap.writer", "rosbags", "rosbags.typesys"):
        monkeypatch.setitem(sys.modules, library, None)
    assert main(["export", str(run), "--to", "mcap"]) == 2
    line = capsys.readouterr().err
    assert "mcap is not installed; pip install 'omnimj[import]'" in line and line.count("\n") == 1
    assert [path.name for path in run.iterdir()] == ["trace.parquet"]
    assert main(["export", str(run), "--to", "csv"]) == main(["export", str(run), "--to", "mat"]) == 0


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        (["none", "--to", "csv"], "none: no such file; a trace.parquet is needed"),
        (["none"], "--to"),
        (["none", "--to", "xls"], "unknown format 'xls'; choices: csv, mat, mcap"),
        ([".", "--to", "csv"], "trace.parquet: no such file"),
    ],
)
def test_bad_input_is_one_line(refused: Refused, argv, expected):
    assert expected in refused("export", *argv)


def test_a_damaged_trace_is_one_line(tmp_path, capsys):
    run = write_run(tmp_path / "run")
    content = (run / "trace.parquet").read_bytes()
    (run / "trace.parquet").write_bytes(content[:-40])
    assert main(["export", str(run), "--to", "csv"]) == 2
    assert "is not a whole Parquet file" in capsys.readouterr().err
