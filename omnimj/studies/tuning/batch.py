"""Drives candidates over draws, and keeps every trial: what was driven once is never driven again.

The folder:
  tuning_plan.json               what was asked
  uses_NAME.json                 when wheels are in use in a draw
  trial_NAME_HASH.json           a draw driven with a candidate, named after its gains
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.errors import InputError, SimulationError
from omnimj.recording.json_files import read_result, result_writer, to_jsonable, write_json
from omnimj.studies.tuning.draws import Draw
from omnimj.studies.tuning.search import Candidate, GainAxis, values_by_name
from omnimj.studies.tuning.trial import TrialMetrics, drive_healthy, drive_trial, read_metrics
from omnimj.studies.workers import Progress, WorkerPool

PLAN = "tuning_plan.json"


class TrialBatch:
    """Those who drive, and the folder of what they found.

    Args:
      folder: From `prepare_folder`.
      axes: What a candidate's values are of.
      before: Gains before the search, by their names, where they are not those of the model.
      thresholds: Of the method; the shipped ones when None.
      workers: Who drives.
      report: Called with a phrase and the share that is done of what is under way.
    """

    def __init__(
        self,
        folder: Path,
        axes: Sequence[GainAxis],
        before: Mapping[str, float],
        thresholds: Thresholds | None,
        workers: WorkerPool,
        report: Progress,
    ):
        self._folder, self._axes, self._before = folder, tuple(axes), dict(before)
        self._thresholds, self._workers, self._report = thresholds, workers, report
        self._uses: dict[str, Any] = {}

    def drive(
        self, candidates: Sequence[Candidate], draws: Sequence[Draw], phrase: str
    ) -> list[tuple[TrialMetrics, ...]]:
        """Facts of every candidate, one per draw.

        Raises:
          SimulationError: A trial broke down in a way that no gains can be blamed for, or a worker died.
          InputError: A trial is there with another truth.
        """
        self._find_uses(draws)
        tasks = {
            _name(draw, values): (draw, values)
            for values in map(self._values, dict.fromkeys(candidates))
            for draw in draws
        }
        ready = {
            name: (*given, self._uses.get(given[0].name), self._thresholds) for name, given in tasks.items()
        }
        found = self._done(drive_trial, ready, phrase)
        return [
            tuple(read_metrics(found[_name(draw, self._values(one))]) for draw in draws) for one in candidates
        ]

    def _values(self, candidate: Candidate) -> Mapping[str, float]:
        """All gains that are not the model's, by their names."""
        return {**self._before, **values_by_name(self._axes, candidate)}

    def _find_uses(self, draws: Sequence[Draw]) -> None:
        tasks = {
            f"uses_{draw.name}": (draw, self._before)
            for draw in draws
            if draw.is_broken and draw.name not in self._uses
        }
        for result in self._done(drive_healthy, tasks, "driving without faults").items():
            self._uses[result[0].removeprefix("uses_")] = result[1]["uses"]

    def _done(
        self, function: Callable[..., Any], tasks: Mapping[str, tuple], phrase: str
    ) -> dict[str, dict[str, Any]]:
        """Results of all tasks by name, those that are kept from before and those that were missing."""
        found = {name: _stored_result(self._folder, name, given[0]) for name, given in tasks.items()}
        missing = {name: tasks[name] for name, result in found.items() if result is None}
        if missing:
            self._workers.run_all(function, missing, result_writer(self._folder), phrase, self._report)
            found |= {name: read_result(self._folder, name) for name in missing}
        broken = {name: found[name] for name in missing if "error" in (found[name] or {"error": "vanished"})}
        if broken:
            name, result = next(iter(broken.items()))
            told = "its file vanished" if result is None else result["error"]
            raise SimulationError(f"{len(broken)} of {len(tasks)} trials broke down; {name}: {told}")
        return {name: result for name, result in found.items() if result is not None}


def _name(draw: Draw, values: Mapping[str, float]) -> str:
    text = json.dumps(dict(values), sort_keys=True)
    return f"trial_{draw.name}_{hashlib.sha256(text.encode()).hexdigest()[:16]}"


def _stored_result(folder: Path, name: str, draw: Draw) -> dict[str, Any] | None:
    """The result that is there; None where it is missing or says what broke.

    Raises:
      InputError: It is there with another truth.
    """
    result = read_result(folder, name)
    if result is None or "error" in result:
        return None
    if result["draw"] != to_jsonable(draw.to_dict()):
        rule = "the library has changed since; --force begins anew"
        raise InputError(f"{folder / name}.json", "holds another trial than this seed draws", rule)
    return result


def prepare_folder(folder: Path, plan: Mapping[str, Any], force: bool) -> Path:
    """The folder of the trials; what it holds belongs to this plan.

    Raises:
      InputError: It holds the trials of another plan and `force` is not given, or it cannot be written.
    """
    file = folder / PLAN
    asked = to_jsonable(json.loads(json.dumps(plan)))
    if read_result(folder, file.stem) == asked:
        return folder
    if folder.exists() and not folder.is_dir():
        raise InputError(
            folder, "is a file", "the trials are kept in a folder of this name; choose another --out"
        )
    if folder.exists() and any(folder.iterdir()) and not (force and file.is_file()):
        rule = f"{PLAN} there says which; choose another --out" + (
            ", or --force to replace it" if file.is_file() else ""
        )
        raise InputError(folder, "holds something else than trials with these settings", rule)
    try:
        for pattern in ("trial_*.json", "uses_*.json"):  # of another plan; what else is there stays
            for old in folder.glob(pattern):
                old.unlink()
        folder.mkdir(parents=True, exist_ok=True)
        write_json(file, asked)
    except OSError as error:
        raise InputError(folder, f"cannot be written ({error.strerror})") from None
    return folder
