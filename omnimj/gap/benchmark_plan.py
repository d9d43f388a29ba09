"""The runs of a benchmark dataset: constant, ramped, pulsed and reversed currents, straight and sideways."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnimj.parameters import Rig
from omnimj.signals import Array

_REST = 0.1  # [s] without current at the start: the accelerometer shows its offset
_SPREAD = 0.08  # share by which a current is drawn off its nominal value


@dataclass(frozen=True)
class PlannedRun:
    """One run; repeats share their condition."""

    name: str
    condition: str
    current: Array
    """Set values, one per sample, shape (k,) [A]."""
    floor: str
    mass: float
    """As declared [kg]."""
    lateral_speed: float
    session: float
    """Where in the series it is, 0 … 1."""


# profile, current [A], index of the mass, floor, lateral speed [m/s], repeats
_PLAN = (
    ("constant", 0.45, 0, "natural_stone", 0.0, 2),
    ("reversing", 0.90, 0, "natural_stone", 0.0, 2),
    ("ramp", 1.50, 1, "pvc", 0.0, 1),
    ("pulse", 1.05, 2, "paperboard", 0.0, 1),
    ("reversing", 0.75, 0, "paperboard", 0.0, 1),
    ("constant", 1.50, 2, "natural_stone", 0.0, 1),
    ("pulse", 0.75, 0, "pvc", 0.0, 2),
    ("reversing", 0.35, 1, "pvc", 0.0, 1),
    ("constant", 0.75, 0, "natural_stone", 0.35, 2),
    ("reversing", 0.90, 1, "natural_stone", -0.30, 1),
    ("ramp", 1.20, 0, "pvc", 0.25, 1),
    ("constant", 1.05, 2, "paperboard", -0.25, 1),
)


def planned_runs(rig: Rig, seed: int, seconds: float = 1.8, conditions: int = len(_PLAN)) -> list[PlannedRun]:
    """The runs of one dataset.

    Args:
      rig: The nominal rig: masses, rate.
      seed: Currents differ a little from dataset to dataset.
      seconds: Length of a run that does not come to the rail's end before.
      conditions: How many of the twelve, from the first on.
    """
    random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,)))
    runs = []
    for k, (profile, current, mass, floor, lateral, repeats) in enumerate(_PLAN[:conditions]):
        size = current * (1.0 + _SPREAD * float(random.uniform(-1.0, 1.0)))
        values = profiled(profile, min(size, 1.5), seconds, rig.sensors.sample_rate)
        name, load = f"run_{k:02d}", rig.rig.masses[mass]
        runs += [(f"{name}{letter}", name, values, floor, load, lateral) for letter in "ab"[:repeats]]
    last = max(len(runs) - 1, 1)
    return [PlannedRun(*run, session=k / last) for k, run in enumerate(runs)]


def profiled(profile: str, size: float, seconds: float, rate: float) -> Array:
    """Current over time, shape (seconds · rate + 1,) [A]: rest, then the profile."""
    time = np.arange(round(seconds * rate) + 1) / rate
    since = time - _REST
    if profile == "reversing":
        shape = np.where(np.floor(since / 0.5).astype(int) % 2 == 0, 1.0, -1.0)
    elif profile == "pulse":
        shape = np.where(since < 0.7, 1.0, 0.0)
    elif profile == "ramp":
        shape = np.minimum(since / 1.2, 1.0)
    else:
        shape = np.ones(len(time))
    return np.where(since < 0.0, 0.0, size * shape)
