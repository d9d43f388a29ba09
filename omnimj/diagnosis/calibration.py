"""Thresholds of the robust method from fault-free recordings, at a stated rate of false alarms.

The detector runs over the recordings with its decisions switched off. The maxima of each statistic over 10 s
of motion have an exponential tail, which gives the level exceeded at the stated rate. The estimated losses
of the motors differ from run to run only; their threshold follows from the spread of the maxima per run. A
last pass with the new thresholds counts the diagnoses that remain in the same recordings.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import exp1, gammaincinv, stdtrit

from omnimj.control.detection.robust.blocks import BLOCK, samples_per_block
from omnimj.control.detection.robust.detector import BLIND, RobustState
from omnimj.control.detection.robust.thresholds import THRESHOLD_UNITS, Thresholds
from omnimj.diagnosis.model_misfit import ModelMisfit, Place, misfit, raised_thresholds
from omnimj.diagnosis.replay import DatasetProgress, DiagnosisConfig, replay_all
from omnimj.display import Displayed
from omnimj.errors import InputError
from omnimj.signals import Array

_RISK = 0.1  # probability that β is above its bound


@dataclass(frozen=True)
class Tail:
    """Exponential tail of a statistic without a fault."""

    start: float
    """u, the median of the maxima."""
    often: float
    """Rate at which u is exceeded [1/h]."""
    slope: float
    """Upper bound of β, in the unit of the statistic."""
    largest: float
    """Largest observed value."""

    def level(self, rate: float) -> float:
        """Return the level that is exceeded `rate` times per hour."""
        return self.start + self.slope * max(math.log(max(self.often, 1e-300) / rate), 0.0)


def fit_tail(maxima: Array, stretch: float) -> Tail:
    """Fit the tail of a statistic.

    Args:
      maxima: Maxima over one stretch each, shape (m,).
      stretch: Duration of a stretch [s].
    """
    start = float(np.median(maxima))
    excess = maxima[maxima > start] - start
    k = len(excess)
    if k == 0:
        return Tail(start, 0.0, 0.0, float(maxima.max()))
    often = -math.log1p(-k / len(maxima))
    usual = (np.euler_gamma + math.log(often) + float(exp1(often))) / (k / len(maxima))
    slope = float(excess.mean()) / usual * k / float(gammaincinv(k, _RISK))
    return Tail(start, often * 3600.0 / stretch, slope, float(maxima.max()))


@dataclass(frozen=True)
class Spread:
    """Spread of an estimate between runs: it differs from robot to robot, not with time.

    The estimate is assumed normal. After k runs the next one exceeds
      m + s √(1 + 1/k) t_{k−1}(1 − p)
    with probability p; Student's t, since m and s are estimated.
    """

    mean: float
    """m, in the unit of the estimate."""
    slope: float
    """s, the standard deviation."""
    runs: int
    hours: float
    """Mean duration of a run [h]."""
    largest: float
    """Largest observed value."""

    def level(self, rate: float) -> float:
        """Return the level that is exceeded `rate` times per hour."""
        if self.runs < 2:
            return math.inf
        far = float(stdtrit(self.runs - 1, 1.0 - min(rate * self.hours, 0.5)))
        return self.mean + self.slope * math.sqrt(1.0 + 1.0 / self.runs) * far


def fit_spread(maxima: Array, hours: float) -> Spread:
    """Fit the spread of an estimate.

    Args:
      maxima: Maxima over one run each, shape (k,).
      hours: Duration of all runs together [h].
    """
    k = len(maxima)
    deviation = float(maxima.std(ddof=1)) if k > 1 else 0.0
    return Spread(float(maxima.mean()), deviation, k, hours / k, float(maxima.max()))


STRETCH = 10.0
"""Duration of motion per maximum [s]; longer than the windows of 1 s, so that maxima are independent."""
TOLERANCE = 0.03
"""Tolerance of the torque constant of a healthy motor, relative."""
STATISTICS = len(THRESHOLD_UNITS) - 1
"""Number of statistics with maxima over stretches; the last of `THRESHOLD_UNITS`, a loss, has one per run."""
UPPER_BOUNDS = {"worn": 1.0}
"""Upper bounds of thresholds: a motor cannot lose more than all of its effectiveness."""
MIN_STRETCHES = 6
"""Smallest number of stretches for a calibration, a minute of motion."""
ADVISED_HOURS = 1.0
"""Duration of motion below which a warning is given [h]."""

_SLIP_TIME = 0.1  # [s] in which a slipped distance builds up
_NEVER = 10**9  # blocks
DISABLED = Thresholds(
    motor=math.inf,
    drag=math.inf,
    accelerometer=math.inf,
    slip=math.inf,
    worn=math.inf,
    turning=math.inf,
    current=_NEVER,
    stuck=_NEVER,
    odd=_NEVER,
)
"""Thresholds with which the detector makes no decision."""


@dataclass(frozen=True)
class CalibratedThreshold:
    """Calibrated threshold."""

    name: str
    value: float
    tail: Tail | Spread
    floor: float
    """Lower bound of the threshold."""


@dataclass(frozen=True)
class Calibration(Displayed):
    """Result of a calibration."""

    rate: float
    """Permitted rate of false alarms, all thresholds together [1/h of motion]."""
    hours: float
    """Duration of motion in the recordings [h]."""
    runs: int
    floors: tuple[str, ...]
    """Floors in the recordings."""
    set: tuple[CalibratedThreshold, ...]
    remaining: tuple[tuple[str, int], ...]
    """Runs that still have diagnoses with these thresholds, and how many."""
    misfit: ModelMisfit | None = None
    """Cost of thresholds far beyond the shipped ones; None: there are none."""

    @property
    def thresholds(self) -> Thresholds:
        """Thresholds of the robust method."""
        return Thresholds()._replace(**{one.name: one.value for one in self.set})

    @property
    def extrapolated(self) -> float:
        """Required hours per false alarm over the recorded hours."""
        return 1.0 / (self.rate * self.hours)


def calibrate(config: DiagnosisConfig, rate: float, progress: DatasetProgress | None = None) -> Calibration:
    """Calibrate the thresholds of the robust method.

    Args:
      config: Recordings of a robot without any fault, checked by `check_config`; method `robust`.
      rate: Permitted false alarms per hour of motion, above 0.
      progress: Progress callback.

    Raises:
      InputError: There is too little motion, or a sensor has obviously failed.
    """
    seen = _maxima(config, progress)
    if len(seen.found) < MIN_STRETCHES:
        found = f"has {seen.moved:.3g} s of motion"
        raise InputError(config.dataset.path, found, f"at least {MIN_STRETCHES * STRETCH:g} s are needed")
    floors, share = lower_bounds(rate, _wheels(config)), rate / len(THRESHOLD_UNITS)
    maxima, hours = np.array(seen.found), seen.moved / 3600.0
    tails: list[Tail | Spread] = [fit_tail(maxima[:, k], STRETCH) for k in range(STATISTICS)]
    tails.append(fit_spread(np.array(seen.losses), hours))
    found = [
        CalibratedThreshold(
            name,
            min(max(tail.level(share), floors[name]), UPPER_BOUNDS.get(name, math.inf)),
            tail,
            floors[name],
        )
        for name, tail in zip(THRESHOLD_UNITS, tails, strict=True)
    ]
    runs = config.dataset.runs
    driven = tuple(sorted({str(run.conditions["floor"]) for run in runs}))
    bare = Calibration(
        rate, hours, len(runs), driven, tuple(found), (), _misfit(config, found, seen, progress)
    )
    checked = dataclasses.replace(config, thresholds=bare.thresholds)
    remaining = [
        (one.name, len(one.diagnoses)) for one in replay_all(checked, progress, "checking") if one.diagnoses
    ]
    return dataclasses.replace(bare, remaining=tuple(remaining))


def _misfit(
    config: DiagnosisConfig,
    found: Sequence[CalibratedThreshold],
    seen: StretchMaxima,
    progress: DatasetProgress | None,
) -> ModelMisfit | None:
    """Return the cost of thresholds far beyond the shipped ones; None if there are none."""
    values = {one.name: one.value for one in found}
    largest = {one.name: one.tail.largest for one in found}
    places = {
        name: [(maxima[k], where[k]) for maxima, where in zip(seen.found, seen.places, strict=True)]
        for k, name in enumerate(THRESHOLD_UNITS)
        if k < STATISTICS
    }
    raised = raised_thresholds(config, values, largest, places)
    if not raised:
        return None
    return misfit(config, DISABLED, Thresholds()._replace(**values), raised, progress)


def lower_bounds(rate: float, wheels: int) -> dict[str, float]:
    """Return the lower bounds of the thresholds for permitted false alarms per hour [1/h] and n wheels.

    For Λ: h = ln(blocks per false alarm × tests), since without a fault Λ > h in a block with a probability
    of at most e^{−h}; n wheels give 2n + 2 tests. For the slipped distance: the shipped threshold. For a
    loss: the tolerance of healthy motors.
    """
    usual = Thresholds()
    per_alarm = 3600.0 / rate / BLOCK
    likely = max(math.log(per_alarm * (2 * wheels + 2)), 1.0)
    return {"motor": likely, "drag": likely, "accelerometer": likely, "slip": usual.slip, "worn": TOLERANCE}


class StretchMaxima:
    """Collector of the maxima of each statistic over stretches of motion, and of the losses per run."""

    def __init__(self, period: float):
        self._period = period * samples_per_block(period)
        self._run, self._moved = -1, 0.0
        self._now, self._where = np.zeros(STATISTICS), [(0, 0.0, 0.0)] * STATISTICS
        self.found: list[np.ndarray] = []
        self.places: list[list[Place]] = []
        """Run and time interval [s] behind each of the maxima."""
        self.losses: list[float] = []
        self.moved = 0.0

    def next_run(self) -> None:
        """Begin a run."""
        self.losses.append(0.0)
        self._run += 1

    def __call__(self, time: float, state: RobustState) -> None:
        """Update the maxima with the state of the detector after a block."""
        seen = state.statistics
        self.losses[-1] = max(self.losses[-1], seen.worn)
        for k in np.flatnonzero(np.array(seen[:STATISTICS]) > self._now).tolist():
            self._now[k] = seen[k]
            self._where[k] = self._run, time - _evidence_time(state, k, self._period), time
        if state.log[-1] == BLIND:
            return
        self.moved += self._period
        self._moved += self._period
        if self._moved >= STRETCH - 0.5 * self._period:
            self.found.append(self._now)
            self.places.append(self._where)
            self._moved = 0.0
            self._now, self._where = np.zeros(STATISTICS), [(self._run, time, time)] * STATISTICS


def _evidence_time(state: RobustState, statistic: int, period: float) -> float:
    """Return the duration of the window behind the largest value of a statistic [s]."""
    scores, n = state.evidence.scores, len(state.evidence.force)
    groups = (slice(0, n), slice(n, 2 * n), slice(2 * n, None))
    if statistic >= len(groups):
        return _SLIP_TIME
    own = groups[statistic]
    return float(scores.window[own][np.argmax(scores.likelihood[own])]) * period


def _maxima(config: DiagnosisConfig, progress: DatasetProgress | None) -> StretchMaxima:
    """Return the maxima of healthy runs without decisions.

    Raises:
      InputError: A sensor is frozen while the robot drives.
    """
    seen = StretchMaxima(config.machine.period)
    for one in replay_all(dataclasses.replace(config, thresholds=DISABLED), progress, "measuring", seen):
        for d in one.diagnoses:
            place = f"{config.dataset.path}: run {one.name!r}"
            what = f"{d.kind} {d.channel or ', '.join(map(str, d.wheels))}".strip()
            found = f"{what} has failed at {d.time:.4g} s"
            raise InputError(place, found, "calibration needs fault-free recordings")
    return seen


def _wheels(config: DiagnosisConfig) -> int:
    return len(config.machine.targets)
