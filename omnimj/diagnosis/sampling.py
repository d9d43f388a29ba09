"""A recorded run as the controller would have sampled it: masked rows left out, pieces between gaps.

Where a logger had the controller's own rate its rows are taken as they are; any other is interpolated
linearly to the controller's rate, across no gap longer than `LONGEST_BRIDGE`. Set currents are held, not
interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.errors import InputError
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array

SLOWEST = 100.0
"""Samples per second that a log has at least: a block of the robust method is 10 ms."""
FINEST_COMMANDS = 500.0
"""Samples per second from which logged set currents tell what the amplifiers had to follow [Hz]: between two
slower samples a speed loop changes its mind many times."""
LONGEST_BRIDGE = 0.02
"""The longest gap that is interpolated across [s]."""
LARGEST = 1e4
"""Beyond any sensor of such machines, in whatever unit: larger numbers are limited to it."""
_ALIKE = 0.005  # of the period: a log at the controller's own rate
_UNEVEN = 0.5  # of the period
_QUARTER = 0.25  # of the period: how far a logger's clock may be off the controller's
_ROUNDING = 1e-6  # [s] of times that were written with few digits


@dataclass(frozen=True)
class Piece:
    """A stretch of a run without a gap, at the controller's rate, k samples."""

    time: Array
    """Shape (k,) [s]."""
    columns: Array
    """The channels, shape (k, channels)."""
    command: Array | None
    """Set currents of the period that each sample ends, shape (k, n) [A]; None where nobody knows."""


@dataclass(frozen=True)
class Sampled:
    """A whole run."""

    pieces: tuple[Piece, ...]
    notes: tuple[str, ...]
    """What a reader should know, one sentence each."""

    @property
    def samples(self) -> int:
        """All pieces together."""
        return sum(len(piece.time) for piece in self.pieces)


def rate_of(run: Run) -> float:
    """Samples per second, by the median step."""
    return 1.0 / float(np.median(np.diff(run.time)))


def require_rates(dataset: Dataset) -> None:
    """Whether every run is sampled often enough.

    Raises:
      InputError: One is not.
    """
    for run in dataset.runs:
        rate = rate_of(run)
        if rate < SLOWEST * (1.0 - _ALIKE):
            rule = f"at least {SLOWEST:g} samples per second are needed to diagnose from"
            raise InputError(f"{dataset.path}: run {run.name!r}", f"has {rate:.4g} per second", rule)


def sampled(
    run: Run, channels: Sequence[str], targets: Sequence[str], period: float, angles: Sequence[str] = ()
) -> Sampled:
    """A run at the controller's rate.

    Args:
      run: At least `SLOWEST` samples per second.
      channels: Columns that the method gets; a row with a masked one is left out.
      targets: Columns of the set currents; they count when the run has all of them.
      period: Of the controller [s].
      angles: Channels in rad that may be wrapped into one turn.
    """
    keep = ~np.any([run.masked.get(name, np.zeros(len(run.time), bool)) for name in channels], axis=0)
    time = run.time[keep]
    values = np.column_stack([_unwrapped(run, name, angles)[keep] for name in channels])
    asked, notes = _asked(run, targets)
    wild = [name for name, column in zip(channels, values.T, strict=True) if np.abs(column).max() > LARGEST]
    if wild:
        notes.append(f"run {run.name}: {', '.join(wild)} beyond ±{LARGEST:g} was limited to that")
        values = np.clip(values, -LARGEST, LARGEST)
    breaks = np.flatnonzero(np.diff(time) > LONGEST_BRIDGE + _ROUNDING) + 1
    pieces, made, rate = [], False, rate_of(run)
    for rows in np.split(np.arange(len(time)), breaks):
        if len(rows) < 2:
            continue
        piece, interpolated = _piece(time[rows], values[rows], period)
        made = made or interpolated
        command = None if asked is None else _held(run.time, asked, piece.time - (1.0 - _QUARTER) * period)
        for k, name in enumerate(channels):
            if name in angles:
                piece.columns[:, k] %= 2.0 * math.pi
        pieces.append(Piece(piece.time, piece.columns, command))
    lost = int((~keep).sum())
    if lost:
        notes.append(f"run {run.name}: {lost} of {len(keep)} rows are masked and were left out")
    if made and abs(rate * period - 1.0) > _ALIKE:
        rates = f"from {rate:.4g} to {1.0 / period:.4g} samples per second"
        notes.append(f"run {run.name}: interpolated linearly {rates}")
    elif made:
        words = f"gaps of up to {1000.0 * LONGEST_BRIDGE:g} ms"
        notes.append(f"run {run.name}: {words} were interpolated across")
    return Sampled(tuple(pieces), tuple(notes))


def _unwrapped(run: Run, name: str, angles: Sequence[str]) -> Array:
    if name not in angles:
        return run.columns[name]
    # an angle may be counted on over many turns
    whole = np.unwrap(run.columns[name])
    return whole - 2.0 * math.pi * np.round(whole[0] / (2.0 * math.pi))


def _asked(run: Run, targets: Sequence[str]) -> tuple[Array | None, list[str]]:
    """Set currents by row, shape (k, n), and what there is to say about them."""
    if not targets or not all(name in run.columns for name in targets):
        return None, []
    if rate_of(run) < FINEST_COMMANDS * (1.0 - _ALIKE):
        words = f"below {FINEST_COMMANDS:g} samples per second set currents tell nothing and are not used"
        return None, [f"run {run.name}: {words}"]
    return np.column_stack([run.columns[name] for name in targets]), []


def _piece(time: Array, values: Array, period: float) -> tuple[Piece, bool]:
    """The rows as they are at the controller's rate, else interpolated; and whether they were."""
    steps = np.diff(time)
    is_alike = abs(steps.mean() - period) <= _ALIKE * period and steps.max() <= (1.0 + _UNEVEN) * period
    if is_alike:
        return Piece(time.copy(), values.copy(), None), False
    grid = time[0] + period * np.arange(int((time[-1] - time[0]) / period + _ALIKE) + 1)
    columns = np.column_stack([np.interp(grid, time, column) for column in values.T])
    return Piece(grid, columns, None), True


def _held(time: Array, asked: Array, at: Array) -> Array:
    """The set currents that held at given times; before the first row those of the first."""
    rows = np.searchsorted(time, at, side="right")
    return np.ascontiguousarray(asked[np.maximum(rows - 1, 0)])


def rows_at(sampled_time: Array, time: Array) -> NDArray[np.int64]:
    """For each of the log's rows the newest sample until then, 0 before the first, shape (k,)."""
    return np.maximum(np.searchsorted(sampled_time, time + _ROUNDING, side="right") - 1, 0)
