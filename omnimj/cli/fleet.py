"""One command over a folder of datasets, such as the logs of a fleet's night: one task per dataset.

A worker holds one dataset at a time. Each dataset gets a folder of its own below `--out` with the files of
the command, and an entry in `fleet.json`. After an interruption the same command continues with the datasets
that are missing.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from omnimj.cli.arguments import command_line, exit_code
from omnimj.cli.progress import run_on_executor
from omnimj.cli.terminal import format_study, print_study
from omnimj.errors import InputError
from omnimj.recording.dataset_file import DATASET_FILE
from omnimj.recording.json_files import write_json
from omnimj.studies.runner import StudyFolder, TrialFolder, run_study
from omnimj.studies.statistics import Table
from omnimj.studies.workers import Progress, WorkerPool

NUMBERS, SUMMARIES, PLAN = "fleet.json", "datasets", "plan.json"
_SETTINGS = ("method", "model", "floors", "thresholds", "gains")
Work = Callable[[argparse.Namespace], dict[str, Any]]
"""Runs the command on one dataset, writes its files, prints nothing and returns a summary."""


def is_fleet(folder: Path) -> bool:
    """Return whether a folder is not a dataset but holds datasets."""
    return folder.is_dir() and not (folder / DATASET_FILE).exists() and bool(_datasets(folder))


def _datasets(folder: Path) -> list[Path]:
    return sorted(file.parent for file in folder.glob(f"*/{DATASET_FILE}"))


@dataclass
class _Fleet:
    """Steps of a fleet for the study runner."""

    arguments: argparse.Namespace
    work_on: Work
    workers: int = field(init=False)
    datasets: list[Path] = field(init=False)

    def __post_init__(self) -> None:
        self.workers, self.datasets = self.arguments.workers, _datasets(self.arguments.dataset)
        self._results = TrialFolder(self.arguments.out / SUMMARIES)

    def prepare(self) -> None:
        given = vars(self.arguments)
        settings = {name: given[name] for name in _SETTINGS if name in given}
        if given.get("accept"):
            settings["accept"] = True
        plan = {"datasets": str(self.arguments.dataset.resolve()), "settings": settings}
        contents = (SUMMARIES, *(dataset.name for dataset in self.datasets))
        StudyFolder(self.arguments.out, PLAN, "a fleet", contents).claim(plan, self.arguments.force)

    def work(self, pool: WorkerPool, report: Progress) -> None:
        tasks = {}
        for dataset in self.datasets:
            if self._results.finished(dataset.name) is None:
                own = {"dataset": dataset, "out": self.arguments.out / dataset.name, "force": True}
                tasks[dataset.name] = (argparse.Namespace(**vars(self.arguments) | own | {"quiet": True}),)
        pool.run_all(self.work_on, tasks, self._results.write, "datasets", report)

    def judge(self, interrupted: bool) -> dict[str, Any]:
        names = [dataset.name for dataset in self.datasets]
        found, errors = self._results.collect(names)
        content = {"command": command_line(self.arguments), "interrupted": interrupted}
        content |= {"datasets": found, "failed": errors}
        write_json(self.arguments.out / NUMBERS, content)
        return content


def run_fleet(
    arguments: argparse.Namespace,
    work_on: Work,
    head: tuple[str, ...],
    row: Callable[[str, Mapping[str, Any]], tuple[str, ...]],
) -> int:
    """Run a command on every dataset of a folder; 1 if one failed."""
    home, there = arguments.dataset.resolve(), arguments.out.resolve()
    if there == home or home in there.parents:
        rule = "choose another one, datasets are not changed"
        raise InputError(f"--out {arguments.out}", "lies in the folder of the datasets", rule)
    content = run_on_executor(arguments, run_study, _Fleet(arguments, work_on))
    found, failed = content["datasets"], content["failed"]
    table = Table("", head, tuple(row(name, summary) for name, summary in found.items()))
    notes = [f"failed: {name}: {error}" for name, error in failed.items()]

    def text() -> str:
        return format_study((), (table,), notes, content["interrupted"], arguments.out).lstrip("\n")

    print_study(arguments.out, NUMBERS, text, arguments.json)
    return exit_code(content["interrupted"], len(failed))
