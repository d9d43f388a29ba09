"""Sensitivity study, `omnimj sensitivity`: the effect of model parameters on the results of a scenario.

The folder:
  sensitivity_plan.json  settings, with every range
  runs/trajectory_….json, runs/noise_….json   parameter values and results of one run
  sensitivity.json, sensitivity.md
All runs have the same noise except those that measure the effect of noise alone.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import omnimj
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import SOURCES
from omnimj.recording.json_files import to_jsonable, write_json
from omnimj.signals import Array
from omnimj.simulate.detectors import make_detector
from omnimj.simulate.plants import make_plant
from omnimj.simulate.scenario.scenario import Scenario, scenario_digest
from omnimj.studies.runner import StudyFolder, TrialFolder, run_study
from omnimj.studies.sensitivity.elementary_effects import (
    FactorRank,
    ResultSensitivity,
    bootstrap_mu_star,
    effect_statistics,
    elementary_effects,
    noise_floor,
    rank_all,
    trajectory,
)
from omnimj.studies.sensitivity.factors import CHOSEN, DEFAULT_SHARE, ExcludedFactor, Factor, find_factors
from omnimj.studies.sensitivity.trial import (
    RESOLUTION,
    TrialConfig,
    drive_with,
    nominal_scenario,
    resolve_method,
    result_units,
)
from omnimj.studies.workers import Progress, WorkerPool

PLAN, RUNS, NUMBERS = "sensitivity_plan.json", "runs", "sensitivity.json"
REPEATS = 20
"""Number of runs with nominal parameters and different noise."""
_BOOTSTRAP_STREAM, _NULL_STREAM = 1, 2  # random streams of the study's seed beside those of the trajectories


@dataclass(frozen=True)
class SensitivityConfig:
    """Settings of a sensitivity study."""

    out: Path
    trial: TrialConfig
    trajectories: int = 10
    seed: int = 0
    """Seed of the sensor noise and of the trajectories."""
    share: float = DEFAULT_SHARE
    """Half-width, relative to the value, of ranges for which the model file states no uncertainty."""
    sources: tuple[str, ...] = (CHOSEN,)
    """Provenances of the parameters to vary."""
    workers: int = 1
    force: bool = False
    """Replace another study in the folder."""


@dataclass(frozen=True)
class SensitivityResult:
    """Ranking of the parameters, over all results and for each."""

    scenario: str
    description: str
    plant: str
    method: str
    config: SensitivityConfig
    factors: tuple[Factor, ...]
    excluded: tuple[ExcludedFactor, ...]
    studies: tuple[ResultSensitivity, ...]
    """One per result that at least one run has."""
    ranks: tuple[FactorRank, ...]
    runs: int
    """Number of finished runs of trajectories."""
    repeats: int
    """Number of finished runs with different noise only."""
    errors: Mapping[str, str]
    """Error message by run that failed."""
    interrupted: bool


def run_sensitivity(
    config: SensitivityConfig, report: Progress, executor: Executor | None = None
) -> SensitivityResult:
    """Run the missing points of all trajectories and rank the parameters; see `run_study`.

    Raises:
      InputError: Also where no parameter has one of the given provenances.
      UnknownNameError: A scenario, plant, method or provenance does not exist.
    """
    return run_study(_Sensitivity(config), report, executor)


def check_config(
    config: SensitivityConfig,
) -> tuple[Scenario, tuple[Factor, ...], tuple[ExcludedFactor, ...]]:
    """Return the scenario, the parameters that are varied in it, and those that are not.

    Raises:
      InputError, UnknownNameError: As `run_sensitivity`.
    """
    for source in config.sources:
        if source not in SOURCES:
            raise UnknownNameError("--source", "source", source, SOURCES)
    scenario = nominal_scenario(config.trial)
    factors, excluded = find_factors(scenario, config.sources, config.share)
    if not factors:
        found = f"no number of {scenario.constants.file} or of the floors is {' or '.join(config.sources)}"
        raise InputError("--source", found, "there is nothing to vary", SOURCES)
    # a plant or method that does not suit the scenario would fail in every run
    make_detector(resolve_method(config.trial, scenario), scenario)
    make_plant(scenario, config.trial.plant, config.seed).close()
    return scenario, factors, excluded


class _Sensitivity:
    """Steps of a sensitivity study for the study runner."""

    def __init__(self, config: SensitivityConfig):
        self.config, self.workers = config, config.workers
        self._runs = TrialFolder(config.out / RUNS)

    def prepare(self) -> None:
        config = self.config
        self._scenario, self._factors, self._excluded = check_config(config)
        self._method = resolve_method(config.trial, self._scenario)
        self._tasks = self._make_tasks()
        StudyFolder(config.out, PLAN, "a sensitivity study", (RUNS,)).claim(self._plan(), config.force)
        self._runs.path.mkdir(exist_ok=True)

    def _plan(self) -> dict[str, Any]:
        """Return the settings that stored runs depend on."""
        config, trial = self.config, self.config.trial
        return {
            "scenario": self._scenario.name,
            "overrides": list(trial.overrides),
            "plant": trial.plant,
            "method": self._method,
            "seed": config.seed,
            "sources": list(config.sources),
            "ranges": [dataclasses.asdict(factor) for factor in self._factors],
            # the parameters that are not varied affect every run, too
            "digest": scenario_digest(trial.scenario, self._scenario),
            "thresholds": Thresholds()._asdict(),
            "version": omnimj.__version__,
        }

    def _make_tasks(self) -> dict[str, tuple]:
        """Return every run by name, noise first, so that an interrupted study can be evaluated."""
        config = self.config
        tasks: dict[str, tuple] = {
            f"noise_{k:02d}": (config.trial, {}, config.seed + k) for k in range(REPEATS)
        }
        for index in range(config.trajectories):
            for point, values in enumerate(self._values(index)):
                tasks[_point_name(index, point)] = (config.trial, values, config.seed)
        return tasks

    def _values(self, index: int) -> list[dict[str, float]]:
        """Return the true parameter values at every point of a trajectory."""
        points = trajectory(self.config.seed, index, len(self._factors))
        return [
            {factor.name: factor.at(x) for factor, x in zip(self._factors, point, strict=True)}
            for point in points.tolist()
        ]

    def work(self, pool: WorkerPool, report: Progress) -> None:
        missing = {name: task for name, task in self._tasks.items() if self._runs.finished(name) is None}
        pool.run_all(drive_with, missing, self._runs.write, "driving", report)

    def judge(self, interrupted: bool) -> SensitivityResult:
        config, scenario = self.config, self._scenario
        found, errors = self._runs.collect(self._tasks)
        results = {name: run["results"] for name, run in found.items()}
        units = result_units(scenario, self._method)
        studies = [self._study(name, unit, results) for name, unit in units.items()]
        known = tuple(study for study in studies if any(one.count for one in study.measures))
        result = SensitivityResult(
            scenario=scenario.name,
            description=scenario.description,
            plant=config.trial.plant,
            method=self._method,
            config=config,
            factors=self._factors,
            excluded=self._excluded,
            studies=known,
            ranks=rank_all(known),
            runs=sum(name.startswith("trajectory") for name in found),
            repeats=sum(name.startswith("noise") for name in found),
            errors=errors,
            interrupted=interrupted,
        )
        write_json(config.out / NUMBERS, to_jsonable(_content(result)))
        return result

    def _study(
        self, name: str, unit: str, results: Mapping[str, Mapping[str, float | None]]
    ) -> ResultSensitivity:
        """Return the effects of all parameters on one result."""
        config, factors = self.config, self._factors

        def result(run: str) -> float:
            value = results.get(run, {}).get(name)
            return math.nan if value is None else value

        rows = []
        for index in range(config.trajectories):
            values = self._values(index)
            places = np.array([[factor.place(at[factor.name]) for factor in factors] for at in values])
            outputs = np.array([result(_point_name(index, point)) for point in range(len(values))])
            rows.append(elementary_effects(places, outputs))
        effects: Array = np.array(rows)
        draws = bootstrap_mu_star(effects, _stream(config.seed, _BOOTSTRAP_STREAM))
        repeats = [result(f"noise_{k:02d}") for k in range(REPEATS)]
        noise = noise_floor(repeats, config.trajectories, len(factors), _stream(config.seed, _NULL_STREAM))
        floor = max(noise, RESOLUTION.get(unit, 0.0)) if math.isfinite(noise) else math.nan
        nominal = repeats[0] if math.isfinite(repeats[0]) else None
        return ResultSensitivity(name, unit, nominal, noise, floor, effect_statistics(effects, draws), draws)


def _point_name(index: int, point: int) -> str:
    return f"trajectory_{index:04d}_{point:03d}"


def _stream(seed: int, stream: int) -> int:
    return int(np.random.SeedSequence((seed, stream)).generate_state(1)[0])


def _content(result: SensitivityResult) -> dict[str, Any]:
    """Return the content of `sensitivity.json`."""
    config, names = result.config, [factor.name for factor in result.factors]
    return {
        "scenario": result.scenario,
        "overrides": config.trial.overrides,
        "plant": result.plant,
        "method": result.method,
        "seed": config.seed,
        "trajectories": config.trajectories,
        "sources": config.sources,
        "version": omnimj.__version__,
        "interrupted": result.interrupted,
        "runs": result.runs,
        "noise_runs": result.repeats,
        "errors": result.errors,
        "parameters": [dataclasses.asdict(factor) for factor in result.factors],
        "left_out": [dataclasses.asdict(factor) for factor in result.excluded],
        "measure_first": [
            dataclasses.asdict(rank) | {"parameter": names[rank.parameter]} for rank in result.ranks
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
            for study in result.studies
        },
    }
