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
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

import omnimj
from omnimj.scenario.scenario import Scenario
from omnimj.sensitivity.driving import drive_changed, method_of
from omnimj.sensitivity.elementary import bootstrap, effects_of_trajectory, measures, noise_floor
from omnimj.sensitivity.order import RUNS, Order, check_order, prepared
from omnimj.sensitivity.ranking import Rank, ResultStudy, rank_all
from omnimj.sensitivity.results import RESOLUTION, result_units
from omnimj.sensitivity.trajectories import trajectory
from omnimj.sensitivity.varied import LeftOut, Varied
from omnimj.signals import Array
from omnimj.trials.pool import Report, Workers, with_workers
from omnimj.trials.results import has_result, keep_in, plain, read_result, write_json

NUMBERS = "sensitivity.json"
REPEATS = 20
"""Runs with nominal numbers and other noise."""
_BOOTSTRAP, _NULL = 1, 2  # streams of the study's seed beside the trajectories' own


@dataclass(frozen=True)
class Outcome:
    """What came of it."""

    scenario: str
    description: str
    plant: str
    method: str
    order: Order
    varied: tuple[Varied, ...]
    left_out: tuple[LeftOut, ...]
    studies: tuple[ResultStudy, ...]
    """Of every result that any run has."""
    ranks: tuple[Rank, ...]
    runs: int
    """Runs of trajectories that came to their end."""
    repeats: int
    """The same of those that tell what noise does."""
    errors: Mapping[str, str]
    """What broke, by run."""
    interrupted: bool


def run_study(order: Order, report: Report, executor: Executor | None = None) -> Outcome:
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
    scenario, varied, left_out = check_order(order)
    folder = prepared(order, scenario, varied)
    tasks = _tasks(order, varied)
    missing = {name: given for name, given in tasks.items() if not has_result(folder, name)}

    def work(workers: Workers) -> None:
        workers.do_all(drive_changed, missing, keep_in(folder), "driving", report)

    finished = with_workers(work, order.workers, executor) if missing else True
    return _judged(order, scenario, varied, left_out, tasks, not finished)


def _values(order: Order, varied: Sequence[Varied], index: int) -> list[dict[str, float]]:
    """What the plant has at every point of a trajectory."""
    points = trajectory(order.seed, index, len(varied))
    return [{v.name: v.at(x) for v, x in zip(varied, point, strict=True)} for point in points.tolist()]


def _point_name(index: int, point: int) -> str:
    return f"trajectory_{index:04d}_{point:03d}"


def _tasks(order: Order, varied: Sequence[Varied]) -> dict[str, tuple]:
    """Every run by name: noise first, so that what comes early can be judged early."""
    tasks: dict[str, tuple] = {f"noise_{k:02d}": (order.asked, {}, order.seed + k) for k in range(REPEATS)}
    for index in range(order.trajectories):
        for point, values in enumerate(_values(order, varied, index)):
            tasks[_point_name(index, point)] = (order.asked, values, order.seed)
    return tasks


def _judged(
    order: Order,
    scenario: Scenario,
    varied: tuple[Varied, ...],
    left_out: tuple[LeftOut, ...],
    tasks: Mapping[str, tuple],
    interrupted: bool,
) -> Outcome:
    """What the runs that are there amount to; writes the numbers."""
    found: dict[str, Mapping[str, float | None]] = {}
    errors: dict[str, str] = {}
    for name in tasks:
        result = read_result(order.out / RUNS, name)
        if result is not None and "error" in result:
            errors[name] = result["error"]
        elif result is not None:
            found[name] = result["results"]
    method = method_of(order.asked, scenario)
    studies = [
        _study(name, unit, order, varied, found) for name, unit in result_units(scenario, method).items()
    ]
    told = tuple(study for study in studies if any(one.count for one in study.measures))
    outcome = Outcome(
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
    write_json(order.out / NUMBERS, plain(_content(outcome)))
    return outcome


def _study(
    name: str,
    unit: str,
    order: Order,
    varied: Sequence[Varied],
    found: Mapping[str, Mapping[str, float | None]],
) -> ResultStudy:
    """What the parameters do to one result."""

    def result(run: str) -> float:
        value = found.get(run, {}).get(name)
        return math.nan if value is None else value

    rows = []
    for index in range(order.trajectories):
        values = _values(order, varied, index)
        places = np.array([[v.place(at[v.name]) for v in varied] for at in values])
        results = np.array([result(_point_name(index, point)) for point in range(len(values))])
        rows.append(effects_of_trajectory(places, results))
    effects: Array = np.array(rows)
    draws = bootstrap(effects, _stream(order.seed, _BOOTSTRAP))
    repeats = [result(f"noise_{k:02d}") for k in range(REPEATS)]
    noise = noise_floor(repeats, order.trajectories, len(varied), _stream(order.seed, _NULL))
    floor = max(noise, RESOLUTION.get(unit, 0.0)) if math.isfinite(noise) else math.nan
    nominal = repeats[0] if math.isfinite(repeats[0]) else None
    return ResultStudy(name, unit, nominal, noise, floor, measures(effects, draws), draws)


def _stream(seed: int, what: int) -> int:
    return int(np.random.SeedSequence((seed, what)).generate_state(1)[0])


def _content(outcome: Outcome) -> dict[str, Any]:
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
