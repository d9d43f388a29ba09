"""What the gap workflow finds, as frozen records: the command line writes them, the report draws them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from omnimj.signals import Array


@dataclass(frozen=True)
class Interval:
    """A number with its bounds."""

    value: float
    low: float | None
    high: float | None
    unit: str = "1"


@dataclass(frozen=True)
class NamedEffect:
    """One effect that was added to the model."""

    effect: str
    words: str
    """What it is, in plain words."""
    parameters: Mapping[str, Interval]
    """With 90 % intervals."""
    selectors: Mapping[str, str | int]
    """Which channel or wheel, where the effect has such a choice."""
    indistinguishable_from: tuple[str, ...]
    """Rivals that the data do not beat."""
    gain: Interval
    """Share of the held-out mismatch (RMS in units of noise) that it takes away, 90 % interval."""
    p_false: float | None
    """Share of decoys (random curves of the same flexibility) that gain as much."""


@dataclass(frozen=True)
class Place:
    """One channel in one regime and its share of the gap."""

    channel: str
    regime: str
    """In words: `carriage speed above 0.8 m/s`."""
    bounds: Mapping[str, tuple[float, float]]
    """The same as numbers: variable → low, high."""
    share: float
    """Of the squared mismatch over all channels, in units of noise."""
    before: float
    """RMS mismatch there [unit of the channel]."""
    after: float | None = None


@dataclass(frozen=True)
class ChannelGap:
    """RMS mismatch of one channel before and after, and the repeatability floor [unit of the channel]."""

    before: float
    after: float | None
    floor: float | None


@dataclass(frozen=True)
class Refitted:
    """A parameter declared uncertain and what the data make of it."""

    name: str
    unit: str
    nominal: float
    low: float
    high: float
    """The stated uncertainty: nominal ± half-width."""
    fitted: float
    at_bound: bool = False


@dataclass(frozen=True)
class Candidate:
    """How one effect did."""

    label: str
    """Effect, and its selector in brackets: `sensor_delay (wheel_speed)`."""
    screened: float
    """Share of the mismatch that its sensitivities explain at best."""
    gain: Interval | None
    """Held-out gain; None when the screening left it behind."""
    verdict: str
    """`named`, `rival`, `beaten`, `given up` (it led at first), `screened out`, `below the margin`."""
    words: str = ""
    """What it is, in plain words."""
    is_sensor: bool = False
    """Whether it is the measurement and not the machine that would be wrong."""


@dataclass(frozen=True)
class Stage:
    """One round of naming: candidates in the order of their gain, and what the decoys gained."""

    candidates: tuple[Candidate, ...]
    decoys: Array
    """Held-out gains of the decoys, shape (n,)."""
    margin: float


@dataclass(frozen=True)
class Overlay:
    """One run (or window) for pictures: measured, simulated before and after, block means."""

    run: str
    heldout: bool
    time: Array
    """Block centres [s], shape (k,)."""
    measured: Array
    before: Array
    after: Array
    """Shape (k, channels)."""
    conditions: Mapping[str, float | str] = field(default_factory=dict)
    """Of the run: floor, mass, current, …"""
    regimes: Mapping[str, Array] = field(default_factory=dict)
    """Regime variable → its value in every block, shape (k,)."""


@dataclass(frozen=True)
class Finding:
    """All that the workflow found; `gap.json` is its digest, `report.html` its story."""

    dataset: str
    plant: str
    verdict: str
    """`named`, `ambiguous`, `unexplained` or `no_gap`."""
    reason: str
    """Why this verdict, in one or two sentences with numbers."""
    effects: tuple[NamedEffect, ...]
    where: tuple[Place, ...]
    train: Mapping[str, ChannelGap]
    heldout: Mapping[str, ChannelGap]
    shrink: float | None
    next_experiment: Mapping[str, Any] | None
    """`why`, `run` (what to drive), `separates` (names), `parting` (how far the rivals part, in noise)."""
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
    """What the check of the data found: masks, signs, units, delays, biases."""
    samples: int = 0
    effective_samples: float = 0.0
    """N and N_eff of the whitened mismatch."""
    simulations: int = 0
    seconds: float = 0.0
    failure: str = ""
    """Why the work ended early, empty when it did not."""
    regimes: Mapping[str, str] = field(default_factory=dict)
    """Regime variable → its unit."""
