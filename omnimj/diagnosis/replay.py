"""One recorded run through a method, sample by sample, as a controller would have called it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.control.cascade.controller import is_good
from omnimj.control.cascade.heading import (
    LARGEST_BIAS,
    REST_WHEEL_SPEED,
    REST_YAW_RATE,
    SETTLING_TIME,
    GyroBias,
    update_gyro_bias,
    yaw_rate_row,
)
from omnimj.control.detection.detector import RecordingDetector
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.gains import ObserverGains
from omnimj.diagnosis.logs import (
    Machine,
    SampledRun,
    Segment,
    make_detector,
    require_rates,
    resample,
    rows_at,
)
from omnimj.errors import InputError, SimulationError
from omnimj.parameters import Floor, Robot
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array, Diagnosis, Trace

SHORTEST_REST = 0.3
"""Rests that count [s]."""


def is_still(wheel_speed: Array, yaw_rate: float, bias: float) -> bool:
    """Whether no wheel turns and the gyro says nothing but bias and noise."""
    return bool(np.abs(wheel_speed).max() < REST_WHEEL_SPEED and abs(yaw_rate - bias) < REST_YAW_RATE)


def first_bias(wheel_speed: Array, yaw_rate: Array, period: float) -> GyroBias:
    """Gyro bias by the first rest of a run, as the wheels show it; 0 without any rest.

    No log says when the demand was zero.

    Args:
      wheel_speed: Shape (k, n) [rad/s].
      yaw_rate: Shape (k,) [rad/s].
      period: Of the samples [s].
    """
    still = np.abs(wheel_speed).max(axis=1) < REST_WHEEL_SPEED
    edges = np.flatnonzero(np.diff(np.concatenate(([False], still, [False])).astype(int)))
    for first, last in edges.reshape(-1, 2):
        if (last - first) * period <= SHORTEST_REST:
            continue
        settled = yaw_rate[first + round(SETTLING_TIME / period) : last]
        if abs(settled.mean()) <= LARGEST_BIAS:
            return GyroBias(bias=float(settled.mean()), averaged=len(settled) * period)
    return GyroBias()


LONGEST_GAP = 0.1
"""After a longer gap no window and no observer reaches back; what was diagnosed stays listed [s]."""
_REPORT_EVERY = 500  # samples

SampleProgress = Callable[[int], None]
"""Called now and then with the samples done."""
Watch = Callable[[Any], None]
"""Called with the method's state after every sample."""


@dataclass(frozen=True)
class RunDiagnosis:
    """What a method made of a run."""

    name: str
    diagnoses: tuple[Diagnosis, ...]
    cannot_judge: float
    """Time in which the method said that it cannot judge [s]."""
    judged: float
    """Time that the method was given [s]."""
    trace: Trace
    """The log's rows and columns, and the method's beside them: what it held at each row."""
    notes: tuple[str, ...]


def sample_run(run: Run, machine: Machine) -> SampledRun:
    """A run at the controller's rate."""
    return resample(run, machine.channels, machine.targets, machine.period, machine.angles)


def replay(
    run: Run,
    samples: SampledRun,
    machine: Machine,
    method: RecordingDetector,
    progress: SampleProgress | None = None,
    watch: Watch | None = None,
) -> RunDiagnosis:
    """Drives a method over a run.

    Args:
      run: As recorded.
      samples: From `sample_run`.
      machine: That the method believes in.
      method: Any.
      progress: For a progress bar.
      watch: For who needs more than the method's log.
    """
    logs = np.empty((samples.samples, len(method.log_names)))
    times = np.concatenate([piece.time for piece in samples.pieces]) if samples.pieces else np.empty(0)
    loop = _Loop(run.name, machine, method, samples, logs, progress, watch)
    told, gaps = (), []
    state, last = None, -np.inf
    for piece in samples.pieces:
        gap = piece.time[0] - last
        is_long = gap > LONGEST_GAP
        if state is not None and is_long:
            told = _joined(told, state.diagnoses)
            gaps.append(gap)
        state = loop.over(piece, state, is_long)
        last = piece.time[-1]
    if state is not None:
        told = _joined(told, state.diagnoses)
    blind = float(loop.blind) * machine.period
    notes = samples.notes
    if gaps:
        many = f"{len(gaps)} gaps" if len(gaps) > 1 else "a gap"
        notes = (*notes, f"run {run.name}: begun anew after {many} of up to {max(gaps):.3g} s")
    trace = _trace(run, times, method.log_names, logs)
    return RunDiagnosis(run.name, told, blind, samples.samples * machine.period, trace, notes)


class _Loop:
    """Steps a method through pieces; keeps the gyro's bias and fills the rows of the log."""

    def __init__(
        self,
        name: str,
        machine: Machine,
        method: RecordingDetector,
        samples: SampledRun,
        logs: Array,
        progress: SampleProgress | None,
        watch: Watch | None,
    ):
        self._name, self._machine, self._method, self._logs = name, machine, method, logs
        self._progress, self._watch, self._done = progress, watch, 0
        self._rest, self._turn, self._speeds = GyroBias(), np.empty(0), slice(0)
        self._wheels, self.blind = 0, 0
        if isinstance(machine.constants, Robot) and samples.pieces:
            n = self._wheels = len(machine.constants.wheels)
            self._speeds, self._turn = slice(n, 2 * n), yaw_rate_row(machine.constants)
            rows = np.concatenate([piece.columns for piece in samples.pieces])
            gyro = rows[:, machine.channels.index("yaw_rate")]
            self._rest = first_bias(rows[:, self._speeds], gyro, machine.period)

    def over(self, piece: Segment, state: Any, is_long: bool) -> Any:
        """The state after a piece, from the one before it and a gap; None: the method begins."""
        machine, method = self._machine, self._method
        bias = self._rest.bias
        first = machine.measurement(float(piece.time[0]), piece.columns[0])
        state = method.begin(first, bias) if state is None else method.resume(state, first, bias, is_long)
        for k, now in enumerate(piece.time.tolist()):
            row = piece.columns[k]
            measured: Any = machine.measurement(now, row)
            command = None if piece.command is None else piece.command[k]
            try:
                if not self._wheels or is_good(measured, self._wheels):
                    state = method.step(state, measured, command, self._rest.bias)
            except (ArithmeticError, np.linalg.LinAlgError) as error:
                found = f"the method breaks down at {now:.6g} s ({error})"
                raise SimulationError(f"run {self._name!r}: {found}") from None
            self._logs[self._done] = state.log
            self.blind += method.cannot_judge(state)
            self._note_rest(measured)
            self._done += 1
            if self._watch is not None:
                self._watch(state)
            if self._progress is not None and self._done % _REPORT_EVERY == 0:
                self._progress(self._done)
        return state

    def _note_rest(self, measured: Any) -> None:
        if not self._machine.has_gyro:
            return
        speed, rate = measured.wheel_speed, measured.yaw_rate
        still = is_still(speed, rate, self._rest.bias)
        self._rest = update_gyro_bias(self._rest, self._turn, still, rate, speed, self._machine.period)


def _joined(before: Sequence[Diagnosis], after: Sequence[Diagnosis]) -> tuple[Diagnosis, ...]:
    """Diagnoses before and after a gap; one that stood and is made again is the one before."""
    joined = list(before)
    for new in after:
        for k, old in enumerate(before):
            same = (old.kind, old.wheels, old.channel) == (new.kind, new.wheels, new.channel)
            if same and (old.time == new.time or joined[k].cleared is None):
                joined[k] = dataclasses.replace(new, time=old.time)
                break
        else:
            joined.append(new)
    return tuple(joined)


def _trace(run: Run, times: Array, names: Sequence[str], logs: Array) -> Trace:
    """Columns of the log, and of the method: at each row what it had said until then."""
    columns = dict(run.columns)
    if len(times):
        held = logs[rows_at(times, run.time)]
        columns |= {name: held[:, k] for k, name in enumerate(names)}
    return Trace(columns)


# A method over all runs of a dataset, one after the other.

DatasetProgress = Callable[[int, int, str], None]
"""Called now and then with the work done, the work in all, and the run."""


@dataclass(frozen=True)
class DiagnosisConfig:
    """What is to be done."""

    dataset: Dataset
    machine: Machine
    method: str
    floors: Mapping[str, Floor]
    thresholds: Thresholds | None = None
    """Of the robust method; the shipped ones when None."""
    observer: ObserverGains | None = None
    """Of the robust method; the shipped ones when None."""

    def method_for(self, run: Run) -> RecordingDetector:
        """The method for one run.

        Raises:
          UnknownNameError: No such method.
          InputError: The method is not for this machine.
        """
        return make_detector(self.method, self.machine, run, self.floors, self.thresholds, self.observer)


def check_config(order: DiagnosisConfig) -> None:
    """Whether the runs can be diagnosed with the method; asked before anything is written.

    Raises:
      UnknownNameError: No such method.
      InputError: The method is not for this machine, or a run is sampled too slowly.
    """
    order.method_for(order.dataset.runs[0])
    require_rates(order.dataset)


def diagnose(order: DiagnosisConfig, progress: DatasetProgress | None = None) -> Iterator[RunDiagnosis]:
    """What the method says of each run, run by run.

    Args:
      order: Checked by `check_config`.
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
