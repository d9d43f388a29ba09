"""Logs of each machine for a fault detector: channels, detector, samples at the controller's rate."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnimj.control.detection.detector import RecordingDetector
from omnimj.control.detection.robust.blocks import BLOCK, BRIDGED
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.gains import ObserverGains
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Floor, Rig, Robot, read_rig, read_robot
from omnimj.plant.interface import RIG_CHANNELS, robot_channels
from omnimj.recording.dataset import Dataset, Run, require_inertial_unit
from omnimj.signals import Array, Measurement, RigMeasurement
from omnimj.simulate.detectors import METHODS, RIG_METHODS, detector_for

PLANTS = ("uto_robot", "quarter_rig")
"""Machines whose logs can be diagnosed."""
_WITHOUT_UNIT = "without it, --floor-labels tells which wheel stands on which floor"


@dataclass(frozen=True)
class Machine:
    """Nominal machine of a detector, and how its logs become measurements."""

    constants: Robot | Rig
    methods: tuple[str, ...]
    """Methods that run on this machine, the default first; `off` diagnoses nothing."""
    channels: tuple[str, ...]
    """Columns passed to the detector, in this order."""
    targets: tuple[str, ...]
    """Columns of commanded currents."""
    angles: tuple[str, ...]
    """Channels in rad that may be wrapped to one turn."""
    measurement: Callable[[float, Array], Measurement | RigMeasurement]
    """Converts time [s] and a row of channels, shape (channels,), to a measurement."""

    @property
    def period(self) -> float:
        """Control period [s]."""
        return 1.0 / self.constants.sensors.sample_rate

    @property
    def has_gyro(self) -> bool:
        """True if the machine has a gyro, whose bias is estimated."""
        return "yaw_rate" in self.channels


def read_machine(dataset: Dataset, model: Path | str | None = None) -> Machine:
    """Read the machine of a dataset.

    Raises:
      InputError: No method diagnoses this machine, the logs lack a channel, or the model file breaks
        a rule.
    """
    require_inertial_unit(dataset, _WITHOUT_UNIT)
    if dataset.plant == "quarter_rig":
        rig = read_rig(model)
        return Machine(rig, RIG_METHODS, RIG_CHANNELS, ("current_target",), (), _rig_measurement)
    if dataset.plant != "uto_robot":
        found = f"plant is {dataset.plant!r}"
        raise InputError(dataset.path, found, "only machines with wheels can be diagnosed", PLANTS)
    robot, n = read_robot(model), dataset.wheels
    if len(robot.wheels) != n:
        found = f"has {len(robot.wheels)} [[wheels]]"
        raise InputError(
            robot.file, found, f"the logs of {dataset.path} have {n} wheels; pass --model, e.g. three_wheel"
        )
    targets = tuple(f"current_target_{i}" for i in range(1, n + 1))
    return Machine(robot, tuple(METHODS), robot_channels(n), targets, ("yaw",), _robot_measurement)


def resolve_method(name: str | None, machine: Machine) -> str:
    """Return the name of the method, by default the first one for this machine.

    Raises:
      UnknownNameError: The method does not exist.
      InputError: The method is not a diagnosis method, or not for this machine.
    """
    names = tuple(one for one in machine.methods if one != "off")
    if name is None:
        return names[0]
    if name in names:
        return name
    if name not in METHODS:
        raise UnknownNameError("--method", "method", name, names)
    rule = "it diagnoses nothing" if name == "off" else "the rig has one wheel"
    raise InputError("--method", f"found {name!r}", rule, names)


def make_detector(
    name: str,
    machine: Machine,
    run: Run,
    floor: Floor,
    expected_floor: Floor | None = None,
    thresholds: Thresholds | None = None,
    observer: ObserverGains | None = None,
) -> RecordingDetector:
    """Make the detector of one run, for its floor and, where stated, its mass.

    Args:
      name: Name of the method.
      machine: Machine that the logs come from.
      run: The run, whose conditions may state a mass.
      floor: Floor of the run, which the published method assumes.
      expected_floor: Floor that the robust method expects; None: it knows nothing of the floor.
      thresholds: Thresholds of the robust method; the shipped ones when None.
      observer: Observer gains of the robust method; the shipped ones when None.

    Raises:
      UnknownNameError: The method does not exist.
      InputError: The method is not for this machine, or the thresholds are not for the method.
    """
    constants, mass = machine.constants, run.conditions.get("mass")
    if isinstance(constants, Robot) and mass is not None:
        body = dataclasses.replace(constants.body, mass=float(mass))
        constants = dataclasses.replace(constants, body=body)
    load = None if mass is None else float(mass)
    detector = detector_for(
        name,
        constants,
        floor,
        mass=load,
        thresholds=thresholds,
        observer=observer,
        expected_floor=expected_floor,
    )
    if detector is None:
        raise InputError("--method", f"found {name!r}", "it diagnoses nothing")
    return detector


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


MIN_RATE = 100.0
"""Lowest sample rate of a log, one sample per block of the robust method [1/s]."""
MIN_COMMAND_RATE = 500.0
"""Lowest sample rate at which logged commanded currents are used [1/s]; at lower rates they change too much
between samples, by the wheel-speed loop."""
LONGEST_BRIDGE = BRIDGED * BLOCK
"""Longest step between two rows that is interpolated [s], as the detector does in a live run; of slower logs
`SLOW_BRIDGE` steps."""
SLOW_BRIDGE = 2.0
"""Longest step that is interpolated, in median steps of a log."""
MAX_VALUE = 1e4
"""Largest plausible magnitude of any channel in its unit."""
_ALIKE = 0.005  # largest deviation of a log at the controller's own rate, relative to the period
_UNEVEN = 0.5  # largest jitter of a step, relative to the period
_QUARTER = 0.25  # largest offset of the logger's clock to the controller's, relative to the period
_ROUNDING = 1e-6  # rounding error of logged times [s]


@dataclass(frozen=True)
class Segment:
    """Segment of a run without a gap, with k samples at the controller's rate."""

    time: Array
    """Sample times, shape (k,) [s]."""
    columns: Array
    """Channels, shape (k, channels)."""
    command: Array | None
    """Commanded currents of the period that each sample ends, shape (k, n) [A]; None if unknown."""


@dataclass(frozen=True)
class SampledRun:
    """Run at the controller's rate, split at its gaps."""

    segments: tuple[Segment, ...]
    notes: tuple[str, ...]
    """Notes for the reader, one sentence each."""

    @property
    def gaps(self) -> tuple[float, ...]:
        """Durations of the gaps between the segments [s]."""
        pairs = itertools.pairwise(self.segments)
        return tuple(float(after.time[0] - before.time[-1]) for before, after in pairs)

    @property
    def samples(self) -> int:
        """Number of samples in all segments."""
        return sum(len(segment.time) for segment in self.segments)


def sample_rate(run: Run) -> float:
    """Return the sample rate of a run by its median step [1/s]."""
    return 1.0 / float(np.median(np.diff(run.time)))


def require_rates(dataset: Dataset) -> None:
    """Check that every run is sampled fast enough.

    Raises:
      InputError: A run is not.
    """
    for run in dataset.runs:
        rate = sample_rate(run)
        if rate < MIN_RATE * (1.0 - _ALIKE):
            rule = f"diagnosis needs at least {MIN_RATE:g} samples per second"
            raise InputError(f"{dataset.path}: run {run.name!r}", f"has {rate:.4g} per second", rule)


def resample(
    run: Run, channels: Sequence[str], targets: Sequence[str], period: float, angles: Sequence[str] = ()
) -> SampledRun:
    """Sample a run at the controller's rate: masked rows are left out, a few missing rows interpolated.

    Args:
      run: Run with at least `MIN_RATE` samples per second.
      channels: Columns for the detector; a row with a masked entry is left out.
      targets: Columns of the commanded currents, used if the run has all of them.
      period: Control period [s].
      angles: Channels in rad that may be wrapped to one turn.
    """
    keep = ~np.any([run.masked.get(name, np.zeros(len(run.time), bool)) for name in channels], axis=0)
    time = run.time[keep]
    values = np.column_stack([_unwrapped(run, name, angles)[keep] for name in channels])
    commands, notes = _commands(run, targets)
    wild = [name for name, column in zip(channels, values.T, strict=True) if np.abs(column).max() > MAX_VALUE]
    if wild:
        notes.append(f"run {run.name}: {', '.join(wild)} beyond ±{MAX_VALUE:g} clipped")
        values = np.clip(values, -MAX_VALUE, MAX_VALUE)
    rate = sample_rate(run)
    bridge = max(LONGEST_BRIDGE, SLOW_BRIDGE / rate)
    breaks = np.flatnonzero(np.diff(time) > bridge + _ROUNDING) + 1
    segments, made = [], False
    for rows in np.split(np.arange(len(time)), breaks):
        if len(rows) < 2:
            continue
        segment, interpolated = _segment(time[rows], values[rows], period)
        made = made or interpolated
        command = (
            None if commands is None else _held(run.time, commands, segment.time - (1.0 - _QUARTER) * period)
        )
        for k, name in enumerate(channels):
            if name in angles:
                segment.columns[:, k] %= 2.0 * math.pi
        segments.append(Segment(segment.time, segment.columns, command))
    lost = int((~keep).sum())
    if lost:
        notes.append(f"run {run.name}: {lost} of {len(keep)} rows are masked and left out")
    if made and abs(rate * period - 1.0) > _ALIKE:
        rates = f"from {rate:.4g} to {1.0 / period:.4g} samples per second"
        notes.append(f"run {run.name}: interpolated linearly {rates}")
    elif made:
        words = f"gaps of up to {1000.0 * bridge:.3g} ms"
        notes.append(f"run {run.name}: {words} interpolated")
    return SampledRun(tuple(segments), tuple(notes))


def _unwrapped(run: Run, name: str, angles: Sequence[str]) -> Array:
    if name not in angles:
        return run.columns[name]
    # an angle may also be logged unwrapped, over many turns
    whole = np.unwrap(run.columns[name])
    return whole - 2.0 * math.pi * np.round(whole[0] / (2.0 * math.pi))


def _commands(run: Run, targets: Sequence[str]) -> tuple[Array | None, list[str]]:
    """Return the commanded currents of all rows, shape (k, n), with notes; None if they are not used."""
    if not targets or not all(name in run.columns for name in targets):
        return None, []
    if sample_rate(run) < MIN_COMMAND_RATE * (1.0 - _ALIKE):
        words = f"commanded currents are not used below {MIN_COMMAND_RATE:g} samples per second"
        return None, [f"run {run.name}: {words}"]
    return np.column_stack([run.columns[name] for name in targets]), []


def _segment(time: Array, values: Array, period: float) -> tuple[Segment, bool]:
    """Return the rows as a segment, and whether they were interpolated to the controller's rate."""
    steps = np.diff(time)
    is_alike = abs(steps.mean() - period) <= _ALIKE * period and steps.max() <= (1.0 + _UNEVEN) * period
    if is_alike:
        return Segment(time.copy(), values.copy(), None), False
    grid = time[0] + period * np.arange(int((time[-1] - time[0]) / period + _ALIKE) + 1)
    columns = np.column_stack([np.interp(grid, time, column) for column in values.T])
    return Segment(grid, columns, None), True


def _held(time: Array, commands: Array, at: Array) -> Array:
    """Return the commanded currents in effect at given times; before the first row, those of the first."""
    rows = np.searchsorted(time, at, side="right")
    return np.ascontiguousarray(commands[np.maximum(rows - 1, 0)])


def rows_at(sampled_time: Array, time: Array) -> NDArray[np.int64]:
    """Return the index of the newest sample at each row of the log, 0 before the first.

    Args:
      sampled_time: Times of the samples, shape (m,) [s].
      time: Times of the rows, shape (k,) [s].

    Returns:
      Shape (k,).
    """
    return np.maximum(np.searchsorted(sampled_time, time + _ROUNDING, side="right") - 1, 0)
