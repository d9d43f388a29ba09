"""Records of the gap workflow, shared by command line and report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.display import Displayed
from omnimj.effects import Interval
from omnimj.estimate.intervals import channel_rms, finite_rms
from omnimj.estimate.replay.steady.traction import TractionCurves
from omnimj.signals import Array


@dataclass(frozen=True)
class NamedEffect:
    """Effect that was added to the model."""

    effect: str
    words: str
    """Description in plain words."""
    parameters: Mapping[str, Interval]
    """Estimates with 90 % intervals."""
    selectors: Mapping[str, str | int]
    """Channel or wheel, where the effect has such a choice."""
    indistinguishable_from: tuple[str, ...]
    """Ambiguity set: rivals that the data do not beat."""
    gain: Interval
    """Reduction of the held-out mismatch (RMS in units of noise), with its 90 % interval."""
    p_false: float | None
    """Share of decoys (random curves of the same flexibility) that gain as much."""


@dataclass(frozen=True)
class MismatchRegime:
    """Channel and regime with its share of the gap."""

    channel: str
    regime: str
    """Description: `carriage speed above 0.8 m/s`."""
    bounds: Mapping[str, tuple[float, float]]
    """Variable → low, high."""
    share: float
    """Share of the squared mismatch over all channels, in units of noise."""
    before: float
    """RMS mismatch in the regime [unit of the channel]."""
    after: float | None = None


@dataclass(frozen=True)
class ChannelGap:
    """RMS mismatch of one channel before and after, and the repeatability floor [unit of the channel]."""

    before: float
    after: float | None
    floor: float | None


@dataclass(frozen=True)
class Refitted:
    """Uncertain parameter and its fitted value."""

    name: str
    unit: str
    nominal: float
    low: float
    high: float
    """`low` and `high` bound the stated uncertainty: nominal ± half-width."""
    fitted: float
    at_bound: bool = False
    stated_by: str = ""
    """Named effect on the same quantity, which states the whole deviation; empty without one."""


@dataclass(frozen=True)
class CandidateResult:
    """Outcome of one candidate effect."""

    label: str
    """Effect, and its selector in brackets: `sensor_delay (wheel_speed)`."""
    screened: float
    """Largest share of the mismatch explained by its sensitivities."""
    gain: Interval | None
    """Held-out gain; None for candidates excluded by the screening."""
    verdict: str
    """`named`, `rival`, `beaten`, `given up` (best at first, eliminated later), `screened out` or
    `below the margin`."""
    words: str = ""
    """Description in plain words."""
    is_sensor: bool = False
    """True for an effect of the measurement, as opposed to the machine."""


UNDETERMINED = "its 90 % interval includes nothing"
"""Reason for which an effect that gains is given up: what it changes is too uncertain to call it present."""


@dataclass(frozen=True)
class GivenUp:
    """Effect that was in the model for a while."""

    label: str
    gain: Interval
    """Held-out gain given the other effects, when it was given up."""
    reason: str

    @property
    def is_undetermined(self) -> bool:
        """True if it gains, but the data do not determine its size."""
        return self.reason == UNDETERMINED


@dataclass(frozen=True)
class Outside:
    """Structure outside the library that was found beside the effects."""

    words: str
    """Description with its size: `a force of 0.49 N that repeats every 0.228 m along the rail`."""
    causes: str
    """Possible causes, as a list in one sentence."""
    values: Mapping[str, float]
    """Its numbers in SI units, by name: `force` and `period`, say."""
    remains: float
    """Held-out mismatch with it, RMS over all channels in units of noise."""


@dataclass(frozen=True)
class Stage:
    """Round of the selection: candidates in the order of their gain, and gains of the decoys."""

    candidates: tuple[CandidateResult, ...]
    decoys: Array
    """Held-out gains of the decoys, shape (n,)."""
    margin: float
    outcome: str = ""
    """Effects that the round added, or the reason for which it added none; empty if it was interrupted."""


@dataclass(frozen=True)
class Overlay:
    """Block means of one run (or window) for plots: measured, simulated before and after."""

    run: str
    heldout: bool
    time: Array
    """Block centres, shape (k,) [s]."""
    measured: Array
    """Measured block means, shape (k, channels) [unit of the channel]."""
    before: Array
    """Simulated block means without the named effects, shape (k, channels)."""
    after: Array
    """Simulated block means with the named effects, shape (k, channels)."""
    conditions: Mapping[str, float | str] = field(default_factory=dict)
    """Conditions of the run: floor, mass, current, …"""
    regimes: Mapping[str, Array] = field(default_factory=dict)
    """Regime variable → its value in every block, shape (k,)."""


@dataclass(frozen=True)
class Finding(Displayed):
    """Complete outcome of the gap workflow; `gap.json` is its digest, `report.html` its report."""

    dataset: str
    plant: str
    verdict: str
    """`named`, `ambiguous`, `unexplained` or `no_gap`."""
    reason: str
    """Reason of the verdict, in one or two sentences with numbers."""
    effects: tuple[NamedEffect, ...]
    where: tuple[MismatchRegime, ...]
    train: Mapping[str, ChannelGap]
    heldout: Mapping[str, ChannelGap]
    shrink: float | None
    next_experiment: Mapping[str, Any] | None
    """`why`, `run` (its settings), `separates` (names), `parting` (distance in units of noise)."""
    channels: Mapping[str, tuple[str, str]]
    """Channel → unit, words."""
    noise: Mapping[str, float]
    """Noise of one block mean per channel [unit of the channel]."""
    heldout_runs: tuple[str, ...]
    refitted: tuple[Refitted, ...]
    stages: tuple[Stage, ...]
    flexible: Mapping[str, float] = field(default_factory=dict)
    """Regime variable → share of the remaining held-out mismatch that a free curve of it explains."""
    overlays: tuple[Overlay, ...] = ()
    data_notes: tuple[str, ...] = ()
    """Notes of the data check: units, signs, delays, biases, corrections, masks."""
    data_faults: tuple[Mapping[str, Any], ...] = ()
    """Findings of the data check, the most important first: `channel`, `kind`, `size`, `sure`, `words`, …"""
    samples: int = 0
    effective_samples: float = 0.0
    """N and N_eff of the whitened mismatch."""
    simulations: int = 0
    seconds: float = 0.0
    failure: str = ""
    """Reason of an early end, empty otherwise."""
    regimes: Mapping[str, str] = field(default_factory=dict)
    """Regime variable → its unit."""
    remains: float | None = None
    """Held-out mismatch of the last model, RMS over all channels in units of noise."""
    outside: Outside | None = None
    """Structure outside the library: in no model file, and left out of all mismatches after the effects."""
    tolerated: tuple[str, ...] = ()
    """Labels of effects that would explain the gap, but within the tolerance of the equations."""
    undetermined: GivenUp | None = None
    """Where nothing is named, the effect that gains most of those whose size the data do not determine."""
    incomplete: bool = False
    """True if effects are named and something else is missing as well."""
    given_up: tuple[GivenUp, ...] = ()
    """Effects that were in the model for a while, the largest gain first."""
    traction: tuple[TractionCurves, ...] = ()
    """Traction over slip by floor, of robots on steady drives."""
    ended: str = ""
    """Reason for which the search added nothing more; empty if it was interrupted."""
    model: Path | None = None
    """Model file that the dataset names."""
    heldout_total: tuple[float | None, float | None] = (None, None)
    """Held-out mismatch before and after, RMS over all channels in units of their noise."""


@dataclass(frozen=True)
class RunGap:
    """RMS mismatch of one run before and after."""

    run: str
    heldout: bool
    """True if the run, or a part of it, was held out."""
    partly: bool
    """True if only some of its windows were held out."""
    conditions: Mapping[str, float | str]
    before: Mapping[str, float]
    """Channel → RMS [unit of the channel]."""
    after: Mapping[str, float] | None
    total_before: float
    """RMS over all channels in units of their noise."""
    total_after: float | None


def has_second_model(finding: Finding) -> bool:
    """True if a finding has a second model to compare with."""
    gaps = [*finding.heldout.values(), *finding.train.values()]
    return any(gap.after is not None for gap in gaps)


def noise_row(finding: Finding) -> Array:
    """Noise of a block mean in the order of the channels, shape (channels,); 1 where unknown."""
    row = np.array([finding.noise.get(name, np.nan) for name in finding.channels], float)
    return np.where(np.isfinite(row) & (row > 0.0), row, 1.0)


def overlays_by_run(finding: Finding) -> dict[str, list[Overlay]]:
    """Overlays by run, windows of one run in the order of time."""
    runs: dict[str, list[Overlay]] = {}
    for overlay in finding.overlays:
        runs.setdefault(overlay.run, []).append(overlay)
    return {run: sorted(windows, key=lambda o: float(o.time[0])) for run, windows in runs.items()}


def run_gaps(finding: Finding) -> tuple[RunGap, ...]:
    """List the gap of every run with an overlay, the largest mismatch in units of noise first."""
    second = has_second_model(finding)
    found = [_of_run(finding, run, windows, second) for run, windows in overlays_by_run(finding).items()]
    return tuple(sorted(found, key=lambda gap: -gap.total_before))


def worst_run(finding: Finding) -> str | None:
    """Held-out run with the largest mismatch before; a training run if none is held out."""
    gaps = _heldout_gaps(finding)
    return gaps[0].run if gaps else None


def typical_run(finding: Finding) -> str | None:
    """Held-out run in the middle of their order; None when that is the worst one too."""
    gaps = _heldout_gaps(finding)
    return gaps[len(gaps) // 2].run if len(gaps) > 1 else None


def _heldout_gaps(finding: Finding) -> list[RunGap]:
    gaps = list(run_gaps(finding))
    return [gap for gap in gaps if gap.heldout] or gaps


def _of_run(finding: Finding, run: str, windows: Sequence[Overlay], second: bool) -> RunGap:
    noise = noise_row(finding)
    before = channel_rms(np.concatenate([w.measured - w.before for w in windows]))
    after = channel_rms(np.concatenate([w.measured - w.after for w in windows])) if second else None
    names = list(finding.channels)
    return RunGap(
        run,
        any(window.heldout for window in windows),
        len({window.heldout for window in windows}) == 2,
        windows[0].conditions,
        dict(zip(names, before.tolist(), strict=True)),
        None if after is None else dict(zip(names, after.tolist(), strict=True)),
        finite_rms(before / noise),
        None if after is None else finite_rms(after / noise),
    )
