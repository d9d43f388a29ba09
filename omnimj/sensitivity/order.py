"""What a study is asked to do, and the folder that belongs to it."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import omnimj
from omnimj.control.robust.verdict import Thresholds
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import SOURCES
from omnimj.recording.folder import check_folder
from omnimj.scenario.digest import digest_of
from omnimj.scenario.methods import make_method
from omnimj.scenario.plants import make_plant
from omnimj.scenario.scenario import Scenario
from omnimj.sensitivity.driving import Asked, method_of, scenario_of
from omnimj.sensitivity.varied import CHOSEN, SHARE, LeftOut, Varied, varied_of
from omnimj.trials.results import read_result, write_json

PLAN, RUNS = "sensitivity_plan.json", "runs"


@dataclass(frozen=True)
class Order:
    """What is to be done."""

    out: Path
    asked: Asked
    trajectories: int = 10
    seed: int = 0
    """Of the sensors' noise and of the trajectories."""
    share: float = SHARE
    """Half-width of the ranges that no file states, relative to the value."""
    sources: tuple[str, ...] = (CHOSEN,)
    """Origins of the numbers that are varied."""
    workers: int = 1
    force: bool = False
    """Whether another study that is in the folder may be replaced."""


def check_order(order: Order) -> tuple[Scenario, tuple[Varied, ...], tuple[LeftOut, ...]]:
    """Whether it can be done: the scenario, what is varied in it, and what is not.

    Raises:
      InputError, UnknownNameError: As `study.run_study`.
    """
    for source in order.sources:
        if source not in SOURCES:
            raise UnknownNameError("--source", "source", source, SOURCES)
    scenario = scenario_of(order.asked)
    varied, left_out = varied_of(scenario, order.sources, order.share)
    if not varied:
        found = f"no number of {scenario.constants.file} or of the floors is {' or '.join(order.sources)}"
        raise InputError("--source", found, "there is nothing to vary", SOURCES)
    # what the plant or the method cannot do would break every run
    make_method(method_of(order.asked, scenario), scenario)
    make_plant(scenario, order.asked.plant, order.seed).close()
    return scenario, varied, left_out


def prepared(order: Order, scenario: Scenario, varied: Sequence[Varied]) -> Path:
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


def _plan(order: Order, scenario: Scenario, varied: Sequence[Varied]) -> dict[str, Any]:
    """What must be alike for a folder to be gone on with."""
    asked = {
        "scenario": scenario.name,
        "overrides": list(order.asked.overrides),
        "plant": order.asked.plant,
        "method": method_of(order.asked, scenario),
        "seed": order.seed,
        "sources": list(order.sources),
        "ranges": [dataclasses.asdict(one) for one in varied],
        # nominal numbers that are not varied act on every run, too
        "digest": digest_of(order.asked.scenario, scenario),
        "thresholds": dataclasses.asdict(Thresholds()),
        "version": omnimj.__version__,
    }
    return json.loads(json.dumps(asked))
