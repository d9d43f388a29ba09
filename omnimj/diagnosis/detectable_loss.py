"""Which loss of a motor a threshold leaves detectable in given recordings, and after what delay.

A loss d of the torque constant of motor j lets the same torque need the current i/(1 − d). With the window w
behind the onset, column x_j and S, N as in `glr`, the fault-free recording would show
  Λ_w = N (S/N + g d/(1 − d))² / 2 / misfit
since the column grows by 1/(1 − d) and the balance by x_j d/(1 − d), of which δ_j and the excess of mass and
inertia that have been learnt explain a part: g = 1 − δ_j − (μ + ι)/2. Λ is expected to cross the threshold h
as soon as a window that lies behind the onset has the information
  N ≥ 2 h misfit / (S/N + g d/(1 − d))².
S is the recording's own, so that the misfit of a wrong model counts. The second route injects the loss into
the measured currents and runs the detector.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.control.detection.robust.blocks import BLOCK
from omnimj.control.detection.robust.detector import BLIND, RobustState
from omnimj.control.detection.robust.force_balance import mass_column
from omnimj.control.detection.robust.glr import (
    FILLED,
    HEAD,
    LONGEST_WINDOW,
    WINDOWS,
    coloured_variance,
)
from omnimj.control.detection.robust.parameter_filter import ParameterModel
from omnimj.diagnosis.logs import Machine, SampledRun, Segment
from omnimj.signals import Array

LOSSES = tuple(round(0.05 * k, 2) for k in range(1, 20))
"""Losses that are tried, 5 … 95 %."""
HORIZON = 2.0
"""Time after the onset in which a loss must be detected [s]; later the parameter filter learns from it."""
HALF = 0.5
"""Share of the onsets from which a loss counts as detectable."""
EVERY = 10
"""Blocks from one onset to the next, 0.1 s."""


@dataclass(frozen=True)
class DetectableLoss:
    """Smallest loss that a threshold leaves detectable."""

    loss: float | None
    """Loss of the torque constant; None: not even the largest of `LOSSES` is detected."""
    delay: float | None
    """Median time from the onset to the crossing of the threshold, of the detected ones [s]."""
    share: float
    """Share of the onsets during motion after which it is detected within `HORIZON`; where `loss` is None,
    that of the largest tried loss."""


@dataclass(frozen=True)
class InjectedLoss:
    """Result of injecting a loss into the recordings."""

    loss: float
    found: int
    """Onsets after which the motor was diagnosed within `HORIZON`."""
    tried: int
    delay: float | None
    """Median delay of the found ones [s]."""

    @property
    def is_found(self) -> bool:
        """True if it was found after at least half of the onsets."""
        return self.found >= HALF * max(self.tried, 1)


class LossInformation:
    """Collector of information and score of each motor and window, by `EVERY` blocks of motion.

    Args:
      wheels: n.
      model: Parameter model of the detector.
    """

    def __init__(self, wheels: int, model: ParameterModel):
        self._wheels, self._short_term = wheels, model.short_term
        self._run = -1
        self._rows: list[tuple[int, float, Array]] = []

    def next_run(self) -> None:
        """Begin a run."""
        self._run += 1

    def __call__(self, time: float, state: RobustState) -> None:
        """Take the state of the detector after a block, with its decisions switched off."""
        if state.blocks % EVERY or state.log[-1] == BLIND:
            return
        self._rows.append((self._run, time, self._scores(state)))

    def _scores(self, state: RobustState) -> Array:
        """N, S/N, misfit and gain, shape (4, windows, n); N = 0 for a window that is not full."""
        n, theta = self._wheels, state.evidence.theta
        p, history = theta.size, state.evidence.history
        ring, cursor = history.ring, history.cursor
        filled, out = int(cursor[FILLED]), np.zeros((4, len(WINDOWS), n))
        out[2] = 1.0
        body = 0.5 * (theta[mass_column(n)] + theta[mass_column(n) + 1])
        out[3] = 1.0 - theta[:n] - body
        rows = ring[(cursor[HEAD] - np.arange(filled)) % LONGEST_WINDOW]
        x = rows[:, : 3 * p].reshape(-1, p)
        r = rows[:, 3 * p : 3 * (p + 1)].reshape(-1) - x @ theta
        precision = np.linalg.inv(state.evidence.cov + np.diag(self._short_term))
        inverse = np.linalg.inv(precision + x.T @ x)
        free = inverse @ (x.T @ r)
        for w, length in enumerate(WINDOWS):
            if length > filled:
                break
            own, rest = x[: 3 * length], r[: 3 * length]
            gram = own.T @ own
            columns = gram[:, :n]
            information = np.diag(gram)[:n] - np.einsum("pj,pq,qj->j", columns, inverse, columns)
            score = own[:, :n].T @ rest - columns.T @ free
            left = float(((rest - own @ free) ** 2).sum()) / (3.0 * length)
            informative = information > 1e-6
            out[0, w] = np.where(informative, information, 0.0)
            out[1, w] = np.where(informative, score / np.where(informative, information, 1.0), 0.0)
            out[2, w] = max(1.0, left) * coloured_variance(state.evidence.usual)
        return out

    @property
    def onsets(self) -> list[tuple[int, float]]:
        """Run and time [s] of every considered onset."""
        return [(run, time) for run, time, _ in self._rows]

    def delays(self, loss: float, threshold: float) -> Array:
        """Expected delay of each motor at each onset, ∞ where it is not detected, shape (onsets, n) [s].

        Args:
          loss: d.
          threshold: h [nats].
        """
        if not self._rows:
            return np.empty((0, self._wheels))
        run = np.array([one for one, _, _ in self._rows])
        time = np.array([one for _, one, _ in self._rows])
        n_, mean, misfit, gain = np.stack([scores for _, _, scores in self._rows], axis=1)
        seen = mean + gain * loss / (1.0 - loss)
        crossed = (seen > 0.0) & (0.5 * n_ * seen**2 >= threshold * misfit)
        found = np.full((len(time), self._wheels), np.inf)
        for ahead in range(1, round(HORIZON / (EVERY * BLOCK)) + 1):
            passed = time[ahead:] - time[: len(time) - ahead]
            same = (run[ahead:] == run[: len(time) - ahead]) & (passed < HORIZON + 0.5 * BLOCK)
            for w, length in enumerate(WINDOWS):
                window = length * BLOCK
                # a window behind the onset, before which at least as much of the healthy robot is left
                most = HORIZON if length == LONGEST_WINDOW else 2.0 * window
                fits = same & (passed > window - 0.5 * BLOCK) & (passed < max(most, EVERY * BLOCK) + 1e-9)
                new = np.where(fits[:, None] & crossed[ahead:, w], passed[:, None], np.inf)
                found[: len(time) - ahead] = np.minimum(found[: len(time) - ahead], new)
        return found

    def detectable(self, threshold: float) -> DetectableLoss:
        """Smallest of `LOSSES` that is expected to be detected after at least half of the onsets."""
        share = 0.0
        for loss in LOSSES:
            delays = self.delays(loss, threshold)
            share = float(np.isfinite(delays).mean()) if delays.size else 0.0
            if share >= HALF:
                return DetectableLoss(loss, float(np.median(delays[np.isfinite(delays)])), share)
        return DetectableLoss(None, None, share)


def with_loss(samples: SampledRun, machine: Machine, wheel: int, loss: float, onset: float) -> SampledRun:
    """Recording in which a motor loses torque constant: the same torque needs the current i/(1 − d).

    The set current grows alike, since the amplifier obeys. The recording ends `HORIZON` after the onset.

    Args:
      samples: Of a healthy robot.
      machine: Names the channels.
      wheel: 1 … n.
      loss: d.
      onset: [s].
    """
    column, segments = machine.channels.index(f"current_{wheel}"), []
    for one in samples.segments:
        rows = one.time <= onset + HORIZON
        factor = np.where(one.time[rows] >= onset, 1.0 / (1.0 - loss), 1.0)
        columns, command = one.columns[rows].copy(), one.command
        columns[:, column] *= factor
        if command is not None:
            command = command[rows].copy()
            command[:, wheel - 1] *= factor
        if len(columns):
            segments.append(Segment(one.time[rows], columns, command))
    return dataclasses.replace(samples, segments=tuple(segments))


def summarize_injections(loss: float, delays: Sequence[float]) -> InjectedLoss:
    """Summarise delays of an injected loss [s]; ∞: not found."""
    found = [one for one in delays if math.isfinite(one)]
    return InjectedLoss(loss, len(found), len(delays), float(np.median(found)) if found else None)


def spread_onsets(
    onsets: Sequence[tuple[int, float]], ends: Mapping[int, float], wheels: int, most: int
) -> list[tuple[int, float, int]]:
    """Run, time [s] and wheel 1 … n of at most so many onsets, evenly spread over those of all runs.

    Args:
      onsets: From `LossInformation.onsets`.
      ends: End of each run [s]; an onset needs `HORIZON` before it.
      wheels: n, taken in turn.
      most: Number of onsets.
    """
    usable = [(run, time) for run, time in onsets if time + HORIZON <= ends[run]]
    if not usable:
        return []
    rows = np.unique(np.linspace(0, len(usable) - 1, most).astype(int))
    return [(*usable[row], k % wheels + 1) for k, row in enumerate(rows.tolist())]
