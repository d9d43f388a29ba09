"""`omnimj compare`: checks and results side by side, plots overlaid, and the index of a folder of runs."""

from __future__ import annotations

import json
import re
import shutil

import numpy as np
import pytest

from omnimj.cli.main import main
from omnimj.recording.traces import read_trace, write_trace
from omnimj.signals import Trace


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two drives of one scenario, which differ in the seed of nothing: with and without the yaw-rate loop."""
    folder = tmp_path_factory.mktemp("runs")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("omnimj.view.report.run.write_report", lambda path, *_: path.touch())
        patched.setattr("omnimj.view.rerun.recording.write_recording_of", lambda path, *_: path.touch())
        patched.setattr("omnimj.cli.run._picture_of", lambda *_: None)
        for name in ("square_path_kinematic", "square_path_kinematic_open_loop"):
            assert main(["run", name, "--out", str(folder / "own folder" / name)]) == 0
    return folder / "own folder"


def metrics_of(folder):
    return json.loads((folder / "metrics.json").read_text())


@pytest.mark.slow
def test_each_cell_is_the_number_of_its_run(runs, capsys):
    closed, opened = sorted(runs.iterdir())
    assert main(["compare", str(closed), str(opened), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["runs"] == [closed.name, opened.name]
    assert "scenario" in found["differing"] and "plant" not in found["differing"]
    for folder in (closed, opened):
        metrics = metrics_of(folder)
        for check in metrics["checks"]:
            text = found["checks"][check["name"].replace("_", " ")][folder.name]
            sign, value = text.split()[:2]
            assert sign == ("✓" if check["ok"] else "✗")
            assert float(value) == pytest.approx(check["value"], rel=5e-3)
        assert float(found["results"]["mean speed"][folder.name].split()[0]) == pytest.approx(
            metrics["mean_speed"], rel=5e-3
        )


@pytest.mark.slow
def test_the_page_overlays_the_runs_and_marks_what_failed(runs, tmp_path, capsys):
    closed, opened = sorted(runs.iterdir())
    worse = tmp_path / "worse <b>"
    shutil.copytree(opened, worse)
    metrics = metrics_of(worse)
    metrics["checks"][0].update(ok=False, value=123.0)
    (worse / "metrics.json").write_text(json.dumps(metrics))
    out = tmp_path / "pages" / "comparison.html"
    assert main(["compare", str(closed), str(worse), "--out", str(out)]) == 0
    assert "✗ 123" in capsys.readouterr().out
    page = out.read_text()
    assert page.count("class='number bad'") == 1 and "worse &lt;b&gt;" in page and "worse <b>" not in page
    figures = set(re.findall(r"<figure id='([\w-]+)'", page))
    assert figures == {"courses", "paths", "wheel_speed"}
    for name in (closed.name, "worse"):
        assert page.count(name) > 3


@pytest.mark.slow
def test_a_run_that_lacks_signals_is_left_out_of_their_plots(runs, tmp_path):
    closed, opened = sorted(runs.iterdir())
    bare = tmp_path / "bare"
    shutil.copytree(opened, bare)
    trace = read_trace(bare / "trace.parquet")
    kept = {name: trace[name] for name in ("time", "wheel_speed_1")}
    write_trace(
        bare / "trace.parquet", Trace({**kept, "current_1": np.zeros(len(kept["time"]))}, trace.about)
    )
    out = tmp_path / "comparison.html"
    assert main(["compare", str(closed), str(bare), "--out", str(out)]) == 0
    assert set(re.findall(r"<figure id='([\w-]+)'", out.read_text())) == {
        "courses",
        "paths",
        "wheel_speed",
        "current",
    }


def test_a_folder_of_runs_gets_an_index_whose_links_lead_to_the_reports(runs, tmp_path, capsys):
    out = runs.parent / "index.html"
    assert main(["compare", str(runs.parent), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    page = out.read_text()
    links = re.findall(r"href='([^']+)'", page)
    assert links == [
        f"own%20folder/{name}/report.html"
        for name in ("square_path_kinematic", "square_path_kinematic_open_loop")
    ]
    for folder in runs.iterdir():
        assert f"own folder/{folder.name}" in printed and f"own folder/{folder.name}" in page
    assert page.count("✓ ok") == 2
    assert main(["compare", str(runs), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {name: one["passed"] for name, one in found.items()} == dict.fromkeys(found, True)
    out.unlink()


def test_wrong_uses_are_refused_in_one_line(refused, runs, tmp_path):
    one = str(next(runs.iterdir()))
    assert "found 1; two to 8 runs can be compared" in refused("compare", one)
    assert "two to 8 runs" in refused("compare", *[one] * 9)
    assert "is given twice" in refused("compare", one, one)
    assert "has no metrics.json" in refused("compare", one, str(tmp_path))
    assert "is not a folder" in refused("compare", str(tmp_path / "nowhere"))
    assert "holds no run" in refused("compare", str(tmp_path))
    assert "there is no --out" in refused("compare", one, one, "--force")
    page = tmp_path / "page.html"
    page.write_text("mine")
    assert "exists already" in refused("compare", one, one, "--out", str(page))
    assert page.read_text() == "mine"
    broken = tmp_path / "broken"
    shutil.copytree(one, broken)
    (broken / "trace.parquet").write_bytes((broken / "trace.parquet").read_bytes()[:-9])
    assert "not a whole Parquet file" in refused("compare", one, str(broken), "--out", str(tmp_path / "new"))
    assert not (tmp_path / "new").exists()
