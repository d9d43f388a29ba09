"""`omnimj sensitivity`: which numbers of the model matter to which result of a scenario.

The folder:
  sensitivity_plan.json  what was asked, every range included
  runs/trajectory_….json, runs/noise_….json   what the plant had, and what came of it
  sensitivity.json, sensitivity.md
What is there is kept: a study that was broken off goes on where it stood, and one with more trajectories
takes up those that were driven. All runs have the same noise but those that tell what noise alone does.
"""

from __future__ import annotations

import dataclasses
import json
import math
import shutil
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import omnimj
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import SOURCES
from omnimj.recording.folder import check_folder
from omnimj.recording.json_files import has_result, read_result, result_writer, to_jsonable, write_json
from omnimj.signals import Array
from omnimj.simulate.detectors import make_detector
from omnimj.simulate.plants import make_plant
from omnimj.simulate.scenario.scenario import Scenario, scenario_digest
from omnimj.studies.sensitivity.elementary_effects import (
    bootstrap_mu_star,
    effect_statistics,
    elementary_effects,
    noise_floor,
    trajectory,
)
from omnimj.studies.sensitivity.factors import CHOSEN, DEFAULT_SHARE, ExcludedFactor, Factor, find_factors
from omnimj.studies.sensitivity.ranking import FactorRank, ResultSensitivity, rank_all
from omnimj.studies.sensitivity.trial import (
    RESOLUTION,
    TrialConfig,
    drive_with,
    nominal_scenario,
    resolve_method,
    result_units,
)
from omnimj.studies.workers import Progress, WorkerPool, run_in_workers

# What a study is asked to do, and the folder that belongs to it.

PLAN, RUNS = "sensitivity_plan.json", "runs"


@dataclass(frozen=True)
class SensitivityConfig:
    """What is to be done."""

    out: Path
    asked: TrialConfig
    trajectories: int = 10
    seed: int = 0
    """Of the sensors' noise and of the trajectories."""
    share: float = DEFAULT_SHARE
    """Half-width of the ranges that no file states, relative to the value."""
    sources: tuple[str, ...] = (CHOSEN,)
    """Origins of the numbers that are varied."""
    workers: int = 1
    force: bool = False
    """Whether another study that is in the folder may be replaced."""


def check_config(order: SensitivityConfig) -> tuple[Scenario, tuple[Factor, ...], tuple[ExcludedFactor, ...]]:
    """Whether it can be done: the scenario, what is varied in it, and what is not.

    Raises:
      InputError, UnknownNameError: As `study.run_sensitivity`.
    """
    for source in order.sources:
        if source not in SOURCES:
            raise UnknownNameError("--source", "source", source, SOURCES)
    scenario = nominal_scenario(order.asked)
    varied, left_out = find_factors(scenario, order.sources, order.share)
    if not varied:
        found = f"no number of {scenario.constants.file} or of the floors is {' or '.join(order.sources)}"
        raise InputError("--source", found, "there is nothing to vary", SOURCES)
    # what the plant or the method cannot do would break every run
    make_detector(resolve_method(order.asked, scenario), scenario)
    make_plant(scenario, order.asked.plant, order.seed).close()
    return scenario, varied, left_out


def prepared(order: SensitivityConfig, scenario: Scenario, varied: Sequence[Factor]) -> Path:
    """The folder of the runs; what it holds belongs to this order.

    Raises:
      InputError: The folder holds something else or another study, or cannot be written.
    """
    asked = _plan(order, scenario, varied)
    plan, runs = order.out / PLAN, order.out / RUNS
    if plan.is_file():
        if read_result(order.out, plan.stem) == asked:
            return runs
        if not order.force:
            rule = f"{PLAN} there says which; choose another folder, or --force to replace it"
            raise InputError(f"--out {order.out}", "holds a study of something else", rule)
    check_folder(order.out, order.force)
    try:
        if plan.is_file():  # a study's own folder, and nothing else, is emptied
            shutil.rmtree(runs, ignore_errors=True)
        runs.mkdir(parents=True, exist_ok=True)
        write_json(plan, asked)
    except OSError as error:
        raise InputError(f"--out {order.out}", f"cannot be written ({error.strerror})") from None
    return runs


def _plan(order: SensitivityConfig, scenario: Scenario, varied: Sequence[Factor]) -> dict[str, Any]:
    """What must be alike for a folder to be gone on with."""
    asked = {
        "scenario": scenario.name,
        "overrides": list(order.asked.overrides),
        "plant": order.asked.plant,
        "method": resolve_method(order.asked, scenario),
        "seed": order.seed,
        "sources": list(order.sources),
        "ranges": [dataclasses.asdict(one) for one in varied],
        # nominal numbers that are not varied act on every run, too
        "digest": scenario_digest(order.asked.scenario, scenario),
        "thresholds": dataclasses.asdict(Thresholds()),
        "version": omnimj.__version__,
    }
    return json.loads(json.dumps(asked))


NUMBERS = "sensitivity.json"
REPEATS = 20
"""Runs with nominal numbers and other noise."""
_BOOTSTRAP, _NULL = 1, 2  # streams of the study's seed beside the trajectories' own


@dataclass(frozen=True)
class SensitivityResult:
    """What came of it."""

    scenario: str
    description: str
    plant: str
    method: str
    order: SensitivityConfig
    varied: tuple[Factor, ...]
    left_out: tuple[ExcludedFactor, ...]
    studies: tuple[ResultSensitivity, ...]
    """Of every result that any run has."""
    ranks: tuple[FactorRank, ...]
    runs: int
    """Runs of trajectories that came to their end."""
    repeats: int
    """The same of those that tell what noise does."""
    errors: Mapping[str, str]
    """What broke, by run."""
    interrupted: bool


def run_sensitivity(
    order: SensitivityConfig, report: Progress, executor: Executor | None = None
) -> SensitivityResult:
    """Drives the runs that are missing, and says what all that are there amount to.

    Args:
      order: What is to be done.
      report: Called with a phrase and the share that is done; may raise KeyboardInterrupt.
      executor: Runs the runs, a task each; processes of its own when None.

    Returns:
      What was found, also after Ctrl-C.

    Raises:
      InputError: The folder holds something else or another study, or cannot be written; the scenario or what
        is asked of it cannot be; nothing in it is of the origins asked for.
      UnknownNameError: No such scenario, plant, method or origin.
      SimulationError: A worker died; what was finished is kept.
    """
    scenario, varied, left_out = check_config(order)
    folder = prepared(order, scenario, varied)
    tasks = _tasks(order, varied)
    missing = {name: given for name, given in tasks.items() if not has_result(folder, name)}

    def work(workers: WorkerPool) -> None:
        workers.run_all(drive_with, missing, result_writer(folder), "driving", report)

    finished = run_in_workers(work, order.workers, executor) if missing else True
    return _judged(order, scenario, varied, left_out, tasks, not finished)


def _values(order: SensitivityConfig, varied: Sequence[Factor], index: int) -> list[dict[str, float]]:
    """What the plant has at every point of a trajectory."""
    points = trajectory(order.seed, index, len(varied))
    return [{v.name: v.at(x) for v, x in zip(varied, point, strict=True)} for point in points.tolist()]


def _point_name(index: int, point: int) -> str:
    return f"trajectory_{index:04d}_{point:03d}"


def _tasks(order: SensitivityConfig, varied: Sequence[Factor]) -> dict[str, tuple]:
    """Every run by name: noise first, so that what comes early can be judged early."""
    tasks: dict[str, tuple] = {f"noise_{k:02d}": (order.asked, {}, order.seed + k) for k in range(REPEATS)}
    for index in range(order.trajectories):
        for point, values in enumerate(_values(order, varied, index)):
            tasks[_point_name(index, point)] = (order.asked, values, order.seed)
    return tasks


def _judged(
    order: SensitivityConfig,
    scenario: Scenario,
    varied: tuple[Factor, ...],
    left_out: tuple[ExcludedFactor, ...],
    tasks: Mapping[str, tuple],
    interrupted: bool,
) -> SensitivityResult:
    """What the runs that are there amount to; writes the numbers."""
    found: dict[str, Mapping[str, float | None]] = {}
    errors: dict[str, str] = {}
    for name in tasks:
        result = read_result(order.out / RUNS, name)
        if result is not None and "error" in result:
            errors[name] = result["error"]
        elif result is not None:
            found[name] = result["results"]
    method = resolve_method(order.asked, scenario)
    studies = [
        _study(name, unit, order, varied, found) for name, unit in result_units(scenario, method).items()
    ]
    told = tuple(study for study in studies if any(one.count for one in study.measures))
    outcome = SensitivityResult(
        scenario=scenario.name,
        description=scenario.description,
        plant=order.asked.plant,
        method=method,
        order=order,
        varied=varied,
        left_out=left_out,
        studies=told,
        ranks=rank_all(told),
        runs=sum(name.startswith("trajectory") for name in found),
        repeats=sum(name.startswith("noise") for name in found),
        errors=errors,
        interrupted=interrupted,
    )
    write_json(order.out / NUMBERS, to_jsonable(_content(outcome)))
    return outcome


def _study(
    name: str,
    unit: str,
    order: SensitivityConfig,
    varied: Sequence[Factor],
    found: Mapping[str, Mapping[str, float | None]],
) -> ResultSensitivity:
    """What the parameters do to one result."""

    def result(run: str) -> float:
        value = found.get(run, {}).get(name)
        return math.nan if value is None else value

    rows = []
    for index in range(order.trajectories):
        values = _values(order, varied, index)
        places = np.array([[v.place(at[v.name]) for v in varied] for at in values])
        results = np.array([result(_point_name(index, point)) for point in range(len(values))])
        rows.append(elementary_effects(places, results))
    effects: Array = np.array(rows)
    draws = bootstrap_mu_star(effects, _stream(order.seed, _BOOTSTRAP))
    repeats = [result(f"noise_{k:02d}") for k in range(REPEATS)]
    noise = noise_floor(repeats, order.trajectories, len(varied), _stream(order.seed, _NULL))
    floor = max(noise, RESOLUTION.get(unit, 0.0)) if math.isfinite(noise) else math.nan
    nominal = repeats[0] if math.isfinite(repeats[0]) else None
    return ResultSensitivity(name, unit, nominal, noise, floor, effect_statistics(effects, draws), draws)


def _stream(seed: int, what: int) -> int:
    return int(np.random.SeedSequence((seed, what)).generate_state(1)[0])


def _content(outcome: SensitivityResult) -> dict[str, Any]:
    """`sensitivity.json`."""
    order, names = outcome.order, [one.name for one in outcome.varied]
    return {
        "scenario": outcome.scenario,
        "overrides": order.asked.overrides,
        "plant": outcome.plant,
        "method": outcome.method,
        "seed": order.seed,
        "trajectories": order.trajectories,
        "sources": order.sources,
        "version": omnimj.__version__,
        "interrupted": outcome.interrupted,
        "runs": outcome.runs,
        "noise_runs": outcome.repeats,
        "errors": outcome.errors,
        "parameters": [dataclasses.asdict(one) for one in outcome.varied],
        "left_out": [dataclasses.asdict(one) for one in outcome.left_out],
        "measure_first": [
            dataclasses.asdict(rank) | {"parameter": names[rank.parameter]} for rank in outcome.ranks
        ],
        "results": {
            study.name: {
                "unit": study.unit,
                "nominal": study.nominal,
                "noise": study.noise,
                "floor": study.floor,
                "effects": [
                    {"parameter": name, "verdict": word, **dataclasses.asdict(one)}
                    for name, word, one in zip(names, study.verdicts, study.measures, strict=True)
                ],
            }
            for study in outcome.studies
        },
    }
