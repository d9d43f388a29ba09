"""Study runner: a folder belongs to one plan, results survive interruptions, broken trials run again."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from inline_executor import InlineExecutor, quiet

from omnimj.errors import InputError
from omnimj.studies.runner import StudyFolder, TrialFolder, guarded, read_json, run_study
from omnimj.studies.workers import Progress, WorkerPool

PLAN = {"seed": 3, "floors": ("pvc", "paperboard"), "limit": math.inf}


def folder(path: Path) -> StudyFolder:
    return StudyFolder(path, "plan.json", "a study", ("runs", "trial_*.json"))


def square(number: int) -> dict[str, int]:
    return {"square": number * number}


class Squares:
    """A study of three trials."""

    workers = 1

    def __init__(self, path: Path):
        self.trials = TrialFolder(path / "runs")
        self._folder = folder(path)

    def prepare(self) -> None:
        self._folder.claim(PLAN)

    def work(self, pool: WorkerPool, report: Progress) -> None:
        missing = {f"t{k}": (k,) for k in range(3) if self.trials.finished(f"t{k}") is None}
        pool.run_all(square, missing, self.trials.write, "squaring", report)

    def judge(self, interrupted: bool) -> tuple[bool, int]:
        results, _ = self.trials.collect(f"t{k}" for k in range(3))
        return interrupted, sum(result["square"] for result in results.values())


def test_an_interrupted_study_continues_with_the_missing_trials_only(tmp_path):
    def stop(phrase: str, share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    first, second = InlineExecutor(), InlineExecutor()
    interrupted, _ = run_study(Squares(tmp_path), stop, first)
    kept = len(list((tmp_path / "runs").iterdir()))
    assert interrupted and 0 < kept < 3
    assert run_study(Squares(tmp_path), quiet, second) == (False, 5)
    assert len(second.calls) == 3 - kept
    assert run_study(Squares(tmp_path), quiet, InlineExecutor()) == (False, 5)


def test_an_equal_plan_continues_and_another_one_needs_force(tmp_path):
    assert folder(tmp_path).claim(PLAN) is False
    (tmp_path / "runs").mkdir()
    for name in ("runs/a.json", "trial_a.json", "mine.txt"):
        (tmp_path / name).touch()
    assert folder(tmp_path).claim(PLAN) is True and (tmp_path / "runs" / "a.json").exists()
    with pytest.raises(InputError, match="a study with other settings"):
        folder(tmp_path).claim({**PLAN, "seed": 4})
    assert folder(tmp_path).claim({**PLAN, "seed": 4}, force=True) is False
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.txt", "plan.json"], (
        "only its own results"
    )
    assert read_json(tmp_path / "plan.json") == {"seed": 4, "floors": ["pvc", "paperboard"], "limit": None}


def test_a_folder_with_something_else_is_refused(tmp_path):
    (tmp_path / "mine.txt").touch()
    with pytest.raises(InputError, match="is not empty"):
        folder(tmp_path).claim(PLAN)
    assert not (tmp_path / "plan.json").exists()


def test_a_broken_or_unreadable_trial_is_not_finished_and_another_truth_is_refused(tmp_path):
    trials = TrialFolder(tmp_path)
    trials.write("good", {"case": {"wheels": [1, 2]}, "value": 1.0})
    trials.write("broken", {"error": "it broke"})
    trials.write("nothing", None)
    (tmp_path / "half.json").write_text('{"value": ', encoding="utf-8")
    assert trials.finished("good", case={"wheels": (1, 2)}) is not None
    assert [trials.finished(name) for name in ("broken", "nothing", "half")] == [None] * 3
    with pytest.raises(InputError, match="holds another case"):
        trials.finished("good", case={"wheels": (1, 3)})
    results, errors = trials.collect(["good", "broken", "nothing", "half"])
    assert list(results) == ["good"] and errors == {"broken": "it broke"}


def test_a_guarded_trial_gives_json_or_the_place_of_its_error():
    found = guarded(lambda: {"a": np.array([1.0, math.nan]), "b": (np.int64(2), math.inf)})()
    assert json.loads(json.dumps(found, allow_nan=False)) == {"a": [1.0, None], "b": [2, None]}
    error = guarded(lambda: {"a": 1 / 0})()["error"]
    assert error.startswith("ZeroDivisionError") and "test_runner.py:" in error
    with pytest.raises(KeyboardInterrupt):
        guarded(interrupt)()


def interrupt() -> dict[str, int]:
    raise KeyboardInterrupt
