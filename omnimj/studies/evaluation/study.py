"""`omnimj evaluate`: many randomised cases with a method, judged against their truth.

The folder:
  evaluation_plan.json  what was asked
  cases/case_….json     the truth of a case and what its runs gave
  recordings/           where asked for, what the sensors said, as a dataset
  evaluation.json, evaluation.md
In JSON a delay without end is null; one since first use is null too where `in_use` of the case's faults is.
What is there is kept: an evaluation that was broken off goes on where it stood, and one with more trials
takes up those that were driven.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import omnimj
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.gains import GAIN_NAMES, Gains
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import read_robot
from omnimj.recording.folder import check_folder
from omnimj.recording.json_files import read_result, result_writer, to_jsonable, write_json, write_text
from omnimj.signals import to_frame
from omnimj.simulate.detectors import require_known_method
from omnimj.studies.evaluation.cases import (
    FLOORS,
    PLANTS,
    SUITES,
    Case,
    CasePopulation,
    check_settings,
    draw_case,
    is_judging_seed,
)
from omnimj.studies.evaluation.goals import judge_goals
from omnimj.studies.evaluation.scoring import CaseScore, score_case
from omnimj.studies.evaluation.summary import Summary, summarize
from omnimj.studies.evaluation.tables import format_heading, result_tables, summary_sentences
from omnimj.studies.evaluation.trial import OFF, RECORDINGS, drive_case, is_recorded, write_recordings_index
from omnimj.studies.random_truth import ALL_CLASSES
from omnimj.studies.statistics import Table, format_markdown
from omnimj.studies.workers import Progress, WorkerPool, run_in_workers

PLAN, NUMBERS, TEXT, CASES = "evaluation_plan.json", "evaluation.json", "evaluation.md", "cases"


@dataclass(frozen=True)
class EvaluationConfig:
    """What is to be done."""

    out: Path
    choice: CasePopulation = field(default_factory=CasePopulation)
    method: str = OFF
    settings: tuple[str, ...] = ()
    """`KEY=VALUE` texts for method and cascade: `diagnosis.variant=printed`."""
    trials: int = 100
    workers: int = 1
    force: bool = False
    """Whether another evaluation that is in the folder may be replaced."""
    thresholds: Thresholds | None = None
    """Of the robust method; the shipped ones when None."""
    records: bool = False
    """Whether what the sensors said is kept."""
    gains: Gains | None = None
    """Of cascade, recovery and observer; the shipped ones when None."""

    def plan(self) -> dict[str, Any]:
        """What must be alike for a folder to be gone on with."""
        gains = Gains(read_robot().control) if self.gains is None else self.gains
        own = {
            "thresholds": dataclasses.asdict(self.thresholds or Thresholds()),
            "gains": {name: gains.value(name) for name in GAIN_NAMES},
            "version": omnimj.__version__,
        }
        asked = {"method": self.method, "settings": self.settings, **dataclasses.asdict(self.choice)}
        return json.loads(json.dumps(asked | own))


@dataclass(frozen=True)
class EvaluationResult:
    """What came of it."""

    heading: str
    summary: Summary
    scores: tuple[CaseScore, ...]
    lines: tuple[str, ...]
    """What the numbers are of."""
    tables: tuple[Table, ...]
    interrupted: bool
    failed: int

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame` with a row per case; needs pandas."""
        cases = [dataclasses.asdict(score) for score in self.scores]
        return to_frame({name: [case[name] for case in cases] for name in (cases[0] if cases else ())})


def run_evaluation(
    order: EvaluationConfig, report: Progress, executor: Executor | None = None
) -> EvaluationResult:
    """Drives the cases that are missing, and judges all that are there.

    Args:
      order: What is to be done.
      report: Called with a phrase and the share that is done; may raise KeyboardInterrupt.
      executor: Runs the cases, a task each; processes of its own when None.

    Returns:
      What was found, also after Ctrl-C.

    Raises:
      InputError: The folder holds something else or another evaluation, or cannot be written; no such
        method.
      UnknownNameError: No such suite, plant, floor or class of faults.
      SimulationError: A worker died; what was finished is kept.
    """
    check_config(order)
    folder = _prepared(order)
    cases = [draw_case(order.choice, index) for index in range(order.trials)]
    own = () if order.thresholds is None else (order.thresholds,)
    recordings = order.out / RECORDINGS
    if order.records or order.gains is not None:
        own = (order.thresholds, recordings if order.records else None)
    if order.gains is not None:
        own = (*own, order.gains)
    missing = {
        case.name: (case, order.method, order.settings, *own)
        for case in cases
        if not _is_driven(folder, case) or (order.records and not is_recorded(recordings, case))
    }

    def work(workers: WorkerPool) -> None:
        workers.run_all(drive_case, missing, result_writer(folder), "driving", report)

    finished = run_in_workers(work, order.workers, executor) if missing else True
    if order.records:
        write_recordings_index(recordings, cases)
    return _judged(order, cases, not finished)


def check_config(order: EvaluationConfig) -> None:
    """Whether the names in it exist.

    Raises:
      UnknownNameError: One does not; the message lists the choices.
      InputError: A list is empty, a setting is none, or there is no such method.
    """
    choice = order.choice
    require_known_method(order.method)
    check_settings(order.settings)
    if choice.suite not in SUITES:
        raise UnknownNameError("--suite", "suite", choice.suite, SUITES)
    for option, kind, names, known in (
        ("--plant", "plant", choice.plants, PLANTS),
        ("--floor", "floor of the evaluation", choice.floors, FLOORS),
        ("--faults", "class of faults", choice.faults, ALL_CLASSES),
    ):
        if not names:
            raise InputError(option, "is empty", "give at least one", known)
        for name in names:
            if name not in known:
                raise UnknownNameError(option, kind, name, known)


def _prepared(order: EvaluationConfig) -> Path:
    """The folder of the cases; what it holds belongs to this order."""
    plan, cases = order.out / PLAN, order.out / CASES
    if plan.is_file():
        if read_result(order.out, plan.stem) == order.plan():
            return cases
        if not order.force:
            rule = f"{PLAN} there says which; choose another folder, or --force to replace it"
            raise InputError(f"--out {order.out}", "holds an evaluation with other settings", rule)
    check_folder(order.out, order.force)
    try:
        if plan.is_file():  # an evaluation's own folder, and nothing else, is emptied
            for folder in (cases, order.out / RECORDINGS):
                shutil.rmtree(folder, ignore_errors=True)
        cases.mkdir(parents=True, exist_ok=True)
        write_json(plan, order.plan())
    except OSError as error:
        raise InputError(f"--out {order.out}", f"cannot be written ({error.strerror})") from None
    return cases


def _is_driven(folder: Path, case: Case) -> bool:
    """Whether a case's result is there; one that says what broke is tried again.

    Raises:
      InputError: It is there with another truth.
    """
    result = read_result(folder, case.name)
    if result is None or "error" in result:
        return False
    if result["case"] != to_jsonable(case.to_dict()):
        rule = "the library has changed since; choose another folder"
        raise InputError(f"{folder / case.name}.json", "holds another case than this seed draws", rule)
    return True


def _judged(order: EvaluationConfig, cases: Sequence[Case], interrupted: bool) -> EvaluationResult:
    """Scores every case that is there, and writes the numbers."""
    scores, errors = [], {}
    for case in cases:
        result = read_result(order.out / CASES, case.name)
        if result is None:
            continue
        if "error" in result:
            errors[case.name] = result["error"]
        else:
            scores.append(score_case(case, result))
    summary = summarize(scores)
    found = tuple(result_tables(summary))
    lines = tuple(summary_sentences(order.choice, summary, len(cases), len(errors)))
    heading = format_heading(order.choice, order.method, order.settings)
    write_json(order.out / NUMBERS, to_jsonable(_content(order, summary, scores, errors, interrupted)))
    write_text(order.out / TEXT, format_markdown(heading, lines, found))
    return EvaluationResult(heading, summary, tuple(scores), lines, found, interrupted, len(errors))


def _content(
    order: EvaluationConfig,
    summary: Summary,
    scores: Sequence[CaseScore],
    errors: Mapping[str, str],
    interrupted: bool,
) -> dict[str, Any]:
    return {
        "plan": order.plan() | {"trials": order.trials},
        "version": omnimj.__version__,
        "judged": is_judging_seed(order.choice.seed),
        "interrupted": interrupted,
        "goals": [dataclasses.asdict(one) for one in judge_goals(summary)],
        "summary": dataclasses.asdict(summary),
        "errors": errors,
        "cases": [
            dataclasses.asdict(s) | {"heading_ratio": s.heading_ratio, "path_ratio": s.path_ratio}
            for s in scores
        ],
    }
