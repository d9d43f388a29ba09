"""Assignment of floors to wheels over time: runs of windows with one assignment each, from their currents.

While the assignment stays the same, a wheel's current differs from the expected one by a bias, which the
model's error explains, and by white noise. The bias is integrated out (Gaussian, new with every assignment),
so that a persistent small difference counts as one observation and not as hundreds. From one window to the
next one wheel may change its floor at the price β in log-likelihood, the prior odds of a crossing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.diagnosis.floor_labels.currents import Labels
from omnimj.signals import Array


@dataclass(frozen=True)
class CurrentNoise:
    """Standard deviations of a window's mean current about the expected one."""

    white: float
    """Part that is independent in each window [A]."""
    bias: float
    """Part that lasts as long as the assignment [A]."""


class Evidence:
    """Log-likelihood of runs of windows with one assignment: sums over the windows before each."""

    def __init__(self, measured: Array, expected: Array, noise: CurrentNoise):
        """Sum residuals and their squares.

        Args:
          measured: Mean currents, NaN where unknown, shape (w, n) [A].
          expected: Currents by assignment, shape (assignments, w, n) [A].
          noise: Scatter of the residuals.
        """
        rest = np.nan_to_num(measured - expected)
        self._count = _sums(np.isfinite(measured)[None].astype(float))
        self._sum, self._square = _sums(rest), _sums(rest**2)
        self._white, self._bias = noise.white**2, noise.bias**2
        self.windows, self.assignments = len(measured), len(expected)

    def until(self, first: NDArray[np.int_] | int, last: NDArray[np.int_] | int) -> Array:
        """Log-likelihood of windows first..last−1 under each assignment, up to a constant.

        Per wheel −½ Σe²/s² + ½ b²(Σe)²/(s²(s² + m b²)) − ½ ln(1 + m b²/s²), with m windows, white noise s
        and bias b.

        Args:
          first: First windows; a number or shape (k,).
          last: Windows after the last; a number or shape (k,).

        Returns:
          Shape (assignments,) or (assignments, k).
        """
        first, last = np.broadcast_arrays(first, last)
        m, total, squares = (
            table[:, last] - table[:, first] for table in (self._count, self._sum, self._square)
        )
        ratio = self._bias / (self._white + m * self._bias)
        per_wheel = (ratio * total**2 - squares) / self._white - np.log1p(m * self._bias / self._white)
        return 0.5 * per_wheel.sum(axis=-1)


def _sums(values: Array) -> Array:
    """Sums over the windows before each, with one more at the end, shape (assignments, w + 1, n)."""
    return np.concatenate([np.zeros_like(values[:, :1]), np.cumsum(values, axis=1)], axis=1)


def neighbours(assignments: Labels) -> NDArray[np.bool_]:
    """Mask of the pairs of assignments that differ in one wheel, shape (assignments, assignments)."""
    differ = (assignments[:, None] != assignments[None]).sum(axis=-1)
    return differ == 1


@dataclass(frozen=True)
class LabelPath:
    """Most probable assignment of every window."""

    index: NDArray[np.int_]
    """Index of the assignment, shape (w,)."""
    changes: int
    """Number of changes."""


def label_path(
    evidence: Evidence, one_wheel: NDArray[np.bool_], start: int | None, price: float
) -> LabelPath:
    """Assignments that maximise the log-likelihood less the price of each change.

    Args:
      evidence: Likelihood of runs of windows.
      one_wheel: Which assignments may follow each other, shape (assignments, assignments).
      start: Assignment before the first window; None if unknown.
      price: β, log-likelihood that a change must gain.
    """
    w, count = evidence.windows, evidence.assignments
    if not w:
        return LabelPath(np.zeros(0, int), 0)
    entered = np.full((w, count), -np.inf)  # best score of a run of windows that begins here
    source = np.full((w, count), -1)
    best, began = np.full((w + 1, count), -np.inf), np.zeros((w + 1, count), int)
    entered[0] = _start(start, count, one_wheel, price)
    for t in range(1, w + 1):
        scores = entered[:t].T + evidence.until(np.arange(t), t)
        began[t] = np.argmax(scores, axis=1)
        best[t] = np.take_along_axis(scores, began[t][:, None], axis=1)[:, 0]
        if t < w:
            options = np.where(one_wheel, best[t][:, None], -np.inf)
            source[t] = np.argmax(options, axis=0)
            entered[t] = options.max(axis=0) - price
    return _traced(best[w], began, source, start)


def _start(start: int | None, count: int, one_wheel: NDArray[np.bool_], price: float) -> Array:
    """Scores of the assignments at the first window: the known one, or one wheel changed before it."""
    if start is None:
        return np.full(count, -np.log(count))
    found = np.where(one_wheel[start], -price, -np.inf)
    found[start] = 0.0
    return found


def _traced(last: Array, began: NDArray[np.int_], source: NDArray[np.int_], start: int | None) -> LabelPath:
    """Follow the best path back from the end."""
    end, label = len(began) - 1, int(np.argmax(last))
    index, changes = np.empty(end, int), 0
    while end > 0:
        first = int(began[end, label])
        index[first:end] = label
        if first > 0:
            label, changes = int(source[first, label]), changes + 1
        elif start is not None and label != start:
            changes += 1
        end = first
    return LabelPath(index, changes)


def label_probabilities(
    evidence: Evidence, one_wheel: NDArray[np.bool_], start: int | None, price: float
) -> Array:
    """Probability of every assignment in each window, from all of the run, shape (w, assignments).

    A change of one wheel has the prior odds exp(−β), shared by all assignments that it may lead to.

    Args:
      evidence: Likelihood of runs of windows.
      one_wheel: Which assignments may follow each other.
      start: Assignment before the first window; None if unknown.
      price: β.
    """
    w, count = evidence.windows, evidence.assignments
    if not w:
        return np.zeros((0, count))
    may = np.where(one_wheel, 0.0, -np.inf)
    entered, after = np.full((w, count), -np.inf), np.full((w + 1, count), -np.inf)
    entered[0] = _start(start, count, one_wheel, price)
    for t in range(1, w):
        left = _log_sum(entered[:t].T + evidence.until(np.arange(t), t), 1)
        entered[t] = _log_sum(left[:, None] + may, 0) - price
    after[w] = 0.0
    found = np.zeros((w, count))
    total = None
    for t in range(w - 1, -1, -1):
        ends = np.arange(t + 1, w + 1)
        stays = evidence.until(t, ends) + after[ends].T  # (assignments, ends)
        begun = _log_sum(stays, 1)
        after[t] = _log_sum(begun[None, :] + may, 1) - price
        if t == 0:
            total = float(_log_sum(entered[0] + begun, 0))
    for t in range(w):
        ends = np.arange(t + 1, w + 1)
        share = np.exp(entered[t][:, None] + evidence.until(t, ends) + after[ends].T - total)
        found[t:] += np.cumsum(share[:, ::-1], axis=1)[:, ::-1].T
    return found / found.sum(axis=1, keepdims=True)


def _log_sum(values: Array, axis: int) -> Array:
    """ln Σ exp over an axis; −∞ where all are."""
    most = values.max(axis=axis, keepdims=True)
    safe = np.where(np.isfinite(most), most, 0.0)
    with np.errstate(divide="ignore"):
        return np.log(np.exp(values - safe).sum(axis=axis)) + np.squeeze(safe, axis)
