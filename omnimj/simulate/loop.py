"""Loop that steps a plant: one generator for recorded runs, the test rig, driving by hand and hardware.

A policy decides the command of every control period from the measurement; the plant, a simulation or
hardware, holds it for one period. Row k of a recording holds what was measured at t_k, the set currents, the
controller's log, the truth at t_k where the plant has one, and the target.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol

import numpy as np

from omnimj.errors import LinkLost, SimulationError
from omnimj.plant.interface import Plant
from omnimj.signals import Array, CurrentCommand, Trace

SNAPSHOT_PERIOD = 0.02
"""Time between two poses of the 3-D recording [s]."""
LARGEST_TRUTH = 1e10
"""Largest magnitude of every true value, in any unit; MuJoCo stops beyond it as well."""

_PROGRESS_EVERY = 100  # [rows]

Progress = Callable[[int, int], None]
"""Called with the number of finished rows and the total number of rows."""
Snapshot = Callable[[float, Array], None]
"""Called every `SNAPSHOT_PERIOD` with the time [s] and the plant's pose (the twin's qpos)."""
Rows = Callable[[tuple[str, ...], Array], None]
"""Called with the column names and the rows since the last call, shape (m, columns)."""


@dataclass(frozen=True)
class Callbacks:
    """Functions that are called while a run goes on; each may be left out."""

    progress: Progress | None = None
    """Called every hundred rows, and at the end."""
    snapshot: Snapshot | None = None
    rows: Rows | None = None
    """Called every hundred rows, and at the end."""
    start: Callable[[Plant], None] | None = None
    """Called by `run_scenario` with the plant before the first step."""


NO_CALLBACKS = Callbacks()


class Policy(Protocol):
    """Source of the command of every control period, which also fills its part of each row.

    A row consists of `names`, the plant's truth and `target_names`.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Column names before the plant's truth, beginning with `time`."""
        ...

    @property
    def target_names(self) -> tuple[str, ...]:
        """Column names after the plant's truth."""
        ...

    def command(self, measurement: Any, row: Array) -> CurrentCommand | None:
        """Command for the coming period; None ends the run.

        Args:
          measurement: Newest measurement of the plant.
          row: Row to fill, shape (columns,): those of `names` at its beginning, of `target_names` at its end.
        """
        ...


class Ending:
    """Context manager that keeps Ctrl-C and failures of the plant as values, so that no row is lost."""

    def __init__(self, *failures: type[Exception]):
        """Treat exceptions of these types as failures of the plant; all others propagate."""
        self._failures = failures
        self.interrupted = False
        """True if Ctrl-C ended the run."""
        self.error: BaseException | None = None
        """The failure that ended the run."""

    def __enter__(self) -> Ending:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        self.interrupted = isinstance(error, KeyboardInterrupt)
        if isinstance(error, self._failures):
            self.error = error
        return self.interrupted or self.error is not None


def column_names(plant: Plant, policy: Policy) -> tuple[str, ...]:
    """Column names of a row: the policy's, those of the plant's truth, the policy's targets.

    Raises:
      ValueError: Two columns share a name.
    """
    names = (*policy.names, *plant.truth_names, *policy.target_names)
    if len(set(names)) != len(names):
        raise ValueError(f"two columns share a name: {sorted(n for n in set(names) if names.count(n) > 1)}")
    return names


def steps(
    plant: Plant, policy: Policy, measurement: Any, table: Array, limit: int | None = None
) -> Iterator[int]:
    """Step a plant under a policy, one row per control period.

    Row k goes to `table[k % len(table)]`, so that a short table serves a run without a planned end. Each row
    is yielded before the plant takes the next step, so that the caller may wait, inspect it or stop.

    Args:
      plant: Plant that has been reset.
      policy: Source of the commands.
      measurement: First measurement of the plant.
      table: Array to fill, shape (rows, columns), with the columns of `column_names`.
      limit: Number of rows after which the run ends; when None, the policy ends it.

    Yields:
      The number of rows so far.

    Raises:
      SimulationError: The truth is not finite or beyond `LARGEST_TRUTH`; errors of the plant propagate.
    """
    truth_names, first = plant.truth_names, len(policy.names)
    last, done = first + len(truth_names), 0
    while (command := policy.command(measurement, row := table[done % len(table)])) is not None:
        truth = plant.truth()
        row[first:last] = truth
        check_truth(truth_names, truth.tolist())
        done += 1
        yield done
        if done == limit:
            return
        measurement = plant.step(command)


def check_truth(names: tuple[str, ...], truth: list[float]) -> None:
    """Refuse numbers that are not finite or beyond `LARGEST_TRUTH`; plain floats are fastest for so few."""
    if (
        math.isfinite(sum(truth))
        and max(truth, default=0.0) <= LARGEST_TRUTH
        and min(truth, default=0.0) >= -LARGEST_TRUTH
    ):
        return
    broken = [
        f"{name} is {value:g}"
        for name, value in zip(names, truth, strict=True)
        if not abs(value) <= LARGEST_TRUTH
    ]
    raise SimulationError(", ".join(broken))


def snapshot_rows(plant: Plant) -> int:
    """Number of rows from one pose of the 3-D recording to the next."""
    return max(1, round(SNAPSHOT_PERIOD / plant.period))


def take_snapshot(plant: Plant, snapshot: Snapshot | None) -> Callable[[int, float], None]:
    """Function of (rows so far, time [s]) that calls `snapshot` with the pose every `SNAPSHOT_PERIOD`."""
    pose, every = getattr(plant, "pose", None), snapshot_rows(plant)
    if snapshot is None or pose is None:
        return lambda done, now: None

    def take(done: int, now: float) -> None:
        if (done - 1) % every == 0:
            snapshot(float(now), pose())

    return take


class RowSource(Protocol):
    """Source of the rows of a trace."""

    @property
    def done(self) -> int:
        """Rows that are finished."""
        ...

    def fill(self, table: Array) -> Iterator[int]:
        """Fill a table, and yield the number of finished rows now and then.

        Args:
          table: Array to fill, shape (rows, columns).
        """
        ...


class _Stepwise:
    """Rows of a policy, step by step."""

    def __init__(self, plant: Plant, policy: Policy, measurement: Any, snapshot: Snapshot | None):
        self._plant, self._policy, self._measurement = plant, policy, measurement
        self._snapshot, self.done = take_snapshot(plant, snapshot), 0

    def fill(self, table: Array) -> Iterator[int]:
        for done in steps(self._plant, self._policy, self._measurement, table, len(table)):
            self.done = done
            self._snapshot(done, table[done - 1, 0])
            yield done


def record(
    plant: Plant,
    policy: Policy,
    measurement: Any,
    rows: int,
    callbacks: Callbacks = NO_CALLBACKS,
    about: Mapping[str, Any] | None = None,
) -> Trace:
    """Run a policy for a number of control periods and return the recorded trace.

    A run that ends early keeps its rows, and `about["interrupted"]` is then true. If the plant failed,
    `about["failure"]` holds time and reason; otherwise it is None.

    Args:
      plant: Plant that has been reset; the caller closes it.
      policy: Source of the commands.
      measurement: First measurement of the plant.
      rows: Number of control periods.
      callbacks: Callbacks for progress and live view.
      about: Description of the run, to which `realtime_factor`, `interrupted` and `failure` are added.
    """
    source = _Stepwise(plant, policy, measurement, callbacks.snapshot)
    return record_rows(source, column_names(plant, policy), (rows, plant.period), callbacks, about)


def record_rows(
    source: RowSource,
    names: tuple[str, ...],
    size: tuple[int, float],
    callbacks: Callbacks,
    about: Mapping[str, Any] | None,
) -> Trace:
    """Record the rows of a source and return them as a trace.

    Args:
      source: Source of the rows.
      names: Names of the columns.
      size: Number of rows, and their period [s].
      callbacks: Callbacks for progress and rows.
      about: Description of the run, to which `realtime_factor`, `interrupted` and `failure` are added.
    """
    rows, period = size
    # filled before the clock runs: the first touch of lazily allocated memory takes up to 8 ms in a row
    table, begin = np.full((rows, len(names)), np.nan), time.perf_counter()
    with Ending(SimulationError, ArithmeticError, LinkLost) as ending:
        for done in source.fill(table):
            if done % _PROGRESS_EVERY == 0 or done == rows:
                _report(callbacks, names, table, done)
    wall, done = time.perf_counter() - begin, source.done
    columns = np.ascontiguousarray(table[:done].T)
    described = {
        **(about or {}),
        "interrupted": ending.interrupted or ending.error is not None,
        "failure": None if ending.error is None else f"at {done * period:.4f} s: {ending.error}",
        "realtime_factor": max(done - 1, 0) * period / wall if wall > 0.0 else 0.0,
    }
    return Trace(dict(zip(names, columns, strict=True)), described)


def _report(callbacks: Callbacks, names: tuple[str, ...], table: Array, done: int) -> None:
    if callbacks.progress is not None:
        callbacks.progress(done, len(table))
    if callbacks.rows is not None:
        callbacks.rows(names, table[(done - 1) // _PROGRESS_EVERY * _PROGRESS_EVERY : done])


def require_complete(trace: Trace, name: str) -> None:
    """Raise the failure or interruption that ended a recorded run early.

    Args:
      trace: Trace from `record` or from the functions of `driving`.
      name: Name of the run in messages.

    Raises:
      SimulationError: The plant failed.
      KeyboardInterrupt: Ctrl-C was pressed.
    """
    if trace.about["failure"]:
        raise SimulationError(f"{name}: {trace.about['failure']}")
    if trace.about["interrupted"]:
        raise KeyboardInterrupt
