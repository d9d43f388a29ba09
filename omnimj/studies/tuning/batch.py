"""Trials of a tuning study: candidates driven over draws, each trial stored and run only once.

The folder:
  tuning_plan.json               settings
  uses_NAME.json                 intervals of a draw in which wheels are in use
  trial_NAME_HASH.json           a draw driven with a candidate; the hash is that of its gains
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.errors import InputError, SimulationError
from omnimj.studies.runner import StudyFolder, TrialFolder
from omnimj.studies.tuning.draws import Draw
from omnimj.studies.tuning.search import Candidate, GainAxis, values_by_name
from omnimj.studies.tuning.trial import TrialMetrics, drive_healthy, drive_trial, read_metrics
from omnimj.studies.workers import Progress, WorkerPool

PLAN = "tuning_plan.json"


class TrialBatch:
    """Batch of trials: candidates driven over draws."""

    def __init__(
        self,
        folder: Path,
        axes: Sequence[GainAxis],
        before: Mapping[str, float],
        thresholds: Thresholds | None,
        pool: WorkerPool,
        report: Progress,
    ):
        self._trials, self._axes, self._before = TrialFolder(folder), tuple(axes), dict(before)
        self._thresholds, self._pool, self._report = thresholds, pool, report
        self._uses: dict[str, Any] = {}

    def drive(self, candidates: Sequence[Candidate], draws: Sequence[Draw]) -> list[tuple[TrialMetrics, ...]]:
        """Return the metrics of every candidate, one per draw.

        Raises:
          SimulationError: A trial failed for a reason other than its gains, or a worker died.
          InputError: A stored trial has another truth.
        """
        self._find_uses(draws)
        gains = {one: {**self._before, **values_by_name(self._axes, one)} for one in candidates}
        tasks = {
            _name(draw, values): (draw, values, self._uses.get(draw.name), self._thresholds)
            for values in gains.values()
            for draw in draws
        }
        found = self._complete(drive_trial, tasks, "trials")
        return [tuple(read_metrics(found[_name(draw, gains[one])]) for draw in draws) for one in candidates]

    def _find_uses(self, draws: Sequence[Draw]) -> None:
        """Find the intervals of use of all draws with a fault."""
        tasks = {
            f"uses_{draw.name}": (draw, self._before)
            for draw in draws
            if draw.is_broken and draw.name not in self._uses
        }
        for name, result in self._complete(drive_healthy, tasks, "driving without faults").items():
            self._uses[name.removeprefix("uses_")] = result["uses"]

    def _complete(
        self, function: Callable[..., Any], tasks: Mapping[str, tuple], phrase: str
    ) -> dict[str, dict[str, Any]]:
        """Return the results of all tasks by name, after running those that are missing."""
        stored = {name: self._trials.finished(name, draw=task[0].to_dict()) for name, task in tasks.items()}
        missing = {name: tasks[name] for name, result in stored.items() if result is None}
        if missing:
            self._pool.run_all(function, missing, self._trials.write, phrase, self._report)
        found, errors = self._trials.collect(missing)
        errors |= {name: "its file vanished" for name in missing if name not in found and name not in errors}
        if errors:
            name, error = next(iter(errors.items()))
            raise SimulationError(f"{len(errors)} of {len(tasks)} trials failed; {name}: {error}")
        return {name: found[name] if result is None else result for name, result in stored.items()}


def _name(draw: Draw, values: Mapping[str, float]) -> str:
    text = json.dumps(dict(values), sort_keys=True)
    return f"trial_{draw.name}_{hashlib.sha256(text.encode()).hexdigest()[:16]}"


def claim_folder(folder: Path, plan: Mapping[str, Any], force: bool) -> None:
    """Make the folder hold the trials of this plan.

    Raises:
      InputError: It holds trials of another plan and `force` is not given, or something else; or it cannot be
        written.
    """
    if folder.is_dir() and any(folder.iterdir()) and not (folder / PLAN).is_file():
        rule = "trials are stored in a folder of this name; choose another --out"
        raise InputError(folder, "holds files other than the trials of a tuning", rule)
    StudyFolder(folder, PLAN, "a tuning", ("trial_*.json", "uses_*.json")).claim(plan, force)
