"""What the logs of each machine hold for a method, and the method for each run."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnimj.control.detection.detector import FaultDetector
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.gains import ObserverGains
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Floor, Rig, Robot, read_rig, read_robot
from omnimj.plant.interface import RIG_CHANNELS, robot_channels
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array, Measurement, RigMeasurement
from omnimj.simulate.detectors import METHODS, RIG_METHODS, DetectorConfig, detector_for

PLANTS = ("uto_robot", "quarter_rig")
"""Machines whose logs can be diagnosed."""


@dataclass(frozen=True)
class Machine:
    """A machine as a method believes it to be, and how its logs become measurements."""

    constants: Robot | Rig
    channels: tuple[str, ...]
    """Columns that a method gets, in this order."""
    targets: tuple[str, ...]
    """Columns of set currents."""
    angles: tuple[str, ...]
    """Channels that may be wrapped into one turn."""
    measurement: Callable[[float, Array], Measurement | RigMeasurement]
    """Time [s] and a row of channels as a measurement."""

    @property
    def period(self) -> float:
        """Of the controller [s]."""
        return 1.0 / self.constants.sensors.sample_rate

    @property
    def has_gyro(self) -> bool:
        """Whether a gyro's bias is to be found."""
        return "yaw_rate" in self.channels


def read_machine(dataset: Dataset, model: Path | None = None) -> Machine:
    """The machine of a dataset.

    Raises:
      InputError: Nothing can be diagnosed on it, or its model file breaks a rule.
    """
    if dataset.plant == "quarter_rig":
        rig = read_rig(model)
        return Machine(rig, RIG_CHANNELS, ("current_target",), (), _rig_measurement)
    if dataset.plant != "uto_robot":
        found = f"plant is {dataset.plant!r}"
        raise InputError(dataset.path, found, "only wheels can be diagnosed", PLANTS)
    robot, n = read_robot(model), dataset.wheels
    if len(robot.wheels) != n:
        found = f"has {len(robot.wheels)} [[wheels]]"
        raise InputError(
            robot.file, found, f"the logs of {dataset.path} have {n}: give --model, e.g. three_wheel"
        )
    targets = tuple(f"current_target_{i}" for i in range(1, n + 1))
    return Machine(robot, robot_channels(n), targets, ("yaw",), _robot_measurement)


def resolve_method(asked: str | None, machine: Machine) -> str:
    """The method that was asked for, or the usual one.

    Raises:
      UnknownNameError: No such method.
      InputError: It diagnoses nothing, or not this machine.
    """
    is_rig = isinstance(machine.constants, Rig)
    names = tuple(name for name in (RIG_METHODS if is_rig else METHODS) if name != "off")
    if asked is None:
        return names[0]
    if asked in names:
        return asked
    if asked not in METHODS:
        raise UnknownNameError("--method", "method", asked, names)
    rule = "it diagnoses nothing" if asked == "off" else "the rig has one wheel"
    raise InputError("--method", f"found {asked!r}", rule, names)


def make_detector(
    name: str,
    machine: Machine,
    run: Run,
    floors: Mapping[str, Floor],
    thresholds: Thresholds | None = None,
    observer: ObserverGains | None = None,
) -> FaultDetector:
    """The method for one run: on its floor, with its mass where it states one.

    Raises:
      UnknownNameError: No such method.
      InputError: The method is not for this machine, or the thresholds are not for the method.
    """
    constants, mass = machine.constants, run.conditions.get("mass")
    if isinstance(constants, Robot) and mass is not None:
        body = dataclasses.replace(constants.body, mass=float(mass))
        constants = dataclasses.replace(constants, body=body)
    load = None if mass is None else float(mass)
    floor = floors[str(run.conditions["floor"])]
    believed = DetectorConfig(constants, floor, load, thresholds=thresholds, observer=observer)
    method = detector_for(name, believed)
    if method is None:
        raise InputError("--method", f"found {name!r}", "it diagnoses nothing")
    return method


def _robot_measurement(time: float, row: Array) -> Measurement:
    n = (len(row) - 4) // 2
    return Measurement(
        time,
        row[:n],
        row[n : 2 * n],
        row[2 * n : 2 * n + 2],
        float(row[2 * n + 2]),
        float(row[2 * n + 3]),
    )


def _rig_measurement(time: float, row: Array) -> RigMeasurement:
    return RigMeasurement(time, *row.tolist())


# A recorded run as the controller would have sampled it: masked rows left out, pieces between gaps.

MIN_RATE = 100.0
"""Samples per second that a log has at least: a block of the robust method is 10 ms."""
MIN_COMMAND_RATE = 500.0
"""Samples per second from which logged set currents tell what the amplifiers had to follow [Hz]: between two
slower samples a speed loop changes its mind many times."""
LONGEST_BRIDGE = 0.02
"""The longest gap that is interpolated across [s]."""
MAX_VALUE = 1e4
"""Beyond any sensor of such machines, in whatever unit: larger numbers are limited to it."""
_ALIKE = 0.005  # of the period: a log at the controller's own rate
_UNEVEN = 0.5  # of the period
_QUARTER = 0.25  # of the period: how far a logger's clock may be off the controller's
_ROUNDING = 1e-6  # [s] of times that were written with few digits


@dataclass(frozen=True)
class Segment:
    """A stretch of a run without a gap, at the controller's rate, k samples."""

    time: Array
    """Shape (k,) [s]."""
    columns: Array
    """The channels, shape (k, channels)."""
    command: Array | None
    """Set currents of the period that each sample ends, shape (k, n) [A]; None where nobody knows."""


@dataclass(frozen=True)
class SampledRun:
    """A whole run."""

    pieces: tuple[Segment, ...]
    notes: tuple[str, ...]
    """What a reader should know, one sentence each."""

    @property
    def samples(self) -> int:
        """All pieces together."""
        return sum(len(piece.time) for piece in self.pieces)


def sample_rate(run: Run) -> float:
    """Samples per second, by the median step."""
    return 1.0 / float(np.median(np.diff(run.time)))


def require_rates(dataset: Dataset) -> None:
    """Whether every run is sampled often enough.

    Raises:
      InputError: One is not.
    """
    for run in dataset.runs:
        rate = sample_rate(run)
        if rate < MIN_RATE * (1.0 - _ALIKE):
            rule = f"at least {MIN_RATE:g} samples per second are needed to diagnose from"
            raise InputError(f"{dataset.path}: run {run.name!r}", f"has {rate:.4g} per second", rule)


def resample(
    run: Run, channels: Sequence[str], targets: Sequence[str], period: float, angles: Sequence[str] = ()
) -> SampledRun:
    """A run at the controller's rate.

    Args:
      run: At least `MIN_RATE` samples per second.
      channels: Columns that the method gets; a row with a masked one is left out.
      targets: Columns of the set currents; they count when the run has all of them.
      period: Of the controller [s].
      angles: Channels in rad that may be wrapped into one turn.
    """
    keep = ~np.any([run.masked.get(name, np.zeros(len(run.time), bool)) for name in channels], axis=0)
    time = run.time[keep]
    values = np.column_stack([_unwrapped(run, name, angles)[keep] for name in channels])
    asked, notes = _asked(run, targets)
    wild = [name for name, column in zip(channels, values.T, strict=True) if np.abs(column).max() > MAX_VALUE]
    if wild:
        notes.append(f"run {run.name}: {', '.join(wild)} beyond ±{MAX_VALUE:g} was limited to that")
        values = np.clip(values, -MAX_VALUE, MAX_VALUE)
    breaks = np.flatnonzero(np.diff(time) > LONGEST_BRIDGE + _ROUNDING) + 1
    pieces, made, rate = [], False, sample_rate(run)
    for rows in np.split(np.arange(len(time)), breaks):
        if len(rows) < 2:
            continue
        piece, interpolated = _piece(time[rows], values[rows], period)
        made = made or interpolated
        command = None if asked is None else _held(run.time, asked, piece.time - (1.0 - _QUARTER) * period)
        for k, name in enumerate(channels):
            if name in angles:
                piece.columns[:, k] %= 2.0 * math.pi
        pieces.append(Segment(piece.time, piece.columns, command))
    lost = int((~keep).sum())
    if lost:
        notes.append(f"run {run.name}: {lost} of {len(keep)} rows are masked and were left out")
    if made and abs(rate * period - 1.0) > _ALIKE:
        rates = f"from {rate:.4g} to {1.0 / period:.4g} samples per second"
        notes.append(f"run {run.name}: interpolated linearly {rates}")
    elif made:
        words = f"gaps of up to {1000.0 * LONGEST_BRIDGE:g} ms"
        notes.append(f"run {run.name}: {words} were interpolated across")
    return SampledRun(tuple(pieces), tuple(notes))


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
    if sample_rate(run) < MIN_COMMAND_RATE * (1.0 - _ALIKE):
        words = f"below {MIN_COMMAND_RATE:g} samples per second set currents tell nothing and are not used"
        return None, [f"run {run.name}: {words}"]
    return np.column_stack([run.columns[name] for name in targets]), []


def _piece(time: Array, values: Array, period: float) -> tuple[Segment, bool]:
    """The rows as they are at the controller's rate, else interpolated; and whether they were."""
    steps = np.diff(time)
    is_alike = abs(steps.mean() - period) <= _ALIKE * period and steps.max() <= (1.0 + _UNEVEN) * period
    if is_alike:
        return Segment(time.copy(), values.copy(), None), False
    grid = time[0] + period * np.arange(int((time[-1] - time[0]) / period + _ALIKE) + 1)
    columns = np.column_stack([np.interp(grid, time, column) for column in values.T])
    return Segment(grid, columns, None), True


def _held(time: Array, asked: Array, at: Array) -> Array:
    """The set currents that held at given times; before the first row those of the first."""
    rows = np.searchsorted(time, at, side="right")
    return np.ascontiguousarray(asked[np.maximum(rows - 1, 0)])


def rows_at(sampled_time: Array, time: Array) -> NDArray[np.int64]:
    """For each of the log's rows the newest sample until then, 0 before the first, shape (k,)."""
    return np.maximum(np.searchsorted(sampled_time, time + _ROUNDING, side="right") - 1, 0)
