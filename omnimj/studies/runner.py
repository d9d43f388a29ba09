"""Study runner: claim a folder for a plan, run the missing trials on an executor, evaluate the results.

A study is a folder with its plan in one JSON file and the result of every trial in another. Results are
written as they arrive, so that an interrupted study continues where it stopped, and one with more trials adds
to those that are finished.
"""

from __future__ import annotations

import functools
import json
import shutil
import traceback
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ParamSpec, Protocol, TypeVar

from omnimj.errors import InputError, write_failure
from omnimj.recording.folder import check_folder
from omnimj.recording.json_files import to_jsonable, write_json
from omnimj.studies.workers import Progress, WorkerPool, run_in_workers

Result_co = TypeVar("Result_co", covariant=True)
Given = ParamSpec("Given")


class Study(Protocol[Result_co]):
    """Steps that differ between studies; `run_study` calls them in this order."""

    @property
    def workers(self) -> int:
        """Number of processes when no executor is given."""
        ...

    def prepare(self) -> None:
        """Check the configuration and claim the folder, before any work is done."""

    def work(self, pool: WorkerPool, report: Progress) -> None:
        """Run the missing trials; what is finished before an interruption stays on disk."""

    def judge(self, interrupted: bool) -> Result_co:
        """Evaluate the stored results and write the study's files."""
        ...


def run_study(study: Study[Result_co], report: Progress, executor: Executor | None = None) -> Result_co:
    """Prepare a study, run its missing trials and evaluate the results.

    Args:
      study: The study.
      report: Called with a phrase and the finished share, 0 … 1; may raise KeyboardInterrupt.
      executor: Runs the trials and stays open; own worker processes when None.

    Returns:
      The study's result, also after Ctrl-C.

    Raises:
      InputError: The configuration breaks a rule, or the folder belongs to something else.
      OutputError: A file cannot be written; finished results are kept.
      SimulationError: A worker died; finished results are kept.
    """
    study.prepare()
    finished = run_in_workers(lambda pool: study.work(pool, report), study.workers, executor)
    return study.judge(not finished)


@dataclass(frozen=True)
class StudyFolder:
    """Folder of a study; it holds the results of one plan at a time."""

    path: Path
    plan_file: str
    noun: str
    """Kind of study with its article, for messages: `an evaluation`."""
    contents: tuple[str, ...]
    """Glob patterns of everything that another plan replaces."""
    can_replace: bool = True
    """True if the command has `--force` to replace another plan's results."""

    def claim(self, plan: Mapping[str, Any], force: bool = False) -> bool:
        """Make the folder hold this plan.

        Args:
          plan: All settings that results depend on; an equal plan continues with the stored results.
          force: Replace the results of another plan.

        Returns:
          True if the folder held this plan already.

        Raises:
          InputError: The folder holds another plan or something else.
          OutputError: The folder cannot be written.
        """
        wanted, file = json.loads(json.dumps(to_jsonable(plan))), self.path / self.plan_file
        if file.is_file():
            if read_json(file) == wanted:
                return True
            if not force:
                rule = f"{self.plan_file} there states which; choose another folder"
                rule += ", or --force to replace it" if self.can_replace else ""
                raise InputError(f"--out {self.path}", f"holds {self.noun} with other settings", rule)
        check_folder(self.path, force)
        try:
            if file.is_file():  # only a study's own results are deleted
                self._delete_contents()
            self.path.mkdir(parents=True, exist_ok=True)
            write_json(file, wanted)
        except OSError as error:
            raise write_failure(f"--out {self.path}", error) from None
        return False

    def _delete_contents(self) -> None:
        for pattern in self.contents:
            for old in self.path.glob(pattern):
                if old.is_dir():
                    shutil.rmtree(old, ignore_errors=True)
                else:
                    old.unlink()


@dataclass(frozen=True)
class TrialFolder:
    """Folder of trial results, one JSON file per trial; that of a trial that failed has only `error`."""

    path: Path

    def read(self, name: str) -> dict[str, Any] | None:
        """Return the result of a trial; None if it is missing or unreadable."""
        return read_json(self.path / f"{name}.json")

    def write(self, name: str, result: Mapping[str, Any] | None) -> None:
        """Store a result, in full or not at all; None stores nothing."""
        if result is not None:
            self.path.mkdir(parents=True, exist_ok=True)
            write_json(self.path / f"{name}.json", result)

    def finished(self, name: str, **truth: Any) -> dict[str, Any] | None:
        """Return the result of a completed trial; None if it is missing or failed.

        Args:
          name: Name of the trial.
          truth: Entries that the result must have for the trial to be the same.

        Raises:
          InputError: An entry differs.
        """
        result = self.read(name)
        if result is None or "error" in result:
            return None
        for key, value in truth.items():
            if result[key] != to_jsonable(value):
                rule = "the library has changed since; choose another --out"
                found = f"holds another {key} than this seed draws"
                raise InputError(self.path / f"{name}.json", found, rule)
        return result

    def collect(self, names: Iterable[str]) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
        """Return the results of finished trials, and the errors of those that failed, by name."""
        found = {name: result for name in names if (result := self.read(name)) is not None}
        errors = {name: str(result["error"]) for name, result in found.items() if "error" in result}
        return {name: result for name, result in found.items() if name not in errors}, errors


def read_json(path: Path) -> dict[str, Any] | None:
    """Return the content of a JSON file; None if it is missing or unreadable."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return None


def guarded(trial: Callable[Given, Mapping[str, Any]]) -> Callable[Given, dict[str, Any]]:
    """Make a trial return its result as JSON types; an exception becomes `{"error": …}` with its place.

    Everything is caught, programming errors too: trials draw unseen machines at random, and a
    study of hours must keep the others, each failure counted and reported with its kind.
    """

    @functools.wraps(trial)
    def run(*arguments: Given.args, **options: Given.kwargs) -> dict[str, Any]:
        try:
            return to_jsonable(trial(*arguments, **options))
        except Exception as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            place = f"{Path(last.filename).name}:{last.lineno}"
            return {"error": f"{type(error).__name__}: {error} ({place})"}

    return run
