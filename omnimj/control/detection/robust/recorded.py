"""Recorded rows through the robust detector as one compiled loop, without the interpreter and its lock.

It does for every row what `RobustDetector.step` does, by the same kernels, so that both give the same
numbers; it returns to Python for the rare decisions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from omnimj.control.cascade.controller import is_good_sample
from omnimj.control.cascade.heading import (
    REST_WHEEL_SPEED,
    REST_YAW_RATE,
    GyroBias,
    update_gyro_bias,
)
from omnimj.control.detection.detector import FaultEstimate
from omnimj.control.detection.robust.blocks import Sample, take_sample
from omnimj.control.detection.robust.detector import RobustDetector, RobustState
from omnimj.control.detection.robust.judgement import decide_block, judge_block
from omnimj.control.records import Record, copied
from omnimj.physics.native import kernel
from omnimj.signals import Array


class RecordedRows(NamedTuple):
    """Rows of a recording at the detector's period, k rows of a robot with n wheels."""

    time: Array
    """Shape (k,) [s]."""
    columns: Array
    """Channels in the order of `robot_channels`, shape (k, 2n+4)."""
    command: Array
    """Set currents of the period that each row ends, shape (k, n) [A]; k = 0: unknown."""
    period: float
    """Time from row to row [s]."""


class _Constants(NamedTuple):
    sampling: Record
    """Packed `SamplingParameters`."""
    robust: Record
    """Packed `RobustParameters`."""


class _Memory(NamedTuple):
    """Changed in place."""

    samples: Record
    evidence: Record
    judged: Record
    rest: Array
    """Packed `GyroBias`, shape (4,)."""
    place: Array
    """Rows that are finished, 1 if the block that ends with the next one is decided, blocks that the watch
    has seen; integers."""


@kernel
def is_still(wheel_speed, yaw_rate, bias):
    """True if no wheel turns and the gyro shows only bias and noise.

    Args:
      wheel_speed: φ̇, shape (n,) [rad/s].
      yaw_rate: Reading of the gyro [rad/s].
      bias: Estimated bias of the gyro [rad/s].
    """
    for speed in wheel_speed:
        if not abs(speed) < REST_WHEEL_SPEED:
            return False
    return abs(yaw_rate - bias) < REST_YAW_RATE


@kernel
def _take_row(constants, memory, rows, k, bias):
    """Take a row into the detector's block; True if a decision has to follow."""
    r, n = rows.columns[k], (rows.columns.shape[1] - 4) // 2
    current, wheel_speed, acceleration = r[:n], r[n : 2 * n], r[2 * n : 2 * n + 2]
    yaw_rate, yaw, known = r[2 * n + 2], r[2 * n + 3], rows.command.shape[0] > 0
    if not is_good_sample(n, rows.time[k], current, wheel_speed, acceleration, yaw_rate, yaw):
        return False
    command = rows.command[k] if known else current
    sample = Sample(rows.time[k], current, wheel_speed, acceleration, yaw_rate, bias, known, command)
    samples = memory.samples[0]
    if not take_sample(constants.sampling[0], samples, sample):
        return False
    return judge_block(constants.robust[0], samples, memory.evidence[0], memory.judged[0], yaw, rows.time[k])


_ALL_DONE, _DECISION_IS_DUE, _BLOCK_IS_DONE = range(3)  # reasons for which the loop returns


@kernel
def _observe_rows(constants, memory, rows, logs, end, watched):
    """Observe rows until `end` of them are finished, or until a decision has to be made.

    Args:
      constants: `_Constants`.
      memory: `_Memory`, changed in place.
      rows: `RecordedRows`.
      logs: Output, signals of the detector, shape (k, signals).
      end: Number of rows.
      watched: Whether to return after every block, too.

    Returns:
      The reason for which the loop returns.
    """
    n, place = (rows.columns.shape[1] - 4) // 2, memory.place
    while place[0] < end:
        k, rest = place[0], memory.rest
        before = GyroBias(rest[0], rest[1], rest[2], rest[3])
        if place[1] == 0 and _take_row(constants, memory, rows, k, before.bias):
            place[1] = 1
            return _DECISION_IS_DUE
        place[1] = 0
        logs[k] = memory.judged[0].log
        wheel_speed, yaw_rate = rows.columns[k, n : 2 * n], rows.columns[k, 2 * n + 2]
        still = is_still(wheel_speed, yaw_rate, before.bias)
        after = update_gyro_bias(before, constants.robust[0].turn, still, yaw_rate, wheel_speed, rows.period)
        rest[0], rest[1], rest[2], rest[3] = after
        place[0] += 1
        if watched and memory.judged[0].blocks != place[2]:
            place[2] = memory.judged[0].blocks
            return _BLOCK_IS_DONE
    return _ALL_DONE


class RecordedObservation:
    """Recorded rows observed by the robust detector.

    Args:
      detector: The detector, of which nothing is overridden.
      state: Its state before the first row; not changed.
      rest: Estimated bias of the gyro before the first row.
      rows: The rows.
      watch: Called after every block with time [s] and state, of which the arrays are changed later.
    """

    def __init__(
        self,
        detector: RobustDetector,
        state: RobustState,
        rest: GyroBias,
        rows: RecordedRows,
        watch: Callable[[float, RobustState], None] | None = None,
    ):
        self._detector, self._rows, self._decisions = detector, rows, state.decisions
        self._watch = watch
        self._constants = _Constants(detector.packed_sampling, detector.packed_constants)
        start = (copied(state.samples), copied(state.memory), copied(state.judged))
        place = np.array([0, 0, state.blocks])
        self._memory = _Memory(*start, np.array(rest, float), place)

    @property
    def done(self) -> int:
        """Rows that are finished."""
        return int(self._memory.place[0])

    @property
    def rest(self) -> GyroBias:
        """Estimated bias of the gyro after them."""
        return GyroBias(*self._memory.rest.tolist())

    @property
    def state(self) -> RobustState:
        """State of the detector after them."""
        m = self._memory
        judges = int(m.judged["blocks"][0]) > 0
        estimate = FaultEstimate.unpack(m.judged["estimate"]) if judges else None
        return RobustState(m.samples, m.evidence, m.judged, self._decisions, estimate)

    def advance(self, logs: Array, every: int) -> Iterator[int]:
        """Observe all rows and yield the number of finished ones now and then.

        Args:
          logs: Output, signals of the detector after every row, shape (k, signals).
          every: Rows from one yield to the next.
        """
        while self.done < len(self._rows.time):
            self._observe(logs, min(self.done + every, len(self._rows.time)))
            yield self.done

    def _observe(self, logs: Array, end: int) -> None:
        detector, m = self._detector, self._memory
        watched = self._watch is not None
        while reason := _observe_rows(self._constants, m, self._rows, logs, end, watched):
            if reason == _DECISION_IS_DUE:
                time = float(self._rows.time[self.done])
                self._decisions = decide_block(
                    detector.thresholds, m.evidence, m.judged, self._decisions, time, detector.channels
                )
            elif self._watch is not None:
                state = RobustState(m.samples, m.evidence, m.judged, self._decisions, None)
                self._watch(float(self._rows.time[self.done - 1]), state)
