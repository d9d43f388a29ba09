"""Check of a dataset: consistency of its channels with each other, before any model is fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from omnimj.estimate.gap.check.columns import repeated_runs, unwrap_counter
from omnimj.estimate.gap.check.suspicions import DataCheck, Suspicion
from omnimj.estimate.gap.plants import Machine, find_plant
from omnimj.recording.dataset import Dataset, Run

_GROSS = np.log(3.0)  # |log| of a factor beyond that of any machine: a unit


def check_dataset(dataset: Dataset, machine: Machine | None = None) -> DataCheck:
    """Look for wrong signs, units, delays and biases, and for swapped, frozen, clipped and repeated channels.

    No friction is assumed: speeds are compared with integrated accelerations, angles with integrated rates,
    wheels with the body that they carry, currents with the motion that they cause.

    Args:
      dataset: The runs as read.
      machine: Gives wheel radius, gear and geometry; the shipped model when None.

    Raises:
      UnknownNameError: Unknown plant.
    """
    found: list[Suspicion] = []
    plant = find_plant(dataset.plant)
    suspicions = plant.suspicions(dataset, plant.read(None) if machine is None else machine)
    for s in sorted(suspicions, key=lambda s: (-s.strength, s.channel, s.kind)):
        if not any((s.channel, s.kind) == (other.channel, other.kind) for other in found):
            found.append(s)
    notes = [*repeated_runs(dataset.runs)]
    notes += [f"{'Sure' if s.is_sure else 'Maybe'}: {s.words}" for s in found]
    return DataCheck(tuple(notes), tuple(found))


def correct_dataset(dataset: Dataset, check: DataCheck) -> Dataset:
    """Correct errors that are gross and sure: a wrong unit, a counter that starts over.

    Signs, small factors, delays and biases are left unchanged, since they are candidates of the search.

    Returns:
      The dataset with a note on every change.
    """
    notes, runs = list(dataset.notes), dataset.runs
    for s in check.suspicions:
        if not any(s.channel in run.columns for run in runs):
            continue
        if s.kind == "wrap" and s.channel != "yaw":
            runs = tuple(_changed(r, s.channel, 1.0, True) for r in runs)
            notes.append(f"{s.channel}: the jumps of a counter that starts over were removed")
        elif s.kind == "scale" and s.is_sure and abs(np.log(abs(s.size))) > _GROSS:
            runs = tuple(_changed(r, s.channel, 1.0 / s.size, False) for r in runs)
            notes.append(f"{s.channel}: divided by {s.size:.6g}, it was in another unit ({s.words})")
    return replace(dataset, runs=runs, notes=tuple(notes))


def _changed(run: Run, name: str, factor: float, is_counter: bool) -> Run:
    if name not in run.columns:
        return run
    values = np.asarray(run.columns[name], float)
    values = unwrap_counter(values) if is_counter else values * factor
    return replace(run, columns={**run.columns, name: values})
