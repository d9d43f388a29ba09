"""Blind benchmark of the gap workflow, `omnimj gap --benchmark`: hidden effects, searched blind, then scored.

The folder:
  benchmark_plan.json   settings
  sealed/               truth, closed until scoring
  datasets/case_…       recordings that the workflow sees
  results/case_….json   findings of the workflow and of the baselines
  scored/case_….json    fits of the true models, made after the searches
  benchmark.json, benchmark.md
"""

from __future__ import annotations

import dataclasses
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import omnimj
from omnimj.effects import RIG
from omnimj.errors import InputError, UnknownNameError
from omnimj.recording.json_files import to_jsonable, write_json, write_text
from omnimj.studies.gap_benchmark import trial
from omnimj.studies.gap_benchmark.cases import TUNING_SEEDS, Case, case_from_dict
from omnimj.studies.gap_benchmark.plants import benchmark_plant, make_dataset
from omnimj.studies.gap_benchmark.scoring import CaseScore, score_case
from omnimj.studies.gap_benchmark.seal import is_sealed, open_seal, seal, seals_labels
from omnimj.studies.gap_benchmark.summary import (
    HEADING,
    Summary,
    case_table,
    result_tables,
    summarize,
    summary_sentences,
)
from omnimj.studies.runner import StudyFolder, TrialFolder, run_study
from omnimj.studies.statistics import Table, format_markdown
from omnimj.studies.workers import Progress, WorkerPool

PLAN, NUMBERS, TEXT = "benchmark_plan.json", "benchmark.json", "benchmark.md"


@dataclass(frozen=True)
class BenchmarkConfig:
    """Settings of a benchmark."""

    out: Path
    seed: int = 0
    trials: int = 1
    """Number of times that the whole set of cases is drawn."""
    cases: int | None = None
    """Number of cases to run, the first in a random order; all when None."""
    made_by: str = "twin"
    """Maker of the datasets, one of the machine's `makers`."""
    workers: int = 1
    plant: str = RIG
    """Machine of the datasets: `quarter_rig`, a shipped MJCF machine, or the path of an MJCF file."""
    seconds: float = 1.8
    """Duration of a run of the rig [s]."""
    conditions: int = 12
    """Number of conditions per dataset of the rig."""

    def plan(self) -> dict[str, Any]:
        """Return the settings that stored results depend on."""
        names = ("seed", "trials", "made_by", "plant", "seconds", "conditions")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class BenchmarkResult:
    """Summary and tables of a benchmark."""

    summary: Summary
    lines: tuple[str, ...]
    """Sentences on the origin of the numbers."""
    tables: tuple[Table, ...]
    interrupted: bool
    failed: int


def run_benchmark(
    config: BenchmarkConfig, report: Progress, executor: Executor | None = None
) -> BenchmarkResult:
    """Make missing datasets, search those without a result, and score all results; see `run_study`.

    Raises:
      UnknownNameError: The maker or the plant does not exist.
    """
    return run_study(_Benchmark(config), report, executor)


class _Benchmark:
    """Steps of a benchmark for the study runner."""

    def __init__(self, config: BenchmarkConfig):
        self.config, self.workers = config, config.workers
        self._sealed, self._datasets = config.out / "sealed", config.out / "datasets"
        self._results, self._truths = TrialFolder(config.out / "results"), TrialFolder(config.out / "scored")
        self._cases: list[Case] = []

    def prepare(self) -> None:
        config = self.config
        plant = benchmark_plant(config.plant)
        if config.made_by not in plant.makers:
            raise UnknownNameError("--made-by", "maker of datasets", config.made_by, plant.makers)
        cases = plant.draw(config.seed, config.trials)
        labels = [case.to_dict() for case in cases]
        folder = StudyFolder(config.out, PLAN, "a benchmark", (), can_replace=False)
        if not folder.claim(config.plan()):
            self._datasets.mkdir(exist_ok=True)
            seal(self._sealed, labels)
        elif not (is_sealed(self._sealed) and seals_labels(self._sealed, labels)):
            rule = "the library has changed since; choose another folder"
            raise InputError(f"{self._sealed}", "holds a truth that this seed does not draw", rule)
        self._cases = cases[: config.cases]

    def work(self, pool: WorkerPool, report: Progress) -> None:
        """Make datasets and search them; only then open the seal and fit the true models."""
        config, results, truths = self.config, self._results, self._truths
        folders = {case.name: self._datasets / case.name for case in self._cases}
        making = {
            case.name: (case, folders[case.name], config.made_by, config.seconds, config.conditions)
            for case in self._cases
            if not folders[case.name].is_dir()
        }
        pool.run_all(make_dataset, making, results.write, "making", report)
        searching = {
            name: (str(path),)
            for name, path in folders.items()
            if path.is_dir() and results.finished(name) is None
        }
        pool.run_all(trial.search_case, searching, results.write, "searching", report)
        fitting = {
            case.name: (str(folders[case.name]), case.to_dict()["hidden"])
            for case in map(case_from_dict, open_seal(self._sealed))
            if case.name in folders
            and case.hidden
            and results.finished(case.name) is not None
            and truths.finished(case.name) is None
        }
        pool.run_all(trial.fit_truth, fitting, truths.write, "fitting the truth", report)

    def judge(self, interrupted: bool) -> BenchmarkResult:
        """Open the seal and score every stored result."""
        config, names = self.config, [case.name for case in self._cases]
        labels = {label["name"]: case_from_dict(label) for label in open_seal(self._sealed)}
        results, errors = self._results.collect(names)
        truths, broken = self._truths.collect(results)
        errors |= {f"{name}, fit of the truth": error for name, error in broken.items()}
        scores = [score_case(labels[name], result, truths.get(name)) for name, result in results.items()]
        summary = summarize(scores)
        tables = tuple(result_tables(summary))
        lines = tuple(summary_sentences(config.seed, _origin(config), len(scores), len(names), len(errors)))
        write_json(config.out / NUMBERS, to_jsonable(_content(config, summary, scores, errors, interrupted)))
        write_text(config.out / TEXT, format_markdown(HEADING, lines, (*tables, case_table(scores))))
        return BenchmarkResult(summary, lines, tables, interrupted, len(errors))


def _origin(config: BenchmarkConfig) -> str:
    """Return what made the datasets, for a sentence."""
    if config.plant == RIG:
        return f"the {config.made_by} model of the rig through its sensors"
    return f"MuJoCo in fine steps, or by equations written by hand, of the machine {Path(config.plant).stem}"


def _content(
    config: BenchmarkConfig,
    summary: Summary,
    scores: list[CaseScore],
    errors: dict[str, str],
    interrupted: bool,
) -> dict[str, Any]:
    """Return the content of `benchmark.json`."""
    return {
        "plan": config.plan(),
        "version": omnimj.__version__,
        "judged": config.seed not in TUNING_SEEDS,
        "interrupted": interrupted,
        "summary": dataclasses.asdict(summary),
        "errors": errors,
        "cases": [dataclasses.asdict(score) for score in scores],
    }
