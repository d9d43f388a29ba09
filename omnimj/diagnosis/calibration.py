"""Thresholds of the robust method from fault-free recordings, at a stated rate of false alarms.

The method runs over the recordings with its decisions switched off; of each statistic the largest value in
every 10 s of motion is kept, and its tail (`tails`) says which level is exceeded as often as may be. Of what
is learnt about the motors the largest of every run is kept, and its spread from run to run says it. A last
pass with the new thresholds says what would still be diagnosed in the same recordings.
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
from omnimj.diagnosis.replay import DatasetProgress, DiagnosisConfig, RunDiagnosis, replay, sample_run
from omnimj.errors import InputError
from omnimj.signals import Array

# How high a statistic comes by chance.

_DOUBT = 0.1  # that β is above its bound


@dataclass(frozen=True)
class Tail:
    """Of one statistic."""

    start: float
    """u, the median of the maxima."""
    often: float
    """How often per hour it is exceeded [1/h]."""
    slope: float
    """Upper bound of β, in the unit of the statistic."""
    largest: float
    """The largest value that was seen."""

    def level(self, rate: float) -> float:
        """What is exceeded `rate` times per hour."""
        return self.start + self.slope * max(math.log(max(self.often, 1e-300) / rate), 0.0)


def fit_tail(maxima: Array, stretch: float) -> Tail:
    """The tail of a statistic.

    Args:
      maxima: Over one stretch each, shape (m,).
      stretch: Length of a stretch [s].
    """
    start = float(np.median(maxima))
    excess = maxima[maxima > start] - start
    k = len(excess)
    if k == 0:
        return Tail(start, 0.0, 0.0, float(maxima.max()))
    often = -math.log1p(-k / len(maxima))
    usual = (np.euler_gamma + math.log(often) + float(exp1(often))) / (k / len(maxima))
    slope = float(excess.mean()) / usual * k / float(gammaincinv(k, _DOUBT))
    return Tail(start, often * 3600.0 / stretch, slope, float(maxima.max()))


@dataclass(frozen=True)
class Spread:
    """Of a number that is learnt, the same for a whole run: it differs from robot to robot, not with time.

    It is the sum of many small errors, taken as normal: the next of k runs exceeds
      m + s √(1 + 1/k) t_{k−1}(1 − p)
    with probability p, Student's t since m and s are estimates themselves.
    """

    mean: float
    slope: float
    """s: standard deviation, in the unit of the statistic."""
    runs: int
    hours: float
    """Of one run [h]."""
    largest: float
    """The largest value that was seen."""

    def level(self, rate: float) -> float:
        """What is exceeded `rate` times per hour."""
        if self.runs < 2:
            return math.inf
        far = float(stdtrit(self.runs - 1, 1.0 - min(rate * self.hours, 0.5)))
        return self.mean + self.slope * math.sqrt(1.0 + 1.0 / self.runs) * far


def fit_spread(maxima: Array, hours: float) -> Spread:
    """The spread of a learnt number.

    Args:
      maxima: Of one run each, shape (k,).
      hours: Of all runs together [h].
    """
    k = len(maxima)
    deviation = float(maxima.std(ddof=1)) if k > 1 else 0.0
    return Spread(float(maxima.mean()), deviation, k, hours / k, float(maxima.max()))


STRETCH = 10.0
"""Of motion: longer than the method's longest window of 1 s, so that maxima do not know of each other [s]."""
TOLERANCE = 0.03
"""By which the torque constant of a healthy motor may be off."""
STATISTICS = len(THRESHOLD_UNITS) - 1
"""Those of `THRESHOLD_UNITS` whose maxima over stretches are taken; the last, a learnt loss, is one number
of a run."""
UPPER_BOUNDS = {"worn": 1.0}
"""What a threshold cannot rise above: more than all of a motor is not lost."""
MIN_STRETCHES = 6
"""Stretches that there must be at least: a minute of motion."""
ADVISED_HOURS = 1.0
"""Hours of motion below which a calibration is warned about [h]."""

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
"""With them nothing is decided."""


@dataclass(frozen=True)
class CalibratedThreshold:
    """One that was set."""

    name: str
    value: float
    tail: Tail | Spread
    floor: float
    """What it may not fall below."""


@dataclass(frozen=True)
class Calibration:
    """What came of it."""

    rate: float
    """False alarms that may be, all thresholds together [1/h of motion]."""
    hours: float
    """Of motion in the recordings."""
    runs: int
    floors: tuple[str, ...]
    """That were driven on."""
    set: tuple[CalibratedThreshold, ...]
    told: tuple[tuple[str, int], ...]
    """Runs in which the method still diagnoses something with these thresholds, and how much."""

    @property
    def thresholds(self) -> Thresholds:
        """For the method."""
        return dataclasses.replace(Thresholds(), **{one.name: one.value for one in self.set})

    @property
    def extrapolated(self) -> float:
        """Hours per false alarm that were asked for, over the hours that there are."""
        return 1.0 / (self.rate * self.hours)


def calibrate(order: DiagnosisConfig, rate: float, progress: DatasetProgress | None = None) -> Calibration:
    """Sets the thresholds.

    Args:
      order: Recordings of a robot without any fault, checked by `check_config`; method `robust`.
      rate: False alarms per hour of motion that may be, above 0.
      progress: For a progress bar.

    Raises:
      InputError: There is too little motion, or a sensor has obviously failed.
    """
    seen = _maxima(order, progress)
    if len(seen.found) < MIN_STRETCHES:
        found = f"has {seen.moved:.3g} s of motion"
        raise InputError(order.dataset.path, found, f"at least {MIN_STRETCHES * STRETCH:g} s are needed")
    floors, share = lower_bounds(rate, _wheels(order)), rate / len(THRESHOLD_UNITS)
    maxima, hours = np.array(seen.found), seen.moved / 3600.0
    tails: list[Tail | Spread] = [fit_tail(maxima[:, k], STRETCH) for k in range(STATISTICS)]
    tails.append(fit_spread(np.array(seen.learnt), hours))
    found = [
        CalibratedThreshold(
            name,
            min(max(tail.level(share), floors[name]), UPPER_BOUNDS.get(name, math.inf)),
            tail,
            floors[name],
        )
        for name, tail in zip(THRESHOLD_UNITS, tails, strict=True)
    ]
    runs = order.dataset.runs
    driven = tuple(sorted({str(run.conditions["floor"]) for run in runs}))
    bare = Calibration(rate, hours, len(runs), driven, tuple(found), ())
    checked = dataclasses.replace(order, thresholds=bare.thresholds)
    told = [(one.name, len(one.diagnoses)) for one in _passes(checked, progress, "checking") if one.diagnoses]
    return dataclasses.replace(bare, told=tuple(told))


def lower_bounds(rate: float, wheels: int) -> dict[str, float]:
    """What each threshold may not fall below.

    Of Λ: h = ln(blocks per false alarm × tests), since by chance alone Λ > h in a block with at most e^{−h}.
    Of the way slipped: the shipped one, below which health was never tried. Of a learnt loss: what motors may
    have from the beginning.

    Args:
      rate: False alarms per hour.
      wheels: n, which makes 2n+2 tests.
    """
    usual = Thresholds()
    per_alarm = 3600.0 / rate / BLOCK
    likely = max(math.log(per_alarm * (2 * wheels + 2)), 1.0)
    return {"motor": likely, "drag": likely, "accelerometer": likely, "slip": usual.slip, "worn": TOLERANCE}


class StretchMaxima:
    """Watches a method: the largest of each statistic in every stretch of motion, and what a run taught."""

    def __init__(self, period: float):
        self._period, self._block = period * samples_per_block(period), -1
        self._now, self._moved = np.zeros(STATISTICS), 0.0
        self.found: list[np.ndarray] = []
        self.learnt: list[float] = []
        self.moved = 0.0

    def next_run(self) -> None:
        """A run begins."""
        self.learnt.append(0.0)

    def __call__(self, state: RobustState) -> None:
        """Takes a state; only a new block says something."""
        if state.blocks == self._block:
            return
        self._block, seen = state.blocks, state.statistics
        self.learnt[-1] = max(self.learnt[-1], seen.worn)
        self._now = np.maximum(self._now, seen[:STATISTICS])
        if state.log[-1] == BLIND:
            return
        self.moved += self._period
        self._moved += self._period
        if self._moved >= STRETCH - 0.5 * self._period:
            self.found.append(self._now)
            self._now, self._moved = np.zeros(STATISTICS), 0.0


def _maxima(order: DiagnosisConfig, progress: DatasetProgress | None) -> StretchMaxima:
    """What is seen of healthy runs while nothing is decided.

    Raises:
      InputError: A sensor stands still while the robot drives.
    """
    seen = StretchMaxima(order.machine.period)
    for one in _passes(dataclasses.replace(order, thresholds=DISABLED), progress, "measuring", seen):
        for d in one.diagnoses:
            place = f"{order.dataset.path}: run {one.name!r}"
            what = f"{d.kind} {d.channel or ', '.join(map(str, d.wheels))}".strip()
            found = f"{what} has failed at {d.time:.4g} s"
            raise InputError(place, found, "thresholds are set with fault-free recordings")
    return seen


def _wheels(order: DiagnosisConfig) -> int:
    return len(order.machine.targets)


def _passes(
    order: DiagnosisConfig,
    progress: DatasetProgress | None,
    phase: str,
    watch: StretchMaxima | None = None,
) -> Sequence[RunDiagnosis]:
    """Every run through the method."""
    runs, found, before = order.dataset.runs, [], 0
    total = sum(len(run.time) for run in runs)
    for run in runs:
        if progress is not None:
            progress(before, total, f"{phase} {run.name}")
        samples = sample_run(run, order.machine)
        if watch is not None:
            watch.next_run()
        one = replay(run, samples, order.machine, order.method_for(run), watch=watch)
        found.append(dataclasses.replace(one, trace=dataclasses.replace(one.trace, columns={})))
        before += len(run.time)
    return found
