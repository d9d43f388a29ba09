"""What the measurement says of every block of a rig run: speed, load, place, time since the reversal, …"""

from __future__ import annotations

import numpy as np

from omnimj.gap.rig_runs import RigRuns
from omnimj.signals import Array

_STANDING = 0.01  # [m/s]


def travelled(runs: RigRuns) -> Array:
    """Path along the rail from the measured speed, from 0 at each run's start, per block [m]."""
    parts = []
    for p in runs.pieces:
        speed = np.nan_to_num(runs.measured[p.first : p.last, 1])
        parts.append(np.cumsum(speed) * runs.size * runs.period)
    return np.concatenate(parts)


def spans(runs: RigRuns) -> dict[str, tuple[float, float]]:
    """Variable → lowest and highest value that the runs cover."""
    speed, position = runs.measured[:, 1], travelled(runs)
    ends = {
        "speed": (float(np.nanmin(speed)), float(np.nanmax(speed))),
        "position": (float(position.min()), float(position.max())),
        "time": (0.0, max(float(p.time[-1]) for p in runs.pieces)),
        "lateral_speed": (float(runs.lateral.min()), float(runs.lateral.max())),
    }
    return {name: (low, max(high, low + 1e-3)) for name, (low, high) in ends.items()}


def regimes(runs: RigRuns) -> dict[str, tuple[str, Array]]:
    """Variable → unit and value per block; those that do not vary are left out."""
    speed, turned = np.nan_to_num(runs.measured[:, 1]), []
    lateral, current, since = [], [], []
    for k, p in enumerate(runs.pieces):
        rows = slice(p.first, p.last)
        samples = slice(runs.first[k], runs.first[k] + (p.last - p.first) * runs.size)
        lateral.append(runs.lateral[samples].reshape(-1, runs.size).mean(axis=1))
        current.append(runs.current[samples].reshape(-1, runs.size).mean(axis=1))
        turned.append(np.cumsum(np.nan_to_num(runs.measured[rows, 0])) * runs.size * runs.period)
        since.append(_since_reversal(speed[rows], p.time))
    size = np.array([p.last - p.first for p in runs.pieces])
    found = {
        "speed": ("m/s", speed),
        "acceleration": ("m/s2", np.nan_to_num(runs.measured[:, 2])),
        "current": ("A", np.concatenate(current)),
        "load": ("kg", np.repeat(runs.mass, size)),
        "lateral_speed": ("m/s", np.concatenate(lateral)),
        "position": ("m", travelled(runs)),
        "wheel_angle": ("rad", np.concatenate(turned)),
        "time": ("s", np.concatenate([p.time for p in runs.pieces])),
        "reversal": ("s", np.concatenate(since)),
    }
    for floor in sorted(set(runs.floor)) if len(set(runs.floor)) > 1 else ():
        found[f"floor {floor}"] = ("1", np.repeat(np.array([float(f == floor) for f in runs.floor]), size))
    return {name: entry for name, entry in found.items() if np.ptp(entry[1]) > 0.0}


def _since_reversal(speed: Array, time: Array) -> Array:
    """Time since the direction last changed [s]."""
    sign = np.sign(np.where(abs(speed) < _STANDING, 0.0, speed))
    since, last, direction = np.empty(len(speed)), 0.0, 0.0
    for k, s in enumerate(sign):
        if s and s != direction:
            last, direction = time[k], s
        since[k] = time[k] - last
    return since
