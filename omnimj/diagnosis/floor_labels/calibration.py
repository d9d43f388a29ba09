"""Noise of the currents and price of a crossing, from runs on one floor each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.diagnosis.floor_labels.currents import FloorPlan, expected_currents, steady_windows
from omnimj.diagnosis.floor_labels.labelling import CurrentNoise, Evidence, label_path, neighbours
from omnimj.errors import InputError, UnknownNameError
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array

MARGIN = 1.5
"""Price of a crossing over the largest that a run on one floor needs to show none."""
FEWEST_RUNS = 4
"""Fewest runs for a calibration."""
_LEAST = math.log(100.0)  # price without any evidence against one floor: prior odds 1 : 100 per window
_HIGHEST = 1e4  # where no price keeps a run on its floor
_ROUNDS = 40
_FEWEST_WINDOWS = 5
_LEAST_NOISE = 0.005  # [A] of perfect data


@dataclass(frozen=True)
class LabelCalibration:
    """Noise and price for `labelling`, and where they come from."""

    noise: CurrentNoise
    price: float
    """β, log-likelihood that a change of one wheel's floor must gain."""
    needed: float
    """Smallest price at which no calibration run shows a change."""
    hardest: str
    """Run that needs it."""
    runs: int
    """Number of runs."""


@dataclass(frozen=True)
class _FloorRun:
    name: str
    measured: Array
    expected: Array
    own: int
    """Index of the assignment with all wheels on the run's floor."""

    @property
    def rest(self) -> Array:
        """Measured less expected currents, shape (w, n)."""
        return self.measured - self.expected[self.own]


def calibrate_labels(plan: FloorPlan, datasets: Sequence[Dataset]) -> LabelCalibration:
    """Estimate noise and price from runs on one floor each.

    White noise is that of differences between successive windows; the bias is what the means of the runs
    have beyond it. The price is `MARGIN` times the smallest one at which no run shows a change.

    Raises:
      InputError: Too few runs drive steadily, or a run does not fit its floor at any price.
      UnknownNameError: A run's floor is none of the plan's.
    """
    place = ", ".join(str(dataset.path) for dataset in datasets)
    found = [_prepared(plan, dataset, run) for dataset in datasets for run in dataset.runs]
    runs = [run for run in found if len(run.measured) >= _FEWEST_WINDOWS]
    if len(runs) < FEWEST_RUNS:
        rule = f"at least {FEWEST_RUNS} runs with a few seconds of steady driving are needed"
        raise InputError(place, f"{len(runs)} runs of steady driving", rule)
    noise = _noise([run.rest for run in runs])
    prices = [_needed_price(plan, run, noise) for run in runs]
    k = int(np.argmax(prices))
    if prices[k] >= _HIGHEST:
        rule = "the model and the floors must fit the runs on one floor: identify them first"
        raise InputError(f"{place}: run {runs[k].name!r}", "its currents fit other floors better", rule)
    needed = float(prices[k])
    return LabelCalibration(noise, max(MARGIN * needed, _LEAST), needed, runs[k].name, len(runs))


def run_floor(plan: FloorPlan, dataset: Dataset, run: Run) -> str:
    """Name of a run's floor, one of the plan's.

    Raises:
      UnknownNameError: It is none of them.
    """
    name, names = run.conditions.get("floor"), [floor.name for floor in plan.floors]
    if name not in names:
        raise UnknownNameError(f"{dataset.path}: run {run.name!r}: floor", "floor label", name, names)
    return str(name)


def _prepared(plan: FloorPlan, dataset: Dataset, run: Run) -> _FloorRun:
    own = plan.all_on(run_floor(plan, dataset, run))
    windows = steady_windows(run, plan.robot.wheel.radius, plan.robot.wheel_count)
    return _FloorRun(run.name, windows.current, expected_currents(plan, windows.wheel_speed), own)


def _noise(rests: Sequence[Array]) -> CurrentNoise:
    steps = np.concatenate([np.diff(rest, axis=0).ravel() for rest in rests])
    white = math.sqrt(0.5 * float(np.nanmean(steps**2)))
    squares = []
    for rest in rests:
        many = np.isfinite(rest).sum(axis=0)
        means = np.nanmean(rest[:, many > 0], axis=0)
        squares.extend((means**2 - white**2 / many[many > 0]).tolist())
    bias = math.sqrt(max(float(np.mean(squares)), 0.0))
    return CurrentNoise(max(white, _LEAST_NOISE), max(bias, _LEAST_NOISE))


def _needed_price(plan: FloorPlan, run: _FloorRun, noise: CurrentNoise) -> float:
    """Smallest price at which a run shows no change of floor, by bisection; `_HIGHEST` if there is none."""
    evidence, one_wheel = Evidence(run.measured, run.expected, noise), neighbours(plan.assignments)
    low, high = 0.0, 1.0
    while label_path(evidence, one_wheel, run.own, high).changes:
        low, high = high, 2.0 * high
        if high > _HIGHEST:
            return _HIGHEST
    for _ in range(_ROUNDS):
        middle = 0.5 * (low + high)
        if label_path(evidence, one_wheel, run.own, middle).changes:
            low = middle
        else:
            high = middle
        if high - low < 0.01 * high:
            break
    return high
