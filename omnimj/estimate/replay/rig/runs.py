"""All rig runs of a dataset together: inputs, block means, regimes and candidate experiments."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.estimate.replay.base_parameters import floor_name
from omnimj.estimate.replay.interface import Experiment, Segment, average_blocks
from omnimj.estimate.rig_runs import CURRENT, WHEEL, rig_run
from omnimj.parameters import Floor, Rig
from omnimj.recording.dataset import Dataset
from omnimj.signals import Array

_SHORTEST = 0.02  # [s] of a block
_MOST_BLOCKS = 6000
_NEIGHBOURS = 10  # samples on either side over which the current is averaged
_STANDING = 0.01  # [m/s]
_SECONDS = 2.0
_PROFILES = {
    "constant": "constant current",
    "reversing": "current to and fro, 0.5 s each way",
    "pulse": "0.7 s of current, then coasting at 0 A",
    "crawl": "current rising slowly from 0",
}


@dataclass(frozen=True)
class RigRuns:
    """All runs concatenated, resampled to the period of the sensors."""

    period: float
    first: NDArray[np.int_]
    """First sample of every run and the end of the last, shape (runs + 1,)."""
    blocks_first: NDArray[np.int_]
    """First block of every run and the end of the last, shape (runs + 1,)."""
    size: int
    """Samples per block."""
    current: Array
    """Measured motor current, denoised, shape (samples,) [A]."""
    target: Array | None
    """Current set value where it was recorded, shape (samples,) [A]."""
    lateral: Array
    """Speed of the gantry, shape (samples,) [m/s]."""
    turned: Array
    """Measured speed of the wheel [rad/s] and its integral since the start of the run [rad], shape
    (samples, 2); none, shape (0, 2), for a run that was not measured."""
    start: Array
    """Carriage [m/s] and wheel speed [rad/s] at the start, shape (runs, 2)."""
    mass: Array
    """Declared mass of each run, shape (runs,) [kg]."""
    floor: tuple[str, ...]
    """Floor of each run."""
    measured: Array
    """Block means of `rig_runs.CHANNELS`, of the current only where its set value was recorded, shape
    (blocks, channels)."""
    segments: tuple[Segment, ...]


def rig_runs(dataset: Dataset, rig: Rig, floors: dict[str, Floor]) -> RigRuns:
    """Resample the runs and take block means.

    Raises:
      InputError: A run without floor.
      UnknownNameError: Unknown floor.
    """
    names = tuple(floor_name(dataset, run, floors) for run in dataset.runs)
    period = 1.0 / rig.sensors.sample_rate
    runs = [rig_run(run, period) for run in dataset.runs]
    total = sum(len(run.time) - 1 for run in runs)
    size = max(round(_SHORTEST / period), int(np.ceil(total / _MOST_BLOCKS)))
    targets = [run.target for run in runs if run.target is not None]
    has_target = len(targets) == len(runs)
    first = np.cumsum([0, *(len(run.time) for run in runs)])
    blocks_first = np.cumsum([0, *(len(run.time) // size for run in runs)])
    return RigRuns(
        period,
        first,
        blocks_first,
        size,
        np.concatenate([denoise_current(run.values[:, CURRENT]) for run in runs]),
        np.concatenate(targets) if has_target else None,
        np.concatenate([run.gantry_speed for run in runs]),
        np.concatenate([_turned(run.values[:, WHEEL], period) for run in runs]),
        np.array([run.start_speeds for run in runs]),
        np.array([run.mass for run in runs]),
        names,
        np.concatenate([average_blocks(run.readings, size) for run in runs])[:, : 4 if has_target else 3],
        tuple(
            Segment(run.name, run.condition, a, b, average_blocks(run.time, size))
            for run, (a, b) in zip(runs, itertools.pairwise(blocks_first.tolist()), strict=True)
        ),
    )


def _turned(speed: Array, period: float) -> Array:
    """Speed and its integral by the trapezoidal rule, shape (samples, 2)."""
    angle = np.concatenate([[0.0], np.cumsum(0.5 * period * (speed[1:] + speed[:-1]))])
    return np.stack([speed, angle], axis=1)


def denoise_current(current: Array) -> Array:
    """Remove the noise of a current, shape (samples,), but keep steps: means of neighbours within 4 σ.

    The input of the replay must not be noisy: near standstill friction rectifies noise, and a noisy current
    breaks away where the true one sticks.
    """
    sigma = float(np.median(np.abs(np.diff(current)))) / 0.6745 / np.sqrt(2.0)
    if sigma == 0.0:
        return current
    total, count = current.copy(), np.ones(len(current))
    for shift in range(1, _NEIGHBOURS + 1):
        near = np.abs(current[shift:] - current[:-shift]) < 4.0 * np.sqrt(2.0) * sigma
        total[shift:] += np.where(near, current[:-shift], 0.0)
        total[:-shift] += np.where(near, current[shift:], 0.0)
        count[shift:] += near
        count[:-shift] += near
    return total / count


def travelled(runs: RigRuns) -> Array:
    """Path along the rail from the measured speed, from 0 at each run's start, shape (blocks,) [m]."""
    parts = []
    for p in runs.segments:
        speed = np.nan_to_num(runs.measured[p.first : p.last, 1])
        parts.append(np.cumsum(speed) * runs.size * runs.period)
    return np.concatenate(parts)


def variable_spans(runs: RigRuns) -> dict[str, tuple[float, float]]:
    """Range of each regime variable: variable → lowest and highest value."""
    speed, position = runs.measured[:, 1], travelled(runs)
    ends = {
        "speed": (float(np.nanmin(speed)), float(np.nanmax(speed))),
        "position": (float(position.min()), float(position.max())),
        "time": (0.0, max(float(p.time[-1]) for p in runs.segments)),
        "lateral_speed": (float(runs.lateral.min()), float(runs.lateral.max())),
    }
    return {name: (low, max(high, low + 1e-3)) for name, (low, high) in ends.items()}


def regimes(runs: RigRuns) -> dict[str, tuple[str, Array]]:
    """Regime variables: name → unit and values, shape (blocks,); constant ones are left out."""
    speed, turned = np.nan_to_num(runs.measured[:, 1]), []
    lateral, current, since = [], [], []
    for k, p in enumerate(runs.segments):
        rows = slice(p.first, p.last)
        samples = slice(runs.first[k], runs.first[k] + (p.last - p.first) * runs.size)
        lateral.append(runs.lateral[samples].reshape(-1, runs.size).mean(axis=1))
        current.append(runs.current[samples].reshape(-1, runs.size).mean(axis=1))
        turned.append(np.cumsum(np.nan_to_num(runs.measured[rows, 0])) * runs.size * runs.period)
        since.append(_since_reversal(speed[rows], p.time))
    size = np.array([p.last - p.first for p in runs.segments])
    found = {
        "speed": ("m/s", speed),
        "acceleration": ("m/s2", np.nan_to_num(runs.measured[:, 2])),
        "current": ("A", np.concatenate(current)),
        "load": ("kg", np.repeat(runs.mass, size)),
        "lateral_speed": ("m/s", np.concatenate(lateral)),
        "position": ("m", travelled(runs)),
        "wheel_angle": ("rad", np.concatenate(turned)),
        "time": ("s", np.concatenate([p.time for p in runs.segments])),
        "reversal": ("s", np.concatenate(since)),
    }
    for floor in sorted(set(runs.floor)) if len(set(runs.floor)) > 1 else ():
        found[f"floor {floor}"] = ("1", np.repeat(np.array([float(f == floor) for f in runs.floor]), size))
    return {name: entry for name, entry in found.items() if np.ptp(entry[1]) > 0.0}


def _since_reversal(speed: Array, time: Array) -> Array:
    """Time since the direction last changed, shape (blocks,) [s]."""
    sign = np.sign(np.where(abs(speed) < _STANDING, 0.0, speed))
    since, last, direction = np.empty(len(speed)), 0.0, 0.0
    for k, s in enumerate(sign):
        if s and s != direction:
            last, direction = time[k], s
        since[k] = time[k] - last
    return since


def rig_experiments(rig: Rig, floors: tuple[str, ...]) -> tuple[Experiment, ...]:
    """Candidate runs: profiles × currents × masses × lateral speeds × floors, about a hundred."""
    masses = (rig.rig.masses[0], rig.rig.masses[-1])
    found = []
    for floor in dict.fromkeys((*floors, "natural_stone", "pvc")):
        for profile, words in _PROFILES.items():
            found += [
                _experiment(profile, words, current, mass, 0.0, floor)
                for current in (0.45, 0.9, 1.5)
                for mass in dict.fromkeys(masses)
            ]
        for lateral in (-0.5, -0.2, 0.2, 0.5):
            found.append(_experiment("constant", "constant current", 0.9, masses[0], lateral, floor))
    return tuple(found)


def _experiment(
    profile: str, words: str, current: float, mass: float, lateral: float, floor: str
) -> Experiment:
    text = f"{words}, {current:g} A, {mass:g} kg on {floor.replace('_', ' ')}"
    if lateral:
        text += f", sideways at {lateral:+g} m/s"
    run = {
        "profile": profile,
        "current": current,
        "mass": mass,
        "lateral_speed": lateral,
        "floor": floor,
        "duration": _SECONDS,
    }
    return Experiment(f"{profile}_{current:g}_{mass:g}_{lateral:g}_{floor}", text, run)


def experiment_runs(experiment: Experiment, like: RigRuns) -> RigRuns:
    """Candidate run in the form of measured ones; `measured` is NaN."""
    run, period = experiment.run, like.period
    time = np.arange(0.0, float(run["duration"]), period)
    set_value = float(run["current"]) * _shape(str(run["profile"]), time)
    count = len(time) // like.size
    still = np.full(len(time), float(run["lateral_speed"]))
    centres: Array = np.asarray((np.arange(count) + 0.5) * like.size * period, float)
    return RigRuns(
        period,
        np.array([0, len(time)]),
        np.array([0, count]),
        like.size,
        set_value,
        None if like.target is None else set_value,
        still,
        np.zeros((0, 2)),
        np.zeros((1, 2)),
        np.array([float(run["mass"])]),
        (str(run["floor"]),),
        np.full((count, like.measured.shape[1]), np.nan),
        (Segment(experiment.name, experiment.name, 0, count, centres),),
    )


def _shape(profile: str, time: Array) -> Array:
    """Set value over time, at most 1."""
    if profile == "reversing":
        return np.where(np.floor(time / 0.5) % 2 == 0, 1.0, -1.0)
    if profile == "pulse":
        return np.where(time < 0.7, 1.0, 0.0)
    if profile == "crawl":
        return time / time[-1]
    return np.ones(len(time))
