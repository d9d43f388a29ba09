"""Measured rig runs on a common clock: what drives the replay, and block means to compare it with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from omnimj.errors import InputError, UnknownNameError
from omnimj.gap.replay import Piece, blocks
from omnimj.parameters import Floor, Rig
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array

CHANNELS = ("wheel_speed", "carriage_speed", "carriage_acceleration")
_SHORTEST = 0.02  # [s] of a block
_MOST_BLOCKS = 6000
_STILL = 0.03  # [m/s] mean lateral speed below which the gantry stands
_NEIGHBOURS = 10  # samples on either side over which the current is averaged
_REST = 0.02  # [m/s] carriage speed below which a run begins at rest


@dataclass(frozen=True)
class RigRuns:
    """All runs one behind the other, resampled to the period of the sensors."""

    period: float
    first: NDArray[np.int_]
    """First sample of every run and the end of the last, shape (runs + 1,)."""
    blocks_first: NDArray[np.int_]
    """The same for blocks."""
    size: int
    """Samples per block."""
    current: Array
    target: Array | None
    """Current set value where it was recorded, shape (samples,) [A]."""
    lateral: Array
    start: Array
    """Carriage and wheel speed at the start, shape (runs, 2)."""
    mass: Array
    floor: tuple[str, ...]
    measured: Array
    """Block means of `CHANNELS` and, with a set value, of the current, shape (blocks, channels)."""
    pieces: tuple[Piece, ...]


def rig_runs(dataset: Dataset, rig: Rig, floors: dict[str, Floor]) -> RigRuns:
    """Resamples, smooths the gantry's speed, takes block means.

    Raises:
      InputError: A run without floor.
      UnknownNameError: A floor that is not known.
    """
    period = 1.0 / rig.sensors.sample_rate
    total = sum(float(run.time[-1] - run.time[0]) for run in dataset.runs)
    size = max(round(_SHORTEST / period), int(np.ceil(total / period / _MOST_BLOCKS)))
    has_target = all("current_target" in run.columns for run in dataset.runs)
    first, blocks_first, pieces = [0], [0], []
    parts: dict[str, list[Array]] = {"current": [], "target": [], "lateral": [], "measured": []}
    start, mass, names = [], [], []
    for run in dataset.runs:
        clock = np.arange(run.time[0], run.time[-1] + 0.5 * period, period)
        count = len(clock) // size
        parts["current"].append(quieted(_resampled(run, "current", clock, fill=True)))
        if has_target:
            parts["target"].append(_resampled(run, "current_target", clock, fill=True))
        parts["lateral"].append(_steady(_resampled(run, "lateral_speed", clock, fill=True), period))
        columns = [*CHANNELS, "current"] if has_target else CHANNELS
        stack = np.stack([_resampled(run, name, clock) for name in columns], axis=1)
        parts["measured"].append(blocks(stack, size))
        start.append(_start(stack))
        mass.append(float(run.conditions.get("mass", rig.rig.masses[0])))
        names.append(_floor(dataset, run, floors))
        time = blocks(clock - clock[0], size)
        pieces.append(Piece(run.name, run.condition, blocks_first[-1], blocks_first[-1] + count, time))
        first.append(first[-1] + len(clock))
        blocks_first.append(blocks_first[-1] + count)
    return RigRuns(
        period,
        np.array(first),
        np.array(blocks_first),
        size,
        np.concatenate(parts["current"]),
        np.concatenate(parts["target"]) if has_target else None,
        np.concatenate(parts["lateral"]),
        np.array(start),
        np.array(mass),
        tuple(names),
        np.concatenate(parts["measured"]),
        tuple(pieces),
    )


def _resampled(run: Run, name: str, clock: Array, fill: bool = False) -> Array:
    """A column on the clock; masked samples are NaN, or bridged where the value drives the replay."""
    values = run.columns.get(name)
    if values is None:  # only the gantry's speed may be missing: it stands
        return np.zeros(len(clock))
    bad = run.masked.get(name)
    if bad is None or not bad.any():
        return np.interp(clock, run.time, values)
    good = np.interp(clock, run.time[~bad], values[~bad])
    if fill:
        return good
    nearest = np.clip(np.searchsorted(run.time, clock), 0, len(bad) - 1)
    return np.where(bad[nearest] | bad[np.maximum(nearest - 1, 0)], np.nan, good)


def quieted(current: Array) -> Array:
    """The current without the noise of its monitor, its steps kept: means of neighbours within 4 σ.

    What drives the replay must not be noisy: near standstill friction rectifies noise, and a noisy current
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


def _steady(lateral: Array, period: float) -> Array:
    """The gantry's speed without the noise of its sensor, exactly 0 while it stands."""
    smooth = uniform_filter1d(lateral, max(1, round(0.05 / period)), mode="nearest")
    middle = float(np.median(smooth))
    if abs(smooth - middle).max() < _STILL:  # constant: the mean is the best there is
        smooth = np.full(len(lateral), float(lateral.mean()))
    return np.where(abs(smooth) < _STILL, 0.0, smooth)


def _start(stack: Array) -> tuple[float, float]:
    """Carriage and wheel speed at the first samples; 0 for a run that begins at rest."""
    wheel, carriage = np.nanmedian(stack[:5, 0]), np.nanmedian(stack[:5, 1])
    return (0.0, 0.0) if abs(carriage) < _REST else (float(carriage), float(wheel))


def _floor(dataset: Dataset, run: Run, floors: dict[str, Floor]) -> str:
    name = run.conditions.get("floor")
    place = dataset.path / "dataset.toml"
    if name is None:
        raise InputError(f"{place}: runs.{run.name}", "'floor' is missing", "say which floor", floors)
    if name not in floors:
        raise UnknownNameError(f"{place}: runs.{run.name}.floor", "floor", name, floors)
    return str(name)
