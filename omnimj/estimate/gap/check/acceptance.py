"""Data that are held back: certain faults of the recording that would spoil every result.

What holds a dataset back, unless it is accepted:

- `time_base`, `unit` and `sign`, if certain: no machine explains them, and no effect of typical size does
- `magnitude`, if ten times what the machine can do: such values are none of its own
- `delay`, if certain and longer than `longest_delay`: the effect `sensor_delay` is a finding of the search up
  to twice its typical size, and a delay beyond that is a fault of the logger

Everything else is reported and goes on. A diagnosis looks for faults of the machine, so that there only a
time base, a unit or a sign that is wrong from the first sample to the last one holds the data back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from omnimj.effects import effects_of
from omnimj.errors import DataFaultError
from omnimj.estimate.gap.check.columns import repeated_runs, unwrap_counter
from omnimj.estimate.gap.check.magnitudes import FAR_BEYOND
from omnimj.estimate.gap.check.suspicions import DataCheck, Suspicion, importance
from omnimj.estimate.gap.check.time_base import corrected_time, has_period, time_base_suspicions
from omnimj.estimate.gap.plants import GapPlant, Machine, find_plant
from omnimj.recording.dataset import Dataset, Run

_TYPICAL_DELAYS = 2.25
"""Typical delays up to which a delay is a finding: twice, as in the benchmark, and its estimate's error."""
_WHOLE_LOG = ("time_base", "unit", "sign")
_MOST_SAMPLES = 400_000  # of the runs that a diagnosis checks: some 7 minutes at 1000 per second …
_LEAST_SAMPLES = 10_000  # … and of each of them
_RULE = "correct the files, state a scale under [columns] of dataset.toml, or give --accept"


def longest_delay(plant: str) -> float:
    """Longest delay of a channel that is a finding rather than a fault of the data [s]."""
    (typical,) = effects_of(plant)["sensor_delay"].typical().values()
    return _TYPICAL_DELAYS * typical


def holding_back(check: DataCheck, plant: str) -> tuple[Suspicion, ...]:
    """Suspicions for which a dataset is held back, the most important first."""
    return tuple(
        s
        for s in check.suspicions
        if s.is_certain
        and (
            s.kind in _WHOLE_LOG
            or (s.kind == "magnitude" and s.size > FAR_BEYOND)
            or (s.kind == "delay" and s.size > longest_delay(plant))
        )
    )


def sound_dataset(
    dataset: Dataset, machine: Machine | None, accept: bool = False
) -> tuple[Dataset, DataCheck]:
    """Check a dataset, hold it back or correct it, and add the findings to its notes.

    Args:
      machine: The machine; the shipped one when None.
      accept: Whether to go on with data that have certain faults: then gross units, time bases and counters
        are corrected.

    Returns:
      The dataset to use, with notes on the findings and on what was corrected, and its check.

    Raises:
      DataFaultError: The data have certain faults and are not accepted.
    """
    return _held_back_or_corrected(dataset, check_dataset(dataset, machine), accept)


def sound_logs(dataset: Dataset, machine: Machine, accept: bool = False) -> tuple[Dataset, DataCheck]:
    """Like `sound_dataset`, for logs of a machine that may be faulty: what is wrong throughout counts."""
    return _held_back_or_corrected(dataset, _check_whole_logs(dataset, machine), accept)


def _held_back_or_corrected(dataset: Dataset, check: DataCheck, accept: bool) -> tuple[Dataset, DataCheck]:
    faults = holding_back(check, dataset.plant)
    if faults and not accept:
        raise DataFaultError(dataset.path, [f"{_title(s)}: {s.words}" for s in faults], _RULE)
    corrected = correct_dataset(dataset, check)
    return replace(corrected, notes=(*check.notes, *corrected.notes)), check


def _check_whole_logs(dataset: Dataset, machine: Machine) -> DataCheck:
    """Check a sample of the logs, and confirm every fault in both halves of them.

    A fault of the machine that begins during a run leaves its first part alone.
    """
    runs = _sampled(dataset.runs)
    found = [
        s
        for s in check_dataset(replace(dataset, runs=runs), machine).suspicions
        if s.kind in _WHOLE_LOG and s.is_certain
    ]
    for half in (0, 1) if any(s.kind != "time_base" for s in found) else ():
        part = check_dataset(replace(dataset, runs=tuple(_half(run, half) for run in runs)), machine)
        seen = {(s.channel, s.kind) for s in part.suspicions}
        found = [s for s in found if s.kind == "time_base" or (s.channel, s.kind) in seen]
    return DataCheck(tuple(f"Sure: {s.words}" for s in found), tuple(found))


def _sampled(runs: Sequence[Run]) -> tuple[Run, ...]:
    """Runs over the whole dataset, of each its beginning, with a limited number of samples."""
    count = max(1, min(len(runs), _MOST_SAMPLES // _LEAST_SAMPLES))
    chosen = [runs[k * len(runs) // count] for k in range(count)]
    return tuple(_rows(run, slice(0, _MOST_SAMPLES // count)) for run in chosen)


def _half(run: Run, half: int) -> Run:
    middle = len(run.time) // 2
    return _rows(run, slice(middle, None) if half else slice(0, middle))


def _rows(run: Run, rows: slice) -> Run:
    columns = {name: np.asarray(values)[rows] for name, values in run.columns.items()}
    return replace(run, columns=columns, masked={name: mask[rows] for name, mask in run.masked.items()})


def _title(found: Suspicion) -> str:
    return found.kind.replace("_", " ")


def fault_records(check: DataCheck) -> list[dict[str, Any]]:
    """Suspicions as JSON-compatible values, the most important first."""
    return [
        {
            "channel": s.channel,
            "kind": s.kind,
            "size": float(s.size),
            "sure": s.is_certain,
            "words": s.words,
            "or_channels": list(s.or_channels),
            "runs": list(s.runs),
        }
        for s in check.suspicions
    ]


def check_dataset(dataset: Dataset, machine: Machine | None = None) -> DataCheck:
    """Look for a wrong time base, units, signs, delays and biases, and for stale, swapped or repeated values.

    No friction is assumed: speeds are compared with integrated accelerations, angles with integrated rates,
    wheels with the body that they carry, currents with the motion that they cause, and magnitudes with what
    the machine can do. Where time is wrong, the other channels are judged with the corrected time.

    Args:
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
            notes.append(f"{s.channel}: the jumps of a counter that wraps around were removed")
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
