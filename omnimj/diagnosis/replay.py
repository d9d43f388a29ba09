"""Replay of recorded runs through a fault detector, sample by sample, as a controller would call it.

The robust detector observes the samples in a compiled loop, every other one is called for each of them. Both
ways give the same numbers.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.control.cascade.controller import is_good
from omnimj.control.cascade.heading import (
    LARGEST_BIAS,
    REST_WHEEL_SPEED,
    SETTLING_TIME,
    GyroBias,
    update_gyro_bias,
    yaw_rate_row,
)
from omnimj.control.detection.detector import RecordingDetector
from omnimj.control.detection.robust.blocks import LONGEST_GAP
from omnimj.control.detection.robust.judgement import BLIND
from omnimj.control.detection.robust.recorded import RecordedObservation, RecordedRows, is_still
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.gains import ObserverGains
from omnimj.diagnosis.driving_regimes import DoesNotFit, judge_fit
from omnimj.diagnosis.logs import (
    Machine,
    SampledRun,
    Segment,
    make_detector,
    require_rates,
    resample,
    rows_at,
)
from omnimj.display import Displayed
from omnimj.errors import InputError, SimulationError
from omnimj.parameters import Floor, Robot
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array, Diagnosis, Trace, true_stretches

SHORTEST_REST = 0.3
"""Shortest rest that counts [s]."""


def first_bias(wheel_speed: Array, yaw_rate: Array, period: float) -> GyroBias:
    """Estimate the gyro bias from the first rest of a run, as the wheels show it; 0 without any rest.

    Logs do not show when the commanded motion was zero.

    Args:
      wheel_speed: φ̇, shape (k, n) [rad/s].
      yaw_rate: Readings of the gyro, shape (k,) [rad/s].
      period: Sample period [s].
    """
    still = np.abs(wheel_speed).max(axis=1) < REST_WHEEL_SPEED
    for first, last in true_stretches(still):
        if (last - first) * period <= SHORTEST_REST:
            continue
        settled = yaw_rate[first + round(SETTLING_TIME / period) : last]
        if abs(settled.mean()) <= LARGEST_BIAS:
            return GyroBias(bias=float(settled.mean()), averaged=len(settled) * period)
    return GyroBias()


_REPORT_EVERY = 500  # samples

SampleProgress = Callable[[int], None]
"""Called regularly with the number of finished samples."""
Watch = Callable[[float, Any], None]
"""Called with the time [s] and the state of the robust detector after every block; the state's arrays change
later."""


@dataclass(frozen=True)
class RunDiagnosis(Displayed):
    """Result of the diagnosis of one run."""

    name: str
    diagnoses: tuple[Diagnosis, ...]
    cannot_judge: float
    """Total time in which the detector could not make a decision, gaps included [s]."""
    judged: float
    """Duration of the samples and of the gaps between them [s]."""
    trace: Trace
    """Columns of the log, with those of the detector appended."""
    notes: tuple[str, ...]
    """Notes for the reader, one sentence each."""
    does_not_fit: DoesNotFit | None = None
    """Where the model does not fit the run; no hardware is named then."""
    withheld: tuple[Diagnosis, ...] = ()
    """Diagnoses that are not trusted since the model does not fit."""
    method: str = ""
    """Name of the detection method; empty: unknown."""


class DiagnosedRuns(tuple[RunDiagnosis, ...], Displayed):
    """Diagnoses of the runs of a dataset, a tuple in the order of the runs."""

    __slots__ = ()


def sample_run(run: Run, machine: Machine) -> SampledRun:
    """Sample a run at the controller's rate, with the channels of its machine."""
    return resample(run, machine.channels, machine.targets, machine.period, machine.angles)


def replay(
    run: Run,
    samples: SampledRun,
    machine: Machine,
    detector: RecordingDetector,
    progress: SampleProgress | None = None,
    watch: Watch | None = None,
) -> RunDiagnosis:
    """Replay a run through a detector.

    Args:
      run: The recorded run.
      samples: From `sample_run`.
      machine: Nominal machine of the detector.
      detector: The detector.
      progress: Progress callback.
      watch: Observer of the detector's states.
    """
    logs = np.empty((samples.samples, len(detector.log_names)))
    times = (
        np.concatenate([segment.time for segment in samples.segments]) if samples.segments else np.empty(0)
    )
    loop = _Loop(run.name, machine, detector, samples, logs, progress, watch)
    diagnoses, gaps = (), []
    state, last = None, -np.inf
    for segment in samples.segments:
        gap = segment.time[0] - last
        is_long = gap > LONGEST_GAP
        if state is not None and is_long:
            diagnoses = _joined(diagnoses, state.diagnoses)
            gaps.append(gap)
        state = loop.over(segment, state, is_long)
        last = segment.time[-1]
    if state is not None:
        diagnoses = _joined(diagnoses, state.diagnoses)
    missing = sum(gap - machine.period for gap in samples.gaps)
    blind, judged = (many * machine.period + missing for many in (loop.blind, samples.samples))
    notes = samples.notes
    if gaps:
        many = f"{len(gaps)} gaps" if len(gaps) > 1 else "a gap"
        notes = (*notes, f"run {run.name}: restarted after {many} of up to {max(gaps):.3g} s")
    trace, robot = _trace(run, times, detector.log_names, logs), machine.constants
    unfit = judge_fit(trace, robot, diagnoses) if isinstance(robot, Robot) else None
    if unfit is None:
        return RunDiagnosis(run.name, diagnoses, blind, judged, trace, notes)
    return RunDiagnosis(run.name, (), blind, judged, trace, notes, unfit, diagnoses)


class _Loop:
    """Loop that steps a detector through segments, estimates the gyro bias and fills the rows of the log."""

    def __init__(
        self,
        name: str,
        machine: Machine,
        detector: RecordingDetector,
        samples: SampledRun,
        logs: Array,
        progress: SampleProgress | None,
        watch: Watch | None,
    ):
        self._name, self._machine, self._detector, self._logs = name, machine, detector, logs
        self._progress, self._watch, self._done = progress, watch, 0
        self._rest, self._turn, self._speeds = GyroBias(), np.empty(0), slice(0)
        self._wheels, self._watched, self.blind = 0, 0, 0
        self._is_compiled = hasattr(type(detector).step, "compiled_in")
        if isinstance(machine.constants, Robot) and samples.segments:
            n = self._wheels = len(machine.constants.wheels)
            self._speeds, self._turn = slice(n, 2 * n), yaw_rate_row(machine.constants)
            rows = np.concatenate([segment.columns for segment in samples.segments])
            gyro = rows[:, machine.channels.index("yaw_rate")]
            self._rest = first_bias(rows[:, self._speeds], gyro, machine.period)

    def over(self, segment: Segment, state: Any, is_long: bool) -> Any:
        """Return the state after a segment, given that before it; None begins, else the detector resumes."""
        machine, detector = self._machine, self._detector
        bias = self._rest.bias
        first = machine.measurement(float(segment.time[0]), segment.columns[0])
        state = detector.begin(first, bias) if state is None else detector.resume(state, first, bias, is_long)
        return self._observed(segment, state) if self._is_compiled else self._stepped(segment, state)

    def _observed(self, segment: Segment, state: Any) -> Any:
        """State after a segment, by the compiled loop."""
        before, time = self._done, np.ascontiguousarray(segment.time, float)
        command = np.empty((0, self._wheels)) if segment.command is None else segment.command
        columns = np.ascontiguousarray(segment.columns, float)
        rows = RecordedRows(time, columns, np.ascontiguousarray(command, float), self._machine.period)
        detector: Any = self._detector
        observation = RecordedObservation(detector, state, self._rest, rows, self._watch)
        logs = self._logs[before : before + len(time)]
        with self._failures(lambda: float(time[observation.done])):
            for done in observation.advance(logs, _REPORT_EVERY):
                self._done = before + done
                if self._progress is not None:
                    self._progress(self._done)
        self._rest = observation.rest
        self.blind += int((logs[:, -1] == BLIND).sum())
        return observation.state

    def _stepped(self, segment: Segment, state: Any) -> Any:
        """State after a segment, with a call of the detector for every sample."""
        machine, detector, before = self._machine, self._detector, self._done
        self._watched = 0 if self._watch is None else state.blocks
        with self._failures(lambda: float(segment.time[self._done - before])):
            for k, now in enumerate(segment.time.tolist()):
                measured: Any = machine.measurement(now, segment.columns[k])
                command = None if segment.command is None else segment.command[k]
                if not self._wheels or is_good(measured, self._wheels):
                    state = detector.step(state, measured, command, self._rest.bias)
                self._logs[self._done] = state.log
                self.blind += detector.cannot_judge(state)
                self._update_bias(measured)
                self._done += 1
                if self._watch is not None and state.blocks != self._watched:
                    self._watched = state.blocks
                    self._watch(now, state)
                if self._progress is not None and self._done % _REPORT_EVERY == 0:
                    self._progress(self._done)
        return state

    @contextmanager
    def _failures(self, now: Callable[[], float]) -> Iterator[None]:
        """Name run and time [s] where the method fails."""
        try:
            yield
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            found = f"the method fails at {now():.6g} s ({error})"
            raise SimulationError(f"run {self._name!r}: {found}") from None

    def _update_bias(self, measured: Any) -> None:
        if not self._machine.has_gyro:
            return
        speed, rate = measured.wheel_speed, measured.yaw_rate
        still = is_still(speed, rate, self._rest.bias)
        self._rest = update_gyro_bias(self._rest, self._turn, still, rate, speed, self._machine.period)


def _joined(before: Sequence[Diagnosis], after: Sequence[Diagnosis]) -> tuple[Diagnosis, ...]:
    """Join the diagnoses before and after a gap; one that was active before and recurs counts as the same."""
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
    """Return the columns of the log, and those of the detector at the newest sample of each row."""
    columns = dict(run.columns)
    if len(times):
        held = logs[rows_at(times, run.time)]
        columns |= {name: held[:, k] for k, name in enumerate(names)}
    return Trace(columns)


DatasetProgress = Callable[[int, int, str], None]
"""Called regularly with finished rows, all rows, and the name of the run."""


@dataclass(frozen=True)
class DiagnosisConfig:
    """Settings of a diagnosis over a dataset."""

    dataset: Dataset
    machine: Machine
    method: str
    floors: Mapping[str, Floor]
    thresholds: Thresholds | None = None
    """Thresholds of the robust method; the shipped ones when None."""
    observer: ObserverGains | None = None
    """Observer gains of the robust method; the shipped ones when None."""
    expected_floors: frozenset[str] = frozenset()
    """Floors whose creep and drag the robust method expects, from `own_floors`; it knows no others."""

    def detector_for(self, run: Run) -> RecordingDetector:
        """Make the detector of one run.

        Raises:
          UnknownNameError: The method does not exist.
          InputError: The method is not for this machine.
        """
        floor = self.floors[str(run.conditions["floor"])]
        expected = floor if floor.name in self.expected_floors else None
        return make_detector(self.method, self.machine, run, floor, expected, self.thresholds, self.observer)


def check_config(config: DiagnosisConfig) -> None:
    """Check that the method can diagnose the runs, before anything is written.

    Raises:
      UnknownNameError: The method does not exist.
      InputError: The method is not for this machine, or a run is sampled too slowly.
    """
    config.detector_for(config.dataset.runs[0])
    require_rates(config.dataset)


def diagnose(config: DiagnosisConfig, progress: DatasetProgress | None = None) -> Iterator[RunDiagnosis]:
    """Diagnose the runs of a dataset one after the other.

    Args:
      config: Settings, checked by `check_config`.
      progress: Progress callback.

    Yields:
      The diagnosis of each run.
    """
    runs = config.dataset.runs
    total, before = sum(len(run.time) for run in runs), 0
    for run in runs:
        samples = sample_run(run, config.machine)
        detector = config.detector_for(run)

        def report(done: int, name: str = run.name, rows: int = len(run.time), first: int = before) -> None:
            if progress is not None:
                progress(min(first + done, first + rows), total, name)

        report(0)
        found = replay(run, samples, config.machine, detector, report)
        yield dataclasses.replace(found, method=config.method)
        before += len(run.time)


def replay_all(
    config: DiagnosisConfig, progress: DatasetProgress | None, phase: str, watch: Any = None
) -> list[RunDiagnosis]:
    """Replay every run of a dataset, and keep its diagnoses alone.

    Args:
      config: Settings, checked by `check_config`.
      progress: Progress callback.
      phase: What it is done for, before the name of a run in the progress.
      watch: `Watch` with a method `next_run`, called before each run.
    """
    found, before = [], 0
    total = sum(len(run.time) for run in config.dataset.runs)
    for run in config.dataset.runs:
        if progress is not None:
            progress(before, total, f"{phase} {run.name}")
        samples = sample_run(run, config.machine)
        if watch is not None:
            watch.next_run()
        one = replay(run, samples, config.machine, config.detector_for(run), watch=watch)
        found.append(dataclasses.replace(one, trace=dataclasses.replace(one.trace, columns={})))
        before += len(run.time)
    return found


def require_other_folder(dataset: Dataset, out: Path) -> None:
    """Check that results are not written into the folder of a dataset.

    Raises:
      InputError: `out` lies in the folder of the dataset, or is that of another.
    """
    home, there = dataset.path.resolve(), out.resolve()
    if there == home or home in there.parents or (out / "dataset.toml").exists():
        raise InputError(
            f"--out {out}", "is a dataset's folder", "choose another one, datasets are not changed"
        )
