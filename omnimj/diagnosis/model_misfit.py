"""Whether calibrated thresholds show that the model is wrong: what a raised threshold costs, and why it rose.

A threshold that rises far beyond the shipped one would hide every fault that is smaller than the model's own
error. A calibration therefore states in which driving regime the statistics were largest, and which loss of a
motor is still detected.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.control.detection.robust.detector import RobustDetector
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.diagnosis.detectable_loss import (
    LOSSES,
    DetectableLoss,
    InjectedLoss,
    LossInformation,
    spread_onsets,
    summarize_injections,
    with_loss,
)
from omnimj.diagnosis.driving_regimes import DrivenRegimes, Regime, driven_regimes, regime_of
from omnimj.diagnosis.replay import DatasetProgress, DiagnosisConfig, replay, replay_all, sample_run
from omnimj.parameters import Robot

MOST_RISE = 1.5
"""Ratio to the shipped threshold beyond which a calibrated one is held back."""
LARGEST = 10
"""Number of largest maxima whose regime is stated."""
INJECTIONS = 40
"""Number of losses that are injected into the recordings."""

Place = tuple[int, float, float]
"""Run and time interval [s] of a maximum."""


@dataclass(frozen=True)
class RaisedThreshold:
    """Threshold that rose beyond `MOST_RISE` times the shipped one."""

    name: str
    value: float
    shipped: float
    is_seen: bool
    """True if the statistic exceeded the shipped threshold; else its tail is extrapolated beyond it."""
    regime: Regime | None
    """Where the statistic was largest; None for the learnt loss, which belongs to a whole run."""


@dataclass(frozen=True)
class ModelMisfit:
    """Cost of raised thresholds."""

    raised: tuple[RaisedThreshold, ...]
    motor: DetectableLoss
    """Loss that the calibrated threshold leaves detectable."""
    shipped_motor: DetectableLoss
    """The same with the shipped threshold."""
    injected: tuple[InjectedLoss, ...]
    """`motor.loss` and, until one is found after half of the onsets, larger ones, injected into the
    recordings."""


def raised_thresholds(
    config: DiagnosisConfig,
    values: Mapping[str, float],
    largest: Mapping[str, float],
    places: Mapping[str, Sequence[tuple[float, Place]]],
) -> tuple[RaisedThreshold, ...]:
    """Thresholds beyond `MOST_RISE` times the shipped ones, with the regimes of their statistics.

    Args:
      config: The recordings.
      values: Calibrated thresholds by name.
      largest: Largest value of each statistic in the recordings.
      places: Maxima of each statistic over stretches, and their places.
    """
    usual = Thresholds()._asdict()
    names = [name for name, value in values.items() if value > MOST_RISE * usual[name]]
    driven = _driven(config) if names else []
    found = []
    for name in names:
        regime = None
        if places.get(name):
            ordered = sorted(places[name], key=lambda one: -one[0])[:LARGEST]
            regime = regime_of([driven[run].between(*when) for _, (run, *when) in ordered], driven)
        seen = largest[name] > usual[name]
        found.append(RaisedThreshold(name, values[name], usual[name], seen, regime))
    return tuple(found)


def _driven(config: DiagnosisConfig) -> list[DrivenRegimes]:
    robot = config.machine.constants
    assert isinstance(robot, Robot)
    n = len(robot.wheels)
    names = [f"wheel_speed_{i}" for i in range(1, n + 1)]
    return [
        driven_regimes(run.time, np.column_stack([run.columns[name] for name in names]), robot)
        for run in config.dataset.runs
    ]


def misfit(
    config: DiagnosisConfig,
    disabled: Thresholds,
    thresholds: Thresholds,
    raised: tuple[RaisedThreshold, ...],
    progress: DatasetProgress | None,
) -> ModelMisfit:
    """Cost of raised thresholds: the loss of a motor that stays detectable, expected and injected.

    Args:
      config: The recordings.
      disabled: Thresholds with which the detector makes no decision.
      thresholds: Calibrated thresholds.
      raised: From `raised_thresholds`.
      progress: Progress callback.
    """
    quiet = dataclasses.replace(config, thresholds=disabled)
    detector = quiet.detector_for(config.dataset.runs[0])
    assert isinstance(detector, RobustDetector)
    information = LossInformation(detector.wheels, detector.constants.model)
    replay_all(quiet, progress, "weighing", information)
    motor = information.detectable(thresholds.motor)
    decided = dataclasses.replace(config, thresholds=thresholds)
    injected: list[InjectedLoss] = []
    first = len(LOSSES) if motor.loss is None else LOSSES.index(motor.loss)
    for loss in LOSSES[first::2]:
        injected.append(inject(decided, loss, information.onsets, detector.wheels))
        if injected[-1].is_found:
            break
    return ModelMisfit(raised, motor, information.detectable(Thresholds().motor), tuple(injected))


def inject(
    config: DiagnosisConfig, loss: float, onsets: Sequence[tuple[int, float]], wheels: int
) -> InjectedLoss:
    """Inject a loss at some of the onsets and run the detector.

    Args:
      config: The recordings and the thresholds.
      loss: d.
      onsets: Run and time [s] of possible onsets.
      wheels: n.
    """
    runs, machine, delays = config.dataset.runs, config.machine, []
    ends = {k: float(run.time[-1]) for k, run in enumerate(runs)}
    sampled = {}
    for k, onset, wheel in spread_onsets(onsets, ends, wheels, INJECTIONS):
        if k not in sampled:
            sampled = {k: sample_run(runs[k], machine)}
        samples = with_loss(sampled[k], machine, wheel, loss, onset)
        found = replay(runs[k], samples, machine, config.detector_for(runs[k])).diagnoses
        times = [d.time - onset for d in found if d.kind == "motor" and wheel in d.wheels]
        delays.append(min((time for time in times if time >= 0.0), default=float("inf")))
    return summarize_injections(loss, delays)
