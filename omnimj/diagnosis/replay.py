"""One recorded run through a method, sample by sample, as a controller would have called it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnimj.control.gyro_bias import BIAS, next_bias, no_rest_yet, turn_row
from omnimj.control.method import Method
from omnimj.control.robust import Robust
from omnimj.control.robust.method import BLIND
from omnimj.diagnosis.beginning import begin, go_on
from omnimj.diagnosis.machines import Machine
from omnimj.diagnosis.resting import first_bias, is_still
from omnimj.diagnosis.sampling import Piece, Sampled, rows_at, sampled
from omnimj.errors import SimulationError
from omnimj.parameters import Robot
from omnimj.recording.dataset import Run
from omnimj.signals import Array, Diagnosis, Trace

LONGEST_GAP = 0.1
"""After a longer gap no window and no observer reaches back; what was diagnosed stays listed [s]."""
_REPORT_EVERY = 500  # samples

Progress = Callable[[int], None]
"""Called now and then with the samples done."""
Watch = Callable[[Any], None]
"""Called with the method's state after every sample."""


@dataclass(frozen=True)
class Replayed:
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


def sample_run(run: Run, machine: Machine) -> Sampled:
    """A run at the controller's rate."""
    return sampled(run, machine.channels, machine.targets, machine.period, machine.angles)


def replay(
    run: Run,
    samples: Sampled,
    machine: Machine,
    method: Method,
    progress: Progress | None = None,
    watch: Watch | None = None,
) -> Replayed:
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
    blind = float((logs[:, -1] == BLIND).sum()) * machine.period if isinstance(method, Robust) else 0.0
    notes = samples.notes
    if gaps:
        many = f"{len(gaps)} gaps" if len(gaps) > 1 else "a gap"
        notes = (*notes, f"run {run.name}: begun anew after {many} of up to {max(gaps):.3g} s")
    trace = _trace(run, times, method.log_names, logs)
    return Replayed(run.name, told, blind, samples.samples * machine.period, trace, notes)


class _Loop:
    """Steps a method through pieces; keeps the gyro's bias and fills the rows of the log."""

    def __init__(
        self,
        name: str,
        machine: Machine,
        method: Method,
        samples: Sampled,
        logs: Array,
        progress: Progress | None,
        watch: Watch | None,
    ):
        self._name, self._machine, self._method, self._logs = name, machine, method, logs
        self._progress, self._watch, self._done = progress, watch, 0
        self._rest, self._turn, self._speeds = no_rest_yet(), np.empty(0), slice(0)
        if isinstance(machine.constants, Robot) and samples.pieces:
            n = len(machine.constants.wheels)
            self._speeds, self._turn = slice(n, 2 * n), turn_row(machine.constants)
            rows = np.concatenate([piece.columns for piece in samples.pieces])
            gyro = rows[:, machine.channels.index("yaw_rate")]
            self._rest = first_bias(rows[:, self._speeds], gyro, machine.period)

    def over(self, piece: Piece, state: Any, is_long: bool) -> Any:
        """The state after a piece, from the one before it and a gap; None: the method begins."""
        machine, method = self._machine, self._method
        bias = float(self._rest[BIAS])
        first = machine.measurement(float(piece.time[0]), piece.columns[0])
        if state is None:
            state = begin(method, machine.constants, first, bias)
        else:
            state = go_on(method, machine.constants, state, first, bias, is_long)
        for k, now in enumerate(piece.time.tolist()):
            row = piece.columns[k]
            measured = machine.measurement(now, row)
            command = None if piece.command is None else piece.command[k]
            try:
                state = method.step(state, measured, command, float(self._rest[BIAS]))
            except (ArithmeticError, np.linalg.LinAlgError) as error:
                found = f"the method breaks down at {now:.6g} s ({error})"
                raise SimulationError(f"run {self._name!r}: {found}") from None
            self._logs[self._done] = state.log
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
        still = is_still(speed, rate, float(self._rest[BIAS]))
        self._rest = next_bias(self._rest, self._turn, still, rate, speed, self._machine.period)


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
