"""A full disk ends a command with 1, path and reason; its result is printed all the same."""

from __future__ import annotations

from full_disk import no_file_beyond

from omnimj.cli.main import main

SHORT = ("run", "nylon_patch", "--plant", "planar", "--set", "duration=0.5", "--set", "checks={}")


def test_a_run_prints_its_result_although_the_recording_does_not_fit(tmp_path, capsys):
    out = tmp_path / "run"
    with no_file_beyond(300_000):
        code = main([*SHORT, "--out", str(out)])
    printed, errors = capsys.readouterr()
    assert code == 1 and "plant planar, method robust" in printed and "written to" not in printed
    lines = [line for line in errors.splitlines() if not line.startswith("compiling native code")]
    assert lines == [f"omnimj: {out / 'run.rrd'}: cannot be written, file too large"]
    assert {file.name for file in out.iterdir()} == {"trace.parquet", "metrics.json"}


def test_a_recording_that_does_not_fit_keeps_what_was_recorded(tmp_path, capsys):
    with no_file_beyond(20_000):
        code = main(["record", "axis_moves", "--repeats", "1", "--out", str(tmp_path / "data")])
    assert code == 1
    assert "cannot be written, file too large" in capsys.readouterr().err
    assert not any((tmp_path / "data").glob("*.parquet")), "no partial run has a final name"
