"""Check of a dataset: consistency of its channels with each other, before any model is fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from omnimj.estimate.gap.check.columns import repeated_runs, unwrap_counter
from omnimj.estimate.gap.check.suspicions import DataCheck, Suspicion, importance
from omnimj.estimate.gap.check.time_base import corrected_time, has_period, time_base_suspicions
from omnimj.estimate.gap.plants import GapPlant, Machine, find_plant
from omnimj.recording.dataset import Dataset, Run


def check_dataset(dataset: Dataset, machine: Machine | None = None) -> DataCheck:
    """Look for a wrong time base, units, signs, delays and biases, and for stale, swapped or repeated values.

    No friction is assumed: speeds are compared with integrated accelerations, angles with integrated rates,
    wheels with the body that they carry, currents with the motion that they cause, and magnitudes with what
    the machine can do. Where time is wrong, the other channels are judged with the corrected time.

    Args:
      dataset: The runs as read.
      machine: Gives wheel radius, gear, geometry, limits and sampling rate; the shipped model when None.

    Returns:
      The suspicions, the most important first.

    Raises:
      UnknownNameError: Unknown plant.
    """
    plant = find_plant(dataset.plant)
    suspicions = _suspicions(dataset, plant, plant.read(None) if machine is None else machine)
    kept: list[Suspicion] = []
    for s in sorted(suspicions, key=importance):
        if not any(_covers(other, s) for other in kept):
            kept.append(s)
    notes = [*repeated_runs(dataset.runs)]
    notes += [f"{'Sure' if s.is_certain else 'Likely'}: {s.words}" for s in kept]
    return DataCheck(tuple(notes), tuple(kept))


def _suspicions(dataset: Dataset, plant: GapPlant, machine: Machine) -> list[Suspicion]:
    """Suspicions of time, and those of the channels once time is right."""
    rate = plant.sample_rate(dataset, machine)
    found = None
    if has_period(dataset.runs, rate):
        found = list(plant.suspicions(dataset, machine))
        if not any(s.kind == "unit" for s in found):
            return found  # a wrong time spoils every rate as a wrong unit does
    late = list(time_base_suspicions(dataset.runs, rate, lambda runs: plant.time_links(runs, machine)))
    if found is not None and not late:
        return found
    timely = _with_corrected_time(dataset, late)
    runs = tuple(run for run in timely.runs if float(np.diff(run.time).min()) > 0.0)
    return [*late, *(plant.suspicions(replace(timely, runs=runs), machine) if runs else ())]


def _covers(other: Suspicion, s: Suspicion) -> bool:
    """True if one suspicion implies the other."""
    if other.kind == "unit" and s.kind in ("unit", "scale", "magnitude"):
        is_same = s.channel == other.channel or s.channel.startswith(f"{other.channel}_")
        return is_same or (other.is_sure and other.channel in s.or_channels)
    return (other.channel, other.kind, other.runs) == (s.channel, s.kind, s.runs)


def correct_dataset(dataset: Dataset, check: DataCheck) -> Dataset:
    """Correct errors that are gross and sure: a wrong time base or unit, a counter that starts over.

    Signs, small factors, delays and biases are left unchanged, since they are candidates of the search.

    Returns:
      The dataset with a note on every change.
    """
    notes, runs = list(dataset.notes), _with_corrected_time(dataset, check.suspicions).runs
    for s in check.suspicions:
        if not any(key.startswith(s.channel) for run in runs for key in run.columns):
            continue
        if s.kind == "time_base" and s.is_sure:
            notes.append(f"time: divided by {s.size:.6g} ({s.words})")
        if s.kind == "wrap" and s.channel != "yaw":
            runs = tuple(_changed(r, s.channel, 1.0, True) for r in runs)
            notes.append(f"{s.channel}: the jumps of a counter that starts over were removed")
        elif s.kind == "unit" and s.is_sure:
            runs = tuple(_changed(r, s.channel, 1.0 / s.size, False) for r in runs)
            notes.append(f"{s.channel}: divided by {s.size:.6g}, it was in another unit ({s.words})")
    return replace(dataset, runs=runs, notes=tuple(notes))


def _with_corrected_time(dataset: Dataset, found: list[Suspicion] | tuple[Suspicion, ...]) -> Dataset:
    for s in found:
        if s.kind == "time_base" and s.is_sure:
            dataset = replace(dataset, runs=corrected_time(dataset.runs, s))
    return dataset


def _changed(run: Run, name: str, factor: float, is_counter: bool) -> Run:
    """Change a channel, or all channels of a name with numbers: `wheel_speed` for `wheel_speed_1` and on."""
    columns = dict(run.columns)
    for key, values in run.columns.items():
        if key == name or (key.startswith(f"{name}_") and key.removeprefix(f"{name}_").isdigit()):
            columns[key] = unwrap_counter(np.asarray(values, float)) if is_counter else values * factor
    return replace(run, columns=columns)
