"""The blind benchmark: what the workflow gets, what is kept, what comes out."""

from __future__ import annotations

import dataclasses
import json

import pytest
from benchmark_truths import VISCOUS, hiding
from inline_executor import InlineExecutor, quiet
from made_findings import rig_unexplained

from omnimj.cli.main import main
from omnimj.errors import InputError, UnknownNameError
from omnimj.studies import workers
from omnimj.studies.gap_benchmark import study, trial
from omnimj.studies.gap_benchmark.datasets import make_dataset
from omnimj.studies.gap_benchmark.scoring import score_case
from omnimj.studies.gap_benchmark.study import BenchmarkConfig, run_benchmark


@pytest.fixture
def searches(monkeypatch):
    """The search finds nothing, the true model is not fitted; what both are asked is kept."""
    asked: list[tuple] = []

    def find_gap(*given, **options):
        asked.append(("find_gap", given, options))
        return rig_unexplained()

    monkeypatch.setattr(trial, "find_gap", find_gap)
    monkeypatch.setattr(trial, "load_replay", lambda dataset: None)
    monkeypatch.setattr(trial, "run_baselines", lambda replay, seed: {})
    monkeypatch.setattr(trial, "true_heldout", lambda replay, effects: {})
    opened = study.open_seal
    monkeypatch.setattr(study, "open_seal", lambda at: asked.append(("open", at)) or opened(at))
    return asked


def test_the_workflow_gets_the_path_alone_and_the_seal_opens_after_the_last_search(tmp_path, searches):
    executor = InlineExecutor()
    order = BenchmarkConfig(tmp_path / "out", 3, cases=3, made_by="planar", seconds=0.2, conditions=1)
    outcome = run_benchmark(order, quiet, executor)
    folders = [tmp_path / "out" / "datasets" / f"case_00{k}" for k in range(3)]
    assert [a for n, a in executor.calls if n == "search_case"] == [(str(folder),) for folder in folders]
    assert searches[:3] == [("find_gap", (folder,), {}) for folder in folders]
    assert {entry[0] for entry in searches[3:]} == {"open"}
    written = json.loads((tmp_path / "out" / "benchmark.json").read_text(encoding="utf-8"))
    assert [case["name"] for case in written["cases"]] == ["case_000", "case_001", "case_002"]
    assert written["judged"] is False and "do not judge" in outcome.lines[0]
    assert "| coverage, where it names | ≥ 95 % |" in (tmp_path / "out" / "benchmark.md").read_text()


def test_what_was_finished_before_ctrl_c_is_kept_and_the_same_order_goes_on(tmp_path, searches):
    order = BenchmarkConfig(tmp_path, 3, cases=3, made_by="planar", seconds=0.2, conditions=1)

    def stop(phrase: str, share: float) -> None:
        if phrase == "searching: 2 of 3":
            raise KeyboardInterrupt

    first = run_benchmark(order, stop, InlineExecutor())
    assert first.interrupted and len(list((tmp_path / "results").iterdir())) == 2
    again = InlineExecutor()
    assert not run_benchmark(order, quiet, again).interrupted
    assert [n for n, _ in again.calls].count("search_case") == 1
    assert "make_dataset" not in [n for n, _ in again.calls]
    with pytest.raises(InputError, match="other settings"):
        run_benchmark(dataclasses.replace(order, seed=4), quiet, InlineExecutor())


def test_a_search_that_breaks_is_counted_and_tried_again(tmp_path, searches, monkeypatch):
    order = BenchmarkConfig(tmp_path, 3, cases=1, made_by="planar", seconds=0.2, conditions=1)
    whole = trial.find_gap
    monkeypatch.setattr(trial, "find_gap", lambda dataset: 1 / 0)
    outcome = run_benchmark(order, quiet, InlineExecutor())
    assert outcome.failed == 1 and "1 searches or fits failed" in outcome.lines[-1]
    monkeypatch.setattr(trial, "find_gap", whole)
    monkeypatch.setattr(trial, "true_heldout", lambda replay, effects: 1 / 0)
    outcome = run_benchmark(order, quiet, InlineExecutor())
    assert outcome.failed == 1
    errors = json.loads((tmp_path / "benchmark.json").read_text(encoding="utf-8"))["errors"]
    assert list(errors) == ["case_000, fit of the truth"]
    assert "ZeroDivisionError" in errors["case_000, fit of the truth"]
    monkeypatch.setattr(trial, "true_heldout", lambda replay, effects: {})
    assert run_benchmark(order, quiet, InlineExecutor()).failed == 0


def test_bad_orders_are_refused_in_one_line(tmp_path, capsys):
    with pytest.raises(UnknownNameError, match="planar"):
        run_benchmark(BenchmarkConfig(tmp_path / "a", made_by="real"), quiet, InlineExecutor())
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "mine.txt").touch()
    with pytest.raises(InputError, match="not empty"):
        run_benchmark(BenchmarkConfig(tmp_path / "b"), quiet, InlineExecutor())
    assert main(["gap", "data", "--benchmark", "--out", str(tmp_path / "c")]) == 2
    assert "makes its own data" in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_prints_the_table_and_writes_a_page(tmp_path, searches, monkeypatch, capsys):
    monkeypatch.setattr(workers, "ProcessPoolExecutor", lambda *given, **named: InlineExecutor())
    argv = ["gap", "--benchmark", "--cases", "1", "--made-by", "planar", "--out", str(tmp_path)]
    assert main(argv) == 0
    assert "false naming, nothing hidden" in capsys.readouterr().out
    assert "Against the goals" in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_micro_case_goes_through_from_end_to_end(tmp_path):
    case = hiding(VISCOUS)
    make_dataset(case, tmp_path / "case_000", "planar", 0.5, 4)
    found = trial.search_case(str(tmp_path / "case_000"))
    assert "error" not in found, found
    truth = trial.fit_truth(str(tmp_path / "case_000"), case.to_dict()["hidden"])
    score = score_case(case, found, truth)
    assert score.shows_gap and all(score.visible)
    assert score.workflow.covered == (True,)
    assert set(score.baselines) == {"base", "sparse", "bic"}
    assert score.baselines["base"].ratio is not None and score.baselines["base"].ratio > 1.5
