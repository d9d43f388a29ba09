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
import multiprocessing
import signal
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import omnimj
from omnimj.errors import InputError, OmnimjError, SimulationError, UnknownNameError
from omnimj.gap import benchmark_work
from omnimj.gap.benchmark_cases import TUNING_SEEDS, Case, case_of, draw_cases
from omnimj.gap.benchmark_making import MAKERS, PLANT, make_dataset
from omnimj.gap.benchmark_scoring import CaseScore, score_case
from omnimj.gap.benchmark_seal import holds, is_sealed, open_seal, seal
from omnimj.gap.benchmark_summary import Summary, summarise
from omnimj.gap.benchmark_table import Table, header, markdown, tables
from omnimj.gap.digest import plain
from omnimj.recording.folder import check_folder, whole_file

PLAN, NUMBERS, TEXT = "benchmark_plan.json", "benchmark.json", "benchmark.md"
Report = Callable[[str, float], None]


@dataclass(frozen=True)
class Order:
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
class Outcome:
    """What came of it."""

    summary: Summary
    lines: tuple[str, ...]
    """What the numbers are of."""
    tables: tuple[Table, ...]
    interrupted: bool
    failed: int


def run_benchmark(order: Order, report: Report, executor: Executor | None = None) -> Outcome:
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
    before = set(multiprocessing.active_children())
    pool = executor or ProcessPoolExecutor(
        order.workers, multiprocessing.get_context("spawn"), initializer=_deaf
    )
    finished = False
    try:
        _work(order, cases, pool, report)
        finished = True
    except KeyboardInterrupt:
        pass
    except BrokenExecutor:
        words = "a worker died; what was finished is kept, and the same command goes on from there"
        raise SimulationError(words) from None
    finally:
        if executor is None:
            _end(pool, before, finished)
    return _scored(order, [case.name for case in cases], not finished)


def _end(pool: Executor, before: set, finished: bool) -> None:
    """Ends the workers; at once when the work was broken off."""
    pool.shutdown(wait=finished, cancel_futures=not finished)
    if not finished:
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()


def _deaf() -> None:
    """Ctrl-C is for the parent, which ends its workers itself."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _prepared(order: Order) -> list[Case]:
    """Draws the cases and seals them; checks that what is in the folder belongs to them."""
    if order.made_by not in MAKERS:
        raise UnknownNameError("--made-by", "maker of datasets", order.made_by, MAKERS)
    if order.plant != PLANT:
        raise UnknownNameError("--plant", "plant of the benchmark", order.plant, (PLANT,))
    cases = draw_cases(order.seed, order.trials)
    labels = [case.as_plain() for case in cases]
    plan, sealed = order.out / PLAN, order.out / "sealed"
    if plan.is_file():
        if json.loads(plan.read_text(encoding="utf-8")) != order.plan():
            rule = f"{PLAN} there says which; choose another folder"
            raise InputError(f"--out {order.out}", "holds a benchmark with other settings", rule)
        if not (is_sealed(sealed) and holds(sealed, labels)):
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
    _write(plan, order.plan())
    return cases


def _work(order: Order, cases: list[Case], pool: Executor, report: Report) -> None:
    """Datasets, searches, and only then, with the seal open, the true models' fits."""
    folders = {case.name: order.out / "datasets" / case.name for case in cases}
    making = {
        case.name: (case, folders[case.name], order.made_by, order.seconds, order.conditions)
        for case in cases
        if not folders[case.name].is_dir()
    }
    results = order.out / "results"
    _all(pool, make_dataset, making, _keep_in(results), "making", report)
    searching = {
        name: (str(path),) for name, path in folders.items() if path.is_dir() and not _has(results, name)
    }
    _all(pool, benchmark_work.search_case, searching, _keep_in(results), "searching", report)
    scored = order.out / "scored"
    fitting = {
        case.name: (str(folders[case.name]), case.as_plain()["hidden"])
        for case in map(case_of, open_seal(order.out / "sealed"))
        if case.name in folders and case.hidden and _has(results, case.name) and not _has(scored, case.name)
    }
    _all(pool, benchmark_work.fit_truth, fitting, _keep_in(scored), "fitting the truth", report)


def _all(
    pool: Executor,
    function: Callable[..., Any],
    tasks: Mapping[str, tuple],
    keep: Callable[[str, Any], None],
    phrase: str,
    report: Report,
) -> None:
    """Does all tasks, each result kept as it comes; what broke down is kept as an error."""
    futures = {pool.submit(function, *arguments): name for name, arguments in tasks.items()}
    try:
        report(phrase, 0.0)
        for done, future in enumerate(as_completed(futures), start=1):
            try:
                keep(futures[future], future.result())
            except OmnimjError as error:
                keep(futures[future], {"error": str(error)})
            report(f"{phrase}: {done} of {len(futures)}", done / len(futures))
    except KeyboardInterrupt:
        for future in futures:
            future.cancel()
        raise


def _keep_in(folder: Path) -> Callable[[str, Any], None]:
    def keep(name: str, result: dict[str, Any] | None) -> None:
        if result is not None:
            _write(folder / f"{name}.json", result)

    return keep


def _has(folder: Path, name: str) -> bool:
    """Whether a result is there; one that says what broke is tried again."""
    found = _read(folder, name)
    return found is not None and "error" not in found


def _read(folder: Path, name: str) -> dict[str, Any] | None:
    file = folder / f"{name}.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None


def _write(path: Path, content: Any) -> None:
    with whole_file(path) as temporary:
        text = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)
        temporary.write_text(text + "\n", encoding="utf-8")


def _scored(order: Order, names: list[str], interrupted: bool) -> Outcome:
    """Opens the seal and scores every result that is there."""
    labels = {plain_case["name"]: case_of(plain_case) for plain_case in open_seal(order.out / "sealed")}
    scores: list[CaseScore] = []
    errors: dict[str, str] = {}
    for name in names:
        result = _read(order.out / "results", name)
        if result is None:
            continue
        if "error" in result:
            errors[name] = result["error"]
            continue
        truth = _read(order.out / "scored", name)
        if truth is not None and "error" in truth:
            errors[f"{name}, fit of the truth"] = truth["error"]
        scores.append(score_case(labels[name], result, truth))
    summary = summarise(scores)
    found = tuple(tables(summary))
    lines = tuple(header(order.seed, order.made_by, len(scores), len(names), len(errors)))
    content = {
        "plan": order.plan(),
        "version": omnimj.__version__,
        "judged": order.seed not in TUNING_SEEDS,
        "interrupted": interrupted,
        "summary": dataclasses.asdict(summary),
        "errors": errors,
        "cases": [dataclasses.asdict(score) for score in scores],
    }
    _write(order.out / NUMBERS, plain(content))
    with whole_file(order.out / TEXT) as temporary:
        temporary.write_text(markdown(lines, found), encoding="utf-8")
    return Outcome(summary, lines, found, interrupted, len(errors))
