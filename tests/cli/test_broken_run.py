"""A simulation that breaks down: one line, exit code 1, and everything until then is kept."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from called_commands import called_compiled

from omnimj.plant.planar import PlanarRobot
from omnimj.recording.traces import read_trace
from omnimj.simulate.loop import LARGEST_TRUTH

SCHEMA = json.loads((Path(__file__).parent.parent / "schema" / "metrics.json").read_text(encoding="utf-8"))
RUN = ("run", "nylon_patch", "--plant", "planar", "--set", "duration=0.2", "--set", "checks={}")


def breaking(monkeypatch, at: int, growth: float = 1.0) -> None:
    """From the step `at` on the truth is not finite; before it, it grows by `growth` a step."""
    truth, calls = PlanarRobot.truth, []

    def broken(self):
        calls.append(None)
        k = len(calls) - 1
        return (truth(self) + 1e-3) * (float("nan") if k >= at else growth**k)

    monkeypatch.setattr(PlanarRobot, "truth", broken)


@pytest.mark.parametrize("json_too", [(), ("--json",)])
def test_what_was_recorded_until_then_is_written_and_one_line_reports_it(
    capsys, tmp_path, monkeypatch, plain_files, json_too
):
    folder = tmp_path / "run"
    breaking(monkeypatch, 120)
    code, out, lines = called_compiled(capsys, *RUN, *json_too, "--out", str(folder))
    assert code == 1 and out == ""
    (line,) = lines
    assert line.startswith("omnimj: at 0.1200 s: x is nan") and line.endswith(f"is in {folder}")
    trace = read_trace(folder / "trace.parquet")
    assert len(trace["time"]) == 120 and all(np.all(np.isfinite(v)) for v in trace.columns.values())
    assert trace.about["failure"].startswith("at 0.1200 s: x is nan")
    metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    jsonschema.validate(metrics, SCHEMA)
    assert metrics["failure"] == trace.about["failure"] and not metrics["passed"]


@pytest.mark.slow
def test_numbers_that_grow_beyond_all_bounds_end_the_run_and_are_drawn_too(
    capsys, tmp_path, monkeypatch, unrendered
):
    breaking(monkeypatch, 200, growth=1.5)
    code, _, lines = called_compiled(capsys, *RUN, "--out", str(tmp_path / "run"))
    assert all((tmp_path / "run" / name).stat().st_size > 1000 for name in ("report.html", "run.rrd"))
    assert code == 1 and len(lines) == 1 and "normal_force_1 is 1" in lines[0]
    trace = read_trace(tmp_path / "run" / "trace.parquet")
    assert 1e9 < max(np.abs(values).max() for values in trace.columns.values()) <= LARGEST_TRUTH


@pytest.mark.parametrize("at", [0, 1])
def test_a_run_without_two_rows_leaves_no_folder(capsys, tmp_path, monkeypatch, at):
    breaking(monkeypatch, at)
    code, out, lines = called_compiled(capsys, *RUN, "--out", str(tmp_path / "run"))
    assert code == 1 and out == "" and not (tmp_path / "run").exists()
    assert len(lines) == 1 and f"at 0.00{at}0 s: x is nan" in lines[0]


def test_a_run_that_does_not_break_down_has_no_failure(capsys):
    code, out, _ = called_compiled(capsys, *RUN, "--json")
    assert code == 0 and json.loads(out)["failure"] is None
