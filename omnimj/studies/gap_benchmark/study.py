"""`omnimj gap --benchmark`: effects hidden by a seed, searched blind, scored when all is done.

The folder:
  benchmark_plan.json   what was asked
  sealed/               the truth, closed until scoring
  datasets/case_…       what the workflow sees
  results/case_….json   what it said, and the baselines
  scored/case_….json    fits of the true models (made after the searches)
  benchmark.json, benchmark.md
What is there is kept: a benchmark that was broken off goes on where it stood.
"""

from __future__ import annotations

import dataclasses
import json
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import omnimj
from omnimj.errors import InputError, UnknownNameError
from omnimj.recording.folder import check_folder
from omnimj.recording.json_files import (
    has_result,
    read_result,
    result_writer,
    to_jsonable,
    write_json,
    write_text,
)
from omnimj.studies.gap_benchmark import trial
from omnimj.studies.gap_benchmark.cases import TUNING_SEEDS, Case, case_from_dict, draw_cases
from omnimj.studies.gap_benchmark.datasets import MAKERS, PLANT, make_dataset
from omnimj.studies.gap_benchmark.scoring import CaseScore, score_case
from omnimj.studies.gap_benchmark.seal import is_sealed, open_seal, seal, seals_labels
from omnimj.studies.gap_benchmark.summary import HEADING, Summary, result_tables, summarize, summary_sentences
from omnimj.studies.statistics import Table, format_markdown
from omnimj.studies.workers import Progress, WorkerPool, run_in_workers

PLAN, NUMBERS, TEXT = "benchmark_plan.json", "benchmark.json", "benchmark.md"


@dataclass(frozen=True)
class BenchmarkConfig:
    """What is to be done."""

    out: Path
    seed: int = 0
    trials: int = 1
    """How often the whole set of cases is drawn."""
    cases: int | None = None
    """Only so many of them; they are in random order. All when None."""
    made_by: str = "twin"
    workers: int = 1
    plant: str = PLANT
    seconds: float = 1.8
    """Length of a run."""
    conditions: int = 12
    """Conditions per dataset."""

    def plan(self) -> dict[str, Any]:
        """What must be alike for a folder to be gone on with."""
        names = ("seed", "trials", "made_by", "plant", "seconds", "conditions")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class BenchmarkResult:
    """What came of it."""

    summary: Summary
    lines: tuple[str, ...]
    """What the numbers are of."""
    tables: tuple[Table, ...]
    interrupted: bool
    failed: int


def run_benchmark(
    order: BenchmarkConfig, report: Progress, executor: Executor | None = None
) -> BenchmarkResult:
    """Makes what is missing, searches what is missing, scores what is there.

    Args:
      order: What is to be done.
      report: Called with a phrase and the share that is done; may raise KeyboardInterrupt.
      executor: Runs the work; processes of its own when None.

    Returns:
      What was found, also after Ctrl-C.

    Raises:
      InputError: The folder holds something else, or another benchmark, or cannot be written.
      UnknownNameError: No such maker or plant.
      SimulationError: A worker died; what was finished is kept.
    """
    cases = _prepared(order)[: order.cases]
    finished = run_in_workers(lambda workers: _work(order, cases, workers, report), order.workers, executor)
    return _scored(order, [case.name for case in cases], not finished)


def _prepared(order: BenchmarkConfig) -> list[Case]:
    """Draws the cases and seals them; checks that what is in the folder belongs to them."""
    if order.made_by not in MAKERS:
        raise UnknownNameError("--made-by", "maker of datasets", order.made_by, MAKERS)
    if order.plant != PLANT:
        raise UnknownNameError("--plant", "plant of the benchmark", order.plant, (PLANT,))
    cases = draw_cases(order.seed, order.trials)
    labels = [case.to_dict() for case in cases]
    plan, sealed = order.out / PLAN, order.out / "sealed"
    if plan.is_file():
        if json.loads(plan.read_text(encoding="utf-8")) != order.plan():
            rule = f"{PLAN} there says which; choose another folder"
            raise InputError(f"--out {order.out}", "holds a benchmark with other settings", rule)
        if not (is_sealed(sealed) and seals_labels(sealed, labels)):
            rule = "the library has changed since; choose another folder"
            raise InputError(f"{sealed}", "holds another truth than this seed draws", rule)
        return cases
    check_folder(order.out, False)
    try:
        for name in ("datasets", "results", "scored"):
            (order.out / name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {order.out}", f"cannot be written ({error.strerror})") from None
    seal(sealed, labels)
    write_json(plan, order.plan())
    return cases


def _work(order: BenchmarkConfig, cases: list[Case], workers: WorkerPool, report: Progress) -> None:
    """Datasets, searches, and only then, with the seal open, the true models' fits."""
    folders = {case.name: order.out / "datasets" / case.name for case in cases}
    making = {
        case.name: (case, folders[case.name], order.made_by, order.seconds, order.conditions)
        for case in cases
        if not folders[case.name].is_dir()
    }
    results = order.out / "results"
    workers.run_all(make_dataset, making, result_writer(results), "making", report)
    searching = {
        name: (str(path),)
        for name, path in folders.items()
        if path.is_dir() and not has_result(results, name)
    }
    workers.run_all(trial.search_case, searching, result_writer(results), "searching", report)
    scored = order.out / "scored"
    fitting = {
        case.name: (str(folders[case.name]), case.to_dict()["hidden"])
        for case in map(case_from_dict, open_seal(order.out / "sealed"))
        if case.name in folders
        and case.hidden
        and has_result(results, case.name)
        and not has_result(scored, case.name)
    }
    workers.run_all(trial.fit_truth, fitting, result_writer(scored), "fitting the truth", report)


def _scored(order: BenchmarkConfig, names: list[str], interrupted: bool) -> BenchmarkResult:
    """Opens the seal and scores every result that is there."""
    labels = {
        plain_case["name"]: case_from_dict(plain_case) for plain_case in open_seal(order.out / "sealed")
    }
    scores: list[CaseScore] = []
    errors: dict[str, str] = {}
    for name in names:
        result = read_result(order.out / "results", name)
        if result is None:
            continue
        if "error" in result:
            errors[name] = result["error"]
            continue
        truth = read_result(order.out / "scored", name)
        if truth is not None and "error" in truth:
            errors[f"{name}, fit of the truth"] = truth["error"]
        scores.append(score_case(labels[name], result, truth))
    summary = summarize(scores)
    found = tuple(result_tables(summary))
    lines = tuple(summary_sentences(order.seed, order.made_by, len(scores), len(names), len(errors)))
    content = {
        "plan": order.plan(),
        "version": omnimj.__version__,
        "judged": order.seed not in TUNING_SEEDS,
        "interrupted": interrupted,
        "summary": dataclasses.asdict(summary),
        "errors": errors,
        "cases": [dataclasses.asdict(score) for score in scores],
    }
    write_json(order.out / NUMBERS, to_jsonable(content))
    write_text(order.out / TEXT, format_markdown(HEADING, lines, found))
    return BenchmarkResult(summary, lines, found, interrupted, len(errors))
