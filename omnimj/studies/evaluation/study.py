"""Evaluation study, `omnimj evaluate`: a diagnosis method on randomised cases, compared with their truth.

The folder:
  evaluation_plan.json  settings
  cases/case_….json     truth of a case and facts from its runs
  recordings/           recorded sensor signals as a dataset, with `--record`
  evaluation.json, evaluation.md
In JSON an infinite delay is null; a delay since first use is also null where the case has no `in_use`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import omnimj
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.gains import GAIN_NAMES, Gains
from omnimj.display import Displayed
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import read_robot
from omnimj.recording.json_files import to_jsonable, write_json, write_text
from omnimj.recording.tabular import Tabular
from omnimj.simulate.detectors import require_known_method
from omnimj.studies.evaluation.cases import (
    FLOORS,
    PLANTS,
    SUITES,
    Case,
    CasePopulation,
    check_settings,
    draw_cases,
    is_judging_seed,
    require_four_wheels,
)
from omnimj.studies.evaluation.goals import judge_goals
from omnimj.studies.evaluation.scoring import CaseEvents, CaseScore, score_case
from omnimj.studies.evaluation.summary import Summary, summarize
from omnimj.studies.evaluation.tables import format_heading, result_tables, summary_sentences
from omnimj.studies.evaluation.trial import OFF, RECORDINGS, drive_case, is_recorded, write_recordings_index
from omnimj.studies.random_structure import STRUCTURES
from omnimj.studies.random_truth import ALL_CLASSES
from omnimj.studies.runner import StudyFolder, TrialFolder, run_study
from omnimj.studies.statistics import Table, format_markdown
from omnimj.studies.workers import Progress, WorkerPool

PLAN, NUMBERS, TEXT, CASES = "evaluation_plan.json", "evaluation.json", "evaluation.md", "cases"


@dataclass(frozen=True)
class EvaluationConfig:
    """Settings of an evaluation."""

    out: Path
    population: CasePopulation = field(default_factory=CasePopulation)
    method: str = OFF
    settings: tuple[str, ...] = ()
    """`KEY=VALUE` texts for method and cascade: `diagnosis.variant=printed`."""
    trials: int = 100
    workers: int = 1
    force: bool = False
    """Replace another evaluation in the folder."""
    thresholds: Thresholds | None = None
    """Thresholds of the robust method; the shipped ones when None."""
    records: bool = False
    """Keep the sensor signals as a dataset."""
    gains: Gains | None = None
    """Gains of cascade, recovery and observer; the shipped ones when None."""

    def plan(self) -> dict[str, Any]:
        """Return the settings that stored cases depend on."""
        gains = Gains(read_robot(self.population.model).control) if self.gains is None else self.gains
        return {
            "method": self.method,
            "settings": list(self.settings),
            **self.population.plan(),
            "thresholds": (self.thresholds or Thresholds())._asdict(),
            "gains": {name: gains.value(name) for name in GAIN_NAMES},
            "version": omnimj.__version__,
        }


@dataclass(frozen=True)
class EvaluationResult(Displayed, Tabular):
    """Scores, summary and tables of an evaluation."""

    heading: str
    summary: Summary
    scores: tuple[CaseScore, ...]
    lines: tuple[str, ...]
    """Sentences on the origin of the numbers."""
    tables: tuple[Table, ...]
    interrupted: bool
    failed: int
    suite: str
    events: Mapping[str, CaseEvents]
    """Faults and diagnoses of the cases by name."""

    def table_columns(self) -> Mapping[str, Sequence[Any]]:
        """Fields of `CaseScore` by name, a row per case."""
        names = [field.name for field in dataclasses.fields(CaseScore)]
        cases = [dataclasses.asdict(score) for score in self.scores]
        return {name: [case[name] for case in cases] for name in names}


def run_evaluation(
    config: EvaluationConfig, report: Progress, executor: Executor | None = None
) -> EvaluationResult:
    """Run the missing cases and evaluate all that are finished; arguments and errors as for `run_study`.

    Raises:
      UnknownNameError: A suite, structure, plant, floor or fault class does not exist.
    """
    return run_study(_Evaluation(config), report, executor)


def check_config(config: EvaluationConfig) -> None:
    """Check that all names in the configuration exist.

    Raises:
      UnknownNameError: A name does not exist; the message lists the choices.
      InputError: A list is empty, a setting is malformed, or the method is unknown.
    """
    population = config.population
    require_four_wheels(population)
    require_known_method(config.method)
    check_settings(config.settings)
    if population.suite not in SUITES:
        raise UnknownNameError("--suite", "suite", population.suite, SUITES)
    if population.structure not in STRUCTURES:
        raise UnknownNameError("--structure", "structure", population.structure, STRUCTURES)
    for option, kind, names, known in (
        ("--plant", "plant", population.plants, PLANTS),
        ("--floor", "floor of the evaluation", population.floors, FLOORS),
        ("--faults", "class of faults", population.faults, ALL_CLASSES),
    ):
        if not names:
            raise InputError(option, "is empty", "give at least one", known)
        for name in names:
            if name not in known:
                raise UnknownNameError(option, kind, name, known)


class _Evaluation:
    """Steps of an evaluation for the study runner."""

    def __init__(self, config: EvaluationConfig):
        self.config, self.workers = config, config.workers
        self._results = TrialFolder(config.out / CASES)
        self._recordings = config.out / RECORDINGS
        self._cases: list[Case] = []

    def prepare(self) -> None:
        config = self.config
        check_config(config)
        folder = StudyFolder(config.out, PLAN, "an evaluation", (CASES, RECORDINGS))
        folder.claim(config.plan(), config.force)
        self._cases = draw_cases(config.population, range(config.trials))

    def work(self, pool: WorkerPool, report: Progress) -> None:
        config = self.config
        recordings = self._recordings if config.records else None
        arguments = (config.method, config.settings, config.thresholds, recordings, config.gains)
        tasks = {case.name: (case, *arguments) for case in self._cases if not self._is_finished(case)}
        pool.run_all(drive_case, tasks, self._results.write, "driving", report)

    def _is_finished(self, case: Case) -> bool:
        if self._results.finished(case.name, case=case.to_dict()) is None:
            return False
        return not self.config.records or is_recorded(self._recordings, case)

    def judge(self, interrupted: bool) -> EvaluationResult:
        config = self.config
        if config.records:
            write_recordings_index(self._recordings, self._cases)
        by_name = {case.name: case for case in self._cases}
        results, errors = self._results.collect(by_name)
        scores = tuple(score_case(by_name[name], result) for name, result in results.items())
        summary = summarize(scores)
        tables = tuple(result_tables(summary))
        lines = tuple(summary_sentences(config.population, summary, len(by_name), len(errors)))
        heading = format_heading(config.population, config.method, config.settings)
        write_json(config.out / NUMBERS, to_jsonable(_content(config, summary, scores, errors, interrupted)))
        write_text(config.out / TEXT, format_markdown(heading, lines, tables))
        events = {name: _events(by_name[name], result) for name, result in results.items()}
        return EvaluationResult(
            heading,
            summary,
            scores,
            lines,
            tables,
            interrupted,
            len(errors),
            config.population.suite,
            events,
        )


def _events(case: Case, result: Mapping[str, Any]) -> CaseEvents:
    return CaseEvents(case.fault_records(), result["method"]["diagnoses"], case.duration)


def _content(
    config: EvaluationConfig,
    summary: Summary,
    scores: Sequence[CaseScore],
    errors: Mapping[str, str],
    interrupted: bool,
) -> dict[str, Any]:
    """Return the content of `evaluation.json`."""
    return {
        "plan": config.plan() | {"trials": config.trials},
        "version": omnimj.__version__,
        "judged": is_judging_seed(config.population.seed),
        "interrupted": interrupted,
        "goals": [dataclasses.asdict(goal) for goal in judge_goals(summary)],
        "summary": dataclasses.asdict(summary),
        "errors": errors,
        "cases": [
            dataclasses.asdict(score) | {"heading_ratio": score.heading_ratio, "path_ratio": score.path_ratio}
            for score in scores
        ],
    }
