"""A method over all runs of a dataset, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from omnimj.control.method import Method
from omnimj.control.robust.gains import ObserverGains
from omnimj.control.robust.verdict import Thresholds
from omnimj.diagnosis.machines import Machine, method_of
from omnimj.diagnosis.replay import Replayed, replay, sample_run
from omnimj.diagnosis.sampling import require_rates
from omnimj.errors import InputError
from omnimj.parameters import Floor
from omnimj.recording.dataset import Dataset, Run

Progress = Callable[[int, int, str], None]
"""Called now and then with the work done, the work in all, and the run."""


@dataclass(frozen=True)
class Order:
    """What is to be done."""

    dataset: Dataset
    machine: Machine
    method: str
    floors: Mapping[str, Floor]
    thresholds: Thresholds | None = None
    """Of the robust method; the shipped ones when None."""
    observer: ObserverGains | None = None
    """Of the robust method; the shipped ones when None."""

    def method_for(self, run: Run) -> Method:
        """The method for one run.

        Raises:
          UnknownNameError: No such method.
          InputError: The method is not for this machine.
        """
        return method_of(self.method, self.machine, run, self.floors, self.thresholds, self.observer)


def check_order(order: Order) -> None:
    """Whether the runs can be diagnosed with the method; asked before anything is written.

    Raises:
      UnknownNameError: No such method.
      InputError: The method is not for this machine, or a run is sampled too slowly.
    """
    order.method_for(order.dataset.runs[0])
    require_rates(order.dataset)


def diagnose(order: Order, progress: Progress | None = None) -> Iterator[Replayed]:
    """What the method says of each run, run by run.

    Args:
      order: Checked by `check_order`.
      progress: For a progress bar.
    """
    runs = order.dataset.runs
    total, before = sum(len(run.time) for run in runs), 0
    for run in runs:
        samples = sample_run(run, order.machine)
        method = order.method_for(run)

        def report(done: int, name: str = run.name, rows: int = len(run.time), first: int = before) -> None:
            if progress is not None:
                progress(min(first + done, first + rows), total, name)

        report(0)
        yield replay(run, samples, order.machine, method, report)
        before += len(run.time)


def require_other_folder(dataset: Dataset, out: Path) -> None:
    """Nothing is written into a dataset's folder.

    Raises:
      InputError: `out` lies there, or is a dataset's folder itself.
    """
    home, there = dataset.path.resolve(), out.resolve()
    if there == home or home in there.parents or (out / "dataset.toml").exists():
        raise InputError(f"--out {out}", "is a dataset's folder", "choose another one, data stay as they are")
